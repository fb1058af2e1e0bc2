//! What an encoder's handle holds: an encoder and its frames, on the caller's thread or on threads of its own.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use nvsprior::geometry::Lens;
use nvsprior::image::{Converter, ImageView, Mask};
use nvsprior::parts::{Coder, FrameWork};
use nvsprior::parts::{Interrupt, Lost, Queue, Worker};
use nvsprior::{Camera, Encoded, Encoder, Error, vulkan};
use nvsprior_link::keys::Authenticator;

use super::dmabuf::Readings;
use super::frame::{Known, refused};
use super::handle::{Content, Handle, locked};
use super::limits::Limits;
use super::memory::Grant;
use super::status::*;
use super::thread::{ThreadStart, spawner};

/// Encodes the frames of one camera, in order. Example, which never waits for a frame:
///
/// ```c
/// if (nvsp_encode_begin(encoder, &image, &info) != NVSP_OK) return;
/// while (nvsp_wait(encoder, 0) == NVSP_PENDING) steer();
/// status = nvsp_encode_finish(encoder, packet, sizeof packet, &bytes, &stats);
/// ```
pub type nvsp_encoder = Handle<Encoding>;

/// What the frames of an encoder share.
pub(super) struct Core {
    pub encoder: Encoder,
    pub converter: Arc<Mutex<Converter>>,
    /// What the converter and the encoder's mask are made of.
    pub optics: Optics,
    pub limits: Limits,
    /// Frames that still take memory, and how many do after the encoder itself took some.
    cold: usize,
    most_cold: usize,
}

/// A frame, as a caller hands it over.
pub(super) struct GivenFrame<'a> {
    pub image: ImageView<'a>,
    /// Keeps the planes readable that lie in DMA-BUFs.
    pub _readings: Readings,
    pub known: Known,
}

/// An encoder with its frames under way: one, or two.
pub(super) struct Encoding {
    core: Arc<Mutex<Core>>,
    converter: Arc<Mutex<Converter>>,
    queue: Queue<FrameWork, Failure>,
    interrupt: Interrupt,
    /// What makes the tags of packets; `None`: they get none.
    authenticator: Option<Authenticator>,
    /// Packets that told the camera.
    lost: Lost,
    /// Whether two frames may be under way.
    two: bool,
    /// The frame finished last.
    last: Encoded,
    /// Whether there is one.
    full: bool,
    /// A vehicle's: its frames come by the vehicle alone.
    pub is_vehicles: bool,
}

impl Encoding {
    /// `two`: a thread searches for a frame's pose while another codes the frame before. `start` is for the threads.
    pub(super) fn new(
        encoder: Encoder,
        converter: Converter,
        limits: Limits,
        two: bool,
        authenticator: Option<Authenticator>,
        start: ThreadStart,
    ) -> Encoding {
        let camera = *encoder.camera();
        let slots = if two { 2 } else { 1 };
        // There is one result more than there are slots: that of the frame finished last.
        let cold = slots + 1;
        let converter = Arc::new(Mutex::new(converter));
        let optics = Optics::default();
        let interrupt = encoder.interrupt().clone();
        let (own, most_cold) = (converter.clone(), cold);
        let core = Core { encoder, converter: own, optics, limits, cold, most_cold };
        let core = Arc::new(Mutex::new(core));
        let lost = Lost::default();
        let workers = match two {
            true => search_and_code(&core, &lost, limits, cold),
            false => vec![encode(&core, &lost)],
        };
        let (width, height) = (camera.width, camera.height);
        let room = || FrameWork::with_room(width, height);
        let works = std::iter::repeat_with(room).take(slots).collect();
        let spawn = spawner([c"nvsp-encoder", c"nvsp-coder"], start);
        let queue = Queue::new(workers, works, lost.clone(), spawn);
        Encoding {
            core,
            converter,
            queue,
            interrupt,
            authenticator,
            lost,
            two,
            last: Encoded::with_room(width, height),
            full: false,
            is_vehicles: false,
        }
    }

