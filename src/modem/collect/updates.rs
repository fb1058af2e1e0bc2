//! The updates of a stream at the topside: pieces to updates.

use crate::modem::error::ModemError;
use crate::modem::limits::{MAX_PIECES, MAX_SOURCES};
use crate::modem::memory::{filled, room};
use crate::modem::reported_updates::LastUpdate;
use crate::modem::wire::code::Known;
use crate::modem::wire::piece::{Cut, PieceHeader, UpdateName, take_update};

/// Updates of which pieces are kept at a time: the next one, and some that come before it does.
const PLACES: usize = 4;
/// Updates taken last, of which no piece is needed any more.
const TAKEN: usize = 64;
/// Bytes of the sources beside the update: its length, and zeros at the end.
const BESIDE: usize = 3 + MAX_SOURCES;

/// Pieces of some updates, in memory that is taken when it is made.
pub struct Updates {
    places: Vec<Place>,
    /// Bytes of an update's sources that there is room for.
    room: usize,
    /// The sources while they are put together.
    sources: Vec<u8>,
    /// Names of the updates that were taken, and the index for the next name.
    taken: Vec<UpdateName>,
    next: usize,
    /// Number of the update that was taken last, modulo 256.
    newest: u8,
    last: Option<LastUpdate>,
    /// Pieces that became part of an update, so far.
    pieces: u64,
}

/// The pieces of one update.
struct Place {
    name: Option<UpdateName>,
    cut: Cut,
    /// Indices of the pieces that are there; their chunks lie one after the other in `data`.
    indices: Vec<u8>,
    data: Vec<u8>,
    /// All of it is there. `data` has the sources.
    whole: bool,
    /// It was offered, and needs another one before it.
    put_off: bool,
    /// When its last piece came, in pieces so far.
    touched: u64,
}

/// What a piece has brought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Brought {
    Kept,
    Duplicate,
    /// The update was whole before.
    Surplus,
    /// It is whole now.
    Whole,
}

impl Updates {
    /// Memory that updates of up to `bytes` bytes take, bytes.
    pub fn memory(bytes: usize) -> usize {
        let room = bytes.saturating_add(BESIDE);
        let list = PLACES * (MAX_SOURCES + size_of::<Place>()) + TAKEN * size_of::<UpdateName>();
        room.saturating_mul(PLACES + 1).saturating_add(list)
    }

    pub fn new(bytes: usize) -> Result<Updates, ModemError> {
        let room_of_one = bytes.saturating_add(BESIDE);
        let mut places = room(PLACES)?;
        for _ in 0..PLACES {
            places.push(Place {
                name: None,
                cut: Cut::default(),
                indices: room(MAX_SOURCES)?,
                data: room(room_of_one)?,
                whole: false,
                put_off: false,
                touched: 0,
            });
        }
        Ok(Updates {
            places,
            room: room_of_one,
            sources: filled(room_of_one, 0)?,
            taken: room(TAKEN)?,
            next: 0,
            newest: 0,
            last: None,
            pieces: 0,
        })
    }

    /// Takes a piece whose check is right.
    pub fn push(&mut self, header: &PieceHeader, chunk: &[u8]) -> Result<Brought, ModemError> {
        let PieceHeader { update: name, cut, index, .. } = *header;
        if cut.len() > self.room {
            return Err(ModemError::UpdateRoom { len: cut.len(), room: self.room });
        }
        if self.taken.contains(&name) {
            self.last = Some(LastUpdate::new(name, None));
            return Ok(Brought::Surplus);
        }
        let Some(at) = self.place_of(name, cut) else { return Ok(Brought::Surplus) };
        self.pieces += 1;
        let place = &mut self.places[at];
        place.touched = self.pieces;
        let brought = place.take(index as u8, chunk);
        self.last = Some(place.told(name));
        if brought != Brought::Whole {
            return Ok(brought);
        }
        if !self.put_together(at, name) {
            self.places[at].clear();
            self.last = Some(LastUpdate::new(name, Some(0)));
            return Err(ModemError::UpdateCheck { number: name.number });
        }
        Ok(Brought::Whole)
    }

