//! Why frames of files do not come together: they were split for another MTU, or for several, or are padded.

use std::collections::BTreeMap;

use nvsprior_link::modem::MIN_MTU;

use super::runs::Gathering;

/// MTUs that are tried.
const TRIED: usize = 4;

/// What to do, if another MTU yields packets that this one does not.
pub fn other(frames: &[Vec<u8>], mtu: usize) -> Option<String> {
    let own = Gathering::complete(frames, mtu).ok()?;
    let yields = |other: usize| {
        let found = Gathering::complete(frames, other).ok()?;
        Some((other, found.len(), found.difference(&own).count()))
    };
    let others = candidates(frames).into_iter().filter(|other| *other != mtu);
    let (best, count, _) =
        others.filter_map(yields).filter(|(.., new)| *new > 0).max_by_key(|(.., new)| *new)?;
    let padded = frames.iter().all(|frame| frame.len() == mtu) && best < mtu;
    Some(match (own.len(), padded) {
        (0, true) => format!(
            "--mtu {best} yields {count} complete packets: the frames are padded to {mtu} bytes"
        ),
        (0, false) => format!("--mtu {best} yields {count} complete packets"),
        (complete, _) => format!(
            "--mtu {mtu} yields {complete} complete packets, --mtu {best} {count}: the frames are of two MTUs. Put \
             those of each into a folder of its own"
        ),
    })
}

/// The commonest lengths; and the length without padding.
fn candidates(frames: &[Vec<u8>]) -> Vec<usize> {
    let mut lengths = BTreeMap::new();
    frames.iter().for_each(|frame| *lengths.entry(frame.len()).or_insert(0_usize) += 1);
    let mut commonest: Vec<(usize, usize)> = lengths.into_iter().collect();
    commonest.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let content =
        |frame: &Vec<u8>| frame.iter().rposition(|byte| *byte != 0).map_or(0, |at| at + 1);
    let padded = frames.iter().map(content).max();
    let lengths = commonest.into_iter().map(|(length, _)| length).take(TRIED);
    lengths.chain(padded).filter(|length| *length >= MIN_MTU).collect()
}
