//! Builds the stages of `nvsprior-shaders` into `kernels/spv/`, one module per entry point. Writes the manifest that
//! ties the modules to their sources. With `--check` it builds in another folder and compares.

use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

mod memory_model;
mod words;

use words::{HEADER, bytes, instructions, words};

use spirv_builder::{Capability, ModuleResult, ShaderPanicStrategy, SpirvBuilder, SpirvMetadata};

const TOOLCHAIN: &str = "nightly-2026-08-15";
const TARGET: &str = "spirv-unknown-vulkan1.2";
/// The modules of the final picture, whose bits are the same on every device: docs/portability.md. The manifest has
/// this list for the tests.
const PORTABLE: [&str; 9] = [
    "arithmetic",
    "project",
    "project_lockstep",
    "quantize_rgb8",
    "splat",
    "splat_lockstep",
    "splat_wave16",
    "splat_wave32",
    "splat_wave64",
];

fn main() -> Result<(), Box<dyn Error>> {
    let check = match std::env::args().nth(1).as_deref() {
        None => false,
        Some("--check") => true,
        Some(other) => {
            return Err(format!("unknown argument {other}; there is only --check").into());
        }
    };
    // The folder that `cargo run` names now, not the one at compile time: several checkouts may share a target folder.
    let package = std::env::var("CARGO_MANIFEST_DIR").map_err(|_| "run me by `cargo run`")?;
    let root = Path::new(&package).parent().ok_or("no parent folder")?;
    let modules = build(root)?;
    let texts = [("manifest.json", manifest(root, &modules)?), ("modules.rs", listing(&modules))];
    let out = root.join("kernels/spv");
    if check { compare(&out, &modules, &texts) } else { write(&out, &modules, &texts) }
}

/// The name of an entry point, such as `bin_count` → its file of the stages, such as `bin`, and its SPIR-V.
type Modules = BTreeMap<String, (String, Vec<u8>)>;

/// Builds the modules and validates them.
fn build(root: &Path) -> Result<Modules, Box<dyn Error>> {
    let mut builder = SpirvBuilder::new(root.join("stages"), TARGET)
        .multimodule(true)
        .release(true)
        .deny_warnings(false)
        .spirv_metadata(SpirvMetadata::None)
        .shader_panic_strategy(ShaderPanicStrategy::SilentExit)
        // The optimiser fuses products and sums into `Fma`, unless they are decorated. So it runs after the decoration.
        .extra_arg("--no-spirv-opt")
        .capability(Capability::VulkanMemoryModel)
        .capability(Capability::Int64)
        .capability(Capability::GroupNonUniform)
        .capability(Capability::GroupNonUniformVote)
        .capability(Capability::GroupNonUniformArithmetic)
        .capability(Capability::GroupNonUniformBallot)
        .capability(Capability::GroupNonUniformShuffle);
    builder.toolchain_overwrite = Some(TOOLCHAIN.into());
    // All checkouts of a user share the target folder, and the modules of all have the same names there.
    let checkout = fnv1a64(root.as_os_str().as_encoded_bytes());
    builder.target_dir_path = Some(format!("spirv-builder-{checkout:016x}").into());
    let result = builder.build()?;
    let ModuleResult::MultiModule(files) = result.module else {
        return Err("the builder returned one module for all entry points".into());
    };
    let mut modules = Modules::new();
    for (entry, file) in files {
        let (source, name) =
            entry.rsplit_once("::").ok_or("an entry point is in no file of its own")?;
        let (source, name) = (source.to_owned(), name.to_owned());
        let mut spirv = fs::read(&file)?;
        if PORTABLE.contains(&name.as_str()) {
            spirv = uncontracted(&spirv);
        }
        let file = file.with_extension("optimised.spv");
        let spirv = memory_model::ordered_by_barriers(&spirv);
        let spirv = without_idle_capabilities(&optimised(&file, &spirv)?);
        validate(&file, &spirv)?;
        check_structures(&name, &spirv)?;
        modules.insert(name, (source, spirv));
    }
    Ok(modules)
}

