//! The topside: packets in, pictures out.

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use nvsprior::{Decoded, Decoder, Picture, Trust};
use pyo3::prelude::*;

use crate::arguments::{Bytes, Whole, whole};
use crate::arrays::{check_out, write_picture};
use crate::engine::PyEngine;
use crate::errors::Failure;
use crate::geometry::{PyCamera, PyPose};
use crate::handle::{Handle, detached};
use crate::prior::PyPrior;
use crate::record::record;

record! {
    /// A decoded frame.
    class "Decoded" PyDecoded {
        /// The picture: uint8, shape (height, width, 3), RGB. Type: uint8 array.
        picture: Py<PyAny>,
        /// Frame number, modulo 2^24. Type: int.
        frame: u32,
        /// The pose that it was rendered at. Type: Pose.
        pose: PyPose,
        /// Whether the vehicle's picture confirms the pose. How well its place is known is `known`. Type:
        /// bool.
        certain: bool,
        /// Within how much the vehicle knows its position: standard deviations of position (the prior's unit) and
        /// rotation (radians) along and about any axis of the camera; None: it does not. Type: tuple[float, float] |
        /// None.
        known: Option<(f64, f64)>,
        /// Whether the render is the vehicle's, byte for byte; None: the packet does not tell. Type: bool | None.
        same_render: Option<bool>,
        /// Whether both devices are portable. Type: bool.
        portable: bool,
        /// Rows, from the top, that the difference picture reached. Type: int.
        rows: u32,
        /// Number of the frame that this one is predicted from; None: it is intra. Type: int | None.
        reference: Option<u32>,
        /// Later frames of the stream may be predicted from this one: tell `Encoder.acknowledge`. Type: bool.
        kept: bool,
        /// Whether the picture went through the display filter. Type: bool.
        filtered: bool,
        /// How far the picture is from what the camera saw: uint8, a level for each block of 16x16 pixels, by rows. 0:
        /// as seen, 1: differs, 2: wrong, 3: not seen. Type: uint8 array.
        truth: Py<PyArray2<u8>>,
        /// Why a part of the packet could not be used: an exception that was not raised; None: all was used. Type:
        /// Error | None.
        damage: Option<Py<PyAny>>,
    }

    fn __repr__(&self) -> String {
        let damage = if self.damage.is_some() { ", damaged" } else { "" };
        format!("<nvsprior.Decoded frame {}{damage}>", self.frame)
    }
}

impl PyDecoded {
    pub fn of(py: Python, decoded: &Decoded, picture: Py<PyAny>) -> PyResult<PyDecoded> {
        let truth = &decoded.truth;
        let blocks = [truth.rows as usize, truth.columns as usize];
        let levels = PyArray1::from_slice(py, &truth.levels).reshape(blocks)?;
        let damage = decoded.damage.as_ref();
        let damage = damage.map(|error| PyErr::from(Failure::new(error.kind().into(), error)));
        Ok(PyDecoded {
            picture,
            frame: decoded.frame,
            pose: PyPose(decoded.pose),
            certain: !decoded.uncertain,
            known: decoded.known.map(|known| (known.position, known.rotation)),
            same_render: decoded.same_render,
            portable: decoded.portable,
            rows: decoded.rows,
            reference: decoded.reference,
            kept: decoded.kept,
            filtered: decoded.filtered,
            truth: levels.unbind(),
            damage: damage.map(|error| error.into_value(py).into_any()),
        })
    }
}

/// Decodes packets, in any order.
///
/// `pixel_limit`: most pixels of a picture; None: no limit. `display_filter`: filter pictures for the screen. Types:
/// engine: Engine, prior: Prior, pixel_limit: int | None, display_filter: bool.
#[pyclass(frozen, module = "nvsprior", name = "Decoder")]
pub struct PyDecoder(Handle<Content>);

pub struct Content {
    pub decoder: Decoder,
    decoded: Decoded,
    /// What is drawn beside packets.
    drawn: Picture,
}

impl PyDecoder {
    pub fn handle(&self) -> &Handle<Content> {
        &self.0
    }
}

/// The picture size of a packet, if its camera is known or told.
fn size_of(decoder: &Decoder, packet: &[u8]) -> Option<(u32, u32)> {
    let packet = decoder.parse(packet).ok()?;
    decoder.size_told(&packet)
}

