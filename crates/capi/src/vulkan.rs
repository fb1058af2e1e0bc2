//! A Vulkan device that the caller has made.

use std::ffi::{c_char, c_void};
use std::sync::Arc;

use ash::vk::{self, Handle as _};

use nvsprior::vulkan::{DeviceHandles, EnabledFeatures, GivenDevice, QueueLock};

use super::status::*;
use super::structs::{In, User, versioned};

/// What VkInstance points to.
pub struct VkInstance_T {
    _opaque: [u8; 0],
}

/// What VkPhysicalDevice points to.
pub struct VkPhysicalDevice_T {
    _opaque: [u8; 0],
}

/// What VkDevice points to.
pub struct VkDevice_T {
    _opaque: [u8; 0],
}

/// What VkQueue points to.
pub struct VkQueue_T {
    _opaque: [u8; 0],
}

/// PFN_vkVoidFunction.
pub type nvsp_vulkan_function = Option<unsafe extern "C" fn()>;

/// PFN_vkGetInstanceProcAddr.
pub type nvsp_vulkan_loader = Option<
    unsafe extern "C" fn(instance: *mut VkInstance_T, name: *const c_char) -> nvsp_vulkan_function,
>;

/// Takes or gives back the lock of a queue. Called on any thread that is inside the library, and on the library's own;
/// both on the same one. It must not call the library, and must not unwind.
pub type nvsp_queue_callback = Option<unsafe extern "C" fn(user: *mut c_void)>;

/// A Vulkan device that you have made, for an engine to work on beside your own work. It needs Vulkan 1.2, the feature
/// vulkanMemoryModel, and a queue that computes; no extensions. With the feature shaderInt64 CPU devices are faster.
/// The types are those of Vulkan's own header. What an engine makes on the device is gone when the last handle made
/// with it is destroyed. Until then keep instance and device; the library destroys neither. Example:
///
/// ```c
/// nvsp_vulkan vulkan = NVSP_INITIALIZER(nvsp_vulkan);
/// vulkan.get_instance_proc_addr = vkGetInstanceProcAddr;
/// vulkan.api_version = VK_API_VERSION_1_2;
/// vulkan.instance = instance;
/// vulkan.physical_device = physical_device;
/// vulkan.device = device;
/// vulkan.features = &features; // A VkPhysicalDeviceFeatures2, as it was VkDeviceCreateInfo.pNext.
/// vulkan.queue = queue;
/// vulkan.queue_family = family;
/// vulkan.lock_queue = lock;
/// vulkan.unlock_queue = unlock;
/// vulkan.queue_user = &mutex;
/// options.vulkan = &vulkan;
/// ```
#[repr(C)]
#[derive(Clone, Copy)]
pub struct nvsp_vulkan {
    pub struct_size: u32,
    pub abi_version: u32,
    /// vkGetInstanceProcAddr of your loader. The library finds all other functions through it. Not NULL.
    pub get_instance_proc_addr: nvsp_vulkan_loader,
    /// A VkInstance. Not NULL.
    pub instance: *mut VkInstance_T,
    /// A VkPhysicalDevice of it. Not NULL.
    pub physical_device: *mut VkPhysicalDevice_T,
    /// A VkDevice made of that. Not NULL.
    pub device: *mut VkDevice_T,
    /// A VkPhysicalDeviceFeatures2 with its chain: what VkDeviceCreateInfo.pNext was when the device was made. The
    /// library reads shaderInt64 of it, and vulkanMemoryModel of a VkPhysicalDeviceVulkan12Features or a
    /// VkPhysicalDeviceVulkanMemoryModelFeatures. Read during the call. Not NULL.
    pub features: *const c_void,
    /// A VkQueue of the device. Not NULL.
    pub queue: *mut VkQueue_T,
    /// The index of the queue's family.
    pub queue_family: u32,
    /// VkApplicationInfo.apiVersion of the instance, VK_API_VERSION_1_2 or newer.
    pub api_version: u32,
    /// Called before the library submits work to the queue, as Vulkan lets one thread at a time use a queue. It waits
    /// until no other thread uses it. NULL: nobody else uses the queue until the last handle made with the engine is
    /// destroyed.
    pub lock_queue: nvsp_queue_callback,
    /// Called after it. NULL if `lock_queue` is.
    pub unlock_queue: nvsp_queue_callback,
    /// Passed to both as it is. What it points to must outlive every handle made with the engine.
    pub queue_user: *mut c_void,
}
versioned!(nvsp_vulkan, 88);

