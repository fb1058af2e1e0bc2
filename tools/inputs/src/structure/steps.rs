//! COLMAP's steps in a work folder.

use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::colmap::ColmapModel;
use crate::estimate::PoseEstimate;
use crate::locked_folder::LockedFolder;
use crate::progress::{Progress, Watch};

use super::models::models;
use super::pairs::joining;
use super::pictures::Listed;
use super::program::{GLOBAL, Program, mapped, registered, share};
use super::record::{Record, Standing};
use super::{Lenses, Matching, StructureError, StructureOptions};

// What keeps a mapper from changing a lens that is known.
const KEPT_LENS: [&str; 2] = ["ba_refine_focal_length", "ba_refine_extra_params"];

// Names in the work folder.
const DATABASE: &str = "database.db";
const LIST: &str = "pictures.txt";
const SPARSE: &str = "sparse";
const SPARSE_PART: &str = "sparse.part";
const FREED: &str = "freed";
// The model of the pictures whose poses are found first, and the pairs that join the others to them.
const FIRST: &str = "first";
const JOINING: &str = "pairs-joining.txt";

/// The list of pairs that are compared at a time. Another way to choose them has another name.
fn pairs_file(matching: Matching) -> &'static str {
    match matching {
        Matching::Auto => "pairs-auto.txt",
        Matching::Exhaustive => "pairs-exhaustive.txt",
        Matching::Sequential => "pairs-sequential.txt",
    }
}

/// Pairs that one run of the program compares: progress is told between runs.
const PAIRS_AT_ONCE: usize = 200;
/// Most features of a picture.
const FEATURES: &str = "4096";
/// Most tracks of features per picture, in the first solution. With all of them it takes five times as long, and comes
/// to the same.
const TRACKS: &str = "500";
/// Longest side of pictures that are small: the program's own thresholds leave too little of them.
const SMALL: u32 = 800;
// What small pictures need. Of 84 pictures of 320×180, 13 got a pose by COLMAP's defaults, and 72 so.
const SMALL_FEATURES: [&str; 2] = ["--SiftExtraction.peak_threshold", "0.002"];
const SMALL_MAPPER: [&str; 6] = [
    "--Mapper.init_min_num_inliers",
    "50",
    "--Mapper.init_min_tri_angle",
    "8",
    "--Mapper.abs_pose_min_num_inliers",
    "20",
];

/// A step of the search for poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ColmapStep {
    /// All pictures are read once, before hours of work.
    Check,
    /// COLMAP's `feature_extractor`.
    Features,
    /// Its `matches_importer`.
    Matches,
    /// Its `global_mapper`, or `mapper`.
    Mapper,
    /// Its `matches_importer`, of the pictures that are left.
    Joins,
    /// Its `mapper`, which goes on with a model.
    Others,
}

impl ColmapStep {
    /// What it does.
    fn name(self) -> String {
        match self {
            ColmapStep::Check => "checking pictures",
            ColmapStep::Features => "finding features",
            ColmapStep::Matches => "matching features",
            ColmapStep::Mapper => "finding poses",
            ColmapStep::Joins => "matching the other frames",
            ColmapStep::Others => "finding the other frames' poses",
        }
        .to_owned()
    }
}

/// The folder that COLMAP works in.
pub type Workplace = LockedFolder<Record>;

impl Workplace {
    /// The file that holds all of COLMAP's output.
    pub fn log(&self) -> PathBuf {
        self.path.join("colmap.log")
    }

    pub fn sparse(&self) -> PathBuf {
        self.path.join(SPARSE)
    }

