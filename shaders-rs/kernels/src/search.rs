//! The search for a frame's pose: Gauss–Newton with Levenberg–Marquardt damping (Marquardt 1963; the
//! damping's update after Nielsen 1999), from the pyramid's coarse levels to the full picture. Stage
//! `solve` calls [`advance`] once per evaluation, on one invocation. The host uses the layouts and the pose code.
//!
//! Poses are relative to the prior's own centre, so that f32 is enough even if the prior lies far
//! from its origin.

use crate::portable;
pub use crate::shared::LEVELS;
use crate::shared::{Params, SUMS, dot};

#[cfg(target_arch = "spirv")]
use spirv_std::num_traits::Float;

/// Most starts of one search.
pub const STARTS: usize = 8;
/// Evaluations that a search keeps a note of.
pub const TRACE: usize = 128;
/// Largest rotation of one step, radians: the series of [`stepped`] hold up to this.
const LARGEST_TURN: f32 = 1.0;
/// Least damping. It keeps the system solvable in f32 if the picture does not determine a direction.
const LEAST_DAMPING: f32 = 1e-5;
/// Least entry of the damping's diagonal, as a share of those of the other translations, or turns. It prevents random
/// steps along an axis that hardly changes the picture.
const LEAST_DIAGONAL: f32 = 1e-4;

/// [`Search::phase`]: evaluations go on.
pub const SEARCHING: u32 = 0;
/// [`Search::phase`]: the pose is found.
pub const FOUND: u32 = 1;

/// [`Search::stop`]: the number of evaluations is used up.
pub const STOP_RENDERS: u32 = 0;
/// [`Search::stop`]: the next step promises too little.
pub const STOP_PROGRESS: u32 = 1;
/// [`Search::stop`]: there is no direction to step along.
pub const STOP_NO_DESCENT: u32 = 2;

/// A world-to-camera motion of points that are given relative to the prior's centre.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(not(target_arch = "spirv"), derive(bytemuck::Pod, bytemuck::Zeroable))]
pub struct Placement {
    /// Unit quaternion, (w, x, y, z).
    pub rotation: [f32; 4],
    /// Translation, camera axes, the prior's unit.
    pub translation: [f32; 3],
}

/// What a search is to do; the host writes it with each frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(not(target_arch = "spirv"), derive(bytemuck::Pod, bytemuck::Zeroable))]
pub struct Program {
    /// Poses to start from.
    pub starts: [Placement; STARTS],
    /// Number of them.
    pub count: u32,
    /// Level at which each start is first evaluated.
    pub first_level: u32,
    /// Level down to which each start is followed by itself. From there only the best goes on.
    pub follow_level: u32,
    /// Levels to visit, one bit per level; level 0 is always visited.
    pub levels: u32,
    /// Levels of which an evaluation draws only some rows of tiles ([`Params::with_rows`]), one bit per level.
    pub sparse: u32,
    /// Most evaluations of one start at one level while starts are compared.
    pub follow_renders: u32,
    /// Most evaluations of a level above 0.
    pub coarse_renders: u32,
    /// Most evaluations of level 0.
    pub renders: u32,
    /// If the best start's first step promises to lower the error by more than this share, the
    /// start is far off: the search goes on at `far_level`.
    pub near: f32,
    /// See `near`.
    pub far_level: u32,
    /// If a coarse level's step is expected to lower the error by less than this share, it is taken without an
    /// evaluation and ends the level. The next level evaluates it.
    pub coarse_leap: f32,
    /// As `coarse_leap`, for level 0: the final picture shows the outcome.
    pub leap: f32,
    /// A coarse level is done if a step is expected to lower the error by less than this share.
    pub coarse_tolerance: f32,
    /// As `coarse_tolerance`, for level 0.
    pub tolerance: f32,
    /// First damping, relative to the diagonal of JᵀJ.
    pub damping: f32,
    /// How the pose is to be written: [`COMPACT`], [`PAPER`] or [`SHORT`].
    pub profile: u32,
}

