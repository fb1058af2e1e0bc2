//! The topside's end of a link: modem frames to pictures.

use nvsprior::Decoder;
use nvsprior_link::modem::{
    CollectedPacket, Collector, CollectorOptions, CollectorStatistics, Sharer,
};
use nvsprior_link::{
    Playout, Recalled, Region, Topside, TopsideEvent, TopsideLink, TopsideOptions,
};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::arguments::{Bytes, Whole, whole};
use crate::arrays::write_picture;
use crate::decoder::{PyDecoded, PyDecoder};
use crate::engine::PyEngine;
use crate::errors::Failure;
use crate::geometry::PyCamera;
use crate::handle::{Handle, detached};
use crate::keys::PyKeys;
use crate::prior::PyPrior;
use crate::record::record;
use crate::vehicle::{any, counts};

record! {
    /// What has come of a packet.
    class "Received" PyReceived {
        /// Frame number, modulo 2^24. Type: int.
        frame: u32,
        /// The packet's first bytes: decode them with `start=True`. Type: bytes.
        packet: Py<PyBytes>,
        /// The bytes are the whole packet. Type: bool.
        complete: bool,
        /// User bytes that came with it. Type: bytes.
        user: Py<PyBytes>,
        /// Modem frames that came. Type: int.
        arrived: usize,
        /// Modem frames that it was sent in; None: not known yet. Type: int | None.
        sent: Option<usize>,
    }
}

impl PyReceived {
    fn of(py: Python, packet: CollectedPacket, user: &[u8]) -> PyReceived {
        let CollectedPacket { frame, bytes, complete, arrived, sent, .. } = packet;
        let (packet, user) = (PyBytes::new(py, bytes).unbind(), PyBytes::new(py, user).unbind());
        PyReceived { frame, packet, complete, user, arrived, sent }
    }
}

/// The topside's end of a link: packets from modem frames, poses, the order of pictures and their age, reports. Give
/// `receive` what the modem received; then take what `picture` and `report` give, until they give None. Times are
/// seconds on a clock of the caller's.
///
/// - `mtu`: most bytes of a modem frame, the vehicle's. `stream`: the one that is taken, 0 to 3.
/// - `playout`: "newest": `picture` gives the newest frame, as it comes and as it gets better. "in order": each frame
///   once, `latency` seconds after its exposure at the latest, `frame_rate` per second. "on demand": `show` gives it.
/// - `max_shares`: modem frames of a packet that there is room for. `packets`: that are held, 1 to 64. `age`: seconds
///   after which a packet is stale.
/// - `modem_checks`: the modem hands over no damaged frames. `report_every`: seconds; None: there is no return channel.
/// - `utc`: times are UTC. `keys`: those of both sides. `state`: what `state()` gave before a restart.
/// - `display_filter`: filter pictures for the screen.
///
/// Types: engine: Engine, prior: Prior, mtu: int, playout: str, latency: float, frame_rate: float | None, stream: int,
/// max_shares: int | None, packets: int, age: float | None, modem_checks: bool, report_every: float | None, utc: bool,
/// keys: Keys | None, state: bytes-like | None, display_filter: bool.
#[pyclass(frozen, module = "nvsprior", name = "Topside")]
pub struct PyTopside(Handle<Topside>);

