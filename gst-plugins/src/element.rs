//! What all elements share: their class and its registration, and what the registry shows of them.

use gst::prelude::*;

/// An element's class and the function that registers it. No rank: an element needs a prior or a link's settings, so it
/// cannot be chosen by itself.
macro_rules! class {
    ($factory:literal, $name:ident extends $($class:path),+ $(; implements $interface:path)?) => {
        gst::glib::wrapper! {
            pub struct $name(ObjectSubclass<element::$name>)
                @extends $($class),+ $(, @implements $interface)?;
        }

        pub fn register(plugin: &gst::Plugin) -> Result<(), gst::glib::BoolError> {
            use gst::glib::prelude::StaticType;
            gst::Element::register(Some(plugin), $factory, gst::Rank::NONE, $name::static_type())
        }
    };
}
pub(crate) use class;

/// The category of an element's log.
macro_rules! log_category {
    ($factory:literal, $about:literal) => {
        static CATEGORY: std::sync::LazyLock<gst::DebugCategory> = std::sync::LazyLock::new(|| {
            gst::DebugCategory::new($factory, gst::DebugColorFlags::empty(), Some($about))
        });
    };
}
pub(crate) use log_category;

/// The functions of `ElementImpl` about the registry: names, and the templates of both pads.
macro_rules! registry {
    ($name:literal, $kind:literal, $about:literal, sink: $sink:expr, src: $src:expr) => {
        fn metadata() -> Option<&'static gst::subclass::ElementMetadata> {
            static METADATA: std::sync::LazyLock<gst::subclass::ElementMetadata> =
                std::sync::LazyLock::new(|| {
                    let author = "The nvsprior authors";
                    gst::subclass::ElementMetadata::new($name, $kind, $about, author)
                });
            Some(&*METADATA)
        }

        fn pad_templates() -> &'static [gst::PadTemplate] {
            static TEMPLATES: std::sync::LazyLock<[gst::PadTemplate; 2]> =
                std::sync::LazyLock::new(|| {
                    [
                        crate::caps::template("sink", gst::PadDirection::Sink, &$sink),
                        crate::caps::template("src", gst::PadDirection::Src, &$src),
                    ]
                });
            &*TEMPLATES
        }
    };
}
pub(crate) use registry;

/// A pad of a registered template.
pub fn pad(template: Option<gst::PadTemplate>) -> gst::PadBuilder<gst::Pad> {
    gst::Pad::builder_from_template(&template.expect("both templates are registered"))
}

/// Gives a new element its pads.
pub fn add_pads(element: &impl IsA<gst::Element>, pads: [&gst::Pad; 2]) {
    for pad in pads {
        element.add_pad(pad).expect("a new element has no pads yet");
    }
}
