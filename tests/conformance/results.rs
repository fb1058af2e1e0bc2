//! What the library makes of a vector's records, as the manifest states it.

use std::collections::BTreeSet;
use std::sync::Arc;

use md5::{Digest, Md5};
use nvsprior::packet::PacketError;
use nvsprior::prior::PriorError;
use nvsprior::render::Scene;
use nvsprior::residual::ResidualError;
use nvsprior::{Decoded, Decoder, Error, Prior, Trust};
use nvsprior_link::keys::{Content, Refusal, Verifier};
use nvsprior_link::modem::{Collector, CollectorOptions, ModemError, Report};
use serde_json::{Value, json};

use crate::common::engine;
use crate::vector::{Kind, Vector};

pub fn md5(parts: &[&[u8]]) -> String {
    let mut hasher = Md5::new();
    parts.iter().for_each(|part| hasher.update(part));
    hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// What came of a vector.
#[derive(Default)]
pub struct Outcome {
    /// One per record.
    pub records: Vec<Value>,
    /// Of a link: the packets that came of its modem frames.
    pub packets: Vec<Value>,
    /// All pictures, one after another.
    pub pictures: Vec<Vec<u8>>,
}

/// What the library makes of a vector about a prior.
pub fn of(vector: &Vector, prior: &Prior) -> Outcome {
    let mut outcome = Outcome::default();
    match &vector.kind {
        Kind::Packets { trust } => {
            let mut decoder = decoder(vector, &scene(prior));
            let mut taken = BTreeSet::new();
            for record in &vector.records {
                let value = match content(vector, record, &mut taken) {
                    Ok(record) => decode(&mut decoder, record, *trust, &mut outcome.pictures),
                    Err(refusal) => json!({ "refused": of_refusal(refusal) }),
                };
                outcome.records.push(value);
            }
        }
        Kind::Link { options, mtu } => link(vector, prior, options, *mtu, &mut outcome),
        Kind::Reports => {
            let mut verifier =
                vector.keys.as_ref().map(|keys| Verifier::new(&keys.keys(), Content::Report));
            let of = |record: &Vec<u8>| match verifier.as_mut().map(|by| by.verify(record)) {
                None => report(record),
                Some(Ok(verified)) => report(verified.content),
                Some(Err(refusal)) => json!({ "refused": of_refusal(refusal) }),
            };
            outcome.records = vector.records.iter().map(of).collect();
        }
        Kind::Priors => outcome.records = vector.records.iter().map(|r| read_prior(r)).collect(),
    }
    outcome
}

/// A packet in a file without its tag. With keys each number of a key is taken once, in any order.
fn content<'a>(
    vector: &Vector,
    record: &'a [u8],
    taken: &mut BTreeSet<(u32, u64)>,
) -> Result<&'a [u8], Refusal> {
    let Some(keys) = &vector.keys else { return Ok(record) };
    let verified = Verifier::new(&keys.keys(), Content::Packet).verify(record)?;
    let is_new = taken.insert((verified.key.0, verified.number));
    if is_new { Ok(verified.content) } else { Err(Refusal::Replayed) }
}

fn of_refusal(refusal: Refusal) -> &'static str {
    match refusal {
        Refusal::Foreign => "foreign",
        Refusal::Replayed => "replayed",
    }
}

fn scene(prior: &Prior) -> Arc<Scene> {
    engine().upload(prior).unwrap()
}

fn decoder(vector: &Vector, scene: &Arc<Scene>) -> Decoder {
    let mut decoder = Decoder::new(&engine(), scene);
    for camera in &vector.cameras {
        decoder.add_camera(camera).unwrap();
    }
    decoder
}

fn decode(decoder: &mut Decoder, record: &[u8], trust: Trust, all: &mut Vec<Vec<u8>>) -> Value {
    let mut decoded = Decoded::default();
    match decoder.decode_into(record, trust, &mut decoded) {
        Ok(()) => {
            let value = told(&decoded);
            all.push(decoded.picture.data);
            value
        }
        Err(error) => json!({ "refused": name_of(&error) }),
    }
}

/// Only what differs from a plain frame.
fn told(decoded: &Decoded) -> Value {
    let mut value = json!({ "frame": decoded.frame, "md5": md5(&[&decoded.picture.data]) });
    let mut tell = |name: &str, what: Value| value[name] = what;
    if let Some(error) = &decoded.damage {
        tell("damage", json!(name_of(error)));
    }
    if decoded.uncertain {
        tell("uncertain", json!(true));
    }
    if let Some(known) = decoded.known {
        tell("known", json!([known.position, known.rotation]));
    }
    if !decoded.portable {
        tell("portable", json!(false));
    }
    if let Some(same) = decoded.same_render {
        tell("same_render", json!(same));
    }
    if decoded.kept {
        tell("kept", json!(true));
    }
    if let Some(frame) = decoded.reference {
        tell("reference", json!(frame));
    }
    if let Some([first, _]) = decoded.truth.thresholds {
        let levels: String = decoded.truth.levels.iter().map(|level| level.to_string()).collect();
        tell("truth", json!({ "threshold": first, "levels": levels }));
    }
    value
}

