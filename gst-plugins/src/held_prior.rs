//! The device and the prior that an element works with.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use gst::prelude::*;
use nvsprior::prior::PriorError;
use nvsprior::prior::blocked::BlockedPrior;
use nvsprior::render::{BlockReader, Scene};
use nvsprior::vulkan::DeviceOptions;
use nvsprior::{Engine, Error, Prior};

use crate::property::PropertyError;

/// What names the prior and the device.
#[derive(Clone, Debug, Default)]
pub struct PriorSettings {
    pub prior: Option<String>,
    /// Most memory for the splats of a prior in blocks, MiB; 0: it is loaded whole.
    pub memory: u32,
    pub device: Option<String>,
    /// Milliseconds; 0: no bound.
    pub watchdog: u32,
}

pub struct HeldPrior {
    pub engine: Engine,
    pub scene: Arc<Scene>,
}

impl HeldPrior {
    /// Opens the device, reads the prior and uploads it. That takes seconds. What a user should know of the prior's
    /// file is posted as warnings of the element.
    pub fn open(
        settings: &PriorSettings,
        element: &impl IsA<gst::Element>,
    ) -> Result<HeldPrior, gst::ErrorMessage> {
        let Some(file) = &settings.prior else {
            let what = "give the file of the trained scene, .ply, .nvsg, .nvsb or .spz";
            let error = PropertyError::Missing("prior", what);
            return Err(gst::error_msg!(gst::ResourceError::Settings, ("{error}")));
        };
        let unread = |error: &dyn std::fmt::Display| {
            let text = error.to_string();
            // Not every error of the library names the file.
            let text = if text.contains(file.as_str()) { text } else { format!("{file}: {text}") };
            gst::error_msg!(gst::ResourceError::OpenRead, ("{text}"))
        };
        let options = settings.device_options();
        let content = settings.read(Path::new(file)).map_err(|e| unread(&e))?;
        if let Content::Whole(prior) = &content {
            for note in prior.report().notes() {
                gst::element_warning!(element, gst::ResourceError::OpenRead, ("{file}: {note}"));
            }
        }
        let engine = Engine::new(&options)
            .map_err(|error| gst::error_msg!(gst::ResourceError::OpenReadWrite, ("{error}")))?;
        let uploaded = match &content {
            Content::Whole(prior) => engine.upload(prior),
            Content::InBlocks(blocked) => {
                let limit = u64::from(settings.memory) << 20;
                engine.open_blocked(blocked, limit, BlockReader::threaded())
            }
        };
        let scene = uploaded.map_err(|e| unread(&e))?;
        Ok(HeldPrior { engine, scene })
    }
}

/// A prior as it was read.
enum Content {
    Whole(Box<Prior>),
    InBlocks(Arc<BlockedPrior>),
}

impl PriorSettings {
    /// Whether the prior stays in its file, and is loaded by what cameras see.
    pub fn is_in_blocks(&self) -> bool {
        self.memory > 0
    }

    fn read(&self, path: &Path) -> Result<Content, PriorError> {
        match self.is_in_blocks() {
            true => Ok(Content::InBlocks(Arc::new(BlockedPrior::open(path)?))),
            false => {
                Ok(Content::Whole(Box::new(nvsprior_formats::open(path, &Default::default())?)))
            }
        }
    }

    fn device_options(&self) -> DeviceOptions {
        let watchdog = u64::from(self.watchdog);
        DeviceOptions {
            device: self.device.clone(),
            watchdog: (watchdog > 0).then(|| Duration::from_millis(watchdog)),
            ..DeviceOptions::default()
        }
    }
}

/// Whether nothing can be coded after this error.
pub fn is_fatal(error: &Error) -> bool {
    matches!(error, Error::Vulkan(_))
}
