//! A device that the program has made for itself, for the engine to work on.

use std::ffi::CStr;
use std::fmt;
use std::sync::Arc;

use ash::{Entry, vk};

use super::Error;
use super::instance::{Instance, Opened};

/// Guards a queue that the program uses, too: Vulkan lets one thread at a time use a queue.
pub trait QueueLock: Send + Sync {
    /// Waits until no other thread uses the queue. Called before each submission.
    fn lock(&self);
    /// Lets the others go on. Called after it, on the same thread.
    fn unlock(&self);
}

/// Handles of a device that the program has made, and what it made it with.
#[derive(Clone, Copy)]
pub struct DeviceHandles {
    /// The loader's function, through which all others are found.
    pub get_instance_proc_addr: vk::PFN_vkGetInstanceProcAddr,
    /// `VkApplicationInfo::apiVersion` of the instance: 1.2 or newer.
    pub api_version: u32,
    /// The instance.
    pub instance: vk::Instance,
    /// The instance's physical device.
    pub physical_device: vk::PhysicalDevice,
    /// The device that was made of it.
    pub device: vk::Device,
    /// A queue of the device.
    pub queue: vk::Queue,
    /// The queue's family, which must compute.
    pub queue_family: u32,
    /// Features that were enabled.
    pub features: EnabledFeatures,
}

/// Features of a device that matter here.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EnabledFeatures {
    /// `vulkanMemoryModel`, which is required.
    pub vulkan_memory_model: bool,
    /// `shaderInt64`, which makes CPU devices faster.
    pub shader_int64: bool,
    /// `subgroupSizeControl` and `computeFullSubgroups`, which make GPUs faster.
    pub full_subgroups: bool,
}

impl EnabledFeatures {
    /// Reads the chain that `VkDeviceCreateInfo::pNext` had.
    ///
    /// # Safety
    /// The chain is one of valid structures.
    pub unsafe fn of(features: &vk::PhysicalDeviceFeatures2) -> EnabledFeatures {
        let mut enabled = EnabledFeatures {
            shader_int64: features.features.shader_int64 == vk::TRUE,
            ..Default::default()
        };
        let mut next = features.p_next.cast::<vk::BaseInStructure>().cast_const();
        // SAFETY: as the caller promises: each structure is of its type, or the chain's end.
        while let Some(structure) = unsafe { next.as_ref() } {
            // SAFETY: as above.
            enabled.full_subgroups |= unsafe {
                match structure.s_type {
                    vk::StructureType::PHYSICAL_DEVICE_VULKAN_1_3_FEATURES => {
                        let f = &*next.cast::<vk::PhysicalDeviceVulkan13Features>();
                        f.subgroup_size_control & f.compute_full_subgroups
                    }
                    vk::StructureType::PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_FEATURES => {
                        let f = &*next.cast::<vk::PhysicalDeviceSubgroupSizeControlFeatures>();
                        f.subgroup_size_control & f.compute_full_subgroups
                    }
                    _ => vk::FALSE,
                }
            } == vk::TRUE;
            // SAFETY: as above.
            enabled.vulkan_memory_model |= unsafe {
                match structure.s_type {
                    vk::StructureType::PHYSICAL_DEVICE_VULKAN_1_2_FEATURES => {
                        (*next.cast::<vk::PhysicalDeviceVulkan12Features>()).vulkan_memory_model
                    }
                    vk::StructureType::PHYSICAL_DEVICE_VULKAN_MEMORY_MODEL_FEATURES => {
                        (*next.cast::<vk::PhysicalDeviceVulkanMemoryModelFeatures>())
                            .vulkan_memory_model
                    }
                    _ => vk::FALSE,
                }
            } == vk::TRUE;
            next = structure.p_next;
        }
        enabled
    }
}

/// A device that the program has made, for [`DeviceOptions::given`](super::DeviceOptions::given). Nothing of it is
/// destroyed here.
#[derive(Clone)]
pub struct GivenDevice {
    handles: DeviceHandles,
    pub(super) lock: Option<Arc<dyn QueueLock>>,
}

impl fmt::Debug for GivenDevice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let DeviceHandles { device, queue, queue_family, .. } = self.handles;
        let locked = self.lock.is_some();
        write!(f, "GivenDevice {{ {device:?}, {queue:?}, {queue_family}, locked: {locked} }}")
    }
}

/// What finds out whether the instance is of Vulkan 1.1 at least: `ash` panics if a function is called that is missing.
const FUNCTIONS: [&CStr; 5] = [
    c"vkEnumerateDeviceExtensionProperties",
    c"vkGetPhysicalDeviceProperties2",
    c"vkGetPhysicalDeviceFeatures2",
    c"vkGetPhysicalDeviceQueueFamilyProperties",
    c"vkGetDeviceProcAddr",
];

