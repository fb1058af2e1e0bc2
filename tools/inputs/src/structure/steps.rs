//! COLMAP's steps in a work folder.

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

use super::pictures::Listed;
use super::program::{Program, WorkFolder, registered, share};
use super::record::{LOCK, Record, Standing};
use super::{Lenses, MAX_EXHAUSTIVE, Matching, Progress, Step, StructureError, StructureOptions};

// What keeps the mapper from changing a lens that is known.
const KEPT_LENS: [&str; 4] =
    ["--Mapper.ba_refine_focal_length", "0", "--Mapper.ba_refine_extra_params", "0"];

// Names in the work folder.
const DATABASE: &str = "database.db";
const LIST: &str = "pictures.txt";
const SPARSE: &str = "sparse";
const SPARSE_PART: &str = "sparse.part";

/// Widest pictures that are small: COLMAP's own thresholds leave too little of them.
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

/// The folder that COLMAP works in, locked.
pub struct Workplace {
    folder: PathBuf,
    lock: File,
    record: Record,
}

type Watch<'a> = &'a mut dyn FnMut(Progress);

impl Workplace {
    /// Makes the folder, or takes up what is in it.
    pub fn open(folder: &Path) -> Result<Workplace, StructureError> {
        std::fs::create_dir_all(folder).map_err(StructureError::file(folder))?;
        let folder = std::path::absolute(folder).map_err(StructureError::file(folder))?;
        Record::open(&folder)?;
        let path = folder.join(LOCK);
        let failed = StructureError::file(&path);
        let lock = File::options().create(true).append(true).open(&path).map_err(&failed)?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(StructureError::Busy { path: folder }),
            Err(TryLockError::Error(error)) => return Err(failed(error)),
        }
        // It may have changed before the lock was had.
        let record = Record::open(&folder)?;
        Ok(Workplace { folder, lock, record })
    }

    /// The file that holds all of COLMAP's output.
    pub fn log(&self) -> PathBuf {
        self.folder.join("colmap.log")
    }

    pub fn sparse(&self) -> PathBuf {
        self.folder.join(SPARSE)
    }

    /// Runs what is not done yet.
    pub fn run(
        &mut self,
        program: &Program,
        listed: &Listed,
        options: &StructureOptions,
        watch: Watch,
    ) -> Result<(), StructureError> {
        if self.record.pictures != listed.digest {
            self.record = Record { pictures: listed.digest.clone(), steps: Vec::new() };
            self.record.write(&self.folder)?;
        }
        let features = features(program, listed, options)?;
        if self.record.standing(0, &features) != Standing::Finished {
            self.check(listed, watch)?;
        }
        self.step(0, Step::Features, program, &features, watch)?;
        let matches = matches(program, listed, options)?;
        self.step(1, Step::Matches, program, &matches, watch)?;
        let mapper = mapper(listed, options);
        self.step(2, Step::Mapper, program, &mapper, watch)
    }

    fn check(&self, listed: &Listed, watch: Watch) -> Result<(), StructureError> {
        watch(Progress::Begins(Step::Check));
        let count = listed.names.len() as f64;
        listed.check(|done| watch(Progress::At(done as f64 / count)))?;
        let list = self.folder.join(LIST);
        std::fs::write(&list, listed.names.join("\n") + "\n")
            .map_err(StructureError::file(&list))?;
        watch(Progress::Ends(Step::Check));
        Ok(())
    }

    /// Runs a step unless it is done. Matching that was cut off goes on; other steps begin again.
    fn step(
        &mut self,
        index: usize,
        step: Step,
        program: &Program,
        arguments: &[String],
        watch: Watch,
    ) -> Result<(), StructureError> {
        let standing = self.record.standing(index, arguments);
        if standing == Standing::Finished {
            watch(Progress::WasDone(step));
            return Ok(());
        }
        watch(Progress::Begins(step));
        self.record.begin(index, arguments);
        self.record.write(&self.folder)?;
        self.prepare(step, standing, program)?;
        let pictures = self.pictures();
        self.command(program, arguments, |line| {
            let share = match step {
                Step::Mapper => registered(line).map(|count| count as f64 / pictures),
                _ => share(line),
            };
            if let Some(share) = share {
                watch(Progress::At(share.min(1.0)));
            }
        })
        .or_else(|error| self.no_model(step, error))?;
        if step == Step::Mapper {
            self.rename_models()?;
        }
        self.record.finish();
        self.record.write(&self.folder)?;
        watch(Progress::Ends(step));
        Ok(())
    }

    /// Removes what would get in a step's way. COLMAP's database keeps the matches that it has, whatever cut the step
    /// off. Its extractor would give the pictures that are left a camera of their own, and its mapper writes at the
    /// end.
    fn prepare(
        &self,
        step: Step,
        standing: Standing,
        program: &Program,
    ) -> Result<(), StructureError> {
        self.remove(SPARSE)?;
        self.remove(SPARSE_PART)?;
        match (step, standing) {
            (Step::Features, _) => {
                for ending in ["", "-journal", "-wal", "-shm"] {
                    self.remove(&format!("{DATABASE}{ending}"))?;
                }
                Ok(())
            }
            (Step::Matches, Standing::Other) => {
                let words = ["database_cleaner", "--database_path", DATABASE, "--type", "matches"];
                self.command(program, &words.map(str::to_owned), |_| {})
            }
            (Step::Mapper, _) => {
                let folder = self.folder.join(SPARSE_PART);
                std::fs::create_dir(&folder).map_err(StructureError::file(&folder))
            }
            _ => Ok(()),
        }
    }

    /// Removes a file or a folder of the work folder, if it is there.
    fn remove(&self, name: &str) -> Result<(), StructureError> {
        let path = self.folder.join(name);
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
        let place = WorkFolder { folder: &self.folder, log: &self.log(), lock: &self.lock };
        program.run(arguments, &place, line)
    }

    /// The mapper fails with exit code 1 if it makes no model: that needs other words.
    fn no_model(&self, step: Step, error: StructureError) -> Result<(), StructureError> {
        let code = match &error {
            StructureError::Step { ended, .. } => ended.code(),
            _ => None,
        };
        let mut made = std::fs::read_dir(self.folder.join(SPARSE_PART)).into_iter().flatten();
        match step {
            Step::Mapper if code == Some(1) && made.next().is_none() => {
                Err(StructureError::NoModel { log: self.log() })
            }
            _ => Err(error),
        }
    }

    fn rename_models(&self) -> Result<(), StructureError> {
        let [from, to] = [self.folder.join(SPARSE_PART), self.sparse()];
        std::fs::rename(&from, &to).map_err(StructureError::file(&from))
    }

    fn pictures(&self) -> f64 {
        let count = self.record.pictures.split(' ').next().and_then(|count| count.parse().ok());
        count.unwrap_or(1.0)
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
    let gpu = known.known(&["--FeatureExtraction.use_gpu", "--SiftExtraction.use_gpu"]);
    arguments.extend(gpu.iter().flat_map(|option| words(&[option, "0"])));
    if listed.width <= SMALL {
        arguments.extend(words(&SMALL_FEATURES));
    }
    Ok(arguments)
}

