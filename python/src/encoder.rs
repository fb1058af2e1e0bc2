//! The vehicle's side: frames in, packets out.

use numpy::PyArray2;
use nvsprior::image::Mask;
use nvsprior::residual::Interest;
use nvsprior::tracking::FrameInfo;
use nvsprior::{Encoded, Encoder, EncoderOptions, FrameStats, Picture, Rate, RenderChecks};
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arguments::{Whole, whole};
use crate::arrays::{check_out, read_mask, read_picture, write_picture};
use crate::engine::PyEngine;
use crate::errors::Failure;
use crate::geometry::{PyCamera, PyHint, PyPose};
use crate::handle::{Handle, detached};
use crate::options;
use crate::prior::PyPrior;
use crate::record::record;
use crate::signals::Signals;

record! {
    /// An encoded frame.
    class "Encoded" PyEncoded {
        /// The bytes to send. Type: bytes.
        packet: Py<PyBytes>,
        /// What the topside will show: uint8, shape (height, width, 3), RGB. Type: uint8 array.
        picture: Py<PyAny>,
        /// The pose as the packet holds it. Type: Pose.
        pose: PyPose,
        /// Number of the frame. Type: int.
        frame: u32,
        /// PSNR of the prior's render at that pose against the treated frame, dB. Type: float.
        render_psnr: f64,
        /// PSNR of `picture` against the treated frame, dB. Type: float.
        psnr: f64,
        /// Whether the picture confirms the pose. How well the place is known is `known`. Type: bool.
        certain: bool,
        /// How far the pose may be off: float64, shape (6, 6), as `Hint` takes one; infinite along open axes. Type:
        /// float64 array.
        covariance: Py<PyArray2<f64>>,
        /// Within how much the position is known: standard deviations of position (the prior's unit) and rotation
        /// (radians) along and about any axis of the camera; None: it is not known. Type: tuple[float, float] | None.
        known: Option<(f64, f64)>,
        /// Whether the frame's time ended its search, which goes on in the next frames. Type: bool.
        out_of_time: bool,
        /// Number of the frame that this one is predicted from; None: it is intra. Type: int | None.
        reference: Option<u32>,
        /// Whether the frame fits the prior much better with red and blue exchanged, as OpenCV has them. Looked for in
        /// the first frames, told once, with a warning; nothing else changes. Type: bool.
        colours_exchanged: bool,
        /// Whether the rate was kept. Type: bool.
        rate_kept: bool,
        /// Bytes of the packet's latent part. Type: int.
        latent_bytes: usize,
        /// Bytes of its truth map. Type: int.
        truth_bytes: usize,
        /// Where the search started: "previous", "predicted", "external", "uncertain" or "key frame". Type: str.
        start: String,
        /// Renders at full size that the frame took. Type: int.
        full_renders: u32,
        /// Time from the frame to its pose, its render and the difference, milliseconds. Type: float.
        refine_milliseconds: f64,
        /// Time of coding the difference and writing the packet, milliseconds. Type: float.
        code_milliseconds: f64,
    }

    fn __repr__(&self, py: Python) -> String {
        let bytes = self.packet.bind(py).as_bytes().len();
        let (frame, psnr) = (self.frame, self.psnr);
        format!("<nvsprior.Encoded frame {frame}, {bytes} bytes, {psnr:.2} dB>")
    }
}

impl PyEncoded {
    fn of(py: Python, encoded: &Encoded, picture: Py<PyAny>) -> PyResult<PyEncoded> {
        let FrameStats { frame, render_psnr, psnr, certain, out_of_time, .. } = encoded.stats;
        let FrameStats { reference, rate_kept, latent_bytes, truth_bytes, start, .. } =
            encoded.stats;
        let FrameStats { colours_exchanged, .. } = encoded.stats;
        let FrameStats { full_renders, refine_milliseconds, code_milliseconds, .. } = encoded.stats;
        let rows = encoded.stats.covariance.map(Vec::from);
        Ok(PyEncoded {
            packet: PyBytes::new(py, &encoded.packet).unbind(),
            picture,
            pose: PyPose(encoded.pose),
            frame,
            render_psnr,
            psnr,
            certain,
            covariance: PyArray2::from_vec2(py, &rows)?.unbind(),
            known: encoded.stats.known.map(|known| (known.position, known.rotation)),
            out_of_time,
            colours_exchanged,
            reference,
            rate_kept,
            latent_bytes,
            truth_bytes,
            start: start.name().into(),
            full_renders,
            refine_milliseconds,
            code_milliseconds,
        })
    }
}

