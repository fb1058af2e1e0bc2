// An engine on a device that the program has made: the same packets and pictures as with a device of its own, while
// another thread submits work to the same queue; and devices that do not fit.

#define _GNU_SOURCE

#include "common.h"

#include <nvsprior_extra.h>
#include <pthread.h>
#include <stdatomic.h>
#include <vulkan/vulkan.h>

#define VULKAN(call) check((call) == VK_SUCCESS, #call, __FILE__, __LINE__)
#define LAYER "VK_LAYER_KHRONOS_validation"

// The program's own device.
static struct {
    VkInstance instance;
    VkDebugUtilsMessengerEXT messenger;
    VkPhysicalDevice physical;
    VkDevice device;
    VkQueue queue;
    uint32_t family;
    VkPhysicalDeviceVulkan12Features vulkan12;
    VkPhysicalDeviceFeatures2 features;
} own;

static int validated;
static atomic_int complaints;

// The lock of the queue.
static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
static atomic_int held, locks, overlaps;

static void lock_queue(void *user) {
    CHECK(user == &own);
    pthread_mutex_lock(&mutex);
    overlaps += atomic_fetch_add(&held, 1) != 0;
    locks++;
}

static void unlock_queue(void *user) {
    CHECK(user == &own);
    overlaps += atomic_fetch_sub(&held, 1) != 1;
    pthread_mutex_unlock(&mutex);
}

static VKAPI_ATTR VkBool32 VKAPI_CALL complain(VkDebugUtilsMessageSeverityFlagBitsEXT severity,
                                               VkDebugUtilsMessageTypeFlagsEXT type,
                                               const VkDebugUtilsMessengerCallbackDataEXT *data, void *user) {
    (void)severity, (void)type, (void)user;
    // The first few: a fault may come with each frame.
    if (complaints++ < 5) {
        fprintf(stderr, "%s\n", data->pMessage);
    }
    return VK_FALSE;
}

static int has_layer(void) {
    VkLayerProperties layers[64];
    uint32_t count = 64;
    const VkResult result = vkEnumerateInstanceLayerProperties(&count, layers);
    for (uint32_t i = 0; (result == VK_SUCCESS || result == VK_INCOMPLETE) && i < count; i++) {
        if (strcmp(layers[i].layerName, LAYER) == 0) {
            return 1;
        }
    }
    return 0;
}

static void make_instance(void) {
    const char *const layer = LAYER, *const extension = VK_EXT_DEBUG_UTILS_EXTENSION_NAME;
    validated = has_layer();
    const VkApplicationInfo application = {
        .sType = VK_STRUCTURE_TYPE_APPLICATION_INFO, .apiVersion = VK_API_VERSION_1_2};
    const VkDebugUtilsMessengerCreateInfoEXT messenger = {
        .sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT,
        .messageSeverity = VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT
                           | VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT,
        .messageType = VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT
                       | VK_DEBUG_UTILS_MESSAGE_TYPE_PERFORMANCE_BIT_EXT,
        .pfnUserCallback = complain};
    const VkInstanceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO,
                                       .pApplicationInfo = &application,
                                       .enabledLayerCount = (uint32_t)validated,
                                       .ppEnabledLayerNames = &layer,
                                       .enabledExtensionCount = (uint32_t)validated,
                                       .ppEnabledExtensionNames = &extension};
    if (vkCreateInstance(&info, NULL, &own.instance) != VK_SUCCESS) {
        give_up("vkCreateInstance");
    }
    if (validated) {
        const PFN_vkCreateDebugUtilsMessengerEXT create = (PFN_vkCreateDebugUtilsMessengerEXT)
            vkGetInstanceProcAddr(own.instance, "vkCreateDebugUtilsMessengerEXT");
        VULKAN(create(own.instance, &messenger, NULL, &own.messenger));
    }
}

