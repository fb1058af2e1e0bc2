//! What Vulkan's memory model wants of memory that invocations share, and rust-gpu leaves out: a barrier orders only
//! accesses that say that they are not private, and it makes their writes visible only if it says so.

use std::collections::{BTreeMap, BTreeSet};

use crate::words::{HEADER, bytes, instructions, words};

const OP_TYPE_POINTER: u32 = 32;
const OP_CONSTANT: u32 = 43;
const OP_LOAD: u32 = 61;
const OP_STORE: u32 = 62;
const OP_COPY_MEMORY: u32 = 63;
const OP_CONTROL_BARRIER: u32 = 224;
/// `Variable`, `AccessChain`, `InBoundsAccessChain`, `PtrAccessChain`, `InBoundsPtrAccessChain`, `CopyObject`,
/// `Select`, `Phi`.
const MAKES_POINTERS: [u32; 8] = [59, 65, 66, 67, 70, 83, 169, 245];
/// Storage classes of memory that invocations share: `Workgroup`, `StorageBuffer`.
const SHARED: [u32; 2] = [4, 12];
/// Memory operand of a load or a store.
const NON_PRIVATE: u32 = 0x20;
/// Semantics of a barrier: `MakeAvailable`, `MakeVisible`.
const MAKE_SEEN: u32 = 0x2000 | 0x4000;

/// The operation of an instruction.
fn operation(instruction: &[u32]) -> u32 {
    instruction[0] & 0xffff
}

/// Makes each access to shared memory one that barriers order, and each barrier one that makes writes visible.
pub fn ordered_by_barriers(spirv: &[u8]) -> Vec<u8> {
    let words = words(spirv);
    let instructions = instructions(&words);
    let pointers = shared_pointers(&instructions);
    let is_barrier = |i: &&&[u32]| operation(i) == OP_CONTROL_BARRIER;
    let semantics: BTreeSet<u32> = instructions.iter().filter(is_barrier).map(|i| i[3]).collect();
    // The bound of identifiers is the header's fourth word.
    let mut next = words[3];
    let mut stronger = BTreeMap::new();
    let mut out = words[..HEADER].to_vec();
    for instruction in instructions {
        match (operation(instruction), instruction) {
            (OP_CONSTANT, [_, of_type, id, value]) if semantics.contains(id) => {
                out.extend(instruction);
                out.extend([4 << 16 | OP_CONSTANT, *of_type, next, value | MAKE_SEEN]);
                stronger.insert(*id, next);
                next += 1;
            }
            (OP_CONTROL_BARRIER, [first, execution, memory, semantics]) => {
                out.extend([*first, *execution, *memory, stronger[semantics]]);
            }
            (OP_LOAD, [_, _, _, pointer, ..]) if pointers.contains(pointer) => {
                out.extend(not_private(instruction, 4));
            }
            (OP_STORE, [_, pointer, ..]) if pointers.contains(pointer) => {
                out.extend(not_private(instruction, 3));
            }
            // Operands of the access to the target, then of that to the source.
            (OP_COPY_MEMORY, [first, target, source]) => {
                let operands =
                    [target, source].map(|p| u32::from(pointers.contains(p)) * NON_PRIVATE);
                out.extend([first + (2 << 16), *target, *source]);
                out.extend(operands);
            }
            _ => out.extend(instruction),
        }
    }
    out[3] = next;
    bytes(out)
}

/// Results that point to shared memory.
fn shared_pointers(instructions: &[&[u32]]) -> BTreeSet<u32> {
    let types: BTreeSet<u32> = instructions
        .iter()
        .filter(|i| operation(i) == OP_TYPE_POINTER && SHARED.contains(&i[2]))
        .map(|i| i[1])
        .collect();
    let results = instructions
        .iter()
        .filter(|i| MAKES_POINTERS.contains(&operation(i)) && types.contains(&i[1]));
    results.map(|i| i[2]).collect()
}

/// A load or store with the memory operand. `at`: where operands begin, if there are any.
fn not_private(instruction: &[u32], at: usize) -> Vec<u32> {
    let mut changed = instruction.to_vec();
    match changed.get_mut(at) {
        Some(operands) => *operands |= NON_PRIVATE,
        None => {
            changed.push(NON_PRIVATE);
            changed[0] += 1 << 16;
        }
    }
    changed
}
