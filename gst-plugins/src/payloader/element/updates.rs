//! What `nvsppay` does with updates, and with reports of them.

use gst::prelude::*;
use gst::subclass::prelude::*;

use nvsprior::keys::Refusal;
use nvsprior::modem::ModemError;

use crate::lock::lock;
use crate::update_event::SentUpdate;

use super::{CATEGORY, Payloader, State};

impl Payloader {
    /// Takes an update for the topside.
    pub(super) fn take_update(&self, update: SentUpdate) {
        let mut state = lock(&self.state);
        let now = state.now;
        state.pieces.push(now, update);
        state.update_refused &= state.pieces.has_refused();
        lock(&self.counts).updates += 1;
        drop(state);
        self.answer();
    }

    /// Tells the encoder what became of updates, and what they take of the link.
    pub(super) fn answer(&self) {
        let (answers, refusal, known) = {
            let mut state = lock(&self.state);
            let (answers, refusal) = (state.pieces.answers(), state.pieces.take_refusal());
            let known = state.update_refused;
            state.update_refused |= refusal.is_some();
            (answers, refusal, known)
        };
        if let Some(error) = refusal.filter(|_| !known) {
            let text = format!("{error}: the update is not sent");
            gst::element_imp_warning!(self, gst::StreamError::Encode, ("{text}"));
        }
        for answer in answers {
            gst::debug!(CATEGORY, imp = self, "{answer:?}");
            self.sink.push_event(answer.event());
        }
    }

    /// Takes a topside's report. `false`: it is none, or none is expected.
    pub(super) fn take_report(&self, report: &[u8]) -> bool {
        let taken = {
            let mut state = lock(&self.state);
            let now = state.now;
            let State { keyed, pieces, .. } = &mut *state;
            let report = match keyed {
                Some(keyed) => keyed.verifier.verify(report).map(|verified| verified.content),
                None => Ok(report),
            };
            report.map_err(ModemError::from).and_then(|report| pieces.report(now, report))
        };
        if let Err(error) = &taken {
            let mut counts = lock(&self.counts);
            counts.foreign += u64::from(*error == ModemError::Key(Refusal::Foreign));
            counts.replayed += u64::from(*error == ModemError::Key(Refusal::Replayed));
            drop(counts);
            gst::debug!(CATEGORY, imp = self, "a report: {error}");
        }
        self.answer();
        taken.is_ok()
    }
}
