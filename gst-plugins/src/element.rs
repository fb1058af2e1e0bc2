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

/// The functions of `ElementImpl` about the registry: names, and the templates of the pads.
macro_rules! registry {
    (
        $name:literal, $kind:literal, $about:literal,
        [$(($pad:literal, $direction:ident, $presence:ident, $caps:expr)),* $(,)?]
    ) => {
        fn metadata() -> Option<&'static gst::subclass::ElementMetadata> {
            static METADATA: std::sync::LazyLock<gst::subclass::ElementMetadata> =
                std::sync::LazyLock::new(|| {
                    let author = "The nvsprior authors";
                    gst::subclass::ElementMetadata::new($name, $kind, $about, author)
                });
            Some(&*METADATA)
        }

        fn pad_templates() -> &'static [gst::PadTemplate] {
            static TEMPLATES: std::sync::LazyLock<Vec<gst::PadTemplate>> =
                std::sync::LazyLock::new(|| {
                    let template = |name, direction, presence, caps: gst::Caps| {
                        gst::PadTemplate::new(name, direction, presence, &caps)
                            .expect("a name, a direction and caps make a template")
                    };
                    vec![$(template(
                        $pad,
                        gst::PadDirection::$direction,
                        gst::PadPresence::$presence,
                        $caps,
                    )),*]
                });
            &TEMPLATES
        }
    };
}
pub(crate) use registry;

/// A pad of a registered template.
pub fn pad(template: Option<gst::PadTemplate>) -> gst::PadBuilder<gst::Pad> {
    gst::Pad::builder_from_template(&template.expect("all templates are registered"))
}

/// Has queries and events of a pad go on by one other alone, or end: reports run in the other direction, and would have
/// them run in a circle.
pub fn linked(
    pad: gst::PadBuilder<gst::Pad>,
    other: Option<&'static str>,
) -> gst::PadBuilder<gst::Pad> {
    pad.iterate_internal_links_function(move |_, parent| {
        let element = parent.and_then(|parent| parent.downcast_ref::<gst::Element>());
        let other = element.zip(other).and_then(|(element, name)| element.static_pad(name));
        gst::Iterator::from_vec(other.into_iter().collect())
    })
}

/// A pad's function. A panic in it ends the pipeline.
macro_rules! guarded {
    ($class:ident, $failed:expr, |$this:ident, $pad:pat_param $(, $given:ident)*| $done:expr) => {
        |$pad, parent $(, $given)*| {
            let _environment = nvsprior::parts::FloatEnvironment::enter();
            $class::catch_panic_pad_function(parent, || $failed, |$this| $done)
        }
    };
}
pub(crate) use guarded;

/// Gives a new element its pads.
pub fn add_pads(element: &impl IsA<gst::Element>, pads: [&gst::Pad; 2]) {
    for pad in pads {
        element.add_pad(pad).expect("a new element has no pads yet");
    }
}

/// The running time at which a buffer came that went through a pad; `None`: it has no time.
pub fn running_time(pad: &gst::Pad, buffer: &gst::BufferRef) -> Option<f64> {
    let segment = pad.sticky_event::<gst::event::Segment>(0)?;
    let segment = segment.segment().downcast_ref::<gst::ClockTime>()?;
    Some(segment.to_running_time(buffer.dts_or_pts()?)?.seconds_f64())
}
