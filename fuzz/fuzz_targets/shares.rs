#![no_main]

#[path = "../src/shares.rs"]
mod shares;
#[path = "../src/vehicle.rs"]
mod vehicle;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| shares::run(bytes));
