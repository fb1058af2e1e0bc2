//! What the ends of a link tell.

use std::collections::VecDeque;

use nvsprior_link::{MAX_STATE, Region, TopsideEvent, VehicleEvent};

use super::status::*;
use super::structs::{number, versioned, zeroed};

/// The other end is heard for the first time, or again.
pub const NVSP_EVENT_HEARD: u32 = 1;
/// Nothing of the other end has come for `value` seconds. A vehicle sends all the same.
pub const NVSP_EVENT_SILENT: u32 = 2;
/// `value` things came that are not of the other end, and nothing of it: both ends need the same MTU, keys and epoch.
pub const NVSP_EVENT_STRANGERS: u32 = 3;
/// Store `data` before more goes: with it as `state` in its options an end goes on after a restart. An end tells it at
/// its beginning, and then rarely.
pub const NVSP_EVENT_STORE: u32 = 4;
/// User bytes came: `data`. A topside tells of which frame: `frame`.
pub const NVSP_EVENT_USER: u32 = 5;
/// Of a vehicle: a frame was coded and is on its way, or it failed: `frame`, `status`, and if that is NVSP_OK `bytes`,
/// `certain` and `value`, its PSNR in dB.
pub const NVSP_EVENT_FRAME: u32 = 6;
/// Of a vehicle: the topside asks for prior and camera. The next packet of its encoder states them; without an encoder
/// do it yourself (nvsp_encoder_announce).
pub const NVSP_EVENT_ASKED: u32 = 7;
/// Of a vehicle: the pilot's region of interest is another one: `region` and `weight`; a weight of 0: there is none.
pub const NVSP_EVENT_REGION: u32 = 8;
/// Of a vehicle: frames come too slowly, or as they should again: it plans for `value` per second from here on.
pub const NVSP_EVENT_FRAME_RATE: u32 = 9;
/// Of a topside: packets that come cannot be shown, and `status` says why; NVSP_OK: they can again.
pub const NVSP_EVENT_REFUSED: u32 = 10;

/// Most bytes of nvsp_event.data.
pub const NVSP_MAX_DATA: usize = 264;
const _: () = assert!(NVSP_MAX_DATA >= MAX_STATE && NVSP_MAX_DATA > 255);

/// What an end tells. The comment of its kind names the fields that it sets; the others are zero.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_event {
    pub struct_size: u32,
    pub abi_version: u32,
    /// NVSP_EVENT_*.
    pub kind: u32,
    /// Number of the frame.
    pub frame: u32,
    /// A number: see the kind.
    pub value: f64,
    /// NVSP_OK, or why a frame failed.
    pub status: nvsp_status,
    /// Bytes of the frame's packet.
    pub bytes: u32,
    /// 1: the picture confirms the frame's pose; else 0.
    pub certain: u32,
    /// How much more an error in the region counts.
    pub weight: u32,
    /// Left, top, right and bottom of the region, as parts of the picture, 0 to 1.
    pub region: [f32; 4],
    /// Bytes of `data`.
    pub data_size: u32,
    /// Zero.
    pub reserved: u32,
    /// User bytes, or a state.
    pub data: [u8; NVSP_MAX_DATA],
}
versioned!(nvsp_event, 328);

impl nvsp_event {
    pub(super) fn of(kind: u32) -> nvsp_event {
        nvsp_event { kind, ..zeroed() }
    }

    pub(super) fn with(mut self, data: &[u8]) -> nvsp_event {
        let data = &data[..data.len().min(NVSP_MAX_DATA)];
        self.data[..data.len()].copy_from_slice(data);
        self.data_size = number(data.len());
        self
    }

    fn valued(kind: u32, value: f64) -> nvsp_event {
        nvsp_event { value, ..nvsp_event::of(kind) }
    }

    /// A region; `None`: there is none.
    fn region(region: Option<Region>) -> nvsp_event {
        let mut event = nvsp_event::of(NVSP_EVENT_REGION);
        if let Some(region) = region {
            event.region = region.edges.map(|edge| f32::from(edge) / 255.0);
            event.weight = region.weight.into();
        }
        event
    }
}

impl From<VehicleEvent> for nvsp_event {
    fn from(event: VehicleEvent) -> nvsp_event {
        match event {
            VehicleEvent::TopsideHeard => nvsp_event::of(NVSP_EVENT_HEARD),
            VehicleEvent::TopsideSilent(seconds) => nvsp_event::valued(NVSP_EVENT_SILENT, seconds),
            VehicleEvent::Strangers(count) => {
                nvsp_event::valued(NVSP_EVENT_STRANGERS, count as f64)
            }
            VehicleEvent::Asked => nvsp_event::of(NVSP_EVENT_ASKED),
            VehicleEvent::Region(region) => nvsp_event::region(region),
            VehicleEvent::User => nvsp_event::of(NVSP_EVENT_USER),
            VehicleEvent::FrameRate(rate) => nvsp_event::valued(NVSP_EVENT_FRAME_RATE, rate),
            VehicleEvent::Store => nvsp_event::of(NVSP_EVENT_STORE),
        }
    }
}

impl From<TopsideEvent> for nvsp_event {
    fn from(event: TopsideEvent) -> nvsp_event {
        match event {
            TopsideEvent::VehicleHeard => nvsp_event::of(NVSP_EVENT_HEARD),
            TopsideEvent::VehicleSilent(seconds) => nvsp_event::valued(NVSP_EVENT_SILENT, seconds),
            TopsideEvent::Strangers(count) => {
                nvsp_event::valued(NVSP_EVENT_STRANGERS, count as f64)
            }
            TopsideEvent::Store => nvsp_event::of(NVSP_EVENT_STORE),
        }
    }
}

/// Events that wait, in memory that is taken once. If nobody takes them, the first ones go.
pub(super) struct Waiting(VecDeque<nvsp_event>);

const ROOM: usize = 16;

impl Waiting {
    pub(super) fn new() -> Waiting {
        Waiting(VecDeque::with_capacity(ROOM))
    }

    pub(super) fn tell(&mut self, event: nvsp_event) {
        if self.0.len() == ROOM {
            self.0.pop_front();
        }
        self.0.push_back(event);
    }

    pub(super) fn take(&mut self) -> Option<nvsp_event> {
        self.0.pop_front()
    }
}
