//! Pictures with poses, for training: from camera files and from COLMAP's models.

mod input;
mod picture;

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use crate::camera_file::{CameraFileError, PosedFile, with_ending};
use crate::colmap::{ColmapError, ColmapModel};
use crate::frame_file::FrameFileError;
use crate::points::{Point, PointsError, read_points};
use glam::DVec3;
pub use input::PosedInput;
use nvsprior::geometry::{Lens, LensError};
use nvsprior::prior::origin_of;

/// Posed pictures, and what else is known of their scene.
#[derive(Clone, Debug)]
pub struct PosedPictures {
    /// The pictures: in time order from a camera file, by name from COLMAP; at least one.
    pub inputs: Vec<PosedInput>,
    /// Points of the scene, if there are any.
    pub points: Option<Vec<Point>>,
}

impl PosedPictures {
    /// What coordinates should count from: zero, unless cameras and points lie too far from there for 32-bit numbers.
    pub fn far_origin(&self) -> DVec3 {
        let cameras = self.inputs.iter().map(|input| input.pose.centre());
        let points = self.points.iter().flatten().map(|point| point.position);
        let places: Vec<[f64; 3]> = cameras.chain(points).map(Into::into).collect();
        origin_of(&places).unwrap_or_default().into()
    }

    /// Has coordinates count from another point.
    pub fn count_from(&mut self, origin: DVec3) {
        self.inputs.iter_mut().for_each(|input| input.pose = input.pose.relative_to(origin));
        self.points.iter_mut().flatten().for_each(|point| point.position -= origin);
    }
}

/// What to read besides the list of pictures. The default is what the list says of itself.
#[derive(Clone, Debug, Default)]
pub struct PosedOptions {
    /// Folder that the pictures' names start from. By default the folder of a camera file; for a
    /// COLMAP model, the folder `images` in the given folder, or up to two folders above the model.
    pub pictures: Option<PathBuf>,
    /// Folder of masks, PNGs: `a/b.png` or `a/b.jpg.png` for the picture `a/b.jpg`, or `b.png` if no
    /// two pictures are named `b`. All of a picture counts if it has none. By default the files that
    /// nerfstudio's `mask_path` names.
    pub masks: Option<PathBuf>,
    /// A point cloud (PLY). By default a COLMAP model's own, or that which nerfstudio's
    /// `ply_file_path` names.
    pub points: Option<PathBuf>,
    /// Only the pictures of this split.
    pub split: Option<String>,
}

#[derive(Debug, thiserror::Error)]
pub enum PosedError {
    #[error(transparent)]
    CameraFile(#[from] CameraFileError),
    #[error(transparent)]
    Colmap(#[from] ColmapError),
    #[error(transparent)]
    Points(#[from] PointsError),
    #[error(transparent)]
    Frame(#[from] FrameFileError),
    #[error("{}: {error}", path.display())]
    Lens { path: PathBuf, error: LensError },
    #[error("{}: there is no such file or folder", path.display())]
    Nothing { path: PathBuf },
    #[error("{}: no pictures in it", path.display())]
    Empty { path: PathBuf },
    #[error("{}: neither a COLMAP model (cameras.bin or cameras.txt) in it, nor in its folders \
        sparse/0 and sparse; for a camera file, give the file", path.display())]
    NoModel { path: PathBuf },
    #[error("{}: no folder \"images\" by this COLMAP model; say where its pictures are",
        path.display())]
    NoFolder { path: PathBuf },
    #[error("{}: its picture {name} is not there: {}", path.display(), file.display())]
    Missing { path: PathBuf, name: String, file: PathBuf },
    #[error("{}: no mask in it is named as a picture is, such as {}", path.display(),
        example.display())]
    NoMasks { path: PathBuf, example: PathBuf },
    #[error("{}: no picture of split \"{split}\"; there are: {known}", path.display())]
    Split { path: PathBuf, split: String, known: String },
}

/// Reads which pictures there are, from `cameras.json`, nerfstudio's `transforms.json`, or a folder
/// with a COLMAP model: the model's own, or one with it as `sparse/0` or `sparse`. Pictures are not
/// read, but all must be there.
pub fn posed_pictures(path: &Path, options: &PosedOptions) -> Result<PosedPictures, PosedError> {
    let listed = if path.is_dir() {
        of_model(path, options)?
    } else if path.exists() {
        of_camera_file(path, options)?
    } else {
        return Err(PosedError::Nothing { path: path.to_path_buf() });
    };
    checked(listed, path, options)
}

/// The pictures of a COLMAP model that was read from a folder, and the folder that their names start from.
pub fn pictures_of_model(
    model: ColmapModel,
    (path, pictures): (&Path, &Path),
    masks: Option<&Path>,
) -> Result<PosedPictures, PosedError> {
    let masks = masks.map(Path::to_path_buf);
    checked(listed(model, pictures), path, &PosedOptions { masks, ..PosedOptions::default() })
}

