//! Storage buffers.

use std::sync::Arc;

use ash::vk;
use bytemuck::{AnyBitPattern, NoUninit};
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};

use super::device::Inner;
use super::{Device, Error};

/// Who reads and writes a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Memory {
    /// Only the device.
    Device,
    /// The host writes, the device reads.
    Upload,
    /// The device writes, the host reads.
    Readback,
}

/// A storage buffer.
pub struct Buffer {
    pub(super) shared: Arc<Shared>,
    name: &'static str,
    bytes: u64,
}

/// Handle and memory, kept alive by the buffer and by every command that uses it.
pub(super) struct Shared {
    pub raw: vk::Buffer,
    allocation: Option<Allocation>,
    /// What it takes of the device's memory.
    bytes: u64,
    device: Arc<Inner>,
}

impl Drop for Shared {
    fn drop(&mut self) {
        if self.device.hung() {
            std::mem::forget(self.allocation.take());
            return;
        }
        // SAFETY: submissions wait for their end, and recorded commands hold this handle.
        unsafe { self.device.device.destroy_buffer(self.raw, None) };
        self.device.give_back(self.bytes);
        if let (Some(allocation), Ok(mut allocator)) =
            (self.allocation.take(), self.device.allocator.lock())
            && let Some(allocator) = allocator.as_mut()
        {
            // A failure to free can only leak, and a destructor has nobody to tell.
            let _ = allocator.free(allocation);
        }
    }
}

impl Shared {
    fn allocate(&mut self, name: &'static str, bytes: u64, memory: Memory) -> Result<(), Error> {
        let failed = |reason: String| Error::Memory { buffer: name, bytes, reason };
        // SAFETY: the buffer was just made on this device.
        let requirements = unsafe { self.device.device.get_buffer_memory_requirements(self.raw) };
        let location = match memory {
            Memory::Device => MemoryLocation::GpuOnly,
            Memory::Upload => MemoryLocation::CpuToGpu,
            Memory::Readback => MemoryLocation::GpuToCpu,
        };
        self.device.take(name, requirements.size)?;
        self.bytes = requirements.size;
        // What is left of a block, 64 MiB or more, would count against a limit too: so each buffer has its own memory.
        let allocation_scheme = match self.device.is_limited() {
            true => AllocationScheme::DedicatedBuffer(self.raw),
            false => AllocationScheme::GpuAllocatorManaged,
        };
        let mut guard = self.device.allocator.lock().map_err(|e| failed(e.to_string()))?;
        let allocator = guard.as_mut().ok_or_else(|| failed("the device is closing".into()))?;
        let description =
            AllocationCreateDesc { name, requirements, location, linear: true, allocation_scheme };
        let allocation = allocator.allocate(&description).map_err(|e| failed(e.to_string()))?;
        let (memory, offset) = (
            // SAFETY: the memory stays with this struct, which frees it after its last use.
            unsafe { allocation.memory() },
            allocation.offset(),
        );
        self.allocation = Some(allocation);
        // SAFETY: the memory is large enough by `requirements`, and bound once.
        unsafe { self.device.device.bind_buffer_memory(self.raw, memory, offset) }
            .map_err(Error::of("vkBindBufferMemory"))
    }
}

impl Buffer {
    /// A buffer of `count` values of `T` (at least one), contents undefined.
    pub fn new<T>(
        device: &Device,
        name: &'static str,
        count: usize,
        memory: Memory,
    ) -> Result<Buffer, Error> {
        let bytes = (count.max(1) as u64).saturating_mul(size_of::<T>() as u64).max(4);
        let limit = device.inner.info.storage_range;
        if bytes > limit {
            return Err(Error::BufferTooLarge {
                buffer: name,
                bytes,
                limit,
                advice: String::new(),
            });
        }
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::INDIRECT_BUFFER
            | vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST;
        let info = vk::BufferCreateInfo::default().size(bytes).usage(usage);
        let inner = &device.inner;
        inner.check()?;
        // SAFETY: a valid description.
        let raw = unsafe { inner.device.create_buffer(&info, None) }
            .map_err(Error::of("vkCreateBuffer"))?;
        let mut shared = Shared { raw, allocation: None, bytes: 0, device: inner.clone() };
        shared.allocate(name, bytes, memory)?;
        Ok(Buffer { shared: Arc::new(shared), name, bytes })
    }

    /// Whether it was made on this very device, as it was opened.
    pub(crate) fn is_on(&self, device: &Device) -> bool {
        Arc::ptr_eq(&self.shared.device, &device.inner)
    }

    /// Size in bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Writes from the start.
    ///
    /// # Panics
    /// If the buffer was not made for uploads, or is smaller than `data`.
    pub fn write<T: NoUninit>(&mut self, data: &[T]) {
        self.write_at(0, data);
    }

    /// Writes from value `first` of `T` on.
    ///
    /// # Panics
    /// As [`write`](Self::write).
    pub fn write_at<T: NoUninit>(&mut self, first: usize, data: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let offset = first * size_of::<T>();
        let fits = (offset + bytes.len()) as u64 <= self.bytes;
        assert!(fits, "{} bytes at {offset} into {}", bytes.len(), self.name);
        let mapped = self.shared.allocation.as_ref().and_then(|a| a.mapped_ptr());
        let mapped = mapped.expect("only upload buffers are written");
        // SAFETY: the mapping spans the buffer's bytes, of which these are a part; `&mut self` is the
        // only host access, and submissions return after the device has finished.
        unsafe {
            let to = mapped.as_ptr().cast::<u8>().add(offset);
            std::ptr::copy_nonoverlapping(bytes.as_ptr(), to, bytes.len());
        }
    }

    /// The values the device left, `count` of them.
    ///
    /// # Panics
    /// If the buffer was not made for reading back, or holds fewer.
    pub fn read<T: AnyBitPattern>(&self, count: usize) -> &[T] {
        let mapped = self.shared.allocation.as_ref().and_then(|a| a.mapped_slice());
        let mapped = mapped.expect("only readback buffers are read");
        bytemuck::cast_slice(&mapped[..count * size_of::<T>()])
    }
}
