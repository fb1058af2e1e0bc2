//! The part of splats in steps.

use super::super::container::Words;
use super::super::{PriorError, Splats};
use super::quantise::{self, Grid, Quantisation, dequantise, quantise};
use super::{planes, stream};

/// What errors call it.
const FORMAT: &str = "splats";

/// Splats in steps, in the order of the file.
pub struct Coded {
    sh_degree: u32,
    quantisation: Quantisation,
    grid: Grid,
    ranks: Vec<u128>,
    columns: Vec<Vec<i32>>,
}

impl Coded {
    /// Splats in steps and in order; those at one place keep theirs. The splats must be valid. Also returns which of
    /// them stands at each place.
    pub fn of(
        splats: &Splats,
        quantisation: &Quantisation,
    ) -> Result<(Coded, Vec<u32>), PriorError> {
        let grid = Grid::of(&splats.positions, quantisation.position);
        let rows = (0..splats.len()).map(|i| quantise(splats, i, quantisation));
        let rows = rows.collect::<Result<Vec<_>, _>>()?;
        let ranks = splats.positions.iter().map(|p| stream::rank(grid.code(*p)));
        let mut order: Vec<(u128, u32)> = ranks.zip(0..).collect();
        order.sort_unstable();
        let columns = vec![vec![0; splats.len()]; quantise::columns(splats.sh_degree)];
        let (sh_degree, ranks) = (splats.sh_degree, vec![0; splats.len()]);
        let mut coded = Coded { sh_degree, quantisation: *quantisation, grid, ranks, columns };
        for (place, (rank, index)) in order.iter().enumerate() {
            let (position, index) = (grid.position(stream::unrank(*rank)), *index as usize);
            if let Some(axis) = position.iter().position(|v| !v.is_finite()) {
                return Err(PriorError::OutOfSteps {
                    splat: index,
                    column: "position",
                    value: splats.positions[index][axis],
                    step: quantisation.position,
                });
            }
            coded.ranks[place] = *rank;
            for (column, code) in coded.columns.iter_mut().zip(&rows[index]) {
                column[place] = *code;
            }
        }
        Ok((coded, order.into_iter().map(|(_, index)| index).collect()))
    }

    /// The part's content.
    pub fn to_bytes(&self) -> Result<Vec<u8>, PriorError> {
        let mut bytes: Vec<u8> = self.grid.origin.into_iter().flat_map(f32::to_le_bytes).collect();
        bytes.extend(i32::from(self.grid.exponent).to_le_bytes());
        bytes.extend(self.quantisation.steps().into_iter().flat_map(|(_, s)| s.to_le_bytes()));
        let packed = planes::pack(&stream::planes(&self.ranks, &self.columns), self.ranks.len());
        bytes.extend(packed.map_err(PriorError::Write)?);
        Ok(bytes)
    }

    /// Reads the part's content, which begins at byte `at` of a file.
    pub fn read(
        content: &[u8],
        at: usize,
        count: usize,
        sh_degree: u32,
    ) -> Result<Coded, PriorError> {
        let refusal = |offset: usize, reason: String| {
            Err(PriorError::Field { format: FORMAT, offset: offset as u64, reason })
        };
        let mut words = Words::new(content, at);
        let origin = words.floats::<3>()?;
        if !origin.iter().all(|v| v.is_finite()) {
            return refusal(at, "an origin that is not finite".into());
        }
        let (offset, exponent) = (words.at(), words.word()? as i32);
        let within = i16::try_from(exponent).ok().filter(|e| Grid::EXPONENTS.contains(e));
        let Some(exponent) = within else {
            return refusal(offset, format!("positions in steps of 2^{exponent}"));
        };
        let [position, log_scale, rotation, opacity_logit, colour, sh] = words.floats()?;
        let quantisation =
            Quantisation { position, log_scale, rotation, opacity_logit, colour, sh };
        quantisation.check()?;
        let columns = quantise::columns(sh_degree);
        let (offset, size) = (words.at(), stream::size(count, columns));
        let planes = planes::unpack(words.rest(), offset, FORMAT, (count, size))?;
        let (ranks, columns) = stream::numbers(&planes, count);
        let grid = Grid { origin, exponent };
        Ok(Coded { sh_degree, quantisation, grid, ranks, columns })
    }

    /// The splats that the numbers stand for.
    pub fn splats(&self) -> Splats {
        let mut splats = Splats::with_capacity(self.ranks.len(), self.sh_degree);
        let mut row = vec![0; self.columns.len()];
        for (place, rank) in self.ranks.iter().enumerate() {
            for (code, column) in row.iter_mut().zip(&self.columns) {
                *code = column[place];
            }
            let position = self.grid.position(stream::unrank(*rank));
            dequantise(&mut splats, position, &row, &self.quantisation);
        }
        splats
    }
}
