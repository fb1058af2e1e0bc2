//! What is refused, with which exit code, and that the message names it.

use serde_json::json;

use crate::dive::{Dive, INPUT};

#[test]
fn help_of_every_subcommand() {
    let dive = Dive::new();
    let usage = |args: &str| dive.run(&format!("{args} --help")).ends_with(0).stdout;
    let all = usage("");
    for command in
        ["encode", "decode", "render", "inspect", "trim", "map", "key-frames", "bench", "demo"]
    {
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
        (&format!("{encode} --start-offset 1,2,3"), "6 numbers are due, but 3 were given"),
        (&format!("{encode} --start-offset 1,2,3,4,5,nan"), "finite"),
        (&format!("{encode} --bytes many"), "many"),
        (&format!("{encode} --optimizer newton"), "gauss-newton"),
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
        (&format!("{encode} cameras.json --starts none.csv"), "none.csv"),
        (&format!("{encode} cameras.json --limit 0"), "cameras.json"),
        (&format!("{render} --device nothing-like-it"), "nothing-like-it"),
        ("render --prior prior.ply --cameras cameras.json --out a.png --frame x.png", "\"x.png\""),
    ] {
        dive.run(args).ends_with(1).says(named);
    }
    std::fs::remove_file(dive.path("images/1.png")).unwrap();
    dive.run(&format!("encode {INPUT} --packets p")).ends_with(1).says("images/1.png");
}

#[test]
fn wrong_figures_and_files_are_named() {
    let dive = Dive::new();
    let encode = format!("encode {INPUT} --packets p");
    for (args, named) in [
        ("--quality 101", "quality must lie in 0..=100"),
        ("--quality nan", "quality must lie in 0..=100"),
        ("--psnr nan", "PSNR"),
        ("--bytes 20", "a budget of 20 bytes"),
        ("--near nan", "near"),
        ("--summary none/s.json", "none/s.json"),
    ] {
        dive.run(&format!("{encode} {args}")).ends_with(1).says(named);
    }
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