    /// What the next frame is encoded by. Fails while a frame is searched for. With one frame at a time it fails from
    /// the beginning of a frame until that is finished or cancelled.
    pub(super) fn core(&self) -> Result<MutexGuard<'_, Core>, Failure> {
        match self.two {
            true => self.queue.check_first_worker()?,
            false => self.queue.check_idle()?,
        }
        // What was cancelled has ended its search.
        self.interrupt.clear();
        let mut core = locked(&self.core)?;
        core.announce_if(&self.lost);
        Ok(core)
    }

    /// Reads a frame on this thread. Others then encode it.
    pub(super) fn begin(&mut self, given: &GivenFrame) -> Result<(), Failure> {
        self.check_known(&given.known)?;
        let converter = &self.converter;
        self.queue.begin(|work| given.fill(converter, work))
    }

    /// Encodes a frame on this thread.
    pub(super) fn run(&mut self, given: &GivenFrame) -> Result<(), Failure> {
        self.queue.check_idle()?;
        self.check_known(&given.known)?;
        let converter = &self.converter;
        self.queue.run(|work| given.fill(converter, work))
    }

    /// Checks what is known of a frame. While another is searched for, what depends on that one is left to the search.
    fn check_known(&self, known: &Known) -> Result<(), Failure> {
        let checked = match self.core() {
            Ok(core) => core.encoder.check_info(&known.frame),
            Err(_) => known.frame.check(0, None),
        };
        checked.map_err(refused)
    }

    /// Refuses calls that a vehicle makes itself.
    pub(super) fn check_own(&self) -> Result<(), Failure> {
        let what = "the encoder is a vehicle's: give that the frames";
        if self.is_vehicles { Err(Failure::at(NVSP_ERR_STATE, what)) } else { Ok(()) }
    }

    /// Frames that may be under way.
    pub(super) fn room(&self) -> usize {
        if self.two { 2 } else { 1 }
    }

    /// Drops all that is under way; whether it has ended.
    pub(super) fn drop_all(&mut self) -> bool {
        let ended = self.queue.cancel();
        if !ended {
            // A search that is under way ends.
            self.interrupt.set();
        }
        ended
    }

    /// Bytes of a packet that its number and its tag take.
    pub(super) fn overhead(&self) -> usize {
        self.authenticator.as_ref().map_or(0, Authenticator::overhead)
    }

    /// Takes the first result: the frame's error, or what `fetch` makes of it. If `fetch` fails, the result stays.
    pub(super) fn take(
        &mut self,
        fetch: impl FnOnce(&Encoded, Option<&mut Authenticator>) -> Result<(), Failure>,
    ) -> Result<nvsp_status, Failure> {
        let overhead = self.overhead();
        let (last, full) = (&mut self.last, &mut self.full);
        let taken = self.queue.take(|work| {
            fetch(&work.encoded, self.authenticator.as_mut())?;
            std::mem::swap(last, &mut work.encoded);
            *full = true;
            Ok(())
        });
        match taken {
            // As the caller counts, to whom the tag is a part of the packet.
            Err(Failure::Library(Error::Budget { budget, needed })) => {
                let (budget, needed) = (budget + overhead, needed + overhead);
                Err(Error::Budget { budget, needed }.into())
            }
            taken => Ok(done_or_pending(taken?)),
        }
    }

    /// The frame finished last.
    pub(super) fn last(&self) -> Result<&Encoded, Failure> {
        if !self.two {
            self.queue.check_idle()?;
        }
        self.full.then_some(&self.last).ok_or(Failure::at(NVSP_ERR_STATE, "no frame was encoded"))
    }
}

impl Content for Encoding {
    fn wait(&mut self, timeout: Duration) -> Result<nvsp_status, Failure> {
        Ok(done_or_pending(self.queue.wait(timeout)?))
    }

    fn cancel(&mut self) -> Result<nvsp_status, Failure> {
        self.check_own()?;
        Ok(done_or_pending(self.drop_all()))
    }
}

impl GivenFrame<'_> {
    /// Converts the image to a slot, and hands over what is known of it.
    fn fill(&self, converter: &Mutex<Converter>, work: &mut FrameWork) -> Result<(), Failure> {
        let mut converter = converter.lock().unwrap_or_else(PoisonError::into_inner);
        converter.convert(&self.image, &mut work.frame)?;
        (work.info, work.left_out) = (self.known.frame, self.known.left_out);
        Ok(())
    }
}

/// The worker that does all of a frame.
fn encode(core: &Arc<Mutex<Core>>, lost: &Lost) -> Worker<FrameWork, Failure> {
    let (core, lost) = (core.clone(), lost.clone());
    Box::new(move |work| {
        let mut core = locked(&core)?;
        core.announce_if(&lost);
        let _memory = core.memory()?;
        core.encoder.check_info(&work.info).map_err(refused)?;
        core.number(work, Encoder::encode_filled)?;
        core.cold = core.cold.saturating_sub(1);
        Ok(())
    })
}

/// The workers of an encoder with two frames under way.
fn search_and_code(
    core: &Arc<Mutex<Core>>,
    lost: &Lost,
    limits: Limits,
    most_cold: usize,
) -> Vec<Worker<FrameWork, Failure>> {
    let (core, lost, noted) = (core.clone(), lost.clone(), lost.clone());
    let search = move |work: &mut FrameWork| {
        let mut core = locked(&core)?;
        core.announce_if(&lost);
        let _memory = core.memory()?;
        core.encoder.check_info(&work.info).map_err(refused)?;
        core.number(work, Encoder::track_filled)?;
        core.cold = core.cold.saturating_sub(1);
        Ok(())
    };
    let (mut coder, mut cold) = (Coder::default(), 0);
    let code = move |work: &mut FrameWork| {
        cold = if coder.changes(work) { most_cold } else { cold };
        let size = (work.frame.width, work.frame.height);
        let coded = (cold > 0).then(|| limits.coder(size)).transpose().and_then(|_memory| {
            coder.code(work)?;
            cold = cold.saturating_sub(1);
            Ok(())
        });
        coded.inspect_err(|_| noted.note(work.states_session))
    };
    vec![Box::new(search), Box::new(code)]
}

