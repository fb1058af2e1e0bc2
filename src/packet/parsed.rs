//! A packet that was read, without its bytes: so it may be kept beside them, and is read once.

use std::ops::Range;

use super::{HeldPoses, Packet, PacketError, Part, Residual, ResidualStart, Salvage, truth};

/// What [`Packet::salvage`] found in some bytes. [`Parsed::of`] those bytes it is the same again, at no cost.
#[derive(Clone, Debug)]
pub struct Parsed {
    /// The payloads in it are empty.
    salvage: Salvage<'static>,
    /// Where the residual's payload lies.
    payload: Range<usize>,
    /// Where the payload of its start lies.
    start: Range<usize>,
    /// Where the truth map lies.
    truth: Option<Range<usize>>,
}

impl Parsed {
    /// Reads what is valid in a truncated or damaged packet.
    ///
    /// # Errors
    /// If the latent part is not valid, or predicted from a pose: the packet is then of no use.
    pub fn of(bytes: &[u8]) -> Result<Parsed, PacketError> {
        Parsed::with(bytes, &HeldPoses::default())
    }

    /// As [`Parsed::of`], with the poses that the packet's may be predicted from.
    pub fn with(bytes: &[u8], held: &HeldPoses) -> Result<Parsed, PacketError> {
        let Salvage { latent, camera, render, residual, residual_start, truth } =
            Packet::salvage_with(bytes, held)?;
        let payload = residual.as_ref().map_or(&[][..], Residual::payload);
        let start = residual_start.map_or(&[][..], |start| start.payload);
        let (payload, start) = (range_in(bytes, payload), range_in(bytes, start));
        let residual = residual.map(|residual| residual.with_payload(&[]));
        let residual_start = residual_start.map(|start| ResidualStart { payload: &[], ..start });
        // A map that the flags alone tell lies nowhere.
        let told = truth.filter(|truth| *truth == truth::ALL_SEEN).map(|_| truth::ALL_SEEN);
        let truth = if told.is_some() { None } else { truth.map(|part| range_in(bytes, part)) };
        let salvage = Salvage { latent, camera, render, residual, residual_start, truth: told };
        Ok(Parsed { salvage, payload, start, truth })
    }

    /// What was found, without payloads.
    pub fn parts(&self) -> &Salvage<'static> {
        &self.salvage
    }

    /// What was found in `bytes`, which it was read from; they may have lost padding since.
    pub(crate) fn salvage<'a>(&self, bytes: &'a [u8]) -> Salvage<'a> {
        let Salvage { latent, camera, render, residual, residual_start, truth } =
            self.salvage.clone();
        Salvage {
            latent,
            camera,
            render,
            residual: residual.and_then(|residual| {
                let (needed, found) = (self.payload.end, bytes.len());
                let cut = PacketError::TooShort { part: Part::Residual, needed, found };
                let payload = bytes.get(self.payload.clone()).ok_or(cut)?;
                Ok(residual.with_payload(payload))
            }),
            residual_start: residual_start.map(|start| {
                let end = self.start.end.min(bytes.len());
                ResidualStart { payload: &bytes[self.start.start.min(end)..end], ..start }
            }),
            truth: truth.or_else(|| bytes.get(self.truth.clone()?)),
        }
    }
}

/// Where a part of some bytes lies in them.
fn range_in(bytes: &[u8], part: &[u8]) -> Range<usize> {
    if part.is_empty() {
        return 0..0;
    }
    let start = part.as_ptr().addr() - bytes.as_ptr().addr();
    start..start + part.len()
}
