//! The file beside a prior of a foreign format: `prior.ply.nvsx` beside `prior.ply`.
//!
//! It holds [`Extras`], and names the prior that they belong to. Files of our own formats hold theirs themselves:
//! nothing is looked for beside them.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::beside;
use super::container::{Container, Format, Head};
use super::error::PriorError;
use super::extras::Extras;
use super::id::PriorId;

/// More than such a file has: a byte for each splat, and what does not grow with them.
const MAX_BYTES: u64 = 1 << 33;

/// The file beside a prior's.
pub fn path_beside(prior: &Path) -> PathBuf {
    beside::path(prior, "nvsx")
}

/// Reads the file beside the prior at `path`, which has this identity and so many splats; `None` if there is none.
///
/// # Errors
/// If it cannot be read, is damaged, or belongs to another prior. They name the file.
pub fn read(path: &Path, id: PriorId, splats: usize) -> Result<Option<Extras>, PriorError> {
    let path = path_beside(path);
    if beside::is_absent(&path) {
        return Ok(None);
    }
    let read = || from_bytes(&beside::read(&path, MAX_BYTES, Format::Beside.text())?, id, splats);
    read().map(Some).map_err(|error| error.in_file(&path.display().to_string()))
}

/// The name of such a file in the folder of the prior at `path`: it belongs to this prior, but bears another name.
pub(super) fn misnamed(path: &Path, id: PriorId) -> Option<String> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let entries = std::fs::read_dir(folder.unwrap_or(Path::new("."))).ok()?;
    let belongs = |path: &Path| {
        let mut start = [0; Head::BYTES];
        if !path.is_file() {
            return false; // What a pipe's other end never writes.
        }
        let read = File::open(path).and_then(|mut file| file.read_exact(&mut start));
        let head = read.ok().and_then(|()| Head::read(&start, Format::Beside, u64::MAX).ok());
        head.is_some_and(|head| head.id == id)
    };
    let paths = entries.flatten().map(|entry| entry.path());
    let found = paths.filter(|path| path.extension().is_some_and(|e| e == "nvsx") && belongs(path));
    found.filter_map(|path| Some(path.file_name()?.to_string_lossy().into_owned())).min()
}

/// Reads the content of such a file, as [`read`] does.
///
/// # Errors
/// If it is no such file, is damaged, or belongs to another prior.
pub fn from_bytes(bytes: &[u8], id: PriorId, splats: usize) -> Result<Extras, PriorError> {
    let file = Container::read(bytes, Format::Beside)?;
    if file.head.id != id {
        return Err(PriorError::Foreign { stated: file.head.id, found: id });
    }
    let extras = Extras::read(&file)?;
    extras.check(splats)?;
    Ok(extras)
}

/// The content of such a file, for a prior of this identity and so many splats.
pub fn to_bytes(extras: &Extras, id: PriorId, splats: usize) -> Vec<u8> {
    let mut file = Container::new(Head::new(Format::Beside, 0, splats, id));
    extras.put(&mut file);
    file.to_bytes()
}

#[cfg(test)]
mod tests {
    use super::super::tests::{bare, sample_splats};
    use super::super::{KeyFrames, Prior, RenderOptions, RenderOverrides, compact, ply};
    use super::*;
    use crate::image::Preprocessing;
    use crate::prior::key_frames::tests::sample_key_frames;

