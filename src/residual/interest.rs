//! Regions of interest: parts of a picture that get more of the bits.

use super::ResidualError;

/// How much the parts of a picture count, in cells of equal size over all of it.
///
/// An error in a cell of weight `w` counts `w` times as much as one in a cell of weight 1. Only the ratios of the
/// weights matter. The difference picture's bytes go there: at the same budget, the other cells get fewer. What decodes
/// them needs to know nothing of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Interest {
    columns: u32,
    rows: u32,
    weights: Vec<u8>,
    /// The greatest weight of all: each pixel is compared with it.
    greatest: u8,
}

/// Most cells along a side.
const MAX_CELLS: u32 = 4096;

impl Interest {
    /// Reads a map of `columns · rows` weights, row by row, 1 to 255 each. It is laid over pictures of any size.
    ///
    /// # Errors
    /// If there are no cells or more than 4096 along a side, weights are missing or left over, or one is 0.
    pub fn map(columns: u32, rows: u32, weights: &[u8]) -> Result<Interest, ResidualError> {
        let in_range = |cells| (1..=MAX_CELLS).contains(&cells);
        let expected = u64::from(columns) * u64::from(rows);
        if !in_range(columns) || !in_range(rows) || weights.len() as u64 != expected {
            return Err(ResidualError::InterestSize { columns, rows, weights: weights.len() });
        }
        if let Some(cell) = weights.iter().position(|weight| *weight == 0) {
            return Err(ResidualError::InterestWeight { cell });
        }
        let greatest = weights.iter().copied().max().unwrap_or(1);
        Ok(Interest { columns, rows, weights: weights.to_vec(), greatest })
    }

    /// A rectangle in pictures of a size, pixels: what lies in it has the weight, all else 1. Parts outside the picture
    /// are ignored.
    ///
    /// # Errors
    /// If the picture has no pixels or more than 4096 along a side, the weight is 0, or the rectangle holds no pixel.
    pub fn rectangle(
        size: (u32, u32),
        x: std::ops::Range<u32>,
        y: std::ops::Range<u32>,
        weight: u8,
    ) -> Result<Interest, ResidualError> {
        let (columns, rows) = size;
        let cells = (columns.min(MAX_CELLS) * rows.min(MAX_CELLS)) as usize;
        let mut interest = Interest::map(columns, rows, &vec![1; cells])?;
        let (x, y) = (x.start..x.end.min(columns), y.start..y.end.min(rows));
        if x.is_empty() || y.is_empty() {
            return Err(ResidualError::InterestEmpty);
        }
        if weight == 0 {
            return Err(ResidualError::InterestWeight { cell: 0 });
        }
        interest.greatest = weight;
        for row in y {
            let start = (row * columns) as usize;
            interest.weights[start + x.start as usize..start + x.end as usize].fill(weight);
        }
        Ok(interest)
    }

    /// The greatest weight of all.
    pub(super) fn greatest(&self) -> u8 {
        self.greatest
    }

    /// The greatest weight in a part of the picture. `across` and `down`: the part's ends, of `of` pixels.
    pub(super) fn within(&self, across: [usize; 2], down: [usize; 2], of: (usize, usize)) -> u8 {
        let cells = |[from, to]: [usize; 2], of: usize, cells: u32| {
            let cells = cells as usize;
            from * cells / of..(to * cells).div_ceil(of).min(cells)
        };
        let columns = cells(across, of.0, self.columns);
        let rows = cells(down, of.1, self.rows);
        let stride = self.columns as usize;
        let of_row = |row: usize| {
            let row = &self.weights[row * stride..][columns.clone()];
            row.iter().copied().max().unwrap_or(1)
        };
        rows.map(of_row).max().unwrap_or(1)
    }

    /// Whether a pixel of a picture counts most.
    pub(crate) fn is_greatest(&self, x: u32, y: u32, of: (u32, u32)) -> bool {
        let (x, y) = (x as usize, y as usize);
        let of = (of.0 as usize, of.1 as usize);
        self.within([x, x + 1], [y, y + 1], of) == self.greatest()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_lies_over_pictures_of_any_size() {
        let interest = Interest::map(2, 1, &[1, 9]).unwrap();
        assert_eq!(interest.greatest(), 9);
        for width in [2, 7, 320] {
            let greatest = (0..width).filter(|x| interest.is_greatest(*x, 0, (width, 3))).count();
            // A pixel that lies on both cells has the greater weight.
            assert_eq!(greatest as u32, width.div_ceil(2));
        }
        assert_eq!(interest.within([0, 4], [0, 1], (4, 4)), 9);
        assert_eq!(interest.within([0, 2], [3, 4], (4, 4)), 1);
    }

    #[test]
    fn a_rectangle_is_cut_at_the_picture() {
        let interest = Interest::rectangle((8, 6), 6..100, 5..6, 4).unwrap();
        let greatest = (0..6).flat_map(|y| (0..8).map(move |x| (x, y)));
        let greatest: Vec<_> =
            greatest.filter(|(x, y)| interest.is_greatest(*x, *y, (8, 6))).collect();
        assert_eq!(greatest, [(6, 5), (7, 5)]);
    }

    #[test]
    fn what_is_no_map_is_refused() {
        for (columns, rows, weights) in
            [(0, 1, &[][..]), (2, 2, &[1, 1, 1]), (1, 5000, &[1; 5000]), (u32::MAX, u32::MAX, &[1])]
        {
            let refused = Interest::map(columns, rows, weights);
            assert!(matches!(refused, Err(ResidualError::InterestSize { .. })));
        }
        assert_eq!(Interest::map(2, 1, &[1, 0]), Err(ResidualError::InterestWeight { cell: 1 }));
        let outside = Interest::rectangle((8, 6), 8..9, 0..6, 4);
        assert_eq!(outside, Err(ResidualError::InterestEmpty));
        #[allow(clippy::reversed_empty_ranges)]
        let reversed = Interest::rectangle((8, 6), 5..2, 0..6, 4);
        assert_eq!(reversed, Err(ResidualError::InterestEmpty));
    }
}