// The physical device that an engine would take by itself, so that the packets are the same.
static void choose_device(void) {
    VkPhysicalDevice all[16];
    uint32_t count = 16;
    int best = 99;
    const int order[] = {[VK_PHYSICAL_DEVICE_TYPE_OTHER] = 4,         [VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU] = 1,
                         [VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU] = 0,  [VK_PHYSICAL_DEVICE_TYPE_VIRTUAL_GPU] = 2,
                         [VK_PHYSICAL_DEVICE_TYPE_CPU] = 3};
    VULKAN(vkEnumeratePhysicalDevices(own.instance, &count, all));
    for (uint32_t i = 0; i < count; i++) {
        VkPhysicalDeviceProperties properties;
        vkGetPhysicalDeviceProperties(all[i], &properties);
        if (order[properties.deviceType] < best) {
            best = order[properties.deviceType];
            own.physical = all[i];
        }
    }
    VkQueueFamilyProperties families[16];
    count = 16;
    vkGetPhysicalDeviceQueueFamilyProperties(own.physical, &count, families);
    for (own.family = 0; own.family < count; own.family++) {
        if (families[own.family].queueFlags & VK_QUEUE_COMPUTE_BIT) {
            return;
        }
    }
    give_up("no device that computes");
}

// A device with one queue of the family that computes, and such features.
static VkDevice make_device(VkBool32 memory_model, VkBool32 int64) {
    own.vulkan12 = (VkPhysicalDeviceVulkan12Features){
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES, .vulkanMemoryModel = memory_model};
    own.features = (VkPhysicalDeviceFeatures2){.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2,
                                               .pNext = &own.vulkan12,
                                               .features = {.shaderInt64 = int64}};
    const float priority = 1;
    const VkDeviceQueueCreateInfo queue = {.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO,
                                           .queueFamilyIndex = own.family,
                                           .queueCount = 1,
                                           .pQueuePriorities = &priority};
    const VkDeviceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO,
                                     .pNext = &own.features,
                                     .queueCreateInfoCount = 1,
                                     .pQueueCreateInfos = &queue};
    VkDevice device = VK_NULL_HANDLE;
    if (vkCreateDevice(own.physical, &info, NULL, &device) != VK_SUCCESS) {
        give_up("vkCreateDevice");
    }
    vkGetDeviceQueue(device, own.family, 0, &own.queue);
    return device;
}

static nvsp_vulkan given(void) {
    nvsp_vulkan vulkan = NVSP_INITIALIZER(nvsp_vulkan);
    vulkan.get_instance_proc_addr = vkGetInstanceProcAddr;
    vulkan.api_version = VK_API_VERSION_1_2;
    vulkan.instance = own.instance;
    vulkan.physical_device = own.physical;
    vulkan.device = own.device;
    vulkan.features = &own.features;
    vulkan.queue = own.queue;
    vulkan.queue_family = own.family;
    vulkan.lock_queue = lock_queue;
    vulkan.unlock_queue = unlock_queue;
    vulkan.queue_user = &own;
    return vulkan;
}

// The program's own work: fills a buffer with a number, and looks whether it is there.
typedef struct work {
    VkBuffer buffer;
    VkDeviceMemory memory;
    VkCommandPool pool;
    VkCommandBuffer commands;
    VkFence fence;
    const uint32_t *words;
    uint32_t number;
} work;

#define WORDS 4096

