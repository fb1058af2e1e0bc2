//! `nvsprior map` on very many pictures.

use crate::dive::{Dive, camera_file, view};
use crate::scene::{CAMERA, pose};

#[test]
fn ten_thousand_pictures_start_with_their_memory_stated() {
    let camera = CAMERA.resized(32, 18);
    let files: Vec<String> = (0..10_000).map(|t| format!("small/{}.png", t % 4)).collect();
    let dive = Dive::new();
    let views = files.iter().enumerate();
    let views = views.map(|(t, file)| view(file, t, "dive", &pose((t % 4) as f64)));
    dive.write_json("cameras.json", &camera_file(&camera, views.collect()));
    std::fs::create_dir(dive.path("small")).unwrap();
    for t in 0..4 {
        let image = image::open(dive.path(&format!("images/{t}.png"))).unwrap();
        image.thumbnail_exact(32, 18).save(dive.path(&format!("small/{t}.png"))).unwrap();
    }
    let map = "map --cameras cameras.json --split dive --splats 300 --iterations 30";
    let run = dive.run(&format!("{map} --held-out 100 --out a.ply")).ends_with(0);
    run.says("9900 pictures of 32×18, 100 held out")
        .says("MB of host memory")
        .says("device memory");
}
