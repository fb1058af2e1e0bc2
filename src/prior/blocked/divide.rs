//! Which splats go together into a block.

use super::super::splats::Splats;

/// Splats longer than the blocks around them is wide by these shares come to blocks of their own. A block is read if
/// its longest splat may be seen, so one long splat would make its whole block seen from afar.
const CLASSES: [f64; 2] = [0.125, 0.5];

/// Divides the splats that `which` names into blocks of at most `most`, each compact in space.
pub fn divide(splats: &Splats, which: Vec<u32>, most: usize) -> Vec<Vec<u32>> {
    let edge = typical_edge(splats, which.clone(), most);
    let mut classes = [Vec::new(), Vec::new(), Vec::new()];
    for index in which {
        let longest = libm::exp(longest_log_scale(splats, index).into());
        let class = CLASSES.iter().filter(|share| longest > **share * edge).count();
        classes[class].push(index);
    }
    let mut blocks = Vec::new();
    for class in classes {
        halve(splats, class, most, &mut blocks);
    }
    blocks
}

/// The greatest of a splat's three log scales.
pub fn longest_log_scale(splats: &Splats, index: u32) -> f32 {
    splats.log_scales[index as usize].into_iter().fold(f32::NEG_INFINITY, f32::max)
}

/// The median, over blocks, of the longest side of their boxes.
fn typical_edge(splats: &Splats, which: Vec<u32>, most: usize) -> f64 {
    let mut blocks = Vec::new();
    halve(splats, which, most, &mut blocks);
    let longest = |block: &Vec<u32>| longest_axis(splats, block).1;
    let mut edges: Vec<f64> = blocks.iter().map(longest).collect();
    edges.sort_unstable_by(f64::total_cmp);
    edges.get(edges.len() / 2).copied().unwrap_or(0.0)
}

/// Halves a list of splats at the median of its longest axis, and so on, until a block has at most `most`. Blocks are
/// added in an order in which neighbours lie side by side.
fn halve(splats: &Splats, mut which: Vec<u32>, most: usize, blocks: &mut Vec<Vec<u32>>) {
    if which.is_empty() {
        return;
    }
    if which.len() <= most {
        blocks.push(which);
        return;
    }
    let (axis, _) = longest_axis(splats, &which);
    let place = |index: &u32| splats.positions[*index as usize][axis];
    let middle = which.len() / 2;
    // Ties by index, so that the blocks depend on the splats alone.
    which.select_nth_unstable_by(middle, |a, b| place(a).total_cmp(&place(b)).then(a.cmp(b)));
    let upper = which.split_off(middle);
    halve(splats, which, most, blocks);
    halve(splats, upper, most, blocks);
}

/// The axis along which splats lie farthest apart, and how far that is.
fn longest_axis(splats: &Splats, which: &[u32]) -> (usize, f64) {
    let extent = |axis: usize| {
        let places = which.iter().map(|i| f64::from(splats.positions[*i as usize][axis]));
        let ends = places.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, greatest], v| {
            [least.min(v), greatest.max(v)]
        });
        ends[1] - ends[0]
    };
    let extents = [0, 1, 2].map(extent);
    let longer = |a: usize, b: usize| if extents[b] > extents[a] { b } else { a };
    let axis = longer(longer(0, 1), 2);
    (axis, extents[axis])
}
