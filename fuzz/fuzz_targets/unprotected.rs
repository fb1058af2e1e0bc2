#![no_main]

#[path = "../src/unprotected.rs"]
mod unprotected;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| unprotected::run(bytes));
