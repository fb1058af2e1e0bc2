//! What elements tell each other of updates: custom events.
//!
//! Updates go downstream, in order with the packets. What becomes of them goes upstream.

use gst::glib;
use nvsprior::prior::{StateId, Update, UpdateError};

const UPDATE: &str = "nvsprior-update";
const HELD: &str = "nvsprior-update-held";
const REFUSED: &str = "nvsprior-update-refused";
const LINK: &str = "nvsprior-update-link";

/// Which update: its number, and the state after it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UpdateName {
    pub number: u16,
    pub state: StateId,
}

impl UpdateName {
    pub fn of(update: &Update) -> UpdateName {
        UpdateName { number: update.number, state: update.state() }
    }

    fn read(fields: &gst::StructureRef) -> Option<UpdateName> {
        let number = fields.get::<u32>("number").ok()?.try_into().ok()?;
        Some(UpdateName { number, state: StateId(fields.get("state").ok()?) })
    }

    fn fields(self, name: &str) -> gst::Structure {
        gst::Structure::builder(name)
            .field("number", u32::from(self.number))
            .field("state", self.state.0)
            .build()
    }
}

/// An update on its way.
#[derive(Clone, Debug, PartialEq)]
pub struct SentUpdate {
    pub name: UpdateName,
    /// As a file has it.
    pub bytes: glib::Bytes,
    /// The vehicle draws with it already, since both sides begin with it.
    pub held: bool,
}

impl SentUpdate {
    /// # Errors
    /// If the bytes are no update.
    pub fn new(bytes: Vec<u8>, held: bool) -> Result<SentUpdate, UpdateError> {
        let name = UpdateName::of(&Update::read(&bytes)?);
        Ok(SentUpdate { name, bytes: glib::Bytes::from_owned(bytes), held })
    }

    /// `None`: the event is another one.
    pub fn read(event: &gst::EventRef) -> Option<SentUpdate> {
        let fields = event.structure().filter(|fields| fields.name() == UPDATE)?;
        let name = UpdateName::read(fields)?;
        let (bytes, held) = (fields.get("update").ok()?, fields.get("held").ok()?);
        Some(SentUpdate { name, bytes, held })
    }

    pub fn event(&self) -> gst::Event {
        let mut fields = self.name.fields(UPDATE);
        fields.set("update", &self.bytes);
        fields.set("held", self.held);
        gst::event::CustomDownstream::new(fields)
    }
}

/// What is told upstream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Answer {
    /// The topside holds an update. `over_link`: as far as its payloader knows; else its decoder says so itself.
    Held { name: UpdateName, over_link: bool },
    /// An update cannot be sent.
    Refused(UpdateName),
    /// The part of the bit rate that updates take now, and the bytes of pictures that a byte of an update costs.
    Link { share: f64, price: f64 },
}

impl Answer {
    /// `None`: the event is another one.
    pub fn read(event: &gst::EventRef) -> Option<Answer> {
        let fields = event.structure()?;
        match fields.name().as_str() {
            HELD => {
                let over_link = fields.get("over-link").ok()?;
                Some(Answer::Held { name: UpdateName::read(fields)?, over_link })
            }
            REFUSED => Some(Answer::Refused(UpdateName::read(fields)?)),
            LINK => {
                let (share, price) = (fields.get("share").ok()?, fields.get("price").ok()?);
                Some(Answer::Link { share, price })
            }
            _ => None,
        }
    }

    pub fn event(&self) -> gst::Event {
        let fields = match *self {
            Answer::Held { name, over_link } => {
                let mut fields = name.fields(HELD);
                fields.set("over-link", over_link);
                fields
            }
            Answer::Refused(name) => name.fields(REFUSED),
            Answer::Link { share, price } => {
                gst::Structure::builder(LINK).field("share", share).field("price", price).build()
            }
        };
        gst::event::CustomUpstream::new(fields)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAME: UpdateName = UpdateName { number: 300, state: StateId(0xFEDC_BA98) };

    #[test]
    fn what_is_told_comes_as_it_was() {
        gst::init().unwrap();
        let update =
            SentUpdate { name: NAME, bytes: glib::Bytes::from_static(b"nvsu..."), held: true };
        assert_eq!(SentUpdate::read(&update.event()), Some(update.clone()));
        assert!(update.event().is_serialized() && update.event().is_downstream());
        for answer in [
            Answer::Held { name: NAME, over_link: true },
            Answer::Held { name: NAME, over_link: false },
            Answer::Refused(NAME),
            Answer::Link { share: 0.25, price: 1.5 },
        ] {
            assert_eq!(Answer::read(&answer.event()), Some(answer));
            assert!(answer.event().is_upstream());
            assert_eq!(SentUpdate::read(&answer.event()), None);
        }
        assert_eq!(Answer::read(&update.event()), None);
    }

    #[test]
    fn events_of_others_are_others() {
        gst::init().unwrap();
        let custom = |fields| gst::event::CustomDownstream::new(fields);
        for fields in [
            gst::Structure::new_empty("other"),
            gst::Structure::new_empty(UPDATE),
            gst::Structure::builder(UPDATE)
                .field("number", 70_000_u32)
                .field("state", 1_u32)
                .build(),
            gst::Structure::builder(HELD).field("number", "one").build(),
            gst::Structure::builder(LINK).field("share", 1_u32).build(),
        ] {
            let event = custom(fields);
            assert_eq!((SentUpdate::read(&event), Answer::read(&event)), (None, None));
        }
        assert_eq!(SentUpdate::read(&gst::event::Eos::new()), None);
        assert!(SentUpdate::new(vec![1, 2, 3], false).is_err());
    }
}
