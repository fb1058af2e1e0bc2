//! Buffers filled from the host and fetched to it, by a copy on the device unless both share memory.

use bytemuck::{AnyBitPattern, NoUninit};

use super::{Buffer, Device, Error, Memory, Recorder, Timing};

impl Buffer {
    /// A buffer that the device only reads, filled with `data`. If host and device share memory
    /// it is written in place, else through a staging copy.
    pub fn from_slice<T: NoUninit>(
        device: &Device,
        name: &'static str,
        data: &[T],
    ) -> Result<Buffer, Error> {
        let mut upload = Buffer::new::<T>(device, name, data.len(), Memory::Upload)?;
        upload.write(data);
        if device.info().unified {
            return Ok(upload);
        }
        let buffer = Buffer::new::<T>(device, name, data.len(), Memory::Device)?;
        let mut recorder = Recorder::new(device, Timing::None)?;
        recorder.copy(&upload, &buffer);
        recorder.finish()?.run()?;
        Ok(buffer)
    }

    /// Copies the first `count` values to the host, of a buffer that only the device sees.
    pub fn fetch<T: AnyBitPattern>(&self, device: &Device, count: usize) -> Result<Vec<T>, Error> {
        let to = Buffer::new::<T>(device, "read back", count, Memory::Readback)?;
        let mut recorder = Recorder::new(device, Timing::None)?;
        recorder.copy(self, &to);
        recorder.finish()?.run()?;
        Ok(to.read(count).to_vec())
    }
}
