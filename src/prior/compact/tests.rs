use super::super::tests::sample_splats;
use super::*;

#[test]
fn probe() {
    for degree in 0..=3 {
        let splats = sample_splats(7, degree);
        let mut bytes = Vec::new();
        let q = Quantisation::default();
        let id = write(&splats, &RenderOptions::INRIA, &q, &mut bytes).unwrap();
        let scene = read(&bytes).unwrap();
        let mut again = Vec::new();
        assert_eq!(write(&scene.splats, &RenderOptions::INRIA, &q, &mut again).unwrap(), id);
    }
}