    /// Runs what is not done yet. Returns the seconds that all steps took.
    pub fn run(
        &mut self,
        program: &Program,
        listed: &Listed,
        options: &StructureOptions,
        watch: Watch,
    ) -> Result<f64, StructureError> {
        if self.record.pictures != listed.digest {
            self.record = Record { pictures: listed.digest.clone(), steps: Vec::new() };
            self.write()?;
        }
        let places = listed.places(&options.first);
        let joining = joining(&places, listed.names.len());
        let features = features(program, listed, options)?;
        let matches = |file| matches(program, listed, options, file);
        let (matches, joins) = (matches(pairs_file(options.matching))?, matches(JOINING)?);
        let done = [&features, &matches].into_iter().enumerate();
        let mut done = done.map(|(i, step)| self.record.standing(i, step) == Standing::Finished);
        let pairs = match done.all(|done| done) {
            true => Vec::new(),
            false => self.look(listed, &places, options, watch)?,
        };
        let pictures = listed.names.len();
        let all_pairs = pairs.len() + joining.len();
        let mut estimate = PoseEstimate::new(pictures, all_pairs, listed.widest, options.size);
        if !pairs.is_empty() {
            watch(Progress::Says(estimate.text()));
        }
        self.step((0, ColmapStep::Features), program, &features, watch, |place, watch| {
            place.command(program, &features, |line| tell(share(line), watch))
        })?;
        if !pairs.is_empty() {
            estimate.features_took(self.record.seconds(0));
            watch(Progress::Says(estimate.text()));
        }
        self.step((1, ColmapStep::Matches), program, &matches, watch, |place, watch| {
            let list = place.path.join(pairs_file(options.matching));
            place.compare(program, &matches, (listed, &list), &pairs, watch)
        })?;
        let mapper = mapper(program, listed, options);
        self.step((2, ColmapStep::Mapper), program, &mapper, watch, |place, watch| {
            let share = |line: &str| registered(line).map(|count| count as f64 / pictures as f64);
            let done = place.command(program, &mapper, |line| {
                tell(mapped(line).or_else(|| share(line)), watch);
            });
            done.or_else(|error| place.no_model(program, error))?;
            place.rename_models(if joining.is_empty() { SPARSE } else { FIRST })
        })?;
        if !joining.is_empty() {
            self.step((3, ColmapStep::Joins), program, &joins, watch, |place, watch| {
                let list = place.path.join(JOINING);
                place.compare(program, &joins, (listed, &list), &joining, watch)
            })?;
            let others = self.others(program, listed, options)?;
            self.step((4, ColmapStep::Others), program, &others, watch, |place, watch| {
                let share = |line: &str| Some(registered(line)? as f64 / pictures as f64);
                place.command(program, &others, |line| tell(share(line), watch))?;
                place.take_model()
            })?;
        }
        Ok((0..5).map(|step| self.record.seconds(step)).sum())
    }

    /// The models that the pictures fell into, the largest first, before others were joined to it.
    pub fn pieces(&self) -> Result<Vec<(PathBuf, ColmapModel)>, StructureError> {
        let first = self.path.join(FIRST);
        let folder = if first.is_dir() { first } else { self.sparse() };
        models(&folder)
    }

    /// Finds the poses of the pictures that the largest model does not have, and those of all together at the end.
    fn others(
        &self,
        program: &Program,
        listed: &Listed,
        options: &StructureOptions,
    ) -> Result<Vec<String>, StructureError> {
        const COMMAND: &str = "mapper";
        let (name, log) = (program.name(), self.log());
        let no_model = || StructureError::NoModel { program: name, log };
        let (model, _) = self.pieces()?.into_iter().next().ok_or_else(no_model)?;
        let folder = listed.folder.to_string_lossy();
        let mut arguments = words(&[COMMAND, "--database_path", DATABASE, "--image_path", &folder]);
        let model = model.to_string_lossy();
        arguments.extend(words(&["--input_path", &model, "--output_path", SPARSE_PART]));
        let known = program.options(COMMAND)?;
        let mut set = |names: &[&'static str], value: &str| {
            arguments.extend(known.known(names).iter().flat_map(|name| words(&[name, value])));
        };
        set(&["--Mapper.random_seed"], &options.seed.to_string());
        // All poses together are made better each time that so many more have come, and at the end.
        const GROWN: &str = "1.3";
        set(&["--Mapper.ba_global_frames_ratio", "--Mapper.ba_global_images_ratio"], GROWN);
        set(&["--Mapper.ba_global_points_ratio"], GROWN);
        arguments.extend(mapper_options(listed, options, "Mapper"));
        Ok(arguments)
    }

