//! What `nvspenc` does with updates.

use gst::prelude::*;
use gst::subclass::prelude::*;
use gst_video::prelude::*;

use crate::dive_file::DiveFile;
use crate::encoder::learning::Learning;
use crate::held_prior::{HeldPrior, is_fatal};
use crate::lock::lock;
use crate::update_event::SentUpdate;

use super::{CATEGORY, Encoder};

impl Encoder {
    pub(super) fn save(&self, learning: &mut Learning) {
        if let Err(error) = learning.save() {
            gst::element_imp_warning!(self, gst::ResourceError::Write, ("{error}"));
        }
    }

    /// Learns from the frame whose packet went last, and keeps what was adopted.
    pub(super) fn learn(&self) -> Result<(), gst::ErrorMessage> {
        let told = *lock(&self.told);
        let mut state = lock(&self.state);
        let Some(frames) = &mut state.frames else { return Ok(()) };
        let (learning, encoder) = frames.learning();
        self.save(learning);
        let done = learning.work(encoder, &told);
        lock(&self.counts).learnt = frames.learnt();
        match done {
            Err(error) if is_fatal(&error) => {
                Err(gst::error_msg!(gst::ResourceError::Failed, ("{error}")))
            }
            Err(error) => {
                let text = format!("{error}: nothing more is learnt");
                gst::element_imp_warning!(self, gst::StreamError::Encode, ("{text}"));
                Ok(())
            }
            Ok(()) => Ok(()),
        }
    }

    pub(super) fn next_unsent(&self) -> Option<SentUpdate> {
        lock(&self.state).frames.as_mut()?.learning().0.next_unsent()
    }

    /// Sends updates downstream. If nobody there takes them, the learner waits.
    pub(super) fn send_updates(&self) {
        while let Some(update) = self.next_unsent() {
            let name = update.name;
            gst::debug!(CATEGORY, imp = self, "update {}, state {}", name.number, name.state);
            self.obj().src_pad().push_event(update.event());
        }
    }

    /// Opens the file of what was learnt, if there is to be one.
    pub(super) fn dive_file(
        &self,
        held: &HeldPrior,
    ) -> Result<Option<DiveFile>, gst::ErrorMessage> {
        let Some(path) = lock(&self.settings).updates.clone() else { return Ok(None) };
        let opened = DiveFile::open("updates", &path, held.scene.id());
        let (file, left_out) =
            opened.map_err(|error| gst::error_msg!(gst::ResourceError::OpenRead, ("{error}")))?;
        if let Some(error) = left_out {
            gst::element_imp_warning!(self, gst::ResourceError::Read, ("{error}"));
        }
        Ok(Some(file))
    }
}
