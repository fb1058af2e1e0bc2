//! Folders that get a file for each frame: never those of two runs, and none lost.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::dive::{Dive, FRAMES, INPUT, pictures, save};

const DECODE: &str = "decode --prior prior.ply --packets packets --pictures seen";

fn names(dive: &Dive, folder: &str) -> Vec<String> {
    let name = |entry: std::io::Result<std::fs::DirEntry>| entry.unwrap().file_name();
    let entries = std::fs::read_dir(dive.path(folder)).unwrap();
    let mut names: Vec<_> = entries.map(|e| name(e).to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn a_folder_of_another_run_is_refused_or_replaced() {
    let dive = Dive::new();
    let encode = format!("encode {INPUT} --packets packets");
    let split = "split packets/0.nvsp --mtu 64 --out frames";
    let join = "join frames --out joined";
    for (first, holds) in
        [(&encode[..], "packets: holds"), (DECODE, "seen"), (split, "frames"), (join, "joined")]
    {
        dive.run(first).ends_with(0);
        let refused = dive.run(first).ends_with(1).says("two runs would be mixed").says(holds);
        assert!(refused.stderr.contains("--overwrite"));
    }
    std::fs::write(dive.path("packets/notes.txt"), "kept").unwrap();
    save(&pictures()[0], &dive.path("seen/own.png"));
    // A shorter run leaves nothing of the longer one.
    dive.run(&format!("{encode} --limit 1 --overwrite")).ends_with(0);
    assert_eq!(names(&dive, "packets"), ["0.nvsp", "notes.txt"]);
    dive.run(&format!("{DECODE} --overwrite")).ends_with(0);
    assert_eq!(names(&dive, "seen"), ["0.png", "own.png"]);
    dive.run(&format!("{split} --overwrite")).ends_with(0);
    dive.run(&format!("{join} --overwrite")).ends_with(0);
    assert_eq!(names(&dive, "joined"), ["00000000.nvsp"]);
}

#[test]
fn what_fails_or_is_killed_leaves_the_old_packets() {
    let dive = Dive::new();
    let encode = format!("encode {INPUT} --packets packets");
    dive.run(&encode).ends_with(0);
    let all = |dive: &Dive| -> Vec<Vec<u8>> {
        names(dive, "packets").iter().map(|name| dive.bytes(&format!("packets/{name}"))).collect()
    };
    let old = all(&dive);
    let other = format!("{encode} --quality 60 --overwrite");
    let whole = std::fs::read(dive.path("images/2.png")).unwrap();
    std::fs::write(dive.path("images/2.png"), &whole[..200]).unwrap();
    dive.run(&other).ends_with(1).says("images/2.png");
    assert_eq!(all(&dive), old);
    std::fs::write(dive.path("images/2.png"), &whole).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_nvsprior"))
        .args(other.split_whitespace())
        .current_dir(dive.path(""))
        .stderr(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let begun = dive.path("packets/.nvsprior-new-nvsp/0.nvsp");
    let since = Instant::now();
    while !begun.exists() && since.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let packets = |dive: &Dive| -> Vec<Vec<u8>> {
        (0..FRAMES).map(|i| dive.bytes(&format!("packets/{i}.nvsp"))).collect()
    };
    assert_eq!(packets(&dive), old);
    dive.run(&other).ends_with(0);
    assert_ne!(packets(&dive), old);
    assert_eq!(names(&dive, "packets").len(), FRAMES);
}

/// The names that are left if those of the files are alike.
#[test]
fn frames_of_like_names_have_a_packet_each() {
    let dive = Dive::new();
    std::fs::create_dir(dive.path("a")).unwrap();
    for name in ["a/1.png", "a_1.png", "a/1.webp"] {
        save(&pictures()[0], &dive.path(name));
    }
    let mut cameras = dive.json("cameras.json");
    let mut with = |files: &[&str]| {
        let first = cameras["images"][0].clone();
        let image = |(i, file): (usize, &&str)| {
            let mut image = first.clone();
            image["file"] = (*file).into();
            image["index"] = i.into();
            image
        };
        cameras["images"] = Value::Array(files.iter().enumerate().map(image).collect());
        dive.write_json("like.json", &cameras);
        dive.run("encode --prior prior.ply --cameras like.json --packets like --overwrite")
    };
    with(&["a/1.png", "a/1.webp"]).ends_with(0);
    assert_eq!(names(&dive, "like"), ["a_1.png.nvsp", "a_1.webp.nvsp"]);
    std::fs::create_dir(dive.path("b")).unwrap();
    save(&pictures()[0], &dive.path("b/1.png"));
    with(&["a/1.png", "a_1.png"]).ends_with(0);
    with(&["a/1.png", "a_1.png", "b/1.png"])
        .ends_with(1)
        .says("a/1.png and a_1.png would be written to one file");
    std::fs::create_dir(dive.path("packets")).unwrap();
    for folder in ["a", "b"] {
        std::fs::create_dir_all(dive.path(folder)).unwrap();
        std::fs::copy(dive.path("like/a_1.nvsp"), dive.path(&format!("{folder}/1.nvsp"))).unwrap();
    }
    dive.run("split a/1.nvsp b/1.nvsp --mtu 64 --out frames")
        .ends_with(1)
        .says("two frames have this name");
}

#[cfg(unix)]
#[test]
fn a_full_disk_costs_nothing_that_was_there() {
    let dive = Dive::new();
    std::fs::write(dive.path("old.png"), "an earlier picture").unwrap();
    let render =
        "render --prior prior.ply --cameras cameras.json --frame images/0.png --out old.png";
    let (code, said) = dive.run_limited(1024, render);
    assert!(code == Some(1) && said.contains("old.png"), "{said}");
    assert_eq!(dive.bytes("old.png"), b"an earlier picture");
    dive.run(&format!("encode {INPUT} --psnr 50 --packets packets")).ends_with(0);
    let old = dive.bytes("packets/0.nvsp");
    let again = format!("encode {INPUT} --psnr 50 --packets packets --overwrite");
    let (code, said) = dive.run_limited(old.len() as u64 / 1024 * 512, &again);
    assert!(code == Some(1) && said.contains("cannot write packets/0.nvsp"), "{said}");
    assert_eq!(dive.bytes("packets/0.nvsp"), old);
    assert_eq!(names(&dive, "packets").len(), FRAMES, "nothing of what failed stays");
    let (code, said) = dive.run_limited(512, &format!("encode {INPUT} --psnr 50 --packets new"));
    assert!(code == Some(1) && said.contains("cannot write new/0.nvsp"), "{said}");
    assert!(names(&dive, "new").is_empty(), "no file of 0 bytes");
}

#[cfg(target_os = "linux")]
#[test]
fn what_cannot_be_told_is_counted_and_ends_nothing() {
    let dive = Dive::without_frames();
    let full = || std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let run = |to_stderr: bool| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_nvsprior"));
        command.args(["import", "prior.ply", "--out", "a.nvsg"]).current_dir(dive.path(""));
        command.stdout(full());
        if to_stderr { command.stderr(full()).output() } else { command.output() }.unwrap()
    };
    for to_stderr in [false, true] {
        let output = run(to_stderr);
        assert!(output.status.success());
        assert!(dive.path("a.nvsg").exists());
        std::fs::remove_file(dive.path("a.nvsg")).unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(to_stderr || said.contains("lines could not be written"), "{said}");
    }
}
