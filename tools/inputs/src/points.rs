//! Point clouds in PLY files.
//!
//! Element `vertex`, which must be the first: `x y z`, and if there are colours `red green blue`, as
//! `uchar` of 0 to 255 or as floats of 0 to 1. Text, or binary of either byte order, properties in
//! any order; other properties and the elements that follow are passed over.

use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};

use glam::DVec3;
use nvsprior::prior::PlyRow;
use serde::de::{DeserializeSeed, Deserializer, SeqAccess, Visitor};
use serde_ply::{ElementDef, PlyFormat, PlyHeader, PlyReader, PropertyType, ScalarType};

/// A point of a scene, in the frame and unit of its camera poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Where it lies; finite.
    pub position: DVec3,
    /// Its colour, if known: values in [0, 1], as in pictures (not linear light).
    pub rgb: Option<[f32; 3]>,
    /// Mean reprojection error, pixels, if known.
    pub error: Option<f64>,
    /// In how many pictures it was found, if known.
    pub track: Option<u32>,
}

/// Why a file of points cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum PointsError {
    #[error("{}: {error}", path.display())]
    Read { path: PathBuf, error: std::io::Error },
    #[error("{}: no PLY header: {reason}", path.display())]
    Header { path: PathBuf, reason: String },
    #[error("{}: its first element must be \"vertex\"", path.display())]
    NoVertices { path: PathBuf },
    #[error("{}: property \"{property}\" {what}", path.display())]
    Property { path: PathBuf, property: &'static str, what: &'static str },
    #[error("{}: {count} points are promised, for which {found} bytes are too few; is the file cut \
        off?", path.display())]
    Cut { path: PathBuf, count: usize, found: usize },
    #[error("{}: point {point}, by byte {offset}: {reason}", path.display())]
    Point { path: PathBuf, point: usize, offset: u64, reason: String },
}

/// Properties that are read, in this order.
const PROPERTIES: [&str; 6] = ["x", "y", "z", "red", "green", "blue"];

/// Reads a point cloud. All points have a colour, or none has.
pub fn read_points(path: &Path) -> Result<Vec<Point>, PointsError> {
    let read = |error| PointsError::Read { path: path.to_path_buf(), error };
    parse_points(&std::fs::read(path).map_err(read)?, path)
}

/// Reads a point cloud's content; `path` is for messages. Memory grows with the content's size,
/// whatever the header says.
pub fn parse_points(bytes: &[u8], path: &Path) -> Result<Vec<Point>, PointsError> {
    let mut cursor = Cursor::new(bytes);
    let failed = |reason: &dyn ToString| PointsError::Header {
        path: path.to_path_buf(),
        reason: reason.to_string(),
    };
    let header = PlyReader::from_reader(&mut cursor).map_err(|e| failed(&e.0))?.header().clone();
    let body = bytes.len().saturating_sub(cursor.position() as usize);
    let layout = Layout::of(&header, body, path)?;
    cursor.set_position(0);
    // The reader wants white space after every number of a text, also after the last one.
    let tail: &[u8] = if header.format == PlyFormat::Ascii { b"\n" } else { b"" };
    let mut reader = PlyReader::from_reader((&mut cursor).chain(tail)).map_err(|e| failed(&e.0))?;
    let mut points = Vec::with_capacity(layout.count);
    let read = serde::de::MapAccess::next_value_seed(
        &mut &mut reader,
        Rows { layout: &layout, points: &mut points },
    );
    drop(reader);
    read.map_err(|e| PointsError::Point {
        path: path.to_path_buf(),
        point: points.len(),
        offset: cursor.position(),
        reason: e.0.to_string(),
    })?;
    Ok(points)
}

/// What a header says of the points.
struct Layout {
    count: usize,
    /// Those of [`PROPERTIES`] that there are.
    properties: &'static [&'static str],
    /// What a colour value is divided by.
    white: f64,
}

