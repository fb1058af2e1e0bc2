//! `nvsprior inspect` and `nvsprior prior trim`: what a prior does not need.

use nvsprior::prior::Splats;
use nvsprior::{Prior, RenderOptions};

use crate::dive::Dive;
use crate::scene::{wall, write_prior};

/// What a row of a report says.
pub fn row<'a>(text: &'a str, name: &str) -> &'a str {
    let line = text.lines().find(|line| line.starts_with(&format!("{name:14} ")));
    line.unwrap_or_else(|| panic!("no row \"{name}\" in:\n{text}"))[15..].trim()
}

/// The wall with a band of zeros, and with every tenth splat a second time, too faint to show.
fn padded() -> Prior {
    let wall = wall(1);
    let from = wall.splats();
    let mut splats = Splats { sh_degree: 1, ..Splats::default() };
    for i in 0..from.len() {
        for logit in [3.0, -7.0].into_iter().take(1 + usize::from(i % 10 == 0)) {
            splats.positions.push(from.positions[i]);
            splats.log_scales.push(from.log_scales[i]);
            splats.rotations.push(from.rotations[i]);
            splats.opacity_logits.push(logit);
            splats.sh.extend(&from.sh[3 * i..][..3]);
            splats.sh.extend([0.0; 9]);
        }
    }
    Prior::from_splats(splats, RenderOptions::INRIA).unwrap()
}

#[test]
fn inspect_says_what_is_left_out() {
    let dive = Dive::new();
    let text = dive.run("inspect prior.ply").ends_with(0).stdout;
    assert!(row(&text, "left out").starts_with("nothing"), "{text}");
    assert!(row(&text, "alpha guard").starts_with("idle"), "{text}");
    assert!(row(&text, "colour guard").starts_with("idle"), "{text}");
    assert_eq!(row(&text, "pyramid"), "1, 1/2, 1/4, 1/8 of 320×180");
    assert!(row(&text, "render").ends_with("ms, with nothing left out"), "{text}");
    write_prior(&dive.path("padded.ply"), &padded());
    let text = dive.run("inspect padded.ply").ends_with(0).stdout;
    // 480 of 56 + 48 bytes; 4,800 with 24 bytes in place of 48.
    for part in [
        "480 splats never seen (exact), 49920 bytes",
        "1 bands of zeros (exact), 115200 bytes",
        "ms with all of it",
    ] {
        assert!(text.contains(part), "no \"{part}\" in:\n{text}");
    }
    // The pictures that packets are made of stay the same.
    let render = "render --cameras cameras.json --frame images/1.png";
    dive.run(&format!("{render} --prior prior.ply --raw a.npy")).ends_with(0);
    dive.run(&format!("{render} --prior padded.ply --raw b.npy")).ends_with(0);
    assert_eq!(dive.bytes("a.npy"), dive.bytes("b.npy"));
}

#[test]
fn inspect_of_a_mission_tells_what_its_views_do_not_show() {
    let dive = Dive::new();
    let mission = "--cameras cameras.json --split dive";
    let inspect = format!("inspect prior.ply {mission} --tolerance 0.1");
    let text = dive.run(&inspect).ends_with(0).stdout;
    let count =
        |name: &str| -> usize { row(&text, name).split(' ').next().unwrap().parse().unwrap() };
    let (unseen, hardly) = (count("unseen"), count("hardly seen"));
    assert!(unseen > 1000 && hardly >= unseen, "{text}");
    assert!(row(&text, "unseen").contains("0.000 dB lost"), "{text}");
    assert!(text.contains("at 1 views of other splits"), "{text}");
    // Cameras with a margin see more.
    let margin = format!("inspect prior.ply {mission} --margin 0.5,5");
    let text = dive.run(&margin).ends_with(0).stdout;
    let less: usize = row(&text, "unseen").split(' ').next().unwrap().parse().unwrap();
    assert!(less < unseen, "{less} of {unseen}");
    // Without a device it says what is known without pictures.
    let none = [("VK_ICD_FILENAMES", "none.json"), ("VK_DRIVER_FILES", "none.json")];
    let text = dive.run_with(&inspect, &none).ends_with(0).stdout;
    assert!(row(&text, "render").starts_with("not measured: "), "{text}");
}