impl Core {
    /// Has the next packet tell what lost ones told, if there were any.
    fn announce_if(&mut self, lost: &Lost) {
        if lost.take() {
            self.encoder.announce();
        }
    }

    /// Does a frame's work by the number that it has with the frames left out before it.
    fn number(
        &mut self,
        work: &mut FrameWork,
        encode: impl FnOnce(&mut Encoder, &mut FrameWork) -> Result<(), Error>,
    ) -> Result<(), Error> {
        self.encoder.skip(work.left_out);
        let done = encode(&mut self.encoder, work);
        match done {
            Ok(()) => {}
            // The number of a frame that was cancelled is used up.
            Err(Error::Vulkan(vulkan::Error::Interrupted)) => self.encoder.skip(1),
            // Another frame that fails is none.
            Err(_) => self.encoder.skip(work.left_out.wrapping_neg()),
        }
        done
    }

    /// Sets memory aside for the next call, unless all that it takes is there.
    pub(super) fn memory(&self) -> Result<Option<Grant>, Failure> {
        let camera = self.encoder.camera();
        (self.cold > 0).then(|| self.limits.encoder(camera)).transpose()
    }

    /// The next frames take memory again.
    pub(super) fn chill(&mut self) {
        self.cold = self.most_cold;
    }

    /// Changes what images are seen through. If it fails, nothing changes.
    pub(super) fn see(&mut self, change: impl FnOnce(&mut Optics)) -> Result<(), Failure> {
        let mut optics = self.optics.clone();
        change(&mut optics);
        let camera = *self.encoder.camera();
        self.look(optics, camera)
    }

    /// Sets camera and what images are seen through. If it fails, nothing changes.
    pub(super) fn look(&mut self, optics: Optics, camera: Camera) -> Result<(), Failure> {
        let same_camera = camera == *self.encoder.camera();
        let _memory = self.limits.seen(&camera, optics.bytes(&camera), same_camera)?;
        let (converter, mask) = optics.through(&camera)?;
        self.encoder.set_view(&camera, mask)?;
        if !same_camera {
            self.chill();
        }
        self.optics = optics;
        *self.converter.lock().unwrap_or_else(PoisonError::into_inner) = converter;
        Ok(())
    }
}

/// What an encoder's images are seen through.
#[derive(Clone, Default)]
pub(super) struct Optics {
    pub lens: Option<Lens>,
    /// Of the lens's size; without one, of the camera's shape.
    pub mask: Option<Arc<Mask>>,
}

/// Bytes of a pixel of the lens's images, and of one of the camera's, that a converter and a mask take at most.
const LENS_PIXEL: u64 = 4;
const CAMERA_PIXEL: u64 = 48;
/// Bytes of the rows and columns of both.
const SIDES: u64 = 256;

impl Optics {
    /// What makes the encoder's pictures, and which of their pixels count.
    pub fn through(&self, camera: &Camera) -> Result<(Converter, Option<Mask>), Failure> {
        let Some(lens) = &self.lens else {
            let converter = Converter::new(camera.width, camera.height)?;
            let mask = self.mask.as_ref().map(|mask| shaped(mask, camera)).transpose()?;
            return Ok((converter, mask));
        };
        let converter = Converter::undistorting(lens, camera).map_err(Error::from)?;
        let mask = match &self.mask {
            Some(mask) if (mask.width, mask.height) != lens.size() => {
                let what = "nvsp_mask.width, height: not those of the lens";
                return Err(Failure::argument(what));
            }
            Some(mask) => Some(mask.undistorted(lens, camera).map_err(Error::from)?),
            None => converter.covered().cloned(),
        };
        Ok((converter, mask))
    }

    /// Host memory that [`Optics::through`] takes at most, and what it keeps; bytes.
    pub fn bytes(&self, camera: &Camera) -> u64 {
        let area = |(width, height): (u32, u32)| u64::from(width) * u64::from(height);
        let own = |(width, height): (u32, u32)| {
            LENS_PIXEL * area((width, height)) + SIDES * (u64::from(width) + u64::from(height))
        };
        let size = (camera.width, camera.height);
        let mask = self.mask.as_ref().map_or(0, |mask| area((mask.width, mask.height)));
        match &self.lens {
            Some(lens) => own(lens.size()) + CAMERA_PIXEL * area(size) + own(size) + mask,
            None if mask > 0 => CAMERA_PIXEL * area(size) + mask,
            None => 0,
        }
    }
}

/// A mask of the camera's shape at the camera's size.
fn shaped(mask: &Mask, camera: &Camera) -> Result<Mask, Failure> {
    let wide = u64::from(mask.width) * u64::from(camera.height);
    let high = u64::from(mask.height) * u64::from(camera.width);
    if wide.abs_diff(high) * 100 > high {
        return Err(Failure::argument("nvsp_mask.width, height: not of the camera's shape"));
    }
    Ok(mask.resized(camera.width, camera.height))
}