fn matches(
    program: &Program,
    listed: &Listed,
    options: &StructureOptions,
) -> Result<Vec<String>, StructureError> {
    let exhaustive = match options.matching {
        Matching::Auto => listed.names.len() <= MAX_EXHAUSTIVE,
        Matching::Exhaustive => true,
        Matching::Sequential => false,
    };
    let command = if exhaustive { "exhaustive_matcher" } else { "sequential_matcher" };
    let known = program.options(command)?;
    let mut arguments = words(&[command, "--database_path", DATABASE]);
    let gpu = known.known(&["--FeatureMatching.use_gpu", "--SiftMatching.use_gpu"]);
    arguments.extend(gpu.iter().flat_map(|option| words(&[option, "0"])));
    let names = ["--FeatureMatching.guided_matching", "--SiftMatching.guided_matching"];
    if let (true, Some(option)) = (listed.width <= SMALL, known.known(&names)) {
        arguments.extend(words(&[option, "1"]));
    }
    if let (false, Some(tree)) = (exhaustive, &options.vocabulary) {
        let tree = std::path::absolute(tree).map_err(StructureError::file(tree))?;
        arguments.extend(words(&["--SequentialMatching.loop_detection", "1"]));
        let tree = tree.to_string_lossy();
        arguments.extend(words(&["--SequentialMatching.vocab_tree_path", &tree]));
    }
    Ok(arguments)
}

fn mapper(listed: &Listed, options: &StructureOptions) -> Vec<String> {
    let folder = listed.folder.to_string_lossy();
    let mut arguments = words(&["mapper", "--database_path", DATABASE, "--image_path", &folder]);
    arguments.extend(words(&["--output_path", SPARSE_PART]));
    if listed.width <= SMALL {
        arguments.extend(words(&SMALL_MAPPER));
    }
    if options.camera_params.is_some() {
        arguments.extend(words(&KEPT_LENS));
    }
    arguments
}