fn link(
    vector: &Vector,
    prior: &Prior,
    options: &CollectorOptions,
    mtu: usize,
    outcome: &mut Outcome,
) {
    let options = CollectorOptions { mtu, ..*options };
    let collector = match &vector.keys {
        Some(keys) => Collector::with_keys(options, &keys.keys()),
        None => Collector::new(options),
    };
    let mut collector = collector.unwrap();
    let mut decoder = decoder(vector, &scene(prior));
    for record in &vector.records {
        outcome.records.push(match collector.push(0.0, record) {
            Ok(_) => json!({}),
            Err(error) => json!({ "refused": of_modem(&error) }),
        });
    }
    for stream in 0..options.streams as u8 {
        for frame in vector.frames.clone() {
            let Some(packet) = collector.packet(stream, frame) else { continue };
            let picture = decode(&mut decoder, packet.bytes, Trust::Start, &mut outcome.pictures);
            outcome.packets.push(json!({
                "stream": stream, "frame": packet.frame, "bytes": md5(&[packet.bytes]),
                "complete": packet.complete, "user": packet.user.map(hex), "picture": picture,
            }));
        }
    }
}

fn report(record: &[u8]) -> Value {
    let (report, user) = match Report::read(record) {
        Ok(read) => read,
        Err(error) => return json!({ "refused": of_modem(&error) }),
    };
    let packets = report.packets().map(|(number, packet)| {
        let shares = (0..packet.shares.sent()).filter(|index| packet.shares.contains(*index));
        let shares: Vec<usize> = shares.collect();
        json!([number, packet.state as u8, packet.arrived, packet.shares.sent(), shares])
    });
    let packets: Vec<Value> = packets.collect();
    let poses: Vec<u32> = report.poses().filter(|(_, held)| *held).map(|(n, _)| n).collect();
    json!({
        "stream": report.stream(), "newest": report.newest(), "packets": packets,
        "user": user.map(hex), "poses": poses, "told": report.poses().count(),
    })
}

fn read_prior(record: &[u8]) -> Value {
    match Prior::from_bytes(record, "vector", &Default::default()) {
        Ok(prior) => json!({
            "id": prior.id().to_string(), "splats": prior.len(),
            "key_frames": prior.key_frames().len(),
            "tables": prior.coder_tables().map(|tables| md5(&[&tables.write()])),
        }),
        Err(error) => json!({ "refused": of_prior(&error) }),
    }
}

fn name_of(error: &Error) -> &'static str {
    match error {
        Error::Packet(error) => of_packet(error),
        Error::Residual(error) => of_residual(error),
        Error::SessionUnknown { .. } => "session-unknown",
        Error::Estranged { .. } => "estranged",
        Error::Camera(_) => "session",
        other => panic!("{other}"),
    }
}

fn of_packet(error: &PacketError) -> &'static str {
    match error {
        PacketError::TooShort { .. } => "too-short",
        PacketError::Version => "version",
        PacketError::Check(_) => "check",
        PacketError::Pose => "pose",
        PacketError::Camera(_) => "session",
        PacketError::SessionTag { .. } => "session-tag",
        PacketError::Coder(_) => "coder",
        PacketError::Truth => "truth",
        PacketError::Reference => "reference",
        PacketError::PoseNotHeld { .. } => "pose-not-held",
        PacketError::Prior { .. } => "prior",
        other => panic!("{other}"),
    }
}

fn of_residual(error: &ResidualError) -> &'static str {
    match error {
        ResidualError::OtherRender => "other-render",
        ResidualError::ReferenceMissing { .. } => "reference-missing",
        ResidualError::Payload(_) | ResidualError::Size { .. } => "payload",
        other => panic!("{other}"),
    }
}

fn of_modem(error: &ModemError) -> &'static str {
    match error {
        ModemError::Key(refusal) => of_refusal(*refusal),
        ModemError::NotAFrame(_) => "not-a-frame",
        ModemError::Cut { .. } => "cut",
        ModemError::ShareCheck | ModemError::ReportCheck => "check",
        ModemError::Packet(error) => of_packet(error),
        ModemError::NoRoom { .. } => "no-room",
        ModemError::OtherShare(_) => "other-share",
        ModemError::Stream(_) => "stream",
        other => panic!("{other}"),
    }
}

fn of_prior(error: &PriorError) -> &'static str {
    match error {
        PriorError::InFile { error, .. }
        | PriorError::InPart { error, .. }
        | PriorError::InBlock { error, .. } => of_prior(error),
        PriorError::UnknownFormat => "magic",
        PriorError::Newer { .. } => "version",
        PriorError::Truncated { .. } => "truncated",
        PriorError::Damaged { .. } => "damaged",
        PriorError::Identity { .. } => "identity",
        PriorError::UnknownPart { .. } => "unknown-part",
        _ => "content",
    }
}
