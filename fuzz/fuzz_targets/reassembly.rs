#![no_main]

#[path = "../src/reassembly.rs"]
mod reassembly;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| reassembly::run(bytes));
