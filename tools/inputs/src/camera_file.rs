//! Camera files: `cameras.json` and nerfstudio's `transforms.json`.
//!
//! `cameras.json` holds `width`, `height`, `fx`, `fy`, `cx`, `cy` and `images`, each with `file`, `index` (time order),
//! `split`, `qvec` (w, x, y, z), `tvec` of the OpenCV world-to-camera pose, its own intrinsics if they differ, and
//! `time`, seconds, if it is known. `transforms.json` holds OpenGL camera-to-world matrices (nerfstudio's data
//! conventions); they are turned into OpenCV poses. They are not moved or scaled: a prior exported after nerfstudio's
//! own scaling and centring lies in another frame.
//!
//! Frames of `transforms.json` are put in the order of their names, numbers in them by value: nerfstudio writes them in
//! COLMAP's order. Inria's `cameras.json`, a list with `img_name`, `position` and `rotation`, is read, too.
//!
//! [`CameraFile`] is for pinhole pictures, and refuses distortion; [`crate::posed`] reads it.

mod inria;
mod numbers;
mod posed;

use std::path::{Path, PathBuf};

use glam::{DMat3, DMat4};
use nvsprior::geometry::rotation_of;
use nvsprior::{Camera, Pose};
use serde_json::Value;

use crate::frame_file::ENDINGS;
use numbers::{RIGID, floats};
pub(crate) use posed::PosedFile;

/// One posed picture.
#[derive(Clone, Debug)]
pub struct View {
    pub file: PathBuf,
    /// Its name as the camera file has it.
    pub name: String,
    /// Which part of the pictures it belongs to: `train`, `test`.
    pub split: Option<String>,
    pub camera: Camera,
    /// World to camera, if the file has it.
    pub pose: Option<Pose>,
    /// When it was taken, seconds on the file's clock.
    pub time: Option<f64>,
}

/// All views of a camera file, in time order.
#[derive(Debug)]
pub struct CameraFile {
    path: PathBuf,
    pub views: Vec<View>,
}

/// Why a camera file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CameraFileError {
    #[error("{}: {error}", path.display())]
    Read { path: PathBuf, error: std::io::Error },
    #[error("{}: not text; a camera file is JSON: cameras.json or transforms.json", path.display())]
    Text { path: PathBuf },
    #[error("{}: not JSON: {error}", path.display())]
    Json { path: PathBuf, error: serde_json::Error },
    #[error("{}: this is {what}, which is not read; export the cameras for COLMAP, as text or binary, and give that \
        folder to `map --cameras`", path.display())]
    Foreign { path: PathBuf, what: &'static str },
    #[error("{}: neither \"images\" (cameras.json) nor \"frames\" (transforms.json) in it",
        path.display())]
    Format { path: PathBuf },
    #[error("{}: {view}: {what}", path.display())]
    View { path: PathBuf, view: String, what: String },
    #[error("{}: no view of split \"{split}\"; there are: {known}", path.display())]
    Split { path: PathBuf, split: String, known: String },
    #[error("{}: no view named \"{name}\"", path.display())]
    Name { path: PathBuf, name: String },
}

/// Distortion coefficients that nerfstudio may write; the renderer is a pinhole.
const DISTORTION: [&str; 8] = ["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"];

/// Nerfstudio's and COLMAP's names of cameras that are pinholes if their distortion is zero.
const PINHOLE_MODELS: [&str; 5] =
    ["OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"];

impl CameraFile {
    /// Reads a camera file of either kind. The content tells the kind.
    pub fn open(path: &Path) -> Result<CameraFile, CameraFileError> {
        let text = read_text(path)?;
        CameraFile::parse(&text, path)
    }

    /// Reads a camera file's content; `path` is its place.
    pub fn parse(text: &str, path: &Path) -> Result<CameraFile, CameraFileError> {
        let root = parse_root(text, path)?;
        let views = entries(&root, path, |entry| {
            if entry.opencv { entry.opencv_view() } else { entry.nerfstudio_view() }
        })?;
        Ok(CameraFile { path: path.to_path_buf(), views })
    }

