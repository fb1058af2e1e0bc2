//! The vehicle's end of a link: packets to modem frames.

use nvsprior::modem::{
    Division, Loss, PacketState, Protection, RateControlOptions, Sender, SenderOptions,
    SenderStatistics,
};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::errors::Failure;
use crate::handle::Handle;
use crate::keys::PyKeys;

/// How a packet was divided into shares, which are modem frames.
#[pyclass(frozen, get_all, module = "nvsprior", name = "Division")]
pub struct PyDivision {
    /// Shares.
    shares: usize,
    /// Bytes of each.
    share_bytes: usize,
    /// Any so many yield a picture; of an unprotected packet the first so many.
    picture_shares: usize,
    /// So many yield all that is sent.
    whole_shares: usize,
    /// Bytes of the packet that are sent.
    packet_bytes: usize,
    /// Bytes on the link, the overhead of each share counted.
    link_bytes: usize,
}

impl From<Division> for PyDivision {
    fn from(division: Division) -> PyDivision {
        let Division { shares, share_bytes, picture_shares, whole_shares, .. } = division;
        let Division { packet_bytes, link_bytes, .. } = division;
        PyDivision { shares, share_bytes, picture_shares, whole_shares, packet_bytes, link_bytes }
    }
}

/// What a report told.
#[pyclass(frozen, get_all, module = "nvsprior", name = "ProcessedReport")]
pub struct PyProcessedReport {
    /// Frames that were decoded in full, modulo 65,536: for `Encoder.acknowledge`.
    kept: Vec<u32>,
    /// Frames, modulo 65,536, and whether their pose is held: for `Encoder.acknowledge_pose`.
    poses: Vec<(u32, bool)>,
    /// Part of the shares that was lost; None: too few to tell.
    loss: Option<f64>,
    /// Shares that are sent again.
    shares: usize,
    /// User bytes that came with the report.
    user: Option<Py<PyBytes>>,
}

/// Takes a vehicle's packets, and yields the modem frames to send. For each frame ask `plan` for its bytes, encode it
/// in as many, and `push` the packet. Whenever the modem is free, send what `next` gives.
///
/// - `bit_rate`: bit/s; 0, without protection alone: packets go as they come.
/// - `mtu`: most bytes of a modem frame. `overhead`: bytes that it costs on the link beside them.
/// - `latency`: seconds from a frame's exposure to the end of its packet's last share. `delay`: what of it is no
///   transmission. `spread`: what of it lies between the packet's first share and its last.
/// - `frame_rate`: most pictures per second. `min_bytes`: fewest for a picture. `max_shares`: of a packet.
/// - `loss`, `burst`: the chance that a modem frame is lost, and how many are lost in a row.
/// - `protection`: "layers" (the default), or None. `stream`: 0 to 3; without protection 0.
/// - `user`: bytes that travel with each packet; None: there are none.
/// - `expect_reports`: the topside sends reports.
/// - `keys`: those of both sides.
#[pyclass(frozen, module = "nvsprior", name = "Sender")]
pub struct PySender(Handle<Sender>);

