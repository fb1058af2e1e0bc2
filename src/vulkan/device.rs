//! Instance, device and queue.

use std::ffi::{CStr, CString, c_void};
use std::mem::ManuallyDrop;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use ash::{Entry, ext, vk};
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};

use super::{Error, GivenDevice, QueueLock, cache};

const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// How to choose and open a device.
#[derive(Clone, Debug, Default)]
pub struct DeviceOptions {
    /// The device's index, or a part of its name or its driver's name. Default: the best device, first a discrete GPU,
    /// then an integrated one, then a CPU.
    pub device: Option<String>,
    /// Run under the Khronos validation layer and keep its messages.
    pub validation: bool,
    /// Most bytes of device memory in all buffers together; 0: all that the device has.
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

/// What kind of device it is, the preferred one first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DeviceKind {
    /// A graphics card with memory of its own.
    DiscreteGpu,
    /// A GPU that shares the host's memory.
    IntegratedGpu,
    /// A GPU of a virtual machine.
    VirtualGpu,
    /// A driver that computes on the CPU, such as llvmpipe.
    Cpu,
    /// Any other.
    Other,
}

impl DeviceKind {
    fn of(device_type: vk::PhysicalDeviceType) -> DeviceKind {
        match device_type {
            vk::PhysicalDeviceType::DISCRETE_GPU => DeviceKind::DiscreteGpu,
            vk::PhysicalDeviceType::INTEGRATED_GPU => DeviceKind::IntegratedGpu,
            vk::PhysicalDeviceType::VIRTUAL_GPU => DeviceKind::VirtualGpu,
            vk::PhysicalDeviceType::CPU => DeviceKind::Cpu,
            _ => DeviceKind::Other,
        }
    }

    /// Its name, for people.
    pub fn name(self) -> &'static str {
        match self {
            DeviceKind::DiscreteGpu => "discrete GPU",
            DeviceKind::IntegratedGpu => "integrated GPU",
            DeviceKind::VirtualGpu => "virtual GPU",
            DeviceKind::Cpu => "CPU",
            DeviceKind::Other => "other",
        }
    }
}

/// What a device says of itself.
#[derive(Clone, Debug)]
pub struct DeviceInfo {
    /// Its name.
    pub name: String,
    /// What kind of device it is.
    pub kind: DeviceKind,
    /// Driver's name and version text.
    pub driver: String,
    /// Vulkan version.
    pub api: (u32, u32),
    /// Invocations of a subgroup.
    pub subgroup: u32,
    /// Whether compute shaders can shuffle within a subgroup.
    pub shuffles: bool,
    /// Whether shaders may use 64-bit integers.
    pub int64: bool,
    /// Shared memory of a workgroup, bytes.
    pub shared_memory: u32,
    /// Largest storage buffer, bytes.
    pub storage_range: u64,
    /// Largest piece of memory that the device gives at once, bytes.
    pub allocation: u64,
    /// Its largest heap of device memory, bytes.
    pub heap: u64,
    /// `maxComputeWorkGroupCount`, first component.
    pub workgroups: u32,
    /// Whether host and device share one memory, so that nothing needs staging.
    pub unified: bool,
    /// Whether stages can ask for rounding to nearest even. Else the device rounds as it does by default.
    pub(crate) rounding_control: bool,
    /// Whether the device computes the operations of the final picture to the same bits as every other. Measured when
    /// an engine is made with it.
    pub portable: bool,
}

impl DeviceInfo {
    /// Whether the device runs a subgroup of eight invocations as one vector, as llvmpipe does. Some stages have a form
    /// for such devices, `…_lockstep`. It has no barriers and no shared copies, loads two words per access, and lanes
    /// hand each other what they loaded.
    pub fn in_lockstep(&self) -> bool {
        self.kind == DeviceKind::Cpu && self.subgroup == 8 && self.int64 && self.shuffles
    }
}

impl std::fmt::Display for DeviceInfo {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{} ({}, {}, Vulkan {}.{}, subgroup {}{})",
            self.name,
            self.kind.name(),
            self.driver,
            self.api.0,
            self.api.1,
            self.subgroup,
            if self.portable { "" } else { ", not portable" }
        )
    }
}

