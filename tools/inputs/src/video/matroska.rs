//! Raw video in Matroska, as the decoders write it to a pipe: size, colours, and frames with their times.
//!
//! Only what they write is read: one track of uncompressed I420, blocks without lacing. Elements that hold others are
//! entered, so their sizes need not be known, as on a pipe they are not. All others are skipped. RFC 9559 has the
//! format.

use std::io::{self, ErrorKind, Read};

use nvsprior::image::{Colour, ImageView};

/// Elements by their identifiers.
mod id {
    pub const SEGMENT: u32 = 0x1853_8067;
    pub const INFO: u32 = 0x1549_A966;
    pub const TIMESTAMP_SCALE: u32 = 0x002A_D7B1;
    pub const TRACKS: u32 = 0x1654_AE6B;
    pub const TRACK_ENTRY: u32 = 0xAE;
    pub const VIDEO: u32 = 0xE0;
    pub const INTERLACED: u32 = 0x9A;
    pub const PIXEL_WIDTH: u32 = 0xB0;
    pub const PIXEL_HEIGHT: u32 = 0xBA;
    pub const COLOUR_SPACE: u32 = 0x002E_B524;
    pub const COLOUR: u32 = 0x55B0;
    pub const MATRIX: u32 = 0x55B1;
    pub const RANGE: u32 = 0x55B9;
    pub const TRANSFER: u32 = 0x55BA;
    pub const CLUSTER: u32 = 0x1F43_B675;
    pub const CLUSTER_TIMESTAMP: u32 = 0xE7;
    pub const BLOCK_GROUP: u32 = 0xA0;
    pub const BLOCK: u32 = 0xA1;
    pub const SIMPLE_BLOCK: u32 = 0xA3;
    /// Those that hold others that are read.
    pub const ENTERED: [u32; 8] =
        [SEGMENT, INFO, TRACKS, TRACK_ENTRY, VIDEO, COLOUR, CLUSTER, BLOCK_GROUP];
}

/// The longest element beside frames that is read or skipped. A decoder's own are far shorter.
const LONGEST: u64 = 1 << 24;

/// What a stream says of its frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Header {
    pub width: u32,
    pub height: u32,
    pub colour: Colour,
    /// Brightness is that of a display with high dynamic range (PQ or HLG).
    pub high_dynamic_range: bool,
    /// Frames are woven of two fields.
    pub interlaced: bool,
}

impl Header {
    /// Of which only the size is known.
    pub fn of_size(width: u32, height: u32) -> Header {
        let colour = Colour::default();
        Header { width, height, colour, high_dynamic_range: false, interlaced: false }
    }
}

/// A block: the frame's time, and its bytes.
pub struct Block {
    /// In ticks of the stream.
    pub ticks: i64,
    pub data: Vec<u8>,
}

/// Reads a stream.
pub struct Matroska<R> {
    input: R,
    header: Header,
    /// Nanoseconds of a tick.
    tick: u64,
    cluster: i64,
    first: Option<Block>,
}

/// What the elements before the first block say.
#[derive(Default)]
struct Described {
    width: u64,
    height: u64,
    fourcc: Vec<u8>,
    matrix: Option<u64>,
    range: Option<u64>,
    transfer: Option<u64>,
    interlaced: u64,
}

fn wrong(what: &str) -> io::Error {
    io::Error::new(ErrorKind::InvalidData, what.to_owned())
}

impl<R: Read> Matroska<R> {
    /// Reads up to the first frame.
    pub fn open(input: R) -> io::Result<Matroska<R>> {
        let header = Header::of_size(0, 0);
        let mut reader = Matroska { input, header, tick: 1_000_000, cluster: 0, first: None };
        let mut described = Described::default();
        let Some(block) = reader.advance(&mut described, None)? else {
            return Err(ErrorKind::UnexpectedEof.into());
        };
        reader.header = described.header()?;
        reader.first = Some(block);
        Ok(reader)
    }

    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Seconds of a tick.
    pub fn tick(&self) -> f64 {
        self.tick as f64 * 1e-9
    }

    /// The next frame, of `length` bytes; `None` at the end. A stream that ends amid an element is an error of the kind
    /// [`ErrorKind::UnexpectedEof`].
    pub fn next(&mut self, length: usize) -> io::Result<Option<Block>> {
        let block = match self.first.take() {
            Some(block) => Some(block),
            None => self.advance(&mut Described::default(), Some(length))?,
        };
        match block {
            Some(block) if block.data.len() != length => {
                Err(wrong("a frame of another length than its size takes"))
            }
            block => Ok(block),
        }
    }

