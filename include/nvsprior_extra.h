/* nvsprior: what few programs need. A Vulkan device of yours, frames in DMA-BUFs, memory of yours, a list of devices,
 * counts of a link. The contract of nvsprior.h holds here, too.
 */

#ifndef NVSPRIOR_EXTRA_H
#define NVSPRIOR_EXTRA_H

#include "nvsprior.h"

#ifdef __cplusplus
extern "C" {
#endif

// ---- A Vulkan device of yours ----

// What VkInstance points to.
typedef struct VkInstance_T VkInstance_T;

// What VkPhysicalDevice points to.
typedef struct VkPhysicalDevice_T VkPhysicalDevice_T;

// What VkDevice points to.
typedef struct VkDevice_T VkDevice_T;

// What VkQueue points to.
typedef struct VkQueue_T VkQueue_T;

// PFN_vkVoidFunction.
typedef void (*nvsp_vulkan_function)(void);

// PFN_vkGetInstanceProcAddr.
typedef nvsp_vulkan_function (*nvsp_vulkan_loader)(struct VkInstance_T *instance, const char *name);

// Takes or gives back the lock of a queue. Called on any thread that is inside the library, and on the library's own;
// both on the same one. It must not call the library, and must not unwind.
typedef void (*nvsp_queue_callback)(void *user);

// A Vulkan device that you have made, for an engine to work on beside your own work. It needs Vulkan 1.2, the feature
// vulkanMemoryModel, and a queue that computes; no extensions. With the feature shaderInt64 CPU devices are faster. The
// types are those of Vulkan's own header. What an engine makes on the device is gone when the last handle made with it
// is destroyed. Until then keep instance and device; the library destroys neither. Example:
//
//     nvsp_vulkan vulkan = NVSP_INITIALIZER(nvsp_vulkan);
//     vulkan.get_instance_proc_addr = vkGetInstanceProcAddr;
//     vulkan.api_version = VK_API_VERSION_1_2;
//     vulkan.instance = instance;
//     vulkan.physical_device = physical_device;
//     vulkan.device = device;
//     vulkan.features = &features; // A VkPhysicalDeviceFeatures2, as it was VkDeviceCreateInfo.pNext.
//     vulkan.queue = queue;
//     vulkan.queue_family = family;
//     vulkan.lock_queue = lock;
//     vulkan.unlock_queue = unlock;
//     vulkan.queue_user = &mutex;
//     options.vulkan = &vulkan;
typedef struct nvsp_vulkan {
  uint32_t struct_size, abi_version;
  // vkGetInstanceProcAddr of your loader. The library finds all other functions through it. Not NULL.
  nvsp_vulkan_loader get_instance_proc_addr;
  struct VkInstance_T *instance; // A VkInstance. Not NULL.
  struct VkPhysicalDevice_T *physical_device; // A VkPhysicalDevice of it. Not NULL.
  struct VkDevice_T *device; // A VkDevice made of that. Not NULL.
  // A VkPhysicalDeviceFeatures2 with its chain: what VkDeviceCreateInfo.pNext was when the device was made. The library
  // reads shaderInt64 of it, and vulkanMemoryModel of a VkPhysicalDeviceVulkan12Features or a
  // VkPhysicalDeviceVulkanMemoryModelFeatures. Read during the call. Not NULL.
  const void *features;
  struct VkQueue_T *queue; // A VkQueue of the device. Not NULL.
  uint32_t queue_family; // The index of the queue's family.
  uint32_t api_version; // VkApplicationInfo.apiVersion of the instance, VK_API_VERSION_1_2 or newer.
  // Called before the library submits work to the queue, as Vulkan lets one thread at a time use a queue. It waits
  // until no other thread uses it. NULL: nobody else uses the queue until the last handle made with the engine is
  // destroyed.
  nvsp_queue_callback lock_queue;
  nvsp_queue_callback unlock_queue; // Called after it. NULL if `lock_queue` is.
  void *queue_user; // Passed to both as it is. What it points to must outlive every handle made with the engine.
} nvsp_vulkan;

// ---- Frames in DMA-BUFs ----

// A DMA-BUF that frames are read from; import each buffer of a camera's ring once. Example, for a frame of V4L2 in
// NV12, whose buffer VIDIOC_EXPBUF exported:
//
//     nvsp_dmabuf *buffer = NULL;
//     if (nvsp_dmabuf_import(engine, fd, 0, &buffer) != NVSP_OK) return 1;
//     nvsp_image image = NVSP_INITIALIZER(nvsp_image);
//     image.format = NVSP_FORMAT_NV12;
//     image.width = 1920;
//     image.height = 1080;
//     image.dmabufs[0] = buffer;
//     image.offsets[1] = 1080 * stride;
//     image.strides[0] = image.strides[1] = stride;
typedef struct nvsp_dmabuf nvsp_dmabuf;

// Imports a DMA-BUF, to read frames from it without a copy. The rows of its pixels lie one after the other
// (DRM_FORMAT_MOD_LINEAR, "pitch linear"). Surfaces in a layout of the hardware's own, such as NVIDIA's block-linear
// NVMM surfaces, must be converted first: on a Jetson nvvidconv or NvBufSurfTransform does it. The library maps the
// buffer for reading and keeps a copy of the descriptor. Needs no extension of the Vulkan device. Allocates.
// Fails with NVSP_ERR_ARGUMENT (the descriptor is not open, or of no DMA-BUF: memfd and files are none),
// NVSP_ERR_UNSUPPORTED (another modifier, or a buffer that the CPU may not read or map), or NVSP_ERR_MEMORY; the text
// is the engine's.
// - `engine`: a live engine, whose log and last error tell of failures.
// - `fd`: a file descriptor of the DMA-BUF. You may close it after the call.
// - `modifier`: the DRM format modifier of its pixels: 0, which is DRM_FORMAT_MOD_LINEAR. V4L2 has no modifiers: its
//   formats without a name of their own for a layout are linear.
// - `dmabuf`: receives the buffer, which nvsp_destroy ends.
NVSP_CHECKED nvsp_status nvsp_dmabuf_import(const struct nvsp_engine *engine, int32_t fd, uint64_t modifier,
    struct nvsp_dmabuf **dmabuf);

// ---- Memory of yours ----

// Gives `size` bytes at an address that is a multiple of `alignment`, a power of two; NULL: there are none. Called on
// any thread, on several at once. It must not call the library, and must not unwind.
typedef void *(*nvsp_allocate_callback)(void *user, size_t size, size_t alignment);

// Takes a block back that nvsp_allocate_callback gave, with the size and alignment that it was asked for.
typedef void (*nvsp_release_callback)(void *user, void *block, size_t size, size_t alignment);

// Sets the functions that the library takes host memory from, for the whole process. Call it before all other
// functions. You may call it again once all handles are destroyed. The Vulkan loader and driver take theirs as they do,
// and threads their stacks.
// Fails with NVSP_ERR_ARGUMENT (one callback without the other), or NVSP_ERR_STATE if the library holds memory.
// - `allocate`: gives memory. NULL: both callbacks are NULL, and the C library's functions are used.
// - `release`: takes it back.
// - `user`: passed to both as it is. What it points to must stay as long as the library is loaded.
NVSP_CHECKED nvsp_status nvsp_set_allocator(nvsp_allocate_callback allocate, nvsp_release_callback release,
    void *user);

// ---- The devices there are ----

#define NVSP_DEVICE_DISCRETE_GPU 1 // A graphics card with memory of its own.
#define NVSP_DEVICE_INTEGRATED_GPU 2 // A GPU that shares the host's memory.
#define NVSP_DEVICE_VIRTUAL_GPU 3 // A GPU of a virtual machine.
#define NVSP_DEVICE_CPU 4 // A driver that computes on the CPU.
#define NVSP_DEVICE_OTHER 5 // Any other device.

// A device that a driver offers.
typedef struct nvsp_device_info {
  uint32_t struct_size, abi_version;
  char name[256]; // Its name, ending in NUL; nvsp_engine_options.device takes it, a part of it, or its number as text.
  char driver[256]; // Name and version of its driver, ending in NUL.
  char unfit[128]; // Why it cannot run an engine, ending in NUL; empty if it can.
  uint32_t kind; // NVSP_DEVICE_*.
  uint32_t vulkan_major; // Vulkan version, first number.
  uint32_t vulkan_minor; // Vulkan version, second number.
  uint32_t reserved; // Zero.
  uint64_t memory; // Its largest heap of memory, bytes.
  uint64_t largest_buffer; // Its largest buffer, bytes.
} nvsp_device_info;

// Describes a device of the installed drivers, by its number, and tells how many there are. Each call asks the drivers
// anew, which takes milliseconds, and allocates. Any thread may call it.
// Fails with NVSP_ERR_MEMORY, NVSP_ERR_VULKAN, NVSP_ERR_NO_DEVICE if no driver is installed, or NVSP_ERR_ARGUMENT if no
// device has this number; `count` is written then, too.
// - `number`: the device's number, from 0.
// - `info`: receives the description. NULL: not wanted.
// - `count`: receives how many devices there are. NULL: not wanted.
NVSP_CHECKED nvsp_status nvsp_device_get_info(uint32_t number, struct nvsp_device_info *info, uint32_t *count);

// ---- Counts of both ends of a link ----

// Counts since the vehicle was made.
typedef struct nvsp_vehicle_statistics {
  uint32_t struct_size, abi_version;
  uint64_t left_out; // Frames for which the link had no bytes.
  uint64_t packets; // Packets taken.
  uint64_t cut; // Packets of them whose end was not sent.
  uint64_t shares; // Modem frames of them.
  uint64_t bytes; // Bytes of them on the link, the overhead of each counted.
  uint64_t waiting; // Modem frames that wait now.
  uint64_t resent; // Modem frames that were sent again.
  uint64_t foreign; // With keys: reports that no key has made.
  uint64_t replayed; // With keys: reports that came a second time.
  double loss; // The loss that packets are protected against now.
  double burst; // And the mean length of its bursts, modem frames.
  double bit_rate; // The bit rate now, bit/s.
} nvsp_vehicle_statistics;

// Copies the counts of a vehicle.
// - `statistics`: receives the counts.
NVSP_CHECKED nvsp_status nvsp_vehicle_get_statistics(struct nvsp_vehicle *vehicle,
    struct nvsp_vehicle_statistics *statistics);

// Counts since the topside was made. A packet has gone by once a newer one took its place, or it is stale.
typedef struct nvsp_topside_statistics {
  uint32_t struct_size, abi_version;
  uint64_t accepted; // Modem frames that were not there before.
  uint64_t duplicates; // Modem frames that were.
  // Those that were none of a packet, damaged, of packets long past, and those of unprotected packets whose first one
  // did not come.
  uint64_t rejected;
  uint64_t arrived; // Those that packets gone by had.
  // Those that they were sent in: 1 - arrived / sent is the loss. Packets of which nothing came do not count, as a
  // frame that was left out looks the same; nor unprotected ones whose length did not come.
  uint64_t sent;
  uint64_t completed; // Packets that became complete.
  uint64_t repaired; // Packets gone by that were complete although modem frames of them were missing.
  uint64_t partial; // Packets gone by that yielded a picture, but not all of it.
  uint64_t lost; // Packets gone by that yielded no picture, and frame numbers of which nothing came.
  uint64_t damaged; // Packets whose own checks did not match what their modem frames held.
  uint64_t waiting; // Modem frames of unprotected packets that now wait for the first one of their packet.
  uint64_t foreign; // With keys: modem frames that no key has made. They count nowhere else.
  uint64_t replayed; // With keys: modem frames that came a second time. They count nowhere else.
} nvsp_topside_statistics;

// Copies the counts of a topside.
// - `statistics`: receives the counts.
NVSP_CHECKED nvsp_status nvsp_topside_get_statistics(struct nvsp_topside *topside,
    struct nvsp_topside_statistics *statistics);

#ifdef __cplusplus
} /* extern "C" */
#endif

#endif /* NVSPRIOR_EXTRA_H */
