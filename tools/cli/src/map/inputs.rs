//! What a prior is trained on.

use std::path::{Path, PathBuf};

use anyhow::Context;
use glam::DVec3;
use nvsprior::image::{Clahe, Preprocessing, Preprocessor, WhiteBalance};
use nvsprior::{Camera, Prior};
use nvsprior_inputs::args::{SizeArgs, WIDTH, progress};
use nvsprior_inputs::points::{Point, read_points};
use nvsprior_inputs::posed::{PosedInput, PosedOptions, PosedPictures, posed_pictures};
use nvsprior_inputs::values::{WrongUsage, make_folder};
use nvsprior_runs::{RunView, RunWriter, RunWriterError};
use nvsprior_train::PosedPicture;
use nvsprior_train::mapper::{ColouredPoint, MapOptions};
use rayon::prelude::*;

use super::budget::Budget;

/// Where the pictures, their poses and the scene's points are.
#[derive(clap::Args)]
pub struct InputArgs {
    /// cameras.json, nerfstudio's transforms.json, or the folder of a COLMAP model
    #[arg(
        long,
        value_name = "PATH",
        required_unless_present = "unposed",
        conflicts_with = "unposed"
    )]
    cameras: Option<PathBuf>,
    /// Folder that the pictures' names start from [default: as the camera file lies, or COLMAP's images/]
    #[arg(long, value_name = "DIR", conflicts_with = "unposed")]
    pictures: Option<PathBuf>,
    /// Folder of masks, PNGs named as the pictures are: white is what counts [default: those that the camera file
    /// names]
    #[arg(long, value_name = "DIR")]
    masks: Option<PathBuf>,
    /// Train on this split alone; the camera file's other splits are held out
    #[arg(long, value_name = "NAME", conflicts_with = "unposed")]
    split: Option<String>,
    /// If no other split is there to be held out: hold out every N-th picture; 0 holds out none
    #[arg(long, value_name = "N", default_value_t = 8)]
    held_out: usize,
    /// The points to start from (PLY) [default: those of the COLMAP model, else random ones]
    #[arg(long, value_name = "FILE")]
    points: Option<PathBuf>,
    /// Pictures wider than this are reduced to it, as in the paper; 0 keeps every size. Several, with commas between:
    /// train for each in its turn, so that one prior serves all; the widest must be a multiple of each other one
    #[arg(long, alias = "widths", value_name = "PIXELS,...", value_delimiter = ',', default_values_t = [WIDTH],
        value_parser = clap::value_parser!(u32).range(0..=i64::from(Camera::MAX_SIDE)))]
    width: Vec<u32>,
    /// Write the pictures without distortion, at the size that they are trained at, with their poses (cameras.json):
    /// what `prior trim`, `prior tables`, `encode` and `bench` read
    #[arg(long, value_name = "DIR")]
    undistorted: Option<PathBuf>,
    /// Bring the means of red, green and blue of each picture together (gray world). The prior says so, and the encoder
    /// does the same with its frames
    #[arg(long)]
    white_balance: bool,
    /// Equalise the contrast of each picture (CLAHE, 8×8 tiles), by at most this factor; after the white balance. The
    /// prior says so, and the encoder does the same with its frames [LIMIT: 2 if it is left out]
    #[arg(long, value_name = "LIMIT", num_args = 0..=1, default_missing_value = "2", value_parser = clahe)]
    clahe: Option<Clahe>,
}

fn clahe(text: &str) -> Result<Clahe, String> {
    let clip_limit = text.parse().map_err(|e| format!("{e}"))?;
    Clahe::new(clip_limit, Clahe::TILES).map_err(|e| e.to_string())
}

pub struct HeldOut {
    pub name: String,
    pub split: String,
    pub view: PosedPicture,
}

/// All that a prior is trained on, and measured by.
pub struct MapInputs {
    pub train: Vec<PosedPicture>,
    /// Pictures to measure by.
    pub held_out: Vec<HeldOut>,
    /// If each picture of this number is held out, of one run.
    every: Option<usize>,
    /// Points to start from; possibly none.
    pub points: Vec<ColouredPoint>,
}

