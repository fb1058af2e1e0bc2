//! What `src/decoder.rs` does with the parts of a packet, with a formula in place of the device.

use nvsprior::coder_tables::Tables;
use nvsprior::packet::{Parsed, RenderCheck, Residual, ResidualStart};
use nvsprior::residual::{Placement, ResidualDecoder, ResidualError, StreamFrame, Viewpoint};
use nvsprior::truth::{Arrived, TruthDecoder, TruthMap};
use nvsprior::{Camera, Picture};

use super::reference::{self, HELD};

/// Bit of the first byte: the device of this side is not portable.
const NOT_PORTABLE: u8 = 1 << 4;
/// Bit of a truth map's first byte: it is predicted from a key map.
const PREDICTED: u8 = 1 << 2;

/// What shows of a packet.
#[derive(Debug, PartialEq)]
pub struct Shown {
    picture: Picture,
    outcome: Result<(), ResidualError>,
    truth: TruthMap,
    same_render: Option<bool>,
}

/// Decodes packets of pictures of one size.
pub struct Topside {
    render: Picture,
    depths: Vec<f32>,
    residual: ResidualDecoder,
    truth: TruthDecoder,
}

impl Topside {
    pub fn new((width, height): (u32, u32)) -> Topside {
        let mut render = Picture::new(width, height);
        for (at, value) in render.data.iter_mut().enumerate() {
            let (x, y) = (at as u32 / 3 % width, at as u32 / 3 / width);
            let edge = if (x / 9 + y / 7) % 3 == 0 { 60 } else { 0 };
            *value = (40 + x + y + edge + (x * 7919 + y * 104_729) % 23 + at as u32 % 3) as u8;
        }
        // Where nothing is drawn, a depth is not finite.
        let depth = |at| if at % 31 == 30 { f32::NAN } else { 1.0 + (at % 7) as f32 / 4.0 };
        Topside {
            render,
            depths: (0..width * height).map(depth).collect(),
            residual: ResidualDecoder::new(width, height, &Tables::generic()),
            truth: TruthDecoder::new(width, height),
        }
    }

    pub fn decode(&mut self, choice: u8, packet: &Parsed, bytes: &[u8]) -> Shown {
        let latent = packet.latent();
        let portable = latent.portable && choice & NOT_PORTABLE == 0;
        let frame = latent.frame_near(None);
        let viewpoint = self.viewpoint(packet);
        let told = packet.render().as_ref().ok().copied().flatten();
        let same_render = told.map(|check| check == RenderCheck::of(&self.render));
        let mut picture = self.render.clone();
        let stream = StreamFrame { frame, viewpoint: &viewpoint, depths: &self.depths };
        let read = Read { choice, packet, bytes };
        let outcome = add_residual(&mut self.residual, &read, &stream, portable, &mut picture);
        if outcome.is_err() {
            assert_eq!(picture, self.render, "an error changes nothing");
        }
        let mut truth = TruthMap::not_seen(picture.width, picture.height);
        self.read_truth(&read, outcome.is_ok(), &picture, &mut truth);
        Shown { picture, outcome, truth, same_render }
    }

    /// Where the packet is seen from: near the origin, by the pose's bits.
    fn viewpoint(&self, packet: &Parsed) -> Viewpoint {
        let Picture { width, height, .. } = self.render;
        let (fx, cx, cy) = (width as f32, width as f32 / 2.0, height as f32 / 2.0);
        let own = Camera { width, height, fx, fy: fx, cx, cy };
        let session = packet.session().as_ref().ok().copied().flatten();
        let camera = session.map_or(own, |session| session.camera);
        let words = packet.latent().pose.words().words;
        let words = words.map(|word| (word & 0xFFFF) as f32 / 65536.0);
        let [x, y, z, a, b, c, ..] = words;
        let length = f32::sqrt(1.0 + a * a + b * b + c * c);
        let rotation = [1.0, a, b, c].map(|part| part / length);
        Viewpoint { camera, placement: Placement { rotation, translation: [x, y, z] } }
    }

