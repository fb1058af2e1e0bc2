//! Inria's `cameras.json`, which its trainer writes: a list of `img_name`, `width`, `height`, `fx`, `fy`, `position`
//! (the camera's centre) and `rotation` (camera to world, rows). The principal point is the middle.

use glam::{DMat3, DVec3};
use nvsprior::Pose;
use nvsprior::geometry::rotation_of;
use serde_json::{Value, json};

use super::numbers::{RIGID, floats};

/// The same as our own list, if it is one; else as it was. What is wrong, with the name of the entry.
pub fn converted(root: Value) -> Result<Value, (String, String)> {
    let Some(list) = root.as_array().filter(|list| list.iter().any(|v| v["img_name"].is_string()))
    else {
        return Ok(root);
    };
    let image = |(index, entry): (usize, &Value)| {
        let name = entry["img_name"].as_str().unwrap_or_default();
        own(entry, name, index).map_err(|what| (format!("view {index} {name}"), what))
    };
    let images: Result<Vec<Value>, _> = list.iter().enumerate().map(image).collect();
    Ok(json!({ "images": images? }))
}

fn own(entry: &Value, name: &str, index: usize) -> Result<Value, String> {
    let numbers = |key: &str| floats::<3>(&entry[key]).ok_or(format!("\"{key}\" is not 3 numbers"));
    let centre = DVec3::from(numbers("position")?);
    let rows: Option<Vec<[f64; 3]>> =
        entry["rotation"].as_array().and_then(|rows| rows.iter().map(floats).collect());
    let rows = rows.and_then(|rows| <[_; 3]>::try_from(rows).ok());
    let to_camera = DMat3::from_cols_array_2d(&rows.ok_or("\"rotation\" is not 3×3 numbers")?);
    let rotation = rotation_of(&to_camera, RIGID).ok_or("\"rotation\" is no rotation")?;
    let pose = Pose::from_centre(rotation, centre);
    let middle = |key: &str| entry[key].as_f64().map(|side| side / 2.0);
    // The trainer leaves out the ending, and the folder.
    let name = if name.contains('/') { name.to_owned() } else { format!("images/{name}") };
    Ok(json!({
        "file": name, "index": index, "width": entry["width"], "height": entry["height"],
        "fx": entry["fx"], "fy": entry["fy"], "cx": middle("width"), "cy": middle("height"),
        "qvec": pose.wxyz(), "tvec": pose.translation.to_array(),
    }))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::CameraFile;
    use super::*;

    #[test]
    fn its_cameras_are_ours() {
        let turned = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]];
        let entry = json!({"id": 0, "img_name": "f", "width": 320, "height": 180, "fx": 260.0,
            "fy": 261.0, "position": [1.0, 2.0, 3.0], "rotation": turned});
        let parse = |entry: &Value| {
            CameraFile::parse(&json!([entry]).to_string(), Path::new("dive/cameras.json"))
        };
        let view = parse(&entry).unwrap().views.remove(0);
        assert_eq!(view.file, Path::new("dive/images/f"));
        assert_eq!((view.camera.cx, view.camera.fy), (160.0, 261.0));
        let pose = view.pose.unwrap();
        assert!((pose.centre() - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-12);
        // It looks along the world's x: the third column of the rotation.
        let ahead = pose.rotation * DVec3::X;
        assert!((ahead - DVec3::Z).length() < 1e-12, "{ahead}");
        for (key, value) in
            [("position", json!([1, 2])), ("rotation", json!([[1, 0, 0], [0, 1, 0], [0, 0, 2]]))]
        {
            let mut wrong = entry.clone();
            wrong[key] = value;
            assert!(parse(&wrong).unwrap_err().to_string().contains(key), "{key}");
        }
    }
}
