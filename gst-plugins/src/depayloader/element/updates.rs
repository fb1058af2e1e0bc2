//! What `nvspdepay` does with updates, and reports of them.

use gst::glib;
use gst::prelude::*;
use gst::subclass::prelude::*;

use crate::lock::lock;
use crate::update_event::{Answer, SentUpdate, UpdateName};

use super::{CATEGORY, Depayloader, State};

/// States that a report tells of at most.
const STATES: usize = 4;

impl Depayloader {
    /// Passes on the updates that are whole.
    pub(super) fn pass_updates(&self) {
        let _output = lock(&self.output);
        let next = || {
            let state = lock(&self.state);
            state.playout.as_ref()?.update().map(<[u8]>::to_vec)
        };
        while let Some(bytes) = next() {
            self.begin();
            let update = SentUpdate::new(bytes, false);
            // Behind a queue, who takes it is not known. What the decoder lacks then comes with the next repetition.
            let added = match &update {
                Ok(update) => self.src.push_event(update.event()),
                Err(error) => {
                    gst::debug!(CATEGORY, imp = self, "an update: {error}");
                    false
                }
            };
            if let Some(playout) = &mut lock(&self.state).playout {
                playout.settle_update(added);
            }
            lock(&self.counts).updates += u64::from(added);
        }
    }

    /// Notes an update that the decoder holds. Those of its number and above are gone.
    pub(super) fn note_held(&self, name: UpdateName) {
        let held = &mut lock(&self.state).held;
        held.retain(|before| before.number < name.number);
        held.insert(0, name);
        held.truncate(STATES);
    }

    /// A report for the vehicle; `None`: there is nothing to tell.
    pub(super) fn report(&self) -> Option<glib::Bytes> {
        let mut state = lock(&self.state);
        let State { playout, held, .. } = &mut *state;
        let held = held.iter().map(|name| (name.number, name.state));
        let report = playout.as_mut()?.report(held);
        let report =
            report.inspect_err(|error| gst::debug!(CATEGORY, imp = self, "a report: {error}"));
        Some(glib::Bytes::from_owned(report.ok()??))
    }

    pub(super) fn src_event(&self, event: gst::Event) -> bool {
        match Answer::read(&event) {
            // They end here: the vehicle hears of them by reports.
            Some(Answer::Held { name, .. }) => {
                self.note_held(name);
                true
            }
            Some(_) => true,
            None => gst::Pad::event_default(&self.src, Some(&*self.obj()), event),
        }
    }
}
