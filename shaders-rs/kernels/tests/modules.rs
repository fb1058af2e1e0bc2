//! The committed SPIR-V modules: built from the sources beside them, and valid.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use nvsprior_kernels::modules::ALL;

/// The folder of this package.
fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn manifest() -> serde_json::Value {
    let text = fs::read_to_string(root().join("spv/manifest.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn modules() -> Vec<String> {
    let names = manifest()["modules"].as_array().unwrap().clone();
    names.iter().map(|name| name.as_str().unwrap().to_owned()).collect()
}

/// The sources in the order of their names, those of this package first.
fn sources() -> Vec<PathBuf> {
    let folders = [root().join("src"), root().with_file_name("stages").join("src")];
    let files = folders.iter().flat_map(|folder| fs::read_dir(folder).unwrap());
    let mut files: Vec<PathBuf> = files.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

/// FNV-1a, 64 bits, of the sources, as `make shaders` writes it.
fn source_hash() -> String {
    let files = sources();
    let bytes = files.iter().flat_map(|file| fs::read(file).unwrap());
    let hash = bytes.fold(0xcbf2_9ce4_8422_2325u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    });
    format!("{hash:016x}")
}

#[test]
fn modules_were_built_from_these_sources() {
    assert_eq!(
        manifest()["sources_fnv1a64"].as_str().unwrap(),
        source_hash(),
        "the shaders' sources changed and its modules were not rebuilt: run `make shaders`"
    );
}

#[test]
fn manifest_lists_what_is_there() {
    let mut files: Vec<String> = fs::read_dir(root().join("spv"))
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "spv"))
        .map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned())
        .collect();
    files.sort();
    assert_eq!(files, modules());
    let mut built_in: Vec<&str> = ALL.iter().filter_map(|m| m.entry.rsplit("::").next()).collect();
    built_in.sort();
    assert_eq!(built_in, modules());
    let toolchain = fs::read_to_string(root().with_file_name("rust-toolchain.toml")).unwrap();
    assert!(toolchain.contains(manifest()["toolchain"].as_str().unwrap()));
}

#[test]
fn modules_are_valid() {
    if Command::new("spirv-val").arg("--version").output().is_err() {
        println!("skipped: spirv-val is not installed (Debian: spirv-tools)");
        return;
    }
    for name in modules() {
        let file = root().join(format!("spv/{name}.spv"));
        let out = Command::new("spirv-val")
            .args(["--target-env", "vulkan1.2"])
            .arg(&file)
            .output()
            .unwrap();
        assert!(out.status.success(), "{name}: {}", String::from_utf8_lossy(&out.stderr));
    }
}
