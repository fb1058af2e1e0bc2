//! Brings poses to a stated course: the similarity (Umeyama 1991; the rotation by Davenport's q-method) that takes the
//! cameras nearest to the places, and the camera's verticals nearest to the stated ones.

use std::path::Path;

use glam::{DMat3, DQuat, DVec3};
use nvsprior::Pose;

use super::{NavigationError, Stated};
use crate::posed::PosedPictures;

/// What stated courses were fitted to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Alignment {
    /// Pictures of which something is stated.
    pub pictures: usize,
    /// Metres per unit; `None`: nothing says how large the scene is, and the unit stays.
    pub metres: Option<f64>,
    /// Whether z is down now.
    pub upright: bool,
    /// How far the cameras are from the stated places, root mean square, metres.
    pub off: Option<f64>,
    /// How far the stated places lie apart, metres.
    pub span: Option<f64>,
    /// The stated place that is the origin now: north, east, down, metres.
    pub origin: DVec3,
}

/// Rounds of fitting; each weighs places by how far they were off in the one before.
const ROUNDS: usize = 10;
/// Places that lie on a line say nothing of the turn about it: how wide a course must be for its length.
const WIDE: f64 = 0.05;
/// How far depths must differ, in the unit of the poses, to give the scale.
const DEEPER: f64 = 0.2;

/// A picture's camera as found, and what is stated of it.
struct Pair {
    centre: DVec3,
    /// Camera to world.
    turn: DMat3,
    stated: Stated,
}

/// Brings poses and points to what is stated of the pictures. World axes become north, east, down, in metres from
/// [`Alignment::origin`], as far as that is stated. `tilt`: how far the camera looks up if the vehicle is level,
/// radians.
pub fn align(
    posed: &mut PosedPictures,
    stated: &[Option<Stated>],
    tilt: f64,
    path: &Path,
) -> Result<Alignment, NavigationError> {
    let pair = |(input, stated): (&crate::posed::PosedInput, &Option<Stated>)| {
        let Pose { rotation, .. } = input.pose;
        let turn = DMat3::from_quat(rotation.conjugate());
        stated.map(|stated| Pair { centre: input.pose.centre(), turn, stated })
    };
    let pairs: Vec<Pair> = posed.inputs.iter().zip(stated).filter_map(pair).collect();
    if pairs.len() < 3 {
        return Err(NavigationError::Few { path: path.to_path_buf(), count: pairs.len() });
    }
    let nothing = || NavigationError::Nothing { path: path.to_path_buf() };
    let fitted = Fitted::of(&pairs, tilt).ok_or_else(nothing)?;
    fitted.apply(posed);
    Ok(fitted.alignment(&pairs))
}

/// world = scale · turn · found + shift
struct Fitted {
    scale: Option<f64>,
    turn: DQuat,
    shift: DVec3,
    upright: bool,
    origin: DVec3,
    /// Whether places were fitted.
    placed: bool,
}

impl Fitted {
    fn of(pairs: &[Pair], tilt: f64) -> Option<Fitted> {
        let verticals: Vec<_> = pairs.iter().filter_map(|pair| directions(pair, tilt)).collect();
        let places: Vec<(DVec3, DVec3)> =
            pairs.iter().filter_map(|pair| Some((pair.centre, pair.stated.position()?))).collect();
        let wide = places.len() >= 3 && width(&places) > WIDE;
        if places.len() >= 3 && (wide || !verticals.is_empty()) {
            return by_places(&places, &verticals);
        }
        if verticals.is_empty() { None } else { Some(by_depths(pairs, &verticals)) }
    }

    fn apply(&self, posed: &mut PosedPictures) {
        let scale = self.scale.unwrap_or(1.0);
        let back = self.turn.conjugate();
        for input in &mut posed.inputs {
            let centre = self.place(input.pose.centre());
            let rotation = (input.pose.rotation * back).normalize();
            input.pose = Pose { rotation, translation: -(rotation * centre) };
        }
        for point in posed.points.iter_mut().flatten() {
            point.position = self.turn * point.position * scale + self.shift;
        }
    }

    fn place(&self, found: DVec3) -> DVec3 {
        self.turn * found * self.scale.unwrap_or(1.0) + self.shift
    }

    fn alignment(&self, pairs: &[Pair]) -> Alignment {
        let places = pairs.iter().filter_map(|pair| {
            let stated = pair.stated.position().filter(|_| self.placed)? - self.origin;
            Some((self.place(pair.centre), stated))
        });
        let places: Vec<_> = places.collect();
        let count = places.len().max(1) as f64;
        let square = places.iter().map(|(a, b)| a.distance_squared(*b)).sum::<f64>() / count;
        let mean = places.iter().map(|(_, b)| *b).sum::<DVec3>() / count;
        let far = places.iter().map(|(_, b)| b.distance(mean)).fold(0.0, f64::max);
        let placed = (!places.is_empty()).then_some(());
        Alignment {
            pictures: pairs.len(),
            metres: self.scale,
            upright: self.upright,
            off: placed.map(|()| square.sqrt()),
            span: placed.map(|()| 2.0 * far),
            origin: self.origin,
        }
    }
}