impl Layout {
    /// Checks the header, and that a body of so many bytes can hold the points.
    fn of(header: &PlyHeader, body: usize, path: &Path) -> Result<Layout, PointsError> {
        let own = || path.to_path_buf();
        let vertex = header.elem_defs.first().filter(|element| element.name == "vertex");
        let vertex = vertex.ok_or_else(|| PointsError::NoVertices { path: own() })?;
        let colours = vertex.has_property("red");
        let properties = if colours { &PROPERTIES[..] } else { &PROPERTIES[..3] };
        let bytes = vertex.get_property("red").is_some_and(|p| is_byte(&p.property_type));
        for property in properties {
            let wrong = |what| PointsError::Property { path: own(), property, what };
            let scalar = scalar(vertex, property).map_err(wrong)?;
            let float = matches!(scalar, ScalarType::F32 | ScalarType::F64);
            let fits = if bytes { scalar == ScalarType::U8 } else { float };
            if property.len() > 1 && !fits {
                return Err(wrong("must be uchar or float, as \"red\" is"));
            }
        }
        let white = if bytes { 255.0 } else { 1.0 };
        // At least a byte for each property; in a text its last needs no white space after it.
        let min = (vertex.count as u128) * vertex.properties.len() as u128;
        if min > body as u128 {
            return Err(PointsError::Cut { path: own(), count: vertex.count, found: body });
        }
        Ok(Layout { count: vertex.count, properties, white })
    }

    /// The point that has these values of [`PROPERTIES`].
    fn point(&self, values: &[f64; 6]) -> Result<Point, String> {
        let [x, y, z, rgb @ ..] = *values;
        let position = DVec3::new(x, y, z);
        if !position.is_finite() {
            return Err(format!("its position {position} is not finite"));
        }
        let rgb = rgb.map(|value| value / self.white);
        if let Some(value) = rgb.iter().find(|value| !(0.0..=1.0).contains(*value)) {
            return Err(format!("colour {value}: as a float it must lie in [0, 1]"));
        }
        let rgb = (self.properties.len() == 6).then_some(rgb.map(|value| value as f32));
        Ok(Point { position, rgb, error: None, track: None })
    }
}

fn is_byte(property: &PropertyType) -> bool {
    matches!(property, PropertyType::Scalar(ScalarType::U8))
}

/// The type of a property that must be there once, and be no list.
fn scalar(vertex: &ElementDef, name: &str) -> Result<ScalarType, &'static str> {
    let mut named = vertex.properties.iter().filter(|p| p.name == name);
    match (named.next().map(|p| &p.property_type), named.next()) {
        (None, _) => Err("is missing"),
        (Some(PropertyType::Scalar(scalar)), None) => Ok(*scalar),
        (Some(PropertyType::List { .. }), _) => Err("is a list"),
        (_, Some(_)) => Err("stands there twice"),
    }
}

/// Reads all rows of the element.
struct Rows<'a> {
    layout: &'a Layout,
    points: &'a mut Vec<Point>,
}

