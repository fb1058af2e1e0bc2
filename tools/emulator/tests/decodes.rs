//! Which of the modules that ship the emulator knows.

use nvsprior_emulator::{Error, Module};
use nvsprior_kernels::modules;

#[test]
fn modules_are_known() {
    for module in modules::ALL {
        match Module::new(module.spirv) {
            Ok(_) => {}
            Err(Error::Unknown { what, .. }) => println!("{}: {what}", module.entry),
            Err(other) => panic!("{}: {other}", module.entry),
        }
    }
}