impl MapInputs {
    /// Puts held-out pictures of the run back to their places among the others, to be trained on in the end. Returns
    /// these places.
    pub fn whole_run(&mut self) -> Vec<usize> {
        let Some(every) = self.every else { return Vec::new() };
        let held_out = self.held_out.iter().filter(|held| held.split == HELD_OUT);
        let places = (every / 2..).step_by(every).zip(held_out);
        let put = |(place, held): (usize, &HeldOut)| {
            self.train.insert(place, held.view.clone());
            place
        };
        places.map(put).collect()
    }
}

/// What is there to train on, before its pictures are read.
#[derive(Clone)]
pub struct Listed {
    /// Pictures to train on; at least one.
    pub train: Vec<PosedInput>,
    /// Pictures to measure by, each with the name of its split.
    pub held_out: Vec<(String, PosedInput)>,
    /// If each picture of this number is held out, of one run.
    pub every: Option<usize>,
    /// Points to start from; possibly none.
    pub points: Vec<ColouredPoint>,
    /// What all coordinates count from, in the world.
    pub origin: DVec3,
    /// The camera of the first picture, of the size that all are brought to.
    pub size: Camera,
    /// How much smaller the sizes are that are trained for.
    pub reductions: Vec<u32>,
}

impl Listed {
    /// Says what coordinates count from, if that is not zero.
    pub fn tell_origin(&self) {
        let DVec3 { x, y, z } = self.origin;
        if self.origin != DVec3::ZERO {
            tell!(
                "the scene lies far from the origin of its coordinates: the prior's splats count from {x}, {y}, {z}; \
                 poses are still the camera file's"
            );
        }
    }

    /// Pixels of the largest picture as it was taken.
    pub fn largest(&self) -> u64 {
        let held_out = self.held_out.iter().map(|(_, input)| input);
        let all = self.train.iter().chain(held_out).map(|input| input.lens.intrinsics());
        all.map(|lens| u64::from(lens.width) * u64::from(lens.height)).max().unwrap_or(0)
    }
}

struct Divided {
    train: Vec<PosedInput>,
    /// Each with the name of its split.
    held_out: Vec<(String, PosedInput)>,
    every: Option<usize>,
}

struct Read {
    view: PosedPicture,
    /// Its entry in the list of those written.
    written: Option<RunView>,
}

/// The split of pictures that are trained on, of a file without splits.
const TRAIN: &str = "train";
/// The split of pictures that are held out of a file without splits.
const HELD_OUT: &str = "held-out";

impl InputArgs {
    /// How pictures are treated.
    pub fn preprocessing(&self) -> Preprocessing {
        let white_balance = match self.white_balance {
            true => WhiteBalance::GrayWorld,
            false => WhiteBalance::None,
        };
        Preprocessing { white_balance, clahe: self.clahe }
    }

    /// The folder of masks, if one was given.
    pub fn masks(&self) -> Option<&Path> {
        self.masks.as_deref()
    }

    /// The width of the pictures that are trained on; `None`: as they are.
    pub fn width(&self) -> Option<u32> {
        self.sizes().most()
    }

    /// The size of all pictures.
    fn sizes(&self) -> SizeArgs {
        SizeArgs::of(self.width.iter().max().copied().unwrap_or(WIDTH))
    }

    /// How much smaller the sizes are that are trained for than pictures of a width.
    fn reductions(&self, width: u32) -> Result<Vec<u32>, WrongUsage> {
        let reduction = |own: &u32| match width.checked_rem(*own) {
            Some(0) => Ok(width / own),
            _ => Err(WrongUsage(format!(
                "--width: {width} is no multiple of {own}; the pictures are {width} pixels wide at most"
            ))),
        };
        match &self.width[..] {
            [_] => Ok(vec![1]),
            widths => widths.iter().map(reduction).collect(),
        }
    }