/// A search in progress, and its outcome.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(not(target_arch = "spirv"), derive(bytemuck::Pod, bytemuck::Zeroable))]
pub struct Search {
    /// What to do.
    pub program: Program,
    /// [`SEARCHING`] or [`FOUND`].
    pub phase: u32,
    /// Why it ended.
    pub stop: u32,
    /// Level of the evaluation under way.
    pub level: u32,
    /// Start that is followed; `program.count` and more: the best of all.
    pub start: u32,
    /// 1: the evaluation under way is the first of its level.
    pub fresh: u32,
    /// Evaluations of this level, the one under way included.
    pub renders: u32,
    /// Largest number of pairs that an evaluation needed.
    pub pairs_needed: u32,
    /// Evaluations so far.
    pub evaluations: u32,
    /// How far evaluations were from the starts that led to them: the greatest distance of camera centres, and the
    /// greatest chord `2 sin(a/2)` of turns by angles `a`.
    pub strayed: [f32; 2],
    /// Evaluations so far, by level.
    pub by_level: [u32; LEVELS],
    /// Levenberg–Marquardt damping.
    pub damping: f32,
    /// Factor of the damping if the next step fails.
    pub growth: f32,
    /// Decrease of Σ r² that the step under way is expected to bring.
    pub expected: f32,
    /// Pose of the evaluation under way.
    pub trial: Placement,
    /// What that evaluation gave: see [`SUMS`].
    pub sums: [f32; SUMS as usize],
    /// Best pose of the level.
    pub place: Placement,
    /// Its sums.
    pub place_sums: [f32; SUMS as usize],
    /// Best pose of the starts followed so far, at `program.follow_level`.
    pub best: Placement,
    /// Its sums.
    pub best_sums: [f32; SUMS as usize],
    /// Which start led there.
    pub best_start: u32,
    /// The outcome, not quantised.
    pub found: Placement,
    /// The share by which its last step is expected to lower the error, if that step was taken without an evaluation;
    /// else 0.
    pub promised: f32,
    /// Σ r² of the last evaluations, in order.
    pub trace: [f32; TRACE],
    /// Their levels.
    pub trace_level: [u32; TRACE],
}

/// Index of Σ r² in the sums.
pub const SQUARE: usize = SUMS as usize - 1;

/// Index of a level's parameters among the prototypes, of which each level has two: all rows of tiles, and some.
/// `sparse`: see [`Program::sparse`].
pub fn prototype(level: u32, sparse: u32) -> usize {
    (2 * level + ((sparse >> (level & 31)) & 1)) as usize
}

/// Goes to the first evaluation.
pub fn begin(s: &mut Search) {
    s.phase = SEARCHING;
    s.start = 0;
    s.level = s.program.first_level;
    s.trial = s.program.starts[0];
    s.fresh = 1;
}

/// Takes `sums`, the result of the evaluation under way. Goes to the next evaluation, or to the end.
pub fn advance(s: &mut Search) {
    note(s);
    if s.fresh == 1 {
        s.place = s.trial;
        s.place_sums = s.sums;
        s.damping = s.program.damping;
        s.growth = 2.0;
        s.renders = 1;
        s.fresh = 0;
    } else {
        judge(s);
    }
    // After a level is done, the search may go on from the best start's place, which is already evaluated.
    let mut undecided = true;
    while undecided {
        undecided = if propose(s) { false } else { end_level(s) };
    }
}

/// Counts the evaluation. If its error is not a number, makes it infinite, so that nothing steps there.
fn note(s: &mut Search) {
    let mut finite = true;
    let mut k = 0;
    while k < SUMS as usize {
        finite &= s.sums[k].abs() < f32::MAX;
        k += 1;
    }
    if !finite {
        k = 0;
        while k < SQUARE {
            s.sums[k] = 0.0;
            k += 1;
        }
        s.sums[SQUARE] = f32::MAX;
    }
    stray(s);
    let at = s.evaluations as usize;
    if at < TRACE {
        s.trace[at] = s.sums[SQUARE];
        s.trace_level[at] = s.level;
    }
    s.evaluations += 1;
    s.by_level[s.level as usize] += 1;
}

