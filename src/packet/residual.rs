//! The residual part: a coded difference picture, or why there is none.

use super::bytes::{Reader, crc16};
use super::error::{MAX_PAYLOAD, PacketError, Part};
use super::form::{Form, WHOLE};
use super::truth;

/// CRC-8/SMBUS: polynomial 0x07, initial value 0, nothing reflected.
const CRC8: crc::Crc<u8> = crc::Crc::<u8>::new(&crc::CRC_8_SMBUS);

/// What a part ends with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Check {
    /// CRC-32 of latent part, length and payload.
    Crc32,
    /// CRC-16 of the latent part's CRC-32, length and payload. The latent part ends with a CRC-16 of its own; a CRC-16
    /// over all of it would depend on eight of its bits only.
    Crc16,
    /// CRC-8 of the latent part's CRC-32 and the payload, for the predicted form. There is no length: the payload ends
    /// where the packet does. The frame number does not count, as the latent part's check covers all of it.
    Crc8,
}

impl Check {
    pub(super) fn of(form: Form) -> Check {
        match (form.predicted, form.full) {
            (Some(_), _) => Check::Crc8,
            (None, Some(_)) => Check::Crc32,
            (None, None) => Check::Crc16,
        }
    }

    /// Whether the part begins with its length.
    pub(super) fn has_length(self) -> bool {
        self != Check::Crc8
    }

    /// Bytes that it takes.
    pub(super) fn len(self) -> usize {
        match self {
            Check::Crc32 => 4,
            Check::Crc16 => 2,
            Check::Crc8 => 1,
        }
    }

    /// The low [`Check::len`] bytes, and zeros.
    fn bytes(self, latent: &[u8], part: &[u8]) -> [u8; 4] {
        match self {
            Check::Crc32 => {
                let mut hasher = crc32fast::Hasher::new();
                hasher.update(latent);
                hasher.update(part);
                hasher.finalize().to_le_bytes()
            }
            Check::Crc16 => {
                let latent = crc32fast::hash(latent).to_le_bytes();
                u32::from(crc16(&[&latent, part])).to_le_bytes()
            }
            Check::Crc8 => {
                let mut hasher = crc32fast::Hasher::new();
                hasher.update(&latent[..1]);
                hasher.update(&latent[2..]);
                let mut digest = CRC8.digest();
                digest.update(&hasher.finalize().to_le_bytes());
                digest.update(part);
                u32::from(digest.finalize()).to_le_bytes()
            }
        }
    }
}

const CODE_NONE: u8 = 0;
const CODE_OMITTED: u8 = 1;
/// [`Residual::Stream`]: coded by the wavelet coder.
const CODE_STREAM: u8 = 5;
/// The part begins with a truth map.
const CODE_TRUTH: u8 = 6;
/// [`Residual::None`], and all of the picture is as seen.
const CODE_ALL_SEEN: u8 = 7;
/// Bit of a code that the flags of the short form tell by the pose profile: the wavelet coder's payload has small
/// blocks.
pub(super) const SMALL_BLOCKS: u8 = 8;

const CODE_STREAM_SMALL_BLOCKS: u8 = CODE_STREAM | SMALL_BLOCKS;
const CODE_TRUTH_SMALL_BLOCKS: u8 = CODE_TRUTH | SMALL_BLOCKS;

/// Whether the predicted form of a latent part has a number for what follows it.
pub(super) fn may_be_predicted(code: u8) -> bool {
    let wavelet = [Coder::Wavelet as u8, CODE_STREAM, CODE_TRUTH];
    let plain = [CODE_NONE, CODE_OMITTED, CODE_ALL_SEEN].contains(&code);
    plain || wavelet.contains(&(code & !SMALL_BLOCKS))
}

/// How a difference picture is coded; the number is the code in a packet's flags.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Coder {
    /// A VP8 key frame without what the packet's header already says.
    Vp8 = 2,
    /// A whole WebP file.
    WebP = 3,
    /// The wavelet coder: see [`crate::residual::wavelet`]. If its form or its generic tables change, it must take
    /// another number: a topside with other tables would decode garbage.
    Wavelet = 4,
    /// The wavelet coder with [small blocks](crate::residual::wavelet). In the short form only.
    SmallBlocks = Coder::Wavelet as u8 | SMALL_BLOCKS,
}