    /// Finds out before hours of work whether points and masks that were given are there.
    pub fn check(&self) -> anyhow::Result<()> {
        self.reductions(self.width.iter().max().copied().unwrap_or(WIDTH))?;
        if let Some(masks) = self.masks.as_deref().filter(|masks| !masks.is_dir()) {
            anyhow::bail!("{}: no folder of masks", masks.display());
        }
        self.points.as_deref().map(read_points).transpose()?;
        if let Some(folder) = &self.undistorted {
            make_folder("--undistorted", folder)?;
        }
        Ok(())
    }

    /// Finds pictures and poses, unless they were found already, and reads points. `origin`: of the prior that the
    /// training goes on with.
    pub fn list(
        &self,
        found: Option<PosedPictures>,
        origin: Option<DVec3>,
    ) -> anyhow::Result<Listed> {
        let mut listed = match (found, &self.cameras) {
            (Some(found), _) => {
                let given = self.points.as_deref().map(read_points).transpose()?;
                PosedPictures { points: given.or(found.points), ..found }
            }
            (None, Some(cameras)) => posed_pictures(cameras, &self.posed_options())?,
            (None, None) => anyhow::bail!("neither pictures nor --cameras"),
        };
        let origin = origin.unwrap_or_else(|| listed.far_origin());
        listed.count_from(origin);
        let points = listed.points.unwrap_or_default();
        let Divided { train, held_out, every } = self.divide(listed.inputs)?;
        let size =
            train.first().map(|input| self.camera(input)).context("no picture to train on")?;
        let points = points.iter().map(coloured).collect();
        let reductions = self.reductions(size.width)?;
        Ok(Listed { train, held_out, every, points, origin, size, reductions })
    }

    fn posed_options(&self) -> PosedOptions {
        PosedOptions {
            pictures: self.pictures.clone(),
            points: self.points.clone(),
            masks: self.masks.clone(),
            ..PosedOptions::default()
        }
    }

    /// Reads the pictures and treats them, and writes them as they are trained on, if that is wanted.
    pub fn read(&self, listed: Listed, preprocessing: &Preprocessing) -> anyhow::Result<MapInputs> {
        let writer = self.undistorted.as_deref().map(RunWriter::new);
        self.read_and_write(listed, preprocessing, writer)
    }

    /// As [`read`](Self::read), of a part of a run. All pictures are [written](Self::write_undistorted) together.
    pub fn read_part(
        &self,
        listed: Listed,
        preprocessing: &Preprocessing,
    ) -> anyhow::Result<MapInputs> {
        self.read_and_write(listed, preprocessing, None)
    }

    fn read_and_write(
        &self,
        listed: Listed,
        preprocessing: &Preprocessing,
        writer: Option<RunWriter>,
    ) -> anyhow::Result<MapInputs> {
        let Listed { train, held_out, every, points, origin, size, reductions } = listed;
        let smaller = self.smaller(&held_out, &size, &reductions, preprocessing)?;
        let bar = progress(train.len() + held_out.len(), "pictures");
        let split = self.split.as_deref().unwrap_or(TRAIN);
        let read = |split: &str, input: &PosedInput| {
            let writer = writer.as_ref().map(|writer| (writer, origin));
            let read = self.read_one(&size, (writer, split), preprocessing, input);
            bar.inc(1);
            read
        };
        let train: Vec<_> =
            train.par_iter().map(|input| read(split, input)).collect::<anyhow::Result<_>>()?;
        let held_out: Vec<_> = held_out
            .par_iter()
            .map(|(split, input)| Ok((input.name.clone(), split.clone(), read(split, input)?)))
            .collect::<anyhow::Result<_>>()?;
        bar.finish_and_clear();
        if let Some(writer) = writer {
            let held_out = held_out.iter().map(|(.., read)| read);
            let views: Vec<_> =
                train.iter().chain(held_out).filter_map(|read| read.written.clone()).collect();
            writer.list(size, &views)?;
        }
        let train = train.into_iter().map(|read| read.view).collect();
        let held_out = held_out.into_iter();
        let held_out = held_out.map(|(name, split, read)| HeldOut { name, split, view: read.view });
        Ok(MapInputs { train, held_out: held_out.chain(smaller).collect(), every, points })
    }