/// Decorates every float operation with `NoContraction`: a device may then neither fuse it with others nor replace it
/// by one that rounds differently. rust-gpu cannot express that.
fn uncontracted(spirv: &[u8]) -> Vec<u8> {
    const OP_DECORATE: u32 = 71;
    const OP_MEMBER_DECORATE: u32 = 72;
    const NO_CONTRACTION: u32 = 42;
    // OpFNegate, OpFAdd, OpFSub, OpFMul, OpFDiv, OpFRem, OpFMod, OpVectorTimesScalar to OpDot.
    let arithmetic = |op: u32| matches!(op, 127 | 129 | 131 | 133 | 136 | 140 | 141 | 142..=148);
    let words = words(spirv);
    let instructions = instructions(&words);
    let decorates = |i: &&[u32]| matches!(i[0] & 0xffff, OP_DECORATE | OP_MEMBER_DECORATE);
    let last = instructions.iter().rposition(|i| decorates(&i)).map_or(0, |at| at + 1);
    let results = instructions.iter().filter(|i| arithmetic(i[0] & 0xffff)).map(|i| i[2]);
    let decorations = results.flat_map(|id| [3 << 16 | OP_DECORATE, id, NO_CONTRACTION]);
    let (before, after) = instructions.split_at(last);
    let header = words[..HEADER].iter().copied();
    let all = header
        .chain(before.iter().flat_map(|i| i.iter().copied()))
        .chain(decorations)
        .chain(after.iter().flat_map(|i| i.iter().copied()));
    bytes(all)
}

/// Removes the capabilities of subgroup operations and of 64-bit integers that a module does not use: a device need not
/// have them then.
fn without_idle_capabilities(spirv: &[u8]) -> Vec<u8> {
    const OP_CAPABILITY: u32 = 17;
    const OP_TYPE_INT: u32 = 21;
    const INT_64: u32 = 11;
    let words = words(spirv);
    let instructions = instructions(&words);
    let any = |is_it: &dyn Fn(&[u32]) -> bool| instructions.iter().any(|i| is_it(i));
    let uses =
        |operations: std::ops::RangeInclusive<u32>| any(&|i| operations.contains(&(i[0] & 0xffff)));
    let wide = any(&|i| i[0] & 0xffff == OP_TYPE_INT && i[2] == 64);
    let idle = |capability: u32| match capability {
        INT_64 => !wide,
        // GroupNonUniform, …Vote, …Arithmetic, …Ballot, …Shuffle.
        61 => !uses(333..=366) && !any(&has_subgroup_number),
        62 => !uses(334..=336),
        63 => !uses(349..=364),
        64 => !uses(337..=344),
        65 => !uses(345..=346),
        _ => false,
    };
    let kept =
        instructions.iter().filter(|i| i[0] & 0xffff != OP_CAPABILITY || !idle(i[1])).copied();
    bytes(words[..HEADER].iter().chain(kept.flatten()).copied())
}

/// Whether an instruction declares a built-in number of subgroups or of their invocations.
fn has_subgroup_number(instruction: &[u32]) -> bool {
    const OP_DECORATE: u32 = 71;
    const BUILT_IN: u32 = 11;
    let [op, _, BUILT_IN, number] = *instruction else { return false };
    op & 0xffff == OP_DECORATE && (36..=41).contains(&number)
}

/// Refuses structures that hold pointers, such as closures that capture a buffer: SwiftShader crashes on them.
fn check_structures(name: &str, spirv: &[u8]) -> Result<(), Box<dyn Error>> {
    const OP_TYPE_STRUCT: u32 = 30;
    const OP_TYPE_POINTER: u32 = 32;
    let words = words(spirv);
    let instructions = instructions(&words);
    let of = |op: u32| instructions.iter().filter(move |i| i[0] & 0xffff == op);
    let pointers: Vec<u32> = of(OP_TYPE_POINTER).map(|i| i[1]).collect();
    match of(OP_TYPE_STRUCT).any(|i| i[2..].iter().any(|member| pointers.contains(member))) {
        true => Err(format!("{name}: a structure or closure holds a reference").into()),
        false => Ok(()),
    }
}

/// What rust-gpu would have had optimised.
fn optimised(file: &Path, spirv: &[u8]) -> Result<Vec<u8>, Box<dyn Error>> {
    fs::write(file, spirv)?;
    let passes = ["--target-env=vulkan1.2", "--eliminate-dead-const", "--strip-debug", "-O"];
    let status = Command::new("spirv-opt").args(passes).arg(file).arg("-o").arg(file).status()?;
    if !status.success() {
        return Err(format!("spirv-opt fails at {}", file.display()).into());
    }
    Ok(fs::read(file)?)
}

