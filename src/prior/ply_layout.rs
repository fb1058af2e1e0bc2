//! Which properties of a PLY file make its splats.

use serde_ply::{ElementDef, PlyHeader, PropertyType, ScalarType};

use super::fault::MAX_LOG_SCALE;
use super::field::{Field, FieldUse, passed_over};
use super::limits::MAX_SPLATS;
use super::ply_header::rest_properties;
use super::warning::PriorWarning;
use super::{PriorError, Splats};

use FieldUse::{Harmless, Read};

/// What is done with the properties of the element `vertex`.
pub const FIELDS: [Field; 15] = [
    ("x", Read),
    ("y", Read),
    ("z", Read),
    ("f_dc_*", Read),
    ("f_rest_*", Read),
    ("opacity", Read),
    ("scale_*", Read),
    ("rot_*", Read),
    ("filter_3D", Read),
    ("red", Read),
    ("green", Read),
    ("blue", Read),
    ("nx", Harmless),
    ("ny", Harmless),
    ("nz", Harmless),
];

/// Most properties of a splat that are read.
pub const MOST: usize = 60;

/// The constant spherical harmonic.
const SH_C0: f64 = 0.282_094_791_773_878_14;

/// Where the splats lie in a file, and which properties they have.
pub struct Layout {
    /// Index of the element `vertex`.
    pub element: usize,
    pub count: usize,
    /// Degree of the spherical harmonics.
    pub sh_degree: u32,
    /// Two scales, as scenes of 2D Gaussian Splatting have them: the third is zero.
    is_flat: bool,
    /// `red green blue` in place of `f_dc_0..2`, and by how much they are more than 0 to 1.
    rgb: Option<f64>,
    /// `filter_3D`, of Mip-Splatting: each splat's smoothing, to be merged into scales and opacity.
    is_filtered: bool,
    /// Positions are 64-bit numbers.
    pub is_double: bool,
    pub warnings: Vec<PriorWarning>,
}

impl Layout {
    pub fn of(header: &PlyHeader) -> Result<Layout, PriorError> {
        let element = header
            .elem_defs
            .iter()
            .position(|e| e.name == "vertex")
            .ok_or(PriorError::NoVertices)?;
        let vertex = &header.elem_defs[element];
        if vertex.count == 0 {
            return Err(PriorError::Empty);
        }
        if vertex.count > MAX_SPLATS {
            return Err(PriorError::TooMany { count: vertex.count });
        }
        let has = |name: &str| vertex.properties.iter().any(|p| p.name == name);
        if !["opacity", "scale_0", "rot_0"].into_iter().any(has) {
            return Err(PriorError::PointCloud);
        }
        let found = vertex.properties.iter().filter(|p| p.name.starts_with("f_rest_")).count();
        let sh_degree = (0..=Splats::MAX_SH_DEGREE)
            .find(|degree| rest_properties(*degree) == found)
            .ok_or(PriorError::ShProperties { found })?;
        let others = header.elem_defs.iter().map(|e| e.name.as_str()).filter(|e| *e != "vertex");
        let names = vertex.properties.iter().map(|p| p.name.as_str());
        let mut warnings = passed_over("PLY element", others, &[]);
        warnings.extend(passed_over("PLY property", names, &FIELDS));
        let layout = Layout {
            element,
            count: vertex.count,
            sh_degree,
            is_flat: has("scale_1") && !has("scale_2"),
            rgb: (!has("f_dc_0") && has("red")).then(|| largest(vertex, "red")),
            is_filtered: has("filter_3D"),
            is_double: is_of(vertex, "x", ScalarType::F64),
            warnings,
        };
        layout.properties().iter().try_for_each(|name| check_property(vertex, name))?;
        Ok(layout)
    }

    /// The properties that are read, in the order in which [`Layout::push`] takes their values.
    pub fn properties(&self) -> &'static [&'static str] {
        let kind = self.sh_degree as usize * 8
            + usize::from(self.is_flat) * 4
            + usize::from(self.rgb.is_some()) * 2
            + usize::from(self.is_filtered);
        let (list, count) = &LISTS[kind];
        &list[..*count]
    }

    /// Appends a splat given by the values of [`Layout::properties`].
    pub fn push(&self, splats: &mut Splats, values: &[f64; MOST]) {
        let values = values.map(|v| v as f32);
        let scales = if self.is_flat { 2 } else { 3 };
        let (place, values) = values.split_at(3);
        let (scale, values) = values.split_at(scales);
        let mut log_scales = [-MAX_LOG_SCALE; 3];
        log_scales[..scales].copy_from_slice(scale);
        let (rotation, values) = values.split_at(4);
        let (mut opacity, colour) = (values[0], &values[1..4]);
        let rest = &values[4..4 + rest_properties(self.sh_degree)];
        if self.is_filtered {
            (log_scales, opacity) = smoothed(log_scales, opacity, values[4 + rest.len()]);
        }
        splats.positions.push([place[0], place[1], place[2]]);
        splats.log_scales.push(log_scales);
        splats.rotations.push([rotation[0], rotation[1], rotation[2], rotation[3]]);
        splats.opacity_logits.push(opacity);
        splats.sh.extend(colour.iter().map(|value| match self.rgb {
            Some(largest) => ((f64::from(*value) / largest - 0.5) / SH_C0) as f32,
            None => *value,
        }));
        let per_channel = rest.len() / 3;
        for coefficient in 0..per_channel {
            splats.sh.extend([0, 1, 2].map(|c| rest[c * per_channel + coefficient]));
        }
    }
}