/// What [`nvsp_vulkan_loader`] is if it is not NULL.
type Loader = unsafe extern "C" fn(*mut VkInstance_T, *const c_char) -> nvsp_vulkan_function;

/// The caller's lock of a queue.
struct Callbacks {
    lock: unsafe extern "C" fn(*mut c_void),
    unlock: unsafe extern "C" fn(*mut c_void),
    user: User,
}

impl QueueLock for Callbacks {
    fn lock(&self) {
        // SAFETY: the header asks for a callback that takes the pointer it came with.
        unsafe { (self.lock)(self.user.0) }
    }

    fn unlock(&self) {
        // SAFETY: as for `lock`.
        unsafe { (self.unlock)(self.user.0) }
    }
}

/// Reads a device of the caller's; NULL is none.
pub(super) fn given(vulkan: In<nvsp_vulkan>) -> Result<Option<GivenDevice>, Failure> {
    let Some(vulkan) = vulkan.optional()? else { return Ok(None) };
    let Some(loader) = vulkan.get_instance_proc_addr else {
        return Err(Failure::null("nvsp_vulkan.get_instance_proc_addr"));
    };
    for (null, field) in [
        (vulkan.instance.is_null(), "nvsp_vulkan.instance"),
        (vulkan.physical_device.is_null(), "nvsp_vulkan.physical_device"),
        (vulkan.device.is_null(), "nvsp_vulkan.device"),
        (vulkan.features.is_null(), "nvsp_vulkan.features"),
        (vulkan.queue.is_null(), "nvsp_vulkan.queue"),
    ] {
        if null {
            return Err(Failure::null(field));
        }
    }
    let lock: Option<Arc<dyn QueueLock>> = match (vulkan.lock_queue, vulkan.unlock_queue) {
        (Some(lock), Some(unlock)) => {
            Some(Arc::new(Callbacks { lock, unlock, user: User(vulkan.queue_user) }))
        }
        (None, None) => None,
        _ => {
            return Err(Failure::argument(
                "nvsp_vulkan: one of lock_queue and unlock_queue is NULL",
            ));
        }
    };
    let features = vulkan.features.cast::<vk::PhysicalDeviceFeatures2>();
    // SAFETY: every structure of Vulkan begins with its type, and the header asks for one in this field.
    if unsafe { (*features).s_type } != vk::StructureType::PHYSICAL_DEVICE_FEATURES_2 {
        return Err(Failure::argument("nvsp_vulkan.features: no VkPhysicalDeviceFeatures2"));
    }
    // SAFETY: the header asks for handles that belong together, and for the chain that the device was made with. A
    // loader's function has the same type here and there: the system's own calling convention is C's.
    unsafe {
        let handles = DeviceHandles {
            get_instance_proc_addr: std::mem::transmute::<Loader, vk::PFN_vkGetInstanceProcAddr>(
                loader,
            ),
            api_version: vulkan.api_version,
            instance: vk::Instance::from_raw(vulkan.instance as u64),
            physical_device: vk::PhysicalDevice::from_raw(vulkan.physical_device as u64),
            device: vk::Device::from_raw(vulkan.device as u64),
            queue: vk::Queue::from_raw(vulkan.queue as u64),
            queue_family: vulkan.queue_family,
            features: EnabledFeatures::of(&*features),
        };
        Ok(Some(GivenDevice::new(handles, lock)))
    }
}