#[pymethods]
impl PyDecoder {
    #[new]
    #[pyo3(signature = (engine, prior, *, pixel_limit = None, display_filter = false))]
    fn new(
        py: Python,
        engine: &PyEngine,
        prior: &PyPrior,
        pixel_limit: Option<i128>,
        display_filter: bool,
    ) -> PyResult<PyDecoder> {
        let pixel_limit: Option<u32> = pixel_limit.whole("pixel_limit")?;
        let decoder = detached(py, || {
            let scene = engine.scene(&prior.0)?;
            let mut decoder = Decoder::new(engine.get()?, &scene);
            decoder.set_pixel_limit(pixel_limit.unwrap_or(u32::MAX));
            decoder.set_filter(display_filter)?;
            Ok(decoder)
        })?;
        let (decoded, drawn) = (Decoded::default(), Picture::default());
        Ok(PyDecoder(Handle::new(Content { decoder, decoded, drawn })))
    }

    /// Decodes a packet. If only its latent part is valid, the picture is the render alone, and `damage` tells why.
    ///
    /// `start`: the bytes are the undamaged start of a packet, as a collector gives it. `out`: an array of the
    /// picture's shape, which then is `Decoded.picture`. Types: packet: bytes-like, start: bool, out: uint8 array |
    /// None. Returns Decoded.
    #[pyo3(signature = (packet, *, start = false, out = None))]
    fn decode(
        &self,
        py: Python,
        packet: Bytes,
        start: bool,
        out: Option<&Bound<PyAny>>,
    ) -> PyResult<PyDecoded> {
        let packet = &packet[..];
        let mut call = self.0.enter()?;
        if let Some((out, size)) = out.zip(size_of(&call.decoder, packet)) {
            check_out("out", out, size)?;
        }
        let trust = if start { Trust::Start } else { Trust::Whole };
        call.detached(py, |content| {
            let Content { decoder, decoded, .. } = content;
            Ok(decoder.decode_into(packet, trust, decoded)?)
        })?;
        let picture = write_picture(py, &call.decoded.picture, out)?.unbind();
        PyDecoded::of(py, &call.decoded, picture)
    }

    /// Draws the prior at a pose for the camera of the packet decoded last: for frames that did not come. None if there
    /// was no packet yet. `out`: as for `decode`. Types: pose: Pose | array, out: uint8 array | None. Returns uint8
    /// array | None.
    #[pyo3(signature = (pose, *, out = None))]
    fn draw<'py>(
        &self,
        py: Python<'py>,
        pose: PyPose,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        let mut call = self.0.enter()?;
        if let Some((out, camera)) = out.zip(call.decoder.camera()) {
            check_out("out", out, (camera.width, camera.height))?;
        }
        let there = call.detached(py, |content| {
            let Content { decoder, drawn, .. } = content;
            Ok(decoder.draw(&pose.0, drawn)?)
        })?;
        there.then(|| write_picture(py, &call.drawn, out)).transpose()
    }

    /// The camera of the packet decoded last. Type: Camera | None.
    #[getter]
    fn camera(&self) -> PyResult<Option<PyCamera>> {
        Ok(self.0.enter()?.decoder.camera().copied().map(PyCamera))
    }

    /// Tells the decoder about a camera that packets only name. Types: camera: Camera. Returns None.
    fn add_camera(&self, camera: &PyCamera) -> PyResult<()> {
        Ok(self.0.enter()?.decoder.add_camera(&camera.0).map_err(Failure::from)?)
    }

    /// Sets whether decoded pictures are filtered for the screen from here on. Types: on: bool. Returns None.
    fn set_display_filter(&self, py: Python, on: bool) -> PyResult<()> {
        Ok(self.0.enter()?.detached(py, |content| Ok(content.decoder.set_filter(on)?))?)
    }

    /// Holds the pose of a packet that came, and draws nothing: later poses may be predicted from it. Types: packet:
    /// bytes-like. Returns None.
    fn hold(&self, packet: Bytes) -> PyResult<()> {
        Ok(self.0.enter()?.decoder.hold(&packet).map_err(Failure::from)?)
    }

    /// Whether the pose of a frame is held. Types: frame: int. Returns bool.
    fn holds_pose(&self, frame: i128) -> PyResult<bool> {
        whole!(frame);
        Ok(self.0.enter()?.decoder.holds_pose(frame))
    }

    /// The pose that a packet states, and whether the vehicle is certain of it. The start of a packet is enough. Types:
    /// packet: bytes-like. Returns tuple[Pose, bool].
    fn pose_of(&self, packet: Bytes) -> PyResult<(PyPose, bool)> {
        let (pose, certain) = self.0.enter()?.decoder.pose_of(&packet).map_err(Failure::from)?;
        Ok((PyPose(pose), certain))
    }
}
