//! What was sent of a frame.

use nvsprior::packet::{Extent, residual_part_len};
use nvsprior_link::modem::{Division, ModemError};

pub struct SentPacket {
    pub frame: usize,
    pub number: u32,
    /// When the frame was exposed, seconds.
    pub exposed: f64,
    pub bytes: PacketBytes,
    pub render_psnr: f64,
    /// Of the whole packet.
    pub psnr: f64,
    pub inter: bool,
}

/// What the bytes of packets are, without the frame numbers that shares tell by themselves.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct PacketBytes {
    /// Latent part, and the camera where it is sent.
    pub latent: usize,
    pub residual: usize,
    /// Length and check of the residual, which it has among its bytes: not one of the parts of a sum.
    #[serde(skip)]
    pub framing: usize,
    /// The truth map, which the residual has among its bytes, too.
    #[serde(skip)]
    pub truth: usize,
    /// What the shares say of themselves.
    pub headers: usize,
    pub parity: usize,
    /// Numbers and tags, with keys.
    pub tags: usize,
}

impl PacketBytes {
    pub fn of(
        division: &Division,
        packet: &[u8],
        truth: usize,
        (overhead, tag): (usize, usize),
    ) -> Result<PacketBytes, ModemError> {
        let Division { shares, header_bytes, packet_bytes, left_out, link_bytes, .. } = *division;
        let Extent { head, has_content, .. } = Extent::read(packet)?;
        let residual = packet_bytes.saturating_sub(head);
        let sent = link_bytes.saturating_sub(shares * overhead + header_bytes);
        let parity = sent.saturating_sub(packet_bytes - left_out);
        let latent = sent - parity - residual;
        let framing = if has_content { residual_part_len(0) } else { 0 };
        Ok(PacketBytes {
            latent,
            residual,
            framing: framing.min(residual),
            truth,
            headers: header_bytes,
            parity,
            tags: shares * tag,
        })
    }

    pub fn total(&self) -> usize {
        self.latent + self.residual + self.headers + self.parity + self.tags
    }
}