impl<'de> DeserializeSeed<'de> for Rows<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for Rows<'_> {
    type Value = ();

    fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str("points")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut rows: A) -> Result<(), A::Error> {
        while let Some(values) = rows.next_element_seed(PlyRow::new(self.layout.properties))? {
            self.points.push(self.layout.point(&values).map_err(serde::de::Error::custom)?);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn parse(bytes: &[u8]) -> Result<Vec<Point>, PointsError> {
        parse_points(bytes, Path::new("cloud.ply"))
    }

    fn header(format: &str, properties: &str) -> String {
        let properties: String = properties.split(';').map(|p| format!("property {p}\n")).collect();
        format!(
            "ply\nformat {format} 1.0\ncomment c\nelement vertex 2\n{properties}element face 1\n\
             property list uchar int vertex_indices\nend_header\n"
        )
    }

    const XYZ_RGB: &str = "float x;float y;float z;uchar red;uchar green;uchar blue";

    /// Points (1, 2, 3) and (−1, 0.5, 8), of colours (0, 51, 255) and (255, 0, 102).
    fn binary(big_endian: bool) -> Vec<u8> {
        let format = if big_endian { "binary_big_endian" } else { "binary_little_endian" };
        let mut bytes = header(format, XYZ_RGB).into_bytes();
        for (position, rgb) in
            [([1.0f32, 2.0, 3.0], [0, 51, 255]), ([-1.0, 0.5, 8.0], [255, 0, 102])]
        {
            let one = |v: f32| if big_endian { v.to_be_bytes() } else { v.to_le_bytes() };
            bytes.extend(position.into_iter().flat_map(one));
            bytes.extend::<[u8; 3]>(rgb);
        }
        bytes.extend([1, 0, 0, 0, 0]);
        bytes
    }

    fn expected() -> Vec<Point> {
        let point = |x, y, z, rgb| Point {
            position: DVec3::new(x, y, z),
            rgb: Some(rgb),
            error: None,
            track: None,
        };
        vec![point(1.0, 2.0, 3.0, [0.0, 0.2, 1.0]), point(-1.0, 0.5, 8.0, [1.0, 0.0, 0.4])]
    }

    #[test]
    fn all_forms_say_the_same() {
        assert_eq!(parse(&binary(false)).unwrap(), expected());
        assert_eq!(parse(&binary(true)).unwrap(), expected());
        let text = header("ascii", XYZ_RGB) + "1 2 3 0 51 255\n-1 .5 8 255 0 102\n1 0\n";
        assert_eq!(parse(text.as_bytes()).unwrap(), expected());
        let other = "float blue;float nx;double z;float green;double x;list uchar int a;float red;\
                     double y";
        let text = header("ascii", other) + "1 9 3 .2 1 1 7 0 2\n.4 9 8 0 -1 2 7 7 1 .5";
        assert_eq!(parse(text.as_bytes()).unwrap(), expected());
    }

    #[test]
    fn colours_may_be_missing() {
        let text = header("ascii", "float x;float y;float z") + "1 2 3\n-1 .5 8";
        let found = parse(text.as_bytes()).unwrap();
        assert_eq!((found[1].position, found[1].rgb), (expected()[1].position, None));
    }

    #[test]
    fn errors_name_what_is_wrong() {
        let rows = "1 2 3 0 51 255\n-1 .5 8 255 0 102\n";
        for (properties, rows, named) in [
            (XYZ_RGB, "1 2 3 0 51 255\n-1 .5 8 256 0 102\n", "point 1, by byte"),
            (XYZ_RGB, "nan 2 3 0 51 255\n-1 .5 8 255 0 102\n", "point 0, by byte"),
            (XYZ_RGB, "1 2 3 0", "cut off"),
            ("float x;float y;float q;uchar red;uchar green;uchar blue", rows, "\"z\" is missing"),
            ("float x;float y;float z;uchar red;uchar green;float x", rows, "\"x\" stands"),
            ("float x;float y;float z;uchar red;uchar green;uchar b", rows, "\"blue\" is missing"),
            ("float x;float y;float z;float red;float green;float blue", rows, "colour 51"),
            ("float x;float y;float z;uchar red;float green;uchar blue", rows, "\"green\" must be"),
            ("float x;float y;float z;float red;float green;uchar blue", rows, "\"blue\" must be"),
            ("float x;float y;float z;short red;short green;short blue", rows, "\"red\" must be"),
            ("float x;float y;list uchar int z", rows, "\"z\" is a list"),
        ] {
            let text = header("ascii", properties) + rows;
            let error = parse(text.as_bytes()).unwrap_err().to_string();
            assert!(error.starts_with("cloud.ply: ") && error.contains(named), "{error}");
        }
        assert!(matches!(parse(b"solid"), Err(PointsError::Header { .. })));
        let text = "ply\nformat ascii 1.0\nelement face 0\nend_header\n";
        assert!(matches!(parse(text.as_bytes()), Err(PointsError::NoVertices { .. })));
        assert!(
            read_points(Path::new("no/such.ply")).unwrap_err().to_string().contains("such.ply")
        );
    }

    proptest! {
        #[test]
        fn cut_and_flipped_files_give_an_error_or_points(
            big_endian: bool, cut in 0usize..400, at in 0usize..400, value: u8,
        ) {
            let whole = binary(big_endian);
            let kept = &whole[..cut.min(whole.len())];
            // The last 5 bytes are the face's.
            prop_assert_eq!(parse(kept).is_ok(), kept.len() >= whole.len() - 5);
            let mut flipped = whole.clone();
            let at = at % whole.len();
            flipped[at] = value;
            if let Ok(points) = parse(&flipped) {
                prop_assert!(points.iter().all(|point| point.position.is_finite()));
            }
        }
    }
}
