//! Shares and reports: shares of several packets, damaged ones and garbage, in any order; what is said of them, read
//! again.
use arbitrary::{Arbitrary, Unstructured};
use nvsprior::modem::{
    Collector, CollectorOptions, Loss, PacketState, Report, Sharer, Sharing, SharingOptions,
};
use nvsprior::packet::{Coder, Latent, PoseProfile, QuantisedPose, Residual};
use nvsprior::prior::CoordinateFrame;
use nvsprior::{Camera, Packet, Pose, PriorId};

/// Streams that are taken.
const STREAMS: usize = 2;

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
    full: bool,
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
    let (mut honest, mut now) = (true, 0.0);
    for arrival in &input.arrivals {
        let (share, after) = match arrival {
            Arrival::Garbage(bytes) => (bytes.clone(), 0),
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

/// Looks at all that a collector says of a stream. `sent`: what its bytes must be the start of.
fn look(collector: &Collector, stream: u8, sent: Option<&Vec<Shared>>) {
    if let Some(newest) = collector.newest(stream) {
        if newest.complete {
            Packet::decode(newest.bytes).expect("a complete packet is valid");
            assert_eq!(collector.missing(stream, newest.frame).count(), 0);
        }
        if let Some(sent) = sent {
            let known = sent.iter().any(|sent| sent.packet.starts_with(newest.bytes));
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
    let packet = packet(sent);
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
        whole: sent.full,
        user: user.as_ref().map(Vec::len),
    });
    let sharing = sharing.ok()?;
    let mut sharer = Sharer::default();
    sharer
        .share(&packet, &sharing, sent.stream % STREAMS as u8, user.as_deref())
        .expect("a valid packet");
    let shares = (0..sharer.count()).map(|index| sharer.get(index).to_vec()).collect();
    Some(Shared { packet, shares })
}

fn packet(sent: &Sent) -> Vec<u8> {
    let camera = Camera { width: 64, height: 36, fx: 60.0, fy: 60.0, cx: 32.0, cy: 18.0 };
    let frame = CoordinateFrame { centre: [0.0; 3], spread: 1.0 };
    let pose = Pose::exp(&[0.001 * f64::from(sent.frame % 512); 6]);
    let pose = QuantisedPose::quantise(&pose, &frame, PoseProfile::Short).expect("a pose in range");
    let latent = Latent::new(sent.frame.into(), PriorId(7), &camera, pose, false).expect("small");
    let latent = latent.shortened(PriorId(7), &camera).expect("small");
    let payload: Vec<u8> = (0..sent.payload).map(|i| i ^ sent.frame as u8).collect();
    let residual = Residual::Coded { coder: Coder::Vp8, payload: &payload };
    Packet { latent, camera: None, render: None, residual, truth: None }.encode().expect("a packet")
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
    let start = if share[1] & 0x10 != 0 { 4 } else { 3 };
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
