//! A file of our own: must give an error or a valid prior. The checks of its head and parts are made to match first,
//! else no input would get past them.
use nvsprior::coder_tables::Tables;
use nvsprior::prior::compact::{self, Quantisation};
use nvsprior::prior::{Extras, KeyFrames, extras_file, with_coder_tables, with_extras};
use nvsprior::{Prior, PriorId};

/// Bytes of the head before its check, and of a part's start before the part's.
const HEAD: usize = 24;
const START: usize = 17;

/// The file with checks that match, as far as it has parts. `None`: it is too short.
fn checked(bytes: &[u8]) -> Option<Vec<u8>> {
    let mut file = bytes.to_vec();
    let check = crc32fast::hash(file.get(..HEAD)?);
    file.get_mut(HEAD..HEAD + 4)?.copy_from_slice(&check.to_le_bytes());
    let mut at = HEAD + 4;
    while let Some(start) = file.get(at..at + START) {
        let length = u64::from_le_bytes(*start[9..].first_chunk()?);
        let content = at + START + 4;
        let end = usize::try_from(length).ok().and_then(|length| content.checked_add(length));
        let Some(within) = end.and_then(|end| file.get(content..end)) else { break };
        let check = crc32fast::hash(&[start, within].concat());
        let next = content + within.len();
        file[at + START..content].copy_from_slice(&check.to_le_bytes());
        at = next;
    }
    Some(file)
}

/// Key frames stand in steps of the bounds that a file states, which a writer makes as narrow as it can.
fn assert_alike(a: &Extras, b: &Extras) {
    let others = |extras: &Extras| Extras { key_frames: KeyFrames::NONE, ..extras.clone() };
    assert_eq!((others(a), a.key_frames.len()), (others(b), b.key_frames.len()));
}

/// What lies beside a foreign prior comes back.
fn beside(file: &[u8]) {
    let word = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| file[at + i]));
    let (id, splats) = (PriorId(word(8)), word(12) as usize);
    if let Ok(extras) = extras_file::from_bytes(file, id, splats) {
        let again = extras_file::to_bytes(&extras, id, splats);
        let again = extras_file::from_bytes(&again, id, splats).expect("what was written");
        assert_alike(&again, &extras);
    }
}

fn open(bytes: &[u8]) -> Prior {
    Prior::from_bytes(bytes, "changed", &Default::default()).expect("what was written")
}

pub fn run(bytes: &[u8]) {
    let _ = compact::read(bytes);
    let Some(file) = checked(bytes) else { return };
    beside(&file);
    let Ok(prior) = Prior::from_bytes(&file, "input", &Default::default()) else { return };
    // What was read is written, in steps and as it is, and read again as the prior that the writer names.
    let mut again = Vec::new();
    let fine = Quantisation::default();
    if let Ok(id) = compact::write(prior.splats(), &prior.besides(), &fine, &mut again) {
        assert_eq!((open(&again).id(), open(&again).len()), (id, prior.len()));
    }
    let mut exact = Vec::new();
    let id = compact::write_exact(prior.splats(), &prior.besides(), &mut exact);
    assert_eq!(id.expect("memory takes it"), prior.id());
    assert_eq!(open(&exact).splats(), prior.splats());
    if !prior.report().format.is_own() {
        return;
    }
    // Parts are taken out and put in again.
    let bare = with_extras(&file, &Extras::default()).expect("what could be read");
    assert_eq!((open(&bare).id(), open(&bare).extras()), (prior.id(), &Extras::default()));
    let full = with_extras(&bare, prior.extras()).expect("what could be read");
    assert_alike(open(&full).extras(), prior.extras());
    let generic = Tables::generic();
    let with = with_coder_tables(&file, Some(&generic)).expect("what could be read");
    assert_eq!(open(&with).coder_tables().map(AsRef::as_ref), Some(&generic));
    let tables = prior.coder_tables().map(AsRef::as_ref);
    let back = with_coder_tables(&with, tables).expect("what was written");
    assert_eq!((open(&back).id(), open(&back).extras()), (prior.id(), prior.extras()));
}
