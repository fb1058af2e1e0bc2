//! What `src/decoder.rs` does with the parts of a packet, with a formula in place of the device.

use nvsprior::coder_tables::Tables;
use nvsprior::packet::{Coder, Latent, RenderCheck, Residual, ResidualStart, Salvage};
use nvsprior::residual::{Placement, ResidualDecoder, ResidualError, StreamFrame, Viewpoint};
use nvsprior::truth::{Arrived, TruthDecoder, TruthMap};
use nvsprior::{Camera, Picture};

use super::reference::{self, HELD};

/// Bit of the first byte: the device of this side is not portable.
const NOT_PORTABLE: u8 = 1 << 4;
/// Bit of a truth map's first byte: it is predicted from a key map.
const PREDICTED: u8 = 1 << 4;

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

    pub fn decode(&mut self, choice: u8, salvage: &Salvage) -> Shown {
        let latent = &salvage.latent;
        let portable = latent.portable && choice & NOT_PORTABLE == 0;
        let frame = latent.frame_near(None);
        let viewpoint = self.viewpoint(salvage);
        let told = salvage.render.as_ref().ok().copied().flatten();
        let same_render = told.map(|check| check == RenderCheck::of(&self.render));
        let mut picture = self.render.clone();
        let stream = StreamFrame { frame, viewpoint: &viewpoint, depths: &self.depths };
        let outcome =
            add_residual(&mut self.residual, choice, salvage, &stream, portable, &mut picture);
        if outcome.is_err() {
            assert_eq!(picture, self.render, "an error changes nothing");
        }
        let mut truth = TruthMap::not_seen(picture.width, picture.height);
        self.read_truth(choice, salvage, outcome.is_ok(), &picture, &mut truth);
        Shown { picture, outcome, truth, same_render }
    }

    /// Where the packet is seen from: near the origin, by the pose's bits.
    fn viewpoint(&self, salvage: &Salvage) -> Viewpoint {
        let Picture { width, height, .. } = self.render;
        let (fx, cx, cy) = (width as f32, width as f32 / 2.0, height as f32 / 2.0);
        let own = Camera { width, height, fx, fy: fx, cx, cy };
        let camera = salvage.camera.as_ref().ok().copied().flatten().unwrap_or(own);
        let words = salvage.latent.pose.words().words.map(|word| (word & 0xFFFF) as f32 / 65536.0);
        let [x, y, z, a, b, c, ..] = words;
        let length = (1.0 + a * a + b * b + c * c).sqrt();
        let rotation = [1.0, a, b, c].map(|part| part / length);
        Viewpoint { camera, placement: Placement { rotation, translation: [x, y, z] } }
    }

    /// Reads the truth map. One that is predicted comes after its key map, which has the same bytes.
    fn read_truth(
        &mut self,
        choice: u8,
        salvage: &Salvage,
        added: bool,
        picture: &Picture,
        map: &mut TruthMap,
    ) {
        let Some(bytes) = salvage.truth else { return };
        let frame = salvage.latent.frame;
        if let [first, second, ..] = *bytes
            && first & PREDICTED != 0
        {
            let mut key = bytes.to_vec();
            key[0] = first & !PREDICTED;
            let distance = u32::from(second >> 4) + if choice & HELD == 0 { 1 } else { 0 };
            let number = frame.wrapping_sub(distance) % Latent::FRAMES;
            self.truth.decode(number, &key, Arrived::All, &mut map.clone());
        }
        let arrived = match &salvage.residual {
            Ok(Residual::None | Residual::Omitted) => Arrived::All,
            Ok(_) if added => Arrived::All,
            Err(_) if added => Arrived::Start { render: &self.render.data, picture: &picture.data },
            _ => return,
        };
        self.truth.decode(frame, bytes, arrived, map);
    }
}

/// What of the decoder a packet reaches.
#[allow(dead_code)]
pub fn reaches(choice: u8, salvage: &Salvage) -> Vec<String> {
    let held = choice & HELD != 0 && choice & NOT_PORTABLE == 0 && salvage.latent.portable;
    let start = salvage.residual_start.filter(|_| salvage.residual.is_err());
    let (is_stream, small_blocks, inter) = match salvage.residual {
        Ok(Residual::Stream { reference, small_blocks, .. }) => {
            (true, small_blocks, reference.is_some())
        }
        Ok(Residual::Coded { coder, .. }) => (false, coder == Coder::SmallBlocks, false),
        _ => (false, false, start.is_some_and(|start| start.reference.is_some())),
    };
    let is_predicted = salvage.truth.is_some_and(|map| map[0] & PREDICTED != 0);
    let of = [
        (small_blocks, "small blocks"),
        (is_stream, "stream"),
        (inter && held, "inter frame"),
        (inter && !held, "missing reference"),
        (start.is_some(), "start of a residual"),
        (salvage.truth.is_some(), "truth map"),
        (is_predicted, "truth map that is predicted"),
        (matches!(salvage.camera, Ok(Some(_))), "camera part"),
        (matches!(salvage.render, Ok(Some(_))), "render part"),
    ];
    let names = of.into_iter().filter(|(is, _)| *is).map(|(_, name)| name.to_owned());
    names.chain([format!("version {}", salvage.latent.version())]).collect()
}

/// Adds the residual, or the start of it that there is.
fn add_residual(
    decoder: &mut ResidualDecoder,
    choice: u8,
    salvage: &Salvage,
    frame: &StreamFrame,
    portable: bool,
    picture: &mut Picture,
) -> Result<(), ResidualError> {
    match (&salvage.residual, salvage.residual_start) {
        (Ok(residual), _) => {
            let mut residual = *residual;
            if let Residual::Stream { reference: Some(reference), .. } = &mut residual {
                reference::provide(choice, reference, decoder, frame, picture);
            }
            decoder.add_in_stream(&residual, frame, portable, picture)
        }
        (
            Err(_),
            Some(ResidualStart { reference: Some(reference), coder, payload, payload_len }),
        ) => {
            let mut reference = reference;
            reference::provide(choice, &mut reference, decoder, frame, picture);
            let start = ResidualStart { reference: Some(reference), coder, payload, payload_len };
            decoder.add_start_in_stream(&start, frame, portable, picture).map(drop)
        }
        (Err(_), Some(start)) => {
            let rows = decoder.add_start(&start, portable, picture)?;
            assert!(rows <= picture.height);
            Ok(())
        }
        (Err(_), None) => Ok(()),
    }
}
