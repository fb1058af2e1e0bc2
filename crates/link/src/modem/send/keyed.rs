//! What a sender with keys has besides.

use crate::keys::{Authenticator, Content, Keys, Verifier};
use crate::modem::error::ModemError;
use crate::modem::memory::room;

/// Makes the tags of modem frames, and checks those of reports.
pub struct Keyed {
    pub authenticator: Authenticator,
    pub verifier: Verifier,
    /// The modem frame that was given out last.
    frame: Vec<u8>,
}

impl Keyed {
    /// Memory that it takes for modem frames of up to `mtu` bytes, bytes.
    pub fn memory(mtu: usize) -> usize {
        mtu
    }

    pub fn new(keys: &Keys, mtu: usize) -> Result<Keyed, ModemError> {
        Ok(Keyed {
            authenticator: Authenticator::new(keys, Content::Frame),
            verifier: Verifier::new(keys, Content::Report),
            frame: room(mtu)?,
        })
    }

    pub fn overhead(&self) -> usize {
        self.authenticator.overhead()
    }

    /// The modem frame with its tag.
    pub fn authenticate(&mut self, stream: u8, frame: &[u8]) -> &[u8] {
        self.authenticator.write(stream, frame, &mut self.frame);
        &self.frame
    }
}
