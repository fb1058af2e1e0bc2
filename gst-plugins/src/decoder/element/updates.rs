//! What `nvspdec` does with updates.

use gst::prelude::*;
use gst::subclass::prelude::*;
use gst_video::prelude::*;

use nvsprior::Error;
use nvsprior::prior::{Update, UpdateError};

use crate::dive_file::DiveFile;
use crate::held_prior::HeldPrior;
use crate::lock::lock;
use crate::property::PropertyError;
use crate::update_event::{Answer, SentUpdate, UpdateName};

use super::{CATEGORY, Decoder, Settings, State};

impl Decoder {
    /// Draws with what is in the dive file from the first packet on.
    pub(super) fn begin_learnt(
        &self,
        held: &HeldPrior,
        decoder: &mut nvsprior::Decoder,
    ) -> Result<Option<DiveFile>, gst::ErrorMessage> {
        let wrong = |error: &dyn std::fmt::Display| {
            gst::error_msg!(gst::ResourceError::OpenRead, ("{error}"))
        };
        let Settings { updates, learnt, .. } = lock(&self.settings).clone();
        let Some(path) = learnt else { return Ok(None) };
        if !updates {
            return Err(gst::error_msg!(
                gst::LibraryError::Settings,
                ("{}", PropertyError::NoUpdates)
            ));
        }
        let (file, left_out) =
            DiveFile::open("learnt", &path, held.scene.id()).map_err(|error| wrong(&error))?;
        if let Some(error) = left_out {
            gst::element_imp_warning!(self, gst::ResourceError::Read, ("{error}"));
        }
        for update in file.each_bytes().map_err(|error| wrong(&error))? {
            decoder.add_update(&update).map_err(|error| wrong(&error))?;
        }
        Ok(Some(file))
    }

    /// Takes an update. Returns the newest one that is held, if it was taken.
    pub(super) fn take_update(&self, update: &SentUpdate) -> Option<UpdateName> {
        let mut state = lock(&self.state);
        let State { decoder, dive_file, no_room, .. } = &mut *state;
        let decoder = decoder.as_mut()?;
        match decoder.add_update(&update.bytes) {
            Ok(_) => {}
            Err(Error::Update(UpdateError::NoRoom)) => {
                if !std::mem::replace(no_room, true) {
                    let text = "an update of the prior has come, but property updates is false, or \
                                prior-memory is set: it is not drawn with";
                    gst::element_imp_warning!(self, gst::LibraryError::Settings, ("{text}"));
                }
                return None;
            }
            Err(error) => {
                // Others come before it, or it was damaged: it comes again.
                gst::debug!(CATEGORY, imp = self, "update {}: {error}", update.name.number);
                return None;
            }
        }
        if let Some(file) = dive_file {
            let kept = Update::read(&update.bytes).and_then(|update| file.add(update));
            if let Err(error) = kept {
                gst::element_imp_warning!(self, gst::ResourceError::Write, ("{error}"));
            }
        }
        Some(newest(decoder))
    }

    /// Tells those upstream that an update is held.
    pub(super) fn tell_held(&self, name: UpdateName) {
        lock(&self.counts).learnt = Some(name);
        let answer = Answer::Held { name, over_link: false };
        self.obj().sink_pad().push_event(answer.event());
    }
}

/// The newest update that a decoder holds.
pub(super) fn newest(decoder: &nvsprior::Decoder) -> UpdateName {
    UpdateName { number: decoder.learnt().number(), state: decoder.learnt().state() }
}