impl Coder {
    /// The wavelet coder, with small blocks or without.
    pub(crate) fn wavelet(small_blocks: bool) -> Coder {
        if small_blocks { Coder::SmallBlocks } else { Coder::Wavelet }
    }
}

/// The reference frame of a residual.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reference {
    /// How many frames before this one, 1 to 255.
    pub distance: u8,
    /// Check of what that frame's residual was decoded to, of its camera and its pose. It tells a frame of the same
    /// number from another stream.
    pub tag: u16,
}

impl Reference {
    /// Most bytes in front of a payload.
    pub const LONGEST: usize = 3;

    /// Bytes in front of the payload of a stream's frame.
    pub fn encoded_len(reference: Option<Reference>) -> usize {
        if reference.is_some() { Self::LONGEST } else { 1 }
    }

    /// These bytes, and zeros.
    fn bytes(reference: Option<Reference>) -> [u8; 3] {
        let Reference { distance, tag } = reference.unwrap_or(Reference { distance: 0, tag: 0 });
        let [low, high] = tag.to_le_bytes();
        [distance, low, high]
    }

    /// Reads them; the rest is the payload. `None` if they are not all there.
    fn read(bytes: &[u8]) -> Option<(Option<Reference>, &[u8])> {
        match bytes {
            [0, payload @ ..] => Some((None, payload)),
            [distance, low, high, payload @ ..] => {
                let tag = u16::from_le_bytes([*low, *high]);
                Some((Some(Reference { distance: *distance, tag }), payload))
            }
            _ => None,
        }
    }
}

/// The difference picture of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Residual<'a> {
    /// None was asked for, or the render alone was good enough.
    None,
    /// One was asked for, but the byte budget could not hold any.
    Omitted,
    /// A coded difference picture.
    Coded {
        /// How it is coded.
        coder: Coder,
        /// Its bytes.
        payload: &'a [u8],
    },
    /// A difference picture of a stream, coded by the wavelet coder. Later frames may be predicted from it.
    Stream {
        /// Its reference frame; `None`: it is intra.
        reference: Option<Reference>,
        /// Whether it is coded as [`Coder::SmallBlocks`], in place of [`Coder::Wavelet`].
        small_blocks: bool,
        /// Its bytes.
        payload: &'a [u8],
    },
}

impl<'a> Residual<'a> {
    /// The payload; empty if there is none.
    pub(super) fn payload(&self) -> &'a [u8] {
        match *self {
            Residual::None | Residual::Omitted => &[],
            Residual::Coded { payload, .. } | Residual::Stream { payload, .. } => payload,
        }
    }

    /// The same with another payload.
    pub(super) fn with_payload<'b>(self, payload: &'b [u8]) -> Residual<'b> {
        match self {
            Residual::None => Residual::None,
            Residual::Omitted => Residual::Omitted,
            Residual::Coded { coder, .. } => Residual::Coded { coder, payload },
            Residual::Stream { reference, small_blocks, .. } => {
                Residual::Stream { reference, small_blocks, payload }
            }
        }
    }

    /// Whether it can travel in the short form only.
    fn has_small_blocks(&self) -> bool {
        match *self {
            Residual::None | Residual::Omitted => false,
            Residual::Coded { coder, .. } => coder == Coder::SmallBlocks,
            Residual::Stream { small_blocks, .. } => small_blocks,
        }
    }
}

/// The start of a coded difference picture whose end is missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResidualStart<'a> {
    /// How it is coded.
    pub coder: Coder,
    /// Its reference frame, if it has one.
    pub reference: Option<Reference>,
    /// Its first bytes. No check covers them.
    pub payload: &'a [u8],
    /// How many bytes it has in all. In the predicted form that is not known: as many as there are.
    pub payload_len: usize,
}

/// Length of the residual part that holds a payload of this length, bytes, in the full form. In the
/// short form it is two bytes shorter.
pub fn residual_part_len(payload: usize) -> usize {
    len_with(payload, Check::Crc32)
}

/// Bytes of a reference in front of the payload, and how many there are.
fn front(residual: &Residual) -> ([u8; 3], usize) {
    match *residual {
        Residual::Stream { reference, .. } => {
            (Reference::bytes(reference), Reference::encoded_len(reference))
        }
        _ => ([0; 3], 0),
    }
}