/// What was listed, with what the options add to it. All pictures must be there.
fn checked(
    (mut inputs, points): Listed,
    path: &Path,
    options: &PosedOptions,
) -> Result<PosedPictures, PosedError> {
    let own = || path.to_path_buf();
    if inputs.is_empty() {
        return Err(PosedError::Empty { path: own() });
    }
    if let Some(masks) = &options.masks {
        find_masks(&mut inputs, masks)?;
    }
    if let Some(split) = &options.split {
        inputs = of_split(inputs, split, path)?;
    }
    let there = |file: &Path| file.is_file();
    if let Some(PosedInput { name, file, .. }) = inputs.iter().find(|i| !there(&i.file)) {
        let (name, file) = (name.clone(), file.clone());
        return Err(PosedError::Missing { path: own(), name, file });
    }
    let given = options.points.as_deref().map(read_points).transpose()?;
    Ok(PosedPictures { inputs, points: given.or(points) })
}

/// The lens of the first picture that a list names, of a split if that is given. The pictures need not be there.
pub fn lens_of(path: &Path, split: Option<&str>) -> Result<Lens, PosedError> {
    let own = || path.to_path_buf();
    let (mut inputs, _) = if path.is_dir() {
        let pictures = Some(PathBuf::new());
        of_model(path, &PosedOptions { pictures, ..PosedOptions::default() })?
    } else if path.exists() {
        (PosedFile::open(path)?.inputs, None)
    } else {
        return Err(PosedError::Nothing { path: own() });
    };
    if let Some(split) = split {
        inputs = of_split(inputs, split, path)?;
    }
    inputs.first().map(|input| input.lens).ok_or_else(|| PosedError::Empty { path: own() })
}

type Listed = (Vec<PosedInput>, Option<Vec<Point>>);

fn of_camera_file(path: &Path, options: &PosedOptions) -> Result<Listed, PosedError> {
    let PosedFile { mut inputs, points } = PosedFile::open(path)?;
    if let Some(pictures) = &options.pictures {
        for input in &mut inputs {
            input.file = with_ending(pictures.join(&input.name));
        }
    }
    let points = points.filter(|_| options.points.is_none());
    Ok((inputs, points.as_deref().map(read_points).transpose()?))
}

fn of_model(path: &Path, options: &PosedOptions) -> Result<Listed, PosedError> {
    let own = || path.to_path_buf();
    let folders = [own(), path.join("sparse/0"), path.join("sparse")];
    let folder = folders.into_iter().find(|folder| ColmapModel::is_in(folder));
    let folder = folder.ok_or_else(|| PosedError::NoModel { path: own() })?;
    let pictures = match &options.pictures {
        Some(pictures) => pictures.clone(),
        None => pictures_by(path, &folder).ok_or_else(|| PosedError::NoFolder { path: own() })?,
    };
    Ok(listed(ColmapModel::open(&folder)?, &pictures))
}

fn listed(ColmapModel { views, points }: ColmapModel, pictures: &Path) -> Listed {
    let inputs = views.into_iter().map(|view| PosedInput {
        file: pictures.join(&view.name),
        name: view.name,
        lens: view.lens,
        pose: view.pose,
        split: None,
        mask: None,
    });
    (inputs.collect(), Some(points))
}

/// The folder of pictures that belongs to a model found in `folder`, from what was given.
fn pictures_by(given: &Path, folder: &Path) -> Option<PathBuf> {
    // The parents of a relative path are in its absolute form.
    let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_path_buf());
    let above = folder.ancestors().take(3);
    let candidates = std::iter::once(given).chain(above).map(|folder| folder.join("images"));
    candidates.into_iter().find(|folder| folder.is_dir())
}

fn of_split(
    inputs: Vec<PosedInput>,
    split: &str,
    path: &Path,
) -> Result<Vec<PosedInput>, PosedError> {
    let mut known: Vec<_> = inputs.iter().filter_map(|i| i.split.clone()).collect();
    known.sort_unstable();
    known.dedup();
    let wanted = |input: &PosedInput| input.split.as_deref() == Some(split);
    let inputs: Vec<_> = inputs.into_iter().filter(wanted).collect();
    if inputs.is_empty() {
        let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
        let (path, split) = (path.to_path_buf(), split.to_owned());
        return Err(PosedError::Split { path, split, known });
    }
    Ok(inputs)
}

/// Gives the pictures the masks that a folder has for them.
fn find_masks(inputs: &mut [PosedInput], folder: &Path) -> Result<(), PosedError> {
    let stem = |input: &PosedInput| Path::new(&input.name).file_stem().map(PathBuf::from);
    let mut stems = HashSet::new();
    let distinct = inputs.iter().all(|input| stems.insert(stem(input)));
    let (mut found, mut example) = (false, folder.to_path_buf());
    for input in inputs {
        let place = folder.join(&input.name);
        let mut candidates = vec![place.with_extension("png"), place.with_added_extension("png")];
        let bare = stem(input).filter(|_| distinct);
        candidates.extend(bare.map(|stem| folder.join(stem).with_added_extension("png")));
        example.clone_from(&candidates[0]);
        if let Some(mask) = candidates.into_iter().find(|file| file.is_file()) {
            (found, input.mask) = (true, Some(mask));
        }
    }
    let path = folder.to_path_buf();
    if found { Ok(()) } else { Err(PosedError::NoMasks { path, example }) }
}

#[cfg(test)]
mod tests;
