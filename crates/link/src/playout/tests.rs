use crate::modem::{Loss, Sharer, Sharing, SharingOptions};
use crate::{Playout as Order, TopsideLink, TopsideOptions};
use nvsprior::packet::{
    Latent, Packet, PoseProfile, QuantisedPose, Residual, SHORT_LATENT_LEN, Session,
};
use nvsprior::prior::CoordinateFrame;
use nvsprior::{Camera, Pose, PriorId};

const RATE: f64 = 10.0;
const LATENCY: f64 = 1.0;
const MTU: usize = 64;
/// What the link takes.
const WAY: f64 = 0.25;

/// A packet that goes on.
#[derive(Debug, PartialEq)]
struct Played {
    frame: i64,
    time: f64,
    bytes: Vec<u8>,
    complete: bool,
    restarted: bool,
}

/// A topside's end that hands out packets in order.
struct Playout(TopsideLink);

impl Playout {
    fn new(frame_rate: Option<f64>) -> Playout {
        let playout = Order::InOrder { latency: LATENCY, frame_rate };
        let options = TopsideOptions { playout, report_every: None, ..TopsideOptions::new(MTU) };
        Playout(TopsideLink::new(&options).unwrap())
    }

    fn next(&mut self, now: f64) -> Option<Played> {
        let (due, packet) = self.0.next_packet(now).unwrap()?;
        Some(Played {
            frame: due.frame,
            time: due.time,
            bytes: packet.bytes.to_vec(),
            complete: packet.complete,
            restarted: due.restarted,
        })
    }
}

/// A packet of a frame number, as a vehicle makes it.
fn packet(frame: u32) -> Vec<u8> {
    let camera = Camera { width: 320, height: 180, fx: 274.4, fy: 274.4, cx: 160.0, cy: 90.0 };
    let site = CoordinateFrame { centre: [0.0; 3], spread: 5.0 };
    let pose = Pose::from_wxyz([1.0, 0.1, 0.0, 0.0], [0.1, 0.2, 3.0]).unwrap();
    let pose = QuantisedPose::quantise(&pose, &site, PoseProfile::Short).unwrap();
    let session = Session { prior: PriorId(7), camera };
    let latent = Latent::new(frame, &session, pose, false).unwrap();
    let payload: Vec<u8> = (0..120).map(|k| (k * 7 + frame) as u8 | 1).collect();
    let residual = Residual::Coded { small_blocks: false, payload: &payload };
    Packet { latent, session: None, render: None, residual, truth: None }.encode().unwrap()
}

/// Its shares: some yield the picture, more yield all.
fn shares(frame: u32) -> Vec<Vec<u8>> {
    let packet = packet(frame);
    let sharing = Sharing::new(&SharingOptions {
        mtu: 64,
        overhead: 0,
        budget: 500,
        max_shares: 8,
        spread: 0,
        loss: Loss { chance: 0.3, burst: 1.0 },
        picture: SHORT_LATENT_LEN,
        packet: Some(packet.len()),
        whole: true,
        user: None,
    });
    let sharing = sharing.unwrap();
    assert!(sharing.layers().len() == 2 && sharing.capacity() >= packet.len(), "{sharing:?}");
    let mut sharer = Sharer::default();
    sharer.share(&packet, &sharing, 0, None).unwrap();
    (0..sharer.count()).map(|k| sharer.get(k).to_vec()).collect()
}

fn taken(frame: u32) -> f64 {
    f64::from(frame) / RATE
}

/// Brings shares at `now`, and plays what is due.
fn bring(playout: &mut Playout, now: f64, shares: &[Vec<u8>]) -> Vec<Played> {
    shares.iter().for_each(|share| _ = playout.0.receive(now, share).unwrap());
    std::iter::from_fn(|| playout.next(now)).collect()
}

/// Whatever its number, and also if that share yields no picture.
#[test]
fn a_packet_counts_from_its_first_share() {
    for frame in [0, 127, 128, 200, 255, 256] {
        let mut playout = Playout::new(None);
        let shares = shares(frame);
        assert!(bring(&mut playout, 1.0, &shares[..1]).is_empty());
        let played = bring(&mut playout, 1.5, &shares[1..]);
        assert_eq!((played[0].frame, played[0].time), (frame.into(), 1.0));
    }
}

#[test]
fn complete_packets_go_on_at_once_and_evenly() {
    let mut playout = Playout::new(Some(RATE));
    let mut times = Vec::new();
    for frame in 0..20u32 {
        // Shares come up to 0.3 s late, at random.
        let late = f64::from(frame * 7 % 4) / 10.0;
        let played = bring(&mut playout, taken(frame) + WAY + late, &shares(frame));
        for played in played {
            assert!(played.complete && played.bytes == packet(played.frame as u32));
            assert_eq!(played.restarted, times.is_empty());
            times.push((played.frame, played.time));
        }
    }
    assert_eq!(times.len(), 20);
    for (frame, time) in times {
        let due = taken(frame as u32) + WAY;
        assert!((time - due).abs() < 0.01, "{frame}: {time} {due}");
    }
}

