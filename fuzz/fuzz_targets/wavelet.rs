#![no_main]

#[path = "../src/wavelet.rs"]
mod wavelet;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| wavelet::run(bytes));
