//! Camera files as lists of posed pictures with their lenses.

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::{CameraFileError, Entry, PINHOLE_MODELS, entries, parse_root, read_text};
use crate::colmap::unit_pose;
use crate::posed::PosedInput;
use nvsprior::geometry::{Distortion, Intrinsics, Lens};

/// What a camera file says of pictures that have poses.
pub(crate) struct PosedFile {
    pub inputs: Vec<PosedInput>,
    /// Its file of points, if it names one.
    pub points: Option<PathBuf>,
}

const FISHEYE_MODEL: &str = "OPENCV_FISHEYE";

impl PosedFile {
    /// Reads a camera file of either kind, told by its content.
    pub fn open(path: &Path) -> Result<PosedFile, CameraFileError> {
        PosedFile::parse(&read_text(path)?, path)
    }

    /// Reads a camera file's content. `path` is for messages, and its folder is where pictures are looked for.
    pub fn parse(text: &str, path: &Path) -> Result<PosedFile, CameraFileError> {
        let root = parse_root(text, path)?;
        let mut last = None;
        let inputs = entries(&root, path, |entry| entry.posed(&mut last))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let points = root["ply_file_path"].as_str().map(|name| folder.join(name));
        Ok(PosedFile { inputs, points })
    }
}

impl Entry<'_> {
    /// Its order and itself. `last` is the lens of the entry before: most have the same one.
    fn posed(&self, last: &mut Option<Lens>) -> Result<(f64, PosedInput), String> {
        let lens = self.lens(*last)?;
        *last = Some(lens);
        let known = if self.opencv { "qvec" } else { "transform_matrix" };
        if self.value.get(known).is_none() {
            return Err(format!("\"{known}\" is missing; only pictures with a pose can be used"));
        }
        if !self.opencv {
            let name = self.text("file_path")?.to_owned();
            let (pose, file) = (self.opengl_pose()?, self.picture(&name));
            let mask = self.value["mask_path"].as_str().map(|name| self.folder.join(name));
            let input = PosedInput { name, file, lens, pose, split: None, mask };
            return Ok((self.rank as f64, input));
        }
        let name = self.text("file")?.to_owned();
        let pose = unit_pose(self.numbers("qvec")?, self.numbers("tvec")?);
        let pose = pose.ok_or("\"qvec\" is of another length than 1, or \"tvec\" not finite")?;
        let split = self.value["split"].as_str().map(str::to_owned);
        let order = self.value["index"].as_f64().unwrap_or(self.order as f64);
        let file = self.picture(&name);
        Ok((order, PosedInput { name, file, lens, pose, split, mask: None }))
    }

    fn lens(&self, last: Option<Lens>) -> Result<Lens, String> {
        let names = match self.opencv {
            true => ["width", "height", "fx", "fy"],
            false => ["w", "h", "fl_x", "fl_y"],
        };
        let intrinsics = Intrinsics {
            width: self.side(names[0])?,
            height: self.side(names[1])?,
            fx: self.number(names[2])?,
            fy: self.number(names[3])?,
            cx: self.number("cx")?,
            cy: self.number("cy")?,
        };
        let distortion = self.distortion()?;
        let same =
            |lens: &Lens| *lens.intrinsics() == intrinsics && *lens.distortion() == distortion;
        match last.filter(same) {
            Some(lens) => Ok(lens),
            None => Lens::new(intrinsics, distortion).map_err(|e| e.to_string()),
        }
    }

    /// By nerfstudio's keys, which `cameras.json` does not have: k1, k2, p1, p2, k3 of a lens of
    /// Brown and Conrady, or k1 to k4 of a fisheye. Others are refused: nerfstudio's k4 of r⁸ has no
    /// place in OpenCV's formula, and it knows no k5 and k6.
    fn distortion(&self) -> Result<Distortion, String> {
        let [k1, k2, k3, k4] = [
            self.coefficient("k1")?,
            self.coefficient("k2")?,
            self.coefficient("k3")?,
            self.coefficient("k4")?,
        ];
        let [p1, p2] = [self.coefficient("p1")?, self.coefficient("p2")?];
        let model = self.value.get("camera_model").or_else(|| self.root.get("camera_model"));
        let fisheye = model.is_some_and(|model| model == FISHEYE_MODEL);
        if let Some(model) = model.filter(|m| !fisheye && !PINHOLE_MODELS.iter().any(|p| *m == p)) {
            return Err(format!(
                "camera model {model} is not read, but {} and {FISHEYE_MODEL} are; undistort the \
                 pictures first",
                PINHOLE_MODELS.join(", ")
            ));
        }
        let others: &[&str] = if fisheye { &["p1", "p2", "k5", "k6"] } else { &["k4", "k5", "k6"] };
        for key in others {
            if self.coefficient(key)? != 0.0 {
                return Err(format!(
                    "distortion \"{key}\" is not zero; a lens of its camera model \
                    has none; undistort the pictures first"
                ));
            }
        }
        let brown = [k1, k2, p1, p2, k3, 0.0, 0.0, 0.0];
        Ok(match fisheye {
            true => Distortion::Fisheye([k1, k2, k3, k4]),
            false if brown == [0.0; 8] => Distortion::None,
            false => Distortion::Brown(brown),
        })
    }

    /// A distortion coefficient; 0 if it is missing.
    fn coefficient(&self, key: &str) -> Result<f64, String> {
        let value = self.value.get(key).or_else(|| self.root.get(key));
        if value.is_none_or(Value::is_null) { Ok(0.0) } else { self.number(key) }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::CameraFile;
    use super::*;

    fn parse(value: &Value) -> Result<PosedFile, String> {
        let path = Path::new("dive/transforms.json");
        PosedFile::parse(&value.to_string(), path).map_err(|e| e.to_string())
    }

    fn nerfstudio() -> Value {
        json!({
            "w": 1280, "h": 720, "fl_x": 1000.0, "fl_y": 1001.0, "cx": 640.25, "cy": 360.0,
            "k1": 0.125, "k2": -0.0625, "k3": 0.25, "p1": 0.001, "p2": -0.002,
            "camera_model": "OPENCV", "ply_file_path": "sparse_pc.ply",
            "frames": [
                {"file_path": "images/f.png", "mask_path": "masks/f.png", "transform_matrix":
                    [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]},
                {"file_path": "images/g.png", "k1": 0.25, "transform_matrix":
                    [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]},
            ]
        })
    }

    #[test]
    fn distortion_becomes_a_lens_and_is_refused_without_one() {
        let file = parse(&nerfstudio()).unwrap();
        assert_eq!(file.points.as_deref(), Some(Path::new("dive/sparse_pc.ply")));
        let input = &file.inputs[0];
        assert_eq!(input.file, Path::new("dive/images/f.png"));
        assert_eq!(input.mask.as_deref(), Some(Path::new("dive/masks/f.png")));
        assert_eq!((input.lens.intrinsics().fy, input.lens.intrinsics().cx), (1001.0, 640.25));
        let mut brown = [0.125, -0.0625, 0.001, -0.002, 0.25, 0.0, 0.0, 0.0];
        assert_eq!(input.lens.distortion(), &Distortion::Brown(brown));
        brown[0] = 0.25;
        assert_eq!(file.inputs[1].lens.distortion(), &Distortion::Brown(brown));
        assert!((input.pose.centre() - glam::DVec3::new(1.0, 2.0, 3.0)).length() < 1e-12);
        let text = nerfstudio().to_string();
        let error = CameraFile::parse(&text, Path::new("t.json")).unwrap_err().to_string();
        assert!(error.contains("\"k1\" is not zero"), "{error}");
    }

    #[test]
    fn fisheyes_have_four_coefficients() {
        let mut value = nerfstudio();
        value["camera_model"] = "OPENCV_FISHEYE".into();
        assert!(parse(&value).err().unwrap().contains("\"p1\" is not zero"));
        (value["p1"], value["p2"], value["k4"]) = (0.into(), Value::Null, 0.5.into());
        let found = *parse(&value).unwrap().inputs[0].lens.distortion();
        assert_eq!(found, Distortion::Fisheye([0.125, -0.0625, 0.25, 0.5]));
        value["camera_model"] = "OPENCV".into();
        assert!(parse(&value).err().unwrap().contains("\"k4\" is not zero"));
        value["camera_model"] = "EQUIRECTANGULAR".into();
        assert!(parse(&value).err().unwrap().contains("EQUIRECTANGULAR"));
        value["camera_model"] = "OPENCV".into();
        value["k4"] = "much".into();
        assert!(parse(&value).err().unwrap().contains("\"k4\" is missing or no finite number"));
    }

    #[test]
    fn poses_are_due_and_of_length_one() {
        let opencv = |image: Value| {
            parse(&json!({
                "width": 320, "height": 180, "fx": 270.0, "fy": 271.0, "cx": 160.0, "cy": 90.0,
                "images": [image]
            }))
        };
        let image = json!({"file": "a.png", "split": "test", "qvec": [0, 1, 0, 0],
            "tvec": [1, 2, 3]});
        let input = opencv(image.clone()).unwrap().inputs.remove(0);
        assert_eq!(
            (input.split.as_deref(), input.pose.wxyz()),
            (Some("test"), [0.0, 1.0, 0.0, 0.0])
        );
        assert_eq!(input.lens.distortion(), &Distortion::None);
        for (key, value) in [
            ("qvec", json!([2, 0, 0, 0])),
            ("qvec", json!([1, 0, 0])),
            ("tvec", json!([1, 2, null])),
        ] {
            let mut image = image.clone();
            image[key] = value;
            assert!(opencv(image).err().unwrap().contains(key));
        }
        let error = opencv(json!({"file": "a.png"})).err().unwrap();
        assert!(error.contains("view 0 a.png: \"qvec\" is missing"), "{error}");
    }
}
