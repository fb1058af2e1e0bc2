//! Binary glTF files, `.glb`, with splats as Khronos's extension `KHR_gaussian_splatting` has them.
//!
//! A primitive of points has an accessor for positions, rotations (x, y, z, w), scales, opacities and each coefficient
//! of the spherical harmonics. Scales and opacities stand there as they are, not as logarithms and logits. Node
//! transforms are applied, so the prior's world is that of the file's scene: right-handed, y up. Nothing else is
//! turned.
//!
//! Read are: all primitives with the extension in the scene that the file shows; the kernel `ellipse`, the projection
//! `perspective`, the colours `srgb_rec709_display`; any component type that glTF allows; data in the file itself.
//! Refused are other kernels, projections and colours, compression (SPZ within glTF is not settled), sparse accessors,
//! files beside the file, and nodes that scale their axes differently. The sorting method is ignored: splats are always
//! sorted by depth. Render options are [`RenderOptions::INRIA`], anti-aliased if the extension says so. Scales of which
//! one is below 0 are read as logarithms, opacities of which one is not from 0 to 1 as logits, as files of the draft
//! have them, with a warning. Attributes and members of the extension that are not known are left out, with a warning.

mod accessor;
mod container;
mod document;
mod placement;

use accessor::Accessors;
use container::{Container, refusal};
use document::{Document, Primitive, SPLATS};
use placement::Placement;

use crate::spz::logit;
use nvsprior::prior::{PriorError, PriorFile, PriorFormat, PriorWarning, Splats};
use nvsprior::{Prior, RenderOptions};

pub use container::MAGIC;
#[cfg(test)]
pub use document::{ATTRIBUTES, FIELDS};

const FORMAT: PriorFormat = PriorFormat::Foreign("glTF, binary", None);

/// Reads a binary glTF file. Memory grows with the number of splats that its scene shows.
pub fn read(bytes: &[u8]) -> Result<PriorFile, PriorError> {
    let container = Container::read(bytes)?;
    let document = Document::read(container.json)?;
    let placements = placement::of_splats(&document)?;
    let (Some(sh_degree), Some(count)) = (
        placements.iter().map(|p| p.primitive.sh_degree()).max(),
        placements
            .iter()
            .try_fold(0, |sum: usize, p| sum.checked_add(p.primitive.count(&document)?)),
    ) else {
        return Err(PriorError::Empty);
    };
    if count > Prior::MAX_SPLATS {
        return Err(PriorError::TooMany { count });
    }
    let accessors =
        Accessors { document: &document, data: container.data, start: container.data_start };
    // Sizes are checked against the file before memory is taken for them.
    let columns = placements.iter().map(|p| Columns::find(&accessors, p.primitive));
    let columns = columns.collect::<Result<Vec<_>, _>>()?;
    let mut splats = Splats::with_capacity(count, sh_degree);
    let coded = Coded::of(&columns);
    let mut exact = Vec::with_capacity(count);
    for (placement, columns) in placements.iter().zip(columns) {
        columns.append(placement, coded, &mut splats, &mut exact);
    }
    let comments = document.asset.generator.iter().map(|by| format!("generator {by}")).collect();
    let mut warnings = coded.warnings();
    for placement in &placements {
        warnings.extend(placement.primitive.warnings());
    }
    let antialiased = placements.iter().any(|p| p.primitive.is_antialiased());
    let options = RenderOptions { antialiased, ..RenderOptions::INRIA };
    let file = PriorFile::new(splats, options, FORMAT);
    let exact_positions = Some(exact);
    Ok(PriorFile { exact_positions, comments, warnings, near_by_size: true, ..file })
}

/// Whether numbers stand as a file of the draft has them, and not as the extension says.
#[derive(Clone, Copy)]
struct Coded {
    /// Scales are logarithms: one of them is below 0.
    logarithms: bool,
    /// Opacities are logits: one of them is beyond 0 and 1.
    logits: bool,
}

impl Coded {
    fn of(columns: &[Columns]) -> Coded {
        let scales = |c: &Columns| {
            (0..c.scales.count).any(|i| c.scales.get::<3>(i).iter().any(|s| *s < 0.0))
        };
        let opacities = |c: &Columns| {
            (0..c.opacities.count).any(|i| !(0.0..=1.0).contains(&c.opacities.get::<1>(i)[0]))
        };
        Coded { logarithms: columns.iter().any(scales), logits: columns.iter().any(opacities) }
    }

    fn warnings(self) -> Vec<PriorWarning> {
        let read_as = |what, taken_for| PriorWarning::ReadAs { what, taken_for };
        let scales =
            self.logarithms.then(|| read_as("glTF scales, some of them below 0,", "logarithms"));
        let opacities =
            self.logits.then(|| read_as("glTF opacities, some of them not from 0 to 1,", "logits"));
        scales.into_iter().chain(opacities).collect()
    }
}

/// The numbers of a primitive's splats.
struct Columns<'a> {
    positions: accessor::Column<'a>,
    rotations: accessor::Column<'a>,
    scales: accessor::Column<'a>,
    opacities: accessor::Column<'a>,
    /// One for each coefficient.
    sh: Vec<accessor::Column<'a>>,
}

impl<'a> Columns<'a> {
    fn find(accessors: &Accessors<'a>, primitive: &Primitive) -> Result<Columns<'a>, PriorError> {
        let find = |name: &str, width| accessors.column(primitive, name, width);
        let splats = |name: &str, width| find(&format!("{SPLATS}:{name}"), width);
        let degrees = 0..=primitive.sh_degree();
        let coefficients = degrees.flat_map(|degree| (0..2 * degree + 1).map(move |n| (degree, n)));
        let coefficient = |(degree, n)| splats(&format!("SH_DEGREE_{degree}_COEF_{n}"), 3);
        let columns = Columns {
            positions: find("POSITION", 3)?,
            rotations: splats("ROTATION", 4)?,
            scales: splats("SCALE", 3)?,
            opacities: splats("OPACITY", 1)?,
            sh: coefficients.map(coefficient).collect::<Result<_, _>>()?,
        };
        let due = columns.positions.count;
        let others = [&columns.rotations, &columns.scales, &columns.opacities];
        let others = others.into_iter().chain(&columns.sh);
        let differs = others.map(|column| column.count).find(|count| *count != due);
        match differs {
            Some(count) => {
                Err(refusal(format!("POSITION has {due} splats, another attribute {count}")))
            }
            None => Ok(columns),
        }
    }

    /// Appends the splats, moved by the transform of their node.
    fn append(
        &self,
        placement: &Placement,
        coded: Coded,
        splats: &mut Splats,
        exact: &mut Vec<[f64; 3]>,
    ) {
        let stride = splats.sh_stride();
        for index in 0..self.positions.count {
            let position = placement.position(self.positions.get(index));
            splats.positions.push(position.map(|v| v as f32));
            exact.push(position);
            splats.rotations.push(placement.rotation(self.rotations.get(index)));
            let scales: [f64; 3] = self.scales.get(index);
            let scales = if coded.logarithms { scales.map(libm::exp) } else { scales };
            splats.log_scales.push(placement.log_scales(scales));
            let [opacity] = self.opacities.get(index);
            splats.opacity_logits.push(if coded.logits { opacity as f32 } else { logit(opacity) });
            let mut sh = [[0.0; 3]; 16];
            for (coefficient, column) in sh.iter_mut().zip(&self.sh) {
                *coefficient = column.get(index);
            }
            splats.sh.extend_from_slice(&placement.sh(sh).as_flattened()[..stride]);
        }
    }
}

#[cfg(test)]
mod tests;