/// A device that the driver knows, whether or not it can run the engine.
#[derive(Clone, Debug)]
pub struct ListedDevice {
    /// What it says of itself. Whether it is portable is not measured.
    pub info: DeviceInfo,
    /// Its own memory, bytes: the largest heap.
    pub memory: u64,
    /// Why it cannot run the engine; `None` if it can.
    pub unfit: Option<&'static str>,
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
    instance: ManuallyDrop<Instance>,
}

/// A device and what it was opened with.
pub(super) struct Opened {
    pub instance: Instance,
    pub physical: vk::PhysicalDevice,
    pub device: ash::Device,
    pub queue: vk::Queue,
    pub queue_family: u32,
    pub info: DeviceInfo,
}

pub(super) struct Instance {
    /// Whether the program made it, and the device: they are not destroyed then.
    given: bool,
    messages: Arc<Mutex<Vec<String>>>,
    messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    pub instance: ash::Instance,
    // The loader library must outlive every call through it.
    _entry: Entry,
}

impl Drop for Instance {
    fn drop(&mut self) {
        if self.given {
            return;
        }
        // SAFETY: the device is gone (Inner drops it first), and nothing else uses the instance.
        unsafe {
            if let Some((debug, messenger)) = self.messenger.take() {
                debug.destroy_debug_utils_messenger(messenger, None);
            }
            self.instance.destroy_instance(None);
        }
    }
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
        let Opened { instance, physical, device, queue, queue_family, info } = match &options.given
        {
            Some(given) => given.open()?,
            None => Opened::own(options)?,
        };
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

    /// What the driver has compiled so far, for [`DeviceOptions::pipeline_cache`] of the next start. It ends in a check.
    pub fn pipeline_cache(&self) -> Result<Vec<u8>, Error> {
        self.inner.check()?;
        cache::read(&self.inner.device, self.inner.pipeline_cache)
    }

