//! The binary form: little-endian, a number of records (u64), then the records.

use glam::DVec3;

use super::error::{ColmapFault, FilePosition, Wrong};
use super::model::{CameraRecord, ImageRecord, Model, point};
use crate::points::Point;

/// Fewest bytes of a camera, a picture and a point.
const MIN_BYTES: [usize; 3] = [4 + 4 + 8 + 8 + 3 * 8, 4 + 7 * 8 + 4 + 1 + 8, 8 + 3 * 8 + 3 + 8 + 8];

/// Bytes of a picture's observation (x, y, number of its point), and of a track's element.
const OBSERVATION: usize = 8 + 8 + 8;
const TRACK_ELEMENT: usize = 4 + 4;

/// What is left of a file.
struct Bytes<'a> {
    rest: &'a [u8],
    length: usize,
}

impl<'a> Bytes<'a> {
    fn new(all: &'a [u8]) -> Bytes<'a> {
        Bytes { rest: all, length: all.len() }
    }

    fn place(&self) -> FilePosition {
        FilePosition::Byte(self.length - self.rest.len())
    }

    fn wrong(&self, fault: ColmapFault) -> Wrong {
        Wrong::new(self.place(), fault)
    }

    fn take<const N: usize>(&mut self, what: &'static str) -> Result<[u8; N], Wrong> {
        let cut = self.wrong(ColmapFault::Cut { what });
        let (taken, rest) = self.rest.split_first_chunk().ok_or(cut)?;
        self.rest = rest;
        Ok(*taken)
    }

    fn u32(&mut self, what: &'static str) -> Result<u32, Wrong> {
        self.take(what).map(u32::from_le_bytes)
    }

    fn u64(&mut self, what: &'static str) -> Result<u64, Wrong> {
        self.take(what).map(u64::from_le_bytes)
    }

    fn floats<const N: usize>(&mut self, what: &'static str) -> Result<[f64; N], Wrong> {
        let mut floats = [0.0; N];
        for float in &mut floats {
            *float = self.take(what).map(f64::from_le_bytes)?;
        }
        Ok(floats)
    }

    /// A number of things of `min` bytes or more each, for which the rest of the file has room.
    fn count(&mut self, min: usize, what: &'static str) -> Result<usize, Wrong> {
        let at = self.place();
        let count = self.u64(what)?;
        let count = usize::try_from(count).ok().filter(|n| *n <= self.rest.len() / min);
        count.ok_or(Wrong::new(at, ColmapFault::Cut { what }))
    }

    /// Passes over things of `size` bytes each, which are as many as the file says; gives their
    /// number.
    fn skip(&mut self, size: usize, what: &'static str) -> Result<usize, Wrong> {
        let count = self.count(size, what)?;
        self.rest = &self.rest[count * size..];
        Ok(count)
    }

    /// A name up to a zero byte, which is passed over.
    fn name(&mut self) -> Result<String, Wrong> {
        let end = self.rest.iter().position(|byte| *byte == 0);
        let end = end.ok_or_else(|| self.wrong(ColmapFault::Cut { what: "the end of a name" }))?;
        let name = std::str::from_utf8(&self.rest[..end]);
        let name = name.map_err(|_| self.wrong(ColmapFault::Text))?.to_owned();
        if name.is_empty() {
            return Err(self.wrong(ColmapFault::Name));
        }
        self.rest = &self.rest[end + 1..];
        Ok(name)
    }

    /// All of a file's records of `min` bytes or more each, and nothing else.
    fn records<T>(
        mut self,
        min: usize,
        what: &'static str,
        read: impl Fn(&mut Self) -> Result<T, Wrong>,
    ) -> Result<Vec<T>, Wrong> {
        let count = self.count(min, what)?;
        let records = (0..count).map(|_| read(&mut self)).collect::<Result<_, _>>()?;
        match self.rest.len() {
            0 => Ok(records),
            count => Err(self.wrong(ColmapFault::Rest { count })),
        }
    }
}

pub fn cameras(bytes: &[u8]) -> Result<Vec<CameraRecord>, Wrong> {
    Bytes::new(bytes).records(MIN_BYTES[0], "all cameras", |bytes| {
        let at = bytes.place();
        let id = bytes.u32("a camera")?;
        let number = bytes.u32("a camera")?;
        let model = Model::numbered(number).map_err(|fault| Wrong::new(at, fault))?;
        let (width, height) = (bytes.u64("a camera")?, bytes.u64("a camera")?);
        let mut parameters = Vec::with_capacity(model.parameters);
        for _ in 0..model.parameters {
            let [parameter] = bytes.floats("a camera's parameters")?;
            parameters.push(parameter);
        }
        Ok(CameraRecord { at, id, model, width, height, parameters })
    })
}

pub fn images(bytes: &[u8]) -> Result<Vec<ImageRecord>, Wrong> {
    Bytes::new(bytes).records(MIN_BYTES[1], "all pictures", |bytes| {
        let at = bytes.place();
        bytes.u32("a picture")?;
        let (quaternion, translation) = (bytes.floats("a pose")?, bytes.floats("a pose")?);
        let camera = bytes.u32("a picture")?;
        let name = bytes.name()?;
        bytes.skip(OBSERVATION, "a picture's observations")?;
        Ok(ImageRecord { at, quaternion, translation, camera, name })
    })
}

pub fn points(bytes: &[u8]) -> Result<Vec<Point>, Wrong> {
    Bytes::new(bytes).records(MIN_BYTES[2], "all points", |bytes| {
        let at = bytes.place();
        bytes.u64("a point")?;
        let position = DVec3::from(bytes.floats::<3>("a point")?);
        let rgb = bytes.take("a point")?;
        let [error] = bytes.floats("a point")?;
        let track = bytes.skip(TRACK_ELEMENT, "a point's track")?;
        point(at, position, rgb, error, track)
    })
}
