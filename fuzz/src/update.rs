//! An update of a prior: must give an error or a valid update. The check at the end is made to match first, else no
//! input would get past it.
use nvsprior::PriorId;
use nvsprior::prior::update::{MAX_FADES, MAX_LEARNT};
use nvsprior::prior::{Learnt, NewSplat, Update, UpdateChain};

pub fn run(bytes: &[u8]) {
    let _ = Update::read(bytes);
    chain(bytes);
    let content = &bytes[..bytes.len().saturating_sub(4)];
    let file = [content, &crc32fast::hash(content).to_le_bytes()].concat();
    let Ok(update) = Update::read(&file) else { return };
    assert!(update.splats.len() <= MAX_LEARNT && update.fades.len() <= MAX_FADES);
    // What was read is written to the same bytes.
    let mut again = Vec::new();
    update.write(&mut again).expect("what could be read");
    assert_eq!(again, file);
    second(&update);
    // As the first of a chain it adds up, unless it takes back or changes what is not there.
    let id = PriorId(1);
    let first = Update { prior: id, number: 1, before: id.into(), ..update };
    let mut learnt = Learnt::none(id);
    let added = learnt.add(&first);
    assert_eq!(added.is_ok(), first.removed.is_empty() && first.changed.is_empty());
    if added.is_err() {
        assert_eq!(learnt, Learnt::none(id));
        return;
    }
    assert_eq!((learnt.state(), learnt.number()), (first.state(), 1));
    assert_eq!(learnt.splats().len(), first.splats.len());
    look(&learnt);
    // The same splats in another order are the same update.
    let mut turned = first.clone();
    turned.splats.reverse();
    let places = |update: &Update| {
        let mut places: Vec<_> = update.splats.iter().map(|splat| splat.position).collect();
        places.sort_unstable();
        places.dedup();
        places.len()
    };
    if places(&first) == first.splats.len() {
        assert_eq!(turned.state(), first.state());
    }
}

/// A chain is what its bytes begin with, up to the first update that is not good.
fn chain(bytes: &[u8]) {
    let Ok(read) = UpdateChain::read(bytes) else { return };
    let mut again = Vec::new();
    read.chain.write(&mut again).expect("what could be read");
    assert!(bytes.starts_with(&again));
    assert_eq!(read.left_out.is_none(), again.len() == bytes.len());
}

/// As the second of a chain it adds up, or changes nothing.
fn second(update: &Update) {
    let id = PriorId(1);
    let splats =
        vec![NewSplat { rotation: [3, -2, 1], log_scale: [1, 2, 3], ..NewSplat::default() }; 40];
    let (removed, changed, fades) = (vec![], vec![], vec![]);
    let first = Update {
        prior: id,
        number: 1,
        before: id.into(),
        splats,
        removed,
        changed,
        fades,
        ..*update
    };
    let mut learnt = Learnt::none(id);
    learnt.add(&first).expect("the first of a chain");
    let before = learnt.clone();
    let second = Update { prior: id, number: 2, before: learnt.state(), ..update.clone() };
    if learnt.add(&second).is_err() {
        assert_eq!(learnt, before);
        return;
    }
    assert_eq!(learnt.splats().len(), 40 - second.removed.len() + second.splats.len());
    look(&learnt);
}

/// What is learnt can be drawn.
fn look(learnt: &Learnt) {
    for splat in learnt.splats() {
        let [w, x, y, z] = splat.rotation;
        let length = w * w + x * x + y * y + z * z;
        assert!((length - 1.0).abs() < 1e-5, "{splat:?}");
        assert!(splat.position.iter().all(|v| v.is_finite()));
        assert!((0.0..=1.0).contains(&learnt.fade_of(splat.position)));
    }
}
