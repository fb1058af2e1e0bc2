#![no_main]

#[path = "../src/pieces.rs"]
mod pieces;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| pieces::run(bytes));
