use super::super::tests::sample_splats;
use super::*;

#[test]
fn sizes() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data/reef/prior.ply");
    let prior = crate::Prior::open(path.as_ref(), &Default::default()).unwrap();
    let mut coded = Coded::of(prior.splats(), &Quantisation::default()).unwrap();
    let n = prior.len() as f64;
    let mut w = Writer::new();
    stream::code_ranks(&mut w, &mut coded.ranks);
    println!("positions {:.3} bits", w.finish().len() as f64 * 8.0 / n);
    let mut sum = 0.0;
    for c in 0..coded.columns.len() {
        let mut w = Writer::new();
        stream::code_columns(&mut w, &mut coded.columns[..=c]);
        let bits = w.finish().len() as f64 * 8.0 / n;
        let h = entropy(&coded.columns[c]);
        println!("column {c}: {:.3} bits; order 0 entropy {h:.3}", bits - sum);
        sum = bits;
    }
}

fn entropy(v: &[i32]) -> f64 {
    let mut m = std::collections::HashMap::new();
    for x in v {
        *m.entry(*x).or_insert(0.0) += 1.0;
    }
    m.values().map(|c: &f64| -c * (c / v.len() as f64).log2()).sum::<f64>() / v.len() as f64
}

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
