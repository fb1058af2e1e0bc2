//! Instance, device and queue.

use std::ffi::CString;
use std::mem::ManuallyDrop;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use ash::{Entry, vk};
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};

use super::device_info::{DeviceInfo, ListedDevice, NO_HARDWARE};
use super::instance::{Instance, Opened};
use super::{Error, GivenDevice, QueueLock, cache};

/// How to choose and open a device.
#[derive(Clone, Debug, Default)]
pub struct DeviceOptions {
    /// The device's index, or a part of its name or its driver's name. Default: the best device, first a discrete GPU,
    /// then an integrated one, then a CPU. A device without hardware ([`DeviceInfo::is_null`]) is refused.
    pub device: Option<String>,
    /// Run under the Khronos validation layer and keep its messages.
    pub validation: bool,
    /// Most bytes of device memory for all buffers together, also of what is taken from the driver; 0: all that the
    /// device has. With a limit each buffer has its own memory, so many of them take longer to make.
    pub memory_limit: u64,
    /// Longest that one submission may take. What takes longer counts as a lost device ([`Error::Hung`]), and what the
    /// device may still use is then never freed: buffers, pipelines, the device itself. `None`: no bound.
    pub watchdog: Option<Duration>,
    /// What [`Device::pipeline_cache`] gave before, so that the driver need not compile again; empty: nothing. Data of
    /// another driver, or damaged data, is left aside.
    pub pipeline_cache: Vec<u8>,
    /// A device that the program has made, to use rather than open one. `device` and `validation` are left aside.
    pub given: Option<GivenDevice>,
}

/// All devices of the installed drivers, in the order of the numbers that [`DeviceOptions::device`] takes.
pub fn devices() -> Result<Vec<ListedDevice>, Error> {
    // SAFETY: the library loaded is the system's Vulkan loader.
    let entry = unsafe { Entry::load() }.map_err(|e| Error::NoLoader(e.to_string()))?;
    let instance = Instance::new(entry, false)?;
    Ok(instance.devices()?.into_iter().map(|device| instance.listed(device)).collect())
}

/// Device memory in use by all that was made on a device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MemoryUse {
    /// Bytes in buffers.
    pub used: u64,
    /// Bytes taken from the driver for them.
    pub reserved: u64,
    /// Buffers.
    pub buffers: u64,
}

/// An opened device with one compute queue. Clones share it.
#[derive(Clone)]
pub struct Device {
    pub(super) inner: Arc<Inner>,
}

/// What lives as long as anything made on the device.
pub(super) struct Inner {
    // Dropped by hand, in this order, before the device and the instance.
    pub allocator: Mutex<Option<Allocator>>,
    queue: Mutex<vk::Queue>,
    /// The program's own lock of a queue that it gave.
    queue_lock: Option<Arc<dyn QueueLock>>,
    pub queue_family: u32,
    pub device: ash::Device,
    pub info: DeviceInfo,
    /// Whether pipelines are made so that the compiler tells what it made of them.
    pub inspected: bool,
    pub timestamp_period: f32,
    /// Whether the queue can tell the time.
    pub timestamps: bool,
    /// A call found the device lost: none after it gets that far.
    lost: AtomicBool,
    /// A call waited for the device in vain: it may still use all that was made on it.
    hung: AtomicBool,
    /// Longest that a submission may take, nanoseconds.
    pub watchdog: u64,
    /// Bytes in buffers, and the most that there may be.
    taken: AtomicU64,
    memory_limit: u64,
    /// Null if the driver makes none.
    pub pipeline_cache: vk::PipelineCache,
    pub instance: ManuallyDrop<Instance>,
}

/// The queue, held for a submission.
pub(super) struct HeldQueue<'a> {
    pub raw: MutexGuard<'a, vk::Queue>,
    lock: Option<&'a dyn QueueLock>,
}

impl Drop for HeldQueue<'_> {
    fn drop(&mut self) {
        if let Some(lock) = self.lock {
            lock.unlock();
        }
    }
}

impl Inner {
    /// Waits for the queue.
    pub fn hold_queue(&self) -> HeldQueue<'_> {
        // A poisoned lock means that another thread panicked between two Vulkan calls; the queue itself is still whole.
        let raw = self.queue.lock().unwrap_or_else(PoisonError::into_inner);
        let lock = self.queue_lock.as_deref();
        if let Some(lock) = lock {
            lock.lock();
        }
        HeldQueue { raw, lock }
    }

    /// Refuses a device that was lost: drivers need not say so again.
    pub fn check(&self) -> Result<(), Error> {
        match self.lost.load(Ordering::Relaxed) {
            true => Err(Error::DeviceLost { call: "an earlier call" }),
            false => Ok(()),
        }
    }

    /// Whether there is a limit of memory.
    pub fn is_limited(&self) -> bool {
        self.memory_limit != u64::MAX
    }

    /// Counts a buffer's bytes. Refuses them if all buffers together would pass the limit.
    pub fn take(&self, buffer: &'static str, bytes: u64) -> Result<(), Error> {
        let limit = self.memory_limit;
        let sum = |taken: u64| taken.checked_add(bytes).filter(|sum| *sum <= limit);
        match self.taken.fetch_update(Ordering::Relaxed, Ordering::Relaxed, sum) {
            Ok(_) => Ok(()),
            Err(taken) => {
                let reason = format!("{taken} bytes are in use, the limit is {limit}");
                Err(Error::Memory { buffer, bytes, reason })
            }
        }
    }

    /// The bytes of a buffer are free again.
    pub fn give_back(&self, bytes: u64) {
        self.taken.fetch_sub(bytes, Ordering::Relaxed);
    }

    /// Takes note if a call found the device lost.
    pub fn note<T>(&self, result: Result<T, Error>) -> Result<T, Error> {
        if let Err(Error::DeviceLost { .. } | Error::Hung { .. }) = result {
            self.lost.store(true, Ordering::Relaxed);
        }
        if let Err(Error::Hung { .. }) = result {
            self.hung.store(true, Ordering::Relaxed);
        }
        result
    }

    /// Whether the device may still use what was made on it, so that nothing may be freed.
    pub fn hung(&self) -> bool {
        self.hung.load(Ordering::Relaxed)
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        let allocator = self.allocator.get_mut().unwrap_or_else(|e| e.into_inner()).take();
        if self.hung() {
            // The driver's code may still run on them: they stay, the loader library too.
            std::mem::forget(allocator);
            return;
        }
        // It frees its memory through the device.
        drop(allocator);
        // SAFETY: buffers, kernels and commands hold this Inner, so all are gone. The instance goes last, once.
        unsafe {
            self.device.destroy_pipeline_cache(self.pipeline_cache, None);
            if !self.instance.given {
                self.device.destroy_device(None);
            }
            ManuallyDrop::drop(&mut self.instance);
        }
    }
}