#[pymethods]
impl PyTopside {
    #[new]
    #[pyo3(signature = (engine, prior, mtu, *, playout = "newest", latency = 1.5, frame_rate = None, stream = 0,
        max_shares = None, packets = 64, age = None, modem_checks = false, report_every = Some(1.0), utc = false,
        keys = None, state = None, display_filter = false))]
    #[allow(clippy::too_many_arguments)] // Python names them.
    fn new(
        py: Python,
        engine: &PyEngine,
        prior: &PyPrior,
        mtu: i128,
        playout: &str,
        latency: f64,
        frame_rate: Option<f64>,
        stream: i128,
        max_shares: Option<i128>,
        packets: i128,
        age: Option<f64>,
        modem_checks: bool,
        report_every: Option<f64>,
        utc: bool,
        keys: Option<&PyKeys>,
        state: Option<Bytes>,
        display_filter: bool,
    ) -> PyResult<PyTopside> {
        whole!(mtu, stream, max_shares, packets);
        let options = TopsideOptions {
            playout: named_playout(playout, latency, frame_rate)?,
            stream,
            max_shares,
            packets,
            age,
            modem_checks,
            report_every,
            is_utc: utc,
            keys: keys.map(|keys| keys.0.clone()),
            state: state.map(|state| state.to_vec()).unwrap_or_default(),
            ..TopsideOptions::new(mtu)
        };
        let topside = detached(py, || {
            let scene = engine.scene(&prior.0)?;
            let mut decoder = Decoder::new(engine.get()?, &scene);
            decoder.set_filter(display_filter)?;
            Ok(Topside::with(decoder, &options)?)
        })?;
        Ok(PyTopside(Handle::new(topside)))
    }

    /// Takes what the modem received. Gives the frame whose packet has more bytes, and whether it is whole; None: there
    /// is none. Raises if it is none of the vehicle's, damaged, or too late: that is no failure of the link. Types:
    /// now: float, frame: bytes-like. Returns tuple[int, bool] | None.
    fn receive(&self, now: f64, frame: Bytes) -> PyResult<Option<(u32, bool)>> {
        Ok(self.0.enter()?.receive(now, &frame).map_err(Failure::from)?.1)
    }

    /// The next picture to show, and its frame's time, seconds. None: there is none now. Types: now: float. Returns
    /// tuple[float, Decoded] | None.
    fn picture(&self, py: Python, now: f64) -> PyResult<Option<(f64, PyDecoded)>> {
        let mut call = self.0.enter()?;
        let is_new = call.detached(py, |topside| Ok(topside.picture(now)?.is_some()))?;
        let Some((decoded, shown)) = call.shown().filter(|_| is_new) else { return Ok(None) };
        let picture = write_picture(py, &decoded.picture, None)?.unbind();
        Ok(Some((shown.time, PyDecoded::of(py, decoded, picture)?)))
    }

    /// With playout "on demand": a camera frame's picture, and what it is: "own", "between" (the prior, at a pose
    /// between those of frames at most `reach` before and after it), "held" (the one before), or "nothing". Types:
    /// frame: int, reach: int. Returns tuple[str, uint8 array | None].
    #[pyo3(signature = (frame, reach = 8))]
    fn show(
        &self,
        py: Python,
        frame: i128,
        reach: i128,
    ) -> PyResult<(&'static str, Option<Py<PyAny>>)> {
        whole!(frame, reach);
        let mut call = self.0.enter()?;
        let (recalled, picture) = call.detached(py, |topside| {
            let (recalled, picture) = topside.show(frame, reach)?;
            // The GIL is away: the array is made behind it.
            Ok((recalled, picture.clone()))
        })?;
        let name = match recalled {
            Recalled::Own => "own",
            Recalled::Between => "between",
            Recalled::Held => "held",
            Recalled::Nothing => return Ok(("nothing", None)),
        };
        Ok((name, Some(write_picture(py, &picture, None)?.unbind())))
    }

    /// What has come of a frame's packet, if enough of it came for a picture. Types: frame: int. Returns Received |
    /// None.
    fn packet(&self, py: Python, frame: i128) -> PyResult<Option<PyReceived>> {
        whole!(frame);
        let mut call = self.0.enter()?;
        let link = call.link();
        Ok(link.packet(frame).map(|packet| PyReceived::of(py, packet, link.user_of(&packet))))
    }

    /// The report that is due at `now`, as a modem frame for the return channel. None: none is. Types: now: float.
    /// Returns bytes | None.
    fn report<'py>(&self, py: Python<'py>, now: f64) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let mut call = self.0.enter()?;
        let report = call.report(now).map_err(Failure::from)?;
        Ok(report.map(|report| PyBytes::new(py, report)))
    }

    /// When there is something to do at the latest, seconds; None: nothing waits. Type: float | None.
    #[getter]
    fn due(&self) -> PyResult<Option<f64>> {
        Ok(self.0.enter()?.link().due())
    }

    /// The next event: its name, and seconds, a count or None. "store": keep `state()` before more goes. Returns
    /// tuple[str, object] | None.
    fn event(&self, py: Python) -> PyResult<Option<(&'static str, Py<PyAny>)>> {
        event(py, self.0.enter()?.link())
    }

    /// What this end goes on with if it starts again. Returns bytes.
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let mut state = Vec::new();
        self.0.enter()?.link().state(&mut state);
        Ok(PyBytes::new(py, &state))
    }

    /// What the pilot looks at gets more of the bytes: left, top, right and bottom as parts (0 to 1) of the picture.
    /// Types: edges: list[float] | None, weight: int. Returns None.
    #[pyo3(signature = (edges, weight = 8))]
    fn set_region(&self, edges: Option<[f64; 4]>, weight: i128) -> PyResult<()> {
        whole!(weight);
        let region = edges.map(|edges| {
            let wrong = format!("edges: {edges:?}, must be a rectangle within 0 to 1");
            Region::new(edges, weight).ok_or_else(|| Failure::argument(wrong))
        });
        self.0.enter()?.link().set_region(region.transpose()?);
        Ok(())
    }

    /// User bytes of reports from here on. Types: user: bytes-like. Returns None.
    fn set_user(&self, user: Bytes) -> PyResult<()> {
        Ok(self.0.enter()?.link().set_user(&user).map_err(Failure::from)?)
    }

    /// Why packets that come are not shown: an exception that is not raised; None: they are. Type: Error | None.
    #[getter]
    fn refusal(&self, py: Python) -> PyResult<Option<Py<PyAny>>> {
        let call = self.0.enter()?;
        let refusal =
            call.refusal().map(|error| PyErr::from(Failure::new(error.kind().into(), error)));
        Ok(refusal.map(|error| error.into_value(py).into_any()))
    }

    /// The vehicle's camera, if it is known. Type: Camera | None.
    #[getter]
    fn camera(&self) -> PyResult<Option<PyCamera>> {
        Ok(self.0.enter()?.camera().copied().map(PyCamera))
    }

    /// Tells it about a camera that packets only name. Types: camera: Camera. Returns None.
    fn add_camera(&self, camera: &PyCamera) -> PyResult<()> {
        Ok(self.0.enter()?.decoder().add_camera(&camera.0).map_err(Failure::from)?)
    }

    /// Counts since the start, by name. Type: dict[str, int].
    #[getter]
    fn statistics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        statistics(py, self.0.enter()?.link())
    }
}