    /// What the device says of itself.
    pub fn info(&self) -> &DeviceInfo {
        &self.inner.info
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

/// Keeps a message of the validation layer.
unsafe extern "system" fn keep_message(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: the layer passes valid data; `user` is the mutex that Instance keeps alive.
    let (text, messages) = unsafe {
        let text = (*data).message_as_c_str().map(|s| s.to_string_lossy().into_owned());
        (text.unwrap_or_default(), &*user.cast::<Mutex<Vec<String>>>())
    };
    if let Ok(mut messages) = messages.lock() {
        messages.push(text);
    }
    vk::FALSE
}

/// Whether a device is the one asked for.
fn is_the_one(wanted: &str, index: usize, info: &DeviceInfo) -> bool {
    match wanted.parse::<usize>() {
        Ok(number) => number == index,
        Err(_) => info.name.contains(wanted) || info.driver.contains(wanted),
    }
}

impl Opened {
    fn own(options: &DeviceOptions) -> Result<Opened, Error> {
        // SAFETY: the library loaded is the system's Vulkan loader.
        let entry = unsafe { Entry::load() }.map_err(|e| Error::NoLoader(e.to_string()))?;
        let instance = Instance::new(entry, options.validation)?;
        let (physical, queue_family, info) = instance.choose(options.device.as_deref())?;
        let device = instance.open(physical, queue_family)?;
        // SAFETY: the queue family was asked for when the device was made.
        let queue = unsafe { device.get_device_queue(queue_family, 0) };
        Ok(Opened { instance, physical, device, queue, queue_family, info })
    }
}

impl Instance {
    /// One that the program made.
    pub(super) fn given(entry: Entry, instance: ash::Instance) -> Instance {
        let messages = Arc::default();
        Instance { given: true, messages, messenger: None, instance, _entry: entry }
    }

    fn new(entry: Entry, validation: bool) -> Result<Instance, Error> {
        let app = vk::ApplicationInfo::default()
            .application_name(c"nvsprior")
            .api_version(vk::API_VERSION_1_2);
        let mut layers = Vec::new();
        let mut extensions = Vec::new();
        if validation {
            // SAFETY: a plain query.
            let present = unsafe { entry.enumerate_instance_layer_properties() }
                .map_err(Error::of("vkEnumerateInstanceLayerProperties"))?;
            if !present.iter().any(|l| l.layer_name_as_c_str() == Ok(VALIDATION_LAYER)) {
                return Err(Error::NoValidationLayer);
            }
            layers.push(VALIDATION_LAYER.as_ptr());
            extensions.push(ext::debug_utils::NAME.as_ptr());
        }
        let info = vk::InstanceCreateInfo::default()
            .application_info(&app)
            .enabled_layer_names(&layers)
            .enabled_extension_names(&extensions);
        // SAFETY: `info` and what it points to live through the call.
        let made = unsafe { entry.create_instance(&info, None) };
        let instance = made.map_err(|result| match result {
            // What the loader says if no driver is installed.
            vk::Result::ERROR_INCOMPATIBLE_DRIVER => {
                Error::NoDevice { found: "no Vulkan driver is installed".into() }
            }
            result => Error::of("vkCreateInstance")(result),
        })?;
        let mut this = Instance {
            given: false,
            messages: Arc::default(),
            messenger: None,
            instance,
            _entry: entry,
        };
        if validation {
            this.listen()?;
        }
        Ok(this)
    }

    fn listen(&mut self) -> Result<(), Error> {
        use vk::{
            DebugUtilsMessageSeverityFlagsEXT as Severity, DebugUtilsMessageTypeFlagsEXT as Kind,
        };
        let debug = ext::debug_utils::Instance::new(&self._entry, &self.instance);
        let user = Arc::as_ptr(&self.messages).cast_mut().cast();
        let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(Severity::WARNING | Severity::ERROR)
            .message_type(Kind::VALIDATION | Kind::PERFORMANCE)
            .pfn_user_callback(Some(keep_message))
            .user_data(user);
        // SAFETY: the mutex behind `user` lives as long as this Instance, which destroys the
        // messenger first.
        let messenger = unsafe { debug.create_debug_utils_messenger(&info, None) }
            .map_err(Error::of("vkCreateDebugUtilsMessengerEXT"))?;
        self.messenger = Some((debug, messenger));
        Ok(())
    }

    /// The device asked for, or the one of the best kind.
    fn choose(&self, wanted: Option<&str>) -> Result<(vk::PhysicalDevice, u32, DeviceInfo), Error> {
        let mut best: Option<(vk::PhysicalDevice, u32, DeviceInfo)> = None;
        let (mut passed_over, mut others) = (Vec::new(), Vec::new());
        for (index, device) in self.devices()?.into_iter().enumerate() {
            let info = self.describe(device);
            if wanted.is_some_and(|wanted| !is_the_one(wanted, index, &info)) {
                others.push(format!("{index}: {}", info.name));
                continue;
            }
            match self.queue_family(device) {
                Err(reason) => passed_over.push(format!("{} {reason}", info.name)),
                Ok(family) if best.as_ref().is_none_or(|b| info.kind < b.2.kind) => {
                    best = Some((device, family, info));
                }
                Ok(_) => {}
            }
        }
        best.ok_or_else(|| match wanted {
            Some(wanted) if passed_over.is_empty() && !others.is_empty() => {
                Error::UnknownDevice { wanted: wanted.to_owned(), found: others.join(", ") }
            }
            _ if passed_over.is_empty() => Error::NoDevice { found: "none found".into() },
            _ => Error::NoDevice { found: passed_over.join(", ") },
        })
    }

    pub(super) fn devices(&self) -> Result<Vec<vk::PhysicalDevice>, Error> {
        // SAFETY: a plain query.
        unsafe { self.instance.enumerate_physical_devices() }
            .map_err(Error::of("vkEnumeratePhysicalDevices"))
    }

    fn listed(&self, device: vk::PhysicalDevice) -> ListedDevice {
        // SAFETY: a plain query on a device of this instance.
        let memory = unsafe { self.instance.get_physical_device_memory_properties(device) };
        let heaps = memory.memory_heaps_as_slice().iter();
        ListedDevice {
            info: self.describe(device),
            memory: heaps.map(|heap| heap.size).max().unwrap_or(0),
            unfit: self.queue_family(device).err(),
        }
    }

    pub(super) fn describe(&self, device: vk::PhysicalDevice) -> DeviceInfo {
        let mut subgroup = vk::PhysicalDeviceSubgroupProperties::default();
        let mut driver = vk::PhysicalDeviceDriverProperties::default();
        let mut floats = vk::PhysicalDeviceFloatControlsProperties::default();
        let mut allocation = vk::PhysicalDeviceMaintenance3Properties::default();
        let mut properties = vk::PhysicalDeviceProperties2::default()
            .push_next(&mut subgroup)
            .push_next(&mut allocation)
            .push_next(&mut floats)
            .push_next(&mut driver);
        // SAFETY: the chained structures live through the call.
        unsafe { self.instance.get_physical_device_properties2(device, &mut properties) };
        // SAFETY: a plain query.
        let features = unsafe { self.instance.get_physical_device_features(device) };
        // SAFETY: as above.
        let memory = unsafe { self.instance.get_physical_device_memory_properties(device) };
        let local = |heap: &&vk::MemoryHeap| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL);
        let heaps = memory.memory_heaps_as_slice().iter().filter(local).map(|heap| heap.size);
        let p = properties.properties;
        let kind = DeviceKind::of(p.device_type);
        let text = |s: Result<&CStr, _>| s.unwrap_or(c"?").to_string_lossy().into_owned();
        DeviceInfo {
            name: text(p.device_name_as_c_str()),
            kind,
            driver: match text(driver.driver_info_as_c_str()) {
                nothing if nothing.is_empty() => text(driver.driver_name_as_c_str()),
                info => info,
            },
            api: (vk::api_version_major(p.api_version), vk::api_version_minor(p.api_version)),
            subgroup: subgroup.subgroup_size,
            shuffles: subgroup.supported_operations.contains(vk::SubgroupFeatureFlags::SHUFFLE)
                && subgroup.supported_stages.contains(vk::ShaderStageFlags::COMPUTE),
            int64: features.shader_int64 == vk::TRUE,
            shared_memory: p.limits.max_compute_shared_memory_size,
            storage_range: u64::from(p.limits.max_storage_buffer_range),
            allocation: allocation.max_memory_allocation_size,
            heap: heaps.max().unwrap_or(0),
            workgroups: p.limits.max_compute_work_group_count[0],
            unified: matches!(kind, DeviceKind::IntegratedGpu | DeviceKind::Cpu),
            rounding_control: floats.shader_rounding_mode_rte_float32 == vk::TRUE,
            portable: false,
        }
    }

    /// A compute queue family of a device that fits, or why it does not.
    pub(super) fn queue_family(&self, device: vk::PhysicalDevice) -> Result<u32, &'static str> {
        // SAFETY: plain queries on a device of this instance.
        let (properties, families) = unsafe {
            (
                self.instance.get_physical_device_properties(device),
                self.instance.get_physical_device_queue_family_properties(device),
            )
        };
        if properties.api_version < vk::API_VERSION_1_2 {
            return Err("is older than Vulkan 1.2");
        }
        let mut vulkan12 = vk::PhysicalDeviceVulkan12Features::default();
        let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut vulkan12);
        // SAFETY: the chained structures live through the call.
        unsafe { self.instance.get_physical_device_features2(device, &mut features) };
        if vulkan12.vulkan_memory_model == vk::FALSE {
            return Err("lacks vulkanMemoryModel");
        }
        families
            .iter()
            .position(|f| f.queue_flags.contains(vk::QueueFlags::COMPUTE))
            .map(|i| i as u32)
            .ok_or("has no compute queue")
    }

    fn open(&self, physical: vk::PhysicalDevice, family: u32) -> Result<ash::Device, Error> {
        let priorities = [1.0];
        let queues = [vk::DeviceQueueCreateInfo::default()
            .queue_family_index(family)
            .queue_priorities(&priorities)];
        let mut vulkan12 = vk::PhysicalDeviceVulkan12Features::default().vulkan_memory_model(true);
        // SAFETY: a plain query.
        let features = unsafe { self.instance.get_physical_device_features(physical) };
        let features =
            vk::PhysicalDeviceFeatures::default().shader_int64(features.shader_int64 == vk::TRUE);
        let info = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_features(&features)
            .push_next(&mut vulkan12);
        // SAFETY: `physical` has the family and the feature (`queue_family` checked both).
        unsafe { self.instance.create_device(physical, &info, None) }
            .map_err(Error::of("vkCreateDevice"))
    }
}

/// A kernel's entry point as Vulkan wants it. Names come from the committed manifest and have no NULs.
pub(super) fn c_name(name: &str) -> CString {
    CString::new(name.replace('\0', "")).unwrap_or_default()
}
