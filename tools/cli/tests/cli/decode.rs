//! `nvsprior decode`: what a topside meets.

use crate::dive::{Dive, pictures};
use crate::scene::{wall, write_prior};

const DECODE: &str = "decode --prior prior.ply --packets packets --frames out";

#[test]
fn packets_about_another_prior_are_refused_by_name() {
    let dive = Dive::new();
    dive.encode("--limit 1");
    write_prior(&dive.path("other.ply"), &wall(2));
    dive.run("decode --prior other.ply --packets packets --frames out")
        .ends_with(1)
        .says("packets/0.nvsp")
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
    dive.encode("--frames-out seen");
    std::fs::remove_file(dive.path("packets/0.nvsp")).unwrap();
    dive.run(DECODE).ends_with(1).says("packets/1.nvsp").says("camera");
    let run = dive.run(&format!("{DECODE} --cameras cameras.json")).ends_with(0);
    assert!(run.stdout.contains("2 of 2 packets decoded"), "{}", run.stdout);
    assert_eq!(dive.bytes("out/2.png"), dive.bytes("seen/2.png"));
}

#[test]
fn one_bad_packet_does_not_stop_the_others() {
    let dive = Dive::new();
    dive.encode("--frames-out seen");
    std::fs::write(dive.path("packets/1.nvsp"), b"no packet").unwrap();
    dive.run(DECODE).ends_with(1).says("packets/1.nvsp").says("1 of 3 packets");
    assert!(!dive.path("out/1.png").exists());
    assert_eq!(dive.bytes("out/2.png"), dive.bytes("seen/2.png"));
}

/// A topside whose device works by other vectors may round differently: it is told, and shows nearly the
/// same. (Lavapipe takes its subgroup size from a variable.)
#[test]
fn another_kind_of_device_is_told_and_shows_nearly_the_same() {
    let dive = Dive::new();
    dive.encode("--render-check 1 --frames-out seen");
    let run = dive.run_with(DECODE, &[("LP_NATIVE_VECTOR_WIDTH", "128")]).ends_with(0);
    let said = run.stdout.contains("renders are not the vehicle's");
    let mut differ = false;
    for name in ["0.png", "1.png", "2.png"] {
        let (seen, shown) =
            (dive.picture(&format!("seen/{name}")), dive.picture(&format!("out/{name}")));
        let psnr = shown.psnr(&seen);
        println!("{name}: {psnr:.1} dB between the two");
        assert!(psnr > 50.0, "{name}: {psnr} dB");
        differ |= seen != shown;
    }
    assert!(said || !differ, "a difference that nothing tells of");
    // On the vehicle's own device there is nothing to tell.
    let run = dive.run(DECODE).ends_with(0);
    assert!(!run.stdout.contains("not the vehicle's"), "{}", run.stdout);
}
