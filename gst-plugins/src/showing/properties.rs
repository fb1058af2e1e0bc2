//! The properties that name the prior and the device, and how pictures are shown.

use nvsprior::Decoder;

use crate::held_prior::HeldPrior;
use crate::property;

/// The values of those about pictures.
#[derive(Clone, Debug, Default)]
pub struct Showing {
    pub camera: Option<String>,
    pub post_messages: bool,
    pub truth_messages: bool,
    pub overlay: bool,
    pub filter: bool,
}

impl Showing {
    /// A decoder as the properties say.
    pub fn decoder(&self, held: &HeldPrior) -> Result<Decoder, gst::ErrorMessage> {
        let mut decoder = Decoder::new(&held.engine, &held.scene);
        if let Some(camera) = &self.camera {
            let wrong = |error: &dyn std::fmt::Display| {
                gst::error_msg!(gst::LibraryError::Settings, ("{error}"))
            };
            let camera = property::sized_camera(camera).map_err(|error| wrong(&error))?;
            decoder.add_camera(&camera).map_err(|error| wrong(&error))?;
        }
        let filtered = decoder.set_filter(self.filter);
        filtered.map_err(|error| gst::error_msg!(gst::LibraryError::Init, ("filter: {error}")))?;
        Ok(decoder)
    }
}

/// The class of an element that shows pictures: its properties behind those that all such have.
macro_rules! showing_element {
    (
        wrapper: [$($wrapper:tt)*];
        $(#[$attribute:meta])*
        struct $name:ident {
            $($(#[property($($property:tt)*)])* $field:ident: $type:ty,)*
        }
    ) => {
        #[derive(glib::Properties)]
        #[properties(wrapper_type = $($wrapper)*)]
        $(#[$attribute])*
        pub struct $name {
            #[property(name = "prior", get, set, type = Option<String>, member = prior, mutable_ready,
                blurb = "File of the trained scene, the same as the vehicle's: .ply, .nvsg, .nvsb, .spz; the content \
                    tells the format")]
            #[property(name = "prior-memory", get, set, type = u32, member = memory, mutable_ready,
                blurb = "Most memory for the splats of a prior in blocks (.nvsb), MiB: only those that cameras see \
                    are loaded; 0: it is loaded whole")]
            #[property(name = "device", get, set, type = Option<String>, member = device, mutable_ready,
                blurb = "The Vulkan device's number, or a part of its name or its driver's name (default: the best \
                    device)")]
            #[property(name = "watchdog", get, set, type = u32, member = watchdog, mutable_ready,
                blurb = "Milliseconds that one submission to the device may take before the device counts as lost; 0: \
                    no bound")]
            prior: Mutex<PriorSettings>,

            #[property(name = "camera", get, set, type = Option<String>, member = camera, mutable_ready,
                blurb = "The vehicle's camera, width,height,fx,fy,cx,cy in pixels, so that packets can be decoded \
                    even if the one that told it was lost (default: packets tell it)")]
            #[property(name = "post-messages", get, set, type = bool, member = post_messages, mutable_playing,
                blurb = "Post an element message with each picture's figures: nvspdec-frame, nvsptopside-frame")]
            #[property(name = "truth-messages", get, set, type = bool, member = truth_messages, mutable_playing,
                blurb = "Post an element message with each picture, nvspdec-truth or nvsptopside-truth: how far each \
                    block of it is from what the camera saw")]
            #[property(name = "overlay", get, set, type = bool, member = overlay, mutable_playing,
                blurb = "Draw over each picture what of it differs from what the camera saw (yellow stripes), is \
                    wrong (magenta lattice), or was not seen (grey, with dots)")]
            #[property(name = "filter", get, set, type = bool, member = filter, mutable_ready,
                blurb = "Filter pictures by a small network that knows the scene, with the prior's weights, or with \
                    the library's")]
            showing: Mutex<crate::showing::Showing>,

            // The derive macro takes its scope from these signs: all must be from here.
            $($(#[property($($property)*)])* $field: $type,)*
        }
    };
}
pub(crate) use showing_element;
