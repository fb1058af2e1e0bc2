//! The vehicle's end of a link: packets to modem frames.

use nvsprior_link::modem::{Division, Loss, Protection, SenderStatistics};
use nvsprior_link::{Pacing, VehicleEvent, VehicleLink, VehicleOptions};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::arguments::{Bytes, whole, wrong_type};
use crate::encoder::PyEncoder;
use crate::errors::Failure;
use crate::handle::Handle;
use crate::keys::PyKeys;

/// How a packet was divided into shares, which are modem frames.
#[pyclass(frozen, get_all, module = "nvsprior", name = "Division")]
pub struct PyDivision {
    /// Shares. Type: int.
    shares: usize,
    /// Bytes of each. Type: int.
    share_bytes: usize,
    /// Any so many yield a picture; of an unprotected packet the first so many. Type: int.
    picture_shares: usize,
    /// So many yield all that is sent. Type: int.
    whole_shares: usize,
    /// Bytes of the packet that are sent. Type: int.
    packet_bytes: usize,
    /// Bytes on the link, the overhead of each share counted. Type: int.
    link_bytes: usize,
}

impl From<Division> for PyDivision {
    fn from(division: Division) -> PyDivision {
        let Division { shares, share_bytes, picture_shares, whole_shares, .. } = division;
        let Division { packet_bytes, link_bytes, .. } = division;
        PyDivision { shares, share_bytes, picture_shares, whole_shares, packet_bytes, link_bytes }
    }
}

/// The vehicle's end of a link for packets: rate, protection, keys, frame numbers, and what the topside holds.
/// `Vehicle` has an encoder, too. For each camera frame: `plan`, `instruct` the encoder, encode, `push`. Whenever the
/// modem is free, send what `transmit` gives; give `receive` what the modem received. Times are seconds on a clock of
/// the caller's.
///
/// - `mtu`: most bytes of a modem frame. `overhead`: bytes that it costs on the link beside them.
/// - `bit_rate`: bit/s; "pull": the modem asks by `transmit`; None, without protection alone: packets go as they come.
/// - `frame_rate`: camera frames per second; None, without a bit rate alone: each that comes counts. `picture_rate`:
///   most pictures per second; None: as many.
/// - `latency`: seconds from a frame's exposure to the end of its packet's last modem frame. `delay`: what of it is no
///   transmission. `spread`: what of it lies between the packet's first modem frame and its last; None: by the loss.
/// - `min_bytes`: fewest for a picture. `max_shares`: modem frames of a packet; None: by MTU and rate.
/// - `loss`, `burst`: the chance that a modem frame is lost, and how many are lost in a row; reports tell the loss.
/// - `protection`: "layers" (the default), or None. `stream`: 0 to 3; without protection 0.
/// - `stamps`: packets tell when their frame was exposed. `utc`: times are UTC. `user_bytes`: that travel with each
///   packet.
/// - `expect_reports`: the topside sends reports. `keys`: those of both sides.
/// - `state`: what `state()` gave before a restart.
///
/// Types: mtu: int, bit_rate: float | str | None, frame_rate: float | None, picture_rate: float | None, latency: float,
/// delay: float, spread: float | None, overhead: int, min_bytes: int, max_shares: int | None, loss: float, burst:
/// float, protection: str | None, stream: int, stamps: bool, utc: bool, user_bytes: int, expect_reports: bool, keys:
/// Keys | None, state: bytes-like | None.
#[pyclass(frozen, module = "nvsprior", name = "VehicleLink")]
pub struct PyVehicleLink(Handle<VehicleLink>);

/// The bit rate, or how it comes to be.
pub enum PacingArgument {
    Rate(f64),
    Named(String),
}

impl FromPyObject<'_, '_> for PacingArgument {
    type Error = PyErr;

    fn extract(given: Borrowed<PyAny>) -> PyResult<PacingArgument> {
        let named = || given.extract().map(PacingArgument::Named);
        let found = given.extract().map(PacingArgument::Rate).or_else(|_| named());
        found.map_err(|_| wrong_type(&given, "bit_rate: a number, \"pull\" or None"))
    }
}