/// Directions in the found world, and what they are: down; north too if it is stated.
fn directions(pair: &Pair, tilt: f64) -> Option<Vec<(DVec3, DVec3)>> {
    let seen = pair.stated.seen(tilt)?;
    let down = (pair.turn * seen.z_axis, DVec3::Z);
    let north = pair.stated.heading.map(|_| (pair.turn * seen.x_axis, DVec3::X));
    Some([Some(down), north].into_iter().flatten().collect())
}

fn by_places(places: &[(DVec3, DVec3)], verticals: &[Vec<(DVec3, DVec3)>]) -> Option<Fitted> {
    let mut weights = vec![1.0; places.len()];
    let origin = (places.iter().map(|(_, b)| *b).sum::<DVec3>() / places.len() as f64).round();
    // Of the stated directions the vertical counts, as much as all places; a compass is worth less than they are.
    let down: Vec<_> = verticals.iter().map(|directions| directions[0]).collect();
    let mut fitted = None;
    for _ in 0..ROUNDS {
        let sum: f64 = weights.iter().sum();
        let mean = |of: fn(&(DVec3, DVec3)) -> DVec3| {
            let weighted = places.iter().zip(&weights).map(|(pair, weight)| of(pair) * *weight);
            weighted.sum::<DVec3>() / sum
        };
        let (found, stated) = (mean(|pair| pair.0), mean(|pair| pair.1));
        let aside: Vec<_> = places.iter().map(|(a, b)| (*a - found, *b - stated)).collect();
        let lengths: f64 =
            aside.iter().zip(&weights).map(|((a, b), w)| w * a.length() * b.length()).sum();
        if lengths <= 0.0 || lengths.is_nan() {
            return None;
        }
        let of_places = aside.iter().zip(&weights).map(|((a, b), w)| (*a, *b, w / lengths));
        let of_down = down.iter().map(|(a, b)| (*a, *b, 1.0 / down.len() as f64));
        let turn = turn(of_places.chain(of_down));
        let (along, square) = aside.iter().zip(&weights).fold((0.0, 0.0), |(s, q), ((a, b), w)| {
            (s + w * (turn * *a).dot(*b), q + w * a.length_squared())
        });
        let scale = along / square;
        if !(scale > 0.0 && scale.is_finite()) {
            return None;
        }
        let shift = stated - origin - turn * found * scale;
        let off: Vec<f64> =
            places.iter().map(|(a, b)| (turn * *a * scale + shift).distance(*b - origin)).collect();
        let usual = 2.5 * median(&off).max(1e-9);
        weights = off.iter().map(|off| (1.0 + (off / usual).powi(2)).powi(-2)).collect();
        let scale = Some(scale);
        fitted = Some(Fitted { scale, turn, shift, upright: true, origin, placed: true });
    }
    fitted
}

/// Without places: the vertical, and the scale if depths differ.
fn by_depths(pairs: &[Pair], verticals: &[Vec<(DVec3, DVec3)>]) -> Fitted {
    let turn = turn(verticals.iter().flatten().map(|(a, b)| (*a, *b, 1.0)));
    let depths: Vec<(f64, f64)> = pairs
        .iter()
        .filter_map(|pair| Some(((turn * pair.centre).z, pair.stated.depth?)))
        .collect();
    let count = depths.len().max(1) as f64;
    let found = depths.iter().map(|pair| pair.0).sum::<f64>() / count;
    let stated = depths.iter().map(|pair| pair.1).sum::<f64>() / count;
    let (along, square) = depths.iter().fold((0.0, 0.0), |(s, q), (a, b)| {
        (s + (a - found) * (b - stated), q + (a - found).powi(2))
    });
    let scale = along / square;
    let told = (square / count).sqrt() > DEEPER && scale > 0.0 && scale.is_finite();
    let scale = told.then_some(scale);
    let origin = DVec3::new(0.0, 0.0, if told { stated.round() } else { 0.0 });
    let shift = DVec3::new(0.0, 0.0, scale.map_or(0.0, |s| stated - origin.z - s * found));
    Fitted { scale, turn, shift, upright: true, origin, placed: false }
}

