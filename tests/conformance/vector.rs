//! A vector, as it lies in `tests/vectors/`.

use std::ops::Range;

use nvsprior::{Camera, Trust};
use nvsprior_link::keys::{Key, Keys};
use nvsprior_link::modem::CollectorOptions;
use serde_json::{Value, json};

use crate::results::{Outcome, hex, md5};

/// What a vector's records are.
#[derive(Clone)]
pub enum Kind {
    /// For one decoder, in order.
    Packets {
        trust: Trust,
    },
    /// Modem frames, for one collector; what they yield is then decoded.
    Link {
        options: CollectorOptions,
        mtu: usize,
    },
    Reports,
    /// Files of priors.
    Priors,
}

/// The keys that a vector's records are checked by.
#[derive(Clone)]
pub struct VectorKeys {
    pub keys: Vec<[u8; 32]>,
    pub tag_bytes: usize,
    pub epoch: u64,
}

impl VectorKeys {
    pub fn keys(&self) -> Keys {
        let keys = Keys::new(self.keys.iter().map(|key| Key::new(*key))).unwrap();
        keys.with_tag_bytes(self.tag_bytes).unwrap().with_epoch(self.epoch)
    }
}

/// One vector.
pub struct Vector {
    pub name: String,
    pub description: &'static str,
    /// File of the prior.
    pub prior: &'static str,
    pub kind: Kind,
    /// Cameras that the decoder knows from the start.
    pub cameras: Vec<Camera>,
    /// Of a link: the frame numbers that may come out.
    pub frames: Range<u32>,
    pub keys: Option<VectorKeys>,
    pub records: Vec<Vec<u8>>,
}

impl Vector {
    pub fn packets(name: &str, description: &'static str, records: Vec<Vec<u8>>) -> Vector {
        Vector {
            name: name.to_owned(),
            description,
            prior: "prior.ply",
            kind: Kind::Packets { trust: Trust::Whole },
            cameras: Vec::new(),
            frames: 0..0,
            keys: None,
            records,
        }
    }

    /// The file: each record behind its length.
    pub fn file(&self) -> Vec<u8> {
        let record = |record: &Vec<u8>| [&(record.len() as u32).to_le_bytes()[..], record].concat();
        self.records.iter().flat_map(record).collect()
    }

    /// The entry of the manifest.
    pub fn entry(&self, outcome: &Outcome) -> Value {
        let pictures: Vec<&[u8]> = outcome.pictures.iter().map(Vec::as_slice).collect();
        let file = format!("{}.bin", self.name);
        let mut entry = json!({
            "name": self.name, "description": self.description, "source": file,
            "source_checksum": md5(&[&self.file()]), "input_file": file,
            "output_format": "rgb24", "result": md5(&pictures), "prior": self.prior,
            "records": outcome.records,
        });
        let kind = match &self.kind {
            Kind::Packets { trust: Trust::Whole } => "packets",
            Kind::Packets { trust: Trust::Start } => "starts",
            Kind::Link { options, mtu } => {
                entry["mtu"] = json!(mtu);
                entry["streams"] = json!(options.streams);
                entry["room"] = json!(options.shares);
                entry["packets"] = json!(outcome.packets);
                "link"
            }
            Kind::Reports => "reports",
            Kind::Priors => "priors",
        };
        entry["kind"] = json!(kind);
        if !self.cameras.is_empty() {
            let camera = |c: &Camera| json!([c.width, c.height, c.fx, c.fy, c.cx, c.cy]);
            entry["cameras"] = self.cameras.iter().map(camera).collect();
        }
        if let Some(VectorKeys { keys, tag_bytes, epoch }) = &self.keys {
            entry["keys"] = keys.iter().map(|key| hex(key)).collect();
            entry["tag"] = json!(tag_bytes);
            // Numbers of JSON have 53 bits.
            entry["epoch"] = json!(epoch.to_string());
        }
        entry
    }
}