/// Encodes the frames of one camera, in order.
///
/// How fine the difference picture is: give one of `quality`, `psnr` and `bytes`, or nothing for quality 10.
///
/// - `quality`: 0 to 100. `psnr`: dB, at the least bytes. `bytes`: of the whole packet, never exceeded.
/// - `residual`: a difference picture is sent; False: none is before `set_rate` asks for one.
/// - `stream`: which frame one is predicted from, "chain", "layers", "keys" or "acknowledged"; None: from none.
///   `key_every`: an intra frame after so many; 0: none after the first.
/// - `tune`: what counts most, "psnr", "ssim" or "detection".
/// - `predict_poses`: poses are predicted from those that the topside acknowledges.
/// - `threshold`: mean squared error, values in [0, 1]: a pose whose error is below this stays if the prior shows too
///   little to tell whether it is right.
/// - `camera_interval`, `check_interval`: frames after which the camera, and a check of the render, are sent again; 0:
///   never. `first_frame`: number of the first frame.
/// - `truth`: packets have truth maps.
/// - `lost_renders`: most renders that a frame takes beside its first search; a step that would take more is cut short
///   or left out, and the next frames go on. 0: search from the frame before and from hints alone.
/// - `frame_time`: most time that a frame takes, milliseconds; None: as long as its search takes. It must hold one
///   render and one coding, which are measured here. `Encoded.out_of_time` tells whether it ended a search.
/// - `frames_treated`: frames come treated as the prior's preprocessing says.
///
/// Types: engine: Engine, prior: Prior, camera: Camera, quality: float | None, psnr: float | None, bytes: int | None,
/// residual: bool, stream: str | None, key_every: int, tune: str, threshold: float, camera_interval: int,
/// check_interval: int, first_frame: int, predict_poses: bool, truth: bool, lost_renders: int, frame_time: float |
/// None, frames_treated: bool.
#[pyclass(frozen, module = "nvsprior", name = "Encoder")]
pub struct PyEncoder(Handle<Content>);

pub struct Content {
    pub encoder: Encoder,
    /// The frame, in memory that is kept.
    frame: Picture,
    encoded: Encoded,
    signals: Signals,
}

impl PyEncoder {
    pub fn handle(&self) -> &Handle<Content> {
        &self.0
    }
}

