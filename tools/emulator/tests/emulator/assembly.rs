//! Makes small modules from instructions. Each has a storage buffer and shared memory, arrays of words.

use nvsprior_emulator::{Counts, Dispatch, Error, Module};

/// An instruction.
pub type Op = Vec<u32>;

/// Numbers that all modules define. The types first.
const VOID: u32 = 1;
const FUNCTION: u32 = 2;
pub const BOOL: u32 = 3;
pub const WORD: u32 = 4;
pub const FOUR: u32 = 5;
const TO_BUFFER: u32 = 6;
const TO_SHARED: u32 = 7;
const BUFFER: u32 = 8;
const SHARED: u32 = 9;
const INDEX_INPUT: u32 = 10;
const LANE_INPUT: u32 = 11;
const SUBGROUP_INPUT: u32 = 28;
/// The invocation's number in its workgroup, and in its subgroup; the subgroup's number in the workgroup.
pub const INDEX: u32 = 12;
pub const LANE: u32 = 13;
pub const SUBGROUP: u32 = 29;
const MAIN: u32 = 14;
/// Memory semantics of barriers, beside [`constant`]s.
pub const ORDERS_SHARED: u32 = 15;
pub const ORDERS_STORAGE: u32 = 16;
/// Orders shared memory, but makes no write visible.
pub const SHOWS_NOTHING: u32 = 27;

/// Memory operand of an access that barriers order.
pub const NON_PRIVATE: u32 = 0x20;
/// Words of shared memory.
const SHARED_WORDS: u32 = 64;

/// The constant `value`, below 80.
pub fn constant(value: u32) -> u32 {
    100 + value
}

/// Scopes of barriers and operations.
pub fn workgroup() -> u32 {
    constant(2)
}

pub fn subgroup() -> u32 {
    constant(3)
}

pub fn op(code: u32, operands: &[u32]) -> Op {
    let mut words = vec![(operands.len() as u32 + 1) << 16 | code];
    words.extend(operands);
    words
}

/// Access chain, and load or store, of a word of the buffer. `id`: a number of its own for the chain.
pub fn store_to_buffer(id: u32, at: u32, value: u32) -> [Op; 2] {
    [op(65, &[TO_BUFFER, id, BUFFER, constant(0), at]), op(62, &[id, value, NON_PRIVATE])]
}

pub fn load_from_buffer(id: u32, at: u32, value: u32) -> [Op; 2] {
    [op(65, &[TO_BUFFER, id, BUFFER, constant(0), at]), op(61, &[WORD, value, id, NON_PRIVATE])]
}

/// Adds one to a word of the buffer.
pub fn count_in_buffer(id: u32, at: u32, before: u32) -> [Op; 2] {
    let chain = op(65, &[TO_BUFFER, id, BUFFER, constant(0), at]);
    [chain, op(234, &[WORD, before, id, constant(1), constant(0), constant(1)])]
}

pub fn store_to_shared(id: u32, at: u32, value: u32) -> [Op; 2] {
    [op(65, &[TO_SHARED, id, SHARED, at]), op(62, &[id, value, NON_PRIVATE])]
}

pub fn load_from_shared(id: u32, at: u32, value: u32) -> [Op; 2] {
    [op(65, &[TO_SHARED, id, SHARED, at]), op(61, &[WORD, value, id, NON_PRIVATE])]
}

pub fn barrier(scope: u32, semantics: u32) -> Op {
    op(224, &[scope, scope, semantics])
}

/// `if value < limit { body }`. Takes four numbers from `id` on.
pub fn when_below(id: u32, value: u32, limit: u32, body: impl IntoIterator<Item = Op>) -> Vec<Op> {
    let [inside, behind] = [id + 1, id + 2];
    let mut ops = vec![
        op(176, &[BOOL, id, value, constant(limit)]),
        op(247, &[behind, 0]),
        op(250, &[id, inside, behind]),
        op(248, &[inside]),
    ];
    ops.extend(body);
    // A body that returns has no branch of its own.
    if ops.last().is_some_and(|op| op[0] as u16 != 253) {
        ops.push(op(249, &[behind]));
    }
    ops.push(op(248, &[behind]));
    ops
}

