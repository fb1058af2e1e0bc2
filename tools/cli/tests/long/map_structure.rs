//! `nvsprior map PICTURES`: stand-ins for COLMAP and Python, and pycolmap itself if it is asked for.

use std::collections::HashMap;
use std::os::unix::fs::PermissionsExt;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use glam::{DQuat, DVec3};
use nvsprior::{Pose, Prior};
use nvsprior_basin::{Conditions, Site, mapping_run};
use nvsprior_inputs::progress::Progress;
use nvsprior_inputs::structure::{DEPTH, Finder, Lenses, Matching, StructureOptions, find_poses};

use crate::dive::{Dive, Run, save};
use crate::scene::pose;

const MAP: &str = "map images --out a.ply --splats 300 --iterations 20 --held-out 0";

/// Stands for `colmap`, in the folder `bin` of the dive. It notes each call in `calls`, writes the model of the folder
/// `model`, and fails, waits or makes nothing if a file says so.
const STAND_IN: &str = r#"#!/bin/sh
case "$1 $2" in
  "help ")
    echo "COLMAP 9.9 -- a stand-in"; echo "  mapper"
    [ -f "$(dirname "$0")/../old" ] || echo "  global_mapper"
    exit 0;;
  *" -h") cat "$(dirname "$0")/options"; exit 0;;