    /// The views of a split, or all.
    pub fn select(&self, split: Option<&str>) -> Result<Vec<View>, CameraFileError> {
        let wanted = |view: &&View| split.is_none() || view.split.as_deref() == split;
        let views: Vec<View> = self.views.iter().filter(wanted).cloned().collect();
        if let (true, Some(split)) = (views.is_empty(), split) {
            let mut known: Vec<_> = self.views.iter().filter_map(|v| v.split.as_deref()).collect();
            known.sort_unstable();
            known.dedup();
            let known = known.join(", ");
            let (path, split) = (self.path.clone(), split.to_owned());
            return Err(CameraFileError::Split { path, split, known });
        }
        Ok(views)
    }

    pub fn view(&self, name: &str) -> Result<&View, CameraFileError> {
        let missing = || CameraFileError::Name { path: self.path.clone(), name: name.to_owned() };
        self.views.iter().find(|view| view.name == name).ok_or_else(missing)
    }
}

pub(crate) fn read_text(path: &Path) -> Result<String, CameraFileError> {
    let bytes = std::fs::read(path)
        .map_err(|error| CameraFileError::Read { path: path.to_path_buf(), error })?;
    String::from_utf8(bytes).map_err(|_| CameraFileError::Text { path: path.to_path_buf() })
}

fn parse_root(text: &str, path: &Path) -> Result<Value, CameraFileError> {
    let own = || path.to_path_buf();
    // Windows programs write a byte order mark.
    let text = text.trim_start_matches('\u{feff}');
    if let Some(what) = foreign(text) {
        return Err(CameraFileError::Foreign { path: own(), what });
    }
    let failed = |error| CameraFileError::Json { path: own(), error };
    let root = serde_json::from_str(text).map_err(failed)?;
    inria::converted(root).map_err(|(view, what)| CameraFileError::View { path: own(), view, what })
}

/// Cameras of other programs, by how their files begin.
fn foreign(text: &str) -> Option<&'static str> {
    let start = text.trim_start();
    let first = start.lines().next().unwrap_or_default();
    match () {
        _ if start.starts_with('<') && text.contains("<chunk") => Some("Metashape's XML"),
        _ if start.starts_with('<') => Some("XML"),
        _ if first.starts_with("#name") || first.starts_with("#cameras") => {
            Some("RealityCapture's CSV")
        }
        _ => None,
    }
}

/// What `read` makes of the entries of a file's list of pictures, by the order that it gives them.
fn entries<T>(
    root: &Value,
    path: &Path,
    mut read: impl FnMut(&Entry) -> Result<(f64, T), String>,
) -> Result<Vec<T>, CameraFileError> {
    let own = path.to_path_buf();
    let (values, opencv) = match (root["images"].as_array(), root["frames"].as_array()) {
        (Some(images), _) => (images, true),
        (_, Some(frames)) => (frames, false),
        _ => return Err(CameraFileError::Format { path: own }),
    };
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut by_name: Vec<usize> = (0..values.len()).collect();
    by_name.sort_by_cached_key(|i| natural(values[*i]["file_path"].as_str().unwrap_or_default()));
    let mut ranks = vec![0; values.len()];
    by_name.iter().enumerate().for_each(|(rank, i)| ranks[*i] = rank);
    let mut views = Vec::with_capacity(values.len());
    for (order, value) in values.iter().enumerate() {
        let entry = Entry { root, value, opencv, order, rank: ranks[order], folder };
        let wrong = |what| CameraFileError::View { path: own.clone(), view: entry.label(), what };
        views.push(read(&entry).map_err(wrong)?);
    }
    views.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(views.into_iter().map(|(_, view)| view).collect())
}

/// A text, and the number behind it: how many digits it has, without zeros in front, and which.
type NamePart = (String, Option<(usize, String)>);