/// Whether a part is written, which says more than the flags do.
fn is_written(residual: &Residual, truth: Option<&[u8]>) -> bool {
    match residual {
        Residual::None => truth.is_some_and(|truth| truth != truth::ALL_SEEN),
        Residual::Omitted => truth.is_some(),
        Residual::Coded { .. } | Residual::Stream { .. } => true,
    }
}

/// Length of a residual's part, bytes.
pub(super) fn encoded_len(residual: &Residual, truth: Option<&[u8]>, check: Check) -> usize {
    if !is_written(residual, truth) {
        return 0;
    }
    let (_, front) = front(residual);
    len_with(truth.map_or(0, <[u8]>::len) + front + residual.payload().len(), check)
}

/// Length of the part that holds a payload, bytes.
fn len_with(payload: usize, check: Check) -> usize {
    let length = if check.has_length() { length_field(payload).count() } else { 0 };
    length + payload + check.len()
}

/// Length of the longest truth map with which a residual's part has at most `budget` bytes.
pub(super) fn truth_room(residual: &Residual, check: Check, budget: usize) -> usize {
    let content = budget.saturating_sub(check.len());
    let (_, front) = front(residual);
    let length = if check.has_length() { length_field(content).count() } else { 0 };
    let others = length + front + residual.payload().len();
    // Without a residual, a map by which all is as seen takes no byte.
    let free = usize::from(matches!(residual, Residual::None));
    content.saturating_sub(others).max(free)
}

/// What the flags say about a residual and a truth map.
pub(super) fn code_of(residual: &Residual, truth: Option<&[u8]>) -> Result<u8, PacketError> {
    let code = match residual {
        Residual::None => CODE_NONE,
        Residual::Omitted => CODE_OMITTED,
        Residual::Coded { coder, .. } => *coder as u8,
        Residual::Stream { .. } => CODE_STREAM,
    };
    let form = if residual.has_small_blocks() { SMALL_BLOCKS } else { 0 };
    match truth {
        None => Ok(code | form),
        Some(_) if !is_written(residual, truth) => Ok(CODE_ALL_SEEN),
        Some(_) => follower(residual).map(|_| CODE_TRUTH | form),
    }
}

/// What a truth map says of the residual after it.
fn follower(residual: &Residual) -> Result<u8, PacketError> {
    match residual {
        Residual::None => Ok(0),
        Residual::Omitted => Ok(1),
        Residual::Coded { coder: Coder::Wavelet | Coder::SmallBlocks, .. } => Ok(2),
        Residual::Stream { .. } => Ok(3),
        Residual::Coded { coder, .. } => Err(PacketError::TruthCoder(*coder as u8)),
    }
}

/// Appends the part, if there is one, to a packet that begins with `latent_len` bytes of latent part.
pub(super) fn write(
    residual: &Residual,
    truth: Option<&[u8]>,
    latent_len: usize,
    check: Check,
    packet: &mut Vec<u8>,
) -> Result<(), PacketError> {
    if !is_written(residual, truth) {
        return Ok(());
    }
    let ((bytes, front), payload) = (front(residual), residual.payload());
    let truth = truth.map(<[u8]>::split_first);
    let truth = truth.map(|split| split.ok_or(PacketError::Truth)).transpose()?;
    let length = truth.map_or(0, |(_, rest)| 1 + rest.len()) + front + payload.len();
    if length > MAX_PAYLOAD {
        return Err(PacketError::PayloadLength);
    }
    let start = packet.len();
    if check.has_length() {
        packet.extend(length_field(length));
    }
    if let Some((first, rest)) = truth {
        packet.push(first & !truth::FOLLOWER | follower(residual)?);
        packet.extend_from_slice(rest);
    }
    packet.extend_from_slice(&bytes[..front]);
    packet.extend_from_slice(payload);
    let bytes = check.bytes(&packet[..latent_len], &packet[start..]);
    packet.extend_from_slice(&bytes[..check.len()]);
    Ok(())
}

