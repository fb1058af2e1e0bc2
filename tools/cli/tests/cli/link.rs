//! `nvsprior split` and `join`: packets through a modem, as files and as datagrams; `nvsprior link`; `nvsprior
//! devices`.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use nvsprior::packet::Packet;
use nvsprior_link::modem::Sharer;

use crate::dive::{Dive, FRAMES, INPUT, name, pictures, save};

const DECODE: &str = "decode --prior prior.ply --frames out --overwrite --packets";

#[test]
fn packets_come_back_from_their_frames() {
    let dive = Dive::new();
    dive.encode("--psnr 45");
    for mtu in [16, 64, 1024] {
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
    // Nothing complete is no success; what came is there.
    let run = dive.run("join frames --out joined").ends_with(1).says("no packet is complete");
    assert!(
        run.stdout.starts_with("1 packets, 0 of them complete; 1 frames were"),
        "{}",
        run.stdout
    );
    assert_eq!(dive.bytes("joined/00000000.nvsp").len(), 63 + (frames - 1) * 60);
    dive.run(&format!("{DECODE} joined")).ends_with(0).says("the render alone is written");
    let render = dive.picture("out/00000000.png").psnr(&pictures()[0]);
    dive.run(&format!("{DECODE} joined --joined")).ends_with(0);
    let shown = dive.picture("out/00000000.png").psnr(&pictures()[0]);
    assert!(shown > render, "{render} dB of the render, {shown} dB");
}

/// Copies the frames of a folder to another one, under numbers that go on.
fn add_frames(dive: &Dive, from: &str, to: &str) {
    std::fs::create_dir_all(dive.path(to)).unwrap();
    let list = |folder: &str| {
        let entries = std::fs::read_dir(dive.path(folder)).unwrap();
        let mut paths: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
        paths.sort();
        paths
    };
    for (i, path) in (list(to).len()..).zip(list(from)) {
        std::fs::copy(path, dive.path(&format!("{to}/{i:05}.frame"))).unwrap();
    }
}

/// Two dives, of which each counts its frames from 0.
fn two_dives() -> Dive {
    let dive = Dive::new();
    for (name, quality) in [("one", 20), ("two", 60)] {
        dive.encode(&format!("--quality {quality}"));
        let split =
            format!("split packets/0.nvsp packets/1.nvsp packets/2.nvsp --out {name} --mtu 64");
        dive.run(&split).ends_with(0);
        std::fs::rename(dive.path("packets"), dive.path(&format!("packets-{name}"))).unwrap();
    }
    dive
}

#[test]
fn frame_numbers_that_begin_anew_lose_no_dive() {
    let dive = two_dives();
    add_frames(&dive, "one", "frames");
    // What is late or comes again is of the same dive.
    add_frames(&dive, "one", "frames");
    add_frames(&dive, "two", "frames");
    add_frames(&dive, "one", "frames");
    let run = dive.run("join frames --out joined").ends_with(0).says("begin anew");
    assert!(run.stdout.contains("6 packets, 6 of them complete"), "{}", run.stdout);
    assert!(run.stdout.contains("joined/2: 3 packets, 3 of them complete"), "{}", run.stdout);
    for (folder, packets) in [("joined", "packets-one"), ("joined/2", "packets-two")] {
        for i in 0..3 {
            let joined = dive.bytes(&format!("{folder}/{i:08}.nvsp"));
            assert_eq!(joined, dive.bytes(&format!("{packets}/{i}.nvsp")), "{folder}, {i}");
        }
    }
    assert!(!dive.path("joined/3").exists());
    // With one dive the second's packets are gone, too.
    dive.run("join one --out joined --overwrite").ends_with(0);
    assert!(!dive.path("joined/2/00000000.nvsp").exists());
}

/// Of the first dive the first packet is lost: the second dive's is no part of it.
#[test]
fn packets_before_the_sign_of_a_new_run_are_of_that_run() {
    let dive = two_dives();
    add_frames(&dive, "one", "frames");
    let first = |name: &std::fs::DirEntry| name.file_name().to_string_lossy().starts_with("0-");
    let of_first =
        std::fs::read_dir(dive.path("one")).unwrap().filter(|e| first(e.as_ref().unwrap()));
    for i in 0..of_first.count() {
        std::fs::remove_file(dive.path(&format!("frames/{i:05}.frame"))).unwrap();
    }
    std::fs::rename(dive.path("frames"), dive.path("cut")).unwrap();
    add_frames(&dive, "cut", "frames");
    add_frames(&dive, "two", "frames");
    dive.run("join frames --out joined").ends_with(0);
    assert!(!dive.path("joined/00000000.nvsp").exists());
    for i in 0..3 {
        let joined = dive.bytes(&format!("joined/2/{i:08}.nvsp"));
        assert_eq!(joined, dive.bytes(&format!("packets-two/{i}.nvsp")));
    }
}

/// From 65,535 on numbers begin at 0: that is no other dive.
#[test]
fn numbers_that_run_over_are_of_one_run() {
    let dive = Dive::new();
    dive.encode("--limit 1");
    let (packet, mut sharer) = (dive.bytes("packets/0.nvsp"), Sharer::default());
    std::fs::create_dir(dive.path("frames")).unwrap();
    let mut count = 0;
    for number in [65_533_u32, 65_534, 65_535, 0, 1, 2] {
        let mut parsed = Packet::decode(&packet).unwrap();
        parsed.latent.frame = number;
        let mut packet = Vec::new();
        parsed.write(&mut packet).unwrap();
        sharer.split(&packet, 64).unwrap();
        for frame in sharer.shares() {
            std::fs::write(dive.path(&format!("frames/{count:05}.frame")), frame).unwrap();
            count += 1;
        }
    }
    let run = dive.run("join frames --out joined").ends_with(0);
    assert!(run.stdout.starts_with("6 packets, 6 of them complete"), "{}", run.stdout);
    assert!(!run.stdout.contains("anew"), "{}", run.stdout);
}

#[test]
fn an_mtu_that_is_not_the_frames_is_named() {
    let dive = Dive::new();
    dive.encode("--psnr 45");
    for (mtu, packets) in [(64, "packets/0.nvsp packets/1.nvsp"), (128, "packets/2.nvsp")] {
        dive.run(&format!("split {packets} --out frames-{mtu} --mtu {mtu}")).ends_with(0);
        add_frames(&dive, &format!("frames-{mtu}"), "both");
    }
    dive.run("join both --out joined").says("--mtu 64").says("two MTUs");
    std::fs::create_dir(dive.path("padded")).unwrap();
    for (i, entry) in std::fs::read_dir(dive.path("frames-64")).unwrap().enumerate() {
        let mut frame = std::fs::read(entry.unwrap().path()).unwrap();
        frame.resize(80, 0);
        std::fs::write(dive.path(&format!("padded/{i:05}.frame")), frame).unwrap();
    }
    dive.run("join padded --out none")
        .ends_with(1)
        .says("--mtu 64 yields 2 complete")
        .says("padded to 80");
    dive.run("join padded --out some --mtu 64").ends_with(0);
    // A packet of one frame is whole by any MTU, and some frames are lost: that is no other MTU.
    dive.run(&format!("encode {INPUT} --residual none --packets small")).ends_with(0);
    let small = "split small/0.nvsp small/1.nvsp packets/2.nvsp --out lossy --mtu 64";
    dive.run(small).ends_with(0);
    std::fs::remove_file(dive.path("lossy/2-0001.frame")).unwrap();
    let run = dive.run("join lossy --out of-lossy").ends_with(0);
    assert!(run.stdout.contains("2 of them complete"), "{}", run.stdout);
    assert!(!run.stderr.contains("MTU"), "{}", run.stderr);
}

const LINK: &str =
    "link --prior prior.ply --cameras cameras.json --threshold 1e-2 --fps 10 --bit-rate 16000";

#[test]
fn a_link_tells_what_the_pilot_sees() {
    let dive = Dive::new();
    let run = format!("{LINK} --seconds 2 --loss 0,0.3 --seed 4 --report");
    dive.run(&format!("{run} one")).ends_with(0);
    let link = dive.json("one/link.json");
    let settings = link["settings"].as_array().unwrap();
    let psnr = |at: usize| settings[at]["shown_psnr"].as_f64().unwrap();
    assert_eq!(link["shown_psnr"], settings[0]["shown_psnr"]);
    assert!(psnr(1) > 20.0 && psnr(0) > psnr(1), "{} {}", psnr(0), psnr(1));
    for setting in settings {
        let bytes = setting["bytes"].as_object().unwrap();
        let sum: u64 = bytes
            .iter()
            .filter(|(name, _)| *name != "total")
            .map(|(_, n)| n.as_u64().unwrap())
            .sum();
        assert_eq!(bytes["total"], sum);
        assert!(setting["worst_second_bits"].as_f64().unwrap() <= 16_000.0 + 1e-3);
        assert!(setting["latency_ms"].as_f64().unwrap() <= 1500.0);
        assert!(setting["pictures_per_second"].as_f64().unwrap() > 5.0);
        let shown = setting["shown"].as_object().unwrap();
        assert_eq!(shown.values().map(|n| n.as_u64().unwrap()).sum::<u64>(), 20);
    }
    assert_eq!(settings[0]["lost_frames"], 0);
    assert_eq!(settings[0]["shown"]["own"], 20);
    assert!(settings[1]["repaired"].as_u64().unwrap() > 0);
    let rows = String::from_utf8(dive.bytes("one/frames.csv")).unwrap();
    assert_eq!(rows.lines().count(), 1 + 2 * 20);
    assert!(dive.bytes("one/link.svg").starts_with(b"<svg"));
    // The same arguments give the same result.
    dive.run(&format!("{run} two")).ends_with(0);
    for file in ["link.json", "frames.csv"] {
        assert!(dive.bytes(&format!("one/{file}")) == dive.bytes(&format!("two/{file}")), "{file}");
    }
}

/// As with the smallest modems: eight bytes, eight bytes a second.
#[test]
fn a_picture_of_the_prior_comes_over_64_bits_per_second() {
    let dive = Dive::new();
    let link = LINK.replace("16000", "64").replace("--fps 10", "--fps 2");
    let run = format!("{link} --seconds 40 --mtu 8");
    for (folder, args) in [("alone", ""), ("told", "--return-delay 2")] {
        dive.run(&format!("{run} {args} --report {folder}")).ends_with(0);
        let link = dive.json(&format!("{folder}/link.json"));
        assert_eq!(link["lost_frames"], 0, "{folder}");
        assert!(link["first_picture_seconds"].as_f64().unwrap() < 5.0, "{folder}: {link}");
        assert!(link["pictures_per_second"].as_f64().unwrap() > 0.25, "{folder}: {link}");
        assert!(link["worst_second_bits"].as_f64().unwrap() <= 64.0 + 1e-3, "{folder}");
    }
    // Eight bytes hold the start of no packet that states its session: all of it takes eight frames at most.
    dive.encode("--residual none --limit 1");
    dive.run("split packets/0.nvsp --out frames --mtu 8").ends_with(0);
    dive.run("join frames --out joined").ends_with(0);
    assert_eq!(dive.bytes("joined/00000000.nvsp"), dive.bytes("packets/0.nvsp"));
}

#[test]
fn frames_of_a_stream_are_predicted_from_what_the_topside_has() {
    let dive = Dive::new();
    // The camera stands still: else it is chance whether an inter frame is shorter.
    (1..=FRAMES).for_each(|t| save(&pictures()[0], &dive.path(&name(t))));
    let run = format!("{} --seconds 3", LINK.replace("16000", "256000"));
    let link = |folder: &str, args: &str| {
        dive.run(&format!("{run} {args} --report {folder}")).ends_with(0);
        dive.json(&format!("{folder}/link.json"))
    };
    let bytes = |link: &serde_json::Value, way: &str| link["bytes"][way].as_u64().unwrap();
    let psnr = |link: &serde_json::Value| link["shown_psnr"].as_f64().unwrap();
    // Without losses, what is shown is what the vehicle has.
    for (folder, args) in [
        ("chain", "--mode chain:0"),
        ("keys", "--mode keys:4"),
        ("acknowledged", "--mode acknowledged --return-delay 0.2 --latency 4.5"),
    ] {
        let link = link(folder, args);
        assert_eq!(link["whole_frames"], link["sent_frames"], "{folder}");
        assert!(
            link["leaning_frames"].as_u64().unwrap() > 0,
            "{folder}: {}",
            link["leaning_frames"]
        );
        let sent = link["sent_psnr"].as_f64().unwrap();
        assert!((psnr(&link) - sent).abs() < 1e-9, "{folder}: {sent} {}", psnr(&link));
        assert_eq!(bytes(&link, "resent"), 0);
    }
    // With losses, frames without their reference are shown as far as they can be.
    let lossy = link("lossy", "--mode chain:0 --loss 0.3");
    assert!(psnr(&lossy) > 20.0, "{}", psnr(&lossy));
}

#[test]
fn a_link_that_cannot_be_is_refused() {
    let dive = Dive::new();
    for (args, text) in [
        ("--loss 1", "a loss of 1"),
        ("--burst 0.5", "in bursts of 0.5"),
        ("--latency 0.15", "latency"),
        ("--bit-rate 0", "between 0.01 and 1e9"),
        ("--mtu 7", "--mtu"),
        ("--mode acknowledged", "--return-delay"),
    ] {
        dive.run(&format!("{} {args} --report x", LINK.replace(" --bit-rate 16000", "")))
            .ends_with(2)
            .says(text);
    }
}

/// What is stopped tells what came.
#[cfg(unix)]
#[test]
fn a_join_that_is_stopped_tells_its_counts() {
    let dive = Dive::new();
    dive.encode("--limit 1");
    let mut join = Command::new(env!("CARGO_BIN_EXE_nvsprior"))
        .args(["join", "--udp", "127.0.0.1:0", "--mtu", "128", "--idle", "600", "--out", "joined"])
        .current_dir(dive.path(""))
        .stderr(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut told = String::new();
    BufReader::new(join.stderr.take().unwrap()).read_line(&mut told).unwrap();
    let address = told.trim().rsplit(' ').next().unwrap().to_owned();
    dive.run(&format!("split packets/0.nvsp --mtu 128 --udp {address}")).ends_with(0);
    while !dive.path("joined/00000000.nvsp").exists() {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let stop = Command::new("kill").args(["-TERM", &join.id().to_string()]).status();
    assert!(stop.unwrap().success());
    let output = join.wait_with_output().unwrap();
    assert!(output.status.success());
    assert!(String::from_utf8_lossy(&output.stdout).starts_with("1 packets, 1 of them complete"));
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

/// RADV compiles for a GPU that is not there, and calls that a discrete GPU. Its driver may be missing.
#[test]
fn a_device_without_hardware_is_listed_and_never_used() {
    let dive = Dive::new();
    let null = [("RADV_FORCE_FAMILY", "navi21")];
    let run = dive.run_with("devices", &null).ends_with(0);
    let Some((_, rest)) = run.stdout.split_once("Null hardware") else {
        eprintln!("skipped: Mesa's RADV is not installed");
        return;
    };
    let rest = rest.lines().take(4).collect::<Vec<_>>().join("\n");
    assert!(rest.contains("cannot run nvsprior: it has no hardware"), "{}", run.stdout);
    dive.run_with("devices --check 1 --device Null", &null).ends_with(1).says("no hardware");
    let run = dive.run_with("devices --check 1", &null).ends_with(0);
    assert!(!run.stderr.contains("Null hardware"), "{}", run.stderr);
}