    /// The folder of the model as it becomes if the lens may change. One that was stated may be of another camera, or
    /// of the same one in air.
    pub fn freed(&self, program: &Program, model: &Path) -> Result<PathBuf, StructureError> {
        let folder = self.path.join(FREED);
        if !ColmapModel::is_in(&folder) {
            std::fs::create_dir_all(&folder).map_err(StructureError::file(&folder))?;
            let model = model.to_string_lossy();
            let arguments = ["bundle_adjuster", "--input_path", &model, "--output_path", FREED];
            let free = ["--BundleAdjustment.refine_focal_length", "1"];
            self.command(program, &words(&[&arguments[..], &free].concat()), |_| {})?;
        }
        Ok(folder)
    }

    /// Reads all pictures, and says which pairs of those at some places are to be compared.
    fn look(
        &self,
        listed: &Listed,
        places: &[usize],
        options: &StructureOptions,
        watch: Watch,
    ) -> Result<Vec<(usize, usize)>, StructureError> {
        watch(Progress::Begins(ColmapStep::Check.name()));
        let count = listed.names.len() as f64;
        let seen = listed.look(places, |done| watch(Progress::At(Some(done as f64 / count))))?;
        let list = self.path.join(LIST);
        std::fs::write(&list, listed.names.join("\n") + "\n")
            .map_err(StructureError::file(&list))?;
        watch(Progress::Ends);
        let in_order = options.sequence || seen.in_order();
        if options.matching == Matching::Auto && !in_order {
            let says =
                "the order of the names is not that of time: pictures that look alike are compared";
            watch(Progress::Says(says.to_owned()));
        }
        let pairs = seen.pairs(options.matching, in_order).into_iter();
        Ok(pairs.map(|(early, late)| (places[early], places[late])).collect())
    }

    /// Runs a step unless it is done. Matching that was cut off goes on; other steps begin again.
    fn step(
        &mut self,
        (index, step): (usize, ColmapStep),
        program: &Program,
        arguments: &[String],
        watch: Watch,
        run: impl FnOnce(&Workplace, Watch) -> Result<(), StructureError>,
    ) -> Result<(), StructureError> {
        let standing = self.record.standing(index, arguments);
        if standing == Standing::Finished {
            watch(Progress::WasDone(step.name()));
            return Ok(());
        }
        watch(Progress::Begins(step.name()));
        let start = Instant::now();
        self.record.begin(index, arguments);
        self.write()?;
        self.prepare(step, standing, program)?;
        run(self, watch)?;
        self.record.finish(start.elapsed());
        self.write()?;
        watch(Progress::Ends);
        Ok(())
    }

    /// Compares pairs, some at a time.
    fn compare(
        &self,
        program: &Program,
        arguments: &[String],
        (listed, list): (&Listed, &Path),
        pairs: &[(usize, usize)],
        watch: Watch,
    ) -> Result<(), StructureError> {
        let name = |i: usize| &listed.names[i];
        let mut done = 0;
        for some in pairs.chunks(PAIRS_AT_ONCE) {
            let lines = some.iter().map(|(a, b)| format!("{} {}\n", name(*a), name(*b)));
            std::fs::write(list, lines.collect::<String>()).map_err(StructureError::file(list))?;
            self.command(program, arguments, |_| {})?;
            done += some.len();
            watch(Progress::At(Some(done as f64 / pairs.len() as f64)));
        }
        Ok(())
    }

