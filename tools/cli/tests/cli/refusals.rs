//! What is refused, with which exit code, and that the message names it.

use serde_json::json;

use crate::dive::{Dive, INPUT};

#[test]
fn help_of_every_subcommand() {
    let dive = Dive::new();
    let usage = |args: &str| dive.run(&format!("{args} --help")).ends_with(0).stdout;
    let all = usage("");
    for command in [
        "encode", "decode", "split", "join", "key", "render", "inspect", "import", "map", "prior",
        "demo", "devices",
    ] {
        assert!(all.contains(&format!("\n  {command} ")), "{all}");
        let text = usage(command);
        assert!(text.contains(&format!("Usage: nvsprior {command}")), "{text}");
    }
    let version = dive.run("--version").ends_with(0).stdout;
    assert_eq!(version.trim(), concat!("nvsprior ", env!("CARGO_PKG_VERSION")));
}

#[test]
fn wrong_usage_ends_with_2() {
    let dive = Dive::new();
    let encode = format!("encode {INPUT} --packets p");
    for (args, named) in [
        ("", "Usage"),
        ("dive", "dive"),
        ("inspect", "<PRIOR>"),
        ("encode --prior prior.ply --packets p", "--cameras"),
        ("render --prior prior.ply --cameras cameras.json --frame images/0.png", "--out"),
        (&format!("{encode} --quality 10 --bytes 100"), "--bytes"),
        (&format!("{encode} --bytes many"), "many"),
        (&format!("{encode} --optimizer bfgs"), "gauss-newton"),
        (&format!("{encode} --residual webp"), "wavelet, none"),
        (&format!("{encode} --mode sometimes"), "intra, stream[:N]"),
        (&format!("{encode} --region 1,2,3,4,0"), "from 1 to 255"),
        (&format!("{encode} --quality 101"), "between 0 and 100"),
        (&format!("{encode} --quality -1"), "between 0 and 100"),
        (&format!("{encode} --quality 1e30"), "between 0 and 100"),
        (&format!("{encode} --quality nan"), "between 0 and 100"),
        (&format!("{encode} --psnr nan"), "between 1 and 100 dB"),
        (&format!("{encode} --near nan"), "between 1e-6 and 1e6"),
        (&format!("{encode} --near 1e30"), "between 1e-6 and 1e6"),
        (&format!("{encode} --alpha-max 1"), "between 0.01 and 0.9999"),
        (&format!("{encode} --threshold nan"), "between 0 and 1"),
        (&format!("{encode} --limit 999999999999"), "from 0 to 100,000"),
        (&format!("{encode} --starts last"), "neither `none`, `first` or `camera-file`"),
        (&format!("{encode} --summary summary.txt"), "must end in .json"),
        (&format!("{encode} --sheet sheet.jpg"), "must end in .png"),
        (
            "render --prior prior.ply --cameras cameras.json --frame images/0.png --out v.jpg",
            ".png",
        ),
        ("decode --prior prior.ply --packets p --frames out --width 160", "--cameras"),
        ("demo --run T9", "there are: T1, T2, T3, T4, T5"),
        ("demo --run T1 --width 100", "160..=4096"),
        ("demo --rate -3", "between 0.1 and 1000 frames per second"),
        ("split a.nvsp --mtu 7 --out frames", "8..=65535"),
        ("split a.nvsp --mtu 64", "--out"),
        ("join --out packets", "<DIR>"),
    ] {
        dive.run(args).ends_with(2).says(named);
    }
}

#[test]
fn without_a_driver_it_says_what_to_install() {
    let dive = Dive::new();
    let none = [("VK_ICD_FILENAMES", "none.json"), ("VK_DRIVER_FILES", "none.json")];
    let render = "render --prior prior.ply --cameras cameras.json --frame images/0.png --out a.png";
    dive.run_with(render, &none).ends_with(1).says("apt-get install mesa-vulkan-drivers");
}

