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

/// Instructions of a module after its header, each with its operands.
fn instructions(spirv: &[u8]) -> Vec<Vec<u32>> {
    let word = |w: &[u8]| u32::from_le_bytes([w[0], w[1], w[2], w[3]]);
    let words: Vec<u32> = spirv.chunks_exact(4).skip(5).map(word).collect();
    let mut rest = words.as_slice();
    let mut instructions = Vec::new();
    while let Some(first) = rest.first() {
        let (one, others) = rest.split_at((first >> 16).max(1) as usize);
        instructions.push(one.to_vec());
        rest = others;
    }
    instructions
}

/// Only the float operations of `docs/portability.md` may be there, and none may be contracted.
#[test]
fn the_final_picture_is_made_of_portable_operations() {
    const DECORATE: u32 = 71;
    const NO_CONTRACTION: u32 = 42;
    const EXT_INST: u32 = 12;
    let manifest = manifest();
    let portable = manifest["portable"].as_array().unwrap();
    let modules = ALL.iter().filter(|m| {
        let name = m.entry.rsplit("::").next().unwrap();
        portable.iter().any(|portable| portable == name)
    });
    let mut seen = 0;
    for module in modules {
        let all = instructions(module.spirv);
        let decorated: Vec<u32> = all
            .iter()
            .filter(|i| i[0] & 0xffff == DECORATE && i[2] == NO_CONTRACTION)
            .map(|i| i[1])
            .collect();
        for i in &all {
            match i[0] & 0xffff {
                // OpFNegate, OpFAdd, OpFSub, OpFMul.
                127 | 129 | 131 | 133 => {
                    assert!(
                        decorated.contains(&i[2]),
                        "{}: %{} may be contracted",
                        module.entry,
                        i[2]
                    );
                    seen += 1;
                }
                // FAbs, Floor, FMin of GLSL.std.450; FindUMsb, which is of integers.
                EXT_INST => {
                    assert!([4, 8, 37, 75].contains(&i[4]), "{}: function {}", module.entry, i[4])
                }
                // Division, remainders, products of vectors and matrices.
                op @ (136 | 140..=148) => panic!("{}: operation {op}", module.entry),
                _ => {}
            }
        }
    }
    assert!(seen > 1000, "{seen} operations looked at");
}
