//! `nvsprior render`: one view of the prior.

use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use anyhow::Context;
use npyz::WriterBuilder;
use nvsprior::render::{Plan, to_byte};
use nvsprior::{Camera, Picture, Pose};

use nvsprior_inputs::args::{DeviceArgs, PriorArgs, numbers};
use nvsprior_inputs::camera_file::CameraFile;
use nvsprior_inputs::{frame_file, values};

/// Render the prior at a pose
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
    #[arg(long, value_name = "FILE", required_unless_present = "raw", value_parser = values::png)]
    out: Option<PathBuf>,
    /// float32 NumPy file to write, height × width × 5: linear R, G, B as blended before clamping,
    /// depth (Σ wᵢ zᵢ), transmittance
    #[arg(long, value_name = "FILE")]
    raw: Option<PathBuf>,
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
    let pose = args.pose.or(view.pose).with_context(|| {
        format!("{}: {} has no pose; give one with --pose", args.cameras.display(), args.frame)
    })?;
    let camera = view.camera;
    camera.check().with_context(|| format!("{}: {}", args.cameras.display(), args.frame))?;
    for (option, path) in [("--out", &args.out), ("--raw", &args.raw)] {
        if let Some(path) = path {
            values::check_file(option, path)?;
        }
    }
    let engine = args.device.open()?;
    let scene = args.prior.upload(&engine)?;
    let mut renderer = engine.renderer(&scene, &camera, Plan::picture())?;
    let pixels = renderer.draw(&pose)?;
    if let Some(path) = &args.out {
        frame_file::write_png(path, &to_picture(&camera, pixels))?;
    }
    if let Some(path) = &args.raw {
        write_npy(path, &camera, pixels).with_context(|| format!("writing {}", path.display()))?;
    }
    args.device.check(&engine)
}

fn to_picture(camera: &Camera, pixels: &[f32]) -> Picture {
    let bytes = pixels.chunks_exact(5).flat_map(|p| p[..3].iter().map(|v| to_byte(*v)));
    Picture { width: camera.width, height: camera.height, data: bytes.collect() }
}

fn write_npy(path: &Path, camera: &Camera, pixels: &[f32]) -> std::io::Result<()> {
    let mut writer = npyz::WriteOptions::new()
        .default_dtype()
        .shape(&[camera.height.into(), camera.width.into(), 5])
        .writer(BufWriter::new(File::create(path)?))
        .begin_nd()?;
    writer.extend(pixels.iter().copied())?;
    writer.finish()
}