/// The topside's end of a link for packets, which are decoded elsewhere: `Topside` decodes, too. Give `receive` what
/// the modem received; then take what `next_packet` and `report` give, until they give None. The arguments are those of
/// `Topside`; playout is "newest" or "in order". Types: mtu: int, playout: str, latency: float, frame_rate: float |
/// None, stream: int, max_shares: int | None, packets: int, age: float | None, modem_checks: bool, report_every: float
/// | None, utc: bool, keys: Keys | None, state: bytes-like | None.
#[pyclass(frozen, module = "nvsprior", name = "TopsideLink")]
pub struct PyTopsideLink(Handle<TopsideLink>);

#[pymethods]
impl PyTopsideLink {
    #[new]
    #[pyo3(signature = (mtu, *, playout = "newest", latency = 1.5, frame_rate = None, stream = 0, max_shares = None,
        packets = 64, age = None, modem_checks = false, report_every = Some(1.0), utc = false, keys = None,
        state = None))]
    #[allow(clippy::too_many_arguments)] // Python names them.
    fn new(
        mtu: i128,
        playout: &str,
        latency: f64,
        frame_rate: Option<f64>,
        stream: i128,
        max_shares: Option<i128>,
        packets: i128,
        age: Option<f64>,
        modem_checks: bool,
        report_every: Option<f64>,
        utc: bool,
        keys: Option<&PyKeys>,
        state: Option<Bytes>,
    ) -> PyResult<PyTopsideLink> {
        whole!(mtu, stream, max_shares, packets);
        let options = TopsideOptions {
            playout: named_playout(playout, latency, frame_rate)?,
            stream,
            max_shares,
            packets,
            age,
            modem_checks,
            report_every,
            is_utc: utc,
            keys: keys.map(|keys| keys.0.clone()),
            state: state.map(|state| state.to_vec()).unwrap_or_default(),
            ..TopsideOptions::new(mtu)
        };
        Ok(PyTopsideLink(Handle::new(TopsideLink::new(&options).map_err(Failure::from)?)))
    }

    /// Takes what the modem received: as `Topside.receive`. Types: now: float, frame: bytes-like. Returns tuple[int,
    /// bool] | None.
    fn receive(&self, now: f64, frame: Bytes) -> PyResult<Option<(u32, bool)>> {
        Ok(self.0.enter()?.receive(now, &frame).map_err(Failure::from)?.1)
    }

    /// The next packet to decode, and its frame's time, seconds. None: there is none now. Types: now: float. Returns
    /// tuple[float, Received] | None.
    fn next_packet(&self, py: Python, now: f64) -> PyResult<Option<(f64, PyReceived)>> {
        let mut call = self.0.enter()?;
        let next = call.next_packet(now).map_err(Failure::from)?;
        let next = next.map(|(due, packet)| (due.time, packet.frame));
        let found = next.and_then(|(time, frame)| Some((time, call.packet(frame)?)));
        Ok(found.map(|(time, packet)| (time, PyReceived::of(py, packet, call.user_of(&packet)))))
    }

    /// The report that is due at `now`. None: none is. `kept`: numbers of the frames that were decoded in full.
    /// `decoder`: tells the poses that it holds; give its `hold` each packet that comes. Types: now: float, kept:
    /// list[int], decoder: Decoder | None. Returns bytes | None.
    #[pyo3(signature = (now, kept = Vec::new(), *, decoder = None))]
    fn report<'py>(
        &self,
        py: Python<'py>,
        now: f64,
        kept: Vec<i128>,
        decoder: Option<&PyDecoder>,
    ) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let kept = kept.into_iter().map(|frame| frame.whole("kept"));
        let kept = kept.collect::<Result<Vec<u32>, Failure>>()?;
        let mut call = self.0.enter()?;
        let topside = decoder.map(|decoder| decoder.handle().enter()).transpose()?;
        let holds = topside.as_ref().map(|topside| |frame| topside.decoder.holds_pose(frame));
        let report = call.report(now, |frame| kept.contains(&frame), holds, false);
        Ok(report.map_err(Failure::from)?.map(|report| PyBytes::new(py, report)))
    }

    /// When there is something to do at the latest, seconds; None: nothing waits. Type: float | None.
    #[getter]
    fn due(&self) -> PyResult<Option<f64>> {
        Ok(self.0.enter()?.due())
    }

    /// The next event: as `Topside.event`. Returns tuple[str, object] | None.
    fn event(&self, py: Python) -> PyResult<Option<(&'static str, Py<PyAny>)>> {
        event(py, &mut *self.0.enter()?)
    }

    /// What this end goes on with if it starts again. Returns bytes.
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let mut state = Vec::new();
        self.0.enter()?.state(&mut state);
        Ok(PyBytes::new(py, &state))
    }

    /// Counts since the start, by name. Type: dict[str, int].
    #[getter]
    fn statistics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        statistics(py, &*self.0.enter()?)
    }
}

