//! Pieces of updates: those of several updates, damaged ones and garbage, in any order; what comes out is an update
//! that was sent. Reports about them make the sender do anything but fail.
use arbitrary::{Arbitrary, Unstructured};
use nvsprior::PriorId;
use nvsprior::modem::{
    Collector, CollectorOptions, Loss, Protection, RateControlOptions, Report, Sender,
    SenderOptions, UpdateOptions,
};
use nvsprior::prior::{Learnt, NewSplat, StateId, Update, UpdateGrid};

#[derive(Arbitrary, Debug)]
struct Input {
    mtu: u8,
    loss: u8,
    reports: bool,
    updates: Vec<Sent>,
    steps: Vec<Step>,
}

/// An update that the vehicle sends.
#[derive(Arbitrary, Debug)]
struct Sent {
    splats: u8,
    seed: u8,
}

#[derive(Arbitrary, Debug)]
enum Step {
    /// The next piece, with padding, and one bit flipped or none. If one is, its check may be made right again.
    Piece {
        after: u8,
        padding: u8,
        flip: Option<u16>,
        repair: bool,
    },
    /// It does not arrive.
    Lost,
    /// What came whole is added, or is not.
    Settle(bool),
    /// A report of any bytes, with its check made right.
    Report(Vec<u8>),
    Garbage(Vec<u8>),
}

pub fn run(bytes: &[u8]) {
    let Ok(input) = Input::arbitrary_take_rest(Unstructured::new(bytes)) else { return };
    let mtu = 16 + usize::from(input.mtu) % 64;
    let mut sender = sender(mtu, input.loss, input.reports);
    let chain = chain(&input.updates);
    let sent: Vec<_> =
        chain.into_iter().take_while(|update| sender.push_update(0.0, update).is_ok()).collect();
    let options = CollectorOptions { update_bytes: 1000, ..CollectorOptions::new(mtu) };
    let mut collector = Collector::new(options).expect("options in range");
    let mut now = 0.0;
    for step in &input.steps {
        match step {
            Step::Piece { after, padding, flip, repair } => {
                now += f64::from(*after) / 16.0;
                let Some((_, piece)) = sender.next(now) else { continue };
                assert!(piece.len() <= mtu);
                let mut piece = piece.to_vec();
                if let Some(bit) = flip {
                    damage(&mut piece, (*bit).into(), *repair);
                }
                piece.extend(std::iter::repeat_n(0xA5, usize::from(*padding) % 8));
                let _ = collector.push(now, &piece);
            }
            Step::Lost => drop(sender.next(now)),
            Step::Settle(added) => collector.settle_update(0, *added),
            Step::Report(bytes) => report(&mut sender, now, bytes),
            Step::Garbage(bytes) => drop(collector.push(now, bytes)),
        }
        if let Some(update) = collector.update(0) {
            assert!(sent.iter().any(|sent| sent == update), "an update that nobody sent");
        }
        assert!(sender.held_update().is_none_or(|held| usize::from(held) <= sent.len()));
    }
}

fn sender(mtu: usize, loss: u8, expect_reports: bool) -> Sender {
    let control = RateControlOptions {
        bit_rate: 5_000.0,
        mtu,
        overhead: 0,
        latency: 1.5,
        delay: 0.1,
        spread: 0.0,
        frame_rate: 2.0,
        min_bytes: 40,
        max_shares: 4,
        loss: Loss { chance: f64::from(loss) / 256.0, burst: 1.0 },
        user: None,
    };
    let updates = Some(UpdateOptions { memory: 4096, ..UpdateOptions::default() });
    let protection = Protection::Layers;
    let options = SenderOptions { control, stream: 0, protection, expect_reports, updates };
    Sender::new(options).expect("options in range")
}

fn chain(sent: &[Sent]) -> Vec<Vec<u8>> {
    let mut learnt = Learnt::none(PriorId(7));
    let next = |sent: &Sent| {
        let splat = |k: u8| NewSplat {
            position: [i32::from(k), i32::from(k ^ sent.seed), 0],
            opacity: (sent.seed % 8) as i8,
            ..NewSplat::default()
        };
        let update = Update {
            prior: learnt.prior(),
            number: learnt.number() + 1,
            before: learnt.state(),
            grid: UpdateGrid { origin: [0.0; 3], exponent: -4 },
            splats: (0..sent.splats % 64).map(splat).collect(),
            removed: vec![],
            changed: vec![],
            fades: vec![],
            frames: [0, 1],
        };
        let mut bytes = Vec::new();
        update.write(&mut bytes).expect("a valid update");
        learnt.add(&update).expect("the next one of the chain");
        bytes
    };
    sent.iter().take(6).map(next).collect()
}

/// Takes a report of some bytes, and one that tells of any states.
fn report(sender: &mut Sender, now: f64, bytes: &[u8]) {
    let check = CHECK.checksum(bytes).to_le_bytes();
    let Ok((report, _)) =
        Report::read(&[bytes, &check].concat()).map(|(r, user)| (r, user.is_some()))
    else {
        return;
    };
    let _ = sender.process_report(now, &report);
    let mut told = report;
    let states = bytes.chunks_exact(3);
    told.tell_states(
        states.map(|s| (s[0].into(), StateId(u32::from_le_bytes([s[1], s[2], 0, 0])))),
    );
    let mut again = [0; 512];
    let len = told.write(None, &mut again).expect("room for a report");
    assert_eq!(Report::read(&again[..len]).map(|(report, _)| report.stream()), Ok(told.stream()));
    let _ = sender.process_report(now, &told);
}

const CHECK: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);

/// Flips a bit of a piece; may make its check right again.
fn damage(piece: &mut [u8], bit: usize, repair: bool) {
    let bit = bit % (8 * piece.len());
    piece[bit / 8] ^= 1 << (bit % 8);
    let head = 7 + piece[6..].iter().take_while(|byte| **byte >= 0x80).count();
    if !repair || head + 2 > piece.len() {
        return;
    }
    let mut digest = CHECK.digest();
    digest.update(&piece[..head]);
    digest.update(&piece[head + 2..]);
    piece[head..head + 2].copy_from_slice(&digest.finalize().to_le_bytes());
}