#[test]
fn trim_writes_a_prior_that_shows_nearly_the_same() {
    let dive = Dive::new();
    let mission = "--cameras cameras.json --split dive --steps 4";
    let trim = format!("prior trim prior.ply {mission} --out small.ply --sheet sheet.png");
    let text = dive.run(&trim).ends_with(0).stdout;
    let small = Prior::open(&dive.path("small.ply"), &Default::default()).unwrap();
    assert!(row(&text, "identity").ends_with(&format!("→ {}", small.id())), "{text}");
    assert!(row(&text, "splats").starts_with(&format!("4800 → {}, ", small.len())), "{text}");
    assert!(small.len() < 3000, "{text}");
    let lost = row(&text, "views").rsplit(", ").next().unwrap();
    let lost: f64 = lost.trim_end_matches(" dB lost").parse().unwrap();
    assert!(lost <= 0.1, "{text}");
    assert!(row(&text, "other splits").starts_with("1 views, "), "{text}");
    assert_eq!(dive.picture("sheet.png").height, 3 * (90 + 4) + 4);
    // Trims again with the same result. Then uses the reduced prior on a link.
    dive.run(&trim.replace("small.ply", "again.ply")).ends_with(0);
    assert_eq!(dive.bytes("small.ply"), dive.bytes("again.ply"));
    let encode = "encode --prior small.ply --cameras cameras.json --split dive --packets packets --overwrite";
    dive.run(encode).ends_with(0);
    dive.run("decode --prior small.ply --packets packets --overwrite --frames out").ends_with(0);
    let psnr = dive.picture("out/0.png").psnr(&dive.picture("images/0.png"));
    assert!(psnr > 25.0, "{psnr} dB");
}

#[test]
fn trim_without_frames_keeps_to_the_floor_within_the_margin() {
    let dive = Dive::new();
    std::fs::remove_dir_all(dive.path("images")).unwrap();
    let mission = "--cameras cameras.json --margin 0.2,3 --floor 40";
    let trim = format!("prior trim prior.ply {mission} --steps 2 --range 50 --out small.nvsg");
    let text = dive.run(&trim).ends_with(0).stdout;
    for name in ["views", "within margin"] {
        let psnr = row(&text, name).split(", ").nth(1).unwrap().split(' ').next().unwrap();
        assert!(psnr.parse::<f64>().unwrap() >= 40.0, "{text}");
    }
    assert!(!text.contains("against frames") && !text.contains("other splits"), "{text}");
    assert_eq!(row(&text, "key frames"), "0");
    assert!(text.contains("of the usual steps"), "{text}");
    let small = Prior::open(&dive.path("small.nvsg"), &Default::default()).unwrap();
    assert!(row(&text, "identity").ends_with(&format!("→ {}", small.id())), "{text}");
    let bytes = |name: &str| dive.bytes(name).len();
    assert!(8 * bytes("small.nvsg") < bytes("prior.ply"), "{text}");
    // Cameras with a margin need more of the prior than those of the file.
    let narrow = "--cameras cameras.json --floor 40 --steps 2 --out narrow.nvsg";
    dive.run(&format!("prior trim prior.ply {narrow}")).ends_with(0);
    let narrow = Prior::open(&dive.path("narrow.nvsg"), &Default::default()).unwrap();
    assert!(narrow.len() < small.len(), "{} against {}", narrow.len(), small.len());
}

#[test]
fn refusals_name_what_is_wrong() {
    let dive = Dive::new();
    let trim = "prior trim prior.ply --cameras cameras.json --out small.ply";
    for (args, code, named) in [
        ("prior trim prior.ply --out small.ply", 2, "--cameras"),
        ("prior trim prior.ply --cameras cameras.json", 2, "--out"),
        (&format!("{trim} --tolerance nan"), 2, "--tolerance"),
        (&format!("{trim} --margin=-1"), 2, "not negative"),
        (&format!("{trim} --split night"), 1, "\"night\"; there are: dive, survey"),
        ("prior trim none.ply --cameras cameras.json --out small.ply", 1, "none.ply"),
        ("prior trim prior.ply --cameras none.json --out small.ply", 1, "none.json"),
        ("prior trim prior.ply --cameras cameras.json --out small.obj", 1, "small.obj"),
        (
            "prior trim prior.ply --cameras cameras.json --out none/small.ply --steps 0",
            1,
            "none/small.ply",
        ),
        ("inspect prior.ply --tolerance 0.1", 2, "--cameras"),
        ("inspect prior.ply --split dive", 2, "--cameras"),
        ("inspect prior.ply --cameras none.json", 1, "none.json"),
    ] {
        dive.run(args).ends_with(code).says(named);
    }
    let mut cameras = dive.json("cameras.json");
    for image in cameras["images"].as_array_mut().unwrap() {
        image.as_object_mut().unwrap().remove("qvec");
    }
    dive.write_json("placeless.json", &cameras);
    dive.run("prior trim prior.ply --cameras placeless.json --out small.ply")
        .ends_with(1)
        .says("placeless.json: no view has a pose");
}
