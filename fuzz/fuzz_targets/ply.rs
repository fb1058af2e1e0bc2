#![no_main]

#[path = "../src/ply.rs"]
mod ply;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| ply::run(bytes));
