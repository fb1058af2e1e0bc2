//! Which pictures are compared: those near each other in time, and those that show the same place.

use image::imageops::FilterType;
use nvsprior::tracking::{Alike, Places};

use super::Matching;

/// Pictures before each that it is compared with; of those farther back, the ones at powers of two up to [`FARTHEST`].
const OVERLAP: usize = 8;
const FARTHEST: usize = 128;
/// Up to so many pictures are all compared with each other.
pub const ALL: usize = 2 * OVERLAP;
/// Places that each picture is compared with, beside those near it.
const PLACES: usize = 3;
/// As [`PLACES`], if the order of names is not that of time.
const PLACES_ALONE: usize = 12;
/// Pictures of one place that follow each other are as good as one: so many apart they count as two.
const APART: usize = 3;
/// Corners in common by which a picture shows the same place; pictures of other places have fewer.
const CORNERS: u32 = 16;
/// Pictures are looked at in this width, pixels.
const WIDTH: u32 = 320;

/// The corners that pictures have in common.
pub struct Seen {
    places: Places,
    size: (u32, u32),
    /// For each picture: the earlier ones that look alike.
    alike: Vec<Vec<Alike>>,
}

impl Seen {
    /// For so many pictures; the first one's size says what shape they have.
    pub fn new(first: (u32, u32), pictures: usize) -> Seen {
        let (width, height) = (WIDTH.min(first.0).max(1), f64::from(first.1.max(1)));
        let height = (height * f64::from(width) / f64::from(first.0.max(1))).round() as u32;
        let size = (width, height.max(1));
        let places = Places::new(size.0, size.1, pictures);
        Seen { places, size, alike: Vec::with_capacity(pictures) }
    }

    /// The size at which pictures are looked at.
    pub fn size(&self) -> (u32, u32) {
        self.size
    }

    /// Adds the next picture, by its luma at [`Seen::size`].
    pub fn add(&mut self, luma: &[f32]) {
        let alike = self.places.add(luma).filter(|alike| alike.corners >= CORNERS).collect();
        self.alike.push(alike);
    }

    /// Pairs of pictures, the earlier one first, in order. `in_order`: the order of the pictures is that of time.
    pub fn pairs(&self, matching: Matching, in_order: bool) -> Vec<(usize, usize)> {
        let count = self.alike.len();
        let exhaustive =
            matching == Matching::Exhaustive || (matching == Matching::Auto && count <= ALL);
        if exhaustive {
            return (0..count).flat_map(|late| (0..late).map(move |early| (early, late))).collect();
        }
        let mut pairs: Vec<_> = (0..count).flat_map(near).collect();
        if matching == Matching::Auto {
            let most = if in_order { PLACES } else { PLACES_ALONE };
            pairs.extend((0..count).flat_map(|late| self.places_of(late, most)));
        }
        pairs.sort_unstable();
        pairs.dedup();
        pairs
    }

    /// Whether the order of names is that of time: most pictures look like one of those just before them.
    pub fn in_order(&self) -> bool {
        let follows = |(late, alike): &(usize, &Vec<Alike>)| {
            alike.first().is_some_and(|best| late - best.picture as usize <= OVERLAP)
        };
        let alone = self.alike.iter().filter(|alike| alike.is_empty()).count();
        let following = self.alike.iter().enumerate().filter(follows).count();
        2 * following >= self.alike.len() - alone
    }

    /// Earlier pictures that show the same place and are not near in time, those with most corners in common.
    fn places_of(&self, late: usize, most: usize) -> impl Iterator<Item = (usize, usize)> {
        let mut chosen: Vec<usize> = Vec::with_capacity(most);
        let far = self.alike[late].iter().map(|alike| alike.picture as usize);
        for early in far.filter(|early| late - early > OVERLAP) {
            if chosen.len() < most && chosen.iter().all(|other| early.abs_diff(*other) >= APART) {
                chosen.push(early);
            }
        }
        chosen.into_iter().map(move |early| (early, late))
    }
}

