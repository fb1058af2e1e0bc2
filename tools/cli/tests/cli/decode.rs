//! `nvsprior decode`: what a topside meets.

use crate::dive::{Dive, pictures};
use crate::scene::{wall, write_prior};

const DECODE: &str = "decode --prior prior.ply --packets packets --frames out --overwrite";

#[test]
fn packets_about_another_prior_are_refused_by_name() {
    let dive = Dive::new();
    dive.encode("--limit 1");
    write_prior(&dive.path("other.ply"), &wall(2));
    dive.run("decode --prior other.ply --packets packets --overwrite --frames out")
        .ends_with(1)
        .says("packets/0.nvsp")
        .says("Render options are part of a prior's identity")
        .says("1 of 1 packets could not be decoded");
    assert!(!dive.path("out/0.png").exists());
}

#[test]
fn a_damaged_residual_leaves_the_render() {
    let dive = Dive::new();
    dive.encode("--limit 1");
    let mut packet = dive.bytes("packets/0.nvsp");
    *packet.last_mut().unwrap() ^= 1;
    std::fs::write(dive.path("packets/0.nvsp"), packet).unwrap();
    dive.run(DECODE).ends_with(0).says("packets/0.nvsp").says("the render alone");
    let shown = dive.picture("out/0.png");
    dive.encode("--limit 1 --residual none");
    dive.run(DECODE).ends_with(0);
    assert_eq!(shown, dive.picture("out/0.png"));
    assert!(shown.psnr(&pictures()[0]) > 25.0);
}

#[test]
fn a_lost_packet_costs_its_own_frame_where_the_camera_is_known() {
    let dive = Dive::new();
    dive.encode("--pictures seen");
    std::fs::remove_file(dive.path("packets/0.nvsp")).unwrap();
    dive.run(DECODE).ends_with(1).says("packets/1.nvsp").says("camera");
    let run = dive.run(&format!("{DECODE} --cameras cameras.json")).ends_with(0);
    assert!(run.stdout.contains("2 of 2 packets decoded"), "{}", run.stdout);
    assert_eq!(dive.bytes("out/2.png"), dive.bytes("seen/2.png"));
}

#[test]
fn one_bad_packet_does_not_stop_the_others() {
    let dive = Dive::new();
    dive.encode("--pictures seen");
    std::fs::write(dive.path("packets/1.nvsp"), b"no packet").unwrap();
    dive.run(DECODE)
        .ends_with(1)
        .says("packets/1.nvsp: latent part: damaged")
        .says("1 of 3 packets");
    assert!(!dive.path("out/1.png").exists());
    assert_eq!(dive.bytes("out/2.png"), dive.bytes("seen/2.png"));
}

/// Environments in which other devices draw. Lavapipe reads the width of its vectors from a variable; that changes
/// subgroups and the stages' forms. `scripts/portability.sh` names other drivers' ICD files in
/// `NVSPRIOR_OTHER_DRIVERS`, with colons between them.
fn other_devices() -> Vec<(&'static str, String)> {
    let widths = ["128", "256", "512"].map(|bits| ("LP_NATIVE_VECTOR_WIDTH", bits.to_owned()));
    let drivers = std::env::var("NVSPRIOR_OTHER_DRIVERS").unwrap_or_default();
    let drivers = drivers.split(':').filter(|file| !file.is_empty());
    let drivers = drivers.map(|file| ("VK_DRIVER_FILES", file.to_owned()));
    widths.into_iter().chain(drivers).collect()
}

#[test]
fn packets_decode_to_the_same_bytes_on_other_devices() {
    let dive = Dive::new();
    let summary = dive.encode("--render-check 1 --pictures seen");
    assert!(summary["frames"].as_array().unwrap().iter().all(|f| f["portable"] == true));
    for (variable, value) in other_devices() {
        let run = dive.run_with(DECODE, &[(variable, &value)]).ends_with(0);
        assert!(!run.stderr.contains("not portable"), "{value}: {}", run.stderr);
        assert!(!run.stdout.contains("not the vehicle's"), "{value}: {}", run.stdout);
        for name in ["0.png", "1.png", "2.png"] {
            let (seen, shown) = (format!("seen/{name}"), format!("out/{name}"));
            assert!(dive.bytes(&seen) == dive.bytes(&shown), "{variable}={value}: {name} differs");
        }
    }
}

#[test]
fn a_portable_device_is_told() {
    let dive = Dive::new();
    for (variable, value) in other_devices() {
        let run = dive.run_with("devices --check 24", &[(variable, &value)]).ends_with(0);
        assert!(run.stdout.contains("portable: 4"), "{variable}={value}: {}", run.stdout);
    }
    dive.run("devices --check 0").ends_with(2);
    dive.run("devices --check --device nowhere").ends_with(1).says("nowhere");
}