/// What the bytes after the fixed parts hold.
pub(super) struct Found<'a> {
    pub residual: Result<Residual<'a>, PacketError>,
    /// The residual's start, if only its end is missing.
    pub start: Option<ResidualStart<'a>>,
    /// The truth map, if all of it is there.
    pub truth: Option<&'a [u8]>,
}

impl<'a> Found<'a> {
    fn without_part(residual: Result<Residual<'a>, PacketError>) -> Found<'a> {
        Found { residual, start: None, truth: None }
    }
}

/// Reads the residual and the truth map; if only the residual's end is missing, also its start.
pub(super) fn decode<'a>(code: u8, bytes: &'a [u8], latent: &[u8], check: Check) -> Found<'a> {
    let kind = match code {
        CODE_NONE => return Found::without_part(Ok(Residual::None)),
        CODE_OMITTED => return Found::without_part(Ok(Residual::Omitted)),
        CODE_ALL_SEEN => {
            return Found {
                truth: Some(truth::ALL_SEEN),
                ..Found::without_part(Ok(Residual::None))
            };
        }
        code if code == Coder::Vp8 as u8 => Kind::Coded(Coder::Vp8),
        code if code == Coder::WebP as u8 => Kind::Coded(Coder::WebP),
        code if code == Coder::Wavelet as u8 => Kind::Coded(Coder::Wavelet),
        code if code == Coder::SmallBlocks as u8 => Kind::Coded(Coder::SmallBlocks),
        CODE_STREAM => Kind::Stream { small_blocks: false },
        CODE_STREAM_SMALL_BLOCKS => Kind::Stream { small_blocks: true },
        CODE_TRUTH | CODE_TRUTH_SMALL_BLOCKS => {
            return with_truth(code == CODE_TRUTH_SMALL_BLOCKS, bytes, latent, check);
        }
        code => return Found::without_part(Err(PacketError::Coder(code))),
    };
    match checked(bytes, latent, check) {
        Ok((_, payload)) => Found::without_part(kind.residual(payload)),
        Err(error) => {
            let cut = cut_content(bytes, latent, check);
            let start = cut.and_then(|(start, len)| kind.start(start, len));
            Found { residual: Err(error), start, truth: None }
        }
    }
}

/// Reads a part that begins with a truth map.
fn with_truth<'a>(small_blocks: bool, bytes: &'a [u8], latent: &[u8], check: Check) -> Found<'a> {
    let whole = checked(bytes, latent, check);
    let (content, len) = match &whole {
        Ok((_, content)) => (*content, content.len()),
        Err(_) => match cut_content(bytes, latent, check) {
            Some(cut) => cut,
            None => return Found::without_part(whole.map(|_| Residual::None)),
        },
    };
    let Some((truth, payload)) = truth::split(content) else {
        return Found::without_part(Err(whole.err().unwrap_or(PacketError::Truth)));
    };
    let kind = Kind::of_follower(truth[0] & truth::FOLLOWER, small_blocks);
    let (residual, start) = match whole {
        Ok(_) => (kind.residual(payload), None),
        Err(error) => (Err(error), kind.start(payload, len - truth.len())),
    };
    Found { residual, start, truth: Some(truth) }
}

/// What a residual's part holds.
#[derive(Clone, Copy)]
enum Kind {
    None,
    Omitted,
    Coded(Coder),
    Stream { small_blocks: bool },
}

impl Kind {
    fn of_follower(follower: u8, small_blocks: bool) -> Kind {
        match follower {
            0 => Kind::None,
            1 => Kind::Omitted,
            2 => Kind::Coded(Coder::wavelet(small_blocks)),
            _ => Kind::Stream { small_blocks },
        }
    }

    /// The residual of all bytes of its part.
    fn residual(self, bytes: &[u8]) -> Result<Residual<'_>, PacketError> {
        match self {
            Kind::None => Ok(Residual::None),
            Kind::Omitted => Ok(Residual::Omitted),
            Kind::Coded(coder) => Ok(Residual::Coded { coder, payload: bytes }),
            Kind::Stream { small_blocks } => match Reference::read(bytes) {
                Some((reference, payload)) => {
                    Ok(Residual::Stream { reference, small_blocks, payload })
                }
                None => Err(PacketError::Reference(bytes.len())),
            },
        }
    }

    /// The start of a payload whose end is missing. `len`: of the whole, the reference included.
    fn start(self, bytes: &[u8], len: usize) -> Option<ResidualStart<'_>> {
        let (coder, reference, payload) = match self {
            Kind::None | Kind::Omitted => return None,
            Kind::Coded(coder) => (coder, None, bytes),
            Kind::Stream { small_blocks } => {
                let (reference, payload) = Reference::read(bytes)?;
                (Coder::wavelet(small_blocks), reference, payload)
            }
        };
        Some(ResidualStart { coder, reference, payload, payload_len: len })
    }
}

