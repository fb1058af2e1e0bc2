//! What the topside is to deal with.

use std::net::SocketAddr;

use nvsprior_link::Region;

/// Events that may wait. If there are more datagrams, the next ones are dropped.
pub const EVENTS: usize = 1024;

pub enum Event {
    /// A modem frame.
    Arrived(Arrived),
    /// Nothing comes, and why.
    Stopped(String),
    /// The source is there again.
    Resumed,
    /// A page wants something.
    Command(Asked),
}

pub struct Arrived {
    /// UTC, seconds.
    pub time: f64,
    pub bytes: Vec<u8>,
    /// Where reports to its sender go, of a datagram.
    pub from: Option<SocketAddr>,
}

pub struct Asked {
    /// Which page, by a name that it gave itself.
    pub page: Option<String>,
    pub command: Command,
}

#[derive(Clone, Copy, Debug)]
pub enum Command {
    Region(Option<Region>),
    Record(bool),
    Snapshot,
}
