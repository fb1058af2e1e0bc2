//! The coder's tables: networks, and where in its interval a coefficient lies.

use super::networks::Networks;

/// Planes of a difference picture: brightness and two of colour.
pub const PLANES: usize = 3;
/// Ranks of bands: 0 the low one, else the level.
pub const RANKS: usize = 7;
/// Magnitudes told apart: one, two, three and above.
pub const MAGNITUDES: usize = 3;

/// Offsets of logits by plane, rank and magnitude.
pub type Offsets = [[[i8; MAGNITUDES]; RANKS]; PLANES];

/// What is trained.
#[derive(Clone, Debug, PartialEq)]
pub struct Tables {
    /// Chances of bits.
    pub networks: Networks,
    /// How much less than a magnitude a coefficient is in the mean, steps of 1/256 of a quantiser step.
    pub offsets: Offsets,
}

/// First bytes of the tables.
const MAGIC: [u8; 4] = *b"NVT1";

/// Why bytes are no tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // Their texts tell.
pub enum TablesError {
    #[error("no coder tables: they begin with `NVT1`")]
    Magic,
    #[error("coder tables of {found} bytes, {expected} expected")]
    Length { expected: usize, found: usize },
}

impl Tables {
    /// Those of intra frames without small blocks, if the prior has no tables of its own.
    pub fn generic() -> Tables {
        Tables::read(include_bytes!("generic.nvt")).unwrap_or_else(|_| Tables::zero())
    }

    /// Those of payloads with small or displaced blocks, if the prior has no tables of its own.
    pub fn small_blocks() -> Tables {
        Tables::read(include_bytes!("small_blocks.nvt")).unwrap_or_else(|_| Tables::zero())
    }

    /// Those of inter frames. They come with the library.
    pub fn stream() -> Tables {
        Tables::read(include_bytes!("stream.nvt")).unwrap_or_else(|_| Tables::zero())
    }

    /// Makes first tables of inter frames from tables of intra frames. Forgets the weights of inputs that mean
    /// something else in inter frames.
    pub fn for_stream(&self) -> Tables {
        let mut tables = self.clone();
        let networks = &mut tables.networks;
        networks.magnitude_1[18..20].fill([0; _]);
        networks.quiet_1[..2].fill([0; _]);
        networks.sign_1[8] = [0; _];
        tables
    }

    /// Tables that know nothing: all bits at even odds.
    pub fn zero() -> Tables {
        Tables {
            networks: Networks {
                magnitude_1: [[0; _]; _],
                magnitude_class: [[0; _]; _],
                magnitude_bias_1: [0; _],
                magnitude_2: [[0; _]; _],
                magnitude_bias_2: [0; _],
                magnitude_3: [[0; _]; _],
                magnitude_bias_3: [0; _],
                quiet_1: [[0; _]; _],
                quiet_class: [[0; _]; _],
                quiet_bias_1: [0; _],
                quiet_2: [0; _],
                quiet_bias_2: 0,
                sign_1: [[0; _]; _],
                sign_class: [[0; _]; _],
                sign_bias_1: [0; _],
                sign_2: [0; _],
                sign_bias_2: 0,
            },
            offsets: [[[0; MAGNITUDES]; RANKS]; PLANES],
        }
    }

    /// Visits all weights in order.
    pub fn for_each_weight(&mut self, mut visit: impl FnMut(&mut i16)) {
        for_each(&mut self.networks, &mut visit);
    }

    /// Their length in bytes.
    pub fn encoded_len() -> usize {
        MAGIC.len() + size_of::<Networks>() + size_of::<Offsets>()
    }

    /// As bytes: weights as 16-bit little-endian numbers in the order of [`Networks`], then the offsets.
    pub fn write(&self) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        let mut copy = self.networks.clone();
        for_each(&mut copy, &mut |weight| bytes.extend_from_slice(&weight.to_le_bytes()));
        bytes.extend(self.offsets.as_flattened().as_flattened().iter().map(|v| *v as u8));
        bytes
    }

    /// Reads [`Tables::write`]'s bytes.
    pub fn read(bytes: &[u8]) -> Result<Tables, TablesError> {
        let body = bytes.strip_prefix(&MAGIC).ok_or(TablesError::Magic)?;
        let (expected, found) = (Tables::encoded_len(), bytes.len());
        if found != expected {
            return Err(TablesError::Length { expected, found });
        }
        let mut tables = Tables::zero();
        let (weights, offsets) = body.split_at(size_of::<Networks>());
        let mut weights = weights.as_chunks().0.iter();
        for_each(&mut tables.networks, &mut |weight| {
            *weight = weights.next().map_or(0, |bytes| i16::from_le_bytes(*bytes));
        });
        let into = tables.offsets.as_flattened_mut().as_flattened_mut();
        for (to, byte) in into.iter_mut().zip(offsets) {
            *to = *byte as i8;
        }
        Ok(tables)
    }
}

/// Visits all weights in order.
fn for_each(networks: &mut Networks, visit: &mut impl FnMut(&mut i16)) {
    let Networks {
        magnitude_1,
        magnitude_class,
        magnitude_bias_1,
        magnitude_2,
        magnitude_bias_2,
        magnitude_3,
        magnitude_bias_3,
        quiet_1,
        quiet_class,
        quiet_bias_1,
        quiet_2,
        quiet_bias_2,
        sign_1,
        sign_class,
        sign_bias_1,
        sign_2,
        sign_bias_2,
    } = networks;
    let parts: [&mut [i16]; 17] = [
        magnitude_1.as_flattened_mut(),
        magnitude_class.as_flattened_mut(),
        magnitude_bias_1,
        magnitude_2.as_flattened_mut(),
        magnitude_bias_2,
        magnitude_3.as_flattened_mut(),
        magnitude_bias_3,
        quiet_1.as_flattened_mut(),
        quiet_class.as_flattened_mut(),
        quiet_bias_1,
        quiet_2,
        std::slice::from_mut(quiet_bias_2),
        sign_1.as_flattened_mut(),
        sign_class.as_flattened_mut(),
        sign_bias_1,
        sign_2,
        std::slice::from_mut(sign_bias_2),
    ];
    parts.into_iter().flatten().for_each(visit);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_library_has_tables() {
        let tables = Tables::read(include_bytes!("generic.nvt")).expect("tables of this version");
        assert_ne!(tables, Tables::zero());
        assert_eq!(tables, Tables::generic());
        assert_eq!(tables.write(), include_bytes!("generic.nvt"));
    }

    #[test]
    fn other_bytes_are_refused() {
        let bytes = Tables::generic().write();
        let (expected, found) = (bytes.len(), bytes.len() - 1);
        let short = Tables::read(&bytes[..found]);
        assert_eq!(short, Err(TablesError::Length { expected, found }));
        assert_eq!(Tables::read(b"NVT0"), Err(TablesError::Magic));
        assert_eq!(Tables::read(&[]), Err(TablesError::Magic));
    }
}