    /// A folder with `p.ply`, in which there are two key frames, and the prior's path.
    fn folder() -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.ply");
        let mut bytes = Vec::new();
        let (splats, keys) = (sample_splats(3, 0), sample_key_frames(2));
        let (options, none) = (RenderOptions::INRIA, Preprocessing::NONE);
        ply::write_ply(&splats, &options, &keys, &none, &mut bytes).unwrap();
        std::fs::write(&path, bytes).unwrap();
        (folder, path)
    }

    fn open(path: &Path) -> Result<Prior, PriorError> {
        Prior::open(path, &RenderOverrides::default())
    }

    #[test]
    fn it_comes_before_what_the_foreign_file_says() {
        let (_folder, path) = folder();
        let plain = open(&path).unwrap();
        assert_eq!(plain.key_frames().len(), 2);
        let beside = path_beside(&path);
        assert!(beside.to_str().unwrap().ends_with("p.ply.nvsx"));
        let extras = Extras {
            key_frames: sample_key_frames(5),
            doubt: Some(vec![1, 2, 3]),
            ..Extras::default()
        };
        std::fs::write(&beside, to_bytes(&extras, plain.id(), 3)).unwrap();
        let with = open(&path).unwrap();
        assert_eq!((with.key_frames().len(), with.id()), (5, plain.id()));
        assert_eq!(with.extras().doubt, extras.doubt);
        // Render options that a user gives make another prior, of the same splats.
        let overrides = RenderOverrides { near: Some(0.5), ..RenderOverrides::default() };
        let other = Prior::open(&path, &overrides).unwrap();
        assert!(other.id() != plain.id() && other.key_frames().len() == 5);
        // In memory there is no file beside.
        let bytes = std::fs::read(&path).unwrap();
        let inside = Prior::from_bytes(&bytes, "p.ply", &RenderOverrides::default()).unwrap();
        assert_eq!(inside.key_frames().len(), 2);
        // A list of none is a list.
        std::fs::write(&beside, to_bytes(&Extras::default(), plain.id(), 3)).unwrap();
        assert_eq!(open(&path).unwrap().key_frames(), &KeyFrames::NONE);
    }

    #[test]
    fn one_that_does_not_belong_to_the_prior_is_named() {
        let (_folder, path) = folder();
        let id = open(&path).unwrap().id();
        let beside = path_beside(&path);
        let error = |bytes: &[u8]| {
            std::fs::write(&beside, bytes).unwrap();
            open(&path).unwrap_err().to_string()
        };
        let valid = to_bytes(&Extras::default(), id, 3);
        let foreign = error(&to_bytes(&Extras::default(), PriorId(id.0 ^ 1), 3));
        assert!(foreign.contains("p.ply.nvsx: about prior"), "{foreign}");
        let doubt = Extras { doubt: Some(vec![7; 2]), ..Extras::default() };
        let short = error(&to_bytes(&doubt, id, 3));
        assert!(short.contains("p.ply.nvsx: array doubt holds 2 entries"), "{short}");
        let cut = error(&valid[..20]);
        assert!(cut.contains("p.ply.nvsx: truncated"), "{cut}");
        let other = error(b"a note");
        assert!(other.contains("p.ply.nvsx: neither"), "{other}");
        std::fs::remove_file(&beside).unwrap();
        std::fs::create_dir(&beside).unwrap();
        let folder = open(&path).unwrap_err().to_string();
        assert!(folder.contains("p.ply.nvsx: no file of"), "{folder}");
    }

    /// A tool that writes the prior anew under another name leaves the file beside it as it is.
    #[test]
    fn one_under_another_name_is_told() {
        let (folder, path) = folder();
        let prior = open(&path).unwrap();
        let told = |path: &Path| -> Vec<String> { open(path).unwrap().report().notes().collect() };
        let extras = Extras { key_frames: sample_key_frames(5), ..Extras::default() };
        std::fs::write(path_beside(&path), to_bytes(&extras, prior.id(), 3)).unwrap();
        let others = to_bytes(&extras, PriorId(prior.id().0 ^ 1), 3);
        std::fs::write(folder.path().join("a.ply.nvsx"), others).unwrap();
        std::fs::write(folder.path().join("b.ply.nvsx"), b"nvsx").unwrap();
        std::fs::create_dir(folder.path().join("c.nvsx")).unwrap();
        assert_eq!(told(&path), [""; 0]);
        let renamed = folder.path().join("scaled.ply");
        std::fs::copy(&path, &renamed).unwrap();
        let [note] = &told(&renamed)[..] else { panic!("{:?}", told(&renamed)) };
        assert!(note.contains("p.ply.nvsx holds this prior's key frames"), "{note}");
        assert!(note.ends_with("scaled.ply.nvsx"), "{note}");
        std::fs::copy(path_beside(&path), path_beside(&renamed)).unwrap();
        assert_eq!(told(&renamed), [""; 0]);
        assert_eq!(open(&renamed).unwrap().key_frames().len(), 5);
    }

    #[test]
    fn nothing_is_looked_for_beside_our_own_files() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.nvsg");
        let mut bytes = Vec::new();
        let (splats, fine) = (sample_splats(3, 0), Default::default());
        compact::write(&splats, &bare(&RenderOptions::INRIA), &fine, &mut bytes).unwrap();
        std::fs::write(&path, bytes).unwrap();
        std::fs::write(path_beside(&path), b"a note").unwrap();
        open(&path).unwrap();
    }
}