    /// Goes on to the next block. Its length is bounded by the frame's, if that is known.
    fn advance(
        &mut self,
        described: &mut Described,
        length: Option<usize>,
    ) -> io::Result<Option<Block>> {
        while let Some(id) = self.identifier()? {
            let size = self.size()?;
            if id::ENTERED.contains(&id) {
                continue;
            }
            let size = size.ok_or_else(|| wrong("an element without a size"))?;
            if id == id::SIMPLE_BLOCK || id == id::BLOCK {
                return self.block(size, length).map(Some);
            }
            self.element(id, size, described)?;
        }
        Ok(None)
    }

    /// Reads an element that says something of the stream, or skips it.
    fn element(&mut self, id: u32, size: u64, described: &mut Described) -> io::Result<()> {
        match id {
            id::TIMESTAMP_SCALE => self.tick = self.number(size)?.max(1),
            id::INTERLACED => described.interlaced = self.number(size)?,
            id::PIXEL_WIDTH => described.width = self.number(size)?,
            id::PIXEL_HEIGHT => described.height = self.number(size)?,
            id::COLOUR_SPACE => described.fourcc = self.bytes(size.min(16))?,
            id::MATRIX => described.matrix = Some(self.number(size)?),
            id::RANGE => described.range = Some(self.number(size)?),
            id::TRANSFER => described.transfer = Some(self.number(size)?),
            id::CLUSTER_TIMESTAMP => self.cluster = self.number(size)? as i64,
            _ if size > LONGEST => return Err(wrong("an element that no decoder writes")),
            _ => {
                let skipped = io::copy(&mut self.input.by_ref().take(size), &mut io::sink())?;
                if skipped < size {
                    return Err(ErrorKind::UnexpectedEof.into());
                }
            }
        }
        Ok(())
    }

    fn block(&mut self, size: u64, length: Option<usize>) -> io::Result<Block> {
        /// Track number, time and flags.
        const HEAD: u64 = 4;
        let longest = length.map_or(u64::from(ImageView::MAX_SIDE).pow(2) * 2, |n| n as u64);
        if size < HEAD || size - HEAD > longest {
            return Err(wrong("a frame of another length than its size takes"));
        }
        let [track, time @ .., flags] = self.array::<4>()?;
        if track & 0x80 == 0 || flags & 0x06 != 0 {
            return Err(wrong("a block of a kind that no decoder writes"));
        }
        let ticks = self.cluster.saturating_add(i16::from_be_bytes(time).into());
        Ok(Block { ticks, data: self.bytes(size - HEAD)? })
    }