impl Device {
    /// Opens the best device, or the one asked for, or takes the one given.
    pub fn open(options: &DeviceOptions) -> Result<Device, Error> {
        let opened = match &options.given {
            Some(given) => given.open()?,
            None => Opened::own(options.validation, options.device.as_deref(), false)?,
        };
        if opened.info.is_null() {
            let found = format!("{} {NO_HARDWARE}", opened.info.name);
            return Err(Error::NoDevice { found });
        }
        Device::with(opened, options)
    }

    pub(super) fn with(opened: Opened, options: &DeviceOptions) -> Result<Device, Error> {
        let Opened { instance, physical, device, queue, queue_family, info, inspected } = opened;
        // SAFETY: `physical` is a device of this instance.
        let limits = unsafe { instance.instance.get_physical_device_properties(physical) }.limits;
        // SAFETY: as above.
        let families =
            unsafe { instance.instance.get_physical_device_queue_family_properties(physical) };
        let timestamps = families[queue_family as usize].timestamp_valid_bits > 0;
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: instance.instance.clone(),
            device: device.clone(),
            physical_device: physical,
            debug_settings: Default::default(),
            buffer_device_address: false,
            allocation_sizes: Default::default(),
        });
        let allocator = match allocator {
            Ok(allocator) => allocator,
            Err(e) => {
                if !instance.given {
                    // SAFETY: nothing was made on the device yet.
                    unsafe { device.destroy_device(None) };
                }
                let reason = e.to_string();
                return Err(Error::Memory { buffer: "allocator", bytes: 0, reason });
            }
        };
        let pipeline_cache = cache::open(&device, &options.pipeline_cache);
        Ok(Device {
            inner: Arc::new(Inner {
                pipeline_cache,
                allocator: Mutex::new(Some(allocator)),
                queue: Mutex::new(queue),
                queue_lock: options.given.as_ref().and_then(|given| given.lock.clone()),
                queue_family,
                device,
                info,
                inspected,
                timestamp_period: limits.timestamp_period,
                timestamps,
                lost: AtomicBool::new(false),
                hung: AtomicBool::new(false),
                watchdog: options
                    .watchdog
                    .map_or(u64::MAX, |time| u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)),
                taken: AtomicU64::new(0),
                memory_limit: match options.memory_limit {
                    0 => u64::MAX,
                    limit => limit,
                },
                instance: ManuallyDrop::new(instance),
            }),
        })
    }

    /// Takes note of whether the device is portable. Nothing that was made on it may be left.
    pub(crate) fn set_portable(&mut self, portable: bool) {
        if let Some(inner) = Arc::get_mut(&mut self.inner) {
            inner.info.portable = portable;
        }
    }

    /// What the driver has compiled so far, for [`DeviceOptions::pipeline_cache`] of the next start. It ends in a
    /// check.
    pub fn pipeline_cache(&self) -> Result<Vec<u8>, Error> {
        self.inner.check()?;
        cache::read(&self.inner.device, self.inner.pipeline_cache)
    }

    /// What the device says of itself.
    pub fn info(&self) -> &DeviceInfo {
        &self.inner.info
    }

    /// Whether the device tells how long its stages take. If it does not, no recording has times of stages or marks.
    pub fn timestamps(&self) -> bool {
        self.inner.timestamps
    }

    /// Device memory in use.
    pub fn memory(&self) -> MemoryUse {
        let allocator = self.inner.allocator.lock().unwrap_or_else(|e| e.into_inner());
        let report = allocator.as_ref().map(Allocator::generate_report);
        report.map_or(MemoryUse::default(), |report| MemoryUse {
            used: report.total_allocated_bytes,
            reserved: report.total_capacity_bytes,
            buffers: report.allocations.len() as u64,
        })
    }

    /// Messages of the validation layer so far; empty if validation is off.
    pub fn validation_messages(&self) -> Vec<String> {
        self.inner.instance.messages.lock().map(|m| m.clone()).unwrap_or_default()
    }
}

/// A kernel's entry point as Vulkan wants it. Names come from the committed manifest and have no NULs.
pub(super) fn c_name(name: &str) -> CString {
    CString::new(name.replace('\0', "")).unwrap_or_default()
}
