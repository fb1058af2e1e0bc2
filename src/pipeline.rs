//! Encoding in two halves at once: while the host codes the difference picture of one frame, the device searches for
//! the pose of the next.

use std::thread::JoinHandle;
use std::time::Duration;

use crate::frame_work::{Coder, FrameWork};
use crate::queue::{Body, Lost, Queue};
use crate::{Encoded, Encoder, Error, FrameInfo, Picture};

/// An [`Encoder`] that yields each packet one call later, but more packets per second: a frame takes
/// the longer of its two halves, not their sum. Packets are the same, byte for byte.
pub struct Pipeline {
    encoder: Encoder,
    queue: Queue<FrameWork, Error>,
    under_way: bool,
    /// Packets that told the camera.
    lost: Lost,
}

impl Pipeline {
    /// Makes a pipeline. The first frame starts the coding thread.
    pub fn new(encoder: Encoder) -> Pipeline {
        let lost = Lost::default();
        let (noted, mut coder) = (lost.clone(), Coder::default());
        let code = move |work: &mut FrameWork| {
            coder.code(work).inspect_err(|_| noted.note(work.states_session))
        };
        let slots = vec![FrameWork::default(), FrameWork::default()];
        let queue = Queue::new(vec![Box::new(code)], slots, lost.clone(), Box::new(spawn));
        Pipeline { encoder, queue, under_way: false, lost }
    }

    /// Finds the pose of a frame, while the difference of the frame before is coded. Then fills `encoded` with the
    /// frame before; `false`: there was none. `info`: as for [`Encoder::encode`].
    ///
    /// # Errors
    /// If the pose cannot be found: this frame is then left out, and the next call still yields the
    /// frame before. If the frame before cannot be coded: that frame is then lost, and this one is
    /// under way. [`Error::Thread`] if the system has no thread.
    pub fn push(
        &mut self,
        frame: &Picture,
        info: impl Into<FrameInfo>,
        encoded: &mut Encoded,
    ) -> Result<bool, Error> {
        let (encoder, info) = (&mut self.encoder, info.into());
        self.queue.begin(|work| encoder.track_next(frame, info, work))?;
        let before = self.take(encoded);
        self.under_way = true;
        before
    }

    /// Fills `encoded` with the frame that is under way; `false`: there is none.
    ///
    /// # Errors
    /// If it cannot be coded.
    pub fn flush(&mut self, encoded: &mut Encoded) -> Result<bool, Error> {
        self.take(encoded)
    }

    fn take(&mut self, encoded: &mut Encoded) -> Result<bool, Error> {
        if !std::mem::take(&mut self.under_way) {
            return Ok(false);
        }
        self.queue.wait(Duration::MAX)?;
        let taken = self.queue.take(|work| {
            std::mem::swap(encoded, &mut work.encoded);
            Ok(())
        });
        if self.lost.take() {
            self.encoder.announce();
        }
        taken
    }

    /// The encoder, for changing its rate or camera between frames.
    pub fn encoder(&mut self) -> &mut Encoder {
        &mut self.encoder
    }
}

/// A thread that is waited for.
struct Thread(Option<JoinHandle<()>>);

impl Drop for Thread {
    fn drop(&mut self) {
        // The queue has caught a panic, and a destructor can report to nobody.
        let _ = self.0.take().map(JoinHandle::join);
    }
}

fn spawn(_: usize, body: Body) -> Result<Box<dyn Send>, Error> {
    let thread = std::thread::Builder::new().name("nvsprior-coder".into()).spawn(body);
    let thread = thread.map_err(|e| Error::Thread(e.to_string()))?;
    Ok(Box::new(Thread(Some(thread))))
}
