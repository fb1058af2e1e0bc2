//! `nvsprior split` and `join`: packets through a modem, as files and as datagrams; `nvsprior link`; `nvsprior
//! devices`.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use crate::dive::{Dive, FRAMES, name, pictures, save};

const DECODE: &str = "decode --prior prior.ply --frames out --packets";

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
    let run = dive.run("join frames --out joined").ends_with(0);
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
