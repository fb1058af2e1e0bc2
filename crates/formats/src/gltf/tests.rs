use proptest::prelude::*;
use serde_json::{Value, json};

use super::*;
use nvsprior::RenderOverrides;

/// A file of the chunks.
fn glb(document: &Value, data: &[u8]) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut file = b"glTF".to_vec();
    let length = 12 + 8 + text.len() + 8 + data.len();
    for word in [2, length as u32, text.len() as u32] {
        file.extend(word.to_le_bytes());
    }
    file.extend(b"JSON");
    file.extend(text);
    file.extend((data.len() as u32).to_le_bytes());
    file.extend(b"BIN\0");
    file.extend(data);
    file
}

/// Two splats of degree 1 with floats, in one node.
fn plain() -> (Value, Vec<u8>) {
    let columns: [(&str, &str, &[f32]); 8] = [
        ("POSITION", "VEC3", &[1.0, 2.0, 3.0, -1.0, 0.0, 0.5]),
        ("KHR_gaussian_splatting:ROTATION", "VEC4", &[0.6, 0.0, 0.0, 0.8, 0.0, 0.0, 0.0, 1.0]),
        ("KHR_gaussian_splatting:SCALE", "VEC3", &[1.0, 0.5, 0.25, 0.1, 0.1, 0.1]),
        ("KHR_gaussian_splatting:OPACITY", "SCALAR", &[0.5, 1.0]),
        ("KHR_gaussian_splatting:SH_DEGREE_0_COEF_0", "VEC3", &[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]),
        ("KHR_gaussian_splatting:SH_DEGREE_1_COEF_0", "VEC3", &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        ("KHR_gaussian_splatting:SH_DEGREE_1_COEF_1", "VEC3", &[2.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        ("KHR_gaussian_splatting:SH_DEGREE_1_COEF_2", "VEC3", &[3.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
    ];
    let (mut data, mut views, mut accessors) = (Vec::new(), Vec::new(), Vec::new());
    let mut attributes = serde_json::Map::new();
    for (index, (name, kind, values)) in columns.into_iter().enumerate() {
        views.push(json!({"buffer": 0, "byteOffset": data.len(), "byteLength": 4 * values.len()}));
        accessors
            .push(json!({"bufferView": index, "componentType": 5126, "count": 2, "type": kind}));
        attributes.insert(name.into(), index.into());
        data.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    }
    let extension = json!({"kernel": "ellipse", "colorSpace": "srgb_rec709_display"});
    let document = json!({
        "asset": {"version": "2.0", "generator": "a test"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{
            "attributes": attributes, "mode": 0, "extensions": {"KHR_gaussian_splatting": extension},
        }]}],
        "buffers": [{"byteLength": data.len()}],
        "bufferViews": views,
        "accessors": accessors,
    });
    (document, data)
}

fn reason(document: &Value, data: &[u8]) -> String {
    read(&glb(document, data)).unwrap_err().to_string()
}

fn near(a: &[f32], b: &[f32]) {
    assert_eq!(a.len(), b.len());
    assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6), "{a:?} {b:?}");
}

#[test]
fn values_are_those_of_the_extension() {
    let (document, data) = plain();
    let file = read(&glb(&document, &data)).unwrap();
    assert_eq!((file.format, file.options), (FORMAT, RenderOptions::INRIA));
    assert_eq!(file.comments, ["generator a test"]);
    let s = &file.splats;
    assert_eq!(s.positions, [[1.0, 2.0, 3.0], [-1.0, 0.0, 0.5]]);
    assert_eq!(s.rotations, [[0.8, 0.6, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]]);
    near(&s.log_scales[0], &[0.0, 0.5_f32.ln(), 0.25_f32.ln()]);
    assert_eq!(s.opacity_logits, [0.0, f32::INFINITY]);
    assert_eq!(s.sh_degree, 1);
    assert_eq!(s.sh[..12], [0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 3.0, 0.0, 0.0]);
    assert_eq!(
        crate::from_bytes(&glb(&document, &data), "x", &RenderOverrides::default()).unwrap().len(),
        2
    );
}

#[test]
fn nodes_move_turn_and_scale() {
    let (mut document, data) = plain();
    // A quarter turn about z: x becomes y, y becomes -x. The child is moved first.
    let half = std::f64::consts::FRAC_1_SQRT_2;
    document["nodes"] = json!([
        {"rotation": [0.0, 0.0, half, half], "scale": [2.0, 2.0, 2.0], "children": [1]},
        {"mesh": 0, "translation": [1.0, 0.0, 0.0]},
    ]);
    let s = read(&glb(&document, &data)).unwrap().splats;
    near(&s.positions[0], &[-4.0, 4.0, 6.0]);
    near(&s.log_scales[0], &[2_f32.ln(), 0.0, 0.5_f32.ln()]);
    near(&s.rotations[1], &[half as f32, 0.0, 0.0, half as f32]);
    // Degree 1 is -y, z, -x: what pointed along y points along -x, what pointed along x points along y.
    near(&[s.sh[3], s.sh[6], s.sh[9]], &[3.0, 2.0, -1.0]);
    // The same as a matrix.
    document["nodes"][0] = json!({"children": [1], "matrix":
        [0.0, 2.0, 0.0, 0.0, -2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0]});
    let same = read(&glb(&document, &data)).unwrap().splats;
    near(same.positions.as_flattened(), s.positions.as_flattened());
    near(&same.sh, &s.sh);
}

#[test]
fn integers_stand_for_parts_of_one() {
    let (mut document, mut data) = plain();
    let at = data.len();
    // Opacities as bytes, rotations as 16-bit numbers with a gap behind each.
    data.extend([51, 255, 0, 0]);
    for word in [0_i16, 0, -32_768, 0, 9, 9, 32_767, 0, 0, 0, 9, 9] {
        data.extend(word.to_le_bytes());
    }
    let views = document["bufferViews"].as_array_mut().unwrap();
    views.push(json!({"buffer": 0, "byteOffset": at, "byteLength": 2}));
    views.push(json!({"buffer": 0, "byteOffset": at + 4, "byteLength": 24, "byteStride": 12}));
    document["accessors"][3] = json!(
        {"bufferView": 8, "componentType": 5121, "normalized": true, "count": 2, "type": "SCALAR"});
    document["accessors"][1] = json!(
        {"bufferView": 9, "componentType": 5122, "normalized": true, "count": 2, "type": "VEC4"});
    let s = read(&glb(&document, &data)).unwrap().splats;
    near(&s.opacity_logits[..1], &[(0.2_f32 / 0.8).ln()]);
    assert_eq!(s.rotations, [[0.0, 0.0, 0.0, -1.0], [0.0, 1.0, 0.0, 0.0]]);
}

#[test]
fn primitives_of_lower_degree_are_filled_up() {
    let (mut document, data) = plain();
    let mut other = document["meshes"][0]["primitives"][0].clone();
    for n in 0..3 {
        let name = format!("KHR_gaussian_splatting:SH_DEGREE_1_COEF_{n}");
        other["attributes"].as_object_mut().unwrap().remove(&name);
    }
    let primitives = document["meshes"][0]["primitives"].as_array_mut().unwrap();
    primitives.push(other);
    // A mesh of triangles beside them is not ours.
    primitives.push(json!({"attributes": {"POSITION": 0}, "mode": 4}));
    let s = read(&glb(&document, &data)).unwrap().splats;
    assert_eq!((s.len(), s.sh_degree, s.check_shape().is_ok()), (4, 1, true));
    assert_eq!(s.sh[24..36], [0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
}

#[test]
fn what_would_be_drawn_wrong_is_refused_by_name() {
    let primitive = "/meshes/0/primitives/0";
    let splats = format!("{primitive}/extensions/KHR_gaussian_splatting");
    for (at, value, expected) in [
        (format!("{splats}/kernel"), json!("cube"), "kernel \"cube\""),
        (format!("{splats}/colorSpace"), json!("lin_rec709_display"), "colorSpace \"lin_rec709"),
        ("/asset".into(), json!(3), "document: "),
        ("/nodes/0/mesh".into(), json!(7), "the mesh of node 0"),
        ("/scene".into(), json!(1), "the scene"),
        ("/scenes/0/nodes".into(), json!([0, 0]), "node 0: the nodes are no tree"),
        (
            "/nodes/0".into(),
            json!({"mesh": 0, "scale": [1.0, 2.0, 1.0]}),
            "node 0 does not only turn",
        ),
        (
            "/nodes/0".into(),
            json!({"mesh": 0, "scale": [0.0, 0.0, 0.0]}),
            "node 0 does not only turn",
        ),
        (
            "/nodes/0".into(),
            json!({"mesh": 0, "scale": [-1.0, 1.0, 1.0]}),
            "node 0 does not only turn",
        ),
        ("/nodes/0".into(), json!({"children": [0]}), "node 0: the nodes are no tree"),
        ("/accessors/2/type".into(), json!("VEC4"), "SCALE, accessor 2: VEC4, not VEC3"),
        ("/accessors/2/componentType".into(), json!(5125), "component type 5125"),
        ("/accessors/2/count".into(), json!(1), "POSITION has 2 splats, another attribute 1"),
        ("/accessors/0/count".into(), json!(99), "24 bytes, 1188 are due"),
        ("/accessors/2/bufferView".into(), json!(null), "it has no bufferView"),
        ("/bufferViews/2/byteLength".into(), json!(1e6 as u64), "truncated"),
        ("/bufferViews/2/buffer".into(), json!(1), "not in the file itself"),
        ("/buffers/0".into(), json!({"byteLength": 8, "uri": "a.bin"}), "not in the file itself"),
    ] {
        let (mut document, data) = plain();
        *document.pointer_mut(&at).unwrap() = value;
        let found = reason(&document, &data);
        assert!(found.contains(expected), "{at}: {found}");
    }
    let (mut document, data) = plain();
    document["extensionsRequired"] = json!(["EXT_meshopt_compression"]);
    assert!(reason(&document, &data).contains("EXT_meshopt_compression"));
    let (mut document, data) = plain();
    *document.pointer_mut(&splats).unwrap() = json!({"kernel": "ellipse", "colorSpace": "srgb_rec709_display",
        "extensions": {"KHR_gaussian_splatting_compression_spz_2": {"bufferView": 0}}});
    assert!(reason(&document, &data).contains("KHR_gaussian_splatting_compression_spz_2"));
    let (mut document, data) = plain();
    document["nodes"] = json!([{}]);
    assert!(matches!(read(&glb(&document, &data)), Err(PriorError::Empty)));
}

proptest! {
    #[test]
    fn damaged_files_are_errors_or_valid(at in 0_usize..4000, byte: u8, end in 0_usize..4000) {
        let (document, data) = plain();
        let mut file = glb(&document, &data);
        let (at, end) = (at % file.len(), end % file.len());
        prop_assert!(read(&file[..end]).is_err());
        file[at] = byte;
        let _ = crate::from_bytes(&file, "x", &RenderOverrides::default());
    }
}

/// The plain file with another column in place of one; floats.
fn with_column(name: &str, values: &[f32]) -> PriorFile {
    let (document, mut data) = plain();
    let accessor = document["meshes"][0]["primitives"][0]["attributes"][name].as_u64().unwrap();
    let start = document["bufferViews"][accessor as usize]["byteOffset"].as_u64().unwrap() as usize;
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    data[start..start + bytes.len()].copy_from_slice(&bytes);
    read(&glb(&document, &data)).unwrap()
}

#[test]
fn logarithms_and_logits_of_the_draft_are_recognised() {
    let (document, data) = plain();
    let right = read(&glb(&document, &data)).unwrap();
    assert_eq!(right.warnings, []);
    let logarithms: Vec<f32> = right.splats.log_scales.as_flattened().to_vec();
    let scales = with_column("KHR_gaussian_splatting:SCALE", &logarithms);
    near(scales.splats.log_scales.as_flattened(), &logarithms);
    assert!(scales.warnings[0].to_string().contains("logarithms"), "{:?}", scales.warnings);
    let logits = with_column("KHR_gaussian_splatting:OPACITY", &[-1.5, 0.5]);
    assert_eq!(logits.splats.opacity_logits, [-1.5, 0.5]);
    assert!(logits.warnings[0].to_string().contains("logits"), "{:?}", logits.warnings);
}

#[test]
fn what_no_list_names_is_told() {
    let (mut document, data) = plain();
    let primitive = &mut document["meshes"][0]["primitives"][0];
    primitive["extensions"]["KHR_gaussian_splatting"]["blur"] = json!(3);
    primitive["attributes"]["_TIME"] = json!(3);
    let told: Vec<String> =
        read(&glb(&document, &data)).unwrap().warnings.iter().map(ToString::to_string).collect();
    assert!(told[0].contains("\"_TIME\"") && told[1].contains("\"blur\""), "{told:?}");
    document["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"]["antialiased"] =
        json!(true);
    assert!(read(&glb(&document, &data)).unwrap().options.antialiased);
}

#[test]
fn a_file_of_the_draft_is_named() {
    let (mut document, data) = plain();
    document["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"] = json!({});
    assert!(reason(&document, &data).contains("a draft of KHR_gaussian_splatting"));
}