    /// Removes what would get in a step's way. COLMAP's database keeps the matches that it has, whatever cut the step
    /// off. Its extractor would give the pictures that are left a camera of their own, and its mapper writes at the
    /// end.
    fn prepare(
        &self,
        step: ColmapStep,
        standing: Standing,
        program: &Program,
    ) -> Result<(), StructureError> {
        let joins = matches!(step, ColmapStep::Joins | ColmapStep::Others);
        for folder in
            [SPARSE, SPARSE_PART, FREED, FIRST].into_iter().take(if joins { 3 } else { 4 })
        {
            self.remove(folder)?;
        }
        match (step, standing) {
            (ColmapStep::Features, _) => {
                for ending in ["", "-journal", "-wal", "-shm"] {
                    self.remove(&format!("{DATABASE}{ending}"))?;
                }
                Ok(())
            }
            (ColmapStep::Matches, Standing::Other) => {
                let words = ["database_cleaner", "--database_path", DATABASE, "--type", "matches"];
                self.command(program, &words.map(str::to_owned), |_| {})
            }
            (ColmapStep::Mapper | ColmapStep::Others, _) => {
                let folder = self.path.join(SPARSE_PART);
                std::fs::create_dir(&folder).map_err(StructureError::file(&folder))
            }
            _ => Ok(()),
        }
    }

    /// Removes a file or a folder of the work folder, if it is there.
    fn remove(&self, name: &str) -> Result<(), StructureError> {
        let path = self.path.join(name);
        let removed = match path.symlink_metadata() {
            Ok(metadata) if metadata.is_dir() => std::fs::remove_dir_all(&path),
            Ok(_) => std::fs::remove_file(&path),
            Err(_) => return Ok(()),
        };
        removed.map_err(StructureError::file(&path))
    }

    fn command(
        &self,
        program: &Program,
        arguments: &[String],
        line: impl FnMut(&str),
    ) -> Result<(), StructureError> {
        program.run(arguments, self, line)
    }

    /// A mapper fails with exit code 1 if it makes no model: that needs other words.
    fn no_model(&self, program: &Program, error: StructureError) -> Result<(), StructureError> {
        let code = match &error {
            StructureError::Step { ended, .. } => ended.code(),
            _ => None,
        };
        let mut made = std::fs::read_dir(self.path.join(SPARSE_PART)).into_iter().flatten();
        match code == Some(1) && made.next().is_none() {
            true => Err(StructureError::NoModel { program: program.name(), log: self.log() }),
            false => Err(error),
        }
    }

    fn rename_models(&self, to: &str) -> Result<(), StructureError> {
        let from = self.path.join(SPARSE_PART);
        std::fs::rename(&from, self.path.join(to)).map_err(StructureError::file(&from))
    }

    /// The model that a mapper went on with: it comes into no folder of its own.
    fn take_model(&self) -> Result<(), StructureError> {
        let (part, folder) = (self.path.join(SPARSE_PART), self.path.join(SPARSE));
        if !ColmapModel::is_in(&part) {
            return self.rename_models(SPARSE);
        }
        let placed = std::fs::create_dir(&folder);
        let placed = placed.and_then(|()| std::fs::rename(&part, folder.join("0")));
        placed.map_err(StructureError::file(&folder))
    }
}

/// Tells how much of a step is done, if a line says so.
fn tell(share: Option<f64>, watch: Watch) {
    if let Some(share) = share {
        watch(Progress::At(Some(share.min(1.0))));
    }
}

fn words(fixed: &[&str]) -> Vec<String> {
    fixed.iter().map(|word| (*word).to_owned()).collect()
}