#[pymethods]
impl PySender {
    #[new]
    #[pyo3(signature = (*, bit_rate, mtu, latency, frame_rate, delay = 0.0, spread = 0.0, overhead = 0,
        min_bytes = 40, max_shares = 16, loss = 0.0, burst = 1.0, user = None, stream = 0,
        protection = Some("layers"), expect_reports = false, keys = None))]
    #[allow(clippy::too_many_arguments)] // Python names them.
    fn new(
        bit_rate: f64,
        mtu: usize,
        latency: f64,
        frame_rate: f64,
        delay: f64,
        spread: f64,
        overhead: usize,
        min_bytes: usize,
        max_shares: usize,
        loss: f64,
        burst: f64,
        user: Option<usize>,
        stream: u8,
        protection: Option<&str>,
        expect_reports: bool,
        keys: Option<&PyKeys>,
    ) -> PyResult<PySender> {
        let protection = match protection {
            Some("layers") => Protection::Layers,
            None => Protection::None,
            Some(other) => {
                let text = format!("protection: {other:?}, but there are \"layers\" and None");
                return Err(Failure::argument(text).into());
            }
        };
        let loss = Loss { chance: loss, burst };
        loss.check().map_err(Failure::from)?;
        let control = RateControlOptions {
            bit_rate,
            mtu,
            overhead,
            latency,
            delay,
            spread,
            frame_rate,
            min_bytes,
            max_shares,
            loss,
            user,
        };
        let options = SenderOptions { control, stream, protection, expect_reports };
        let sender = match keys {
            Some(keys) => Sender::with_keys(options, &keys.0),
            None => Sender::new(options),
        };
        Ok(PySender(Handle::new(sender.map_err(Failure::from)?)))
    }

    /// Bytes for the packet of the frame exposed at `now`, seconds. None: the frame is left out. Times must not fall.
    fn plan(&self, now: f64) -> PyResult<Option<usize>> {
        Ok(self.0.enter()?.plan(now).map_err(Failure::from)?)
    }

    /// Takes the packet of the frame that was planned last, ready at `now`, and the user bytes that travel with it.
    #[pyo3(signature = (now, packet, user = None))]
    fn push(&self, now: f64, packet: &[u8], user: Option<&[u8]>) -> PyResult<PyDivision> {
        let division = self.0.enter()?.push(now, packet, user).map_err(Failure::from)?;
        Ok(division.into())
    }

    /// When the next modem frame was due, and its bytes, if it is due at `now`.
    fn next<'py>(&self, py: Python<'py>, now: f64) -> PyResult<Option<(f64, Bound<'py, PyBytes>)>> {
        let mut call = self.0.enter()?;
        Ok(call.next(now).map(|(due, frame)| (due, PyBytes::new(py, frame))))
    }

    /// When the next modem frame is due, seconds; None: none waits.
    #[getter]
    fn due(&self) -> PyResult<Option<f64>> {
        Ok(self.0.enter()?.due())
    }

    /// Shares that wait.
    #[getter]
    fn waiting(&self) -> PyResult<usize> {
        Ok(self.0.enter()?.waiting())
    }

    /// Takes a report of the topside that came at `now`. Tell the encoder which frames are kept.
    fn process_report(&self, py: Python, now: f64, report: &[u8]) -> PyResult<PyProcessedReport> {
        let mut call = self.0.enter()?;
        let (report, user) = call.read_report(report).map_err(Failure::from)?;
        let processed = call.process_report(now, &report).map_err(Failure::from)?;
        let kept = report.packets().filter(|(_, packet)| packet.state == PacketState::Kept);
        Ok(PyProcessedReport {
            kept: kept.map(|(frame, _)| frame).collect(),
            poses: report.poses().collect(),
            loss: processed.loss,
            shares: processed.shares,
            user: user.map(|user| PyBytes::new(py, user).unbind()),
        })
    }

    /// The link carries another bit rate from `now` on.
    fn set_bit_rate(&self, now: f64, bit_rate: f64) -> PyResult<()> {
        Ok(self.0.enter()?.set_bit_rate(now, bit_rate).map_err(Failure::from)?)
    }

    /// The link's loss, as it was measured.
    #[pyo3(signature = (loss, burst = 1.0))]
    fn set_loss(&self, loss: f64, burst: f64) -> PyResult<()> {
        let set = self.0.enter()?.set_loss(Loss { chance: loss, burst });
        Ok(set.map_err(Failure::from)?)
    }

    /// Counts bytes that are given to the link at `now` besides.
    fn count(&self, now: f64, bytes: usize) -> PyResult<()> {
        Ok(self.0.enter()?.count(now, bytes).map_err(Failure::from)?)
    }

    /// With keys: the number of the next modem frame, to go on from after a restart.
    #[getter]
    fn next_number(&self) -> PyResult<Option<u64>> {
        Ok(self.0.enter()?.next_number())
    }

    /// Counts since the start, by name.
    #[getter]
    fn statistics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let SenderStatistics { left_out, packets, cut, shares, bytes, resent, foreign, replayed } =
            self.0.enter()?.statistics();
        let counts = PyDict::new(py);
        for (name, count) in [
            ("left_out", left_out),
            ("packets", packets),
            ("cut", cut),
            ("shares", shares),
            ("bytes", bytes),
            ("resent", resent),
            ("foreign", foreign),
            ("replayed", replayed),
        ] {
            counts.set_item(name, count)?;
        }
        Ok(counts)
    }
}