static void start_work(work *work) {
    const VkBufferCreateInfo buffer = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                                       .size = 4 * WORDS,
                                       .usage = VK_BUFFER_USAGE_TRANSFER_DST_BIT};
    VULKAN(vkCreateBuffer(own.device, &buffer, NULL, &work->buffer));
    VkMemoryRequirements needs;
    vkGetBufferMemoryRequirements(own.device, work->buffer, &needs);
    VkPhysicalDeviceMemoryProperties memories;
    vkGetPhysicalDeviceMemoryProperties(own.physical, &memories);
    const VkMemoryPropertyFlags wanted =
        VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    uint32_t type = 0;
    while (!(needs.memoryTypeBits & 1u << type) || (memories.memoryTypes[type].propertyFlags & wanted) != wanted) {
        type++;
    }
    const VkMemoryAllocateInfo memory = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO,
                                         .allocationSize = needs.size,
                                         .memoryTypeIndex = type};
    VULKAN(vkAllocateMemory(own.device, &memory, NULL, &work->memory));
    VULKAN(vkBindBufferMemory(own.device, work->buffer, work->memory, 0));
    void *mapped = NULL;
    VULKAN(vkMapMemory(own.device, work->memory, 0, VK_WHOLE_SIZE, 0, &mapped));
    work->words = mapped;
    const VkCommandPoolCreateInfo pool = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO,
                                          .flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT,
                                          .queueFamilyIndex = own.family};
    VULKAN(vkCreateCommandPool(own.device, &pool, NULL, &work->pool));
    const VkCommandBufferAllocateInfo commands = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
                                                  .commandPool = work->pool,
                                                  .commandBufferCount = 1};
    VULKAN(vkAllocateCommandBuffers(own.device, &commands, &work->commands));
    const VkFenceCreateInfo fence = {.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
    VULKAN(vkCreateFence(own.device, &fence, NULL, &work->fence));
}

static void do_work(work *work) {
    const uint32_t number = ++work->number * 2654435761u;
    const VkCommandBufferBeginInfo begin = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
    const VkMemoryBarrier barrier = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                                     .srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT,
                                     .dstAccessMask = VK_ACCESS_HOST_READ_BIT};
    VULKAN(vkBeginCommandBuffer(work->commands, &begin));
    vkCmdFillBuffer(work->commands, work->buffer, 0, VK_WHOLE_SIZE, number);
    vkCmdPipelineBarrier(work->commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &barrier, 0,
                         NULL, 0, NULL);
    VULKAN(vkEndCommandBuffer(work->commands));
    const VkSubmitInfo submit = {.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO,
                                 .commandBufferCount = 1,
                                 .pCommandBuffers = &work->commands};
    lock_queue(&own);
    VULKAN(vkQueueSubmit(own.queue, 1, &submit, work->fence));
    unlock_queue(&own);
    VULKAN(vkWaitForFences(own.device, 1, &work->fence, VK_TRUE, UINT64_MAX));
    VULKAN(vkResetFences(own.device, 1, &work->fence));
    CHECK(work->words[0] == number && work->words[WORDS - 1] == number);
}

static void end_work(work *work) {
    vkDestroyFence(own.device, work->fence, NULL);
    vkDestroyCommandPool(own.device, work->pool, NULL);
    vkDestroyBuffer(own.device, work->buffer, NULL);
    vkFreeMemory(own.device, work->memory, NULL);
}

static atomic_int stop, rounds;

static void *beside(void *unused) {
    work work = {0};
    start_work(&work);
    while (!stop) {
        do_work(&work);
        rounds++;
    }
    end_work(&work);
    return unused;
}

// Encodes and decodes the scene, and compares with what another engine gave.
static void whole_way(rig *rig, const packet *expected, const uint8_t *shown) {
    packet found[MAX_FRAMES];
    encode_all(rig, &dive, found);
    uint8_t *pixels = malloc(dive.size);
    for (int i = 0; i < dive.frames; i++) {
        CHECK(found[i].size == expected[i].size && memcmp(found[i].bytes, expected[i].bytes, found[i].size) == 0);
        nvsp_picture place = place_of(pixels, dive.camera.width, dive.camera.height);
        EXPECT(NVSP_OK, nvsp_decode(rig->decoder, found[i].bytes, found[i].size, 0, &place, NULL));
        CHECK(memcmp(pixels, shown + (size_t)i * dive.size, dive.size) == 0);
        free(found[i].bytes);
    }
    free(pixels);
}

