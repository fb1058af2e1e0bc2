#![no_main]

#[path = "../src/camera_file.rs"]
mod camera_file;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| camera_file::run(bytes));