fn features(
    program: &Program,
    listed: &Listed,
    options: &StructureOptions,
) -> Result<Vec<String>, StructureError> {
    const COMMAND: &str = "feature_extractor";
    let known = program.options(COMMAND)?;
    let folder = listed.folder.to_string_lossy();
    let mut arguments = words(&[COMMAND, "--database_path", DATABASE, "--image_path", &folder]);
    arguments.extend(words(&["--image_list_path", LIST]));
    arguments.extend(words(&["--ImageReader.camera_model", &options.camera_model]));
    if let Some(params) = &options.camera_params {
        arguments.extend(words(&["--ImageReader.camera_params", params]));
    }
    let sharing = match options.lenses {
        Lenses::One => "--ImageReader.single_camera",
        Lenses::Folder => "--ImageReader.single_camera_per_folder",
        Lenses::Picture => "--ImageReader.single_camera_per_image",
    };
    arguments.extend(words(&[sharing, "1"]));
    if let Some(masks) = &options.masks {
        let masks = std::path::absolute(masks).map_err(StructureError::file(masks))?;
        arguments.extend(words(&["--ImageReader.mask_path", &masks.to_string_lossy()]));
    }
    let of_kind = |names: &[&'static str], value: &str| {
        known.known(names).map(|option| words(&[option, value])).unwrap_or_default()
    };
    let gpu = ["--FeatureExtraction.use_gpu", "--SiftExtraction.use_gpu"];
    arguments.extend(of_kind(&gpu, "0"));
    let size = ["--FeatureExtraction.max_image_size", "--SiftExtraction.max_image_size"];
    arguments.extend(of_kind(&size, &options.size.to_string()));
    arguments.extend(words(&["--SiftExtraction.max_num_features", FEATURES]));
    if listed.widest.0 <= SMALL {
        arguments.extend(words(&SMALL_FEATURES));
    }
    Ok(arguments)
}

fn matches(
    program: &Program,
    listed: &Listed,
    options: &StructureOptions,
    pairs: &str,
) -> Result<Vec<String>, StructureError> {
    const COMMAND: &str = "matches_importer";
    let known = program.options(COMMAND)?;
    let mut arguments = words(&[COMMAND, "--database_path", DATABASE]);
    arguments.extend(words(&["--match_list_path", pairs, "--match_type", "pairs"]));
    let mut set = |names: &[&'static str], value: &str| {
        let option = known.known(names);
        arguments.extend(option.iter().flat_map(|option| words(&[option, value])));
    };
    set(&["--FeatureMatching.use_gpu", "--SiftMatching.use_gpu"], "0");
    set(&["--TwoViewGeometry.random_seed"], &options.seed.to_string());
    if listed.widest.0 <= SMALL {
        set(&["--FeatureMatching.guided_matching", "--SiftMatching.guided_matching"], "1");
    }
    Ok(arguments)
}

fn mapper(program: &Program, listed: &Listed, options: &StructureOptions) -> Vec<String> {
    let folder = listed.folder.to_string_lossy();
    let (command, group) = match program.is_global() {
        true => (GLOBAL, "GlobalMapper"),
        false => ("mapper", "Mapper"),
    };
    let mut arguments = words(&[command, "--database_path", DATABASE, "--image_path", &folder]);
    arguments.extend(words(&["--output_path", SPARSE_PART]));
    if program.is_global() {
        let seed = options.seed.to_string();
        arguments.extend(words(&["--GlobalMapper.random_seed", &seed]));
        arguments.extend(words(&["--GlobalMapper.track_required_tracks_per_view", TRACKS]));
    }
    arguments.extend(mapper_options(listed, options, group));
    arguments
}

/// What the pictures ask of a mapper.
fn mapper_options(listed: &Listed, options: &StructureOptions, group: &str) -> Vec<String> {
    let small = listed.widest.0 <= SMALL && group == "Mapper";
    let mut arguments = words(if small { &SMALL_MAPPER[..] } else { &[] });
    if options.camera_params.is_some() {
        arguments
            .extend(KEPT_LENS.iter().flat_map(|name| words(&[&format!("--{group}.{name}"), "0"])));
    }
    arguments
}