/// The properties of each kind of file, and how many they are. The reader of rows wants names that live for ever.
static LISTS: [([&str; MOST], usize); 32] = {
    let mut lists = [([""; MOST], 0); 32];
    let mut kind = 0;
    while kind < lists.len() {
        lists[kind] = list(kind);
        kind += 1;
    }
    lists
};

/// `kind`: the degree times 8, 4 if splats are flat, 2 with `red green blue`, 1 with a filter.
const fn list(kind: usize) -> ([&'static str; MOST], usize) {
    const PLACE: [&str; 6] = ["x", "y", "z", "scale_0", "scale_1", "scale_2"];
    const TURN: [&str; 5] = ["rot_0", "rot_1", "rot_2", "rot_3", "opacity"];
    let colour =
        if kind & 2 != 0 { ["red", "green", "blue"] } else { ["f_dc_0", "f_dc_1", "f_dc_2"] };
    let list = append(([""; MOST], 0), &PLACE, if kind & 4 != 0 { 5 } else { 6 });
    let list = append(append(list, &TURN, 5), &colour, 3);
    let list = append(list, &REST, rest_properties(kind as u32 / 8));
    append(list, &["filter_3D"], kind & 1)
}

const fn append(
    (mut list, mut at): ([&'static str; MOST], usize),
    names: &[&'static str],
    count: usize,
) -> ([&'static str; MOST], usize) {
    let end = at + count;
    let start = at;
    while at < end {
        list[at] = names[at - start];
        at += 1;
    }
    (list, at)
}

/// The value of full colour: 255 if it stands in a byte, else 1.
fn largest(vertex: &ElementDef, name: &str) -> f64 {
    if is_of(vertex, name, ScalarType::U8) { 255.0 } else { 1.0 }
}

fn is_of(vertex: &ElementDef, name: &str, scalar: ScalarType) -> bool {
    let is = |kind: &PropertyType| matches!(kind, PropertyType::Scalar(own) if *own == scalar);
    vertex.properties.iter().any(|p| p.name == name && is(&p.property_type))
}

/// Logarithmic scales and opacity of a splat smoothed by a Gaussian of standard deviation `filter`: Mip-Splatting (Yu
/// et al., CVPR 2024), equation 9.
fn smoothed(log_scales: [f32; 3], logit: f32, filter: f32) -> ([f32; 3], f32) {
    let added = f64::from(filter) * f64::from(filter);
    let variances = log_scales.map(|s| libm::exp(2.0 * f64::from(s)));
    let kept: f64 = variances.iter().map(|v| v / (v + added)).product();
    let opacity = libm::sqrt(kept) / (1.0 + libm::exp(-f64::from(logit)));
    let scales = variances.map(|v| (0.5 * libm::log(v + added)) as f32);
    (scales, libm::log(opacity / (1.0 - opacity)) as f32)
}

fn check_property(vertex: &ElementDef, name: &str) -> Result<(), PriorError> {
    let mut named = vertex.properties.iter().filter(|p| p.name == name);
    match (named.next(), named.next()) {
        (None, _) => Err(PriorError::MissingProperty { property: name.to_owned() }),
        (Some(property), None) if matches!(property.property_type, PropertyType::Scalar(_)) => {
            Ok(())
        }
        _ => Err(PriorError::BadProperty { property: name.to_owned() }),
    }
}

/// Spherical harmonics above degree 0, as files name them.
#[rustfmt::skip]
pub const REST: [&str; 45] = [
    "f_rest_0", "f_rest_1", "f_rest_2", "f_rest_3", "f_rest_4", "f_rest_5", "f_rest_6", "f_rest_7",
    "f_rest_8", "f_rest_9", "f_rest_10", "f_rest_11", "f_rest_12", "f_rest_13", "f_rest_14",
    "f_rest_15", "f_rest_16", "f_rest_17", "f_rest_18", "f_rest_19", "f_rest_20", "f_rest_21",
    "f_rest_22", "f_rest_23", "f_rest_24", "f_rest_25", "f_rest_26", "f_rest_27", "f_rest_28",
    "f_rest_29", "f_rest_30", "f_rest_31", "f_rest_32", "f_rest_33", "f_rest_34", "f_rest_35",
    "f_rest_36", "f_rest_37", "f_rest_38", "f_rest_39", "f_rest_40", "f_rest_41", "f_rest_42",
    "f_rest_43", "f_rest_44",
];