/// What there is of a part's content, if its end is missing, and how long it would be.
fn cut_content<'a>(bytes: &'a [u8], latent: &[u8], check: Check) -> Option<(&'a [u8], usize)> {
    if !check.has_length() {
        return (!ends(latent)).then_some((bytes, bytes.len()));
    }
    let (len, field) = read_length(bytes).ok()?;
    let end = field + len;
    (bytes.len() < end + check.len()).then(|| (&bytes[field..bytes.len().min(end)], len))
}

/// Whether a packet in the predicted form ends where its bytes do.
fn ends(latent: &[u8]) -> bool {
    latent.get(1).is_some_and(|number| number & WHOLE != 0)
}

/// Whether the flags say that a residual part follows, perhaps of an unknown coder.
pub(super) fn has_part(code: u8) -> bool {
    !matches!(code, CODE_NONE | CODE_OMITTED | CODE_ALL_SEEN)
}

/// Length of the part that `bytes` begin with, bytes.
pub(super) fn part_len(bytes: &[u8], check: Check) -> Result<usize, PacketError> {
    let (length, field) = read_length(bytes)?;
    Ok(field + length + check.len())
}

/// Bytes of the part that `bytes` begin with that are not its content; 0: its length is not there.
pub(super) fn framing_len(bytes: &[u8], check: Check) -> usize {
    match check.has_length() {
        true => read_length(bytes).map_or(0, |(_, field)| field + check.len()),
        false => check.len(),
    }
}

/// Bytes of a part up to the end of the truth map that it begins with; 0: there is none, or not all of it is there.
pub(super) fn told_len(code: u8, bytes: &[u8], check: Check) -> usize {
    let told = || {
        let field = if check.has_length() { read_length(bytes).ok()?.1 } else { 0 };
        let (map, _) = truth::split(bytes.get(field..)?)?;
        Some(field + map.len())
    };
    if code & !SMALL_BLOCKS == CODE_TRUTH { told().unwrap_or(0) } else { 0 }
}

/// Length of a valid part at the start of `bytes`, and its payload.
pub(super) fn checked<'a>(
    bytes: &'a [u8],
    latent: &[u8],
    check: Check,
) -> Result<(usize, &'a [u8]), PacketError> {
    let (length, field) = match check.has_length() {
        true => read_length(bytes)?,
        false if ends(latent) => (bytes.len().saturating_sub(check.len()), 0),
        // It is longer.
        false => (bytes.len(), 0),
    };
    let needed = field + length + check.len();
    let part = bytes.get(..needed).ok_or(PacketError::TooShort {
        part: Part::Residual,
        needed,
        found: bytes.len(),
    })?;
    let (checked, found) = part.split_at(field + length);
    if check.bytes(latent, checked)[..check.len()] != *found {
        return Err(PacketError::Check(Part::Residual));
    }
    Ok((needed, &checked[field..]))
}

/// The length as the part starts with it: seven bits per byte, low bits first.
fn length_field(length: usize) -> impl Iterator<Item = u8> {
    let groups = std::iter::successors(Some(length), |rest| Some(rest >> 7).filter(|r| *r > 0));
    groups.map(|rest| (rest & 0x7F) as u8 | if rest >> 7 > 0 { 0x80 } else { 0 })
}

/// The payload's length, and how many bytes say so.
fn read_length(bytes: &[u8]) -> Result<(usize, usize), PacketError> {
    let mut length = 0;
    for index in 0..4 {
        let [byte] = Reader::new(bytes.get(index..).unwrap_or(&[]), Part::Residual, 1)?.take();
        length |= usize::from(byte & 0x7F) << (7 * index);
        if byte & 0x80 == 0 {
            return Ok((length, index + 1));
        }
    }
    Err(PacketError::PayloadLength)
}
