//! The inspection runs, and the dives of a run.

use nvsprior::Pose;

use super::scene::Scene;
use super::trajectory::basin::{Track, inspection_pose, row_pose};
use super::trajectory::{FRAME_RATE, quay as quay_track, tower as tower_track};
use super::{Rig, Site, ageing, basin, quay, tower};

/// The inspection runs, some time after the mapping run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Run {
    /// The basin as mapped.
    T1,
    /// With a new metallic object beside the structure and the vehicle's safety line in view.
    T2,
    /// The quay on another day: other light, more silt, and after some frames a crab pot with its buoy.
    T3,
    /// The basin weeks later: some growth, a brace gone, a chain in its place, another day's light.
    T4,
    /// The basin months later: much growth, the chain still there, a pipe that has come off, other light again.
    T5,
    /// The row as mapped, along its side.
    T6,
    /// The tower as mapped, back from it and along its face.
    T7,
}

/// The run of a name.
impl std::str::FromStr for Run {
    type Err = String;

    fn from_str(name: &str) -> Result<Run, String> {
        let named = Run::ALL.into_iter().find(|run| run.name() == name);
        named.ok_or_else(|| {
            format!("no such run; there are: {}", Run::ALL.map(Run::name).join(", "))
        })
    }
}

impl Run {
    pub const ALL: [Run; 7] = [Run::T1, Run::T2, Run::T3, Run::T4, Run::T5, Run::T6, Run::T7];

    pub fn name(self) -> &'static str {
        match self {
            Run::T1 => "T1",
            Run::T2 => "T2",
            Run::T3 => "T3",
            Run::T4 => "T4",
            Run::T5 => "T5",
            Run::T6 => "T6",
            Run::T7 => "T7",
        }
    }

    pub fn site(self) -> Site {
        match self {
            Run::T1 | Run::T2 | Run::T4 | Run::T5 => Site::Basin,
            Run::T3 => Site::Quay,
            Run::T6 => Site::Row,
            Run::T7 => Site::Tower,
        }
    }

    /// Weeks since the mapping run. 0: the run's scene does not age.
    pub fn weeks(self) -> f32 {
        match self {
            Run::T1 | Run::T2 | Run::T3 | Run::T6 | Run::T7 => 0.0,
            Run::T4 => 4.0,
            Run::T5 => 26.0,
        }
    }

    /// Tells the runs' noise apart.
    fn tag(self) -> u32 {
        match self {
            Run::T1 => 1,
            Run::T2 => 2,
            Run::T3 => 5,
            Run::T4 => 6,
            Run::T5 => 7,
            Run::T6 => 11,
            Run::T7 => 13,
        }
    }
}

/// A dive: a run, once. Dives of a run see the same scene, from tracks of their own and in other moments of the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dive {
    pub run: Run,
    /// Weeks since the mapping run. Only the scenes of T4 and T5 age.
    pub weeks: f32,
    /// From 1.
    pub number: u8,
    /// Frames per second.
    pub rate: f64,
    /// Of the vehicle at the tower.
    pub rig: Rig,
}

impl Dive {
    /// The first dive of a run, at the run's own age.
    pub fn of(run: Run) -> Dive {
        Dive { run, weeks: run.weeks(), number: 1, rate: FRAME_RATE, rig: Rig::default() }
    }

    /// What stands there, without the safety line.
    pub(crate) fn scene(&self) -> Scene {
        match self.run {
            Run::T1 => basin::mapped(),
            Run::T2 => basin::with_new_object(),
            Run::T3 => quay::later(),
            Run::T4 | Run::T5 => ageing::basin_after(self.weeks),
            Run::T6 => basin::row(),
            Run::T7 => tower::mapped(),
        }
    }

    /// Tells the dives' noise apart, and their moments of the light.
    pub(crate) fn tag(&self) -> u32 {
        self.run.tag() + 16 * self.earlier()
    }

    /// Where the camera is, `time` seconds into the dive. At the tower: the rig's first one.
    pub(crate) fn pose(&self, time: f64) -> Pose {
        let earlier = self.earlier();
        let on = |track: Track| inspection_pose(&track.after(earlier), time);
        match self.run {
            Run::T1 => on(Track::T1),
            Run::T2 => on(Track::T2),
            Run::T3 => quay_track::inspection_pose(earlier, time),
            Run::T4 => on(Track::T4),
            Run::T5 => on(Track::T5),
            Run::T6 => row_pose(earlier, time),
            Run::T7 => tower_track::inspection_pose(earlier, time),
        }
    }

    /// How many dives of the run came before.
    fn earlier(&self) -> u32 {
        u32::from(self.number.saturating_sub(1))
    }
}