    /// Writes the pictures of a run as they are trained on, if that is wanted, without keeping them.
    pub fn write_undistorted(&self, listed: &Listed) -> anyhow::Result<()> {
        let Some(writer) = self.undistorted.as_deref().map(RunWriter::new) else { return Ok(()) };
        let split = self.split.as_deref().unwrap_or(TRAIN);
        let train = listed.train.iter().map(|input| (split, input));
        let held_out = listed.held_out.iter().map(|(split, input)| (split.as_str(), input));
        let all: Vec<_> = train.chain(held_out).collect();
        let bar = progress(all.len(), "pictures without distortion");
        let write = |(split, input): &(&str, &PosedInput)| {
            let how = (Some((&writer, listed.origin)), *split);
            let read = self.read_one(&listed.size, how, &Preprocessing::NONE, input);
            bar.inc(1);
            read.map(|read| read.written)
        };
        let views: Vec<_> = all.par_iter().map(write).collect::<anyhow::Result<_>>()?;
        bar.finish_and_clear();
        let views: Vec<_> = views.into_iter().flatten().collect();
        Ok(writer.list(listed.size, &views)?)
    }

    /// Reads a picture as it is measured by.
    pub fn read_picture(
        &self,
        input: &PosedInput,
        size: &Camera,
        preprocessing: &Preprocessing,
    ) -> anyhow::Result<PosedPicture> {
        Ok(self.read_one(size, (None, HELD_OUT), preprocessing, input)?.view)
    }

    /// The camera of a picture that is brought to the size of all.
    pub fn camera_at(&self, input: &PosedInput, size: &Camera) -> Camera {
        // Pictures of one lens share a size; others are brought to it.
        self.camera(input).resized(size.width, size.height)
    }

    /// The pictures that are held out, at the smaller sizes that are trained for.
    fn smaller(
        &self,
        held_out: &[(String, PosedInput)],
        size: &Camera,
        reductions: &[u32],
        preprocessing: &Preprocessing,
    ) -> anyhow::Result<Vec<HeldOut>> {
        let mut all = Vec::new();
        for by in reductions.iter().filter(|by| **by > 1) {
            let size = size.reduced(*by);
            let read = |(split, input): &(String, PosedInput)| {
                let view = self.read_one(&size, (None, split), preprocessing, input)?.view;
                let split = format!("{split} at {}", size.width);
                Ok(HeldOut { name: input.name.clone(), split, view })
            };
            let views = held_out.par_iter().map(read).collect::<anyhow::Result<Vec<_>>>()?;
            all.extend(views);
        }
        Ok(all)
    }

    /// Reads the pictures of another list, at most so many, evenly spread, brought to the size of a camera.
    pub fn read_others(
        &self,
        cameras: &Path,
        most: usize,
        size: &Camera,
        prior: &Prior,
    ) -> anyhow::Result<Vec<PosedPicture>> {
        let mut listed = posed_pictures(cameras, &PosedOptions::default())?;
        listed.count_from(prior.origin());
        let preprocessing = prior.preprocessing();
        let read = |input| Ok(self.read_one(size, (None, TRAIN), preprocessing, input)?.view);
        let every = listed.inputs.len().div_ceil(most).max(1);
        listed.inputs.par_iter().step_by(every).map(read).collect()
    }

    /// Reads a picture, and brings it to the size of all.
    fn read_one(
        &self,
        size: &Camera,
        (writer, split): (Option<(&RunWriter, DVec3)>, &str),
        preprocessing: &Preprocessing,
        input: &PosedInput,
    ) -> anyhow::Result<Read> {
        let camera = self.camera_at(input, size);
        let (mut picture, mask) = input.load_masked(&camera)?;
        let pose = input.pose;
        let write = |(writer, origin): (&RunWriter, DVec3)| {
            let pose = pose.absolute_from(origin);
            let file = writer.picture(&input.name, &picture)?;
            Ok::<_, RunWriterError>(RunView { file, split: split.into(), camera, pose, time: None })
        };
        let written = writer.map(write).transpose()?;
        Preprocessor::new(preprocessing).apply(&mut picture);
        let mask = mask.data.contains(&false).then_some(mask.data);
        Ok(Read { view: PosedPicture { camera, pose, picture, mask }, written })
    }