#[pymethods]
impl PyVehicleLink {
    #[new]
    #[pyo3(signature = (mtu, bit_rate, frame_rate, *, picture_rate = None, latency = 1.5, delay = 0.3, spread = None,
        overhead = 0, min_bytes = 40, max_shares = None, loss = 0.1, burst = 1.0, protection = Some("layers"),
        stream = 0, stamps = true, utc = false, user_bytes = 0, expect_reports = true, keys = None, state = None))]
    #[allow(clippy::too_many_arguments)] // Python names them.
    fn new(
        mtu: i128,
        bit_rate: Option<PacingArgument>,
        frame_rate: Option<f64>,
        picture_rate: Option<f64>,
        latency: f64,
        delay: f64,
        spread: Option<f64>,
        overhead: i128,
        min_bytes: i128,
        max_shares: Option<i128>,
        loss: f64,
        burst: f64,
        protection: Option<&str>,
        stream: i128,
        stamps: bool,
        utc: bool,
        user_bytes: i128,
        expect_reports: bool,
        keys: Option<&PyKeys>,
        state: Option<Bytes>,
    ) -> PyResult<PyVehicleLink> {
        whole!(mtu, overhead, min_bytes, max_shares, stream, user_bytes);
        let unknown = |name: &str, found: &str, due: &str| -> PyErr {
            Failure::argument(format!("{name}: {found:?}, but there are {due}")).into()
        };
        let options = VehicleOptions {
            mtu,
            pacing: match bit_rate {
                Some(PacingArgument::Rate(rate)) => Pacing::Rate(rate),
                Some(PacingArgument::Named(name)) if name == "pull" => Pacing::Pull,
                Some(PacingArgument::Named(name)) => {
                    return Err(unknown("bit_rate", &name, "a number, \"pull\" and None"));
                }
                None => Pacing::AsTheyCome,
            },
            frame_rate,
            picture_rate,
            latency,
            delay,
            spread,
            protection: match protection {
                Some("layers") => Protection::Layers,
                None => Protection::None,
                Some(other) => return Err(unknown("protection", other, "\"layers\" and None")),
            },
            loss: Loss { chance: loss, burst },
            overhead,
            min_bytes,
            max_shares,
            stream,
            expect_reports,
            // Poses are predicted by the encoder: `predict_poses`.
            state_poses: false,
            has_stamps: stamps,
            user_bytes,
            is_utc: utc,
            keys: keys.map(|keys| keys.0.clone()),
            state: state.map(|state| state.to_vec()).unwrap_or_default(),
        };
        Ok(PyVehicleLink(Handle::new(VehicleLink::new(&options).map_err(Failure::from)?)))
    }

    /// Counts a camera frame, and gives its number and the bytes of its packet. None: it is left out. `exposed`: when,
    /// seconds; None: now. Types: now: float, exposed: float | None. Returns tuple[int, int] | None.
    #[pyo3(signature = (now, exposed = None))]
    fn plan(&self, now: f64, exposed: Option<f64>) -> PyResult<Option<(u32, usize)>> {
        let planned = self.0.enter()?.plan(now, exposed.unwrap_or(now)).map_err(Failure::from)?;
        Ok(planned.map(|planned| (planned.number, planned.bytes)))
    }

    /// Drops the frame that was planned: it could not be encoded. Returns None.
    fn drop_plan(&self) -> PyResult<()> {
        self.0.enter()?.drop_plan();
        Ok(())
    }

    /// Tells the encoder what reports told since the last frame: call it before each frame. Types: encoder: Encoder.
    /// Returns None.
    fn instruct(&self, encoder: &PyEncoder) -> PyResult<()> {
        let mut call = self.0.enter()?;
        let mut content = encoder.handle().enter()?;
        Ok(call.instruct(&mut content.encoder).map_err(Failure::from)?)
    }

    /// Takes the packet of the frame that was planned, ready at `now`, and the user bytes that travel with it. Types:
    /// now: float, packet: bytes-like, user: bytes-like | None. Returns Division.
    #[pyo3(signature = (now, packet, user = None))]
    fn push(&self, now: f64, packet: Bytes, user: Option<Bytes>) -> PyResult<PyDivision> {
        let division = self.0.enter()?.push(now, &packet, user.as_deref().unwrap_or_default());
        Ok(division.map_err(Failure::from)?.into())
    }

    /// Takes what the modem received. Raises if it is no report for this vehicle: that is no failure of the link.
    /// Types: now: float, report: bytes-like. Returns None.
    fn receive(&self, now: f64, report: Bytes) -> PyResult<()> {
        Ok(self.0.enter()?.receive(now, &report).map_err(Failure::from)?)
    }

    /// The next modem frame that is due at `now` and has at most `most` bytes. None: none is. Types: now: float, most:
    /// int | None. Returns bytes | None.
    #[pyo3(signature = (now, most = None))]
    fn transmit<'py>(
        &self,
        py: Python<'py>,
        now: f64,
        most: Option<i128>,
    ) -> PyResult<Option<Bound<'py, PyBytes>>> {
        whole!(most);
        let mut call = self.0.enter()?;
        let frame = call.transmit(now, most.unwrap_or(usize::MAX)).map_err(Failure::from)?;
        Ok(frame.map(|frame| PyBytes::new(py, frame)))
    }

    /// When the next modem frame is due, seconds; None: none waits, or the modem pulls. Type: float | None.
    #[getter]
    fn due(&self) -> PyResult<Option<f64>> {
        Ok(self.0.enter()?.due())
    }

    /// The next event: its name, and seconds, a count, a rate, a region or user bytes, or None. "store": keep `state()`
    /// before more goes. Returns tuple[str, object] | None.
    fn event(&self, py: Python) -> PyResult<Option<(&'static str, Py<PyAny>)>> {
        let mut call = self.0.enter()?;
        let Some(event) = call.event() else { return Ok(None) };
        Ok(Some(match event {
            VehicleEvent::TopsideHeard => ("topside heard", py.None()),
            VehicleEvent::TopsideSilent(seconds) => ("topside silent", any(py, seconds)?),
            VehicleEvent::Strangers(count) => ("strangers", any(py, count)?),
            VehicleEvent::Asked => ("asked", py.None()),
            VehicleEvent::Region(region) => {
                let region = region.map(|region| (region.edges.map(u32::from), region.weight));
                ("region", any(py, region)?)
            }
            VehicleEvent::User => ("user", PyBytes::new(py, call.user()).into_any().unbind()),
            VehicleEvent::FrameRate(rate) => ("frame rate", any(py, rate)?),
            VehicleEvent::Store => ("store", py.None()),
        }))
    }

    /// What this end goes on with if it starts again. Returns bytes.
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let mut state = Vec::new();
        self.0.enter()?.state(&mut state);
        Ok(PyBytes::new(py, &state))
    }

    /// The link carries another bit rate from `now` on. Types: now: float, bit_rate: float. Returns None.
    fn set_bit_rate(&self, now: f64, bit_rate: f64) -> PyResult<()> {
        Ok(self.0.enter()?.set_bit_rate(now, bit_rate).map_err(Failure::from)?)
    }

    /// The link's loss, as it was measured. Types: loss: float, burst: float. Returns None.
    #[pyo3(signature = (loss, burst = 1.0))]
    fn set_loss(&self, loss: f64, burst: f64) -> PyResult<()> {
        let set = self.0.enter()?.set_loss(Loss { chance: loss, burst });
        Ok(set.map_err(Failure::from)?)
    }

    /// Counts bytes that are given to the link at `now` besides. Types: now: float, bytes: int. Returns None.
    fn count_others(&self, now: f64, bytes: i128) -> PyResult<()> {
        whole!(bytes);
        Ok(self.0.enter()?.count_others(now, bytes).map_err(Failure::from)?)
    }

    /// Number of the next frame: for `Encoder(first_frame=…)`. Type: int.
    #[getter]
    fn next_frame(&self) -> PyResult<u32> {
        Ok(self.0.enter()?.next_frame())
    }

    /// Counts since the start, by name. Type: dict[str, int].
    #[getter]
    fn statistics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let statistics = self.0.enter()?.statistics();
        counts!(
            py,
            SenderStatistics { left_out, packets, cut, shares, bytes, resent, foreign, replayed } =
                statistics
        )
    }
}

/// Counts by their names: all that the library has.
macro_rules! counts {
    ($py:expr, $statistics:ident { $($name:ident),* } = $found:expr) => {{
        let $statistics { $($name),* } = $found;
        let counts = PyDict::new($py);
        $(counts.set_item(stringify!($name), $name)?;)*
        Ok(counts)
    }};
}
pub(crate) use counts;

/// A value of any kind.
pub fn any<'py>(
    py: Python<'py>,
    value: impl IntoPyObject<'py, Error: Into<PyErr>>,
) -> PyResult<Py<PyAny>> {
    use pyo3::BoundObject;
    Ok(value.into_pyobject(py).map_err(Into::into)?.into_any().into_bound().unbind())
}
