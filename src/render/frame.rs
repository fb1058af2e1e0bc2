//! The camera's frame on the device, and the search for its pose: everything between the upload of
//! the frame's bytes and the 8-bit pictures, as one recording.

use std::mem::offset_of;

use bytemuck::Zeroable;

use crate::Picture;
use crate::search::{Anchor, PoseCode, Program, Search};
use crate::shared::{GROUP, Groups};
use crate::vulkan::{Buffer, Device, Error, Memory, Recorder};

use super::light::{Correction, FlatField};
use super::radix::Fineness;
use super::splat::Channels;
use super::view::{Level, Part, View};
use super::workspace::Workspace;
use super::{Jacobian, Kernels, Scene, lists, splat};

/// Evaluations that one submission has room for. A frame that follows another takes six to eight; a
/// search that is not done then goes on in a second submission. Those left over cost their empty
/// dispatches.
pub(crate) const SLOTS: usize = 10;

/// A pose's code with what it is relative to, as stages `solve` and `place` share it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct Coded {
    pub anchor: Anchor,
    pub code: PoseCode,
}

/// 8-bit pictures of the size of level 0.
pub(crate) struct Bytes {
    pub render: Buffer,
    pub coded_asked: Buffer,
    pub coded: Buffer,
}

/// What a search needs beyond a [`View`].
pub(crate) struct Frame {
    pub bytes: Buffer,
    /// How the frame's light becomes the prior's: see [`FlatField`].
    pub light: Buffer,
    light_floats: Vec<f32>,
    pub difference: Buffer,
    pub search_asked: Buffer,
    pub search: Buffer,
    pub search_read: Buffer,
    pub coded_read: Buffer,
}

/// Words of a picture's bytes, up to whole groups of four pixels.
fn words(level: &Level) -> usize {
    level.camera.pixels().div_ceil(4) * 3
}

impl Bytes {
    pub fn new(device: &Device, view: &View) -> Result<Bytes, Error> {
        let words = view.levels.first().map_or(0, words);
        Ok(Bytes {
            render: Buffer::new::<u32>(device, "8-bit picture", words, Memory::Readback)?,
            coded_asked: Buffer::new::<Coded>(device, "pose code", 1, Memory::Upload)?,
            coded: Buffer::new::<Coded>(device, "pose code", 1, Memory::Device)?,
        })
    }
}

impl Frame {
    pub fn new(device: &Device, view: &View) -> Result<Frame, Error> {
        let words = view.levels.first().map_or(0, words);
        let camera = view.levels.first().map(|level| level.camera);
        let [width, height] = camera.map_or([0, 0], |c| [c.width, c.height].map(|v| v as usize));
        let field = FlatField::new(width, height);
        let light = Buffer::new::<f32>(device, "light", field.room(), Memory::Upload)?;
        let mut frame = Frame {
            light_floats: Vec::with_capacity(field.room()),
            light,
            bytes: Buffer::new::<u32>(device, "8-bit frame", words, Memory::Upload)?,
            difference: Buffer::new::<u32>(device, "difference", words, Memory::Readback)?,
            search_asked: Buffer::new::<Search>(device, "search", 1, Memory::Upload)?,
            search: Buffer::new::<Search>(device, "search", 1, Memory::Device)?,
            search_read: Buffer::new::<Search>(device, "search read back", 1, Memory::Readback)?,
            coded_read: Buffer::new::<Coded>(device, "pose code read back", 1, Memory::Readback)?,
        };
        frame.set_light(&Correction::NONE, &field);
        Ok(frame)
    }

    /// How the light of frames is corrected, and what of them counts.
    pub fn set_light(&mut self, correction: &Correction, field: &FlatField) {
        field.floats(correction, &mut self.light_floats);
        self.light.write(&self.light_floats);
    }

    /// Asks for a search.
    pub fn ask(&mut self, program: &Program) {
        self.search_asked.write(&[Search { program: *program, ..Search::zeroed() }]);
    }

    /// Takes the camera's picture, of the size of level 0.
    pub fn set(&mut self, frame: &Picture) {
        self.bytes.write(&frame.data);
    }
}

/// What all stages of a frame are recorded with.
pub(crate) struct Chain<'a> {
    pub kernels: &'a Kernels,
    pub scene: &'a Scene,
    pub view: &'a View,
    pub work: &'a Workspace,
    pub bytes: &'a Bytes,
    pub frame: &'a Frame,
    pub jacobian: Jacobian,
    pub fineness: Fineness,
}