impl GivenDevice {
    /// Takes handles, and what guards the queue. Without a lock nothing else may use the queue.
    ///
    /// # Safety
    /// The handles are valid and belong together. They stay valid as long as this, a clone of it, or anything made on
    /// the device lives. The features are those that the device was made with.
    pub unsafe fn new(handles: DeviceHandles, lock: Option<Arc<dyn QueueLock>>) -> GivenDevice {
        GivenDevice { handles, lock }
    }

    /// Checks that the engine can work on it.
    pub(super) fn open(&self) -> Result<Opened, Error> {
        let unfit = |reason: String| Error::GivenDevice { reason };
        let DeviceHandles { physical_device: physical, queue_family, features, .. } = self.handles;
        if self.handles.api_version < vk::API_VERSION_1_2 {
            let version = self.handles.api_version;
            let (major, minor) = (vk::api_version_major(version), vk::api_version_minor(version));
            return Err(unfit(format!(
                "its instance is for Vulkan {major}.{minor}, 1.2 is needed"
            )));
        }
        let instance = self.instance()?;
        if !instance.devices()?.contains(&physical) {
            return Err(unfit("the physical device is none of the instance's".into()));
        }
        let mut info = instance.describe(physical);
        let lacks = |reason| unfit(format!("{} {reason}", info.name));
        instance.queue_family(physical).map_err(lacks)?;
        if !features.vulkan_memory_model {
            return Err(unfit("it was made without the feature vulkanMemoryModel".into()));
        }
        info.int64 &= features.shader_int64;
        info.wave = info.wave.filter(|_| features.full_subgroups);
        // SAFETY: a physical device of this instance.
        let families =
            unsafe { instance.instance.get_physical_device_queue_family_properties(physical) };
        let Some(family) = families.get(queue_family as usize) else {
            let count = families.len();
            return Err(unfit(format!("queue family {queue_family}: there are {count}")));
        };
        if !family.queue_flags.contains(vk::QueueFlags::COMPUTE) {
            return Err(unfit(format!("queue family {queue_family} does not compute")));
        }
        // SAFETY: a device of this instance, whose vkGetDeviceProcAddr was found.
        let device = unsafe { ash::Device::load(instance.instance.fp_v1_0(), self.handles.device) };
        let queue = self.handles.queue;
        Ok(Opened { instance, physical, device, queue, queue_family, info, inspected: false })
    }

    /// The instance with its functions.
    fn instance(&self) -> Result<Instance, Error> {
        let DeviceHandles { get_instance_proc_addr, instance, .. } = self.handles;
        for name in FUNCTIONS {
            // SAFETY: a valid instance, and a name that ends in NUL.
            if unsafe { get_instance_proc_addr(instance, name.as_ptr()) }.is_none() {
                let reason = format!("its instance has no {}", name.to_string_lossy());
                return Err(Error::GivenDevice { reason });
            }
        }
        // SAFETY: the loader's function, and an instance of that loader.
        unsafe {
            let functions = ash::StaticFn { get_instance_proc_addr };
            let instance = ash::Instance::load(&functions, instance);
            Ok(Instance::given(Entry::from_static_fn(functions), instance))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn features_are_found_anywhere_in_the_chain() {
        let mut model =
            vk::PhysicalDeviceVulkanMemoryModelFeatures::default().vulkan_memory_model(true);
        let mut other = vk::PhysicalDevice16BitStorageFeatures::default();
        let features = vk::PhysicalDeviceFeatures2::default()
            .features(vk::PhysicalDeviceFeatures::default().shader_int64(true))
            .push_next(&mut model)
            .push_next(&mut other);
        let mut control = vk::PhysicalDeviceSubgroupSizeControlFeatures::default()
            .subgroup_size_control(true)
            .compute_full_subgroups(true);
        let features = features.push_next(&mut control);
        let all =
            EnabledFeatures { vulkan_memory_model: true, shader_int64: true, full_subgroups: true };
        // SAFETY: chains of valid structures.
        unsafe {
            assert_eq!(EnabledFeatures::of(&features), all);
            let mut vulkan12 =
                vk::PhysicalDeviceVulkan12Features::default().vulkan_memory_model(true);
            let features = vk::PhysicalDeviceFeatures2::default().push_next(&mut vulkan12);
            assert!(EnabledFeatures::of(&features).vulkan_memory_model);
            let mut vulkan13 =
                vk::PhysicalDeviceVulkan13Features::default().subgroup_size_control(true);
            let features = vk::PhysicalDeviceFeatures2::default().push_next(&mut vulkan13);
            assert!(!EnabledFeatures::of(&features).full_subgroups, "they need not be full");
            let none = vk::PhysicalDeviceFeatures2::default();
            assert_eq!(EnabledFeatures::of(&none), EnabledFeatures::default());
        }
    }
}
