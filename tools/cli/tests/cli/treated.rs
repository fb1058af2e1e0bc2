//! Dives whose prior states a preprocessing, and such whose pictures were treated by hand.

use nvsprior::image::{Clahe, Preprocessing, Preprocessor, WhiteBalance};
use nvsprior::{Picture, Prior};

use crate::dive::{Dive, name, pictures, save};
use crate::scene::{wall, write_prior};

pub fn preprocessing() -> Preprocessing {
    let clahe = Some(Clahe::new(3.0, Clahe::TILES).unwrap());
    Preprocessing { white_balance: WhiteBalance::GrayWorld, clahe }
}

pub fn treated(picture: &Picture) -> Picture {
    let mut treated = picture.clone();
    Preprocessor::new(&preprocessing()).apply(&mut treated);
    treated
}

/// A dive whose prior states the preprocessing.
pub fn preprocessed() -> Dive {
    let dive = Dive::new();
    write_prior(&dive.path("prior.ply"), &wall(1).with_preprocessing(preprocessing()));
    dive
}

/// A dive whose pictures on disk are treated, and whose prior says nothing.
pub fn treated_by_hand() -> Dive {
    let dive = Dive::new();
    for (t, picture) in pictures().iter().enumerate() {
        save(&treated(picture), &dive.path(&name(t)));
    }
    dive
}

pub fn open(dive: &Dive, name: &str) -> Prior {
    Prior::open(&dive.path(name), &Default::default()).unwrap()
}
