//! The places.

use nvsprior::Pose;

use super::scene::Scene;
use super::trajectory::{self, tower::Course};
use super::{basin, quay, tower};

/// A place with a mapping run and inspection runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Site {
    /// An indoor basin with a structure of oil barrels.
    Basin,
    /// A harbour's wall of sheet piles, in green water.
    Quay,
    /// Three structures of oil barrels in a long basin.
    Row,
    /// A steel lattice tower in black water, in the light of the vehicle's own lamps.
    Tower,
}

impl Site {
    pub const ALL: [Site; 4] = [Site::Basin, Site::Quay, Site::Row, Site::Tower];

    pub fn mapping_run_name(self) -> &'static str {
        match self {
            Site::Basin => "M1",
            Site::Quay => "M2",
            Site::Row => "M3",
            Site::Tower => "M4",
        }
    }

    /// Whether the vehicle brings its own light. Such a site has a choice of rig and course.
    pub fn has_lamps(self) -> bool {
        self == Site::Tower
    }

    pub(crate) fn mapped(self) -> Scene {
        match self {
            Site::Basin => basin::mapped(),
            Site::Quay => quay::mapped(),
            Site::Row => basin::row(),
            Site::Tower => tower::mapped(),
        }
    }

    /// Of the whole mapping run; at the tower, of the rig's first camera.
    pub(crate) fn mapping_poses(self) -> Vec<Pose> {
        match self {
            Site::Basin => trajectory::basin::mapping_poses(),
            Site::Quay => trajectory::quay::mapping_poses(),
            Site::Row => trajectory::basin::row_mapping_poses(),
            Site::Tower => Course::Both.poses(),
        }
    }
}