fn named_playout(name: &str, latency: f64, frame_rate: Option<f64>) -> Result<Playout, Failure> {
    match name {
        "newest" => Ok(Playout::Newest),
        "in order" => Ok(Playout::InOrder { latency, frame_rate }),
        "on demand" => Ok(Playout::OnDemand),
        other => {
            let due = "\"newest\", \"in order\" and \"on demand\"";
            Err(Failure::argument(format!("playout: {other:?}, but there are {due}")))
        }
    }
}

fn event(py: Python, link: &mut TopsideLink) -> PyResult<Option<(&'static str, Py<PyAny>)>> {
    let Some(event) = link.event() else { return Ok(None) };
    Ok(Some(match event {
        TopsideEvent::VehicleHeard => ("vehicle heard", py.None()),
        TopsideEvent::VehicleSilent(seconds) => ("vehicle silent", any(py, seconds)?),
        TopsideEvent::Strangers(count) => ("strangers", any(py, count)?),
        TopsideEvent::Store => ("store", py.None()),
    }))
}

fn statistics<'py>(py: Python<'py>, link: &TopsideLink) -> PyResult<Bound<'py, PyDict>> {
    counts!(
        py,
        CollectorStatistics {
            accepted,
            duplicates,
            rejected,
            waiting,
            arrived,
            sent,
            completed,
            repaired,
            partial,
            lost,
            damaged,
            foreign,
            replayed
        } = link.statistics()
    )
}

/// Divides a packet into modem frames of at most `mtu` bytes, without protection: for packets that exist already.
/// Types: packet: bytes-like, mtu: int. Returns list[bytes].
#[pyfunction]
pub fn split<'py>(py: Python<'py>, packet: Bytes, mtu: i128) -> PyResult<Vec<Bound<'py, PyBytes>>> {
    whole!(mtu);
    let mut sharer = Sharer::default();
    sharer.split(&packet, mtu).map_err(Failure::from)?;
    Ok(sharer.shares().map(|frame| PyBytes::new(py, frame)).collect())
}

/// Puts packets together from modem frames of at most `mtu` bytes, in any order: the newest 64 of stream 0, by frame
/// number. What is no modem frame is left aside. Types: frames: list[bytes-like], mtu: int. Returns list[Received].
#[pyfunction]
pub fn join(py: Python, frames: Vec<Bytes>, mtu: i128) -> PyResult<Vec<PyReceived>> {
    let mtu: usize = mtu.whole("mtu")?;
    let options = CollectorOptions {
        shares: frames.len().clamp(1, nvsprior_link::modem::MAX_SHARES),
        packets: 64,
        // All came at once.
        age: 1.0,
        modem_checks: mtu < nvsprior_link::modem::MIN_CHECKED_MTU,
        ..CollectorOptions::new(mtu)
    };
    let mut collector = Collector::new(options).map_err(Failure::from)?;
    let mut numbers: Vec<u32> = Vec::new();
    for frame in &frames {
        use nvsprior_link::modem::Collected as C;
        if let Ok(C::Grown(_, number) | C::Complete(_, number)) = collector.push(0.0, frame) {
            numbers.push(number);
        }
    }
    numbers.sort_unstable();
    numbers.dedup();
    let packets = numbers.into_iter().filter_map(|number| collector.packet(0, number));
    Ok(packets.map(|packet| PyReceived::of(py, packet, packet.user.unwrap_or_default())).collect())
}