esac
echo "$*" >> ../calls
echo "Processed file [1/4]"
echo "  Name: 0.png"
if [ -f ../wait-$1 ]; then echo $$ > ../pid; exec sleep 100; fi
if [ -f ../fail-$1 ]; then echo "E0101 something broke" >&2; exit 3; fi
case "$1" in
  bundle_adjuster) cp sparse/1/* freed/;;
  feature_extractor) cat pictures.txt > database.db;;
  global_mapper | mapper)
    [ -f ../nothing ] && exit 1
    mkdir -p sparse.part/0 sparse.part/1
    cp ../model/* sparse.part/1/
    cp ../model/cameras.txt ../model/points3D.txt sparse.part/0/
    head -n 2 ../model/images.txt > sparse.part/0/images.txt;;
esac
"#;

/// Stands for a `python3` without pycolmap, which can install it. With it, it does what the stand-in for COLMAP does.
const PYTHON: &str = r#"#!/bin/sh
here="$(dirname "$0")"
case "$1 $2" in
  "-m venv")
    if [ -f no-venv ]; then echo "No module named venv" >&2; exit 1; fi
    mkdir -p "$3/bin" && cp "$0" "$3/bin/python3";;
  "-m pip")
    if [ -f no-network ]; then echo "ERROR: No matching distribution found" >&2; exit 1; fi
    touch "$here/installed";;
  "-c "*)
    [ -f "$here/installed" ] || exit 1
    shift 2
    exec colmap "$@";;
esac
"#;

const OLD_OPTIONS: &str = "--SiftExtraction.use_gpu arg (=1)\n--SiftExtraction.max_image_size\n\
    --SiftMatching.use_gpu arg (=1)\n";
const NEW_OPTIONS: &str = "--FeatureExtraction.use_gpu arg\n--FeatureExtraction.max_image_size\n\
    --FeatureMatching.use_gpu arg\n--TwoViewGeometry.random_seed\n";

/// A dive with the stand-in. Its model has three of the four pictures, in a unit of its own.
fn dive() -> Dive {
    let dive = Dive::new();
    for folder in ["bin", "model"] {
        std::fs::create_dir(dive.path(folder)).unwrap();
    }
    program(&dive, "bin/colmap", STAND_IN);
    std::fs::write(dive.path("bin/options"), NEW_OPTIONS).unwrap();
    let images: String = (0..3).map(|t| image(t, &pose(t as f64))).collect();
    let points: String = (0..40).map(point).collect();
    std::fs::write(dive.path("model/cameras.txt"), "1 PINHOLE 160 90 130 130 80 45\n").unwrap();
    std::fs::write(dive.path("model/images.txt"), images).unwrap();
    std::fs::write(dive.path("model/points3D.txt"), points).unwrap();
    dive
}

fn program(dive: &Dive, path: &str, script: &str) {
    let path = dive.path(path);
    std::fs::write(&path, script).unwrap();
    std::fs::set_permissions(&path, PermissionsExt::from_mode(0o755)).unwrap();
}

/// The unit of the stand-in's model, in those of the dive.
const UNIT: f64 = 0.01;

fn image(t: usize, pose: &Pose) -> String {
    let ([w, x, y, z], t3) = (pose.wxyz(), pose.translation * UNIT);
    format!("{} {w} {x} {y} {z} {} {} {} 1 {t}.png\n\n", t + 1, t3.x, t3.y, t3.z)
}

fn point(i: usize) -> String {
    let (x, y) = ((i % 8) as f64 * 0.3 - 1.0, (i / 8) as f64 * 0.3 - 0.6);
    format!("{i} {} {} {} 90 120 150 0.5 1 0 2 0\n", x * UNIT, y * UNIT, 4.0 * UNIT)
}

fn run(dive: &Dive, args: &str) -> Run {
    let path = format!("{}:/usr/bin:/bin", dive.path("bin").display());
    // Nothing is installed outside of the dive.
    let cache = dive.path("cache").display().to_string();
    dive.run_with(args, &[("PATH", &path), ("XDG_CACHE_HOME", &cache)])
}

/// The commands that were called since the last look.
fn calls(dive: &Dive) -> Vec<String> {
    let path = dive.path("calls");
    let text = std::fs::read_to_string(&path).unwrap_or_default();
    let _ = std::fs::remove_file(path);
    text.lines().map(str::to_owned).collect()
}

fn commands(dive: &Dive) -> Vec<String> {
    let first = |call: String| call.split(' ').next().unwrap_or_default().to_owned();
    calls(dive).into_iter().map(first).collect()
}

#[test]
fn poses_are_found_once_and_a_prior_is_trained() {
    let dive = dive();
    let found = run(&dive, MAP).ends_with(0).says("poses of 3 of 4 pictures");
    found.says("no pose was found of 3.png").says("warning: 1 of 4 pictures have no pose");
    let made = calls(&dive);
    let options = [
        ("feature_extractor", "--FeatureExtraction.use_gpu 0"),
        ("feature_extractor", "--FeatureExtraction.max_image_size 1280"),
        ("feature_extractor", "--ImageReader.camera_model RADIAL --ImageReader.single_camera 1"),
        ("matches_importer", "--FeatureMatching.use_gpu 0 --TwoViewGeometry.random_seed 1"),
        ("global_mapper", "--output_path sparse.part --GlobalMapper.random_seed 1"),
    ];
    assert_eq!(made.len(), 3, "{made:?}");
    for (command, options) in options {
        let own = made.iter().find(|call| call.starts_with(command)).unwrap();
        assert!(own.contains(options), "{own}");
    }
    let list = std::fs::read_to_string(dive.path("a.ply.colmap/database.db")).unwrap();
    assert_eq!(list, "0.png\n1.png\n2.png\n3.png\n");
    let log = std::fs::read_to_string(dive.path("a.ply.colmap/colmap.log")).unwrap();
    assert!(log.contains("$ colmap global_mapper") && log.contains("  Name: 0.png"), "{log}");
    // The prior is in the unit by which the scene's median depth is fixed.
    let prior = Prior::open(&dive.path("a.ply"), &Default::default()).unwrap();
    let mut depths: Vec<f32> = prior.splats().positions.iter().map(|p| p[2]).collect();
    depths.sort_by(f32::total_cmp);
    let depth = f64::from(depths[depths.len() / 2]);
    assert!((depth - DEPTH).abs() < 0.2 * DEPTH, "{depth}");
    // The same again.
    let first = dive.bytes("a.ply");
    run(&dive, MAP).ends_with(0).says("finding poses: done before");
    assert_eq!((dive.bytes("a.ply"), commands(&dive)), (first, Vec::new()));
}

#[test]
fn what_changes_is_done_again_with_all_that_follows() {
    let dive = dive();
    run(&dive, MAP).ends_with(0);
    calls(&dive);
    run(&dive, &format!("{MAP} --matching sequential")).ends_with(0);
    assert_eq!(commands(&dive), ["database_cleaner", "matches_importer", "global_mapper"]);
    let model = "--camera SIMPLE_RADIAL:130,80,45,0.01";
    let other = format!("{MAP} {model} --lenses picture");
    run(&dive, &format!("{other} --seed 7")).ends_with(0);
    let made = calls(&dive);
    assert!(
        made[0].contains("SIMPLE_RADIAL --ImageReader.camera_params 130,80,45,0.01"),
        "{made:?}"
    );
    assert!(made[0].contains("--ImageReader.single_camera_per_image 1"), "{made:?}");
    assert!(made[1].contains("--TwoViewGeometry.random_seed 7"), "{made:?}");
    assert!(made[2].contains("--GlobalMapper.ba_refine_focal_length 0"), "{made:?}");
    std::fs::remove_file(dive.path("images/3.png")).unwrap();
    run(&dive, &other).ends_with(0).says("poses of 3 of 3 pictures");
    let made = commands(&dive);
    assert_eq!(made[..3], ["feature_extractor", "matches_importer", "global_mapper"]);
    // Whether the stated lens fits.
    assert_eq!(made[3..], ["bundle_adjuster"]);
}

#[test]
fn an_older_colmap_is_run_by_its_own_options_if_it_is_asked_for() {
    let dive = dive();
    std::fs::write(dive.path("old"), "").unwrap();
    std::fs::write(dive.path("bin/options"), OLD_OPTIONS).unwrap();
    run(&dive, &format!("{MAP} --poses colmap")).ends_with(0).says("older than 4");
    let made = calls(&dive);
    assert!(made[0].contains("--SiftExtraction.use_gpu 0 --SiftExtraction.max_image_size 1280"));
    assert!(made[1].starts_with("matches_importer") && made[1].contains("SiftMatching.use_gpu 0"));
    assert!(made[2].starts_with("mapper ") && !made[2].contains("GlobalMapper"), "{made:?}");
}

#[test]
fn pycolmap_is_installed_once_after_saying_so() {
    let dive = dive();
    std::fs::rename(dive.path("bin/colmap"), dive.path("colmap")).unwrap();
    program(&dive, "bin/python3", PYTHON);
    for (fault, said) in [("no-venv", "No module named venv"), ("no-network", "No matching")] {
        std::fs::write(dive.path(fault), "").unwrap();
        run(&dive, MAP).ends_with(1).says("installing pycolmap").says(said).says("--cameras");
        std::fs::remove_file(dive.path(fault)).unwrap();
        let left = std::fs::read_dir(dive.path("cache/nvsprior")).unwrap().count();
        assert_eq!(left, 0, "what a failed installation made is still there");
    }
    // What the stand-in for Python runs.
    std::fs::rename(dive.path("colmap"), dive.path("bin/colmap")).unwrap();
    std::fs::write(dive.path("old"), "").unwrap();
    std::fs::write(dive.path("no-network"), "").unwrap();
    run(&dive, MAP).ends_with(0).says("installing pycolmap").says("older than 4");
    std::fs::remove_file(dive.path("no-network")).unwrap();
    std::fs::remove_file(dive.path("old")).unwrap();
    run(&dive, &format!("{MAP} --poses pycolmap")).ends_with(0).says("installing pycolmap");
    let again = run(&dive, &format!("{MAP} --poses pycolmap")).ends_with(0);
    assert!(!again.stderr.contains("installing"), "{}", again.stderr);
    let python = dive.path("cache/nvsprior/pycolmap/bin/python3");
    run(&dive, &format!("{MAP} --poses {}", python.display())).ends_with(0);
    run(&dive, &format!("{MAP} --poses /bin/true"))
        .ends_with(1)
        .says("/bin/true: neither a COLMAP");
}

#[test]
fn a_step_that_fails_is_named_and_goes_on_later() {
    let dive = dive();
    let steps = ["feature_extractor", "matches_importer", "global_mapper"];
    for step in steps {
        let fails = dive.path(&format!("fail-{step}"));
        std::fs::write(&fails, "").unwrap();
        let failed = run(&dive, MAP).ends_with(1).says(&format!("COLMAP {step} failed"));
        failed.says("status: 3").says("something broke").says("a.ply.colmap/colmap.log");
        assert_eq!(commands(&dive).last().map(String::as_str), Some(step));
        std::fs::remove_file(fails).unwrap();
    }
    std::fs::write(dive.path("nothing"), "").unwrap();
    run(&dive, MAP).ends_with(1).says("no two pictures to begin with").says("colmap.log");
    assert_eq!(commands(&dive), ["global_mapper"]);
    std::fs::remove_file(dive.path("nothing")).unwrap();
    run(&dive, MAP).ends_with(0);
    assert_eq!(commands(&dive), ["global_mapper"]);
}

/// A killed run leaves a step half done, and perhaps its COLMAP at work.
#[test]
fn a_step_that_was_cut_off_is_not_taken_for_done() {
    let dive = dive();
    for step in ["feature_extractor", "matches_importer", "global_mapper"] {
        let waits = dive.path(&format!("wait-{step}"));
        std::fs::write(&waits, "").unwrap();
        let mut child = start(&dive);
        let pid = pid(&dive);
        child.kill().unwrap();
        child.wait().unwrap();
        run(&dive, MAP).ends_with(1).says("a.ply.colmap").says("at work in it");
        assert!(Command::new("kill").arg(pid).status().unwrap().success());
        std::fs::remove_file(waits).unwrap();
        assert_eq!(commands(&dive).last().map(String::as_str), Some(step));
    }
    retry(&dive).ends_with(0);
    assert_eq!(commands(&dive), ["global_mapper"]);
}

fn start(dive: &Dive) -> Child {
    let path = format!("{}:/usr/bin:/bin", dive.path("bin").display());
    let mut command = Command::new(env!("CARGO_BIN_EXE_nvsprior"));
    command.args(MAP.split(' ')).env("PATH", path).current_dir(dive.path(""));
    // The lock of a COLMAP that was killed before goes with it, which may take a moment.
    command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

/// Runs until the lock of a killed COLMAP is gone.
fn retry(dive: &Dive) -> Run {
    loop {
        let run = run(dive, MAP);
        if !run.stderr.contains("at work in it") {
            return run;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// The process that waits in place of a step.
fn pid(dive: &Dive) -> String {
    let path = dive.path("pid");
    loop {
        let pid = std::fs::read_to_string(&path).unwrap_or_default();
        if pid.ends_with('\n') {
            std::fs::remove_file(&path).unwrap();
            return pid.trim().to_owned();
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn without_colmap_and_python_it_says_what_to_install() {
    let dive = dive();
    let cache = dive.path("cache").display().to_string();
    let absent = dive.run_with(MAP, &[("PATH", ""), ("XDG_CACHE_HOME", &cache)]).ends_with(1);
    absent.says("COLMAP 4").says("python3: ").says("--poses").says("--cameras");
}

#[test]
fn wrong_pictures_are_named_before_colmap_runs() {
    let dive = dive();
    for (args, code, named) in [
        (format!("{MAP} --cameras cameras.json"), 2, "--cameras"),
        (MAP.replace("images ", ""), 2, "--cameras"),
        (format!("{MAP} --split dive"), 2, "--split"),
        ("map --cameras cameras.json --out a.ply --lenses one".to_owned(), 2, "--lenses"),
        (format!("{MAP} --camera-model FOV"), 2, "FOV"),
        (format!("{MAP} --camera PINHOLE:1,x,3,4"), 2, "--camera"),
        (format!("{MAP} --navigation course.csv,steep"), 2, "the tilt"),
        (format!("{MAP} --poses none"), 1, "none: not found"),
        (MAP.replace("images", "none"), 1, "none"),
        (MAP.replace("images", "bin"), 1, "no pictures"),
    ] {
        run(&dive, &args).ends_with(code).says(named);
    }
    let whole = dive.bytes("images/2.png");
    std::fs::write(dive.path("images/2.png"), &whole[..whole.len() / 2]).unwrap();
    run(&dive, MAP).ends_with(1).says("images/2.png");
    let small = image::RgbImage::new(80, 45);
    small.save(dive.path("images/2.png")).unwrap();
    run(&dive, MAP).ends_with(1).says("2.png: 80×45").says("--lenses folder");
    std::fs::create_dir(dive.path("one")).unwrap();
    std::fs::write(dive.path("one/0.png"), dive.bytes("images/0.png")).unwrap();
    run(&dive, &MAP.replace("images", "one")).ends_with(1).says("one/0.png: the only picture");
    std::fs::remove_dir_all(dive.path("a.ply.colmap")).unwrap();
    std::fs::create_dir(dive.path("a.ply.colmap")).unwrap();
    std::fs::write(dive.path("a.ply.colmap/notes.txt"), "mine").unwrap();
    small.save(dive.path("one/1.png")).unwrap();
    run(&dive, MAP).ends_with(1);
    assert_eq!(commands(&dive), Vec::<String>::new());
    assert_eq!(dive.bytes("a.ply.colmap/notes.txt"), b"mine");
    std::fs::remove_file(dive.path("images/2.png")).unwrap();
    run(&dive, MAP).ends_with(1).says("a.ply.colmap: holds other things");
    assert_eq!(dive.bytes("a.ply.colmap/notes.txt"), b"mine");
}

/// pycolmap on the pictures of the demo's mapping run, 84 of 320×180, whose poses are known.
#[test]
#[ignore = "installs pycolmap, and takes minutes: make poses-test"]
fn pycolmap_finds_the_poses_of_the_demos_mapping_run() {
    let dive = Dive::new();
    let pictures = dive.path("m1");
    std::fs::create_dir(&pictures).unwrap();
    let mut known = HashMap::new();
    for frame in mapping_run(Site::Basin, Conditions::CALM) {
        save(&frame.picture, &pictures.join(&frame.name));
        known.insert(frame.name, frame.pose);
    }
    let map = "map m1 --out m1.ply --splats 4000 --iterations 300";
    let said = dive.run(map).ends_with(0).stderr;
    println!("{said}");
    assert!(Prior::open(&dive.path("m1.ply"), &Default::default()).is_ok());
    let options = StructureOptions {
        finder: Finder::Auto,
        camera_model: "RADIAL".into(),
        camera_params: None,
        lenses: Lenses::One,
        sequence: false,
        first: Vec::new(),
        matching: Matching::Auto,
        size: 1280,
        masks: None,
        navigation: None,
        seed: 1,
    };
    let found = find_poses(&pictures, &dive.path("m1.ply.colmap"), &options, &mut |progress| {
        assert!(matches!(progress, Progress::WasDone(_) | Progress::Says(_)), "{progress:?}");
    });
    let inputs = found.unwrap().posed.inputs;
    let pairs = inputs.iter().map(|input| (input.pose, known[&input.name]));
    let pairs: Vec<(Pose, Pose)> = pairs.collect();
    let mut errors = errors(&pairs);
    errors.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (place, _) = errors[errors.len() / 2];
    errors.sort_by(|a, b| a.1.total_cmp(&b.1));
    let (_, angle) = errors[errors.len() / 2];
    let worst = errors.iter().map(|error| error.0).fold(0.0, f64::max);
    println!(
        "{} of 84 pictures; median error {place:.4} units and {angle:.3}°, at most {worst:.4} units",
        pairs.len()
    );
    assert!(pairs.len() >= 70, "{} pictures", pairs.len());
    assert!(place < 0.05 && angle < 0.5, "{place} units, {angle}°");
}

/// Distance (in the known unit) and angle (degrees) of found poses from known ones, after the similarity that brings
/// the found ones nearest.
fn errors(pairs: &[(Pose, Pose)]) -> Vec<(f64, f64)> {
    let count = pairs.len() as f64;
    // World of the found poses to that of the known ones: the mean of what each camera says.
    let turns = pairs.iter().map(|(found, known)| known.rotation.conjugate() * found.rotation);
    let first = pairs[0].1.rotation.conjugate() * pairs[0].0.rotation;
    let sum = turns.fold(DQuat::from_array([0.0; 4]), |sum, turn| {
        if turn.dot(first) < 0.0 { sum - turn } else { sum + turn }
    });
    let turn = sum.normalize();
    let mean = |centre: fn(&(Pose, Pose)) -> DVec3| pairs.iter().map(centre).sum::<DVec3>() / count;
    let means = [mean(|pair| pair.0.centre()), mean(|pair| pair.1.centre())];
    let moved = |pair: &(Pose, Pose)| turn * (pair.0.centre() - means[0]);
    let aside = |pair: &(Pose, Pose)| pair.1.centre() - means[1];
    let [along, square] = pairs.iter().fold([0.0; 2], |[a, s], pair| {
        [a + moved(pair).dot(aside(pair)), s + moved(pair).length_squared()]
    });
    let scale = along / square;
    let error = |pair: &(Pose, Pose)| {
        let place = (moved(pair) * scale).distance(aside(pair));
        let found = pair.0.rotation * turn.conjugate();
        (place, found.angle_between(pair.1.rotation).to_degrees())
    };
    pairs.iter().map(error).collect()
}