/// How wide the stated places lie, for their length: of the plane through them.
fn width(places: &[(DVec3, DVec3)]) -> f64 {
    let mean = places.iter().map(|(_, b)| *b).sum::<DVec3>() / places.len() as f64;
    let aside = || places.iter().map(|(_, b)| *b - mean);
    let farthest =
        aside().fold(DVec3::ZERO, |far, p| if p.length() > far.length() { p } else { far });
    let along = farthest.normalize_or_zero();
    let across = aside().map(|p| (p - along * p.dot(along)).length()).fold(0.0, f64::max);
    across / farthest.length().max(1e-12)
}

/// The rotation that turns the first vectors nearest to the second ones, with weights: the eigenvector of Davenport's
/// matrix with the largest eigenvalue, by its powers.
fn turn(pairs: impl Iterator<Item = (DVec3, DVec3, f64)>) -> DQuat {
    let mut b = DMat3::ZERO;
    for (from, to, weight) in pairs {
        b += DMat3::from_cols(to * from.x, to * from.y, to * from.z) * weight;
    }
    let sum = b + b.transpose();
    let trace = b.x_axis.x + b.y_axis.y + b.z_axis.z;
    let z = DVec3::new(b.y_axis.z - b.z_axis.y, b.z_axis.x - b.x_axis.z, b.x_axis.y - b.y_axis.x);
    let s = sum.to_cols_array_2d();
    let mut k = [[0.0; 4]; 4];
    for i in 0..3 {
        for j in 0..3 {
            k[i][j] = s[j][i] - if i == j { trace } else { 0.0 };
        }
        (k[i][3], k[3][i]) = (z[i], z[i]);
    }
    k[3][3] = trace;
    // Shifted, so that the largest eigenvalue is the largest by size; squared again and again, it alone is left.
    let size = k.iter().flatten().map(|v: &f64| v * v).sum::<f64>().sqrt().max(1e-300);
    let mut power: [[f64; 4]; 4] = std::array::from_fn(|i| {
        std::array::from_fn(|j| k[i][j] / size + if i == j { 1.0 } else { 0.0 })
    });
    for _ in 0..60 {
        let product: [[f64; 4]; 4] = std::array::from_fn(|i| {
            std::array::from_fn(|j| (0..4).map(|l| power[i][l] * power[l][j]).sum())
        });
        let largest = product.iter().flatten().fold(0.0, |m: f64, v| m.max(v.abs())).max(1e-300);
        power = product.map(|row| row.map(|v| v / largest));
    }
    let longest = power.into_iter().max_by(|a, b| norm(a).total_cmp(&norm(b)));
    DQuat::from_array(longest.unwrap_or([0.0, 0.0, 0.0, 1.0])).normalize()
}