    /// Where the pieces of an update go. `None`: all places have updates that are due before it.
    fn place_of(&mut self, name: UpdateName, cut: Cut) -> Option<usize> {
        let at = self.places.iter().position(|place| place.name == Some(name));
        let at = match at {
            Some(at) if self.places[at].whole || self.places[at].cut == cut => return Some(at),
            // Its vehicle has cut it anew.
            Some(at) => at,
            None => {
                let wait = |place: &Place| {
                    let wait = place.name.map_or(u32::MAX, |name| u32::from(self.wait(name)));
                    (wait, std::cmp::Reverse(place.touched))
                };
                let (at, last) = self.places.iter().enumerate().max_by_key(|(_, p)| wait(p))?;
                if wait(last).0 < u32::from(self.wait(name)) {
                    return None;
                }
                at
            }
        };
        let place = &mut self.places[at];
        place.clear();
        (place.name, place.cut) = (Some(name), cut);
        Some(at)
    }

    /// How many updates come before one: after the newest one, or from the beginning of another chain.
    fn wait(&self, name: UpdateName) -> u8 {
        let after = name.number.wrapping_sub(self.newest).wrapping_sub(1);
        if after < u8::MAX / 2 { after } else { name.number.wrapping_sub(1) }
    }

    /// Makes the sources of an update of its pieces; `false`: they do not yield it.
    fn put_together(&mut self, at: usize, name: UpdateName) -> bool {
        let place = &mut self.places[at];
        let Cut { sources, chunk } = place.cut;
        let mut found = [None; MAX_PIECES];
        for (place, index) in place.indices.iter().enumerate() {
            found[usize::from(*index)] = Some(place);
        }
        let data = &place.data;
        let chunk_of = |index: usize| &data[found[index].unwrap_or(0) * chunk..][..chunk];
        let known = Known::new(place.indices.iter().map(|index| usize::from(*index)));
        for (index, into) in self.sources[..sources * chunk].chunks_mut(chunk).enumerate() {
            match found[index] {
                Some(_) => into.copy_from_slice(chunk_of(index)),
                None => known.write(index, chunk_of, into),
            }
        }
        place.data.clear();
        place.data.extend(&self.sources[..sources * chunk]);
        place.whole = true;
        take_update(&place.data, name).is_some()
    }

    /// The place of the whole update that is due first, of those that were not put off.
    fn due(&self) -> Option<(usize, UpdateName)> {
        let offered = |place: &Place| (place.whole && !place.put_off).then_some(place.name);
        let all = self.places.iter().enumerate();
        let offered = all.filter_map(|(at, place)| Some((at, offered(place)??)));
        offered.min_by_key(|(_, name)| self.wait(*name))
    }

    /// The whole update that is due first.
    pub fn offered(&self) -> Option<&[u8]> {
        let (at, name) = self.due()?;
        take_update(&self.places[at].data, name)
    }

    /// Tells whether the update that was offered was added. If not, it is offered again after another one was.
    pub fn settle(&mut self, added: bool) {
        let Some((at, name)) = self.due() else { return };
        if !added {
            self.places[at].put_off = true;
            self.forget_taken();
            return;
        }
        self.places[at].clear();
        // Another chain begins, or this one again.
        if self.wait(name) != 0 || name.number <= self.newest {
            self.forget_taken();
        }
        self.newest = name.number;
        match self.taken.get_mut(self.next) {
            Some(place) => *place = name,
            None => self.taken.push(name),
        }
        self.next = (self.next + 1) % TAKEN;
        self.places.iter_mut().for_each(|place| place.put_off = false);
    }

    /// The decoder may hold fewer updates than were taken. Those that it holds are taken once more, to no harm.
    fn forget_taken(&mut self) {
        self.taken.clear();
        self.next = 0;
    }

    /// The update whose piece came last.
    pub fn last(&self) -> Option<LastUpdate> {
        self.last
    }

    #[cfg(test)]
    pub fn capacity(&self) -> usize {
        let places = self
            .places
            .iter()
            .map(|place| size_of::<Place>() + place.indices.capacity() + place.data.capacity());
        let taken = self.taken.capacity() * size_of::<UpdateName>();
        places.sum::<usize>() + self.sources.capacity() + taken
    }
}

impl Place {
    fn clear(&mut self) {
        (self.name, self.whole, self.put_off) = (None, false, false);
        self.indices.clear();
        self.data.clear();
    }

    fn take(&mut self, index: u8, chunk: &[u8]) -> Brought {
        if self.whole {
            return Brought::Surplus;
        }
        if self.indices.contains(&index) {
            return Brought::Duplicate;
        }
        self.indices.push(index);
        self.data.extend(chunk);
        if self.indices.len() == self.cut.sources { Brought::Whole } else { Brought::Kept }
    }

    /// What a report tells of it.
    fn told(&self, name: UpdateName) -> LastUpdate {
        let whole = self.whole || self.indices.len() == self.cut.sources;
        LastUpdate::new(name, (!whole).then_some(self.indices.len()))
    }
}