/// Notes how far the evaluation was from its start.
fn stray(s: &mut Search) {
    let from = if following(s) { s.start } else { s.best_start };
    let apart = apart(&s.trial, &s.program.starts[from as usize % STARTS]);
    // What is not a number is far.
    let mut kind = 0;
    while kind < 2 {
        if !(apart[kind] <= s.strayed[kind]) {
            s.strayed[kind] = if apart[kind] < f32::MAX { apart[kind] } else { f32::MAX };
        }
        kind += 1;
    }
}

/// The distance of the centres of two cameras, and the chord of the turn between them.
pub fn apart(a: &Placement, b: &Placement) -> [f32; 2] {
    let of = |p: &Placement| transform_back(&rotation_matrix(&p.rotation), p.translation);
    let (c, d) = (of(a), of(b));
    let off = [c[0] - d[0], c[1] - d[1], c[2] - d[2]];
    let (p, q) = (&a.rotation, &b.rotation);
    let cosine = p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3];
    let square = crate::shared::max(1.0 - cosine * cosine, 0.0);
    [dot(off, off).sqrt(), 2.0 * square.sqrt()]
}

/// Accepts or rejects the step under way.
fn judge(s: &mut Search) {
    let ratio = (s.place_sums[SQUARE] - s.sums[SQUARE]) / s.expected;
    if ratio > 0.0 {
        s.place = s.trial;
        s.place_sums = s.sums;
        let fit = 2.0 * ratio - 1.0;
        let shrink = 1.0 - fit * fit * fit;
        s.damping *= if shrink > 1.0 / 3.0 { shrink } else { 1.0 / 3.0 };
        s.damping = crate::shared::max(s.damping, LEAST_DAMPING);
        s.growth = 2.0;
    } else {
        s.damping *= s.growth;
        s.growth *= 2.0;
    }
}

/// Whether starts are still compared.
fn following(s: &Search) -> bool {
    s.start < s.program.count
}

/// Sets the next trial of this level; `false` if the level is done.
fn propose(s: &mut Search) -> bool {
    let program = &s.program;
    let (mut most, mut tolerance, mut leap) = (program.renders, program.tolerance, program.leap);
    if s.level > 0 {
        most = program.coarse_renders;
        tolerance = program.coarse_tolerance;
        leap = program.coarse_leap;
    }
    if following(s) {
        most = program.follow_renders;
        leap = 0.0;
    }
    s.found = s.place;
    s.promised = 0.0;
    let step = damped_step(&s.place_sums, s.damping);
    let error = s.place_sums[SQUARE];
    if !step.downhill {
        s.stop = STOP_NO_DESCENT;
        return false;
    }
    if !(step.expected > tolerance * error) {
        s.stop = STOP_PROGRESS;
        return false;
    }
    let first = (s.level == program.first_level) & (s.by_level[s.level as usize] == program.count);
    if first
        & !following(s)
        & (s.level < program.far_level)
        & (step.expected > program.near * error)
    {
        s.level = program.far_level;
        s.trial = s.place;
        s.fresh = 1;
        return true;
    }
    let next = stepped(&s.place, &step.tau);
    if !(step.expected > leap * error) {
        s.stop = STOP_PROGRESS;
        s.found = next;
        s.promised = step.expected / error;
        return false;
    }
    if s.renders >= most {
        s.stop = STOP_RENDERS;
        return false;
    }
    s.expected = step.expected;
    s.trial = next;
    s.renders += 1;
    true
}

/// Goes to the next level, the next start, or the end; `true` if the search goes on from a place
/// that is already evaluated.
fn end_level(s: &mut Search) -> bool {
    s.fresh = 1;
    if following(s) {
        if s.level > s.program.follow_level {
            s.level = next_level(s);
            s.trial = s.place;
            return false;
        }
        if (s.start == 0) | (s.place_sums[SQUARE] < s.best_sums[SQUARE]) {
            s.best = s.place;
            s.best_sums = s.place_sums;
            s.best_start = s.start;
        }
        s.start += 1;
        if following(s) {
            s.level = s.program.first_level;
            s.trial = s.program.starts[s.start as usize % STARTS];
            return false;
        }
        s.place = s.best;
        s.place_sums = s.best_sums;
        s.damping = s.program.damping;
        s.growth = 2.0;
        s.renders = 1;
        s.fresh = 0;
        return true;
    }
    if s.level > 0 {
        s.level = next_level(s);
        s.trial = s.found;
        return false;
    }
    s.phase = FOUND;
    false
}

