//! `nvsprior render` and `nvsprior inspect`.

use nvsprior::render::to_byte;
use nvsprior::vulkan::DeviceOptions;
use nvsprior::{Engine, Prior};

use crate::dive::{Dive, name, pictures};
use crate::scene::CAMERA;

/// Shape and floats of a NumPy file, as far as the tool writes them.
fn read_npy(bytes: &[u8]) -> (String, Vec<f32>) {
    assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
    let data = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = String::from_utf8(bytes[10..data].to_vec()).unwrap();
    let floats = bytes[data..].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap()));
    (header, floats.collect())
}

#[test]
fn picture_and_floats_agree() {
    let dive = Dive::new();
    let view = format!("--prior prior.ply --cameras cameras.json --frame {}", name(1));
    dive.run(&format!("render {view} --out view.png --raw view.npy")).ends_with(0);
    let (header, floats) = read_npy(&dive.bytes("view.npy"));
    for part in ["'descr': '<f4'", "'fortran_order': False", "'shape': (90, 160, 5"] {
        assert!(header.contains(part), "{header}");
    }
    let picture = dive.picture("view.png");
    assert_eq!((picture.width, picture.height), (CAMERA.width, CAMERA.height));
    assert_eq!(floats.len(), CAMERA.pixels() * 5);
    for (pixel, rgb) in floats.chunks_exact(5).zip(picture.data.chunks_exact(3)) {
        assert_eq!(pixel[..3].iter().map(|v| to_byte(*v)).collect::<Vec<_>>(), rgb);
        let (depth, transmittance) = (pixel[3], pixel[4]);
        assert!((0.0..0.5).contains(&transmittance), "{transmittance}");
        assert!((3.0..5.0).contains(&(depth / (1.0 - transmittance))), "{depth}");
    }
    assert!(picture.psnr(&pictures()[1]) > 25.0);
}

#[test]
fn a_given_pose_stands_in_for_the_view_s() {
    let dive = Dive::new();
    let render = "render --prior prior.ply --cameras cameras.json --frame";
    dive.run(&format!("{render} {} --out a.png --pose 1,0,0,0,0,0,0", name(3))).ends_with(0);
    dive.run(&format!("{render} {} --out b.png", name(0))).ends_with(0);
    assert_eq!(dive.bytes("a.png"), dive.bytes("b.png"));
    dive.run(&format!("{render} {} --out c.png --near 100", name(0))).ends_with(0);
    assert!(dive.picture("c.png").data.iter().all(|v| *v == 0), "all lies before the near plane");
}

#[test]
fn many_poses_give_a_picture_each() {
    let dive = Dive::new();
    let render = format!("render --prior prior.ply --cameras cameras.json --frame {}", name(3));
    let many = format!("{render} --poses poses.csv --pictures many");
    let header = "name,qw,qx,qy,qz,tx,ty,tz\n";
    std::fs::write(dive.path("poses.csv"), format!("{header}b,1,0,0,0,0.1,0,0\na,1,0,0,0,0,0,0\n"))
        .unwrap();
    dive.run(&many).ends_with(0);
    for (name, pose) in [("a", "1,0,0,0,0,0,0"), ("b", "1,0,0,0,0.1,0,0")] {
        dive.run(&format!("{render} --out one.png --pose {pose}")).ends_with(0);
        assert_eq!(dive.picture(&format!("many/{name}.png")), dive.picture("one.png"));
    }
    dive.run(&many).ends_with(1).says("two runs would be mixed");
    for (rows, says) in [("", "no poses"), ("../a,1,0,0,0,0,0,0\n", "\"../a\" cannot be the name")]
    {
        std::fs::write(dive.path("poses.csv"), format!("{header}{rows}")).unwrap();
        dive.run(&many).ends_with(1).says(says);
    }
    dive.run(&format!("{render} --poses poses.csv")).ends_with(2).says("--pictures");
}

#[test]
fn validation_is_silent_where_its_layer_is_installed() {
    let dive = Dive::new();
    let args = format!("--cameras cameras.json --frame {} --out a.png --validate", name(0));
    let run = dive.run(&format!("render --prior prior.ply {args}"));
    match Engine::new(&DeviceOptions { validation: true, ..DeviceOptions::default() }) {
        Ok(engine) => run.ends_with(0).says(&engine.device().to_string()),
        Err(error) => run.ends_with(1).says(&error.to_string()),
    };
}

#[test]
fn inspect_names_splats_and_identity() {
    let dive = Dive::new();
    let prior = Prior::open(&dive.path("prior.ply"), &Default::default()).unwrap();
    let text = dive.run("inspect prior.ply").ends_with(0).stdout;
    for part in ["4800 of 4800 read".to_owned(), prior.id().to_string()] {
        assert!(text.contains(&part), "no \"{part}\" in:\n{text}");
    }
    // Options that change the picture change the identity.
    let other = dive.run("inspect prior.ply --antialiased").ends_with(0).stdout;
    assert!(!other.contains(&prior.id().to_string()), "{other}");
}