    /// Reads the truth map. One that is predicted comes after its key map, which has the same bytes.
    fn read_truth(&mut self, read: &Read, added: bool, picture: &Picture, map: &mut TruthMap) {
        let Some(bytes) = read.packet.truth(read.bytes) else { return };
        let frame = read.packet.latent().frame;
        if let [first, second, ..] = *bytes
            && first & PREDICTED != 0
        {
            let mut key = bytes.to_vec();
            key[0] = first & !PREDICTED;
            let distance = u32::from(second >> 4) + if read.choice & HELD == 0 { 1 } else { 0 };
            let number = frame.wrapping_sub(distance);
            self.truth.decode(number, &key, Arrived::All, &mut map.clone());
        }
        let arrived = match read.packet.residual(read.bytes) {
            Ok(Residual::None | Residual::Omitted) => Arrived::All,
            Ok(_) if added => Arrived::All,
            Err(_) if added => Arrived::Start { render: &self.render.data, picture: &picture.data },
            _ => return,
        };
        self.truth.decode(frame, bytes, arrived, map);
    }
}

/// A packet, its bytes, and how they are decoded.
struct Read<'a> {
    choice: u8,
    packet: &'a Parsed,
    bytes: &'a [u8],
}

/// What of the decoder a packet reaches.
#[allow(dead_code)]
pub fn reaches(choice: u8, packet: &Parsed, bytes: &[u8]) -> Vec<String> {
    let latent = packet.latent();
    let held = choice & HELD != 0 && choice & NOT_PORTABLE == 0 && latent.portable;
    let (residual, start, truth) =
        (packet.residual(bytes), packet.start(bytes), packet.truth(bytes));
    let small_blocks = match residual {
        Ok(Residual::Coded { small_blocks, .. } | Residual::Stream { small_blocks, .. }) => {
            small_blocks
        }
        _ => false,
    };
    let inter = match residual {
        Ok(Residual::Stream { reference, .. }) => reference.is_some(),
        _ => start.is_some_and(|start| start.reference.is_some()),
    };
    let is_predicted = truth.is_some_and(|map| map[0] & PREDICTED != 0);
    let of = [
        (small_blocks, "small blocks"),
        (packet.is_in_stream(), "stream"),
        (inter && held, "inter frame"),
        (inter && !held, "missing reference"),
        (start.is_some(), "start of a residual"),
        (truth.is_some(), "truth map"),
        (is_predicted, "truth map that is predicted"),
        (matches!(packet.session(), Ok(Some(_))), "session part"),
        (matches!(packet.render(), Ok(Some(_))), "render part"),
        (latent.uncertain, "uncertain pose"),
        (!latent.portable, "device that is not portable"),
        (latent.pose.is_short(), "short pose"),
        (!latent.pose.is_short(), "compact pose"),
    ];
    of.into_iter().filter(|(is, _)| *is).map(|(_, name)| name.to_owned()).collect()
}

/// Adds the residual, or the start of it that there is.
fn add_residual(
    decoder: &mut ResidualDecoder,
    read: &Read,
    frame: &StreamFrame,
    portable: bool,
    picture: &mut Picture,
) -> Result<(), ResidualError> {
    let Read { choice, packet, bytes } = *read;
    match (packet.residual(bytes), packet.start(bytes)) {
        (Ok(mut residual), _) => {
            if let Residual::Stream { reference: Some(reference), .. } = &mut residual {
                reference::provide(choice, reference, decoder, frame, picture);
            }
            decoder.add_in_stream(&residual, frame, portable, picture)
        }
        (Err(_), Some(start)) if start.reference.is_some() => {
            let mut reference = start.reference;
            let provide = |own| reference::provide(choice, own, decoder, frame, picture);
            reference.as_mut().into_iter().for_each(provide);
            let start = ResidualStart { reference, ..start };
            decoder.add_start_in_stream(&start, frame, portable, picture)
        }
        (Err(_), Some(start)) => decoder.add_start(&start, portable, picture),
        (Err(_), None) => Ok(()),
    }
}
