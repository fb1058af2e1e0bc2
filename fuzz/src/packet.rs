//! Packets, and all that the topside does with one but draw: any bytes must give an error or a picture.
//!
//! The first byte says how the bytes after it are made a packet: see [`repair`]. A formula takes the device's place, so
//! that an input takes microseconds: see [`topside`].

use std::cell::RefCell;

use nvsprior::Packet;
use nvsprior::packet::{Extent, Parsed};

#[path = "predicted.rs"]
mod predicted;
#[path = "packet/reference.rs"]
mod reference;
#[path = "packet/repair.rs"]
mod repair;
#[path = "packet/topside.rs"]
mod topside;

use topside::Topside;

/// Sizes of pictures that are decoded. Small ones, as time goes with the pixels.
const SIZES: [(u32, u32); 8] =
    [(1, 1), (7, 2), (8, 8), (17, 5), (16, 16), (24, 16), (33, 17), (64, 36)];

thread_local! {
    /// Topsides that have seen all earlier inputs, by size.
    static USED: RefCell<Vec<Topside>> =
        RefCell::new(SIZES.iter().map(|size| Topside::new(*size)).collect());
}

pub fn run(input: &[u8]) {
    predicted::run(input);
    let Some((&choice, bytes)) = input.split_first() else { return };
    let mut bytes = bytes.to_vec();
    repair::repair(choice, &mut bytes);
    check_extent(&bytes);
    let Ok(packet) = Parsed::of(&bytes) else { return };
    check_parts(&bytes);
    let Some(at) = size_of(&packet) else { return };
    let shown = USED.with_borrow_mut(|used| used[at].decode(choice, &packet, &bytes));
    // What was decoded before must not show. A topside takes long to make, so one input in 256 is compared.
    if crc32fast::hash(input).is_multiple_of(256) {
        assert_eq!(Topside::new(SIZES[at]).decode(choice, &packet, &bytes), shown);
    }
}

/// What of the decoder an input reaches, if it is a packet that is decoded; for the test of the corpus.
#[allow(dead_code)]
pub fn reaches(input: &[u8]) -> Vec<String> {
    let Some((&choice, bytes)) = input.split_first() else { return Vec::new() };
    let mut bytes = bytes.to_vec();
    repair::repair(choice, &mut bytes);
    match Parsed::of(&bytes) {
        Ok(packet) if size_of(&packet).is_some() => topside::reaches(choice, &packet, &bytes),
        _ => Vec::new(),
    }
}

/// What the start of a packet says of the whole must hold.
fn check_extent(bytes: &[u8]) {
    let Ok(Extent { latent, head, valid, whole, .. }) = Extent::read(bytes) else { return };
    assert!(latent <= head && latent <= valid && valid <= bytes.len());
    assert!(whole.is_none_or(|whole| head <= whole && whole == valid));
}

/// What was read can be written.
fn check_parts(bytes: &[u8]) {
    if let Ok(packet) = Packet::decode(bytes) {
        let again = packet.encode().expect("what was read can be written");
        assert_eq!(Packet::decode(&again), Ok(packet));
    }
}

/// Which of [`SIZES`] a packet's picture has; `None`: another one.
fn size_of(packet: &Parsed) -> Option<usize> {
    match packet.session() {
        Ok(Some(session)) => {
            let size = (session.camera.width, session.camera.height);
            SIZES.iter().position(|own| *own == size)
        }
        _ => Some(usize::from(packet.latent().tag) % SIZES.len()),
    }
}
