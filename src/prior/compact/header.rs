//! The first bytes of a compact prior.

use super::super::{PriorError, PriorId, RenderOptions, Splats};
use super::format::{FORMAT, MAGIC, refusal};
use super::quantise::{Grid, Quantisation};

const VERSION: u8 = 1;
/// Bytes of a focal length.
const FOCAL: usize = 4;

/// What precedes the coded part; its bytes are in docs/format/prior.md.
pub struct Header {
    pub sh_degree: u32,
    pub key_frames: bool,
    pub coder_tables: bool,
    pub preprocessing: bool,
    pub count: u32,
    pub id: PriorId,
    pub options: RenderOptions,
    pub grid: Grid,
    pub quantisation: Quantisation,
}

impl Header {
    /// Without the focal length.
    pub const BYTES: usize = 76;

    /// Bytes that it takes.
    pub fn size(&self) -> usize {
        Header::BYTES + self.options.trained_focal.map_or(0, |_| FOCAL)
    }

    /// As in a file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let options = &self.options;
        let mut bytes = MAGIC.to_vec();
        let parts = u8::from(self.key_frames)
            | u8::from(self.coder_tables) << 1
            | u8::from(self.preprocessing) << 2;
        let drawn = u8::from(options.antialiased) | u8::from(options.trained_focal.is_some()) << 1;
        let flags = [drawn, parts];
        bytes.extend([VERSION, self.sh_degree as u8].into_iter().chain(flags));
        bytes.extend(self.count.to_le_bytes());
        bytes.extend(self.id.to_bytes());
        let floats = [options.near, options.alpha_max].into_iter().chain(options.background);
        bytes.extend(floats.chain(self.grid.origin).flat_map(f32::to_le_bytes));
        bytes.extend(i32::from(self.grid.exponent).to_le_bytes());
        bytes.extend(self.quantisation.steps().into_iter().flat_map(|(_, s)| s.to_le_bytes()));
        bytes.extend(options.trained_focal.into_iter().flat_map(f32::to_le_bytes));
        bytes
    }

    /// Reads and checks the header at the start of `bytes`, which has that many.
    pub fn read(bytes: &[u8]) -> Result<Header, PriorError> {
        let word = |at: usize| -> [u8; 4] { std::array::from_fn(|i| bytes[at + i]) };
        let float = |at| f32::from_le_bytes(word(at));
        let triple = |at| [float(at), float(at + 4), float(at + 8)];
        if bytes[4] != VERSION {
            let (version, known) = (bytes[4].into(), VERSION.into());
            return Err(PriorError::Newer { format: FORMAT, version, known });
        }
        let sh_degree = u32::from(bytes[5]);
        if sh_degree > Splats::MAX_SH_DEGREE {
            return Err(PriorError::ShDegree { degree: sh_degree });
        }
        if bytes[6] > 3 || bytes[7] > 7 {
            return Err(refusal(6, "unknown flags".into()));
        }
        let count = u32::from_le_bytes(word(8));
        if count == 0 {
            return Err(PriorError::Empty);
        }
        let needed = Header::BYTES + FOCAL;
        let has_focal = bytes[6] & 2 != 0;
        if has_focal && bytes.len() < needed {
            let (needed, found) = (needed as u128, bytes.len());
            return Err(PriorError::Truncated { needed, found });
        }
        let options = RenderOptions {
            near: float(16),
            alpha_max: float(20),
            antialiased: bytes[6] & 1 != 0,
            background: triple(24),
            trained_focal: has_focal.then(|| float(Header::BYTES)),
        };
        options.check()?;
        let grid = Grid { origin: triple(36), exponent: exponent(i32::from_le_bytes(word(48)))? };
        if !grid.origin.iter().all(|v| v.is_finite()) {
            return Err(refusal(36, "an origin that is not finite".into()));
        }
        let quantisation = Quantisation {
            position: float(52),
            log_scale: float(56),
            rotation: float(60),
            opacity_logit: float(64),
            colour: float(68),
            sh: float(72),
        };
        quantisation.check()?;
        let id = PriorId::from_bytes(word(12));
        Ok(Header {
            sh_degree,
            key_frames: bytes[7] & 1 != 0,
            coder_tables: bytes[7] & 2 != 0,
            preprocessing: bytes[7] & 4 != 0,
            count,
            id,
            options,
            grid,
            quantisation,
        })
    }
}

fn exponent(value: i32) -> Result<i16, PriorError> {
    let exponent = i16::try_from(value).ok().filter(|e| Grid::EXPONENTS.contains(e));
    exponent.ok_or_else(|| refusal(48, format!("positions in steps of 2^{value}")))
}