static void on_own_device(const packet *expected, const uint8_t *shown, VkBool32 int64, int locked) {
    own.device = make_device(VK_TRUE, int64);
    const int complaints_before = complaints;
    nvsp_vulkan vulkan = given();
    if (!locked) {
        vulkan.lock_queue = NULL;
        vulkan.unlock_queue = NULL;
    }
    nvsp_engine_options options = patient_options();
    options.vulkan = &vulkan;
    MUST(nvsp_engine_create(&options, &both.engine));
    // The structure and what it points to are the caller's again.
    memset(&vulkan, 0xa5, sizeof vulkan);
    const VkPhysicalDeviceFeatures2 features = own.features;
    memset(&own.features, 0xa5, sizeof own.features);
    EXPECT(NVSP_ERR_UNSUPPORTED, nvsp_engine_reopen(both.engine));
    MUST(nvsp_prior_open(both.engine, dive.prior, NULL, &both.prior));
    rig_add(&both, &dive.camera, NULL);
    pthread_t thread;
    locks = rounds = stop = 0;
    if (locked && pthread_create(&thread, NULL, beside, NULL) != 0) {
        give_up("no thread");
    }
    // The engine's own handle goes first: the others keep what they need.
    nvsp_destroy(both.engine);
    both.engine = NULL;
    whole_way(&both, expected, shown);
    stop = 1;
    if (locked) {
        pthread_join(thread, NULL);
        CHECK(rounds > 0 && locks > rounds && overlaps == 0);
        printf("%d submissions of the library, %d of the program beside them\n", locks - rounds, (int)rounds);
    }
    rig_close(&both);
    own.features = features;
    // The device goes on to work.
    work after = {0};
    start_work(&after);
    do_work(&after);
    end_work(&after);
    VULKAN(vkDeviceWaitIdle(own.device));
    // With validation on, this complains of everything that the library has left.
    vkDestroyDevice(own.device, NULL);
    own.device = VK_NULL_HANDLE;
    CHECK(complaints == complaints_before);
}

static char said[1000];

static void keep(void *user, int32_t level, const char *text) {
    (void)user;
    if (level == NVSP_LOG_ERROR) {
        snprintf(said, sizeof said, "%s", text);
    }
}

static void refused(nvsp_status status, const nvsp_vulkan *vulkan, const char *named) {
    nvsp_engine_options options = NVSP_INITIALIZER(nvsp_engine_options);
    nvsp_engine *engine = NULL;
    options.vulkan = vulkan;
    options.log = keep;
    said[0] = 0;
    EXPECT(status, nvsp_engine_create(&options, &engine));
    if (!CHECK(engine == NULL && strstr(said, named) != NULL)) {
        fprintf(stderr, "%s: %s\n", named, said);
    }
}

// A loader whose instance is of Vulkan 1.0.
static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL old_loader(VkInstance instance, const char *name) {
    return strstr(name, "2") != NULL ? NULL : vkGetInstanceProcAddr(instance, name);
}

// Queue families as many GPUs have them: a second one that only copies.
static VKAPI_ATTR void VKAPI_CALL two_families(VkPhysicalDevice physical, uint32_t *count,
                                               VkQueueFamilyProperties *families) {
    if (families == NULL) {
        vkGetPhysicalDeviceQueueFamilyProperties(physical, count, NULL);
        ++*count;
        return;
    }
    --*count;
    vkGetPhysicalDeviceQueueFamilyProperties(physical, count, families);
    families[*count] = families[0];
    families[*count].queueFlags = VK_QUEUE_TRANSFER_BIT;
    ++*count;
}

static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL loader_of_two(VkInstance instance, const char *name) {
    return strcmp(name, "vkGetPhysicalDeviceQueueFamilyProperties") == 0 ? (PFN_vkVoidFunction)two_families
                                                                         : vkGetInstanceProcAddr(instance, name);
}

