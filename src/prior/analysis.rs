//! Prior analysis: what a prior needs of the renderer, whatever the camera. The rest can be left out when the prior is
//! loaded, and no picture changes by a bit.

use std::fmt;

use super::{Prior, RenderOptions, Splats};
use crate::shared::{self, ALPHA_MIN, GEOMETRY_PLANES};

/// What pictures of a prior need.
#[derive(Clone, Debug)]
pub struct PriorAnalysis {
    /// Splats that some picture may show, by index, in order; at least one. Empty for a blocked prior, which has none
    /// but such.
    pub splats: Vec<u32>,
    /// Degree of the spherical harmonics beyond which all coefficients are zero.
    pub sh_degree: u32,
    /// Whether a splat's alpha may exceed the clamp.
    pub clamps_alpha: bool,
    /// Whether a splat's colour may fall below zero, so that it must be clamped.
    pub clamps_colour: bool,
    /// Whether the background has a colour.
    pub background: bool,
    /// Whether opacity is compensated for the low-pass.
    pub antialiased: bool,
    /// Most bits of a depth key, for cameras anywhere.
    pub key_bits: u32,
    findings: Vec<Finding>,
}

/// Something that is left out, or is not needed.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// What it is.
    pub name: &'static str,
    /// How far pictures change.
    pub kind: Kind,
    /// How many there are of it.
    pub count: usize,
    /// Bytes of device memory that it would take.
    pub bytes: u64,
    /// Why it is not needed.
    pub reason: String,
}

/// How far pictures change by what is left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// Not at all.
    Exact,
    /// No channel of a pixel changes by more than this, values in [0, 1].
    Bounded(f64),
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Kind::Exact => f.write_str("exact"),
            Kind::Bounded(change) => write!(f, "within {:.2}/255", 255.0 * change),
        }
    }
}

impl PriorAnalysis {
    /// Studies a prior.
    pub fn of(prior: &Prior) -> PriorAnalysis {
        let (splats, options) = (prior.splats(), prior.options());
        let opacities: Vec<f32> = (0..splats.len()).map(|i| splats.opacity(i) as f32).collect();
        let visible = |i: &u32| opacities[*i as usize] >= ALPHA_MIN;
        let mut shown: Vec<u32> = (0..splats.len() as u32).filter(visible).collect();
        if shown.is_empty() {
            // A renderer has one splat at least; this one shows nothing.
            shown.push(0);
        }
        let sh_degree = splats.needed_sh_degree();
        // Rounding may raise an alpha a little above its splat's opacity.
        let clamped = options.alpha_max * (1.0 - 1e-5);
        let mut analysis = PriorAnalysis {
            clamps_alpha: shown.iter().any(|i| opacities[*i as usize] > clamped),
            clamps_colour: shown.iter().any(|i| may_be_negative(splats, *i as usize)),
            background: options.background != [0.0; 3],
            antialiased: options.antialiased,
            key_bits: key_bits(options.near, f32::MAX),
            splats: shown,
            sh_degree,
            findings: Vec::new(),
        };
        analysis.findings = analysis.find(splats);
        analysis
    }

    /// Everything, as if no splat had been looked at; for comparisons.
    pub fn everything(prior: &Prior) -> PriorAnalysis {
        PriorAnalysis {
            splats: (0..prior.len() as u32).collect(),
            sh_degree: prior.splats().sh_degree,
            clamps_alpha: true,
            clamps_colour: true,
            background: true,
            antialiased: prior.options().antialiased,
            key_bits: u32::BITS,
            findings: Vec::new(),
        }
    }

    /// What pictures of a blocked prior need, by its head.
    pub fn of_head(options: &RenderOptions, sh_degree: u32, clamps_alpha: bool) -> PriorAnalysis {
        PriorAnalysis {
            splats: Vec::new(),
            sh_degree,
            clamps_alpha,
            clamps_colour: true,
            background: options.background != [0.0; 3],
            antialiased: options.antialiased,
            key_bits: key_bits(options.near, f32::MAX),
            findings: Vec::new(),
        }
    }

    /// What is left out at load, and what could be.
    pub fn findings(&self) -> &[Finding] {
        &self.findings
    }

