//! What of a picture is not as the camera saw it, as rectangles.

use nvsprior::truth::{BLOCK, TruthLevel, TruthMap};

/// Regions of one picture at most.
pub const MOST: usize = 16;

/// Blocks of one level that lie side by side or above each other.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Region {
    pub level: u8,
    /// Number of its blocks.
    pub blocks: usize,
    /// The smallest rectangle around it: x, y, width, height, pixels.
    pub rectangle: (u32, u32, u32, u32),
}

/// What regions of a level are called.
pub fn name_of(level: u8) -> Option<&'static str> {
    match level {
        level if level == TruthLevel::Differs as u8 => Some("nvsp-differs"),
        level if level == TruthLevel::Wrong as u8 => Some("nvsp-wrong"),
        level if level == TruthLevel::NotSeen as u8 => Some("nvsp-not-seen"),
        _ => None,
    }
}

/// The largest regions of a picture of a size that are not as seen, the largest first.
pub fn regions(map: &TruthMap, (width, height): (u32, u32)) -> Vec<Region> {
    let columns = map.columns as usize;
    let mut left: Vec<bool> = map.levels.iter().map(|level| name_of(*level).is_some()).collect();
    let mut found = Vec::new();
    let mut edge = Vec::new();
    for start in 0..map.levels.len() {
        if !std::mem::take(&mut left[start]) {
            continue;
        }
        let level = map.levels[start];
        let [mut x, mut y] = [start % columns, start / columns].map(|at| at..at + 1);
        let mut blocks = 0;
        edge.push(start);
        while let Some(at) = edge.pop() {
            blocks += 1;
            let (column, row) = (at % columns, at / columns);
            x = x.start.min(column)..x.end.max(column + 1);
            y = y.start.min(row)..y.end.max(row + 1);
            let beside = [
                (column > 0).then(|| at - 1),
                (column + 1 < columns).then_some(at + 1),
                at.checked_sub(columns),
                (at + columns < left.len()).then_some(at + columns),
            ];
            for next in beside.into_iter().flatten() {
                if map.levels[next] == level && std::mem::take(&mut left[next]) {
                    edge.push(next);
                }
            }
        }
        let pixels = |blocks: std::ops::Range<usize>, end: u32| {
            let start = blocks.start as u32 * BLOCK;
            (start, (blocks.end as u32 * BLOCK).min(end) - start)
        };
        let ((x, across), (y, down)) = (pixels(x, width), pixels(y, height));
        found.push(Region { level, blocks, rectangle: (x, y, across, down) });
    }
    found.sort_by_key(|region| std::cmp::Reverse(region.blocks));
    found.truncate(MOST);
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A map of levels, a digit each.
    fn map(rows: &[&str]) -> TruthMap {
        let (columns, count) = (rows[0].len() as u32, rows.len() as u32);
        let mut map = TruthMap::not_seen(columns * BLOCK, count * BLOCK);
        map.levels = rows.concat().bytes().map(|digit| digit - b'0').collect();
        map
    }

    #[test]
    fn neighbours_of_one_level_are_a_region() {
        let map = map(&["00110", "01120", "00220", "30002"]);
        let found = regions(&map, (5 * BLOCK - 3, 4 * BLOCK - 5));
        let region = |level, blocks, rectangle| Region { level, blocks, rectangle };
        assert_eq!(
            found,
            [
                region(1, 4, (16, 0, 48, 32)),
                region(2, 3, (32, 16, 32, 32)),
                region(3, 1, (0, 48, 16, 11)),
                // Corners do not join blocks; at the edges they are smaller.
                region(2, 1, (64, 48, 13, 11)),
            ]
        );
        assert_eq!(name_of(found[0].level), Some("nvsp-differs"));
        assert_eq!(name_of(0), None);
    }

    #[test]
    fn the_largest_come_first_and_others_are_left_out() {
        let row = "1010101010".repeat(4);
        let zeros = "0".repeat(row.len());
        let last = format!("11{}", "0".repeat(row.len() - 2));
        let found = regions(&map(&[&row, &zeros, &last]), (40 * BLOCK, 3 * BLOCK));
        assert_eq!(found.len(), MOST);
        assert_eq!((found[0].blocks, found[0].rectangle), (2, (0, 32, 32, 16)));
        assert!(found[1..].iter().all(|region| region.blocks == 1));
        assert!(regions(&map(&["00", "00"]), (32, 32)).is_empty());
        let all = regions(&TruthMap::not_seen(100, 50), (100, 50));
        assert_eq!(all, [Region { level: 3, blocks: 28, rectangle: (0, 0, 100, 50) }]);
        assert!(regions(&TruthMap::default(), (0, 0)).is_empty());
    }
}