/// The next finer level to be visited.
fn next_level(s: &Search) -> u32 {
    let mut level = s.level;
    let mut looking = true;
    while looking & (level > 0) {
        level -= 1;
        looking = (s.program.levels >> level) & 1 == 0;
    }
    level
}

/// A step of Gauss–Newton.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// ρ, θ.
    pub tau: [f32; 6],
    /// Decrease of Σ r² that the quadratic model expects.
    pub expected: f32,
    /// Whether there is such a step.
    pub downhill: bool,
}

/// Place of row `i`, column `j` (`i <= j`) in the upper triangle, row by row.
pub fn upper(i: usize, j: usize) -> usize {
    i * 6 - i * (i + 1) / 2 + j
}

/// The step of `(JᵀJ + λ D) δ = −Jᵀr`. `D` is the diagonal of JᵀJ; entries that are small against the others of their
/// kind are raised (`LEAST_DIAGONAL`). The system is scaled by `D`, so it does not depend on the prior's unit of
/// length. Directions that the picture does not determine at all get no step. A turn beyond `LARGEST_TURN`, or a
/// translation that shifts the picture as much, shortens the step.
pub fn damped_step(sums: &[f32; SUMS as usize], damping: f32) -> Step {
    let scale = scales(sums);
    let mut right = [0.0; 6];
    let mut i = 0;
    while i < 6 {
        right[i] = -sums[21 + i] * scale[i];
        i += 1;
    }
    let mut out = Step { tau: [0.0; 6], expected: 0.0, downhill: false };
    let mut l = [[0.0; 6]; 6];
    if !factorise(sums, &scale, damping, &mut l) {
        return out;
    }
    let x = substitute(&l, &right);
    // Products of the step: with the right side, and with itself.
    let (mut along, mut own) = (0.0, 0.0);
    i = 0;
    let mut finite = true;
    while i < 6 {
        along += x[i] * right[i];
        own += x[i] * x[i];
        out.tau[i] = x[i] * scale[i];
        finite &= out.tau[i].abs() < f32::MAX;
        i += 1;
    }
    let share = within_reach(sums, &out.tau);
    i = 0;
    while i < 6 {
        out.tau[i] *= share;
        i += 1;
    }
    // 2 δᵀ(−Jᵀr) − δᵀ JᵀJ δ, with JᵀJ δ from the system, so that all terms are positive.
    out.expected = share * ((2.0 - share) * along + share * damping * own);
    out.downhill = finite & (out.expected > 0.0) & (out.expected < f32::MAX);
    out
}

/// One over the roots of `D`; 0 for a kind of motion that the picture does not show.
fn scales(sums: &[f32; SUMS as usize]) -> [f32; 6] {
    let mut scale = [0.0; 6];
    let mut kind = 0;
    while kind < 6 {
        let (a, b, c) = (diagonal(sums, kind), diagonal(sums, kind + 1), diagonal(sums, kind + 2));
        let least = LEAST_DIAGONAL * crate::shared::max(crate::shared::max(a, b), c);
        let mut i = kind;
        while i < kind + 3 {
            let d = crate::shared::max(diagonal(sums, i), least);
            if d > 0.0 {
                scale[i] = 1.0 / d.sqrt();
            }
            i += 1;
        }
        kind += 3;
    }
    scale
}

/// Entry `i` of the diagonal of JᵀJ.
fn diagonal(sums: &[f32; SUMS as usize], i: usize) -> f32 {
    sums[upper(i, i)]
}