/// What names are sorted by: numbers in them count by their value.
fn natural(name: &str) -> Vec<NamePart> {
    let mut parts: Vec<NamePart> = vec![Default::default()];
    for c in name.chars() {
        if !c.is_ascii_digit() && parts.last().is_none_or(|(_, number)| number.is_some()) {
            parts.push(Default::default());
        }
        let Some((text, number)) = parts.last_mut() else { continue };
        if !c.is_ascii_digit() {
            text.push(c);
            continue;
        }
        let (length, digits) = number.get_or_insert_default();
        if *length > 0 || c != '0' {
            *length += 1;
            digits.push(c);
        }
    }
    parts
}

/// One entry of the file's list of pictures, with the fields that count for all of them.
struct Entry<'a> {
    root: &'a Value,
    value: &'a Value,
    /// Whether it is `cameras.json`'s, else `transforms.json`'s.
    opencv: bool,
    order: usize,
    /// Its place among the names of `transforms.json`.
    rank: usize,
    folder: &'a Path,
}

impl Entry<'_> {
    /// A number of the entry, else of the whole file.
    fn number(&self, key: &str) -> Result<f64, String> {
        let value = self.value.get(key).or_else(|| self.root.get(key));
        let number = value.and_then(Value::as_f64).filter(|v| v.is_finite());
        number.ok_or_else(|| format!("\"{key}\" is missing or no finite number"))
    }

    /// What to call it in an error: its place in the list, and its name if it has one.
    fn label(&self) -> String {
        let name = self.text("file").or_else(|_| self.text("file_path"));
        format!("view {} {}", self.order, name.unwrap_or_default()).trim_end().to_owned()
    }

    fn text(&self, key: &str) -> Result<&str, String> {
        self.value[key].as_str().ok_or_else(|| format!("\"{key}\" is missing or no text"))
    }

    fn numbers<const N: usize>(&self, key: &str) -> Result<[f64; N], String> {
        floats(&self.value[key]).ok_or_else(|| format!("\"{key}\" is not {N} numbers"))
    }

    /// A side of a picture, pixels. Frames may be larger than what is rendered.
    fn side(&self, key: &str) -> Result<u32, String> {
        let value = self.number(key)?;
        let whole = value.fract() == 0.0 && (1.0..=65_535.0).contains(&value);
        whole
            .then_some(value as u32)
            .ok_or_else(|| format!("\"{key}\" is {value}: no picture side"))
    }

    /// Width, height, fx, fy, cx, cy by their names in the file.
    fn camera(&self, names: [&str; 6]) -> Result<Camera, String> {
        let [width, height, fx, fy, cx, cy] = names;
        let camera = Camera {
            width: self.side(width)?,
            height: self.side(height)?,
            fx: self.number(fx)? as f32,
            fy: self.number(fy)? as f32,
            cx: self.number(cx)? as f32,
            cy: self.number(cy)? as f32,
        };
        let intrinsics = Camera { width: 1, height: 1, ..camera };
        intrinsics.check().map_err(|e| e.to_string())?;
        Ok(camera)
    }

    /// The file of a picture: its name may lack an ending, or have the separators of Windows.
    fn picture(&self, name: &str) -> PathBuf {
        let file = with_ending(self.folder.join(name));
        if file.exists() || !name.contains('\\') {
            return file;
        }
        with_ending(self.folder.join(name.replace('\\', "/")))
    }

    fn time(&self) -> Result<Option<f64>, String> {
        let Some(value) = self.value.get("time").filter(|value| !value.is_null()) else {
            return Ok(None);
        };
        let time = value.as_f64().filter(|v| v.is_finite());
        time.map(Some).ok_or_else(|| "\"time\" is no finite number".to_owned())
    }

    fn opencv_view(&self) -> Result<(f64, View), String> {
        let name = self.text("file")?.to_owned();
        let pose = if self.value.get("qvec").is_some() {
            let pose = Pose::from_wxyz(self.numbers("qvec")?, self.numbers("tvec")?);
            Some(pose.ok_or("\"qvec\" and \"tvec\" are no pose")?)
        } else {
            None
        };
        let order = self.value["index"].as_f64().unwrap_or(self.order as f64);
        let camera = self.camera(["width", "height", "fx", "fy", "cx", "cy"])?;
        let split = self.value["split"].as_str().map(str::to_owned);
        let time = self.time()?;
        Ok((order, View { file: self.picture(&name), name, split, camera, pose, time }))
    }

    fn nerfstudio_view(&self) -> Result<(f64, View), String> {
        let coefficient = |key: &&&str| self.number(key).is_ok_and(|v| v != 0.0);
        if let Some(key) = DISTORTION.iter().find(coefficient) {
            return Err(format!("distortion \"{key}\" is not zero; undistort the pictures first"));
        }
        let model = self.value.get("camera_model").or_else(|| self.root.get("camera_model"));
        if let Some(model) = model.filter(|m| !PINHOLE_MODELS.iter().any(|known| *m == known)) {
            return Err(format!(
                "camera model {model} is no pinhole; undistort the pictures first"
            ));
        }
        let name = self.text("file_path")?.to_owned();
        let camera = self.camera(["w", "h", "fl_x", "fl_y", "cx", "cy"])?;
        let pose = if self.value.get("transform_matrix").is_some() {
            Some(self.opengl_pose()?)
        } else {
            None
        };
        let file = self.picture(&name);
        // Its "time", of moving scenes, is no seconds.
        Ok((self.rank as f64, View { file, name, split: None, camera, pose, time: None }))
    }

    /// An OpenGL camera-to-world matrix as an OpenCV world-to-camera pose: flips y and z of the
    /// camera, then inverts the motion.
    fn opengl_pose(&self) -> Result<Pose, String> {
        let wrong = "\"transform_matrix\" is no rigid 4×4 matrix";
        let rows = self.value["transform_matrix"].as_array().ok_or(wrong)?;
        let rows: Option<Vec<[f64; 4]>> = rows.iter().map(floats).collect();
        let rows = rows.and_then(|rows| <[_; 4]>::try_from(rows).ok()).ok_or(wrong)?;
        let m = DMat4::from_cols_array_2d(&rows).transpose();
        let flip = DMat3::from_diagonal(glam::DVec3::new(1.0, -1.0, -1.0));
        let rotation = rotation_of(&(DMat3::from_mat4(m) * flip), RIGID);
        let rotation = rotation.filter(|_| m.is_finite()).ok_or(wrong)?;
        Ok(Pose { rotation, translation: m.w_axis.truncate() }.inverse())
    }
}

