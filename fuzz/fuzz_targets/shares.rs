#![no_main]

#[path = "../src/shares.rs"]
mod shares;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| shares::run(bytes));