/// Cholesky's factor of the scaled and damped system; `false` if there is none.
fn factorise(
    sums: &[f32; SUMS as usize],
    scale: &[f32; 6],
    damping: f32,
    l: &mut [[f32; 6]; 6],
) -> bool {
    let mut definite = true;
    let mut i = 0;
    while i < 6 {
        let mut j = 0;
        while j <= i {
            let mut sum = sums[upper(j, i)] * scale[i] * scale[j];
            if i == j {
                sum += damping;
                if scale[i] == 0.0 {
                    sum += 1.0;
                }
            }
            let mut k = 0;
            while k < j {
                sum -= l[i][k] * l[j][k];
                k += 1;
            }
            if i == j {
                definite &= sum > 0.0;
                l[i][i] = sum.sqrt();
            } else {
                l[i][j] = sum / l[j][j];
            }
            j += 1;
        }
        i += 1;
    }
    definite
}

/// The share of a step that turns by at most `LARGEST_TURN`, and moves by at most as many depths `L` of the scene;
/// `tr Hθθ = L² tr Hρρ`. Both limits shift the picture by the same amount.
fn within_reach(sums: &[f32; SUMS as usize], tau: &[f32; 6]) -> f32 {
    let moved = dot([tau[0], tau[1], tau[2]], [tau[0], tau[1], tau[2]]).sqrt();
    let turned = dot([tau[3], tau[4], tau[5]], [tau[3], tau[4], tau[5]]).sqrt();
    let of_moves = diagonal(sums, 0) + diagonal(sums, 1) + diagonal(sums, 2);
    let of_turns = diagonal(sums, 3) + diagonal(sums, 4) + diagonal(sums, 5);
    let mut share = 1.0;
    if turned > LARGEST_TURN {
        share = LARGEST_TURN / turned;
    }
    let reach = LARGEST_TURN * (of_turns / of_moves).sqrt();
    if moved * share > reach {
        share = reach / moved;
    }
    share
}

/// Solves `L Lᵀ x = b`.
fn substitute(l: &[[f32; 6]; 6], b: &[f32; 6]) -> [f32; 6] {
    let mut x = *b;
    let mut i = 0;
    while i < 6 {
        let mut k = 0;
        while k < i {
            x[i] -= l[i][k] * x[k];
            k += 1;
        }
        x[i] /= l[i][i];
        i += 1;
    }
    let mut left = 6;
    while left > 0 {
        i = left - 1;
        let mut k = left;
        while k < 6 {
            x[i] -= l[k][i] * x[k];
            k += 1;
        }
        x[i] /= l[i][i];
        left = i;
    }
    x
}

/// `Exp(τ)` applied after a placement (Barfoot, State Estimation for Robotics, eq. 8.30–8.33). A turn beyond
/// `LARGEST_TURN` shortens the whole step to it.
pub fn stepped(from: &Placement, tau: &[f32; 6]) -> Placement {
    let mut rho = [tau[0], tau[1], tau[2]];
    let mut theta = [tau[3], tau[4], tau[5]];
    let angle = dot(theta, theta).sqrt();
    if angle > LARGEST_TURN {
        let s = LARGEST_TURN / angle;
        rho = [rho[0] * s, rho[1] * s, rho[2] * s];
        theta = [theta[0] * s, theta[1] * s, theta[2] * s];
    }
    let x = dot(theta, theta);
    // (1 − cos a)/a² and (a − sin a)/a³ of a² = x; sin(a/2)/a and cos(a/2).
    let b = 0.5 - x * (1.0 / 24.0 - x * (1.0 / 720.0 - x * (1.0 / 40_320.0)));
    let c = 1.0 / 6.0 - x * (1.0 / 120.0 - x * (1.0 / 5040.0 - x * (1.0 / 362_880.0)));
    let y = 0.25 * x;
    let sine = 0.5 - y * (1.0 / 12.0 - y * (1.0 / 240.0 - y * (1.0 / 10_080.0)));
    let cosine = 1.0 - y * (0.5 - y * (1.0 / 24.0 - y * (1.0 / 720.0)));
    let turn = [cosine, sine * theta[0], sine * theta[1], sine * theta[2]];
    let once = crate::shared::cross(theta, rho);
    let twice = crate::shared::cross(theta, once);
    let moved = crate::shared::transform(&rotation_matrix(&turn), from.translation);
    Placement {
        rotation: normalised(&product(&turn, &from.rotation)),
        translation: [
            moved[0] + rho[0] + b * once[0] + c * twice[0],
            moved[1] + rho[1] + b * once[1] + c * twice[1],
            moved[2] + rho[2] + b * once[2] + c * twice[2],
        ],
    }
}

