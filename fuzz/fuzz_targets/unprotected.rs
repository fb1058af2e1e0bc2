#![no_main]

#[path = "../src/unprotected.rs"]
mod unprotected;
#[path = "../src/vehicle.rs"]
mod vehicle;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| unprotected::run(bytes));