pub fn end() -> Op {
    op(253, &[])
}

/// The words of a module for workgroups of `size`.
pub fn words(size: u32, body: &[Op]) -> Vec<u8> {
    let name = [u32::from_le_bytes(*b"main"), 0];
    let inputs = [INDEX_INPUT, LANE_INPUT, SUBGROUP_INPUT];
    let mut ops = vec![
        op(17, &[1]),
        op(14, &[0, 3]),
        op(15, &[&[5, MAIN], &name[..], &[BUFFER, SHARED], &inputs].concat()),
        op(16, &[MAIN, 17, size, 1, 1]),
        op(71, &[20, 6, 4]),
        op(72, &[21, 0, 35, 0]),
        op(71, &[BUFFER, 33, 0]),
        op(71, &[BUFFER, 34, 0]),
        op(71, &[INDEX_INPUT, 11, 29]),
        op(71, &[LANE_INPUT, 11, 41]),
        op(71, &[SUBGROUP_INPUT, 11, 40]),
        op(19, &[VOID]),
        op(33, &[FUNCTION, VOID]),
        op(20, &[BOOL]),
        op(21, &[WORD, 32, 0]),
        op(23, &[FOUR, WORD, 4]),
        op(43, &[WORD, ORDERS_SHARED, 0x6108]),
        op(43, &[WORD, ORDERS_STORAGE, 0x6048]),
        op(43, &[WORD, SHOWS_NOTHING, 0x108]),
    ];
    ops.extend((0..80).map(|value| op(43, &[WORD, constant(value), value])));
    ops.extend([
        op(29, &[20, WORD]),
        op(30, &[21, 20]),
        op(32, &[22, 12, 21]),
        op(32, &[TO_BUFFER, 12, WORD]),
        op(59, &[22, BUFFER, 12]),
        op(28, &[23, WORD, constant(SHARED_WORDS)]),
        op(32, &[24, 4, 23]),
        op(32, &[TO_SHARED, 4, WORD]),
        op(59, &[24, SHARED, 4]),
        op(32, &[25, 1, WORD]),
        op(59, &[25, INDEX_INPUT, 1]),
        op(59, &[25, LANE_INPUT, 1]),
        op(59, &[25, SUBGROUP_INPUT, 1]),
        op(54, &[VOID, MAIN, 0, FUNCTION]),
        op(248, &[26]),
        op(61, &[WORD, INDEX, INDEX_INPUT]),
        op(61, &[WORD, LANE, LANE_INPUT]),
        op(61, &[WORD, SUBGROUP, SUBGROUP_INPUT]),
    ]);
    ops.extend_from_slice(body);
    ops.push(op(56, &[]));
    let head = [0x0723_0203, 0x0001_0500, 0, 1_000, 0];
    head.into_iter().chain(ops.concat()).flat_map(u32::to_le_bytes).collect()
}

/// A dispatch along one axis.
pub fn dispatch(groups: u32, subgroup: u32, seed: u64) -> Dispatch<'static> {
    Dispatch { groups: [groups, 1, 1], push: &[], constants: &[], subgroup, seed }
}

/// Runs a module of one workgroup, of subgroups of 8, on a buffer.
pub fn run(size: u32, body: &[Op], seed: u64, buffer: &mut Vec<u32>) -> Result<Counts, Error> {
    run_with(size, body, &dispatch(1, 8, seed), buffer)
}

pub fn run_with(
    size: u32,
    body: &[Op],
    dispatch: &Dispatch,
    buffer: &mut Vec<u32>,
) -> Result<Counts, Error> {
    let mut buffers = [std::mem::take(buffer)];
    let counts = Module::new(&words(size, body))?.run(dispatch, &mut buffers);
    [*buffer] = buffers;
    counts
}