#[test]
fn missing_things_are_named() {
    let dive = Dive::new();
    let encode = "encode --packets p --prior prior.ply --cameras";
    let render = "render --prior prior.ply --cameras cameras.json --out a.png --frame images/0.png";
    for (args, named) in [
        ("inspect none.ply", "none.ply"),
        ("encode --prior none.ply --cameras cameras.json --packets p", "none.ply"),
        ("decode --prior prior.ply --packets none --frames out", "none"),
        ("decode --prior prior.ply --packets images --frames out", "images: no packets"),
        (&format!("{encode} none.json"), "none.json"),
        (&format!("{encode} cameras.json --split night"), "\"night\"; there are: dive, survey"),
        (&format!("{encode} cameras.json --limit 0"), "cameras.json"),
        (
            &format!("{render} --device nothing-like-it"),
            "no Vulkan device \"nothing-like-it\"; there are: 0: ",
        ),
        (&format!("{render} --device 37"), "no Vulkan device \"37\"; there are: 0: "),
        ("join images --out packets", "images: no frames"),
        ("split none.nvsp --mtu 64 --out frames", "none.nvsp"),
        ("split prior.ply --mtu 64 --out frames", "prior.ply"),
        ("render --prior prior.ply --cameras cameras.json --out a.png --frame x.png", "\"x.png\""),
    ] {
        dive.run(args).ends_with(1).says(named);
    }
    std::fs::write(dive.path("images/1.png"), "text").unwrap();
    dive.run(&format!("encode {INPUT} --packets untouched"))
        .ends_with(1)
        .says("images/1.png: not a picture");
    assert!(!dive.path("untouched").exists(), "work began");
    std::fs::remove_file(dive.path("images/1.png")).unwrap();
    dive.run(&format!("encode {INPUT} --packets p")).ends_with(1).says("images/1.png");
}

#[test]
fn wrong_figures_and_files_are_named() {
    let dive = Dive::new();
    std::fs::create_dir(dive.path("folder.json")).unwrap();
    let encode = format!("encode {INPUT} --packets p");
    for (args, named) in [
        ("--bytes 20", "a budget of 20 bytes"),
        ("--summary none/s.json", "--summary none/s.json: cannot be written"),
        ("--sheet none/s.png", "--sheet none/s.png: cannot be written"),
        ("--summary folder.json", "this is a folder; give a file"),
        ("--pictures prior.ply", "--pictures prior.ply: this is a file; give a folder"),
    ] {
        dive.run(&format!("{encode} {args}")).ends_with(1).says(named);
    }
    let onto_file = format!("encode {INPUT} --packets cameras.json");
    dive.run(&onto_file).ends_with(1).says("--packets cameras.json: this is a file; give a folder");
    let not_text = "encode --prior prior.ply --packets p --cameras prior.ply";
    dive.run(not_text).ends_with(1).says("prior.ply: not text; a camera file is JSON");
    let encode = "encode --prior prior.ply --packets p --cameras bad.json";
    for (key, value, named) in [
        ("fx", json!(-1), "fx = -1"),
        ("fx", json!("wide"), "\"fx\" is missing or no finite number"),
        ("width", json!(0), "\"width\" is 0"),
        ("width", json!(1e9), "\"width\" is 1000000000"),
        ("height", json!(5000), "5000"),
        ("images", json!(1), "neither"),
    ] {
        let mut cameras = dive.json("cameras.json");
        cameras[key] = value;
        dive.write_json("bad.json", &cameras);
        dive.run(encode).ends_with(1).says("bad.json").says(named);
    }
    let mut cameras = dive.json("cameras.json");
    cameras["images"][0]["qvec"] = json!([1, null, 0, 0, 0]);
    dive.write_json("bad.json", &cameras);
    dive.run(encode).ends_with(1).says("bad.json").says("qvec");
    std::fs::write(dive.path("prior.ply"), &dive.bytes("prior.ply")[..5000]).unwrap();
    dive.run("inspect prior.ply").ends_with(1).says("prior.ply").says("truncated");
}