    fn find(&self, splats: &Splats) -> Vec<Finding> {
        let mut findings = Vec::new();
        let gone = splats.len() - self.splats.len();
        if gone > 0 {
            findings.push(Finding {
                name: "splats never seen",
                kind: Kind::Exact,
                count: gone,
                bytes: gone as u64 * splat_bytes(splats.sh_degree),
                reason: "opacity below 1/255, so no pixel blends them".into(),
            });
        }
        let all = self.splats.len() as u64;
        if self.sh_degree < splats.sh_degree {
            findings.push(Finding {
                name: "bands of zeros",
                kind: Kind::Exact,
                count: (splats.sh_degree - self.sh_degree) as usize,
                bytes: all * (splat_bytes(splats.sh_degree) - splat_bytes(self.sh_degree)),
                reason: "every coefficient of these bands is 0".into(),
            });
        }
        findings.extend(self.faint_bands(splats));
        findings
    }

    /// The highest bands that together change every colour by less than half an 8-bit step.
    fn faint_bands(&self, splats: &Splats) -> Option<Finding> {
        let changes = |degree: u32| -> f64 {
            let bands = degree + 1..=self.sh_degree;
            let of = |i: &u32| bands.clone().map(|l| amplitude(splats, *i as usize, l)).sum();
            self.splats.iter().map(of).fold(0.0, f64::max)
        };
        let (degree, change) = (0..self.sh_degree)
            .map(|degree| (degree, changes(degree)))
            .find(|(_, change)| *change <= 0.5 / 255.0)?;
        let saved = splat_bytes(self.sh_degree) - splat_bytes(degree);
        Some(Finding {
            name: "faint bands",
            kind: Kind::Bounded(change),
            count: (self.sh_degree - degree) as usize,
            bytes: self.splats.len() as u64 * saved,
            reason: "they change no colour by half an 8-bit step".into(),
        })
    }
}

/// Bits of the largest depth key of splats no farther than `depth` from the camera.
pub fn key_bits(near: f32, depth: f32) -> u32 {
    let largest = depth.to_bits().saturating_sub(near.to_bits());
    u32::BITS - largest.leading_zeros()
}

/// Device memory of a splat, bytes.
pub fn splat_bytes(sh_degree: u32) -> u64 {
    8 * u64::from(GEOMETRY_PLANES + shared::sh_planes(sh_degree))
}

/// The most that a band changes any channel of a splat's colour, in any direction. A sum over the band's harmonics is
/// at most `√((2l+1)/4π) ‖c‖` (the addition theorem).
fn amplitude(splats: &Splats, i: usize, band: u32) -> f64 {
    let own = &splats.sh[i * splats.sh_stride()..][..splats.sh_stride()];
    let l = band as usize;
    let coefficients = &own[3 * l * l..3 * (l + 1) * (l + 1)];
    let norm = |channel: usize| -> f64 {
        let squares = coefficients.iter().skip(channel).step_by(3).map(|v| f64::from(*v).powi(2));
        squares.sum::<f64>().sqrt()
    };
    let greatest = (0..3).map(norm).fold(0.0, f64::max);
    greatest * ((2 * l + 1) as f64 / (4.0 * std::f64::consts::PI)).sqrt()
}

