//! Encoding in two halves at once: while the host codes the difference picture of one frame, the device searches for
//! the pose of the next.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use crate::residual::{ResidualEncoder, ResidualSetup};
use crate::tracked_frame::TrackedFrame;
use crate::{Encoded, Encoder, Error, Known, Picture};

/// A frame on its way through the coding thread, and back.
#[derive(Default)]
struct Parcel {
    tracked: TrackedFrame,
    encoded: Encoded,
    failure: Option<Error>,
}

/// An [`Encoder`] that gives each packet one call later, but more packets per second: a frame takes
/// the longer of its two halves, not their sum. Packets are the same, byte for byte.
pub struct Pipeline {
    encoder: Encoder,
    to_coder: Option<SyncSender<Parcel>>,
    from_coder: Receiver<Parcel>,
    coder: Option<JoinHandle<()>>,
    /// The parcel that is not with the coder.
    spare: Vec<Parcel>,
    under_way: bool,
}

impl Pipeline {
    /// Starts the coding thread.
    ///
    /// # Errors
    /// [`Error::Thread`] if the system gives no thread.
    pub fn new(encoder: Encoder) -> Result<Pipeline, Error> {
        let (to_coder, parcels) = sync_channel::<Parcel>(1);
        let (back, from_coder) = sync_channel(1);
        let coder = std::thread::Builder::new()
            .name("nvsprior-coder".into())
            .spawn(move || code(&parcels, &back))
            .map_err(|e| Error::Thread(e.to_string()))?;
        Ok(Pipeline {
            encoder,
            to_coder: Some(to_coder),
            from_coder,
            coder: Some(coder),
            spare: vec![Parcel::default(), Parcel::default()],
            under_way: false,
        })
    }

    /// Finds the pose of a frame, while the difference of the frame before is coded. Then fills `encoded` with the
    /// frame before; `false`: there was none. `known`: as for [`Encoder::encode`].
    ///
    /// # Errors
    /// If the pose cannot be found: this frame is then left out, and the next call still gives the
    /// frame before. If the frame before cannot be coded: that frame is then lost, and this one is
    /// under way.
    pub fn push(
        &mut self,
        frame: &Picture,
        known: impl Into<Known>,
        encoded: &mut Encoded,
    ) -> Result<bool, Error> {
        let mut parcel = self.spare.pop().unwrap_or_default();
        if let Err(error) = self.encoder.track_next(frame, &known.into(), &mut parcel.tracked) {
            self.spare.push(parcel);
            return Err(error);
        }
        let before = self.take(encoded);
        let sent = self.to_coder.as_ref().is_some_and(|to| to.send(parcel).is_ok());
        if !sent {
            return Err(Error::CoderGone);
        }
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
        let mut parcel = self.from_coder.recv().map_err(|_| Error::CoderGone)?;
        let failure = parcel.failure.take();
        if failure.is_none() {
            std::mem::swap(encoded, &mut parcel.encoded);
        } else if parcel.tracked.camera.is_some() {
            // The camera was in the packet that is lost.
            self.encoder.announce();
        }
        self.spare.push(parcel);
        failure.map_or(Ok(true), Err)
    }

    /// The encoder, for changing its rate or camera between frames.
    pub fn encoder(&mut self) -> &mut Encoder {
        &mut self.encoder
    }
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        // The thread ends with its channel.
        self.to_coder.take();
        if let Some(coder) = self.coder.take() {
            // `CoderGone` has reported a panic there, and a destructor can report to nobody.
            let _ = coder.join();
        }
    }
}

/// Codes the differences of tracked frames. Keeps the coder for as long as frames ask for the same.
#[derive(Default)]
pub(crate) struct Coder(Option<(ResidualSetup, ResidualEncoder)>);

impl Coder {
    /// Whether the frame needs another coder than the one before.
    #[cfg(feature = "capi")]
    pub fn changes(&self, tracked: &TrackedFrame) -> bool {
        let same = |(own, _): &(ResidualSetup, _)| {
            tracked.residual.as_ref().is_some_and(|setup| own.is_as(setup))
        };
        !self.0.as_ref().is_some_and(same)
    }

    /// See [`TrackedFrame::encode`].
    pub fn code(&mut self, tracked: &mut TrackedFrame, encoded: &mut Encoded) -> Result<(), Error> {
        // A frame that was tracked has it.
        let setup = tracked.residual.take().ok_or(Error::CoderGone)?;
        let (_, coder) = match self.0.take() {
            Some(same) if same.0.is_as(&setup) => self.0.insert(same),
            _ => {
                let coder = ResidualEncoder::new(&setup);
                self.0.insert((setup, coder))
            }
        };
        tracked.encode(coder, encoded)
    }
}

/// What the coding thread does.
fn code(parcels: &Receiver<Parcel>, back: &SyncSender<Parcel>) {
    let mut coder = Coder::default();
    while let Ok(mut parcel) = parcels.recv() {
        let Parcel { tracked, encoded, failure } = &mut parcel;
        *failure = coder.code(tracked, encoded).err();
        if back.send(parcel).is_err() {
            return;
        }
    }
}
