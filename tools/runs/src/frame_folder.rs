//! Folders that get a file for each frame, and never hold those of two runs at once.
//!
//! If files of an earlier run are replaced, the new ones are written to a folder inside of it. Once all are whole, that
//! folder gets another name; from there on the old files go and the new ones come, and whoever opens the folder next
//! ends that if this process could not.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs::{self, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use nvsprior::Picture;

use crate::output::{OutputError, make_folder};
use crate::png_file::{PngFileError, is_marked, marked_grey_png, marked_png};

#[derive(Debug, thiserror::Error)]
pub enum FrameFolderError {
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error("{option} {}: holds files of this kind already, such as {example}: two runs would be mixed. Give another \
        folder, or --overwrite, which removes those that such a command wrote", path.display())]
    Holds { option: &'static str, path: PathBuf, example: String },
    #[error("{}: is there already: two frames have this name, or it is not this command's file. Give each frame \
        another name, or another folder", path.display())]
    Twice { path: PathBuf },
    #[error("cannot write {}: {error}", path.display())]
    Write { path: PathBuf, error: std::io::Error },
    #[error(transparent)]
    Picture(#[from] PngFileError),
}

/// What a folder's files are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameKind {
    /// All that end so are a command's own: nobody else writes them.
    Ending(&'static str),
    /// PNGs, of which those are a command's own whose text "Software" is this.
    Picture(&'static str),
}

impl FrameKind {
    pub const PACKET: FrameKind = FrameKind::Ending("nvsp");
    pub const RECONSTRUCTION: FrameKind = FrameKind::Picture("nvsprior: reconstruction");
    pub const RENDER: FrameKind = FrameKind::Picture("nvsprior: render");
    pub const TRUTH: FrameKind = FrameKind::Picture("nvsprior: truth map");
    pub const OVERLAY: FrameKind = FrameKind::Picture("nvsprior: overlay");
    pub const DOUBT: FrameKind = FrameKind::Picture("nvsprior: doubt");

    fn ending(self) -> &'static str {
        match self {
            FrameKind::Ending(ending) => ending,
            FrameKind::Picture(_) => "png",
        }
    }

    /// What its PNGs say of themselves.
    pub fn mark(self) -> &'static str {
        match self {
            FrameKind::Ending(_) => "nvsprior",
            FrameKind::Picture(mark) => mark,
        }
    }

    fn is_own(self, file: &Path) -> bool {
        match self {
            FrameKind::Ending(_) => true,
            FrameKind::Picture(mark) => is_marked(file, mark),
        }
    }
}

/// Where new files lie that replace others.
struct Stages {
    /// Until all are whole.
    new: PathBuf,
    /// While the old ones go, those that [`OLD`] in it lists.
    whole: PathBuf,
    /// While they move out of it.
    moving: PathBuf,
}

/// The names of the old files, a line each.
const OLD: &str = ".old";

impl Stages {
    fn of(folder: &Path, ending: &str) -> Stages {
        let stage = |name: &str| folder.join(format!(".nvsprior-{name}-{ending}"));
        Stages { new: stage("new"), whole: stage("whole"), moving: stage("moving") }
    }
}

/// A folder that gets a file for each frame.
#[derive(Debug)]
pub struct FrameFolder {
    folder: PathBuf,
    kind: FrameKind,
    /// Where the files are written: the folder itself, unless it holds some of an earlier run.
    to: PathBuf,
    /// Files that may be written again.
    again: BTreeSet<String>,
}

