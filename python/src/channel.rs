//! A simulated acoustic channel.

use nvsprior_channel::channel::{Channel, ChannelOptions};
use nvsprior_link::modem::Loss;
use pyo3::prelude::*;

use crate::arguments::whole;
use crate::errors::Failure;
use crate::handle::Handle;

/// Carries modem frames one after another, and loses some as Gilbert's model says. The same seed gives the same losses.
///
/// `bit_rate`: bit/s. `overhead`: bytes that a modem frame takes beside its own. `propagation`: seconds from one end to
/// the other. `loss`, `burst`: the chance that a modem frame is lost, and how many are in a row. `reorder`: the chance
/// that one arrives late. `blackout`: nothing arrives from the first time to the second, seconds. Types: bit_rate:
/// float, overhead: int, propagation: float, loss: float, burst: float, reorder: float, blackout: tuple[float, float],
/// seed: int.
#[pyclass(frozen, module = "nvsprior", name = "Channel")]
pub struct PyChannel(Handle<Channel>);

#[pymethods]
impl PyChannel {
    #[new]
    #[pyo3(signature = (*, bit_rate, overhead = 0, propagation = 0.0, loss = 0.0, burst = 1.0, reorder = 0.0,
        blackout = (0.0, 0.0), seed = 1))]
    #[allow(clippy::too_many_arguments)] // Python names them.
    fn new(
        bit_rate: f64,
        overhead: i128,
        propagation: f64,
        loss: f64,
        burst: f64,
        reorder: f64,
        blackout: (f64, f64),
        seed: i128,
    ) -> PyResult<PyChannel> {
        whole!(overhead, seed);
        let loss = Loss { chance: loss, burst };
        loss.check().map_err(Failure::from)?;
        let wrong = |name: &str, value: f64, due: &str| {
            Err(Failure::argument(format!("{name}: {value}, must be {due}")).into())
        };
        if !(bit_rate.is_finite() && bit_rate > 0.0) {
            return wrong("bit_rate", bit_rate, "positive and finite");
        }
        if !(propagation.is_finite() && propagation >= 0.0) {
            return wrong("propagation", propagation, "0 or more");
        }
        if !(0.0..=1.0).contains(&reorder) {
            return wrong("reorder", reorder, "in 0 to 1");
        }
        Ok(PyChannel(Handle::new(Channel::new(ChannelOptions {
            bit_rate,
            overhead,
            propagation,
            loss,
            reorder,
            blackout: blackout.into(),
            seed,
        }))))
    }

    /// Sends a modem frame of `length` bytes that is ready at `now`, seconds, after those before it. Returns when it
    /// arrives, seconds; None: it is lost. Types: now: float, length: int. Returns float | None.
    fn send(&self, now: f64, length: i128) -> PyResult<Option<f64>> {
        whole!(length);
        if !now.is_finite() {
            return Err(Failure::argument(format!("now: {now}, must be finite")).into());
        }
        Ok(self.0.enter()?.send(now, length).arrival)
    }
}
