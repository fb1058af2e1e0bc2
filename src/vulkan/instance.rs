//! A Vulkan instance, and the choice of a device.

use std::ffi::{CStr, c_void};
use std::sync::{Arc, Mutex};

use ash::{Entry, ext, khr, vk};

use crate::shared::WAVE_MEMORY;

use super::Error;
use super::device_info::{DeviceInfo, DeviceKind, ListedDevice, NO_HARDWARE};

const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// A device and what it was opened with.
pub(super) struct Opened {
    pub instance: Instance,
    pub physical: vk::PhysicalDevice,
    pub device: ash::Device,
    pub queue: vk::Queue,
    pub queue_family: u32,
    pub info: DeviceInfo,
    /// Whether the compiler is asked what it makes of pipelines.
    pub inspected: bool,
}

pub(super) struct Instance {
    /// Whether the program made it, and the device: they are not destroyed then.
    pub given: bool,
    pub messages: Arc<Mutex<Vec<String>>>,
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

/// A device to choose from, and its compute queue family, or why it does not fit.
type Candidate = (DeviceInfo, Result<u32, &'static str>);

/// The index of the device asked for, or of the one of the best kind, and its queue family. A device without hardware
/// must be asked for.
fn best(candidates: &[Candidate], wanted: Option<&str>) -> Result<(usize, u32), Error> {
    let mut best: Option<(usize, u32)> = None;
    let (mut passed_over, mut others) = (Vec::new(), Vec::new());
    for (index, (info, family)) in candidates.iter().enumerate() {
        match *family {
            _ if wanted.is_some_and(|wanted| !is_the_one(wanted, index, info)) => {
                others.push(format!("{index}: {}", info.name));
            }
            Err(reason) => passed_over.push(format!("{} {reason}", info.name)),
            Ok(_) if info.is_null() && wanted.is_none() => {
                passed_over.push(format!("{} {NO_HARDWARE}", info.name));
            }
            Ok(family) if best.is_none_or(|(best, _)| info.kind < candidates[best].0.kind) => {
                best = Some((index, family));
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

impl Opened {
    /// Opens a device of the system's drivers; `inspected`: with what its compiler tells.
    pub(super) fn own(
        validation: bool,
        wanted: Option<&str>,
        inspected: bool,
    ) -> Result<Opened, Error> {
        // SAFETY: the library loaded is the system's Vulkan loader.
        let entry = unsafe { Entry::load() }.map_err(|e| Error::NoLoader(e.to_string()))?;
        let instance = Instance::new(entry, validation)?;
        let (physical, queue_family, info) = instance.choose(wanted)?;
        let device = instance.open(physical, queue_family, inspected)?;
        // SAFETY: the queue family was asked for when the device was made.
        let queue = unsafe { device.get_device_queue(queue_family, 0) };
        Ok(Opened { instance, physical, device, queue, queue_family, info, inspected })
    }
}

/// The subgroup size that the forms for waves are built for: [`DeviceInfo::wave`]. It is 32 if the device can: at 64 an
/// invocation has one row of pixels, and more instructions for each. Else it is the device's own.
fn wave(
    subgroup: u32,
    [least, most]: [u32; 2],
    operations: vk::SubgroupFeatureFlags,
) -> Option<u32> {
    let subgroup = if (least..=most).contains(&32) { 32 } else { subgroup };
    let needed = vk::SubgroupFeatureFlags::BASIC
        | vk::SubgroupFeatureFlags::VOTE
        | vk::SubgroupFeatureFlags::ARITHMETIC
        | vk::SubgroupFeatureFlags::BALLOT
        | vk::SubgroupFeatureFlags::SHUFFLE;
    (matches!(subgroup, 16 | 32 | 64) && operations.contains(needed)).then_some(subgroup)
}

impl Instance {
    /// One that the program made.
    pub(super) fn given(entry: Entry, instance: ash::Instance) -> Instance {
        let messages = Arc::default();
        Instance { given: true, messages, messenger: None, instance, _entry: entry }
    }

    pub(super) fn new(entry: Entry, validation: bool) -> Result<Instance, Error> {
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
        let devices = self.devices()?;
        let candidates: Vec<Candidate> =
            devices.iter().map(|d| (self.describe(*d), self.queue_family(*d))).collect();
        let (chosen, family) = best(&candidates, wanted)?;
        Ok((devices[chosen], family, candidates[chosen].0.clone()))
    }

    pub(super) fn devices(&self) -> Result<Vec<vk::PhysicalDevice>, Error> {
        // SAFETY: a plain query.
        unsafe { self.instance.enumerate_physical_devices() }
            .map_err(Error::of("vkEnumeratePhysicalDevices"))
    }

    pub(super) fn listed(&self, device: vk::PhysicalDevice) -> ListedDevice {
        // SAFETY: a plain query on a device of this instance.
        let memory = unsafe { self.instance.get_physical_device_memory_properties(device) };
        let heaps = memory.memory_heaps_as_slice().iter();
        let info = self.describe(device);
        ListedDevice {
            memory: heaps.map(|heap| heap.size).max().unwrap_or(0),
            unfit: match self.queue_family(device) {
                Ok(_) if info.is_null() => Some(NO_HARDWARE),
                family => family.err(),
            },
            info,
        }
    }

    pub(super) fn describe(&self, device: vk::PhysicalDevice) -> DeviceInfo {
        let mut subgroup = vk::PhysicalDeviceSubgroupProperties::default();
        let mut sizes = vk::PhysicalDeviceSubgroupSizeControlProperties::default();
        let controls_size = self.controls_subgroup_size(device);
        let mut driver = vk::PhysicalDeviceDriverProperties::default();
        let mut floats = vk::PhysicalDeviceFloatControlsProperties::default();
        let mut allocation = vk::PhysicalDeviceMaintenance3Properties::default();
        let mut properties = vk::PhysicalDeviceProperties2::default()
            .push_next(&mut subgroup)
            .push_next(&mut allocation)
            .push_next(&mut floats)
            .push_next(&mut driver);
        if controls_size {
            properties = properties.push_next(&mut sizes);
        }
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
        let compute = vk::ShaderStageFlags::COMPUTE;
        let operations = match subgroup.supported_stages.contains(compute) {
            true => subgroup.supported_operations,
            false => vk::SubgroupFeatureFlags::empty(),
        };
        let full = controls_size && sizes.required_subgroup_size_stages.contains(compute);
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
            shuffles: operations.contains(vk::SubgroupFeatureFlags::SHUFFLE),
            wave: match full && p.limits.max_compute_shared_memory_size >= WAVE_MEMORY {
                true => {
                    let sizes = [sizes.min_subgroup_size, sizes.max_subgroup_size];
                    wave(subgroup.subgroup_size, sizes, operations)
                }
                false => None,
            },
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

    /// Whether a pipeline can ask for full subgroups of a size.
    fn controls_subgroup_size(&self, device: vk::PhysicalDevice) -> bool {
        // SAFETY: a plain query on a device of this instance.
        let extensions = unsafe { self.instance.enumerate_device_extension_properties(device) };
        let name = ext::subgroup_size_control::NAME;
        let is_it = |e: &vk::ExtensionProperties| e.extension_name_as_c_str() == Ok(name);
        if !extensions.is_ok_and(|extensions| extensions.iter().any(is_it)) {
            return false;
        }
        let mut control = vk::PhysicalDeviceSubgroupSizeControlFeatures::default();
        let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut control);
        // SAFETY: the chained structure lives through the call, and the device knows it.
        unsafe { self.instance.get_physical_device_features2(device, &mut features) };
        control.subgroup_size_control == vk::TRUE && control.compute_full_subgroups == vk::TRUE
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

    fn open(
        &self,
        physical: vk::PhysicalDevice,
        family: u32,
        inspected: bool,
    ) -> Result<ash::Device, Error> {
        let priorities = [1.0];
        let queues = [vk::DeviceQueueCreateInfo::default()
            .queue_family_index(family)
            .queue_priorities(&priorities)];
        let mut vulkan12 = vk::PhysicalDeviceVulkan12Features::default().vulkan_memory_model(true);
        // SAFETY: a plain query.
        let features = unsafe { self.instance.get_physical_device_features(physical) };
        let features =
            vk::PhysicalDeviceFeatures::default().shader_int64(features.shader_int64 == vk::TRUE);
        let mut info = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_features(&features)
            .push_next(&mut vulkan12);
        let mut control = vk::PhysicalDeviceSubgroupSizeControlFeatures::default()
            .subgroup_size_control(true)
            .compute_full_subgroups(true);
        let mut executables = vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR::default()
            .pipeline_executable_info(true);
        let mut extensions = Vec::new();
        if self.controls_subgroup_size(physical) {
            extensions.push(ext::subgroup_size_control::NAME.as_ptr());
            info = info.push_next(&mut control);
        }
        if inspected {
            extensions.push(khr::pipeline_executable_properties::NAME.as_ptr());
            info = info.push_next(&mut executables);
        }
        info = info.enabled_extension_names(&extensions);
        // SAFETY: `physical` has the family and the feature (`queue_family` checked both), and the first extension if
        // it is asked for. If it lacks the second one, the call fails.
        unsafe { self.instance.create_device(physical, &info, None) }
            .map_err(Error::of("vkCreateDevice"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn device(name: &str, kind: DeviceKind) -> DeviceInfo {
        DeviceInfo { kind, name: name.into(), ..DeviceInfo::NONE }
    }

    /// A CPU driver, the device without hardware, and an old device.
    fn candidates() -> Vec<Candidate> {
        vec![
            (device("llvmpipe", DeviceKind::Cpu), Ok(1)),
            (device("Null hardware (RADV NAVI21)", DeviceKind::DiscreteGpu), Ok(2)),
            (device("old", DeviceKind::DiscreteGpu), Err("is old")),
        ]
    }

    #[test]
    fn a_device_without_hardware_is_chosen_only_if_it_is_asked_for() {
        let candidates = candidates();
        assert_eq!(best(&candidates, None).unwrap(), (0, 1));
        assert_eq!(best(&candidates, Some("Null hardware")).unwrap(), (1, 2));
        assert_eq!(best(&candidates, Some("1")).unwrap(), (1, 2));
        let error = best(&candidates[1..], None).unwrap_err().to_string();
        assert!(error.contains("Null hardware (RADV NAVI21) has no hardware"), "{error}");
    }

    #[test]
    fn the_best_kind_of_device_is_chosen() {
        let mut candidates = candidates();
        candidates.push((device("a GPU", DeviceKind::IntegratedGpu), Ok(3)));
        assert_eq!(best(&candidates, None).unwrap(), (3, 3));
        assert_eq!(best(&candidates, Some("llvm")).unwrap(), (0, 1));
        let error = |wanted| best(&candidates, Some(wanted)).unwrap_err();
        assert!(matches!(error("old"), Error::NoDevice { found } if found == "old is old"));
        assert!(matches!(error("new"), Error::UnknownDevice { .. }));
    }
}