impl FrameFolder {
    /// Makes the folder if it is missing. One that holds files of the kind is refused, unless they may be replaced.
    pub fn open(
        option: &'static str,
        folder: &Path,
        kind: FrameKind,
        overwrite: bool,
    ) -> Result<FrameFolder, FrameFolderError> {
        let path = || folder.to_path_buf();
        make_folder(option, folder)?;
        let failed = |error| FrameFolderError::Write { path: path(), error };
        end_replacing(folder, kind.ending()).map_err(failed)?;
        let there = files_of(folder, kind.ending()).map_err(failed)?;
        let mut to = path();
        if let Some(first) = there.first() {
            if !overwrite {
                let example = first.file_name().unwrap_or_default().to_string_lossy().into_owned();
                return Err(FrameFolderError::Holds { option, path: path(), example });
            }
            to = Stages::of(folder, kind.ending()).new;
            // It may be of a run that was ended before its files were whole.
            let gone = if to.exists() { fs::remove_dir_all(&to) } else { Ok(()) };
            gone.and_then(|()| fs::create_dir(&to)).map_err(failed)?;
        }
        Ok(FrameFolder { folder: path(), kind, to, again: BTreeSet::new() })
    }

    /// Writes a file. A name that is taken is refused; a file that cannot be written whole does not stay.
    pub fn write(&mut self, name: &str, bytes: &[u8]) -> Result<(), FrameFolderError> {
        let (path, last) = (self.to.join(name), self.folder.join(name));
        let twice = || FrameFolderError::Twice { path: last.clone() };
        if self.to != self.folder && last.exists() && !self.kind.is_own(&last) {
            return Err(twice());
        }
        let failed = |error: std::io::Error| match error.kind() {
            ErrorKind::AlreadyExists => twice(),
            _ => FrameFolderError::Write { path: last.clone(), error },
        };
        let mut file =
            OpenOptions::new().write(true).create_new(true).open(&path).map_err(failed)?;
        file.write_all(bytes).map_err(|error| {
            // The first error is the one to tell.
            let _ = fs::remove_file(&path);
            failed(error)
        })
    }

    /// Writes NAME.png.
    pub fn write_picture(&mut self, name: &str, picture: &Picture) -> Result<(), FrameFolderError> {
        self.write_png(name, |mark| marked_png(picture, Some(mark)))
    }

    /// Writes NAME.png, of grey levels in rows.
    pub fn write_grey(
        &mut self,
        name: &str,
        (width, height): (u32, u32),
        levels: &[u8],
    ) -> Result<(), FrameFolderError> {
        self.write_png(name, |mark| marked_grey_png((width, height), levels, mark))
    }

    fn write_png(
        &mut self,
        name: &str,
        png: impl FnOnce(&str) -> Result<Vec<u8>, png::EncodingError>,
    ) -> Result<(), FrameFolderError> {
        let name = format!("{name}.png");
        let failed = |error| PngFileError::Write { path: self.folder.join(&name), error };
        let bytes = png(self.kind.mark()).map_err(failed)?;
        self.write(&name, &bytes)
    }

    /// As [`write`](Self::write), but a file that this command wrote before may be replaced.
    pub fn write_again(&mut self, name: &str, bytes: &[u8]) -> Result<(), FrameFolderError> {
        if self.again.contains(name) {
            let path = self.to.join(name);
            let beside = path.with_added_extension("part");
            let written = fs::write(&beside, bytes).and_then(|()| fs::rename(&beside, &path));
            return written.map_err(|error| {
                // The first error is the one to tell.
                let _ = fs::remove_file(&beside);
                FrameFolderError::Write { path, error }
            });
        }
        self.write(name, bytes)?;
        self.again.insert(name.to_owned());
        Ok(())
    }

    /// What this command wrote before.
    pub fn read(&self, name: &str) -> std::io::Result<Vec<u8>> {
        fs::read(self.to.join(name))
    }

    /// Removes what this command wrote before.
    pub fn remove(&mut self, name: &str) -> std::io::Result<()> {
        self.again.remove(name);
        fs::remove_file(self.to.join(name))
    }

    /// All files are written: they take the place of an earlier run's.
    pub fn finish(&mut self) -> Result<(), FrameFolderError> {
        self.replace().map_err(|error| FrameFolderError::Write { path: self.folder.clone(), error })
    }