impl Chain<'_> {
    /// A frame from its bytes on: pyramid, search, pictures.
    pub fn record_first(&self, r: &mut Recorder) -> Result<(), Error> {
        self.record_pyramid(r)?;
        r.copy(&self.frame.search_asked, &self.frame.search)?;
        r.copy(&self.bytes.coded_asked, &self.bytes.coded)?;
        self.record_solve(r, true)?;
        self.record_more(r)
    }

    /// Further evaluations of a search under way, and the pictures once it is done.
    pub fn record_more(&self, r: &mut Recorder) -> Result<(), Error> {
        for _ in 0..SLOTS {
            self.record_slot(r)?;
            r.mark("evaluation");
        }
        self.record_pictures(r)?;
        r.copy(&self.frame.search, &self.frame.search_read)?;
        r.copy(&self.bytes.coded, &self.frame.coded_read)?;
        r.copy(&self.work.counters, &self.work.counters_read)?;
        r.mark("pictures");
        Ok(())
    }

    /// The frame at every level.
    pub fn record_pyramid(&self, r: &mut Recorder) -> Result<(), Error> {
        let frame_width = self.view.levels[0].camera.width;
        for Level { camera, factor, params } in &self.view.levels {
            let pixels = camera.pixels() as u32;
            let scale = 1.0 / (255.0 * (factor * factor) as f32);
            let push =
                [frame_width, *factor, camera.width, pixels, params.frame_offset, scale.to_bits()];
            let buffers = [&self.frame.bytes, &self.view.frame, &self.frame.light];
            // Down the second axis too: 4096×4096 pixels are more workgroups than every device takes
            // along one.
            let groups = pixels.div_ceil(GROUP);
            let down = groups.div_ceil(GROUP);
            let groups = [groups.div_ceil(down), down, 1];
            r.dispatch(&self.kernels.pyramid, &buffers, &push, groups)?;
        }
        Ok(())
    }

    /// One evaluation of the normal equations, wherever the search stands, and what follows from it.
    fn record_slot(&self, r: &mut Recorder) -> Result<(), Error> {
        let Chain { kernels, scene, view, work, .. } = *self;
        let (jacobian, fineness) = (self.jacobian, self.fineness);
        splat::record_equations(r, kernels, scene, view, work, jacobian, fineness)?;
        self.record_solve(r, false)
    }

    fn record_solve(&self, r: &mut Recorder, first: bool) -> Result<(), Error> {
        let (view, work) = (self.view, self.work);
        let buffers = [
            &view.prototypes,
            &self.frame.search,
            &view.partials,
            &view.params,
            &view.groups,
            &work.counters,
            &self.bytes.coded,
        ];
        let (kernel, push) = (&self.kernels.solve, [first.into()]);
        if first {
            return r.dispatch(kernel, &buffers, &push, [1, 1, 1]);
        }
        let one = Part::First.at(offset_of!(Groups, one));
        r.dispatch_indirect(kernel, &buffers, &push, &view.groups, one)
    }

    /// The picture at the pose as its packet holds it, and the difference from the frame.
    fn record_pictures(&self, r: &mut Recorder) -> Result<(), Error> {
        let Chain { kernels, scene, view, work, bytes, frame, .. } = *self;
        let part = Part::Picture;
        record_place(r, kernels, view, bytes, part)?;
        record_picture(r, kernels, scene, view, work, Channels::Colour, part)?;
        record_bytes(r, kernels, view, bytes, part)?;
        record_difference(r, kernels, view, bytes, frame, part)
    }
}

/// The frame less the 8-bit picture.
pub(crate) fn record_difference(
    r: &mut Recorder,
    kernels: &Kernels,
    view: &View,
    bytes: &Bytes,
    frame: &Frame,
    part: Part,
) -> Result<(), Error> {
    let buffers = [&view.params, &frame.bytes, &bytes.render, &frame.difference];
    let quads = part.at(offset_of!(Groups, quads));
    r.dispatch_indirect(&kernels.difference, &buffers, &[], &view.groups, quads)
}

/// Puts the camera where the code says.
pub(crate) fn record_place(
    r: &mut Recorder,
    kernels: &Kernels,
    view: &View,
    bytes: &Bytes,
    part: Part,
) -> Result<(), Error> {
    let buffers = [&view.prototypes, &bytes.coded, &view.params];
    let one = part.at(offset_of!(Groups, one));
    r.dispatch_indirect(&kernels.place, &buffers, &[], &view.groups, one)
}

/// The picture.
pub(crate) fn record_picture(
    r: &mut Recorder,
    kernels: &Kernels,
    scene: &Scene,
    view: &View,
    work: &Workspace,
    channels: Channels,
    part: Part,
) -> Result<(), Error> {
    lists::record(r, kernels, scene, view, work, Fineness::Exact, part)?;
    splat::record(r, scene, view, work, channels, part)
}

/// The picture in 8 bits.
pub(crate) fn record_bytes(
    r: &mut Recorder,
    kernels: &Kernels,
    view: &View,
    bytes: &Bytes,
    part: Part,
) -> Result<(), Error> {
    let buffers = [&view.params, &view.image, &bytes.render];
    let quads = part.at(offset_of!(Groups, quads));
    r.dispatch_indirect(&kernels.finish, &buffers, &[], &view.groups, quads)
}

/// A linear value as a byte: clamped, rounded to nearest; a NaN gives 0. What stage `finish` does.
pub fn to_byte(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}