#[pymethods]
impl PyEncoder {
    #[new]
    #[pyo3(signature = (engine, prior, camera, *, quality = None, psnr = None, bytes = None,
        residual = true, stream = None, key_every = 16, tune = "psnr", threshold = 1e-3, camera_interval = 64,
        check_interval = 0, first_frame = 0, predict_poses = false, truth = true,
        lost_renders = 96, frame_time = None, frames_treated = false))]
    #[allow(clippy::too_many_arguments)] // Python names them.
    fn new(
        py: Python,
        engine: &PyEngine,
        prior: &PyPrior,
        camera: &PyCamera,
        quality: Option<f32>,
        psnr: Option<f64>,
        bytes: Option<i128>,
        residual: bool,
        stream: Option<&str>,
        key_every: i128,
        tune: &str,
        threshold: f64,
        camera_interval: i128,
        check_interval: i128,
        first_frame: i128,
        predict_poses: bool,
        truth: bool,
        lost_renders: i128,
        frame_time: Option<f64>,
        frames_treated: bool,
    ) -> PyResult<PyEncoder> {
        whole!(bytes, key_every, camera_interval, check_interval, first_frame, lost_renders);
        if !(threshold.is_finite() && threshold >= 0.0) {
            return Err(
                Failure::argument(format!("threshold: {threshold}, must be 0 or more")).into()
            );
        }
        let rate = options::rate(quality, psnr, bytes)?.unwrap_or(Rate::Quality(10.0));
        let mut how = EncoderOptions {
            threshold,
            rate: residual.then_some(rate),
            tune: options::tune(tune)?,
            mode: options::mode(stream, key_every)?,
            camera_interval,
            render_checks: RenderChecks::every(check_interval),
            first_frame,
            predict_poses,
            truth,
            frame_time: frame_time.map(options::frame_time).transpose()?,
            frames_treated,
            ..EncoderOptions::default()
        };
        how.refine.lost_renders = lost_renders;
        let encoder = detached(py, || {
            let scene = engine.scene(&prior.0)?;
            Ok(Encoder::new(engine.get()?, &scene, &camera.0, how)?)
        })?;
        let signals = Signals::default();
        encoder.interrupt().ask(signals.looked_for());
        Ok(PyEncoder(Handle::new(Content {
            encoder,
            signals,
            frame: Picture::default(),
            encoded: Encoded::with_room(camera.0.width, camera.0.height),
        })))
    }

    /// Encodes a frame: uint8, shape (height, width, 3), RGB, of the camera's size. It is copied once, into memory that
    /// the encoder keeps.
    ///
    /// `hint`: about where the camera stands, used if the frame before gives no good start; the first frame needs one
    /// unless the prior has key frames. `time`: when the frame was taken, seconds on a clock of yours. `out`: an array
    /// of the frame's shape, which then is `Encoded.picture`. A frame that fails changes nothing. Types: frame: uint8
    /// array, hint: Pose | array | Hint | None, time: float | None, out: uint8 array | None. Returns Encoded.
    #[pyo3(signature = (frame, hint = None, *, time = None, out = None))]
    fn encode(
        &self,
        py: Python,
        frame: &Bound<PyAny>,
        hint: Option<PyHint>,
        time: Option<f64>,
        out: Option<&Bound<PyAny>>,
    ) -> PyResult<PyEncoded> {
        let hint = hint.map(|hint| hint.0);
        let mut call = self.0.enter()?;
        let camera = *call.encoder.camera();
        out.map(|out| check_out("out", out, (camera.width, camera.height))).transpose()?;
        read_picture("frame", frame, &mut call.frame)?;
        let done = call.detached(py, |content| {
            let Content { encoder, frame, encoded, .. } = content;
            Ok(encoder.encode_into(frame, FrameInfo { hint, time }, encoded)?)
        });
        call.signals.raised()?;
        done?;
        if call.encoded.stats.colours_exchanged {
            let text = c"the frame fits the prior much better with red and blue exchanged: frames are RGB; of \
                OpenCV's, which are BGR, give `frame[..., ::-1]`";
            PyErr::warn(py, &py.get_type::<PyUserWarning>(), text, 1)?;
        }
        let picture = write_picture(py, &call.encoded.picture, out)?.unbind();
        PyEncoded::of(py, &call.encoded, picture)
    }

    /// The prior's render at the pose of the last frame: uint8, shape (height, width, 3). `out`: as for `encode`.
    /// Types: out: uint8 array | None. Returns uint8 array.
    #[pyo3(signature = (*, out = None))]
    fn render<'py>(
        &self,
        py: Python<'py>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        write_picture(py, &self.0.enter()?.encoded.render, out)
    }

    /// Sets how fine the difference pictures are from here on; nothing: none is sent. `steady_bytes`: bytes of a packet
    /// for a link; one that also states the camera, or a check, has as many more as these take. Types: quality: float |
    /// None, psnr: float | None, bytes: int | None, steady_bytes: int | None. Returns None.
    #[pyo3(signature = (*, quality = None, psnr = None, bytes = None, steady_bytes = None))]
    fn set_rate(
        &self,
        quality: Option<f32>,
        psnr: Option<f64>,
        bytes: Option<i128>,
        steady_bytes: Option<i128>,
    ) -> PyResult<()> {
        whole!(bytes, steady_bytes);
        let rate = options::rate(quality, psnr, bytes)?;
        let mut content = self.0.enter()?;
        let encoder = &mut content.encoder;
        match (rate, steady_bytes) {
            (None, Some(bytes)) => encoder.set_steady_bytes(bytes),
            (rate, None) => encoder.set_rate(rate),
            _ => {
                let text = "quality, psnr, bytes and steady_bytes: give one of them";
                return Err(Failure::argument(text).into());
            }
        }
        Ok(())
    }

    /// The camera of the next frame. Type: Camera.
    #[getter]
    fn camera(&self) -> PyResult<PyCamera> {
        Ok(PyCamera(*self.0.enter()?.encoder.camera()))
    }

    /// Sets another camera, or another size, from the next frame on. Poses carry over. Types: camera: Camera. Returns
    /// None.
    fn set_camera(&self, py: Python, camera: &PyCamera) -> PyResult<()> {
        Ok(self.0.enter()?.detached(py, |content| Ok(content.encoder.set_camera(&camera.0)?))?)
    }

    /// Sets which pixels count: an array of bool, or of uint8, of which 128 and more counts, shape (height, width).
    /// None: all do. Mask what shows the vehicle itself. Types: mask: array | None. Returns None.
    fn set_mask(&self, mask: Option<&Bound<PyAny>>) -> PyResult<()> {
        let mut call = self.0.enter()?;
        let nvsprior::Camera { width, height, .. } = *call.encoder.camera();
        let data = mask.map(|mask| read_mask("mask", mask, (width, height))).transpose()?;
        let mask = data.map(|data| Mask { width, height, data });
        Ok(call.encoder.set_mask(mask.as_ref()).map_err(Failure::from)?)
    }

    /// Sets the rectangle that gets more of the bits, pixels: (left, top, width, height). An error in it counts
    /// `weight` times as much as one beside it, 1 to 255. None: all parts count the same. Types: region: tuple[int,
    /// int, int, int] | None, weight: int. Returns None.
    #[pyo3(signature = (region, weight = 8))]
    fn set_region(&self, region: Option<[i128; 4]>, weight: i128) -> PyResult<()> {
        whole!(weight);
        let mut call = self.0.enter()?;
        let size = (call.encoder.camera().width, call.encoder.camera().height);
        let interest = region.map(|[left, top, width, height]| {
            let number = |value: i128| Whole::<u32>::whole(value, "region");
            let (left, top) = (number(left)?, number(top)?);
            let (width, height) = (number(width)?, number(height)?);
            let across = left..left.saturating_add(width);
            let down = top..top.saturating_add(height);
            Ok::<_, Failure>(Interest::rectangle(size, across, down, weight)?)
        });
        call.encoder.set_interest(interest.transpose()?);
        Ok(())
    }

    /// Has the next packet state prior and camera: the topside asks what packets are about, or one was lost. Returns
    /// None.
    fn announce(&self) -> PyResult<()> {
        self.0.enter()?.encoder.announce();
        Ok(())
    }

    /// Tells that the topside has decoded a frame in full (`Decoded.kept`); the number may be modulo 65,536. Types:
    /// frame: int. Returns None.
    fn acknowledge(&self, frame: i128) -> PyResult<()> {
        whole!(frame);
        self.0.enter()?.encoder.acknowledge(frame);
        Ok(())
    }

    /// Tells whether the topside holds the pose of a frame; the number may be modulo 65,536. Types: frame: int, held:
    /// bool. Returns None.
    #[pyo3(signature = (frame, held = true))]
    fn acknowledge_pose(&self, frame: i128, held: bool) -> PyResult<()> {
        whole!(frame);
        self.0.enter()?.encoder.acknowledge_pose(frame, held);
        Ok(())
    }

    /// Leaves out the numbers of frames that are not encoded. Types: frames: int. Returns None.
    fn skip(&self, frames: i128) -> PyResult<()> {
        whole!(frames);
        self.0.enter()?.encoder.skip(frames);
        Ok(())
    }

    /// Forgets the track: the next frame needs a hint, or key frames. Returns None.
    fn reset(&self) -> PyResult<()> {
        self.0.enter()?.encoder.reset();
        Ok(())
    }

    /// Renders key frames ahead, at most so many, for a first frame without a hint. Returns how many are left. Types:
    /// most: int. Returns int.
    fn prepare(&self, py: Python, most: i128) -> PyResult<usize> {
        let most: usize = most.whole("most")?;
        let mut call = self.0.enter()?;
        let left = call.detached(py, |content| Ok(content.encoder.prepare(most)?));
        call.signals.raised()?;
        Ok(left?)
    }
}
