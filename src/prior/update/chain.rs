//! The chain of a dive's updates, as each side keeps it for the next dive: the file `dive.nvsu`.
//!
//! | byte | type | content |
//! |---|---|---|
//! | 0 | | `nvsc` |
//! | 4 | u8 | version of the format: 1 |
//! | 5 | u32 | [`PriorId`] of the prior that the chain begins with |
//! | 9 | u32 | CRC-32 of the bytes before |
//! | 13 | | the updates in their order, each as its length (u32) and [`Update::write`] |
//!
//! All little endian. An update has a check of its own. If one is cut off or damaged, those before it are good.

use super::super::id::PriorId;
use super::UpdateError;
use super::content::Update;
use super::learnt::Learnt;
use super::limits::MAX_UPDATE_BYTES;

/// Name of the file that holds the chain of a side's dives, in the folder that it is kept in.
pub const DIVE_FILE: &str = "dive.nvsu";

/// How a chain starts.
pub const CHAIN_MAGIC: &[u8] = b"nvsc";
const VERSION: u8 = 1;
/// Bytes of the header without its check.
const NAMED: usize = 9;
/// Bytes of the header.
const HEADER: usize = NAMED + 4;

/// The updates of a prior in their order, from the first one on, with what they add up to.
#[derive(Clone, Debug, PartialEq)]
pub struct UpdateChain {
    updates: Vec<Update>,
    learnt: Learnt,
}

/// A chain as it was read.
#[derive(Debug)]
pub struct ChainRead {
    /// The updates that are good.
    pub chain: UpdateChain,
    /// Why the next one, and all after it, are left out; `None`: the file is whole.
    pub left_out: Option<UpdateError>,
}

impl UpdateChain {
    /// No update yet.
    pub fn none(prior: PriorId) -> UpdateChain {
        UpdateChain { updates: Vec::new(), learnt: Learnt::none(prior) }
    }

    /// Adds the next update. Fails as [`Learnt::add`] does, and changes nothing then.
    pub fn add(&mut self, update: Update) -> Result<(), UpdateError> {
        self.learnt.add(&update)?;
        self.updates.push(update);
        Ok(())
    }

    /// Takes an update as it comes from the vehicle, by the rule of
    /// [`Decoder::add_update`](crate::Decoder::add_update). One that is there already changes nothing. One that stands
    /// on an earlier state is the first one of a new chain: the vehicle has begun anew from that state, and the updates
    /// after it go. Returns whether the chain has changed.
    ///
    /// # Errors
    /// As for [`UpdateChain::add`]. Nothing changes then.
    pub fn take(&mut self, update: Update) -> Result<bool, UpdateError> {
        if self.updates.contains(&update) {
            return Ok(false);
        }
        if update.before == self.learnt.state() {
            return self.add(update).map(|()| true);
        }
        let base = self.updates.iter().position(|there| there.state() == update.before);
        let mut anew = UpdateChain::none(self.learnt.prior());
        for before in &self.updates[..base.map_or(0, |base| base + 1)] {
            anew.add(before.clone())?;
        }
        anew.add(update)?;
        *self = anew;
        Ok(true)
    }

    /// The updates, number 1 first.
    pub fn updates(&self) -> &[Update] {
        &self.updates
    }

    /// What they add up to.
    pub fn learnt(&self) -> &Learnt {
        &self.learnt
    }

    /// Appends the chain as bytes.
    pub fn write(&self, into: &mut Vec<u8>) -> Result<(), UpdateError> {
        let start = into.len();
        into.extend(CHAIN_MAGIC);
        into.push(VERSION);
        into.extend(self.learnt.prior().to_bytes());
        let check = crc32fast::hash(&into[start..]);
        into.extend(check.to_le_bytes());
        for update in &self.updates {
            let length = into.len();
            into.extend([0; 4]);
            update.write(into)?;
            let bytes = (into.len() - length - 4) as u32;
            into[length..length + 4].copy_from_slice(&bytes.to_le_bytes());
        }
        Ok(())
    }

