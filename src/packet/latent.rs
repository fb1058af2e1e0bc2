//! The latent part: header and pose, a picture by itself.

use crate::Camera;
use crate::prior::PriorId;

use super::bytes::{Reader, crc16, from_u24, to_u24};
use super::camera_tag::size_bytes;
use super::error::{PacketError, Part};
use super::form::{FRAMES, Follows, Form, LEARNT_SHORT_LEN, SHORT_FRAMES, SHORT_LATENT_LEN};
use super::pose::{PoseProfile, QuantisedPose};
use super::predicted::Prediction;
use super::residual::{Check, SMALL_BLOCKS, may_be_predicted, residual_part_len};
use super::session::Session;

/// High four bits of the first byte.
const MAGIC: u8 = 0xB;
/// Version of the full form, in the low four bits of the first byte, if the encoder's device is portable.
const VERSION: u8 = 1;
/// Version of the full form if the encoder's device is not portable. The layout is the same.
const VERSION_NOT_PORTABLE: u8 = 2;
/// The two versions of the short form. Any two of these versions differ in two bits or more, and no flags of the
/// full form are flags of the short one. So only three flipped bits make one form read as the other.
const VERSION_SHORT: u8 = 4;
const VERSION_SHORT_NOT_PORTABLE: u8 = 7;
/// The versions of frames that are drawn with updates, in the same order. They differ from those and from each other in
/// two bits or more, too.
const VERSION_LEARNT: u8 = 8;
const VERSION_LEARNT_NOT_PORTABLE: u8 = 11;
const VERSION_LEARNT_SHORT: u8 = 13;
const VERSION_LEARNT_SHORT_NOT_PORTABLE: u8 = 14;
/// Versions of portable devices.
const PORTABLE: [u8; 4] = [VERSION, VERSION_SHORT, VERSION_LEARNT, VERSION_LEARNT_SHORT];
/// Stands in the flags of the short form for its profile if the residual has small blocks. It differs from that in two
/// bits, and in one from all of the full form: still only three flipped bits make one form read as the other.
const SMALL_BLOCKS_CODE: u8 = 0b00;
const FLAG_UNCERTAIN: u8 = 1 << 2;
const FLAG_CAMERA: u8 = 1 << 3;
const FLAG_RENDER: u8 = 1 << 7;

/// What a packet says first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Latent {
    /// Frame number; its low 24 bits travel, in the short form and with updates 16.
    pub frame: u32,
    /// The prior, or the state after its updates, and the camera to render with.
    pub session: Session,
    /// The number of the last update that the frame is drawn with, modulo 256; `None`: it is drawn with none.
    pub update: Option<u8>,
    /// The pose to render at.
    pub pose: QuantisedPose,
    /// The pose is not certain: the picture does not confirm it.
    pub uncertain: bool,
    /// The encoder's device draws what every portable device draws.
    pub portable: bool,
    /// The pose as the predicted form states it; `None`: the part has another form, or was read.
    pub predicted: Option<Prediction>,
}

impl Follows {
    pub(super) fn of_flags(flags: u8) -> Follows {
        let form = if flags & 0b11 == SMALL_BLOCKS_CODE { SMALL_BLOCKS } else { 0 };
        Follows {
            camera: flags & FLAG_CAMERA != 0,
            render: flags & FLAG_RENDER != 0,
            residual: flags >> 4 & 0b111 | form,
        }
    }
}

impl Latent {
    /// Frame numbers are sent modulo this.
    pub const FRAMES: u32 = FRAMES;
    /// In the short form, modulo this; see [`Latent::frame_near`].
    pub const SHORT_FRAMES: u32 = SHORT_FRAMES;

    /// The latent part of a frame seen by `camera`, on a portable device, in the full form.
    pub fn new(
        frame: u32,
        prior: PriorId,
        camera: &Camera,
        pose: QuantisedPose,
        uncertain: bool,
    ) -> Result<Latent, PacketError> {
        let (frame, session) = (frame % Self::FRAMES, Session::stated(prior, camera)?);
        let (update, predicted) = (None, None);
        Ok(Latent { frame, session, update, pose, uncertain, portable: true, predicted })
    }

    /// Says that the frame is drawn with updates. Its session is then of the state after them, as if that were the
    /// prior.
    pub fn with_update(self, number: u16) -> Latent {
        Latent { frame: self.frame % Self::SHORT_FRAMES, update: Some(number as u8), ..self }
    }

    /// Gives it the short form, for a topside that knows prior and camera. Unchanged if the short form cannot hold the
    /// pose.
    pub fn shortened(self, prior: PriorId, camera: &Camera) -> Result<Latent, PacketError> {
        if !self.pose.is_short() {
            return Ok(self);
        }
        let (frame, session) = (self.frame % Self::SHORT_FRAMES, Session::tagged(prior, camera)?);
        Ok(Latent { frame, session, ..self })
    }

