//! What an end tells its owner.

use std::collections::VecDeque;

use super::pilot::Region;

/// What a vehicle's end tells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum VehicleEvent {
    /// The topside is heard for the first time, or again.
    TopsideHeard,
    /// No report has come for so many seconds. Frames are sent all the same.
    TopsideSilent(f64),
    /// So many things came while no report comes, and none is a report that these keys can read: both sides need the
    /// same keys and epoch.
    Strangers(u64),
    /// The topside asks for prior and camera. The next packet states them.
    Asked,
    /// The pilot's region of interest from here on; `None`: there is none. The encoder gets it with the next frame.
    Region(Option<Region>),
    /// User bytes came with a report: [`VehicleLink::user`](super::VehicleLink::user).
    User,
    /// Frames come too slowly, or as fast as they should again: so many per second are planned for from here on.
    FrameRate(f64),
    /// Store [`VehicleLink::state`](super::VehicleLink::state) before more goes.
    Store,
}

/// What a topside's end tells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TopsideEvent {
    /// The vehicle is heard for the first time, or again.
    VehicleHeard,
    /// Nothing of the vehicle has come for so many seconds.
    VehicleSilent(f64),
    /// So many things came while nothing of the vehicle comes, and none can be read: both sides need the same MTU, keys
    /// and epoch.
    Strangers(u64),
    /// Store [`TopsideLink::state`](super::TopsideLink::state) before more goes.
    Store,
}

/// Events that wait, in memory that is taken once. If nobody takes them, the first ones go.
#[derive(Debug)]
pub(super) struct Events<E>(VecDeque<E>);

const ROOM: usize = 16;

impl<E: Copy + PartialEq> Events<E> {
    pub fn new() -> Events<E> {
        Events(VecDeque::with_capacity(ROOM))
    }

    pub fn tell(&mut self, event: impl Into<Option<E>>) {
        let Some(event) = event.into() else { return };
        // It is not told twice in a row.
        if self.0.back() == Some(&event) {
            return;
        }
        if self.0.len() == ROOM {
            self.0.pop_front();
        }
        self.0.push_back(event);
    }

    pub fn take(&mut self) -> Option<E> {
        self.0.pop_front()
    }
}