fn validate(file: &Path, spirv: &[u8]) -> Result<(), Box<dyn Error>> {
    fs::write(file, spirv)?;
    let status =
        Command::new("spirv-val").args(["--target-env", "vulkan1.2"]).arg(file).status()?;
    if status.success() {
        Ok(())
    } else {
        Err(format!("spirv-val refuses {}", file.display()).into())
    }
}

/// FNV-1a, 64 bits.
fn fnv1a64(bytes: &[u8]) -> u64 {
    let add = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, add)
}

/// The hash of the shader sources in the order of their names, those of `kernels` first: enough to notice a change, and
/// simple enough to be repeated by the test that compares it.
fn source_hash(root: &Path) -> Result<String, Box<dyn Error>> {
    let mut files: Vec<PathBuf> = Vec::new();
    for package in ["kernels", "stages"] {
        for entry in fs::read_dir(root.join(package).join("src"))? {
            files.push(entry?.path());
        }
    }
    files.sort();
    let mut all = Vec::new();
    for file in files {
        all.extend(fs::read(&file)?);
    }
    Ok(format!("{:016x}", fnv1a64(&all)))
}

/// A file and its entry points, in lines that are not too long.
fn row(file: &str, names: &[&str]) -> String {
    const WIDTH: usize = 100;
    let mut lines = vec![format!("    {file}:")];
    for name in names {
        let last = lines.len() - 1;
        match lines[last].len() + name.len() < WIDTH {
            true => lines[last] += &format!(" {name}"),
            false => lines.push(format!("        {name}")),
        }
    }
    lines.join("\n") + ";\n"
}

/// What `kernels/src/modules.rs` includes.
fn listing(modules: &Modules) -> String {
    let mut files: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for (name, (source, _)) in modules {
        files.entry(source).or_default().push(name);
    }
    let rows: String = files.iter().map(|(file, names)| row(file, names)).collect();
    let head = "// The entry points by the file of the stages that has them. `make shaders` writes this.\n";
    format!("{head}modules! {{\n{rows}}}\n")
}

fn manifest(root: &Path, modules: &Modules) -> Result<String, Box<dyn Error>> {
    let names: Vec<&String> = modules.keys().collect();
    let manifest = serde_json::json!({
        "sources_fnv1a64": source_hash(root)?,
        "rust_gpu": "0.11.0",
        "toolchain": TOOLCHAIN,
        "target": TARGET,
        "modules": names,
        "portable": PORTABLE,
    });
    Ok(serde_json::to_string_pretty(&manifest)? + "\n")
}

fn write(out: &Path, modules: &Modules, texts: &[(&str, String)]) -> Result<(), Box<dyn Error>> {
    fs::create_dir_all(out)?;
    for entry in fs::read_dir(out)? {
        let path = entry?.path();
        if path.extension().is_some_and(|e| e == "spv") {
            fs::remove_file(path)?;
        }
    }
    for (name, (_, spirv)) in modules {
        fs::write(out.join(format!("{name}.spv")), spirv)?;
        println!("{name}.spv: {} bytes", spirv.len());
    }
    for (name, text) in texts {
        fs::write(out.join(name), text)?;
    }
    Ok(())
}

fn compare(out: &Path, modules: &Modules, texts: &[(&str, String)]) -> Result<(), Box<dyn Error>> {
    let mut different: Vec<String> = modules
        .iter()
        .filter(|(name, (_, spirv))| {
            fs::read(out.join(format!("{name}.spv"))).ok().as_ref() != Some(spirv)
        })
        .map(|(name, _)| format!("{name}.spv"))
        .collect();
    let is_other = |(name, text): &&(&str, String)| {
        fs::read_to_string(out.join(name)).ok().as_ref() != Some(text)
    };
    different.extend(texts.iter().filter(is_other).map(|(name, _)| (*name).to_owned()));
    if different.is_empty() {
        println!("{} modules agree with their sources", modules.len());
        return Ok(());
    }
    Err(format!(
        "rebuilt modules differ from kernels/spv/: {}; run `make shaders`",
        different.join(", ")
    )
    .into())
}