/// Whether a channel of a splat's colour may be negative in some direction. In doubt it may.
fn may_be_negative(splats: &Splats, i: usize) -> bool {
    let own = &splats.sh[i * splats.sh_stride()..][..3];
    let min = own.iter().copied().fold(f32::INFINITY, f32::min);
    let constant = 0.5 + f64::from(shared::sh_basis([0.0; 3])[0]) * f64::from(min);
    let change: f64 = (1..=splats.sh_degree).map(|l| amplitude(splats, i, l)).sum();
    !(constant - change > 1e-4 * (1.0 + change))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prior::tests::sample_splats;
    use crate::{Prior, RenderOptions};

    fn needs(change: impl Fn(&mut Splats, &mut RenderOptions)) -> PriorAnalysis {
        let (mut splats, mut options) = (sample_splats(6, 3), RenderOptions::INRIA);
        splats.opacity_logits = vec![0.0; 6];
        splats.sh.iter_mut().for_each(|v| *v = 0.01 * v.sin());
        change(&mut splats, &mut options);
        PriorAnalysis::of(&Prior::from_splats(splats, options).unwrap())
    }

    #[test]
    fn a_prior_that_needs_all_has_no_findings() {
        let all = needs(|_, _| ());
        assert_eq!((all.splats.len(), all.sh_degree), (6, 3));
        assert_eq!(all.findings(), []);
        assert!(!all.clamps_alpha && !all.clamps_colour && !all.background && !all.antialiased);
    }

    #[test]
    fn splats_that_are_never_seen_are_left_out_in_order() {
        // Logits just below and above that of 1/255.
        let limit = -(254.0_f32.ln());
        let some = needs(|s, _| {
            s.opacity_logits = vec![0.0, -9.0, limit - 1e-3, limit + 1e-3, -20.0, 1.0]
        });
        assert_eq!(some.splats, [0, 3, 5]);
        let [finding] = some.findings() else { panic!("{:?}", some.findings()) };
        assert_eq!((finding.kind, finding.count), (Kind::Exact, 3));
        assert_eq!(finding.bytes, 3 * 8 * (7 + 24));
        assert_eq!(needs(|s, _| s.opacity_logits = vec![-9.0; 6]).splats, [0]);
    }

    #[test]
    fn bands_of_zeros_and_faint_ones_are_told_apart() {
        let zero_from = |s: &mut Splats, k: usize, v: f32| {
            s.sh.chunks_exact_mut(48).for_each(|own| own[3 * k..].fill(v));
        };
        assert_eq!(needs(|s, _| zero_from(s, 1, 0.0)).sh_degree, 0);
        let second = needs(|s, _| zero_from(s, 9, 0.0));
        assert_eq!((second.sh_degree, second.findings()[0].count), (2, 1));
        let one_left = needs(|s, _| {
            zero_from(s, 1, 0.0);
            s.sh[48 * 4 + 3 * 4] = -1e-3;
        });
        assert_eq!(one_left.sh_degree, 2);
        let faint = needs(|s, _| zero_from(s, 4, 1e-5));
        assert_eq!(faint.sh_degree, 3);
        let [finding] = faint.findings() else { panic!("{:?}", faint.findings()) };
        let Kind::Bounded(change) = finding.kind else { panic!("{finding:?}") };
        assert!(finding.count == 2 && change > 1e-5 && change < 1e-4, "{finding:?}");
    }

    /// The bound of a band holds in every direction, and some direction comes near it.
    #[test]
    fn amplitudes_bound_the_colour() {
        let splats = sample_splats(6, 3);
        for (i, band) in [(0, 1), (3, 2), (5, 3)] {
            let bound = amplitude(&splats, i, band);
            let own = &splats.sh[48 * i..][..48];
            let mut max = 0.0_f32;
            for step in 0..2000 {
                let z = 1.0 - (step as f32 + 0.5) / 1000.0;
                let (s, c) = (step as f32 * 2.399_963).sin_cos();
                let r = (1.0 - z * z).sqrt();
                let basis = shared::sh_basis([r * c, r * s, z]);
                for channel in 0..3 {
                    let terms = (band * band) as usize..((band + 1) * (band + 1)) as usize;
                    let value: f32 = terms.map(|k| basis[k] * own[3 * k + channel]).sum();
                    max = max.max(value.abs());
                }
            }
            assert!(f64::from(max) <= bound * 1.000_01, "band {band}: {max} beyond {bound}");
            assert!(f64::from(max) > 0.4 * bound, "band {band}: {max} far below {bound}");
        }
    }

    #[test]
    fn guards_that_no_splat_trips() {
        let opaque = needs(|s, _| s.opacity_logits[2] = 6.0);
        assert!(opaque.clamps_alpha);
        assert!(!needs(|s, o| (s.opacity_logits[2], o.alpha_max) = (6.0, 0.999)).clamps_alpha);
        assert!(needs(|s, _| s.sh[48 * 3] = -1.8).clamps_colour);
        assert!(needs(|_, o| o.background = [0.0, 0.5, 0.0]).background);
        assert_eq!(key_bits(0.2, 0.2), 0);
        assert_eq!(key_bits(0.5, 1.0), 24);
        assert_eq!(needs(|_, _| ()).key_bits, 31);
    }
}
