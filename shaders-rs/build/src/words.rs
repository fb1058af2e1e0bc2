//! A SPIR-V module as words and as instructions. An instruction's first word holds its number of words and its
//! operation.

/// Words of a module's header.
pub const HEADER: usize = 5;

pub fn words(spirv: &[u8]) -> Vec<u32> {
    spirv.chunks_exact(4).map(|w| u32::from_le_bytes([w[0], w[1], w[2], w[3]])).collect()
}

/// The instructions after the header.
pub fn instructions(words: &[u32]) -> Vec<&[u32]> {
    let mut instructions = Vec::new();
    let mut at = HEADER;
    while at < words.len() {
        let count = (words[at] >> 16).max(1) as usize;
        instructions.push(&words[at..(at + count).min(words.len())]);
        at += count;
    }
    instructions
}

/// The bytes of a module.
pub fn bytes(words: impl IntoIterator<Item = u32>) -> Vec<u8> {
    words.into_iter().flat_map(u32::to_le_bytes).collect()
}
