//! `nvsprior devices`: the Vulkan devices of this machine.

use nvsprior::vulkan::{ListedDevice, devices};

/// List the Vulkan devices of this machine
///
/// The number, or a part of the name or the driver's name, is what --device takes. Whether a device draws the same
/// bytes as every other one is measured by `nvsprior verify-device`.
#[derive(clap::Args)]
pub struct Args {}

pub fn run(_: &Args) -> anyhow::Result<()> {
    for (number, ListedDevice { info, memory, unfit }) in devices()?.iter().enumerate() {
        let (major, minor) = info.api;
        println!("{number}: {}", info.name);
        println!("   {}, {}, Vulkan {major}.{minor}", info.kind.name(), info.driver);
        println!("   {} MB of memory, subgroups of {}", memory / 1_000_000, info.subgroup);
        match unfit {
            None => println!("   can run nvsprior"),
            Some(why) => println!("   cannot run nvsprior: it {why}"),
        }
    }
    Ok(())
}
