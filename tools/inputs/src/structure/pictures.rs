//! The pictures of a folder.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use image::ImageReader;
use rayon::prelude::*;

use super::pairs::{Seen, luma};
use super::{Lenses, StructureError};
use crate::frame_file::{ENDINGS, FrameFileError, open_image};
use crate::posed::PosedError;

pub struct Listed {
    /// The folder's absolute path.
    pub folder: PathBuf,
    /// Their names from the folder, with slashes, sorted.
    pub names: Vec<String>,
    /// What names, sizes and times of the files come to: other pictures, another text.
    pub digest: String,
    /// Size of the widest one, pixels.
    pub widest: (u32, u32),
}

/// Pictures that are read at once.
const AT_ONCE: usize = 8;

impl Listed {
    /// Lists a folder and those below it. Reads each picture's size.
    pub fn of(folder: &Path, lenses: Lenses) -> Result<Listed, StructureError> {
        let folder = std::path::absolute(folder).map_err(StructureError::file(folder))?;
        let mut files = Vec::new();
        collect(&folder, &mut files)?;
        files.sort();
        match &files[..] {
            [] => return Err(StructureError::Empty { path: folder }),
            [one] => return Err(StructureError::One { path: one.clone() }),
            _ => {}
        }
        let mut listed =
            Listed { folder, names: Vec::new(), digest: String::new(), widest: (0, 0) };
        let mut digest = Digest::default();
        for file in &files {
            listed.names.push(listed.name(file)?);
            digest.add(file)?;
        }
        listed.digest = digest.text();
        listed.widest = check_sizes(&files, lenses)?;
        Ok(listed)
    }

    /// Its name as COLMAP has it.
    fn name(&self, file: &Path) -> Result<String, StructureError> {
        let wrong = || StructureError::Name { path: file.to_path_buf() };
        let within = file.strip_prefix(&self.folder).map_err(|_| wrong())?;
        let parts: Option<Vec<&str>> = within.iter().map(|part| part.to_str()).collect();
        let name = parts.ok_or_else(wrong)?.join("/");
        if name.contains(['\n', '\r']) { Err(wrong()) } else { Ok(name) }
    }

    /// The places of pictures among all; all places if none is named.
    pub fn places(&self, names: &[String]) -> Vec<usize> {
        let wanted: HashSet<&String> = names.iter().collect();
        let all = self.names.iter().enumerate();
        all.filter(|(_, name)| names.is_empty() || wanted.contains(name)).map(|(i, _)| i).collect()
    }

    /// Reads each picture whole: a broken one is found before hours of work. Returns what those at some places have in
    /// common.
    pub fn look(
        &self,
        places: &[usize],
        mut done: impl FnMut(usize),
    ) -> Result<Seen, StructureError> {
        let mut seen = Seen::new(self.widest, places.len());
        let size = seen.size();
        for (i, names) in self.names.chunks(AT_ONCE).enumerate() {
            let read = |name: &String| Ok(luma(&open_image(&self.folder.join(name))?, size));
            let lumas: Result<Vec<_>, FrameFileError> = names.par_iter().map(read).collect();
            let lumas = lumas.map_err(PosedError::from)?;
            let wanted = |at: usize| places.binary_search(&(AT_ONCE * i + at)).is_ok();
            for (_, luma) in lumas.iter().enumerate().filter(|(at, _)| wanted(*at)) {
                seen.add(luma);
            }
            done(AT_ONCE * i + names.len());
        }
        Ok(seen)
    }
}

/// Adds the files of pictures. Names that begin with a dot are left out.
fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> Result<(), StructureError> {
    for entry in std::fs::read_dir(folder).map_err(StructureError::file(folder))? {
        let path = entry.map_err(StructureError::file(folder))?.path();
        if path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b".")) {
            continue;
        }
        if path.is_dir() {
            collect(&path, files)?;
        } else if is_picture(&path) {
            files.push(path);
        }
    }
    Ok(())
}

fn is_picture(path: &Path) -> bool {
    let ending = path.extension().and_then(|ending| ending.to_str());
    ending.is_some_and(|ending| ENDINGS.iter().any(|known| ending.eq_ignore_ascii_case(known)))
}

/// Pictures that share intrinsics must share a size. The widest one's size.
fn check_sizes(files: &[PathBuf], lenses: Lenses) -> Result<(u32, u32), StructureError> {
    let mut first: Option<(&PathBuf, (u32, u32))> = None;
    let mut widest = (0, 0);
    for file in files {
        let found = size(file)?;
        widest = widest.max(found);
        let of_one_lens = |(other, _): &(&PathBuf, (u32, u32))| match lenses {
            Lenses::One => true,
            Lenses::Folder => other.parent() == file.parent(),
            Lenses::Picture => false,
        };
        match first.filter(of_one_lens) {
            None => first = Some((file, found)),
            Some((first, expected)) if expected != found => {
                let (path, first) = (file.clone(), first.clone());
                return Err(StructureError::Sizes { path, found, first, expected });
            }
            Some(_) => {}
        }
    }
    Ok(widest)
}

fn size(file: &Path) -> Result<(u32, u32), StructureError> {
    let reader = ImageReader::open(file).map_err(StructureError::file(file))?;
    let reader = reader.with_guessed_format().map_err(StructureError::file(file))?;
    let failed = |error| FrameFileError::Image { path: file.to_path_buf(), error };
    Ok(reader.into_dimensions().map_err(failed).map_err(PosedError::from)?)
}

/// A check sum over names, sizes and times of files.
#[derive(Default)]
struct Digest {
    count: usize,
    sum: crc32fast::Hasher,
}

impl Digest {
    fn add(&mut self, file: &Path) -> Result<(), StructureError> {
        let metadata = std::fs::metadata(file).map_err(StructureError::file(file))?;
        let changed = metadata.modified().ok().and_then(|t| t.duration_since(UNIX_EPOCH).ok());
        let facts = (file, metadata.len(), changed);
        self.sum.update(format!("{facts:?}").as_bytes());
        self.count += 1;
        Ok(())
    }

    fn text(self) -> String {
        format!("{} pictures, {:08x}", self.count, self.sum.finalize())
    }
}
