//! A file as its head and its parts.

use super::super::PriorError;
use super::head::{Format, Head};
use super::part::{Part, PartName};

/// A file's head and parts.
#[derive(Clone, Debug)]
pub struct Container<'a> {
    pub head: Head,
    parts: Vec<Part<'a>>,
}

impl<'a> Container<'a> {
    /// One without parts.
    pub fn new(head: Head) -> Container<'a> {
        Container { head, parts: Vec::new() }
    }

    /// Reads head and parts at the start of `bytes`, which reach to the last part or further.
    pub fn read(bytes: &'a [u8], format: Format) -> Result<Container<'a>, PriorError> {
        let head = Head::read(bytes, format, bytes.len() as u64)?;
        let (mut at, end) = (Head::BYTES, head.end as usize);
        let mut parts: Vec<Part> = Vec::new();
        for _ in 0..head.parts {
            let part = Part::read(&bytes[..end], at, format)?;
            if parts.iter().any(|earlier| earlier.name == part.name) {
                return Err(format.refusal(at, format!("a second part {}", part.name())));
            }
            at = part.end();
            parts.push(part);
        }
        match at == end {
            true => Ok(Container { head, parts }),
            false => Err(format.refusal(at, "more bytes than parts".into())),
        }
    }

    /// A part, if it is there.
    pub fn part(&self, name: PartName) -> Option<&Part<'a>> {
        self.parts.iter().find(|part| part.is(name))
    }

    /// A part that must be there.
    pub fn required(&self, name: PartName) -> Result<&Part<'a>, PriorError> {
        let reason = || format!("no part \"{}\"", name.text);
        let format = self.head.format.text();
        self.part(name).ok_or_else(|| PriorError::Content { format, reason: reason() })
    }

    /// What `read` makes of a part's content, if the part is there. Its second argument is where the content begins.
    /// An error names the part.
    pub fn read_part<T>(
        &self,
        name: PartName,
        read: impl FnOnce(&[u8], usize) -> Result<T, PriorError>,
    ) -> Result<Option<T>, PriorError> {
        self.part(name).map(|part| part.read_content(read)).transpose()
    }

    /// Replaces a part, adds it, or, without content, takes it out. The others stay, those that are not known here too.
    pub fn set(&mut self, name: PartName, content: Option<Vec<u8>>) {
        let at = self.parts.iter().position(|part| part.is(name));
        match (at, content.map(|content| Part::new(name, content))) {
            (Some(at), Some(part)) => self.parts[at] = part,
            (None, Some(part)) => self.parts.push(part),
            (Some(at), None) => drop(self.parts.remove(at)),
            (None, None) => {}
        }
    }

    /// As in a file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let size = Head::BYTES + self.parts.iter().map(Part::size).sum::<usize>();
        let parts = self.parts.len() as u16;
        let mut bytes = Vec::with_capacity(size);
        bytes.extend(Head { parts, end: size as u64, ..self.head }.to_bytes());
        self.parts.iter().for_each(|part| part.put(&mut bytes));
        bytes
    }
}