    /// The frame number modulo 2²⁴. A short form states only the low 16 bits: of the numbers that
    /// end in them, this is the one nearest to `last`, the number of a packet read before. If
    /// `last` is `None`, it is the 16 bits. It is right unless 32,768 packets in a row are missing.
    pub fn frame_near(&self, last: Option<u32>) -> u32 {
        match self.form().frames() {
            Self::FRAMES => self.frame,
            frames => nearest_frame(self.frame, frames, last),
        }
    }

    /// Reads the latent part at the start of `bytes`, and nothing after it.
    pub fn decode(bytes: &[u8]) -> Result<Latent, PacketError> {
        Latent::read(bytes).map(|(latent, _, _)| latent)
    }

    /// Checks that the packet is about the prior at hand. In the short form that takes the camera too: see
    /// [`Session::check`].
    pub fn check_prior(&self, held: PriorId) -> Result<(), PacketError> {
        match self.session {
            Session::Stated { prior, .. } if prior != held => {
                Err(PacketError::Prior { packet: prior, held })
            }
            _ => Ok(()),
        }
    }

    /// Version of the wire format, as the first byte states it.
    pub fn version(&self) -> u8 {
        let Form { full, learnt, .. } = self.form();
        match (full.is_some(), learnt, self.portable) {
            (true, false, true) => VERSION,
            (true, false, false) => VERSION_NOT_PORTABLE,
            (false, false, true) => VERSION_SHORT,
            (false, false, false) => VERSION_SHORT_NOT_PORTABLE,
            (true, true, true) => VERSION_LEARNT,
            (true, true, false) => VERSION_LEARNT_NOT_PORTABLE,
            (false, true, true) => VERSION_LEARNT_SHORT,
            (false, true, false) => VERSION_LEARNT_SHORT_NOT_PORTABLE,
        }
    }

    /// Whether it is written in the short form, or in the predicted one.
    pub fn is_short(&self) -> bool {
        self.form().full.is_none()
    }

    pub(super) fn form(&self) -> Form {
        let full = match self.session {
            Session::Stated { .. } => Some(self.pose.profile()),
            Session::Tagged(_) => None,
        };
        let predicted = self.predicted.map(|prediction| prediction.latent_len());
        Form { full, learnt: self.update.is_some(), predicted }
    }

    /// Whether it is written in the predicted form.
    pub fn is_predicted(&self) -> bool {
        self.predicted.is_some()
    }

    /// Bytes at the start of the packet that shares tell by themselves: the frame number of the predicted form.
    pub fn told_by_shares(&self) -> usize {
        usize::from(self.is_predicted())
    }

    /// Bytes by which a packet of at most `budget` bytes is shorter on a link than [`residual_part_len`] says.
    /// `others`: those that are not the residual part.
    ///
    /// [`residual_part_len`]: super::residual_part_len
    pub fn spared(&self, budget: Option<usize>, others: usize) -> usize {
        let check = Check::of(self.form());
        let check_len = Check::Crc32.len() - check.len();
        if check.has_length() {
            return check_len;
        }
        let told = self.told_by_shares();
        let payload =
            budget.map_or(0, |budget| (budget + told).saturating_sub(others + check.len()));
        check_len + told + residual_part_len(payload) - Check::Crc32.len() - payload
    }

    /// Length of the part, bytes.
    pub fn encoded_len(&self) -> usize {
        self.form().latent_len()
    }

    /// Length of the full form, bytes.
    pub fn full_len(profile: PoseProfile) -> usize {
        Form { full: Some(profile), learnt: false, predicted: None }.latent_len()
    }

    /// Writes the part at the start of an empty packet.
    pub(super) fn write(&self, follows: &Follows, bytes: &mut Vec<u8>) -> Result<(), PacketError> {
        if let Some(prediction) = &self.predicted {
            self.check_predicted(follows)?;
            prediction.write(follows, self.frame, bytes);
            return Ok(());
        }
        let code = match (self.form().full, follows.residual & SMALL_BLOCKS != 0) {
            (full, false) => full.unwrap_or(PoseProfile::Short).code(),
            (None, true) => SMALL_BLOCKS_CODE,
            (Some(_), true) => return Err(PacketError::SmallBlocks),
        };
        let flags = code
            | if self.uncertain { FLAG_UNCERTAIN } else { 0 }
            | if follows.camera { FLAG_CAMERA } else { 0 }
            | if follows.render { FLAG_RENDER } else { 0 }
            | (follows.residual & !SMALL_BLOCKS) << 4;
        bytes.extend_from_slice(&[MAGIC << 4 | self.version(), flags]);
        match self.session {
            Session::Stated { prior, width, height, camera_tag } => {
                self.write_frame(bytes);
                bytes.extend_from_slice(&prior.to_bytes());
                bytes.extend_from_slice(&size_bytes(width, height)?);
                self.pose.write(bytes);
                bytes.push(camera_tag);
            }
            Session::Tagged(tag) => {
                if follows.camera {
                    return Err(PacketError::ShortCamera);
                }
                self.write_frame(bytes);
                bytes.push(tag);
                self.pose.write_short(bytes).ok_or(PacketError::ShortPose)?;
            }
        }
        let check = crc16(&[bytes]);
        bytes.extend_from_slice(&check.to_le_bytes());
        Ok(())
    }

