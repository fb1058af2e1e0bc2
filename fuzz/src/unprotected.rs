//! Unprotected packets: shares of several packets, damaged ones and garbage, in any order.
use arbitrary::{Arbitrary, Unstructured};
use nvsprior_link::modem::{Collector, CollectorOptions, Sharer, share_count};

use crate::vehicle::{self, Stated, check_complete, is_start};

#[derive(Arbitrary, Debug)]
struct Input {
    mtu: u8,
    room: u8,
    modem_checks: bool,
    packets: Vec<Sent>,
    arrivals: Vec<Arrival>,
}

/// A packet that the vehicle sends.
#[derive(Arbitrary, Debug)]
struct Sent {
    frame: u8,
    pose: u8,
    stated: bool,
    payload: Option<u8>,
}

#[derive(Arbitrary, Debug)]
enum Arrival {
    /// A share of a packet, with some padding, and one bit flipped or none.
    Frame {
        packet: u8,
        index: u8,
        padding: u8,
        flip: Option<u16>,
    },
    Garbage(Vec<u8>),
}

pub fn run(bytes: &[u8]) {
    let Ok(input) = Input::arbitrary_take_rest(Unstructured::new(bytes)) else { return };
    let mtu = 8 + usize::from(input.mtu);
    let shares = share_count(64 + 16 * usize::from(input.room), mtu).unwrap_or(8);
    let modem_checks = input.modem_checks;
    let options =
        CollectorOptions { shares, packets: 4, modem_checks, ..CollectorOptions::new(mtu) };
    let mut collector = Collector::new(options).expect("options in range");
    let packets: Vec<Vec<u8>> = input.packets.iter().take(8).map(packet).collect();
    // Only a check of sixteen bits tells shares of two packets with one tag apart. A fuzzer gets past that.
    let mut tags = [false; 4];
    let mut first_of_its_tag =
        |p: &Vec<u8>| !std::mem::replace(&mut tags[usize::from(p[2] & 3)], true);
    // Small modem frames have no check at all.
    let mut honest = mtu >= 16 && packets.iter().all(&mut first_of_its_tag);
    for arrival in &input.arrivals {
        let (frame, valid) = arrived(arrival, &packets, mtu);
        honest &= valid;
        let _ = collector.push(0.0, &frame);
        let _ = collector.report(0, |_| false).expect("a stream in range");
        if let Some(newest) = collector.newest(0) {
            let _ = collector.missing(0, newest.frame).count();
            if newest.complete {
                check_complete(newest.bytes);
            }
            if honest {
                let known = packets.iter().any(|packet| is_start(newest.bytes, packet));
                assert!(known, "bytes that nobody sent");
            }
        }
    }
}

fn packet(sent: &Sent) -> Vec<u8> {
    let stated = [Stated::Short, Stated::Compact, Stated::Predicted][usize::from(sent.pose) % 3];
    vehicle::packet(sent.frame.into(), 0.01, stated, sent.payload, sent.stated)
}

/// The frame, and whether it is as it was sent.
fn arrived(arrival: &Arrival, packets: &[Vec<u8>], mtu: usize) -> (Vec<u8>, bool) {
    match arrival {
        Arrival::Garbage(bytes) => (bytes.clone(), false),
        Arrival::Frame { packet, index, padding, flip } => {
            let Some(packet) = packets.get(usize::from(*packet) % packets.len().max(1)) else {
                return (Vec::new(), true);
            };
            let mut sharer = Sharer::default();
            // A small modem frame does not carry every packet.
            let Ok(()) = sharer.split(packet, mtu) else { return (Vec::new(), true) };
            let mut frame = sharer.get(usize::from(*index) % sharer.count()).to_vec();
            let padding = usize::from(*padding) % (mtu - frame.len() + 1);
            frame.extend(std::iter::repeat_n(0, padding));
            if let Some(bit) = flip {
                let bit = usize::from(*bit) % (8 * frame.len());
                frame[bit / 8] ^= 1 << (bit % 8);
            }
            (frame, flip.is_none())
        }
    }
}
