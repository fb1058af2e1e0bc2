//! `nvsprior render`: views of the prior.

use std::path::{Path, PathBuf};

use anyhow::Context;
use npyz::WriterBuilder;
use nvsprior::prior::replace_file;
use nvsprior::render::{Plan, to_byte};
use nvsprior::{Camera, Picture, Pose};

use nvsprior_inputs::args::{DeviceArgs, OverwriteArgs, PriorArgs, numbers, progress};
use nvsprior_inputs::camera_file::CameraFile;
use nvsprior_inputs::{frame_file, values};
use nvsprior_runs::FrameKind;

/// Render the prior at a pose, or at many
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    prior: PriorArgs,
    /// cameras.json, or nerfstudio's transforms.json
    #[arg(long, value_name = "FILE")]
    cameras: PathBuf,
    /// File name of the view in the camera file
    #[arg(long, value_name = "NAME")]
    frame: String,
    /// Render here instead of at the view's pose: world-to-camera qw,qx,qy,qz,tx,ty,tz
    #[arg(long, value_name = "POSE", value_parser = parse_pose, allow_hyphen_values = true)]
    pose: Option<Pose>,
    /// Picture to write (PNG)
    #[arg(long, value_name = "FILE", required_unless_present_any = ["raw", "poses"],
        value_parser = values::png)]
    out: Option<PathBuf>,
    /// float32 NumPy file to write, height × width × 5: linear R, G, B as blended before clamping,
    /// depth (Σ wᵢ zᵢ), transmittance
    #[arg(long, value_name = "FILE")]
    raw: Option<PathBuf>,
    /// Render at each pose of a CSV file, with the view's camera: the columns name,qw,qx,qy,qz,tx,ty,tz
    #[arg(long, value_name = "FILE", requires = "pictures", conflicts_with_all = ["pose", "out", "raw"])]
    poses: Option<PathBuf>,
    /// Folder for the pictures of --poses: one NAME.png of each row
    #[arg(long, value_name = "DIR", requires = "poses")]
    pictures: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

fn parse_pose(text: &str) -> Result<Pose, String> {
    let [w, x, y, z, tx, ty, tz] = numbers::<7>(text)?;
    Pose::from_wxyz([w, x, y, z], [tx, ty, tz]).ok_or_else(|| "the quaternion is zero".into())
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let cameras = CameraFile::open(&args.cameras)?;
    let view = cameras.view(&args.frame)?;
    let camera = view.camera;
    camera.check().with_context(|| format!("{}: {}", args.cameras.display(), args.frame))?;
    match (&args.poses, &args.pictures) {
        (Some(poses), Some(folder)) => draw_many(args, &camera, &read_poses(poses)?, folder),
        _ => {
            let pose = args.pose.or(view.pose).with_context(|| {
                format!(
                    "{}: {} has no pose; give one with --pose",
                    args.cameras.display(),
                    args.frame
                )
            })?;
            draw_one(args, &camera, &pose)
        }
    }
}

/// Names and poses, in the order of the names.
fn read_poses(path: &Path) -> anyhow::Result<Vec<(String, Pose)>> {
    let known = frame_file::read_known_by("name", path)?;
    let mut poses = Vec::new();
    for (name, known) in known {
        let is_plain = Path::new(&name).file_name().is_some_and(|file| file == name.as_str());
        anyhow::ensure!(is_plain, "{}: \"{name}\" cannot be the name of a picture", path.display());
        poses.extend(known.hint.map(|hint| (name, hint.pose)));
    }
    anyhow::ensure!(!poses.is_empty(), "{}: has no poses", path.display());
    poses.sort_by(|a, b| a.0.cmp(&b.0));
    Ok(poses)
}

fn draw_many(
    args: &Args,
    camera: &Camera,
    poses: &[(String, Pose)],
    folder: &Path,
) -> anyhow::Result<()> {
    let mut folder = args.overwrite.open("--pictures", folder, FrameKind::RENDER)?;
    let engine = args.device.open()?;
    let scene = args.prior.upload(&engine)?;
    let mut renderer = engine.renderer(&scene, camera, Plan::picture())?;
    let bar = progress(poses.len(), "renders");
    for (name, pose) in poses {
        let picture = to_picture(camera, renderer.draw(&pose.relative_to(scene.origin()))?);
        folder.write_picture(name, &picture)?;
        bar.inc(1);
    }
    folder.finish()?;
    args.device.check(&engine)
}

fn draw_one(args: &Args, camera: &Camera, pose: &Pose) -> anyhow::Result<()> {
    for (option, path) in [("--out", &args.out), ("--raw", &args.raw)] {
        if let Some(path) = path {
            values::check_file(option, path)?;
        }
    }
    let engine = args.device.open()?;
    let scene = args.prior.upload(&engine)?;
    let mut renderer = engine.renderer(&scene, camera, Plan::picture())?;
    let pixels = renderer.draw(&pose.relative_to(scene.origin()))?;
    let picture = to_picture(camera, pixels);
    if let Some(path) = &args.out {
        nvsprior_runs::write_png(path, &picture)?;
    }
    if let Some(path) = &args.raw {
        replace_file(path, &npy(camera, pixels)?)?;
    }
    args.prior.tell_if_cut(&picture, camera, pose)?;
    args.device.check(&engine)
}

fn to_picture(camera: &Camera, pixels: &[f32]) -> Picture {
    let bytes = pixels.chunks_exact(5).flat_map(|p| p[..3].iter().map(|v| to_byte(*v)));
    Picture { width: camera.width, height: camera.height, data: bytes.collect() }
}

fn npy(camera: &Camera, pixels: &[f32]) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut writer = npyz::WriteOptions::new()
        .default_dtype()
        .shape(&[camera.height.into(), camera.width.into(), 5])
        .writer(&mut bytes)
        .begin_nd()?;
    writer.extend(pixels.iter().copied())?;
    writer.finish()?;
    Ok(bytes)
}
