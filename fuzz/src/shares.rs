//! Shares and reports: shares of several packets, damaged ones and garbage, in any order; what is said of them, read
//! again.
use arbitrary::{Arbitrary, Unstructured};
use nvsprior_link::modem::{
    Collector, CollectorOptions, Loss, PacketState, Report, Sharer, Sharing, SharingOptions,
};

use crate::vehicle::{self, Stated, check_complete, is_predicted, is_start};

/// Streams that are taken.
const STREAMS: usize = 2;
/// High two bits of an unprotected packet's first share.
const START: u8 = 0b10;

#[derive(Arbitrary, Debug)]
struct Input {
    mtu: u8,
    room: u8,
    packets: Vec<Sent>,
    arrivals: Vec<Arrival>,
}

/// A packet that the vehicle sends.
#[derive(Arbitrary, Debug)]
struct Sent {
    frame: u16,
    /// Bits: all of it is sent, whatever the budget; its pose is predicted.
    kind: u8,
    payload: u8,
    budget: u16,
    max: u8,
    loss: u8,
    user: Option<u8>,
    stream: u8,
}

#[derive(Arbitrary, Debug)]
enum Arrival {
    /// A share of a packet, so many seconds after the one before, with padding, and one bit flipped or none. If one is,
    /// its check may be made right again.
    Share {
        packet: u8,
        index: u8,
        after: u8,
        padding: u8,
        flip: Option<u16>,
        repair: bool,
    },
    Garbage(Vec<u8>),
}

struct Shared {
    stream: u8,
    packet: Vec<u8>,
    shares: Vec<Vec<u8>>,
}

pub fn run(bytes: &[u8]) {
    let Ok(input) = Input::arbitrary_take_rest(Unstructured::new(bytes)) else { return };
    let mtu = 16 + usize::from(input.mtu) % 64;
    // Small, so that many runs fit a second.
    let shares = 1 + usize::from(input.room) % 16;
    let options =
        CollectorOptions { shares, packets: 4, streams: STREAMS, ..CollectorOptions::new(mtu) };
    let mut collector = Collector::new(options).expect("options in range");
    let sent: Vec<_> = input.packets.iter().take(4).filter_map(|sent| shared(sent, mtu)).collect();
    let (mut honest, mut now) = (tell_apart(&sent), 0.0);
    for arrival in &input.arrivals {
        let (share, after) = match arrival {
            Arrival::Garbage(bytes) => {
                // No check vouches for an unprotected packet whose pose is predicted.
                honest &= bytes.first().is_none_or(|first| first >> 6 != START);
                (bytes.clone(), 0)
            }
            Arrival::Share { packet, index, after, padding, flip, repair } => {
                let Some(shared) = sent.get(usize::from(*packet) % sent.len().max(1)) else {
                    return;
                };
                let mut share = shared.shares[usize::from(*index) % shared.shares.len()].clone();
                if let Some(bit) = flip {
                    damage(&mut share, *bit, *repair);
                    honest &= !repair;
                }
                share.extend(std::iter::repeat_n(0xA5, usize::from(*padding) % 8));
                (share, *after)
            }
        };
        now += f64::from(after) / 64.0;
        let _ = collector.push(now, &share);
        (0..STREAMS as u8).for_each(|stream| look(&collector, stream, honest.then_some(&sent)));
    }
    let _ = Report::read(bytes);
}

/// Whether no packet's shares can be taken for another's. Those of absolute poses have a check that tells.
fn tell_apart(sent: &[Shared]) -> bool {
    let name = |sent: &Shared| (sent.stream, sent.packet[2]);
    let mut names: Vec<_> = sent.iter().map(name).collect();
    names.sort_unstable();
    names.dedup();
    names.len() == sent.len() || !sent.iter().any(|sent| is_predicted(&sent.packet))
}

/// Looks at all that a collector says of a stream. `sent`: what its bytes must be the start of.
fn look(collector: &Collector, stream: u8, sent: Option<&Vec<Shared>>) {
    if let Some(newest) = collector.newest(stream) {
        if newest.complete {
            check_complete(newest.bytes);
            assert_eq!(collector.missing(stream, newest.frame).count(), 0);
        }
        if let Some(sent) = sent {
            let known = sent.iter().any(|sent| is_start(newest.bytes, &sent.packet));
            assert!(known, "bytes that nobody sent");
        }
    }
    let report = collector.report(stream, |frame| frame % 2 == 0).expect("a stream in range");
    let Some(report) = report else { return };
    let mut bytes = [0; 4096];
    let len = report.write(Some(b"user"), &mut bytes).expect("room for a report");
    let (read, user) = Report::read(&bytes[..len]).expect("what was written is read");
    assert_eq!(user, Some(&b"user"[..]));
    for ((number, found), (written, said)) in read.packets().zip(report.packets()) {
        assert_eq!((number, found.state), (written, said.state));
        assert!(found.state != PacketState::Part || found.shares == said.shares);
    }
}

fn shared(sent: &Sent, mtu: usize) -> Option<Shared> {
    let stated = if sent.kind & 2 == 0 { Stated::Short } else { Stated::Predicted };
    let packet = vehicle::packet(sent.frame, 0.001, stated, Some(sent.payload), false);
    let user = sent.user.map(|len| vec![len; usize::from(len)]);
    let sharing = Sharing::new(&SharingOptions {
        mtu,
        overhead: 0,
        budget: usize::from(sent.budget) % 1024,
        max_shares: 1 + usize::from(sent.max) % 8,
        spread: 0,
        loss: Loss { chance: f64::from(sent.loss) / 256.0, burst: 1.0 },
        picture: 19,
        packet: Some(packet.len()),
        whole: sent.kind & 1 != 0,
        user: user.as_ref().map(Vec::len),
    });
    let sharing = sharing.ok()?;
    let mut sharer = Sharer::default();
    let stream = sent.stream % STREAMS as u8;
    sharer.share(&packet, &sharing, stream, user.as_deref()).expect("a valid packet");
    let shares = (0..sharer.count()).map(|index| sharer.get(index).to_vec()).collect();
    Some(Shared { stream, packet, shares })
}

/// Flips a bit of a share; may make its check right again.
fn damage(share: &mut [u8], bit: u16, repair: bool) {
    const CHECK: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);
    let bit = usize::from(bit) % (8 * share.len());
    share[bit / 8] ^= 1 << (bit % 8);
    if !repair {
        return;
    }
    let numbers = |share: &[u8], from: usize| {
        from + share[from..].iter().take_while(|byte| **byte >= 0x80).count() + 1
    };
    let start = if share[1] & 8 != 0 { 4 } else { 3 };
    let head = numbers(share, start).min(share.len());
    let head = numbers(share, head);
    if head + 2 > share.len() {
        return;
    }
    let mut digest = CHECK.digest();
    digest.update(&share[..head]);
    digest.update(&share[head + 2..]);
    share[head..head + 2].copy_from_slice(&digest.finalize().to_le_bytes());
}
