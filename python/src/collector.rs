//! The topside's end of a link: modem frames to packets.

use std::collections::HashSet;

use nvsprior::modem::{
    Collected, CollectedPacket, Collector, CollectorOptions, CollectorStatistics,
};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::decoder::PyDecoder;
use crate::errors::Failure;
use crate::handle::Handle;
use crate::keys::PyKeys;

/// What a modem frame has brought.
#[pyclass(frozen, get_all, module = "nvsprior", name = "Collected")]
pub struct PyCollected {
    /// "complete": the packet is whole; "grown": it has more bytes than before; "kept": of use once more come;
    /// "duplicate"; "surplus"; "damaged": the packet's checks do not match.
    kind: &'static str,
    /// The stream, if the kind has one.
    stream: Option<u8>,
    /// The frame number, if the kind has one.
    frame: Option<u32>,
}

impl From<Collected> for PyCollected {
    fn from(collected: Collected) -> PyCollected {
        let (kind, stream, frame) = match collected {
            Collected::Complete(stream, frame) => ("complete", Some(stream), Some(frame)),
            Collected::Grown(stream, frame) => ("grown", Some(stream), Some(frame)),
            Collected::Kept => ("kept", None, None),
            Collected::Duplicate => ("duplicate", None, None),
            Collected::Surplus => ("surplus", None, None),
            Collected::Damaged(stream, frame) => ("damaged", Some(stream), Some(frame)),
        };
        PyCollected { kind, stream, frame }
    }
}

#[pymethods]
impl PyCollected {
    fn __repr__(&self) -> String {
        match self.frame {
            Some(frame) => format!("<nvsprior.Collected {}, frame {frame}>", self.kind),
            None => format!("<nvsprior.Collected {}>", self.kind),
        }
    }
}

/// What has come of a packet.
#[pyclass(frozen, get_all, module = "nvsprior", name = "CollectedPacket")]
pub struct PyCollectedPacket {
    /// Frame number, modulo 2^24.
    frame: u32,
    /// The packet's first bytes: decode them with `start=True`.
    packet: Py<PyBytes>,
    /// The bytes are the whole packet.
    complete: bool,
    /// No share brings more.
    ended: bool,
    /// User bytes that came with it.
    user: Option<Py<PyBytes>>,
    /// Shares that came.
    arrived: usize,
    /// Shares that it was sent in; None: not known yet.
    sent: Option<usize>,
}

impl PyCollectedPacket {
    fn new(py: Python, packet: CollectedPacket) -> PyCollectedPacket {
        let CollectedPacket { frame, bytes, complete, ended, user, arrived, sent } = packet;
        let packet = PyBytes::new(py, bytes).unbind();
        let user = user.map(|user| PyBytes::new(py, user).unbind());
        PyCollectedPacket { frame, packet, complete, ended, user, arrived, sent }
    }
}

/// Collects the modem frames of any number of packets at once, in any order, repeated, padded or damaged.
///
/// `mtu`: the sender's, bytes. `shares`: of a packet that there is room for. `packets`: of a stream that are held, 1 to
/// 64. `streams`: that are taken, 1 to 4. `age`: seconds after which a packet is stale. `modem_checks`: the modem hands
/// over no damaged frames. `keys`: those of both sides.
#[pyclass(frozen, module = "nvsprior", name = "Collector")]
pub struct PyCollector {
    handle: Handle<Collector>,
    mtu: usize,
}

#[pymethods]
impl PyCollector {
    #[new]
    #[pyo3(signature = (mtu, *, shares = 32, packets = 16, streams = 1, age = 4.0, modem_checks = false,
        keys = None))]
    #[allow(clippy::too_many_arguments)] // Python names them.
    fn new(
        mtu: usize,
        shares: usize,
        packets: usize,
        streams: usize,
        age: f64,
        modem_checks: bool,
        keys: Option<&PyKeys>,
    ) -> PyResult<PyCollector> {
        let options = CollectorOptions { mtu, shares, packets, streams, age, modem_checks };
        let collector = match keys {
            Some(keys) => Collector::with_keys(options, &keys.0),
            None => Collector::new(options),
        };
        Ok(PyCollector { handle: Handle::new(collector.map_err(Failure::from)?), mtu })
    }

    /// Takes a modem frame that came at `now`, seconds on a clock that does not go back. Raises if it is no share, is
    /// damaged or too old, or not of the keys; nothing changes then.
    fn push(&self, now: f64, frame: &[u8]) -> PyResult<PyCollected> {
        Ok(self.handle.enter()?.push(now, frame).map_err(Failure::from)?.into())
    }

    /// The packet of a frame number, if enough of it came for a picture.
    #[pyo3(signature = (frame, *, stream = 0))]
    fn packet(&self, py: Python, frame: u32, stream: u8) -> PyResult<Option<PyCollectedPacket>> {
        let call = self.handle.enter()?;
        Ok(call.packet(stream, frame).map(|packet| PyCollectedPacket::new(py, packet)))
    }

    /// The packet of the greatest frame number that yields a picture.
    #[pyo3(signature = (*, stream = 0))]
    fn newest(&self, py: Python, stream: u8) -> PyResult<Option<PyCollectedPacket>> {
        let call = self.handle.enter()?;
        Ok(call.newest(stream).map(|packet| PyCollectedPacket::new(py, packet)))
    }

    /// Indices of a packet's shares that have not come.
    #[pyo3(signature = (frame, *, stream = 0))]
    fn missing(&self, frame: u32, stream: u8) -> PyResult<Vec<usize>> {
        Ok(self.handle.enter()?.missing(stream, frame).collect())
    }

    /// A report for the vehicle of what came, as it goes over the return channel. None: nothing has come yet. `kept`:
    /// numbers of the frames that were decoded in full. `decoder`: tells the poses that it holds.
    #[pyo3(signature = (kept = Vec::new(), *, decoder = None, user = None, stream = 0))]
    fn report<'py>(
        &self,
        py: Python<'py>,
        kept: Vec<u32>,
        decoder: Option<&PyDecoder>,
        user: Option<&[u8]>,
        stream: u8,
    ) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let mut call = self.handle.enter()?;
        let kept: HashSet<u32> = kept.into_iter().collect();
        let report = call.report(stream, |frame| kept.contains(&frame)).map_err(Failure::from)?;
        let Some(mut report) = report else { return Ok(None) };
        if let Some(decoder) = decoder {
            let topside = decoder.handle().enter()?;
            report.tell_poses(|frame| topside.decoder.holds_pose(frame));
        }
        let mut bytes = vec![0; self.mtu];
        let written = call.write_report(&report, user, &mut bytes).map_err(Failure::from)?;
        Ok(Some(PyBytes::new(py, &bytes[..written])))
    }

    /// With keys: the number of the next report, to go on from after a restart.
    #[getter]
    fn next_number(&self) -> PyResult<Option<u64>> {
        Ok(self.handle.enter()?.next_number())
    }

    /// Counts since the start, by name.
    #[getter]
    fn statistics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let CollectorStatistics {
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
            replayed,
        } = self.handle.enter()?.statistics();
        let counts = PyDict::new(py);
        for (name, count) in [
            ("accepted", accepted),
            ("duplicates", duplicates),
            ("rejected", rejected),
            ("waiting", waiting),
            ("arrived", arrived),
            ("sent", sent),
            ("completed", completed),
            ("repaired", repaired),
            ("partial", partial),
            ("lost", lost),
            ("damaged", damaged),
            ("foreign", foreign),
            ("replayed", replayed),
        ] {
            counts.set_item(name, count)?;
        }
        Ok(counts)
    }
}
