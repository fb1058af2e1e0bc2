#![no_main]

#[path = "../src/packed.rs"]
mod packed;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| packed::run(bytes));
