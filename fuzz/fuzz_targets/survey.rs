#![no_main]

#[path = "../src/survey.rs"]
mod survey;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| survey::run(bytes));