    /// Reads a chain. What comes before the first update that is cut off, damaged or not the next one is kept.
    ///
    /// Fails if the header is not that of a chain.
    pub fn read(bytes: &[u8]) -> Result<ChainRead, UpdateError> {
        if !bytes.starts_with(CHAIN_MAGIC) {
            return Err(UpdateError::UnknownFormat);
        }
        let truncated = UpdateError::Truncated { needed: HEADER, found: bytes.len() };
        let (header, mut rest) = bytes.split_at_checked(HEADER).ok_or(truncated)?;
        let word = |at: usize| std::array::from_fn(|i| header[at + i]);
        let (stated, found) = (u32::from_le_bytes(word(NAMED)), crc32fast::hash(&header[..NAMED]));
        if stated != found {
            return Err(UpdateError::Damaged { stated, found });
        }
        if header[4] != VERSION {
            return Err(UpdateError::Newer { version: header[4], known: VERSION });
        }
        let mut chain = UpdateChain::none(PriorId::from_bytes(word(5)));
        while !rest.is_empty() {
            match next(rest).and_then(|(update, after)| chain.add(update).map(|()| after)) {
                Ok(after) => rest = after,
                Err(error) => {
                    let due = u32::from(chain.learnt.number()) + 1;
                    let left_out = UpdateError::LeftOut { due, error: Box::new(error) };
                    return Ok(ChainRead { chain, left_out: Some(left_out) });
                }
            }
        }
        Ok(ChainRead { chain, left_out: None })
    }
}

