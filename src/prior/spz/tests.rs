use super::*;
use crate::RenderOverrides;

#[test]
fn biker() {
    let d = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data/formats/");
    for (a, b) in [("biker.spz", "biker.ply"), ("guitar.compressed.ply", "guitar.ply")] {
        let a = Prior::open(format!("{d}{a}").as_ref(), &RenderOverrides::default()).unwrap();
        let b = Prior::open(format!("{d}{b}").as_ref(), &RenderOverrides::default()).unwrap();
        println!("{:?} {:?}", a.report(), b.report());
        let (a, b) = (a.splats(), b.splats());
        println!("{:?} {:?}", a.positions[0], b.positions[0]);
        println!("{:?} {:?}", a.rotations[0], b.rotations[0]);
        println!("{:?} {:?}", a.rotations[1], b.rotations[1]);
        println!("{:?} {:?}", a.log_scales[0], b.log_scales[0]);
        println!("{:?} {:?}", a.opacity_logits[0], b.opacity_logits[0]);
        println!("{:?} {:?}", &a.sh[..3], &b.sh[..3]);
        let d =
            |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        println!("{}", d(a.positions.as_flattened(), b.positions.as_flattened()));
        println!("{}", d(a.rotations.as_flattened(), b.rotations.as_flattened()));
        println!("{}", d(a.log_scales.as_flattened(), b.log_scales.as_flattened()));
        println!("{}", d(&a.opacity_logits, &b.opacity_logits));
        println!("{}", d(&a.sh, &b.sh));
    }
}