    fn replace(&mut self) -> std::io::Result<()> {
        if self.to == self.folder {
            return Ok(());
        }
        let old = files_of(&self.folder, self.kind.ending())?;
        let own = old.iter().filter(|file| self.kind.is_own(file));
        let names: Vec<&OsStr> = own.filter_map(|file| file.file_name()).collect();
        fs::write(self.to.join(OLD), names.join(OsStr::new("\n")).as_encoded_bytes())?;
        fs::rename(&self.to, Stages::of(&self.folder, self.kind.ending()).whole)?;
        self.to.clone_from(&self.folder);
        end_replacing(&self.folder, self.kind.ending())
    }
}

impl Drop for FrameFolder {
    fn drop(&mut self) {
        if self.to != self.folder {
            // Files of a command that has failed.
            let _ = fs::remove_dir_all(&self.to);
        }
    }
}

/// Ends what a process was at that replaced a folder's files of an ending, if there is any.
pub fn end_replacing(folder: &Path, ending: &str) -> std::io::Result<()> {
    let Stages { whole, moving, .. } = Stages::of(folder, ending);
    if whole.is_dir() {
        for name in fs::read_to_string(whole.join(OLD))?.lines() {
            match fs::remove_file(folder.join(name)) {
                Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
                _ => {}
            }
        }
        fs::rename(&whole, &moving)?;
    }
    if moving.is_dir() {
        for entry in fs::read_dir(&moving)? {
            let entry = entry?;
            match entry.file_name() == OLD {
                true => fs::remove_file(entry.path())?,
                false => fs::rename(entry.path(), folder.join(entry.file_name()))?,
            }
        }
        fs::remove_dir(&moving)?;
    }
    Ok(())
}

/// Removes a folder's files of a kind that commands wrote: for programs whose folder it is.
pub fn remove_own(folder: &Path, kind: FrameKind) -> std::io::Result<()> {
    let files = if folder.is_dir() { files_of(folder, kind.ending())? } else { Vec::new() };
    files.iter().filter(|file| kind.is_own(file)).try_for_each(fs::remove_file)
}