/// The update at the start of `bytes`, and what follows it.
fn next(bytes: &[u8]) -> Result<(Update, &[u8]), UpdateError> {
    let truncated = |needed| UpdateError::Truncated { needed, found: bytes.len() };
    let (length, rest) = bytes.split_first_chunk().ok_or(truncated(4))?;
    let length = u32::from_le_bytes(*length) as usize;
    if length > MAX_UPDATE_BYTES {
        let reason = format!("an update of {length} bytes: at most {MAX_UPDATE_BYTES}");
        return Err(UpdateError::Field { offset: 0, reason });
    }
    let (update, after) = rest.split_at_checked(length).ok_or(truncated(4 + length))?;
    Ok((Update::read(update)?, after))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::StateId;
    use super::super::tests::sample;
    use super::*;

    /// Three updates that stand on each other.
    fn chain() -> UpdateChain {
        let mut chain = UpdateChain::none(PriorId(7));
        for (number, count) in [(1, 9), (2, 5), (3, 0)] {
            let before = chain.learnt.state();
            let plain = Update { removed: vec![], changed: vec![], ..sample(number, count) };
            let removed = if number == 3 { vec![1, 4] } else { vec![] };
            chain.add(Update { before, removed, ..plain }).unwrap();
        }
        chain
    }

    fn written(chain: &UpdateChain) -> Vec<u8> {
        let mut bytes = Vec::new();
        chain.write(&mut bytes).unwrap();
        bytes
    }

    /// Where the updates of a chain end.
    fn ends(chain: &UpdateChain) -> Vec<usize> {
        let part = |count: usize| {
            let mut part = UpdateChain::none(chain.learnt.prior());
            chain.updates[..count].iter().for_each(|update| part.add(update.clone()).unwrap());
            written(&part).len()
        };
        (0..=chain.updates.len()).map(part).collect()
    }

    #[test]
    fn a_chain_comes_back() {
        let chain = chain();
        for chain in [UpdateChain::none(PriorId(7)), chain] {
            let read = UpdateChain::read(&written(&chain)).unwrap();
            assert!(read.left_out.is_none());
            assert_eq!(read.chain, chain);
        }
    }

    #[test]
    fn what_came_before_a_cut_is_kept() {
        let (chain, bytes) = (chain(), written(&chain()));
        let ends = ends(&chain);
        assert_eq!(ends[0], HEADER);
        for length in 0..bytes.len() {
            let read = UpdateChain::read(&bytes[..length]);
            if length < HEADER {
                assert!(read.is_err(), "{length}");
                continue;
            }
            let read = read.unwrap();
            let whole = ends.iter().rposition(|end| *end <= length).unwrap();
            assert_eq!(read.chain.updates, chain.updates[..whole], "{length}");
            assert_eq!(read.left_out.is_none(), ends[whole] == length, "{length}");
        }
        let cut = UpdateChain::read(&bytes[..bytes.len() - 1]).unwrap().left_out.unwrap();
        assert!(cut.to_string().starts_with("update 3 and all after it are left out: truncated"));
    }

    #[test]
    fn a_changed_byte_never_yields_another_chain() {
        let (chain, bytes) = (chain(), written(&chain()));
        for place in 0..bytes.len() {
            let mut bytes = bytes.clone();
            bytes[place] ^= 0x41;
            let Ok(read) = UpdateChain::read(&bytes) else {
                assert!(place < HEADER, "{place}");
                continue;
            };
            assert!(read.left_out.is_some(), "{place}");
            let kept = read.chain.updates.len();
            assert_eq!(read.chain.updates, chain.updates[..kept], "{place}");
        }
    }

    #[test]
    fn what_is_not_the_next_update_is_refused_and_left_out() {
        let mut chain = chain();
        let before = chain.clone();
        let other = Update { before: StateId(1), removed: vec![], changed: vec![], ..sample(4, 1) };
        assert!(chain.add(other.clone()).is_err());
        assert_eq!(chain, before);
        let mut bytes = written(&chain);
        let mut own = Vec::new();
        other.write(&mut own).unwrap();
        bytes.extend((own.len() as u32).to_le_bytes());
        bytes.extend(own);
        let read = UpdateChain::read(&bytes).unwrap();
        assert_eq!(read.chain, before);
        let text = read.left_out.unwrap().to_string();
        assert!(text.starts_with("update 4 and all after it are left out: update 4 stands on"));
    }

    #[test]
    fn a_vehicle_that_begins_anew_is_followed() {
        let whole = chain();
        let plain = |number, before| {
            let update = Update { before, removed: vec![], changed: vec![], ..sample(number, 2) };
            Update { frames: [7, 9], ..update }
        };
        let mut chain = UpdateChain::none(PriorId(7));
        for update in &whole.updates {
            assert!(chain.take(update.clone()).unwrap());
        }
        for update in &whole.updates {
            assert!(!chain.take(update.clone()).unwrap(), "it is there already");
        }
        assert_eq!(chain, whole);
        // One that stands on no state, and one whose number does not fit the state that it stands on.
        for wrong in [plain(4, StateId(1)), plain(3, whole.updates[0].state())] {
            assert!(chain.take(wrong).is_err());
            assert_eq!(chain, whole);
        }
        // From the prior alone, from the first update, and from the newest.
        for kept in 0..=whole.updates.len() {
            let mut expected = UpdateChain::none(PriorId(7));
            whole.updates[..kept].iter().for_each(|update| expected.add(update.clone()).unwrap());
            let next = plain(kept as u16 + 1, expected.learnt.state());
            expected.add(next.clone()).unwrap();
            let mut chain = whole.clone();
            assert!(chain.take(next).unwrap());
            assert_eq!(chain, expected, "{kept}");
        }
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_are_an_error_or_a_chain(
            bytes in proptest::collection::vec(any::<u8>(), 0..300),
        ) {
            prop_assert!(UpdateChain::read(&bytes).is_err());
            let whole = [&written(&chain())[..], &bytes].concat();
            let read = UpdateChain::read(&whole).unwrap();
            prop_assert_eq!(read.chain, chain());
            prop_assert_eq!(read.left_out.is_none(), bytes.is_empty());
        }
    }
}