/// nerfstudio leaves out endings at times; a dot within a name is none.
pub(crate) fn with_ending(file: PathBuf) -> PathBuf {
    if file.exists() {
        return file;
    }
    let endings = ENDINGS.into_iter().map(str::to_owned).chain(ENDINGS.map(str::to_uppercase));
    let mut candidates = endings.map(|ending| file.with_added_extension(ending));
    candidates.find(|candidate| candidate.exists()).unwrap_or(file)
}

#[cfg(test)]
mod tests {
    use nvsprior::{Picture, Pose};
    use nvsprior_runs::{RunView, RunWriter, RunWriterError};

    use super::*;

    fn parse(value: Value) -> Result<CameraFile, CameraFileError> {
        CameraFile::parse(&value.to_string(), Path::new("dive/cameras.json"))
    }

    fn opencv() -> Value {
        serde_json::json!({
            "width": 320, "height": 180, "fx": 270.0, "fy": 271.0, "cx": 160.0, "cy": 90.0,
            "images": [
                {"index": 5, "file": "b/2.png", "split": "b",
                 "qvec": [1, 0, 0, 0], "tvec": [1, 2, 3]},
                {"index": 2, "file": "a/1.png", "split": "a",
                 "qvec": [2, 0, 0, 0], "tvec": [0, 0, 1], "fx": 100.0},
            ]
        })
    }