static void what_does_not_fit(void) {
    own.device = make_device(VK_TRUE, VK_TRUE);
    const nvsp_vulkan valid = given();
    nvsp_vulkan wrong;
#define WITHOUT(field) \
    wrong = valid; \
    wrong.field = NULL; \
    refused(NVSP_ERR_ARGUMENT, &wrong, "nvsp_vulkan." #field)
    WITHOUT(get_instance_proc_addr);
    WITHOUT(instance);
    WITHOUT(physical_device);
    WITHOUT(device);
    WITHOUT(features);
    WITHOUT(queue);
    wrong = valid;
    wrong.lock_queue = NULL;
    refused(NVSP_ERR_ARGUMENT, &wrong, "lock_queue");
    wrong = valid;
    wrong.unlock_queue = NULL;
    refused(NVSP_ERR_ARGUMENT, &wrong, "unlock_queue");
    wrong = valid;
    wrong.features = &own.vulkan12;
    refused(NVSP_ERR_ARGUMENT, &wrong, "VkPhysicalDeviceFeatures2");
    wrong = valid;
    wrong.api_version = VK_API_VERSION_1_1;
    refused(NVSP_ERR_NO_DEVICE, &wrong, "Vulkan 1.1");
    wrong.api_version = 0;
    refused(NVSP_ERR_NO_DEVICE, &wrong, "1.2 is needed");
    wrong = valid;
    wrong.get_instance_proc_addr = old_loader;
    refused(NVSP_ERR_NO_DEVICE, &wrong, "vkGetPhysicalDeviceProperties2");
    wrong = valid;
    wrong.queue_family = 77;
    refused(NVSP_ERR_NO_DEVICE, &wrong, "queue family 77");
    VkQueueFamilyProperties families[16];
    uint32_t count = 16;
    vkGetPhysicalDeviceQueueFamilyProperties(own.physical, &count, families);
    wrong = valid;
    wrong.get_instance_proc_addr = loader_of_two;
    wrong.queue_family = count;
    refused(NVSP_ERR_NO_DEVICE, &wrong, "does not compute");
    wrong = valid;
    wrong.struct_size = 8;
    nvsp_engine_options options = NVSP_INITIALIZER(nvsp_engine_options);
    nvsp_engine *engine = NULL;
    options.vulkan = &wrong;
    EXPECT(NVSP_ERR_STRUCTURE, nvsp_engine_create(&options, &engine));
    // Fields that exclude each other.
    options.vulkan = &valid;
    options.device = "0";
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_engine_create(&options, &engine));
    options.device = NULL;
    options.flags = NVSP_ENGINE_VALIDATION;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_engine_create(&options, &engine));
    CHECK(engine == NULL);
    vkDestroyDevice(own.device, NULL);
    // A device made without what is needed.
    own.device = make_device(VK_FALSE, VK_TRUE);
    const nvsp_vulkan poor = given();
    refused(NVSP_ERR_NO_DEVICE, &poor, "vulkanMemoryModel");
    // The device that the program made is whole.
    VULKAN(vkDeviceWaitIdle(own.device));
    vkDestroyDevice(own.device, NULL);
}

int main(int argc, char **argv) {
    set_up(argc, argv);
    rig_add(&both, &dive.camera, NULL);
    uint8_t *shown = malloc(dive.size * MAX_FRAMES);
    encode_all(&both, &dive, packets);
    for (int i = 0; i < dive.frames; i++) {
        nvsp_picture place = place_of(shown + (size_t)i * dive.size, dive.camera.width, dive.camera.height);
        MUST(nvsp_decode(both.decoder, packets[i].bytes, packets[i].size, 0, &place, NULL));
    }
    rig_close(&both);

    make_instance();
    choose_device();
    printf("validation layer: %s\n", validated ? "on" : "not installed");
    on_own_device(packets, shown, VK_TRUE, 1);
    // A device whose features are fewer; nobody else uses its queue.
    on_own_device(packets, shown, VK_FALSE, 0);
    what_does_not_fit();
    CHECK(complaints == 0);
    if (validated) {
        const PFN_vkDestroyDebugUtilsMessengerEXT destroy = (PFN_vkDestroyDebugUtilsMessengerEXT)
            vkGetInstanceProcAddr(own.instance, "vkDestroyDebugUtilsMessengerEXT");
        destroy(own.instance, own.messenger, NULL);
    }
    vkDestroyInstance(own.instance, NULL);
    free(shown);
    return tear_down();
}
