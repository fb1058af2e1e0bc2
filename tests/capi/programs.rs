//! Building and running the programs.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use crate::scene;

const FLAGS: [&str; 8] =
    ["-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1", "-g", "-pthread"];

/// Builds and runs `tests/c/NAME.c` with the scene's folder and more arguments. Says so if there is no C compiler.
pub fn run(name: &str, arguments: &[&str]) {
    if let Some(program) = build(name) {
        succeeds(Command::new(program).arg(scene::folder()).args(arguments));
    }
}

/// As [`run`], but the program repeats things less often.
pub fn run_few(name: &str) {
    if let Some(program) = build(name) {
        succeeds(Command::new(program).env("NVSP_TEST_FEW", "1").arg(scene::folder()));
    }
}

/// As [`run`], under a Vulkan layer of `tests/c`.
pub fn run_with_layer(name: &str, layer: &str) {
    if !Path::new("/usr/include/vulkan/vk_layer.h").exists() {
        println!("skipped: {name}, as the Vulkan headers (libvulkan-dev) are not installed");
        return;
    }
    let Some(program) = build(name) else { return };
    let mut cc = compiler();
    cc.args(["-fPIC", "-shared", "-o"]).arg(work().join(format!("lib{layer}.so")));
    succeeds(cc.arg(source(layer)));
    std::fs::copy(source(layer).with_extension("json"), work().join(format!("{layer}.json")))
        .unwrap();
    let mut command = Command::new(program);
    command.env("VK_LAYER_PATH", work());
    command.env("VK_INSTANCE_LAYERS", "VK_LAYER_NVSPRIOR_lost_device");
    succeeds(command.arg(scene::folder()));
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn work() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join("c-programs")
}

fn source(name: &str) -> PathBuf {
    root().join(format!("tests/c/{name}.c"))
}

fn compiler() -> Command {
    let mut cc = Command::new(std::env::var_os("CC").unwrap_or("cc".into()));
    cc.args(FLAGS).arg("-I").arg(root().join("include"));
    cc
}

/// Whether a program makes a Vulkan device itself.
fn uses_vulkan(name: &str) -> bool {
    name == "given_device"
}

/// Builds a program and returns its path; `None` if there is no C compiler.
fn build(name: &str) -> Option<PathBuf> {
    if compiler().arg("--version").output().is_err() {
        println!("skipped: {name}, as there is no C compiler");
        return None;
    }
    if uses_vulkan(name) && !Path::new("/usr/include/vulkan/vulkan.h").exists() {
        println!("skipped: {name}, as the Vulkan headers (libvulkan-dev) are not installed");
        return None;
    }
    let library = library();
    let program = work().join(name);
    let mut cc = compiler();
    cc.arg(source(name)).arg(source("common")).arg("-o").arg(&program);
    cc.arg("-L").arg(library).arg(format!("-Wl,-rpath,{}", library.display()));
    cc.args(["-lnvsprior", "-lm", "-ldl"]);
    if uses_vulkan(name) {
        cc.arg("-lvulkan");
    }
    succeeds(&mut cc);
    Some(program)
}

/// The folder of the shared library, which is built once here: `cargo test` itself builds none.
fn library() -> &'static Path {
    static LIBRARY: OnceLock<PathBuf> = OnceLock::new();
    LIBRARY.get_or_init(|| {
        std::fs::create_dir_all(work()).unwrap();
        let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
        let mut cargo = Command::new(env!("CARGO"));
        cargo.current_dir(root()).args(["rustc", "-p", "nvsprior-capi", "--lib"]);
        cargo.args(["--crate-type", "cdylib"]);
        // As cargo-c does, so that the library has its own allocator.
        succeeds(cargo.arg("--target-dir").arg(target).args(["--", "--cfg", "cargo_c"]));
        // As it is called once it is installed.
        let built = target.join("debug/libnvsprior_capi.so");
        std::fs::copy(built, work().join("libnvsprior.so")).unwrap();
        work()
    })
}

/// Runs a command. If it fails, shows what it printed.
fn succeeds(command: &mut Command) {
    let output = command.output().unwrap_or_else(|e| panic!("{command:?}: {e}"));
    let (out, err) =
        (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{command:?}: {}\n{out}{err}", output.status);
    print!("{out}");
}