    #[test]
    fn views_come_in_time_order_with_their_own_intrinsics() {
        let file = parse(opencv()).unwrap();
        assert_eq!(file.views[0].name, "a/1.png");
        assert_eq!(file.views[0].file, Path::new("dive/a/1.png"));
        assert_eq!((file.views[0].camera.fx, file.views[1].camera.fx), (100.0, 270.0));
        assert_eq!(file.views[0].pose.unwrap().wxyz(), [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(file.select(Some("b")).unwrap().len(), 1);
        assert_eq!(file.view("b/2.png").unwrap().split.as_deref(), Some("b"));
    }

    #[test]
    fn times_are_each_views_own_or_none() {
        let mut value = opencv();
        value["images"][0]["time"] = 2.5.into();
        value["images"][1]["time"] = Value::Null;
        let file = parse(value.clone()).unwrap();
        assert_eq!((file.views[0].time, file.views[1].time), (None, Some(2.5)));
        value["images"][1]["time"] = "noon".into();
        assert!(parse(value).unwrap_err().to_string().contains("a/1.png: \"time\""));
    }

    #[test]
    fn errors_name_what_is_wrong() {
        let file = parse(opencv()).unwrap();
        assert!(file.select(Some("c")).unwrap_err().to_string().contains("there are: a, b"));
        assert!(file.view("x").is_err());
        let mut value = opencv();
        value["images"][1]["tvec"] = serde_json::json!([1, 2]);
        let error = parse(value).unwrap_err().to_string();
        assert!(error.contains("view 1 a/1.png: ") && error.contains("tvec"), "{error}");
        for quaternion in [serde_json::json!([0, 0, 0, 0]), serde_json::json!([1, null, 0, 0, 0])] {
            let mut value = opencv();
            value["images"][0]["qvec"] = quaternion;
            assert!(parse(value).unwrap_err().to_string().contains("qvec"));
        }
        for width in [0.0, 320.5, 1e9] {
            let mut value = opencv();
            value["width"] = width.into();
            let error = parse(value).unwrap_err().to_string();
            assert!(error.contains(&format!("\"width\" is {width}")), "{error}");
        }
        assert!(parse(serde_json::json!({"a": 1})).is_err());
        assert!(CameraFile::parse("{", Path::new("x")).is_err());
    }

    fn nerfstudio() -> Value {
        // A camera at (1, 2, 3) that looks along world −z with y up: OpenGL's identity.
        serde_json::json!({
            "w": 1280, "h": 720, "fl_x": 1000.0, "fl_y": 1000.0, "cx": 640.0, "cy": 360.0,
            "k1": 0.0, "camera_model": "OPENCV",
            "frames": [{"file_path": "images/f.png", "transform_matrix":
                [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]}]
        })
    }

    #[test]
    fn frames_are_in_the_order_of_their_names() {
        let mut value = nerfstudio();
        let frame = value["frames"][0].clone();
        let named = |name: &str| {
            let mut frame = frame.clone();
            frame["file_path"] = name.into();
            frame
        };
        let names = ["images/frame_10.png", "images/frame_0.png", "images/frame_009.png"];
        value["frames"] = names.map(named).to_vec().into();
        let found = parse(value).unwrap();
        let order = [1, 2, 0].map(|i| names[i]);
        assert_eq!(found.views.iter().map(|view| &view.name[..]).collect::<Vec<_>>(), order);
    }

    #[test]
    fn pictures_are_found_by_names_of_windows_and_without_endings() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("images")).unwrap();
        for name in ["f.PNG", "a.b.jpg"] {
            std::fs::write(folder.path().join("images").join(name), "").unwrap();
        }
        let mut value = nerfstudio();
        for (name, file) in [("images\\f", "images/f.PNG"), ("./images/a.b", "./images/a.b.jpg")] {
            value["frames"][0]["file_path"] = name.into();
            let text = format!("\u{feff}{value}");
            let found = CameraFile::parse(&text, &folder.path().join("t.json")).unwrap();
            assert_eq!(found.views[0].file, folder.path().join(file));
        }
    }