/// The pairs of a picture with those before it in time.
fn near(late: usize) -> impl Iterator<Item = (usize, usize)> {
    let steps = (1..=OVERLAP).chain((1..).map(|k| OVERLAP << k));
    steps.take_while(move |step| *step <= late.min(FARTHEST)).map(move |step| (late - step, late))
}

/// Pairs that join all other pictures to those at some places: each is compared with the nearest of these on both
/// sides, and with the one before it.
pub fn joining(places: &[usize], count: usize) -> Vec<(usize, usize)> {
    const EACH_SIDE: usize = 2;
    let mut pairs = Vec::new();
    for at in (0..count).filter(|at| places.binary_search(at).is_err()) {
        let next = places.partition_point(|place| *place < at);
        let near = next.saturating_sub(EACH_SIDE)..(next + EACH_SIDE).min(places.len());
        let near = near.map(|i| (places[i].min(at), places[i].max(at)));
        pairs.extend(near.chain(at.checked_sub(1).map(|before| (before, at))));
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// A picture's luma at a size: values in [0, 1].
pub fn luma(picture: &image::DynamicImage, size: (u32, u32)) -> Vec<f32> {
    let small = picture.resize_exact(size.0, size.1, FilterType::Triangle).into_luma8();
    small.into_raw().into_iter().map(|value| f32::from(value) / 255.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(alike: &[&[(u32, u32)]]) -> Seen {
        let alike = alike.iter().map(|list| {
            list.iter().map(|&(picture, corners)| Alike { picture, corners }).collect()
        });
        Seen { alike: alike.collect(), ..Seen::new((32, 18), 1) }
    }

    #[test]
    fn near_pictures_are_compared_and_far_ones_at_powers_of_two() {
        let mut list = vec![&[][..]; 300];
        list[40] = &[(39, 90)];
        let pairs = seen(&list).pairs(Matching::Sequential, true);
        let of = |late: usize| pairs.iter().filter(move |pair| pair.1 == late).map(|pair| pair.0);
        assert_eq!(of(3).collect::<Vec<_>>(), [0, 1, 2]);
        let expected = [72, 136, 168, 184, 192, 193, 194, 195, 196, 197, 198, 199];
        assert_eq!(of(200).collect::<Vec<_>>(), expected);
    }

    #[test]
    fn a_place_seen_before_is_compared_once_for_each_stretch() {
        let mut list = vec![&[][..]; 60];
        for (late, own) in list.iter_mut().enumerate().skip(1) {
            *own = [&[(0, 99)], &[(50, 99)]][usize::from(late > 50)];
        }
        list[59] = &[(58, 90), (10, 60), (11, 50), (20, 40), (30, 30), (35, 20)];
        let seen = seen(&list);
        assert!(!seen.in_order());
        let places: Vec<_> = seen.places_of(59, PLACES).collect();
        assert_eq!(places, [(10, 59), (20, 59), (30, 59)]);
        assert!(seen.pairs(Matching::Auto, true).contains(&(30, 59)));
        assert!(!seen.pairs(Matching::Sequential, true).contains(&(30, 59)));
    }

    #[test]
    fn other_pictures_are_compared_with_those_beside_them() {
        let pairs = joining(&[0, 4, 8], 10);
        let of = |at: usize| pairs.iter().filter(move |pair| pair.0 == at || pair.1 == at);
        // Three of the few, the one before, and the one after, which has it before itself.
        assert_eq!(of(6).count(), 5, "{pairs:?}");
        for pair in [(0, 1), (1, 4), (1, 8), (1, 2), (0, 2), (0, 5), (4, 9), (8, 9)] {
            assert!(pairs.contains(&pair), "{pair:?} {pairs:?}");
        }
        assert!(pairs.iter().all(|pair| pair.0 < pair.1) && !pairs.contains(&(0, 4)));
        assert_eq!(joining(&[0, 1, 2], 3), []);
    }

    #[test]
    fn few_pictures_are_all_compared() {
        let seen = seen(&[&[][..]; 12]);
        assert_eq!(seen.pairs(Matching::Auto, true).len(), 66);
        assert!(seen.pairs(Matching::Sequential, true).len() < 66);
        assert_eq!(seen.pairs(Matching::Exhaustive, true).len(), 66);
    }
}