/// A folder's files of an ending, in the order of their names.
pub fn files_of(folder: &Path, ending: &str) -> std::io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.extension().is_some_and(|own| own == ending) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PACKETS: FrameKind = FrameKind::PACKET;
    const PICTURES: FrameKind = FrameKind::RECONSTRUCTION;

    fn open(
        folder: &Path,
        kind: FrameKind,
        overwrite: bool,
    ) -> Result<FrameFolder, FrameFolderError> {
        FrameFolder::open("--packets", folder, kind, overwrite)
    }

    /// The names in a folder with what is in the files.
    fn content(folder: &Path) -> Vec<String> {
        let text = |path: &PathBuf| String::from_utf8_lossy(&fs::read(path).unwrap()).into_owned();
        let named = |entry: fs::DirEntry| {
            let name = entry.file_name().to_string_lossy().into_owned();
            if entry.path().is_dir() { name } else { format!("{name} {}", text(&entry.path())) }
        };
        let mut names: Vec<_> = fs::read_dir(folder).unwrap().map(|e| named(e.unwrap())).collect();
        names.sort();
        names
    }

    #[test]
    fn an_earlier_run_is_refused_or_replaced_as_a_whole() {
        let place = tempfile::tempdir().unwrap();
        let folder = &place.path().join("a/packets");
        let mut first = open(folder, PACKETS, false).unwrap();
        for name in ["1.nvsp", "2.nvsp", "3.nvsp"] {
            first.write(name, b"old").unwrap();
        }
        first.finish().unwrap();
        fs::write(folder.join("notes.txt"), "kept").unwrap();
        let refused = open(folder, PACKETS, false).unwrap_err().to_string();
        assert!(refused.contains("1.nvsp") && refused.contains("--overwrite"), "{refused}");
        let mut second = open(folder, PACKETS, true).unwrap();
        second.write("2.nvsp", b"new").unwrap();
        // Until all are written the old ones are there.
        assert!(content(folder).contains(&"2.nvsp old".into()));
        second.finish().unwrap();
        assert_eq!(content(folder), ["2.nvsp new", "notes.txt kept"]);
        let mut failed = open(folder, PACKETS, true).unwrap();
        failed.write("9.nvsp", b"newer").unwrap();
        drop(failed);
        assert_eq!(content(folder), ["2.nvsp new", "notes.txt kept"]);
    }

    /// Whatever a process that is killed leaves, the next one makes the old or the new of it.
    #[test]
    fn a_kill_at_any_moment_leaves_the_old_or_the_new() {
        let (old, new) = (["1.nvsp old", "2.nvsp old"], ["2.nvsp new", "3.nvsp new"]);
        for moment in 0..6 {
            let place = tempfile::tempdir().unwrap();
            let folder = place.path();
            for name in ["1.nvsp", "2.nvsp"] {
                fs::write(folder.join(name), "old").unwrap();
            }
            let Stages { new: begun, whole, moving } = Stages::of(folder, "nvsp");
            fs::create_dir(&begun).unwrap();
            let steps: [&dyn Fn(); 6] = [
                &|| fs::write(begun.join("2.nvsp"), "new").unwrap(),
                &|| fs::write(begun.join("3.nvsp"), "new").unwrap(),
                &|| {
                    fs::write(begun.join(OLD), "1.nvsp\n2.nvsp").unwrap();
                    fs::rename(&begun, &whole).unwrap();
                },
                &|| fs::remove_file(folder.join("1.nvsp")).unwrap(),
                &|| {
                    fs::remove_file(folder.join("2.nvsp")).unwrap();
                    fs::rename(&whole, &moving).unwrap();
                },
                &|| fs::rename(moving.join("3.nvsp"), folder.join("3.nvsp")).unwrap(),
            ];
            steps[..=moment].iter().for_each(|step| step());
            end_replacing(folder, "nvsp").unwrap();
            let found = content(folder);
            match moment {
                0 | 1 => assert_eq!(found[1..], old, "{moment}"),
                _ => assert_eq!(found, new, "{moment}"),
            }
            drop(open(folder, PACKETS, true).unwrap());
            assert_eq!(content(folder), if moment < 2 { old } else { new }, "{moment}");
        }
    }

    #[test]
    fn names_that_fall_together_are_refused() {
        let place = tempfile::tempdir().unwrap();
        for overwrite in [false, true] {
            let mut folder = open(place.path(), PACKETS, overwrite).unwrap();
            folder.write("1.nvsp", b"first").unwrap();
            let error = folder.write("1.nvsp", b"second").unwrap_err();
            assert!(matches!(error, FrameFolderError::Twice { .. }), "{error}");
            folder.finish().unwrap();
            assert_eq!(content(place.path()), ["1.nvsp first"]);
        }
    }

    #[test]
    fn pictures_of_others_stay() {
        let place = tempfile::tempdir().unwrap();
        let picture = Picture::new(2, 1);
        let own = |name: &str, overwrite: bool| {
            let mut folder = open(place.path(), PICTURES, overwrite)?;
            folder.write_picture(name, &picture)?;
            folder.finish()
        };
        own("1", false).unwrap();
        crate::write_png(&place.path().join("frame.png"), &picture).unwrap();
        fs::write(place.path().join("strange.png"), "no picture").unwrap();
        own("2", true).unwrap();
        let there = |name: &str| place.path().join(name).exists();
        assert!(there("2.png") && there("frame.png") && there("strange.png") && !there("1.png"));
        assert!(matches!(own("frame", true), Err(FrameFolderError::Twice { .. })));
        assert!(there("2.png") && there("frame.png"), "what failed has removed nothing");
        remove_own(place.path(), PICTURES).unwrap();
        assert!(!there("2.png") && there("frame.png"));
    }
}
