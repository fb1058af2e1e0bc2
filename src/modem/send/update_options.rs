//! What updates may take of a link.

use crate::modem::error::ModemError;

/// What updates may take of a link, and how many a sender keeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UpdateOptions {
    /// Part of the bit rate that an update gets while it is sent, above 0 and below 1. Pictures get the rest.
    pub share: f64,
    /// Part of the bit rate in which updates are sent again and again if no reports are expected, for a topside that
    /// joins late; 0: they are not.
    pub repeat: f64,
    /// Bytes of updates that are kept, all of the dive: a topside that restarts needs all of them. If there is no more
    /// room, [`Sender::push_update`](crate::modem::Sender::push_update) refuses.
    pub memory: usize,
}

impl Default for UpdateOptions {
    /// A third while an update is sent, a twelfth for repetitions, and 64 KiB: some 70 updates.
    fn default() -> UpdateOptions {
        UpdateOptions { share: 1.0 / 3.0, repeat: 1.0 / 12.0, memory: 1 << 16 }
    }
}

impl UpdateOptions {
    /// # Errors
    /// With the name of what is out of its range.
    pub fn check(&self) -> Result<(), ModemError> {
        let UpdateOptions { share, repeat, .. } = *self;
        if !(share > 0.0 && share < 1.0) {
            return Err(ModemError::UpdateShare { field: "share", value: share });
        }
        if !(0.0..=share).contains(&repeat) {
            return Err(ModemError::UpdateShare { field: "repeat", value: repeat });
        }
        Ok(())
    }
}
