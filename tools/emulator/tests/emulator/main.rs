//! Tests of the emulator itself: it computes what modules say, and finds what is wrong with broken ones.

mod assembly;
mod faults;
mod races;
mod results;
mod shipped;