    #[test]
    fn lenses_without_distortion_are_pinholes_whatever_their_model() {
        for model in ["SIMPLE_RADIAL", "RADIAL", "SIMPLE_PINHOLE"] {
            let mut value = nerfstudio();
            value["camera_model"] = model.into();
            assert!(parse(value).is_ok(), "{model}");
        }
    }

    #[test]
    fn cameras_of_other_programs_are_named() {
        for (text, named) in [
            ("<?xml version=\"1.0\"?>\n<document><chunk label=\"1\"/></document>", "Metashape"),
            ("#name,x,y,alt,heading,pitch,roll\na.png,1,2,3,4,5,6\n", "RealityCapture"),
        ] {
            let error = CameraFile::parse(text, Path::new("x")).unwrap_err().to_string();
            assert!(error.contains(named) && error.contains("COLMAP"), "{error}");
        }
    }

    #[test]
    fn opengl_poses_are_turned_into_opencv_ones() {
        let file = parse(nerfstudio()).unwrap();
        let pose = file.views[0].pose.unwrap();
        assert!((pose.centre() - glam::DVec3::new(1.0, 2.0, 3.0)).length() < 1e-12);
        // A point in front, above and to the right.
        let p = pose.rotation * glam::DVec3::new(2.0, 3.0, -7.0) + pose.translation;
        assert!((p - glam::DVec3::new(1.0, -1.0, 10.0)).length() < 1e-12, "{p}");
    }

    #[test]
    fn distorting_lenses_and_skewed_matrices_are_refused() {
        let mut value = nerfstudio();
        value["k1"] = 0.1.into();
        assert!(parse(value).unwrap_err().to_string().contains("k1"));
        let mut value = nerfstudio();
        value["camera_model"] = "OPENCV_FISHEYE".into();
        assert!(parse(value).unwrap_err().to_string().contains("OPENCV_FISHEYE"));
        let mut value = nerfstudio();
        value["frames"][0]["transform_matrix"][0][0] = 2.into();
        assert!(parse(value).is_err());
        let mut value = nerfstudio();
        value["frames"][0]["transform_matrix"][3] = serde_json::json!([0, 0, 0, null, 1]);
        assert!(parse(value).is_err());
    }

    #[test]
    fn what_a_run_writer_writes_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let writer = RunWriter::new(&folder.path().join("run"));
        let camera = Camera { width: 8, height: 4, fx: 7.0, fy: 7.5, cx: 4.0, cy: 2.0 };
        let picture = Picture { width: 8, height: 4, data: (0..96).collect() };
        let mut views = Vec::new();
        for (i, name) in ["../a/1.jpg", "a/2.png"].iter().enumerate() {
            let file = writer.picture(name, &picture).unwrap();
            let camera = Camera { fx: 7.0 + i as f32, ..camera };
            let pose = Pose { translation: glam::DVec3::new(0.1, 0.2, i as f64), ..Pose::IDENTITY };
            views.push(RunView { file, split: "s".into(), camera, pose, time: None });
        }
        writer.list(camera, &views).unwrap();
        let read = CameraFile::open(&folder.path().join("run/cameras.json")).unwrap();
        for (own, view) in views.iter().zip(&read.views) {
            assert_eq!(own.camera, view.camera);
            assert_eq!(Some(own.pose), view.pose);
            let found = image::open(&view.file).unwrap().into_rgb8().into_raw();
            assert_eq!(found, picture.data);
        }
        let again = writer.picture("a/1.webp", &picture);
        assert!(matches!(again, Err(RunWriterError::Twice { .. })));
    }
}