    /// Checks that the predicted form can say all that is to be said.
    fn check_predicted(&self, follows: &Follows) -> Result<(), PacketError> {
        let fits = !(self.uncertain || follows.camera || follows.render);
        match fits && may_be_predicted(follows.residual) {
            true => Ok(()),
            false => Err(PacketError::Predicted),
        }
    }

    /// The frame number, and that of the update.
    fn write_frame(&self, bytes: &mut Vec<u8>) {
        match (self.form().frames(), self.update) {
            (FRAMES, _) => bytes.extend_from_slice(&to_u24(self.frame)),
            (_, update) => {
                bytes.extend_from_slice(&(self.frame as u16).to_le_bytes());
                bytes.extend(update);
            }
        }
    }

    /// The latent part, what follows, and the bytes after it.
    pub(super) fn read(bytes: &[u8]) -> Result<(Latent, Follows, &[u8]), PacketError> {
        let form = check_start(bytes)?;
        let len = form.latent_len();
        let mut reader = Reader::new(bytes, Part::Latent, len)?;
        let [first, flags] = reader.take();
        let frame = match form.frames() {
            FRAMES => from_u24(reader.take()),
            _ => u16::from_le_bytes(reader.take()).into(),
        };
        let update = form.learnt.then(|| reader.take()).map(|[number]| number);
        let (session, pose) = match form.full {
            Some(profile) => {
                let prior = PriorId::from_bytes(reader.take());
                let size = from_u24(reader.take());
                let pose = QuantisedPose::read(&mut reader, profile);
                let [camera_tag] = reader.take();
                let (width, height) = ((size & 0xFFF) + 1, (size >> 12) + 1);
                (Session::Stated { prior, width, height, camera_tag }, pose)
            }
            None => {
                let [tag] = reader.take();
                (Session::Tagged(tag), QuantisedPose::read_short(&mut reader))
            }
        };
        let check = crc16(&[reader.taken()]);
        if check != u16::from_le_bytes(reader.take()) {
            return Err(PacketError::Check(Part::Latent));
        }
        let latent = Latent {
            frame,
            session,
            update,
            pose: pose?,
            uncertain: flags & FLAG_UNCERTAIN != 0,
            portable: PORTABLE.contains(&(first & 0xF)),
            predicted: None,
        };
        Ok((latent, Follows::of_flags(flags), &bytes[len..]))
    }
}

/// Checks the first two bytes, on which the part's length depends.
pub(super) fn check_start(bytes: &[u8]) -> Result<Form, PacketError> {
    if let Some(first) = bytes.first().filter(|first| **first >> 4 != MAGIC) {
        return Err(PacketError::Magic(*first));
    }
    let [first, flags] = Reader::new(bytes, Part::Latent, SHORT_LATENT_LEN)?.take();
    let code = flags & 0b11;
    let version = first & 0xF;
    let learnt = version >= VERSION_LEARNT;
    match version {
        VERSION | VERSION_NOT_PORTABLE | VERSION_LEARNT | VERSION_LEARNT_NOT_PORTABLE => {
            let form = |profile| Form { full: Some(profile), learnt, predicted: None };
            Reader::new(bytes, Part::Latent, form(PoseProfile::Compact).latent_len())?;
            PoseProfile::of_code(code).map(form)
        }
        VERSION_SHORT
        | VERSION_SHORT_NOT_PORTABLE
        | VERSION_LEARNT_SHORT
        | VERSION_LEARNT_SHORT_NOT_PORTABLE => {
            if code != PoseProfile::Short.code() && code != SMALL_BLOCKS_CODE {
                return Err(PacketError::Profile(code));
            }
            if flags & FLAG_CAMERA != 0 {
                return Err(PacketError::ShortCamera);
            }
            Ok(Form { full: None, learnt, predicted: None })
        }
        // Garbage begins so, too: a newer packet is one whose check matches where later versions promise it.
        version if is_later(bytes) => Err(PacketError::Version(version)),
        _ => Err(PacketError::Check(Part::Latent)),
    }
}

/// Whether a check matches at one of the places where later versions keep it.
fn is_later(bytes: &[u8]) -> bool {
    let full = [PoseProfile::Compact, PoseProfile::Paper].map(Latent::full_len);
    let lengths = [SHORT_LATENT_LEN, LEARNT_SHORT_LEN, full[0], full[1]];
    lengths.into_iter().any(|length| {
        let part = bytes.get(..length).and_then(|part| part.split_last_chunk());
        part.is_some_and(|(part, check)| crc16(&[part]) == u16::from_le_bytes(*check))
    })
}

/// Finds the frame number nearest to `last`, among those that are `frame` modulo `frames`. All are modulo
/// [`Latent::FRAMES`].
pub(crate) fn nearest_frame(frame: u32, frames: u32, last: Option<u32>) -> u32 {
    let Some(last) = last else { return frame };
    let ahead = frame.wrapping_sub(last) % frames;
    let behind = if ahead > frames / 2 { frames } else { 0 };
    last.wrapping_add(ahead).wrapping_sub(behind) % Latent::FRAMES
}