    /// The identifier of the next element; `None` if the stream ends before it.
    fn identifier(&mut self) -> io::Result<Option<u32>> {
        let mut first = [0];
        loop {
            match self.input.read(&mut first) {
                Ok(0) => return Ok(None),
                Ok(_) => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        let more = first[0].leading_zeros();
        if more > 3 {
            return Err(wrong("not Matroska"));
        }
        let mut id = u32::from(first[0]);
        for _ in 0..more {
            id = id << 8 | u32::from(self.array::<1>()?[0]);
        }
        Ok(Some(id))
    }

    /// The size of an element; `None` if it is not told.
    fn size(&mut self) -> io::Result<Option<u64>> {
        let [first] = self.array::<1>()?;
        let more = first.leading_zeros();
        if more > 7 {
            return Err(wrong("not Matroska"));
        }
        let mut size = u64::from(first) & (0x7F >> more);
        for _ in 0..more {
            size = size << 8 | u64::from(self.array::<1>()?[0]);
        }
        let unknown = (1u64 << (7 * (more + 1))) - 1;
        Ok((size != unknown).then_some(size))
    }

    fn number(&mut self, size: u64) -> io::Result<u64> {
        if size > 8 {
            return Err(wrong("a number of more than eight bytes"));
        }
        Ok(self.bytes(size)?.iter().fold(0, |number, byte| number << 8 | u64::from(*byte)))
    }

    fn array<const N: usize>(&mut self) -> io::Result<[u8; N]> {
        let mut bytes = [0; N];
        self.input.read_exact(&mut bytes)?;
        Ok(bytes)
    }

    fn bytes(&mut self, size: u64) -> io::Result<Vec<u8>> {
        /// Memory for what comes, before it has come.
        const AHEAD: u64 = 1 << 26;
        let mut bytes = Vec::with_capacity(size.min(AHEAD) as usize);
        self.input.by_ref().take(size).read_to_end(&mut bytes)?;
        if (bytes.len() as u64) < size {
            return Err(ErrorKind::UnexpectedEof.into());
        }
        Ok(bytes)
    }
}

impl Described {
    fn header(&self) -> io::Result<Header> {
        let side = |side: u64| {
            u32::try_from(side).ok().filter(|side| (1..=ImageView::MAX_SIDE).contains(side))
        };
        let (Some(width), Some(height)) = (side(self.width), side(self.height)) else {
            return Err(wrong("frames without a size, or larger than any camera's"));
        };
        if self.fourcc != b"I420" {
            return Err(wrong("frames of another format than I420"));
        }
        let high_dynamic_range = matches!(self.transfer, Some(16 | 18));
        // 0: unknown, 2: no.
        let interlaced = self.interlaced == 1;
        let colour = self.colour(height);
        Ok(Header { width, height, colour, high_dynamic_range, interlaced })
    }

    /// The numbers are those of ITU-T H.273. The library has no BT.2020, to which BT.709 is nearest.
    fn colour(&self, height: u32) -> Colour {
        /// What is not said is BT.709 for HD, as players take it.
        const HD: u32 = 720;
        let bt709 = match self.matrix {
            Some(1 | 9 | 10) => true,
            Some(4..=6) => false,
            _ => height >= HD,
        };
        match (bt709, self.range == Some(2)) {
            (true, true) => Colour::Bt709Full,
            (true, false) => Colour::Bt709Limited,
            (false, true) => Colour::Bt601Full,
            (false, false) => Colour::Bt601Limited,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn element(id: u32, content: &[u8]) -> Vec<u8> {
        let id: Vec<u8> = id.to_be_bytes().into_iter().skip_while(|byte| *byte == 0).collect();
        let size = (0x1000_0000 | content.len() as u32).to_be_bytes();
        [&id[..], &size, content].concat()
    }

    fn head(colour: &[u8]) -> Vec<u8> {
        let size = [element(id::PIXEL_WIDTH, &[4]), element(id::PIXEL_HEIGHT, &[2])].concat();
        let video = [&size[..], &element(id::COLOUR_SPACE, b"I420"), colour].concat();
        let entry = element(id::TRACK_ENTRY, &element(id::VIDEO, &video));
        let info = element(id::INFO, &element(id::TIMESTAMP_SCALE, &1000u32.to_be_bytes()));
        // A segment without a size, as on a pipe.
        let segment = [&id::SEGMENT.to_be_bytes()[..], &[0x01], &[0xFF; 7]].concat();
        [element(0x1A45_DFA3, b"skipped"), segment, info, element(id::TRACKS, &entry)].concat()
    }

    fn cluster(ticks: u32, offset: i16, fill: u8) -> Vec<u8> {
        let [a, b] = offset.to_be_bytes();
        let block = [&[0x81, a, b, 0x80][..], &[fill; 12]].concat();
        let time = element(id::CLUSTER_TIMESTAMP, &ticks.to_be_bytes());
        element(id::CLUSTER, &[time, element(id::SIMPLE_BLOCK, &block)].concat())
    }

    #[test]
    fn frames_come_with_their_times() {
        let stream = [head(&[]), cluster(70_000, -3, 1), cluster(100_000, 7, 2)].concat();
        let mut reader = Matroska::open(&stream[..]).unwrap();
        assert_eq!((reader.header().width, reader.header().height), (4, 2));
        assert_eq!(reader.header().colour, Colour::Bt601Limited);
        assert!((reader.tick() - 1e-6).abs() < 1e-15);
        for (ticks, fill) in [(69_997, 1), (100_007, 2)] {
            let block = reader.next(12).unwrap().unwrap();
            assert_eq!((block.ticks, block.data), (ticks, vec![fill; 12]));
        }
        assert!(reader.next(12).unwrap().is_none());
    }

    #[test]
    fn colours_are_told() {
        let of = |numbers: &[(u32, u8)]| {
            let inner: Vec<u8> = numbers.iter().flat_map(|(id, n)| element(*id, &[*n])).collect();
            let stream = [head(&element(id::COLOUR, &inner)), cluster(0, 0, 0)].concat();
            let header = *Matroska::open(&stream[..]).unwrap().header();
            (header.colour, header.high_dynamic_range)
        };
        assert_eq!(of(&[(id::MATRIX, 1), (id::RANGE, 2)]), (Colour::Bt709Full, false));
        assert_eq!(of(&[(id::MATRIX, 6), (id::RANGE, 1)]), (Colour::Bt601Limited, false));
        assert_eq!(of(&[(id::MATRIX, 9), (id::TRANSFER, 16)]), (Colour::Bt709Limited, true));
    }

    #[test]
    fn any_cut_and_any_changed_byte_is_an_error_or_an_end() {
        let stream = [head(&[]), cluster(1, 2, 3), cluster(4, 5, 6)].concat();
        let read = |bytes: &[u8]| -> io::Result<usize> {
            let mut reader = Matroska::open(bytes)?;
            let mut count = 0;
            while reader.next(12)?.is_some() {
                count += 1;
            }
            Ok(count)
        };
        assert_eq!(read(&stream).unwrap(), 2);
        for length in 0..stream.len() {
            assert!(!matches!(read(&stream[..length]), Ok(2..)), "{length}");
        }
        for at in 0..stream.len() {
            for value in [0, 1, 0x40, 0x7F, 0xFF] {
                let mut changed = stream.clone();
                changed[at] = value;
                assert!(!matches!(read(&changed), Ok(3..)), "{at}, {value}");
            }
        }
    }
}