/// Hamilton's product of (w, x, y, z).
fn product(a: &[f32; 4], b: &[f32; 4]) -> [f32; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

fn normalised(q: &[f32; 4]) -> [f32; 4] {
    let s = portable::inverse_sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    [q[0] * s, q[1] * s, q[2] * s, q[3] * s]
}

/// The matrix of a unit quaternion, row-major.
pub fn rotation_matrix(q: &[f32; 4]) -> [f32; 9] {
    let (w, x, y, z) = (q[0], q[1], q[2], q[3]);
    [
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    ]
}

/// A matrix's transpose times a vector.
fn transform_back(m: &[f32; 9], v: [f32; 3]) -> [f32; 3] {
    [
        m[0] * v[0] + m[3] * v[1] + m[6] * v[2],
        m[1] * v[0] + m[4] * v[1] + m[7] * v[2],
        m[2] * v[0] + m[5] * v[1] + m[8] * v[2],
    ]
}

/// Sets the camera's pose in the parameters of a render.
pub fn set_pose(params: &mut Params, at: &Placement) {
    let rotation = rotation_matrix(&at.rotation);
    let centre = transform_back(&rotation, at.translation);
    params.rotation = rotation;
    params.translation = at.translation;
    params.centre = [-centre[0], -centre[1], -centre[2]];
}

/// [`PoseCode::profile`]: sixteen bytes, relative to the prior.
pub const COMPACT: u32 = 1;
/// [`PoseCode::profile`]: seven f32.
pub const PAPER: u32 = 2;
/// [`Program::profile`]: the compact code on a coarser grid, near the prior. Its words are those of [`COMPACT`].
pub const SHORT: u32 = 3;
/// Steps of a compact centre per step of the short grid.
pub const SHORT_CENTRE_STEPS: i32 = 1 << 5;
/// Largest coordinate of a centre on the short grid, in its own steps: 16 bits.
pub const SHORT_CENTRE_MAX: i32 = (1 << 15) - 1;
/// Steps of a small compact component per step of the short grid.
pub const SHORT_SMALL_STEPS: i32 = 1 << 3;
/// Largest small component on the short grid, in its own steps: 15 bits.
pub const SHORT_SMALL_MAX: i32 = (1 << 14) - 1;
/// Offset of a small quaternion component's code, which stands for zero.
pub const SMALL_ZERO: i32 = 1 << 17;
/// Code steps per unit of a small component.
const SMALL_STEPS: f32 = 131_071.0 * core::f32::consts::SQRT_2;
/// Largest code of a centre's coordinate.
const CENTRE_MAX: f32 = 8_388_607.0;

/// A pose as a packet holds it, in words.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(not(target_arch = "spirv"), derive(bytemuck::Pod, bytemuck::Zeroable))]
pub struct PoseCode {
    /// [`COMPACT`] or [`PAPER`].
    pub profile: u32,
    /// Compact: the camera's centre in steps, the largest component's index, the other three, in
    /// order. Paper: the bits of translation and (w, x, y, z).
    pub words: [i32; 7],
}

/// Where the prior lies: what codes are relative to.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(not(target_arch = "spirv"), derive(bytemuck::Pod, bytemuck::Zeroable))]
pub struct Anchor {
    /// The prior's centre in the world.
    pub centre: [f32; 3],
    /// Step of the compact centre, the prior's unit.
    pub step: f32,
}

fn round(v: f32) -> i32 {
    (v + 0.5).floor() as i32
}

/// Whether three magnitudes are below a limit; none that is not a number is.
fn all_below(v: &[f32; 3], limit: f32) -> bool {
    (v[0].abs() < limit) & (v[1].abs() < limit) & (v[2].abs() < limit)
}

/// Rounds to a multiple of a power of two, at most `most` times it.
fn round_to(v: f32, multiple: i32, most: i32) -> i32 {
    let code = round(v / multiple as f32);
    (if code > most { most } else { code }) * multiple
}

/// The code of a placement: compact, unless the paper's code is wanted or the camera is out of reach. It lies on the
/// short grid if that is wanted and within reach.
pub fn quantised(at: &Placement, anchor: &Anchor, profile: u32) -> PoseCode {
    let rotation = rotation_matrix(&at.rotation);
    let c = transform_back(&rotation, at.translation);
    let steps = [-c[0] / anchor.step, -c[1] / anchor.step, -c[2] / anchor.step];
    let q = &at.rotation;
    if (profile != PAPER) & all_below(&steps, CENTRE_MAX) {
        let reach = (SHORT_CENTRE_MAX * SHORT_CENTRE_STEPS) as f32;
        let short = (profile == SHORT) & all_below(&steps, reach);
        let centre_steps = if short { SHORT_CENTRE_STEPS } else { 1 };
        let small_steps = if short { SHORT_SMALL_STEPS } else { 1 };
        let small_most = if short { SHORT_SMALL_MAX } else { SMALL_ZERO - 1 };
        let centre_most = CENTRE_MAX as i32;
        let mut largest = 0;
        let mut i = 1;
        while i < 4 {
            if q[i].abs() > q[largest].abs() {
                largest = i;
            }
            i += 1;
        }
        let scale = if q[largest] < 0.0 { -SMALL_STEPS } else { SMALL_STEPS };
        let mut words = [0, 0, 0, largest as i32, 0, 0, 0];
        i = 0;
        while i < 3 {
            words[i] = round_to(steps[i], centre_steps, centre_most);
            i += 1;
        }
        let mut to = 4;
        i = 0;
        while i < 4 {
            if i != largest {
                words[to] = round_to(q[i] * scale, small_steps, small_most);
                to += 1;
            }
            i += 1;
        }
        return PoseCode { profile: COMPACT, words };
    }
    let moved = crate::shared::transform(&rotation, anchor.centre);
    let bits = |v: f32| v.to_bits() as i32;
    PoseCode {
        profile: PAPER,
        words: [
            bits(at.translation[0] - moved[0]),
            bits(at.translation[1] - moved[1]),
            bits(at.translation[2] - moved[2]),
            bits(q[0]),
            bits(q[1]),
            bits(q[2]),
            bits(q[3]),
        ],
    }
}

/// The placement of a code. On a device only stage `project` calls this, for the encoder and the decoder: so both
/// render at the same bits.
pub fn placed(code: &PoseCode, anchor: &Anchor) -> Placement {
    let w = &code.words;
    if code.profile == COMPACT {
        const STEP: f32 = 1.0 / SMALL_STEPS;
        let small = [w[4] as f32 * STEP, w[5] as f32 * STEP, w[6] as f32 * STEP];
        let rest = 1.0 - dot(small, small);
        let largest = portable::sqrt(rest);
        let [a, b, c] = small;
        let q = if w[3] == 0 {
            [largest, a, b, c]
        } else if w[3] == 1 {
            [a, largest, b, c]
        } else if w[3] == 2 {
            [a, b, largest, c]
        } else {
            [a, b, c, largest]
        };
        let rotation = normalised(&q);
        let centre =
            [w[0] as f32 * anchor.step, w[1] as f32 * anchor.step, w[2] as f32 * anchor.step];
        let t = crate::shared::transform(&rotation_matrix(&rotation), centre);
        return Placement { rotation, translation: [-t[0], -t[1], -t[2]] };
    }
    let float = |word: i32| f32::from_bits(word as u32);
    let rotation = normalised(&[float(w[3]), float(w[4]), float(w[5]), float(w[6])]);
    let moved = crate::shared::transform(&rotation_matrix(&rotation), anchor.centre);
    Placement {
        rotation,
        translation: [float(w[0]) + moved[0], float(w[1]) + moved[1], float(w[2]) + moved[2]],
    }
}