fn norm(row: &[f64; 4]) -> f64 {
    row.iter().map(|v| v * v).sum()
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use nvsprior::geometry::{Distortion, Intrinsics, Lens};
    use nvsprior::random::Random;

    use super::*;
    use crate::points::Point;
    use crate::posed::PosedInput;

    /// A course in the world north, east, down, and the same as structure from motion would give it.
    struct Course {
        stated: Vec<Option<Stated>>,
        known: Vec<Pose>,
        found: PosedPictures,
        metres: f64,
    }

    const TILT: f64 = -0.6;
    const POINT: DVec3 = DVec3::new(1e6 + 1.0, 2.0, 9.0);

    fn course(place: impl Fn(f64) -> DVec3) -> Course {
        let mut random = Random::new(3);
        let (metres, away) = (0.37, DQuat::from_scaled_axis(DVec3::new(0.7, -1.1, 0.4)));
        let intrinsics =
            Intrinsics { width: 64, height: 36, fx: 60.0, fy: 60.0, cx: 32.0, cy: 18.0 };
        let lens = Lens::new(intrinsics, Distortion::None).unwrap();
        let mut made = Course {
            stated: Vec::new(),
            known: Vec::new(),
            found: PosedPictures { inputs: Vec::new(), points: None },
            metres,
        };
        for i in 0..24 {
            let t = f64::from(i) / 4.0;
            let [pitch, roll] = [0.1 * random.even(), 0.1 * random.even()];
            let stated = Stated {
                place: Some([place(t).x, place(t).y]),
                depth: Some(place(t).z),
                pitch_roll: Some([pitch, roll]),
                heading: Some(0.3 * t),
            };
            let seen = stated.seen(TILT).unwrap();
            let rotation = DQuat::from_mat3(&seen);
            let known = Pose { rotation, translation: -(rotation * place(t)) };
            // found = away · known / metres
            let rotation = known.rotation * away.conjugate();
            let centre = away * known.centre() / metres;
            let pose = Pose { rotation, translation: -(rotation * centre) };
            made.found.inputs.push(PosedInput {
                name: format!("{i}.png"),
                file: format!("{i}.png").into(),
                lens,
                pose,
                split: None,
                mask: None,
            });
            made.known.push(known);
            made.stated.push(Some(stated));
        }
        let position = away * POINT / metres;
        made.found.points = Some(vec![Point { position, rgb: None, error: None, track: None }]);
        made
    }

    fn wide(t: f64) -> DVec3 {
        DVec3::new(1e6 + 3.0 * t.cos(), 2.0 * t.sin(), 5.0 + 0.5 * (3.0 * t).sin())
    }

    fn aligned(course: &Course, stated: &[Option<Stated>]) -> (PosedPictures, Alignment) {
        let mut posed = course.found.clone();
        let alignment = align(&mut posed, stated, TILT, Path::new("nav.csv")).unwrap();
        (posed, alignment)
    }

    fn worst(course: &Course, posed: &PosedPictures, origin: DVec3) -> [f64; 2] {
        let pairs = posed.inputs.iter().zip(&course.known);
        pairs.fold([0.0; 2], |[place, turn], (input, known)| {
            let off = (input.pose.centre() + origin).distance(known.centre());
            let turned = input.pose.rotation.angle_between(known.rotation);
            [f64::max(place, off), f64::max(turn, turned)]
        })
    }

    #[test]
    fn places_give_unit_and_axes() {
        let course = course(wide);
        let only = |stated: &Option<Stated>| stated.map(|s| Stated { pitch_roll: None, ..s });
        let places: Vec<_> = course.stated.iter().map(only).collect();
        for stated in [&course.stated, &places] {
            let (posed, alignment) = aligned(&course, stated);
            assert!((alignment.metres.unwrap() - course.metres).abs() < 1e-6, "{alignment:?}");
            let [place, turn] = worst(&course, &posed, alignment.origin);
            assert!(place < 1e-6 && turn < 1e-6, "{place} m, {turn}");
            let point = posed.points.unwrap()[0].position + alignment.origin;
            assert!(point.distance(POINT) < 1e-6, "{point}");
            // Large numbers do not come into the prior.
            assert!(posed.inputs[0].pose.centre().length() < 10.0);
        }
    }

    #[test]
    fn a_few_wrong_places_do_not_count() {
        let course = course(wide);
        let mut stated = course.stated.clone();
        for i in [3, 11, 12] {
            stated[i].as_mut().unwrap().place = Some([1e6 + 40.0, -30.0]);
        }
        let (posed, alignment) = aligned(&course, &stated);
        let [place, turn] = worst(&course, &posed, alignment.origin);
        assert!(place < 0.05 && turn < 0.02, "{place} m, {turn}");
        assert!(alignment.off.unwrap() > 5.0, "{alignment:?}");
    }

    #[test]
    fn on_a_line_attitudes_say_which_way_is_up() {
        let course = course(|t| DVec3::new(2.0 * t, 0.1, 4.0));
        let (posed, alignment) = aligned(&course, &course.stated);
        let [place, turn] = worst(&course, &posed, alignment.origin);
        assert!(place < 1e-6 && turn < 1e-6, "{place} m, {turn}");
        let only = |stated: &Option<Stated>| stated.map(|s| Stated { pitch_roll: None, ..s });
        let places: Vec<_> = course.stated.iter().map(only).collect();
        let mut posed = course.found.clone();
        let error = align(&mut posed, &places, TILT, Path::new("nav.csv")).unwrap_err();
        assert!(matches!(error, NavigationError::Nothing { .. }), "{error}");
    }

    #[test]
    fn depth_and_attitude_give_unit_and_vertical() {
        let course = course(wide);
        let only = |stated: &Option<Stated>| stated.map(|s| Stated { place: None, ..s });
        let stated: Vec<_> = course.stated.iter().map(only).collect();
        let (posed, alignment) = aligned(&course, &stated);
        assert!((alignment.metres.unwrap() - course.metres).abs() < 1e-6, "{alignment:?}");
        for (input, known) in posed.inputs.iter().zip(&course.known) {
            let depth = input.pose.centre().z + alignment.origin.z;
            assert!((depth - known.centre().z).abs() < 1e-6, "{depth}");
        }
        // At one depth nothing says how large the scene is.
        let flat = |stated: &Option<Stated>| stated.map(|s| Stated { depth: Some(5.0), ..s });
        let flat: Vec<_> = stated.iter().map(flat).collect();
        let level = self::course(|t| DVec3::new(t, t * t, 5.0));
        let (_, alignment) = aligned(&level, &flat);
        assert_eq!((alignment.metres, alignment.upright), (None, true));
    }

    #[test]
    fn too_few_are_refused() {
        let course = course(wide);
        let mut stated = vec![None; course.stated.len()];
        stated[..2].copy_from_slice(&course.stated[..2]);
        let mut posed = course.found.clone();
        let error = align(&mut posed, &stated, TILT, Path::new("nav.csv")).unwrap_err();
        assert!(error.to_string().contains("of 2 of the pictures"), "{error}");
    }
}
