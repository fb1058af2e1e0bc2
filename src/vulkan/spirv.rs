//! What is added to a module when a pipeline is made of it.

/// Words of a module's header.
const HEADER: usize = 5;
const OP_ENTRY_POINT: u32 = 15;
const OP_EXECUTION_MODE: u32 = 16;
const OP_CAPABILITY: u32 = 17;
const OP_DECORATE: u32 = 71;
const NO_CONTRACTION: u32 = 42;
const CAPABILITY_ROUNDING_MODE_RTE: u32 = 4467;
const ROUNDING_MODE_RTE: u32 = 4462;

/// Asks for rounding to nearest even of 32-bit sums and products, in modules that must not be contracted: those of the
/// final picture. Only for devices that support this: SPIR-V 1.4, "RoundingModeRTE".
pub(super) fn round_to_nearest(words: &mut Vec<u32>) {
    let Some(Places { capability, entry_end, entry }) = Places::of(words) else { return };
    let mode = [4 << 16 | OP_EXECUTION_MODE, entry, ROUNDING_MODE_RTE, 32];
    words.splice(entry_end..entry_end, mode);
    words.splice(capability..capability, [2 << 16 | OP_CAPABILITY, CAPABILITY_ROUNDING_MODE_RTE]);
}

/// Where to insert.
struct Places {
    /// Before the first capability.
    capability: usize,
    /// Behind the last entry point.
    entry_end: usize,
    /// The entry point.
    entry: u32,
}

impl Places {
    /// `None` if the module has no operation that must not be contracted.
    fn of(words: &[u32]) -> Option<Places> {
        let (mut found, mut exact) = (None, false);
        let mut at = HEADER;
        while let Some(first) = words.get(at) {
            let (op, count) = (first & 0xffff, (first >> 16).max(1) as usize);
            if op == OP_ENTRY_POINT {
                let entry = *words.get(at + 2)?;
                found = Some(Places { capability: HEADER, entry_end: at + count, entry });
            }
            exact |= op == OP_DECORATE && words.get(at + 2) == Some(&NO_CONTRACTION);
            at += count;
        }
        found.filter(|_| exact)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_modules_of_the_picture_are_changed() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/shaders-rs/kernels/spv/manifest.json");
        let manifest = std::fs::read_to_string(file).unwrap();
        let portable = manifest.split("\"portable\"").nth(1).unwrap().split(']').next().unwrap();
        for module in nvsprior_kernels::modules::ALL {
            let before: Vec<u32> = bytemuck::pod_collect_to_vec(module.spirv);
            let mut words = before.clone();
            round_to_nearest(&mut words);
            let name = module.entry.rsplit("::").next().unwrap();
            let expected = portable.contains(&format!("\"{name}\""));
            assert_eq!(words.len() == before.len() + 6, expected, "{}", module.entry);
        }
    }
}