#[test]
fn a_packet_that_lacks_shares_goes_on_in_part_when_its_time_is_over() {
    let mut playout = Playout::new(Some(RATE));
    bring(&mut playout, WAY, &shares(0));
    // The next one has a picture, and no more.
    let some = &shares(1)[..2];
    assert!(bring(&mut playout, taken(1) + WAY, some).is_empty());
    // The one behind it is whole, and waits for its turn.
    assert!(bring(&mut playout, taken(2) + WAY, &shares(2)).is_empty());
    let deadline = playout.0.due().unwrap();
    assert!((deadline - (taken(1) + WAY + LATENCY)).abs() < 1e-6, "{deadline}");
    assert_eq!(playout.next(deadline - 1e-3), None);
    let first = playout.next(deadline).unwrap();
    assert!(!first.complete && first.bytes.len() < packet(1).len());
    assert!(packet(1).starts_with(&first.bytes) && first.bytes.len() >= SHORT_LATENT_LEN);
    assert_eq!(playout.next(deadline).unwrap().bytes, packet(2));
    assert_eq!((playout.next(deadline), playout.0.due()), (None, None));
}

#[test]
fn packets_of_which_too_little_came_are_left_out() {
    let mut playout = Playout::new(Some(RATE));
    bring(&mut playout, WAY, &shares(0));
    assert!(bring(&mut playout, taken(1) + WAY, &shares(1)[..1]).is_empty());
    assert!(bring(&mut playout, taken(3) + WAY, &shares(3)).is_empty(), "waits for 1");
    let played = bring(&mut playout, taken(1) + WAY + LATENCY + 1e-6, &[]);
    assert_eq!(played.len(), 1);
    assert_eq!(played[0].frame, 3);
    // What comes later is too late.
    assert!(bring(&mut playout, taken(12) + WAY, &shares(1)[1..]).is_empty());
    assert_eq!(playout.0.late(), 1);
}

#[test]
fn shares_between_each_other_keep_the_order_of_frames() {
    let mut playout = Playout::new(Some(RATE));
    let all = [shares(0), shares(1), shares(2)];
    let mut played = Vec::new();
    // The last one comes first.
    for k in 0..all.iter().map(Vec::len).max().unwrap() {
        for of in all.iter().rev() {
            if let Some(share) = of.get(k) {
                played.extend(bring(&mut playout, 0.5, std::slice::from_ref(share)));
            }
        }
    }
    assert_eq!(played.iter().map(|played| played.frame).collect::<Vec<_>>(), [0, 1, 2]);
    assert!(played.iter().all(|played| played.complete));
}

#[test]
fn a_blackout_ends_with_the_next_packet() {
    let mut playout = Playout::new(Some(RATE));
    for frame in (0..30).chain(100..130) {
        let played = bring(&mut playout, taken(frame) + WAY, &shares(frame));
        assert_eq!(played.len(), 1, "{frame}");
        assert!((played[0].time - taken(frame) - WAY).abs() < 0.01);
    }
}

#[test]
fn a_vehicle_that_starts_anew_is_followed() {
    let mut playout = Playout::new(Some(RATE));
    for frame in 0..200 {
        bring(&mut playout, taken(frame) + WAY, &shares(frame));
    }
    let mut played = Vec::new();
    for frame in 0..20 {
        played.extend(bring(&mut playout, 60.0 + taken(frame), &shares(frame)));
    }
    assert!(played.len() >= 15, "{}", played.len());
    assert!(played[0].restarted && !played[1].restarted);
    let last = played.last().unwrap();
    assert!((last.time - 60.0 - taken(19)).abs() < 0.01, "{}", last.time);
}

#[test]
fn frame_numbers_are_counted_on() {
    let mut playout = Playout::new(Some(RATE));
    for frame in 65_530..65_542u32 {
        let played = bring(&mut playout, taken(frame), &shares(frame % 65_536));
        assert_eq!(played[0].frame, i64::from(frame));
        assert!((played[0].time - taken(frame)).abs() < 1e-6);
    }
}

#[test]
fn clocks_that_run_apart_are_followed() {
    let mut playout = Playout::new(Some(RATE));
    for frame in 0..4000 {
        // The vehicle's clock is 0.02 % slow.
        let now = 1.0002 * taken(frame);
        let played = bring(&mut playout, now, &shares(frame));
        assert!((played[0].time - now).abs() < 0.02, "{frame}: {} {now}", played[0].time);
    }
}

#[test]
fn without_a_frame_rate_a_packet_has_the_time_of_its_first_share() {
    let mut playout = Playout::new(None);
    let of = shares(5);
    assert!(bring(&mut playout, 3.0, &of[..1]).is_empty());
    let played = bring(&mut playout, 3.2, &of[1..]);
    assert_eq!((played.len(), played[0].time), (1, 3.0));
}

#[test]
fn other_frames_on_the_link_do_no_harm() {
    let mut playout = Playout::new(Some(RATE));
    for junk in [&[][..], &[0x40], &[0xFF; 64]] {
        assert!(playout.0.receive(0.0, junk).is_err());
    }
    assert_eq!(bring(&mut playout, 0.1, &shares(0)).len(), 1);
    // Shares that come again bring nothing.
    assert!(bring(&mut playout, 0.2, &shares(0)).is_empty());
}

#[test]
fn a_packet_without_protection_is_played() {
    let mut playout = Playout::new(Some(RATE));
    let mut sharer = Sharer::default();
    sharer.split(&packet(3), MTU).unwrap();
    let frames: Vec<_> = sharer.shares().map(<[u8]>::to_vec).collect();
    assert_eq!(bring(&mut playout, 0.1, &frames).len(), 1);
    assert_eq!(bring(&mut playout, 0.2, &shares(4)).len(), 1, "a protected one may follow");
}
