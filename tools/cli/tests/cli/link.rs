//! `nvsprior split` and `join`: packets through a modem, as files and as datagrams; `nvsprior devices`.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use crate::dive::{Dive, pictures};

const DECODE: &str = "decode --prior prior.ply --frames out --packets";

#[test]
fn packets_come_back_from_their_frames() {
    let dive = Dive::new();
    dive.encode("--psnr 45");
    for mtu in [31, 64, 1024] {
        let split = "split packets/0.nvsp packets/1.nvsp packets/2.nvsp --out";
        let run = dive.run(&format!("{split} frames-{mtu} --mtu {mtu}")).ends_with(0);
        assert!(run.stdout.starts_with("3 packets in "), "{}", run.stdout);
        // In the wrong order, and some twice: names tell the order in which frames are taken.
        let frames = dive.path(&format!("frames-{mtu}"));
        let twice = frames.join("2-0000.frame");
        std::fs::copy(&twice, frames.join("9-0000.frame")).unwrap();
        let run = dive.run(&format!("join frames-{mtu} --out joined-{mtu}")).ends_with(0);
        assert!(run.stdout.starts_with("3 packets, 3 of them complete"), "{}", run.stdout);
        for number in 0..3 {
            let joined = dive.bytes(&format!("joined-{mtu}/{number:08}.nvsp"));
            assert!(joined == dive.bytes(&format!("packets/{number}.nvsp")), "MTU {mtu}");
        }
    }
}

#[test]
fn of_a_packet_with_a_gap_what_comes_before_it_is_shown() {
    let dive = Dive::new();
    dive.encode("--psnr 45 --limit 1");
    dive.run("split packets/0.nvsp --out frames --mtu 64").ends_with(0);
    let mut frames = std::fs::read_dir(dive.path("frames")).unwrap().count();
    assert!(frames > 4, "{frames} frames");
    frames /= 2;
    std::fs::remove_file(dive.path(&format!("frames/0-{frames:04}.frame"))).unwrap();
    std::fs::write(dive.path("frames/0-9999.frame"), b"noise").unwrap();
    let run = dive.run("join frames --out joined").ends_with(0);
    assert!(
        run.stdout.starts_with("1 packets, 0 of them complete; 1 frames were"),
        "{}",
        run.stdout
    );
    assert_eq!(dive.bytes("joined/00000000.nvsp").len(), 64 + (frames - 1) * 60);
    dive.run(&format!("{DECODE} joined")).ends_with(0).says("the render alone is written");
    let render = dive.picture("out/00000000.png").psnr(&pictures()[0]);
    dive.run(&format!("{DECODE} joined --joined")).ends_with(0);
    let shown = dive.picture("out/00000000.png").psnr(&pictures()[0]);
    assert!(shown > render, "{render} dB of the render, {shown} dB");
}

#[test]
fn frames_come_over_udp() {
    let dive = Dive::new();
    dive.encode("--psnr 45");
    let mut join = Command::new(env!("CARGO_BIN_EXE_nvsprior"))
        .args(["join", "--udp", "127.0.0.1:0", "--mtu", "128", "--idle", "4", "--out", "joined"])
        .current_dir(dive.path(""))
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut told = String::new();
    BufReader::new(join.stderr.take().unwrap()).read_line(&mut told).unwrap();
    let address = told.trim().rsplit(' ').next().unwrap().to_owned();
    let split = format!("split packets/0.nvsp packets/1.nvsp --mtu 128 --udp {address}");
    dive.run(&format!("{split} --bit-rate 2000000")).ends_with(0);
    assert!(join.wait().unwrap().success());
    for number in 0..2 {
        let joined = dive.bytes(&format!("joined/{number:08}.nvsp"));
        assert_eq!(joined, dive.bytes(&format!("packets/{number}.nvsp")));
    }
}

#[test]
fn devices_are_listed() {
    let dive = Dive::new();
    let run = dive.run("devices").ends_with(0);
    assert!(
        run.stdout.starts_with("0: ") && run.stdout.contains("can run nvsprior"),
        "{}",
        run.stdout
    );
    let none = [("VK_ICD_FILENAMES", "none.json"), ("VK_DRIVER_FILES", "none.json")];
    dive.run_with("devices", &none).ends_with(1).says("apt-get install mesa-vulkan-drivers");
}