    /// The pinhole of a picture, at the size that it is trained at.
    fn camera(&self, input: &PosedInput) -> Camera {
        self.sizes().reduced(&input.lens.pinhole())
    }

    /// Divides the pictures by their splits; without splits, as [`every`](Self::every).
    fn divide(&self, inputs: Vec<PosedInput>) -> anyhow::Result<Divided> {
        let Some(split) = &self.split else { return Ok(self.every(inputs)) };
        let of_split = |input: &PosedInput| input.split.as_ref() == Some(split);
        let (train, others): (Vec<_>, Vec<_>) = inputs.into_iter().partition(of_split);
        if train.is_empty() {
            let cameras = self.cameras.as_deref().unwrap_or(Path::new("")).display();
            anyhow::bail!("{cameras}: no picture of split \"{split}\"");
        }
        if others.is_empty() {
            return Ok(self.every(train));
        }
        let named = |input: PosedInput| Some((input.split.clone()?, input));
        let held_out = others.into_iter().filter_map(named).collect();
        Ok(Divided { train, held_out, every: None })
    }

    /// Holds out every N-th picture.
    fn every(&self, inputs: Vec<PosedInput>) -> Divided {
        let every = self.held_out;
        let (mut train, mut held_out) = (Vec::new(), Vec::new());
        for (i, input) in inputs.into_iter().enumerate() {
            if every > 1 && i % every == every / 2 {
                held_out.push((HELD_OUT.to_owned(), input));
            } else {
                train.push(input);
            }
        }
        Divided { train, held_out, every: (every > 1).then_some(every) }
    }
}

fn coloured(point: &Point) -> ColouredPoint {
    let position = point.position.as_vec3().to_array();
    ColouredPoint { position, rgb: point.rgb.unwrap_or([0.5; 3]) }
}

/// A number that other pictures, points or options change.
pub fn fingerprint(inputs: &MapInputs, options: &MapOptions, budget: &Budget) -> u32 {
    let mut sum = crc32fast::Hasher::new();
    let MapInputs { train, held_out, every, points } = inputs;
    sum.update(format!("{options:?} {budget:?} {every:?}").as_bytes());
    let held_out = held_out.iter().map(|held| &held.view);
    for PosedPicture { camera, pose, picture, mask } in train.iter().chain(held_out) {
        sum.update(format!("{camera:?} {pose:?}").as_bytes());
        sum.update(&picture.data);
        let mask = mask.iter().flatten().map(|counts| u8::from(*counts));
        sum.update(&mask.collect::<Vec<_>>());
    }
    for point in points {
        point.position.iter().chain(&point.rgb).for_each(|v| sum.update(&v.to_le_bytes()));
    }
    sum.finalize()
}

#[cfg(test)]
mod tests {
    use nvsprior::Picture;

    use super::*;

    #[test]
    fn what_is_held_out_goes_back_to_its_place() {
        let camera = Camera { width: 1, height: 1, fx: 1.0, fy: 1.0, cx: 0.5, cy: 0.5 };
        let view = |byte: usize| {
            let picture = Picture::from_rgb(1, 1, vec![byte as u8; 3]).unwrap();
            PosedPicture::new(camera, Default::default(), picture)
        };
        let held = |byte| HeldOut { name: String::new(), split: HELD_OUT.into(), view: view(byte) };
        let (held_out, train): (Vec<_>, Vec<_>) = (0..8).partition(|i| i % 3 == 1);
        let train = train.into_iter().map(view).collect();
        let held_out = held_out.into_iter().map(held).collect();
        let mut inputs = MapInputs { train, held_out, every: Some(3), points: Vec::new() };
        assert_eq!(inputs.whole_run(), [1, 4, 7]);
        assert!(inputs.train.iter().map(|view| view.picture.data[0]).eq(0..8));
    }
}
