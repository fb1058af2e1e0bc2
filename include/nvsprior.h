/* nvsprior: pictures through an acoustic modem, against a 3D Gaussian Splatting prior.
 *
 * A vehicle and its topside hold the same trained scene, the prior. For each camera frame an encoder finds the pose at
 * which the prior looks most like the frame. It packs the pose with a coded difference picture. A decoder renders the
 * prior at the pose and adds the difference.
 *
 * Who has a link needs two handles. Leave a field at zero if you do not need it.
 *
 *   nvsp_vehicle          frames in (nvsp_vehicle_frame), modem frames out (nvsp_vehicle_transmit), reports in.
 *   nvsp_topside          modem frames in (nvsp_topside_receive), pictures and reports out (nvsp_topside_picture,
 *                         nvsp_topside_report).
 *
 * Each makes and owns its encoder or decoder. What is lost, late, twice, damaged or a stranger's is their matter. Both
 * need an engine and a prior, as follows; without them they take and give packets.
 *
 * Who encodes and decodes alone takes these functions, in this order. The first part of this header has them, with all
 * structures that they take.
 *
 *   nvsp_engine_create    opens a Vulkan device. nvsp_engine_options.log receives the text of every failure.
 *   nvsp_prior_open       reads the scene, and copies it to the device.
 *   nvsp_encoder_create   on the vehicle: makes an encoder for a camera.
 *   nvsp_encode           makes a packet of a frame.
 *   nvsp_decoder_create   on the topside: makes a decoder.
 *   nvsp_decode           makes a picture of a packet.
 *   nvsp_destroy          on both sides: ends each of them.
 *
 * The next part has a status in words (nvsp_status_text) and what any handle takes: the details of a failure
 * (nvsp_last_error), waiting and cancelling. The other parts are for those who need them: versions, frames that are
 * coded beside your own work, lens and mask, how far a picture is from what the camera saw (nvsp_decoder_get_truth),
 * and both ends of a link. Keys against strangers are an option: nvsp_keys.
 * nvsprior_extra.h has what few need: a Vulkan device of yours, DMA-BUFs, an allocator, a list of devices, counts of
 * the link.
 *
 * The contract of every function:
 *
 * Status. A call that can fail returns an nvsp_status: NVSP_OK (0), NVSP_PENDING, or an error below zero.
 *   nvsp_status_text says it in words; nvsp_last_error on the handle tells the details, and without a handle those of
 *   this thread's last failure. A call that fails writes nothing through any pointer and loses nothing that was good.
 *   There are two exceptions: NVSP_ERR_BUFFER_TOO_SMALL tells the size needed, and NVSP_ERR_NEWER the version. You may
 *   go on to use the handle, except after NVSP_ERR_INTERNAL, and NVSP_ERR_DEVICE_LOST (see nvsp_engine_reopen). The
 *   firmware build has no NVSP_ERR_INTERNAL: there a fault of the library itself aborts the process, and a watchdog
 *   must start it again.
 * Failures. The comment of a function names the statuses that are its own. Besides, a call may fail with
 *   NVSP_ERR_ARGUMENT (see Parameters), NVSP_ERR_STRUCTURE (see Structures), NVSP_ERR_INTERNAL (see Status), on a
 *   handle for one thread at a time with NVSP_ERR_BUSY (see Threads), and with NVSP_ERR_UNFINISHED until what was begun
 *   on it is finished.
 * Ownership. nvsp_..._create, nvsp_prior_open and nvsp_dmabuf_import give you a handle; nvsp_destroy ends it. You may
 *   destroy handles in any order: a handle keeps alive what it needs of another. All other memory is yours, and is read
 *   or written only during the call. Texts that a call returns are static.
 * Parameters. One line per parameter says what it is, its unit, and what NULL means. If it says nothing of NULL, NULL
 *   yields NVSP_ERR_ARGUMENT. Any other pointer must be what its line says: the library cannot check it. Bytes are
 *   as many as the next parameter says. A handle has no line: it must be a live one, and not NULL. Nor has `now`, the
 *   time of the call, which must be finite.
 * Threads. Any number of threads may use an engine, a prior or a DMA-BUF at once. One thread at a time may use an
 *   encoder, a decoder, a vehicle or a topside: a second one gets NVSP_ERR_BUSY and does no harm. No thread may use a
 *   handle while it is destroyed, or afterwards.
 * Stacks. A call takes at most 32 kB of its thread's stack. If less than 1 MB of that is left, or the stack is one of
 *   your own making, the call runs on a thread of the library that ends with it, and so do your callbacks within.
 * Waiting. A call waits only if its comment says so, and only for the device, no longer than
 *   nvsp_engine_options.watchdog_milliseconds for one piece of work. Building pipelines, in nvsp_engine_create and the
 *   first nvsp_prior_open, takes as long as the driver takes. No call waits for another program, a file (except
 *   nvsp_prior_open) or a network.
 * Memory. A call allocates only if its comment says so. Encoding, decoding and both ends of a link allocate nothing on
 *   the host once they have run a first time. A call that allocates first sets aside as much as it may need at most. If
 *   the system does not have it, the call fails with NVSP_ERR_MEMORY, and nothing has changed. The library itself never
 *   ends the process for want of memory, wherever that comes from (nvsp_set_allocator). A Vulkan driver may: Mesa's
 *   does, while it compiles.
 * Structures. Every structure begins with struct_size and abi_version. Set it up with NVSP_INIT(&structure), or as
 *   nvsp_camera camera = NVSP_INITIALIZER(nvsp_camera). This makes every other field zero, its default. Later versions
 *   only append fields. Flags that are unknown, and reserved fields that are not zero, are refused.
 * Compilers. With GCC and Clang a status that is not looked at gives a warning. Define NVSP_NO_ATTRIBUTES before you
 *   include this header to switch that off.
 * Times of a link are seconds on any clock of that side. It may be set back: work goes on.
 * Units. Angles in radians, pixels from the upper left corner, lengths in the prior's own unit, PSNR
 *   in dB against 255.
 * Signals and forks. The library installs no signal handlers. Its threads block all signals, except those of their own
 *   faults (SIGSEGV, SIGBUS, SIGILL, SIGFPE, SIGTRAP, SIGSYS). A child of fork may not use handles of its parent.
 */

#ifndef NVSPRIOR_H
#define NVSPRIOR_H

#include <stddef.h>
#include <stdint.h>

/* Sets a structure up for use: all defaults. Returns an nvsp_status. */
#define NVSP_INIT(structure) nvsp_struct_init((structure), sizeof *(structure), NVSP_ABI_VERSION)

/* NVSP_INITIALIZER: what a structure is initialised with, all defaults. NVSP_HEAD: its first two fields, if you state
 * others after it: nvsp_picture place = {NVSP_HEAD(nvsp_picture), .format = NVSP_FORMAT_RGB8}; in C++ before
 * C++20 state all, in order, without names. */
#ifdef __cplusplus
template <class Structure> inline Structure nvsp_initialized() {
    Structure made = Structure();
    made.struct_size = sizeof(Structure);
    made.abi_version = 1;
    return made;
}
#define NVSP_INITIALIZER(type) nvsp_initialized<type>()
#else
#define NVSP_INITIALIZER(type) {NVSP_HEAD(type)}
#endif
#if defined(__cplusplus) && __cplusplus < 202002L
#define NVSP_HEAD(type) sizeof(type), NVSP_ABI_VERSION
#else
#define NVSP_HEAD(type) .struct_size = sizeof(type), .abi_version = NVSP_ABI_VERSION
#endif

/* For nvsp_encoder_options.mode, with NVSP_MODE_CHAIN, NVSP_MODE_LAYERS or NVSP_MODE_KEYS: a key frame comes after n
 * frames, 1 to 16,777,214; or none after the first. Without either, after 16. */
#define NVSP_KEY_EVERY(n) ((uint32_t)(n) << 8)
#define NVSP_KEY_ONCE 0xFFFFFF00u

/* For nvsp_encoder_options.search_bound. Renders: most renders of the prior, of any size, that one frame takes beside
 * its first search, the picture that is sent included. The first search starts from the frame before, or from a hint if
 * there is none. A step that would take more is cut short or left out, and the next frames go on. A pose whose search
 * was cut short is not certain. 1 to 2,147,483,647. */
#define NVSP_BOUND_RENDERS(n) ((uint32_t)(n))
/* Most time that a frame takes, from its image to its packet, without scaling and conversion; and at most 96 renders.
 * Once it is up, the best pose so far is drawn, coded and sent, and the search goes on in the next frames. What one
 * render and one coding take is measured when the encoder is made; a time below that fails with NVSP_ERR_ARGUMENT, and
 * the text says what is needed. With it the same frames need not give the same packets; each decodes to the same
 * picture everywhere. 1 to 2,147,483,647. */
#define NVSP_BOUND_MILLISECONDS(n) ((uint32_t)(n) | 0x80000000u)

/* For compilers: a status must be looked at. */
#if defined(__GNUC__) && !defined(NVSP_NO_ATTRIBUTES)
#define NVSP_CHECKED __attribute__((warn_unused_result))
#else
#define NVSP_CHECKED
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* nvsprior_extra.h has them. */
struct nvsp_dmabuf;
struct nvsp_vulkan;

// ---- The usual case ----

// The vehicle's end of a link: camera frames in, modem frames out, and reports of the topside in. It has an encoder,
// protection against losses, keys, and the order of it all; it has no thread but the encoder's, no socket, no file and
// no clock. No call waits. Example, which a control loop turns as often as it likes:
//
//     if (camera_has(&image)) status = nvsp_vehicle_frame(vehicle, now(), &image, NULL, NULL, 0);
//     if (modem_received(bytes, &size)) status = nvsp_vehicle_receive(vehicle, now(), bytes, size);
//     while (modem_is_free() && nvsp_vehicle_transmit(vehicle, now(), 64, bytes, &size, NULL) == NVSP_OK)
//         modem_send(bytes, size);
//     while (nvsp_vehicle_event(vehicle, &event) == NVSP_OK) heed(&event);
typedef struct nvsp_vehicle nvsp_vehicle;

// The topside's end of a link: modem frames in, pictures and reports out. It has a decoder, the order of pictures and
// their age, and keys; it has no thread but the decoder's, no socket, no file and no clock. No call waits. Example:
//
//     while (modem_received(bytes, &size)) status = nvsp_topside_receive(topside, now(), bytes, size);
//     if (nvsp_topside_picture(topside, now(), &picture, &shown) == NVSP_OK) show(&picture, &shown);
//     if (nvsp_topside_report(topside, now(), bytes, 64, &size, NULL) == NVSP_OK) modem_send(bytes, size);
//     while (nvsp_topside_event(topside, &event) == NVSP_OK) heed(&event);
typedef struct nvsp_topside nvsp_topside;

// What a call came to: `NVSP_OK`, `NVSP_PENDING`, or an error below zero.
typedef int32_t nvsp_status;

#define NVSP_LOG_ERROR 1 // A call failed.
#define NVSP_LOG_WARNING 2 // Something is not as it should be, but work goes on.
#define NVSP_LOG_INFO 3 // What was chosen and loaded.

// Receives messages of an engine and of everything made with it: a level, NVSP_LOG_ERROR, NVSP_LOG_WARNING or
// NVSP_LOG_INFO, and a text that is valid during the call. It is called on the thread that is inside the library, or on
// an encoder's own thread (see nvsp_encode_begin), and perhaps on several threads at once. It must not call the
// library, and must not unwind. A frame that succeeds makes no call.
typedef void (*nvsp_log_callback)(void *user, int32_t level, const char *message);

// Called once on each thread that the library starts, before it does any work: set its scheduling, its affinity or
// another name here. `name` is the name that the thread has, valid during the call. It must not call the library, and
// must not unwind.
typedef void (*nvsp_thread_callback)(void *user, const char *name);

// Run under the Khronos validation layer, which must be installed. Its messages are logged as warnings when the engine
// is destroyed or reopened. For tests; slow.
#define NVSP_ENGINE_VALIDATION 1

// For nvsp_engine_options.watchdog_milliseconds: wait as long as the device takes.
#define NVSP_WATCHDOG_NONE UINT32_MAX

// How to open an engine; all zero: the best device, nothing logged.
typedef struct nvsp_engine_options {
  uint32_t struct_size, abi_version;
  // The device's number as text, or a part of its name or its driver's name. NULL: the best device, first a discrete
  // GPU, then an integrated one, then a CPU.
  const char *device;
  nvsp_log_callback log; // Receives messages. NULL: nothing is logged.
  // Passed to `log` as it is. What it points to must outlive every handle made with the engine, not the engine's own
  // alone: priors, encoders and decoders log, too, and their threads.
  void *log_user;
  uint32_t flags; // NVSP_ENGINE_* bits.
  // Most pixels of a picture, width times height. Encoders and decoders refuse larger ones with NVSP_ERR_MEMORY, and
  // take none for them. 0: 16,777,216, which is 4096 by 4096.
  uint32_t frame_size_limit;
  // Most bytes of host memory that opening a prior, an encoder or a decoder may take. A call that may need more fails
  // with NVSP_ERR_MEMORY before it takes any. 0: no limit.
  uint64_t host_memory_limit;
  // Most bytes of device memory that everything made with the engine may take from the driver together. A call that
  // needs more fails with NVSP_ERR_MEMORY. 0: no limit; then memory is taken in blocks of 64 MiB and more.
  uint64_t device_memory_limit;
  // Called on each thread that the library starts: one per encoder and one per decoder, by its first nvsp_encode_begin
  // or nvsp_decode_begin. NULL: nothing is called.
  nvsp_thread_callback thread_start;
  // Passed to `thread_start` as it is. What it points to must outlive every handle made with the engine.
  void *thread_start_user;
  // Longest that the library waits for one piece of work on the device, milliseconds: a frame is one to a few pieces.
  // If it takes longer, the call fails with NVSP_ERR_DEVICE_LOST, and so does every later call on what was made with
  // the engine. All handles can then be destroyed as usual; the memory that the device may still use is never given
  // back. 0: 60,000. NVSP_WATCHDOG_NONE: no bound.
  uint32_t watchdog_milliseconds;
  uint32_t reserved; // Zero.
  // What nvsp_engine_get_pipeline_cache gave on an earlier start, so that the driver need not compile again. Read
  // during nvsp_engine_create. Bytes that are damaged, or of another device or driver, are left aside. NULL: none.
  const uint8_t *pipeline_cache;
  size_t pipeline_cache_size; // Bytes of it.
  // A Vulkan device of yours to work on. Read during nvsp_engine_create. `device` is then NULL, and
  // NVSP_ENGINE_VALIDATION not set: validation is your instance's. NULL: the library opens a device of its own.
  const struct nvsp_vulkan *vulkan;
} nvsp_engine_options;

// An opened Vulkan device with all pipelines built. Example:
//
//     nvsp_engine_options options = NVSP_INITIALIZER(nvsp_engine_options);
//     nvsp_engine *engine = NULL;
//     options.log = print_to_stderr;
//     options.watchdog_milliseconds = 5000;
//     if (nvsp_engine_create(&options, &engine) != NVSP_OK) return 1;
typedef struct nvsp_engine nvsp_engine;

// Opens a device and builds the pipelines. Takes tens of milliseconds to seconds. The text of a failure goes to the
// options' `log`, as there is no handle to ask yet.
// Fails with NVSP_ERR_ARGUMENT (unknown flags, a name that is no UTF-8, or fields that exclude each other),
// NVSP_ERR_NO_DEVICE, NVSP_ERR_MEMORY or NVSP_ERR_VULKAN.
// - `options`: `log` and `log_user` are used as long as anything made with the engine lives. NULL: all defaults.
// - `engine`: receives the engine, which nvsp_destroy ends.
NVSP_CHECKED nvsp_status nvsp_engine_create(const struct nvsp_engine_options *options, struct nvsp_engine **engine);

#define NVSP_PRIOR_NEAR 1 // `near_plane` is given.
#define NVSP_PRIOR_ALPHA_MAX 2 // `alpha_max` is given.
#define NVSP_PRIOR_ANTIALIASED 4 // `antialiased` is given.
#define NVSP_PRIOR_BACKGROUND 8 // `background` is given.
#define NVSP_PRIOR_TRAINED_FOCAL 16 // `trained_focal` is given.

// Where a prior is, and render options that replace those of its file. These are part of the prior's identity: both
// sides of a link must give the same.
typedef struct nvsp_prior_options {
  uint32_t struct_size, abi_version;
  uint32_t given; // NVSP_PRIOR_* bits: which of the fields below count.
  float near_plane; // Splats whose camera z is not above this are culled, in the prior's unit; above 0.
  float alpha_max; // Alpha is clamped to this; between 0 and 1.
  uint32_t antialiased; // Not 0: gsplat's anti-aliased mode.
  float background[3]; // Linear RGB behind everything, 0 to 1.
  // Most memory for the splats of a prior in blocks (.nvsb), host and device together, MiB; 0: it is loaded whole. See
  // nvsp_prior_open.
  uint32_t blocks_memory;
  // Focal length of the pictures that the prior was trained on, pixels, 1 to 1,000,000. With it a prior that does not
  // state its own serves pictures of other sizes, too.
  float trained_focal;
  uint32_t reserved; // Zero.
  const uint8_t *content; // A file's content, in place of its path. Read during nvsp_prior_open. NULL: a file is read.
  size_t content_size; // Bytes of it.
} nvsp_prior_options;

// A trained scene on the device. Example:
//
//     nvsp_prior *prior = NULL;
//     if (nvsp_prior_open(engine, "reef.nvsg", NULL, &prior) != NVSP_OK) {
//         char text[512];
//         nvsp_last_error(engine, text, sizeof text);
//         fputs(text, stderr);
//     }
typedef struct nvsp_prior nvsp_prior;

// Reads a prior from a file, checks it and copies it to the device. The content tells the format: a .ply as Inria's
// trainer and nerfstudio write it, a compact prior (.nvsg) or a prior in blocks (.nvsb); with the feature "formats"
// also an .spz, .glb, .sog or .compressed.ply. Invalid splats are left out and logged as a warning. The file is not
// needed afterwards, and no copy of it stays in host memory. While the call runs, host and device together take at most
// four times the size of a binary .ply, or eight times the size of a text .ply. A file of another format takes more, by
// the factor by which it is packed.
//
// Key frames, the poses at which a lost camera is looked for, are read too: from the prior's own file, or, if that is
// of a foreign format, from the file PATH.nvsx beside it if there is one. They are no part of its identity; `nvsprior
// key-frames` writes them. If PATH.nvsx is not valid, or about another prior, the call fails with NVSP_ERR_PRIOR.
//
// Scene coder tables are read from an .nvsg or .nvsb. With them difference pictures take fewer bytes. They are part of
// the prior's identity: both sides of a link need them. `nvsprior prior tables` writes them.
//
// A prior may state a preprocessing: how the pictures that it was trained on were treated. Its encoders treat their
// frames in the same way. It is no part of the identity, and decoding does not depend on it: the topside shows the
// treated picture.
//
// With `options.blocks_memory` a prior in blocks (.nvsb, by `nvsprior prior blocks`) stays in its file. Only what
// cameras see is loaded, within that memory. Pictures and packets are the same. The file must stay as it is as long as
// the prior is in use. A thread of the library reads blocks ahead. A frame that needs a block which is not there waits
// for it: see nvsp_prior_info. A frame that sees more than there is room for fails with NVSP_ERR_MEMORY. Render options
// cannot be given with it. Encoders and decoders that share such a prior work in turn.
//
// With `options.content` the file's content is in memory. It is not needed afterwards. No file is read: key frames come
// from that content, and a prior in blocks is loaded whole.
// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_FILE, NVSP_ERR_PRIOR, NVSP_ERR_MEMORY, NVSP_ERR_VULKAN or
// NVSP_ERR_DEVICE_LOST; the text is the engine's.
// - `path`: the file's name, ending in NUL. NULL: `options.content` is given.
// - `options`: how; NULL: all as the file says.
// - `prior`: receives the prior, which nvsp_destroy ends.
NVSP_CHECKED nvsp_status nvsp_prior_open(const struct nvsp_engine *engine, const char *path,
    const struct nvsp_prior_options *options, struct nvsp_prior **prior);

// A pinhole camera without distortion; x right, y down, z forward. Pixel (0, 0) covers [0, 1) x [0, 1). A device
// refuses sizes for which its buffers are too small or its dispatches too few, with NVSP_ERR_MEMORY; the text tells the
// limit. Every device that Vulkan 1.2 allows takes 2048 by 2048.
typedef struct nvsp_camera {
  uint32_t struct_size, abi_version;
  uint32_t width; // Pixels, 1 to 4096.
  uint32_t height; // Pixels, 1 to 4096.
  float fx; // Focal length along x, pixels, 0.01 to 1,000,000.
  float fy; // Focal length along y, pixels, 0.01 to 1,000,000.
  float cx; // Principal point, x, pixels from the left edge, -1,000,000 to 1,000,000.
  float cy; // Principal point, y, pixels from the upper edge, -1,000,000 to 1,000,000.
} nvsp_camera;

#define NVSP_KEY_BYTES 32 // Bytes of a key.

// Keys that both sides hold. What goes to the other side gets 2 bytes of number and a tag in front. What comes without
// the right tag, or a second time, is refused before anything else of it is read. On a link give the keys to
// nvsp_vehicle and nvsp_topside, else to encoder and decoder. Example:
//
//     nvsp_keys keys = NVSP_INITIALIZER(nvsp_keys);
//     keys.keys = key; // 32 random bytes
//     keys.count = 1;
//     keys.epoch = dive;
//     options.keys = &keys;
typedef struct nvsp_keys {
  uint32_t struct_size, abi_version;
  // `count` keys of NVSP_KEY_BYTES bytes each, one after the other. Tags are made by the first, and checked by all. The
  // library copies them, and erases its copies when they are not needed any more.
  const uint8_t *keys;
  uint32_t count; // Number of keys, 1 to 4.
  uint32_t tag_bytes; // Bytes of a tag, 2 to 16. Both sides need the same. 0: 4.
  uint64_t epoch; // Both sides need the same, and nothing of another epoch passes: count the dives, for example.
  // Number of the first thing that this side sends, below 2^48. An encoder that starts again within an epoch goes on
  // with nvsp_frame_stats.next_number: numbers that the other side has taken are refused. Two encoders need other keys,
  // or other epochs. The state of a vehicle or a topside knows it.
  uint64_t number;
  // Numbers below this one count as taken, by the first key. A decoder that starts again within an epoch gets what
  // nvsp_decoded.taken told. Without it, what came before may pass once more until something newer has come. The state
  // of a vehicle or a topside knows it. 0: none.
  uint64_t taken;
} nvsp_keys;

#define NVSP_RATE_DEFAULT 0 // Quality 10.
#define NVSP_RATE_QUALITY 1 // Quality of the difference picture, 0 to 100.
#define NVSP_RATE_BYTES 2 // Bytes of the whole packet, never exceeded; 0 to 4,294,967,295.
#define NVSP_RATE_PSNR 3 // PSNR to reach with as few bytes as possible, dB; above 0, up to 100.
#define NVSP_RATE_NONE 4 // No difference picture: the pose alone.
// Bytes of a steady packet, for links: one that also states prior and camera, or has a check of the render, has as many
// more as these take, so that its difference picture is as fine. If these and the pose alone take more, the packet has
// them alone. 0 to 4,294,967,295.
#define NVSP_RATE_STEADY 5

#define NVSP_TUNE_PSNR 0 // All squared errors count alike.
// Texture hides errors: they count less in it. Errors of colour count half. SSIM is higher, and PSNR up to 0.3 dB lower
// at the same bytes.
#define NVSP_TUNE_SSIM 1
// Errors count more in parts of the picture that the prior does not show. So a new thing shows first.
#define NVSP_TUNE_DETECTION 2

#define NVSP_MODE_INTRA 0 // For nvsp_encoder_options.mode. Every frame is intra: a lost packet costs its own frame.
// A frame is predicted from the one before. Saves most; a lost packet spoils all frames up to the next key frame.
#define NVSP_MODE_CHAIN 1
// Layers: every other frame is the reference of none, and every fourth of more. A lost packet spoils fewer frames.
#define NVSP_MODE_LAYERS 2
// A frame is predicted from the last key frame. A lost packet costs its own frame, unless it is the key frame.
#define NVSP_MODE_KEYS 3
// A frame is predicted from the newest one that nvsp_encoder_acknowledge has told of. A lost packet costs its own
// frame.
#define NVSP_MODE_ACKNOWLEDGED 4

// For nvsp_encoder_options.camera_interval: prior and camera are stated with the first frame only.
#define NVSP_CAMERA_ONCE UINT32_MAX

// How to encode; all zero: the defaults.
typedef struct nvsp_encoder_options {
  uint32_t struct_size, abi_version;
  uint32_t rate; // NVSP_RATE_*: it sets how fine the difference picture is.
  // The number that `rate` takes: quality, bytes or dB; 0 for NVSP_RATE_DEFAULT and NVSP_RATE_NONE, which take none.
  float rate_value;
  // NVSP_MODE_*: whether difference pictures are predicted from those of earlier frames. They then take fewer bytes,
  // and the encoder about 327 more bytes of host memory per pixel. A frame whose reference is missing is shown as the
  // prior's render alone: nvsp_decoded.damage is then NVSP_ERR_REFERENCE. A key frame, which is intra, ends what a loss
  // has spoiled: say how often they come by NVSP_MODE_CHAIN | NVSP_KEY_EVERY(8), for example; else after every 16
  // frames. If the device is not portable, all frames are intra.
  uint32_t mode;
  // State prior and camera (29 bytes) again after this many frames, for a topside that missed them; 0: 64. Until the
  // topside has acknowledged a frame (nvsp_encoder_acknowledge), and always if the device is not portable, a check of
  // the render (6 bytes) comes with them. It tells the topside whether its render is the same.
  uint32_t camera_interval;
  uint32_t first_frame; // Number of the first frame; packets carry it modulo 2^16.
  // How long a frame may be searched for: NVSP_BOUND_RENDERS(n) or NVSP_BOUND_MILLISECONDS(n). 0: 96 renders.
  uint32_t search_bound;
  // Not 0: images come already treated as nvsp_prior_info.white_balance and clahe_tiles say, so they are encoded as
  // they are. 0: the encoder treats them, whatever their format, after it has brought them to the camera's size.
  uint32_t frames_treated;
  // Not 0: two frames may be under way at once, see nvsp_encode_begin. While one thread codes the difference picture of
  // a frame, another searches for the pose of the next. So more frames per second are encoded, and each packet is the
  // same, byte for byte. Takes about twice the host memory. 0: one frame at a time.
  uint32_t pipelined;
  // Not 0: packets tell the topside nothing of how far its picture is from what the camera saw. 0: they have a truth
  // map, of 8 % of the packet or its budget at most, or six bytes: see nvsp_decoder_get_truth. With NVSP_RATE_NONE
  // there is none.
  uint32_t no_truth;
  // NVSP_TUNE_*: what counts when bits are given to one part of the difference picture and taken from another. The
  // topside needs not know.
  uint32_t tune;
  // Each packet gets a number and a tag by these keys. They take nvsp_keys.tag_bytes and 2 bytes of it; budgets count
  // them. Read during nvsp_encoder_create. NULL: none, also if an nvsp_vehicle sends the packets: it gets the keys.
  const struct nvsp_keys *keys;
} nvsp_encoder_options;

// Encodes the frames of one camera, in order. Example, which never waits for a frame:
//
//     if (nvsp_encode_begin(encoder, &image, &info) != NVSP_OK) return;
//     while (nvsp_wait(encoder, 0) == NVSP_PENDING) steer();
//     status = nvsp_encode_finish(encoder, packet, sizeof packet, &bytes, &stats);
typedef struct nvsp_encoder nvsp_encoder;

// Makes an encoder for frames of `camera`. Allocates what every frame takes, on host and device. The first frame still
// allocates on the host what depends on its content and options, and has the driver compile; so encode one at the quay.
// With NVSP_BOUND_MILLISECONDS the driver compiles here, and one render and one coding are measured. Later frames
// allocate nothing, unless a view of the prior needs more room on the device than any before it.
// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_MEMORY, NVSP_ERR_VULKAN or NVSP_ERR_DEVICE_LOST; the text is the engine's.
// - `prior`: a live prior that was opened with `engine`.
// - `camera`: size, focal lengths and principal point, pixels.
// - `options`: how; NULL: all defaults.
// - `encoder`: receives the encoder, which nvsp_destroy ends.
NVSP_CHECKED nvsp_status nvsp_encoder_create(const struct nvsp_engine *engine, const struct nvsp_prior *prior,
    const struct nvsp_camera *camera, const struct nvsp_encoder_options *options, struct nvsp_encoder **encoder);

#define NVSP_FORMAT_RGB8 1 // Three bytes per pixel: red, green, blue.
#define NVSP_FORMAT_BGR8 2 // Three bytes per pixel: blue, green, red.
// Four bytes per pixel: red, green, blue, alpha. Alpha is ignored in images and 255 in pictures.
#define NVSP_FORMAT_RGBA8 3
#define NVSP_FORMAT_NV12 4 // Plane 0: Y; plane 1: U and V in turn, one pair per two by two pixels. Images only.
#define NVSP_FORMAT_I420 5 // Planes Y, U, V; one U and one V per two by two pixels. Images only.

#define NVSP_COLOUR_BT601_LIMITED 0 // BT.601, limited range: what most cameras and V4L2 deliver.
#define NVSP_COLOUR_BT601_FULL 1 // BT.601, full range: JPEG.
#define NVSP_COLOUR_BT709_LIMITED 2 // BT.709, limited range: HDTV, most H.264 decoders.
#define NVSP_COLOUR_BT709_FULL 3 // BT.709, full range.

// A camera's image; read during the call only. If its size is not the camera's, it is scaled to it. Its shape must be
// the camera's (1 % is tolerated). With a lens its size must be the lens's.
typedef struct nvsp_image {
  uint32_t struct_size, abi_version;
  uint32_t format; // NVSP_FORMAT_*.
  uint32_t colour; // NVSP_COLOUR_*; used for NV12 and I420 only.
  uint32_t width; // Pixels, 1 to 16384.
  uint32_t height; // Pixels, 1 to 16384.
  const uint8_t *planes[3]; // First byte of each plane that the format has. All NULL if the planes lie in `dmabufs`.
  size_t strides[3]; // Bytes from one row to the next, of each plane.
  size_t sizes[3]; // Bytes of each plane. Nothing beyond them is read. For a plane in a DMA-BUF 0 means up to its end.
  // The DMA-BUF that each plane lies in, which nobody may write during the call. NULL, except for the first: the
  // first's. All NULL: the image lies at `planes`.
  const struct nvsp_dmabuf *dmabufs[3];
  size_t offsets[3]; // Where each plane begins in its DMA-BUF, bytes. 0 if there is none.
} nvsp_image;

// Where a camera stands: x_camera = R x_world + t. Within another structure it always has the fields below, set up as
// by NVSP_INIT; what a pose gains in a later version is appended to the outer structure.
typedef struct nvsp_pose {
  uint32_t struct_size, abi_version;
  double rotation[4]; // Quaternion of R: w, x, y, z. Any length but zero.
  double translation[3]; // t, in the prior's unit.
} nvsp_pose;

#define NVSP_GIVEN_TIME 1 // For nvsp_frame_info.given: `time` is the frame's.

// What is known of a frame besides its image; all zero: nothing. Read during the call only.
typedef struct nvsp_frame_info {
  uint32_t struct_size, abi_version;
  // A pose from sensors or an estimator; NULL: none. It is used if there is no certain pose of the frame before, and if
  // it disagrees with that one by more than a tenth of the scene's depth or 6 degrees; the picture decides. On the
  // scenes of docs/poses.md it may be off by 40 degrees or 1.5 units: of 104 starts each all were found. What is
  // farther off costs time, not certainty. Beyond a million spreads of the prior it is refused.
  const struct nvsp_pose *hint;
  // How sure the hint is: the covariance of the small motion from the hint to the true pose. 36 values, row by row:
  // translation along the camera's axes (the prior's unit), then turns about them (radians). Symmetric and positive
  // semidefinite. An axis of which nothing is known has an infinite variance, and 0 beside it. NULL: not stated.
  const double *hint_covariance;
  double hint_age; // Seconds from the time of the hint to the time of the frame; 0 or more.
  // When the frame was taken, seconds on a clock of yours. Used if `given` has NVSP_GIVEN_TIME. A later frame must not
  // have an earlier time. After nvsp_encoder_reset any time is allowed again.
  double time;
  uint32_t given; // NVSP_GIVEN_TIME, or 0.
  // Camera frames that were left out before this one: its number is as much greater. If numbers count all frames of the
  // camera, the topside knows which it lacks, and can draw them at poses between (nvsp_decoder_draw).
  uint32_t left_out;
} nvsp_frame_info;

#define NVSP_FRAME_UNCERTAIN 1 // The picture does not confirm the pose. The encoder looks for it again at every frame.
// The rate was not kept: the budget holds no difference picture, or the best one does not reach the PSNR.
#define NVSP_FRAME_RATE_MISSED 4
// The picture does not determine one direction of the pose: see nvsp_frame_stats.pose_covariance.
#define NVSP_FRAME_UNDETERMINED 8
// The position is known within position_deviation and rotation_deviation. Navigate by no other: that the picture is
// confirmed (NVSP_FRAME_UNCERTAIN is not set) does not say where the camera is.
#define NVSP_FRAME_POSITION_KNOWN 128
// The frame's time ended its search: see NVSP_BOUND_MILLISECONDS. The search goes on in the next frames.
#define NVSP_FRAME_OUT_OF_TIME 16
// A device is not portable: the topside's render, and its picture, may differ from the vehicle's in the last bit of a
// colour. In nvsp_frame_stats this is the encoder's device. In nvsp_decoded it is one of the two, or the vehicle's by
// nvsp_decode_header.
#define NVSP_FRAME_NOT_PORTABLE 2

#define NVSP_START_HINT 0 // The frame started from the pose given with it.
#define NVSP_START_PREVIOUS 1 // It started from the pose of the frame before.
#define NVSP_START_PREDICTED 2 // It started from the pose that constant velocity predicts.
#define NVSP_START_UNCERTAIN 3 // No start was near, and no pose was given: it started from the best one at hand.
#define NVSP_START_KEY_FRAME 4 // The prior's key frames yielded the start.

#define NVSP_STOP_GRADIENT 0 // The gradient became small enough.
#define NVSP_STOP_PROGRESS 1 // The steps became small enough.
#define NVSP_STOP_NO_DESCENT 2 // No step made the error smaller.
#define NVSP_STOP_ITERATIONS 3 // No iterations were left.

// What encoding a frame took and yielded.
typedef struct nvsp_frame_stats {
  uint32_t struct_size, abi_version;
  uint32_t frame; // Number of the frame.
  uint32_t bytes; // Bytes of the packet, number and tag counted.
  uint32_t latent_bytes; // Bytes of its latent part, which makes a picture by itself.
  uint32_t truth_bytes; // Bytes of the packet that its truth map takes; 0: it has none, or one that takes none.
  uint32_t full_renders; // Renders of the prior at full resolution that the frame took.
  uint32_t start; // NVSP_START_*.
  uint32_t stop; // NVSP_STOP_*: why the refinement ended.
  // NVSP_FRAME_UNCERTAIN, NVSP_FRAME_RATE_MISSED, NVSP_FRAME_UNDETERMINED, NVSP_FRAME_NOT_PORTABLE,
  // NVSP_FRAME_POSITION_KNOWN and NVSP_FRAME_OUT_OF_TIME bits.
  uint32_t flags;
  // PSNR of the prior's render against the frame, dB. If the prior has a preprocessing, the frame is the treated one,
  // here and below: figures of priors of different preprocessing cannot be compared.
  double render_psnr;
  double psnr; // PSNR of what the topside will show against the frame, dB.
  double milliseconds; // Time that the frame took, milliseconds, without scaling and conversion.
  struct nvsp_pose pose; // The pose as the packet holds it.
  // How far the pose may be off: its covariance, as nvsp_frame_info.hint_covariance states one (6 × 6, row by row:
  // translation along the camera's axes in the prior's unit, then turns about them in radians). The root of a value on
  // the diagonal is the standard deviation along an axis. An axis that is open has an infinite variance, and 0 beside
  // it; so have all with NVSP_FRAME_UNCERTAIN.
  double pose_covariance[36];
  // With NVSP_FRAME_POSITION_KNOWN: the greatest standard deviation of the position along an axis (the prior's unit),
  // as the packet states it; else infinite.
  double position_deviation;
  // With NVSP_FRAME_POSITION_KNOWN: the greatest standard deviation of a turn about an axis (radians); else infinite.
  double rotation_deviation;
  // The largest eigenvalue of the normal equations divided by the smallest: the best determined direction of the pose
  // against the least determined. Infinite if the picture does not determine one direction at all.
  double pose_condition;
  // Frames since the last certain one, or since the encoder was made or reset. This frame counts; 0 if it is certain.
  uint32_t frames_since_certain;
  // How many frames before this one the frame came that its difference picture is predicted from; 0: it is intra.
  uint32_t reference_distance;
  uint64_t next_number; // With keys: the number of the next packet. Else 0. See nvsp_keys.number.
} nvsp_frame_stats;

// Encodes a frame into `packet`. First the frame is treated as the prior's preprocessing says, unless
// nvsp_encoder_options.frames_treated says that it is. Waits for a lock of the device's queue, and for the device. Uses
// the hint in `info` if the frame before yields no good start. Without a hint, the prior's key frames find the first
// frame. Allocates nothing from the second frame on, unless a view of the prior needs more room on the device than any
// before it.
//
// The text of NVSP_ERR_ARGUMENT names the field of `info`. The same frames, poses and calls yield the same packets,
// byte for byte, on the same device and driver.
// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_IMAGE, NVSP_ERR_UNSUPPORTED, NVSP_ERR_NO_START, NVSP_ERR_BUDGET,
// NVSP_ERR_MEMORY, NVSP_ERR_VULKAN or NVSP_ERR_DEVICE_LOST: the encoder then acts as if it had not seen the frame.
// Fails also with NVSP_ERR_BUFFER_TOO_SMALL: the packet is then kept until the next frame is encoded, and
// nvsp_encode_finish fetches it.
// - `image`: the frame.
// - `info`: what is known of the frame. NULL: nothing is known.
// - `packet`: receives the packet.
// - `size`: bytes of `packet`; nvsp_size_bound always suffices.
// - `written`: receives the packet's length, bytes, also with NVSP_ERR_BUFFER_TOO_SMALL.
// - `stats`: receives what the frame took. NULL: not wanted.
NVSP_CHECKED nvsp_status nvsp_encode(struct nvsp_encoder *encoder, const struct nvsp_image *image,
    const struct nvsp_frame_info *info, uint8_t *packet, size_t size, size_t *written, struct nvsp_frame_stats *stats);

// Decodes packets, in any order. Example:
//
//     nvsp_picture picture = NVSP_INITIALIZER(nvsp_picture);
//     picture.format = NVSP_FORMAT_RGB8;
//     status = nvsp_decode(decoder, packet, bytes, 0, &picture, NULL); // NVSP_ERR_BUFFER_TOO_SMALL
//     picture.pixels = malloc(picture.needed);
//     picture.size = picture.needed;
//     status = nvsp_decode_finish(decoder, &picture, NULL);
typedef struct nvsp_decoder nvsp_decoder;

// Makes a decoder for packets about a prior. The first packet of a camera takes the device memory for its pictures.
// Fails with NVSP_ERR_ARGUMENT or NVSP_ERR_MEMORY; the text is the engine's.
// - `prior`: a live prior that was opened with `engine`.
// - `keys`: only whole packets that an encoder has made with one of these keys are taken, and none a second time. NULL:
//   none, and whatever comes is taken.
// - `decoder`: receives the decoder, which nvsp_destroy ends.
NVSP_CHECKED nvsp_status nvsp_decoder_create(const struct nvsp_engine *engine, const struct nvsp_prior *prior,
    const struct nvsp_keys *keys, struct nvsp_decoder **decoder);

// A place for a picture. The call that fills it also writes its `width`, `height` and `needed`, if it succeeds and if
// it fails with NVSP_ERR_BUFFER_TOO_SMALL. So a place without pixels asks for the size.
typedef struct nvsp_picture {
  uint32_t struct_size, abi_version;
  uint32_t format; // NVSP_FORMAT_RGB8, NVSP_FORMAT_BGR8 or NVSP_FORMAT_RGBA8.
  uint32_t width; // Receives the picture's width, pixels.
  uint32_t height; // Receives the picture's height, pixels.
  uint32_t reserved; // Zero.
  uint8_t *pixels; // First byte. NULL only if `size` is 0.
  // Bytes from one row to the next; 0: rows without padding. Bytes after a row's pixels are left as they are.
  size_t stride;
  size_t size; // Bytes of the place. Nothing beyond them is written.
  size_t needed; // Receives how many bytes the picture needs with this format and stride.
} nvsp_picture;

// For nvsp_decode: the bytes are the undamaged start of a packet, as nvsp_topside_packet copies it. If the difference
// picture is cut short, the decoder shows what arrived, a coarser picture. Without this flag it shows a difference
// picture only if it is whole and its check matches.
#define NVSP_DECODE_START 1

// The render is the vehicle's, byte for byte. If neither this bit nor NVSP_DECODED_OTHER_RENDER is set, the packet does
// not tell.
#define NVSP_DECODED_SAME_RENDER 4
// The render is not the vehicle's: the vehicle's device, or its driver, rounds differently.
#define NVSP_DECODED_OTHER_RENDER 8
// The frame is one of a stream, and its difference picture is predicted from that of nvsp_decoded.reference.
#define NVSP_DECODED_INTER 16
// The frame is one of a stream and came in full: later ones may be predicted from it. If there is a return channel,
// tell the vehicle: nvsp_encoder_acknowledge.
#define NVSP_DECODED_KEPT 32
#define NVSP_DECODED_FILTERED 64 // The picture went through the display filter: see nvsp_decoder_set_filter.
#define NVSP_DECODED_WHOLE 256 // For nvsp_decoded.flags, of a topside: all of the frame's packet came.
// The frame did not come: the prior is drawn at a pose between those of frames that did.
#define NVSP_DECODED_BETWEEN 512
#define NVSP_DECODED_RESTARTED 1024 // It does not follow the one before: the vehicle has begun anew.
#define NVSP_DECODED_POSE 2048 // Of nvsp_decode_header: `pose` is given.
// Of nvsp_decode_header: the packet states prior and camera; else they are those of an earlier packet.
#define NVSP_DECODED_SESSION 4096

// For nvsp_decoded.clock: `age` is since the frame's packet began to come. It is older by what the link took.
#define NVSP_CLOCK_NONE 0
#define NVSP_CLOCK_REPORTS 1 // The vehicle counts from the reports that it got: `age` is never too small.
#define NVSP_CLOCK_VEHICLE 2 // The vehicle's own UTC.

// What decoding a packet yielded besides the picture; or, by nvsp_decode_header, what it says first.
typedef struct nvsp_decoded {
  uint32_t struct_size, abi_version;
  uint32_t frame; // Number of the frame, completed from that of the packet before. Of nvsp_decode_header modulo 2^16.
  uint32_t width; // Pixels. Of nvsp_decode_header 0 without NVSP_DECODED_SESSION, as the height.
  uint32_t height; // Pixels.
  uint32_t flags; // Bits: NVSP_FRAME_UNCERTAIN, NVSP_FRAME_NOT_PORTABLE, NVSP_FRAME_POSITION_KNOWN, NVSP_DECODED_*.
  uint32_t rows; // Rows that the difference picture reached: all, or 0 if the picture is the prior's render alone.
  // NVSP_OK, or what was wrong with a part of the packet that the picture does without: NVSP_ERR_RESIDUAL (the
  // difference picture), NVSP_ERR_NEWER (its coder is not known), NVSP_ERR_REFERENCE (its reference frame is missing)
  // or NVSP_ERR_PACKET (prior and camera).
  nvsp_status damage;
  struct nvsp_pose pose; // The pose.
  // With NVSP_DECODED_INTER: number of the reference frame, completed from that of the packet before; else 0.
  uint32_t reference;
  uint32_t clock; // NVSP_CLOCK_*. This and the fields from `time` to `bytes` are a topside's; else they are zero.
  // With NVSP_FRAME_POSITION_KNOWN: the greatest standard deviation of the position along an axis of the camera (the
  // prior's unit); else infinite.
  double position_deviation;
  // With NVSP_FRAME_POSITION_KNOWN: the greatest standard deviation of a turn about an axis of the camera (radians);
  // else infinite.
  double rotation_deviation;
  uint64_t taken; // With keys: the number above all of the packets that came. Else 0. See nvsp_keys.taken.
  double time; // In order the frame's time, else when it was fetched; seconds.
  double age; // How old the frame was at that call, seconds: see `clock`.
  double old; // From which age on the picture is old, as the vehicle tells, seconds. Say so to who looks at it.
  uint32_t arrived; // Modem frames of its packet that came.
  uint32_t sent; // Modem frames that it was sent in. 0: not known.
  uint32_t bytes; // Bytes of its packet that came.
  // With NVSP_DECODED_SESSION: identity of the prior that the packet is about, see nvsp_prior_info. This and the fields
  // behind are of nvsp_decode_header; else they are zero.
  uint32_t prior_id;
  uint32_t latent_bytes; // Bytes of the latent part, which makes a picture by itself.
  uint32_t tag; // The tag, of 16 bits, that names prior and camera.
} nvsp_decoded;

// Decodes a packet. Waits for a lock of the device's queue, and for the device. Whatever the bytes are, the call yields
// a picture or an error. Allocates nothing from the second valid packet of a camera on, unless a view of the prior
// needs more room on the device than any before it. It holds at most 2 MiB and 136 bytes per pixel on the host, and
// from the first packet of a stream on 272 more per pixel. The pixels are those of the packet's picture, with sides
// rounded up to multiples of 16.
//
// The same packet yields the same picture, byte for byte, as the encoder predicted, on the same device and driver.
// nvsp_decoder_get_truth tells what of it is as the camera saw it.
// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_PACKET, NVSP_ERR_OTHER_PRIOR, NVSP_ERR_CAMERA_UNKNOWN, NVSP_ERR_MEMORY,
// NVSP_ERR_VULKAN or NVSP_ERR_DEVICE_LOST. With keys, fails with NVSP_ERR_FOREIGN or NVSP_ERR_REPLAYED: nothing of it
// is read then. Fails also with NVSP_ERR_BUFFER_TOO_SMALL: the picture is then kept until the next packet is decoded,
// and nvsp_decode_finish fetches it.
// - `packet`: the packet.
// - `size`: bytes of `packet`.
// - `flags`: NVSP_DECODE_START, or 0.
// - `picture`: receives the picture. Its pixels are yours. NULL: not wanted.
// - `info`: receives what the packet yielded. NULL: not wanted.
NVSP_CHECKED nvsp_status nvsp_decode(struct nvsp_decoder *decoder, const uint8_t *packet, size_t size, uint32_t flags,
    struct nvsp_picture *picture, struct nvsp_decoded *info);

// Ends a handle of any kind. What was made with it goes on to work: the last such handle frees what they share, and
// closes the device, unless you gave it. Waits for a frame or a packet that was begun, at most as long as the watchdog
// allows. Modem frames that wait in a vehicle are lost. Encoder and decoder that a vehicle or a topside has handed out
// end with these: on them the call does nothing.
// - `handle`: a live handle, which no thread uses. NULL: nothing is done.
void nvsp_destroy(void *handle);

// ---- Statuses, and what any handle takes ----

#define NVSP_OK 0 // Done.

#define NVSP_PENDING 1 // Not done yet: ask again later.

// An argument or a field is out of its range, or NULL where it must not be; the text names it. Correct the program.
#define NVSP_ERR_ARGUMENT -1
// A structure that was not set up by NVSP_INIT, or of a header that this library does not know. Build the program with
// the header of this library.
#define NVSP_ERR_STRUCTURE -2
// The destination is too small. What else the call writes tells how many bytes are needed: `written`, or
// nvsp_picture.needed. Call again with as many.
#define NVSP_ERR_BUFFER_TOO_SMALL -3
#define NVSP_ERR_BUSY -4 // Another thread is inside a call on this handle. Call again.
#define NVSP_ERR_STATE -5 // There is nothing to finish or to fetch.
// A frame or a packet that was begun on this handle is not finished: finish it, or cancel it. Of a vehicle: too many
// modem frames wait.
#define NVSP_ERR_UNFINISHED -6
// A fault of the library itself, in this call or an earlier one. Destroy the handle, and report the fault.
#define NVSP_ERR_INTERNAL -7
// No Vulkan loader, or no device that fits; the text says what was found and what to install.
#define NVSP_ERR_NO_DEVICE -8
// The device was lost, or did not end its work within nvsp_engine_options.watchdog_milliseconds. See
// nvsp_engine_reopen.
#define NVSP_ERR_DEVICE_LOST -9
// Host or device memory could not be allocated, or the engine's limits do not allow it or so large a picture. The text
// names what is too large, and the limit. Leave the frame out, or make room.
#define NVSP_ERR_MEMORY -10
#define NVSP_ERR_VULKAN -11 // A Vulkan call failed; the text names it. Use another device or driver.
// The system, a driver or an engine cannot do this; the text says what is missing. Do without.
#define NVSP_ERR_UNSUPPORTED -12
#define NVSP_ERR_FILE -13 // A file cannot be read. Look at its path and its rights.
// The content of a prior is not valid. The text names the splat or the byte. Get the file anew.
#define NVSP_ERR_PRIOR -14
// An image's size, shape, strides or planes do not fit, or its DMA-BUF is still being written. Leave the frame out.
#define NVSP_ERR_IMAGE -15
// The first frame came without a pose to start from, and the prior has no key frames. Give a hint.
#define NVSP_ERR_NO_START -16
// The byte budget does not even hold the pose, or a packet's modem frames do not. Give more bytes, or leave the frame
// out.
#define NVSP_ERR_BUDGET -17
// The bytes are no packet, no modem frame of the vehicle and no report for it, or they are damaged or too late, or
// longer than the modem frames hold. Drop them.
#define NVSP_ERR_PACKET -18
// The packet is about another prior than the one at hand: open that one. Or one before was, or its render was another,
// and this one does not state its prior: wait for one that does.
#define NVSP_ERR_OTHER_PRIOR -19
// The packet's tag is not that of the prior at hand with any camera known: the packet that states prior and camera is
// missing, or it is about another prior. Wait for one that states them, or have the vehicle call nvsp_encoder_announce.
#define NVSP_ERR_CAMERA_UNKNOWN -20
// A packet, a modem frame, a difference picture or a prior's file is of a newer format than this library knows, or
// looks like one by chance. Update this side.
#define NVSP_ERR_NEWER -21
// No key that is held has made the tag: of a stranger or of another epoch, or damaged. Drop it.
#define NVSP_ERR_FOREIGN -22
#define NVSP_ERR_REPLAYED -23 // It has the right tag, and comes a second time. Drop it; many tell of a stranger.
#define NVSP_ERR_RESIDUAL -24 // The difference picture is damaged or cut short. Only nvsp_decoded.damage has it.
// The reference frame of a difference picture is missing, came in part, or is of another stream. Only
// nvsp_decoded.damage has it.
#define NVSP_ERR_REFERENCE -25

// Says in a few English words what a status means. The text is static and never NULL, even if the number is no status.
// - `status`: any number.
const char *nvsp_status_text(nvsp_status status);

// Copies the text of the last failed call on a handle into `text`. An engine's is also that of the last failure to make
// something with it; that of the encoder of a vehicle tells of its last frame that failed. Writes at most `size` bytes,
// with the NUL at the end. The text is empty if nothing failed.
// Fails with NVSP_ERR_BUFFER_TOO_SMALL if `size` is 0.
// - `handle`: a live handle of any kind. NULL: the last call that failed on this thread, of any handle or of none.
// - `text`: receives the text, ending in NUL.
// - `size`: bytes of `text`, 1 or more.
nvsp_status nvsp_last_error(const void *handle, char *text, size_t size);

// Tells whether the frame or the packet that was begun has ended, with success or not: NVSP_OK if it has, else
// NVSP_PENDING. Waits for that at most as long as you say.
// Fails with NVSP_ERR_STATE if none was begun, or NVSP_ERR_ARGUMENT (another handle).
// - `handle`: an encoder or a decoder; a vehicle: its first frame that is coded; a topside: what it decodes.
// - `milliseconds`: the longest to wait; 0 does not wait.
NVSP_CHECKED nvsp_status nvsp_wait(void *handle, uint32_t milliseconds);

// Drops what was begun, and a packet or a picture that was not fetched; both frames, if two are under way. Never waits:
// returns NVSP_OK if the handle is free again, or nothing was begun, else NVSP_PENDING. What was begun then ends with
// what the device is at, a few renders, at most as long as the watchdog allows; a coding that has begun goes on to its
// end. Until then, other calls fail with NVSP_ERR_UNFINISHED. Call this again, or nvsp_wait, which then returns
// NVSP_ERR_STATE.
//
// A frame that is dropped counts as one whose packet was lost. Its number is used up. The next search may start at its
// pose. The next packet names prior and camera in full. A camera that a dropped packet told is known afterwards.
// Fails with NVSP_ERR_ARGUMENT (another handle).
// - `handle`: an encoder or a decoder; those of a vehicle and a topside are these handles' own.
NVSP_CHECKED nvsp_status nvsp_cancel(void *handle);

// ---- Structures and versions ----

#define NVSP_ABI_VERSION 1 // Version of the ABI that this header describes.

// Version of the library that this header came with; nvsp_version tells that of the library in use. First number.
#define NVSP_VERSION_MAJOR 1
#define NVSP_VERSION_MINOR 0 // Second number.
#define NVSP_VERSION_PATCH 0 // Third number.
#define NVSP_VERSION_NUMBER 1000000 // The three in one number, for comparisons: 1,000,000 major + 1,000 minor + patch.

// Zeroes a structure of `size` bytes, then writes its size and the caller's ABI version into it. The structure then
// means all defaults. The macro NVSP_INIT calls this.
// Fails with NVSP_ERR_STRUCTURE (size below 8 or above 4096, or another ABI version).
// - `structure`: is zeroed.
// - `size`: bytes of the structure, 8 to 4096.
// - `abi_version`: NVSP_ABI_VERSION of your header.
nvsp_status nvsp_struct_init(void *structure, size_t size, uint32_t abi_version);

// Returns the version of the library in use, such as "1.0.0". The text is static. NVSP_INIT and every call that takes a
// structure refuse a program made for another NVSP_ABI_VERSION.
// - `number`: receives it as one number, as NVSP_VERSION_NUMBER has it for the header. NULL: not wanted.
// - `abi_version`: receives the ABI version that the library speaks. NULL: not wanted.
const char *nvsp_version(uint32_t *number, uint32_t *abi_version);

// ---- Engines ----

// A device in words, and the memory it gave.
typedef struct nvsp_engine_info {
  uint32_t struct_size, abi_version;
  char device[256]; // Name, kind, driver and Vulkan version of the device, ending in NUL.
  uint64_t memory_used; // Bytes of device memory that everything made with the engine uses.
  uint64_t memory_reserved; // Bytes of device memory taken from the driver for that.
  uint64_t buffers; // Vulkan buffers in use.
} nvsp_engine_info;

// Opens the device again, with the options that the engine was made with. Call it after NVSP_ERR_DEVICE_LOST. What was
// made with the engine before stays on the lost device: every call on it fails with NVSP_ERR_DEVICE_LOST. So open the
// prior again next. Then move encoders and decoders to it with nvsp_encoder_reopen and nvsp_decoder_reopen, which keep
// their state. Then destroy the old prior. If the device cannot be opened, the engine does not change; try again later.
// Fails as nvsp_engine_create does, or with NVSP_ERR_UNSUPPORTED if the device is one that you gave: make a new one,
// and a new engine with it.
NVSP_CHECKED nvsp_status nvsp_engine_reopen(const struct nvsp_engine *engine);

// Describes the engine's device and its memory. Allocates.
// - `info`: receives the description.
NVSP_CHECKED nvsp_status nvsp_engine_get_info(const struct nvsp_engine *engine, struct nvsp_engine_info *info);

// Copies what the driver has compiled so far, to keep in a file for nvsp_engine_options.pipeline_cache of the next
// start. Call it after a first frame was encoded or decoded, as drivers compile late. Waits for no work. Allocates.
// Fails with NVSP_ERR_BUFFER_TOO_SMALL, NVSP_ERR_MEMORY, NVSP_ERR_VULKAN or NVSP_ERR_DEVICE_LOST.
// - `bytes`: receives the data. NULL only if `size` is 0.
// - `size`: bytes of `bytes`.
// - `written`: receives the number of bytes, also with NVSP_ERR_BUFFER_TOO_SMALL.
NVSP_CHECKED nvsp_status nvsp_engine_get_pipeline_cache(const struct nvsp_engine *engine, uint8_t *bytes, size_t size,
    size_t *written);

// ---- Priors ----

#define NVSP_WHITE_BALANCE_NONE 0 // Colours were left as they were.
#define NVSP_WHITE_BALANCE_GRAY_WORLD 1 // The means of red, green and blue were brought together, by gains up to 4.

// What a prior is.
typedef struct nvsp_prior_info {
  uint32_t struct_size, abi_version;
  uint32_t id; // Identity of splats, render options and coder tables; packets carry it.
  uint32_t splats; // Splats in use.
  uint32_t dropped; // Invalid splats of the file, which were left out.
  uint32_t sh_degree; // Degree of the spherical harmonics, 0 to 3.
  float near_plane; // Near plane in use, the prior's unit.
  float alpha_max; // Clamp of alpha in use, between 0 and 1.
  uint32_t antialiased; // 1: the anti-aliased mode is in use; else 0.
  float background[3]; // Background in use, linear RGB, 0 to 1.
  float centre[3]; // Median position of the splats, the prior's unit.
  float spread; // Spread of the positions around it, the prior's unit.
  uint32_t key_frames; // Key frames: poses at which a lost camera is looked for.
  // NVSP_WHITE_BALANCE_*: how the colours of the pictures that it was trained on were balanced. Encoders do the same
  // with their frames: see nvsp_encoder_options.frames_treated.
  uint32_t white_balance;
  // Tiles along a side for CLAHE, by which the contrast of those pictures was equalised, after the white balance; 0: it
  // was not.
  uint32_t clahe_tiles;
  float clahe_clip_limit; // Its clip limit, 1 to 256; 0: none.
  float trained_focal; // Trained focal length in use, pixels; 0: none is stated.
  // Of a prior in blocks (nvsp_prior_options.blocks_memory), now: blocks on the device; here and below 0 if the prior
  // is loaded whole.
  uint32_t loaded_blocks;
  uint32_t loaded_splats; // Splats on the device.
  uint32_t splat_room; // Splats that there is room for on the device.
  uint64_t host_bytes; // Bytes of splats in host memory.
  uint64_t block_changes; // How often the blocks on the device changed.
  uint64_t block_waits; // Blocks that a frame waited for: they were not read ahead.
  uint64_t repeated_searches; // Searches that were done again, since they went further than blocks had been brought.
  // Searches that lacked blocks, since there was no room for all. Their pose may be worse; their picture is whole.
  uint64_t incomplete_searches;
} nvsp_prior_info;

// What a prior, and an encoder and a decoder of it, may take at most, bytes. A view that shows more of the prior than
// the device memory was made for makes a frame take more.
typedef struct nvsp_memory_estimate {
  uint32_t struct_size, abi_version;
  uint64_t splats; // Splats that the file claims.
  uint64_t prior_host; // Host memory while the prior is opened.
  // Device memory of the prior; while it is opened, as much again if the device has a memory of its own.
  uint64_t prior_device;
  // Host memory of an encoder; 0 without a camera. The points that it knows key frames by come besides: half a MiB, and
  // 9.6 KB for each key frame.
  uint64_t encoder_host;
  uint64_t encoder_device; // Device memory of an encoder; 0 without a camera.
  uint64_t decoder_host; // Host memory of a decoder; 0 without a camera.
  uint64_t decoder_device; // Device memory of a decoder; 0 without a camera.
} nvsp_memory_estimate;

// Estimates the memory that a prior takes, before it is loaded, from the first 64 KiB of its file: what
// nvsp_engine_options.host_memory_limit is compared with. The file may claim what is not true: then opening it fails.
// Opens no device. Allocates; any thread may call it.
// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_FILE, or NVSP_ERR_PRIOR if the file is of another format.
// - `path`: the file's name, ending in NUL.
// - `camera`: the camera of encoders and decoders. NULL: their memory is not wanted.
// - `estimate`: receives the estimate.
NVSP_CHECKED nvsp_status nvsp_prior_estimate(const char *path, const struct nvsp_camera *camera,
    struct nvsp_memory_estimate *estimate);

// Describes a prior. Call it between frames of a prior in blocks: it waits for the frame under way.
// - `info`: receives the description.
NVSP_CHECKED nvsp_status nvsp_prior_get_info(const struct nvsp_prior *prior, struct nvsp_prior_info *info);

// ---- Images and poses ----

// Writes the pose on the way from one pose to another: 0 is the first, 1 the second, and each step of the way is the
// same motion. Beyond 0 to 1 it goes on. Any thread may call it.
// Fails with NVSP_ERR_ARGUMENT if a pose is no rigid motion or the part is not finite, or so large that the pose is
// not.
// - `from`, `to`: the poses, from world to camera.
// - `part`: the part of the way: of a frame number between two others, (number - first) / (second - first).
// - `between`: receives the pose.
NVSP_CHECKED nvsp_status nvsp_pose_between(const struct nvsp_pose *from, const struct nvsp_pose *to, double part,
    struct nvsp_pose *between);

// ---- Encoders ----

// Sets the rate of all frames from here on.
// Fails with NVSP_ERR_ARGUMENT.
// - `mode`: NVSP_RATE_*.
// - `value`: the number that the mode takes: quality 0 to 100, bytes, or dB. NVSP_RATE_DEFAULT and NVSP_RATE_NONE take
//   none: 0.
NVSP_CHECKED nvsp_status nvsp_encoder_set_rate(struct nvsp_encoder *encoder, uint32_t mode, float value);

// Has the next packet state prior and camera. In a stream its frame is intra. Call it if a topside asks what the
// packets are about, or if a packet was not sent.
NVSP_CHECKED nvsp_status nvsp_encoder_announce(struct nvsp_encoder *encoder);

// Tells the encoder that the topside has decoded a frame in full: nvsp_decoded.flags had NVSP_DECODED_KEPT. With
// NVSP_MODE_ACKNOWLEDGED later frames are predicted from it; else nothing changes. Nor does anything if the frame is
// unknown or too old: the last 32 can be reference frames.
// - `frame`: nvsp_decoded.frame.
NVSP_CHECKED nvsp_status nvsp_encoder_acknowledge(struct nvsp_encoder *encoder, uint32_t frame);

// Sets another camera, or another size, for all frames from here on; the next packet carries it. Lens and mask stay.
// Allocates as nvsp_encoder_create and nvsp_encoder_set_lens do. If it fails, the old camera stays.
// Fails with NVSP_ERR_ARGUMENT (the camera, or lens or mask do not fit it), NVSP_ERR_MEMORY, NVSP_ERR_VULKAN or
// NVSP_ERR_DEVICE_LOST.
// - `camera`: size, focal lengths and principal point, pixels.
NVSP_CHECKED nvsp_status nvsp_encoder_set_camera(struct nvsp_encoder *encoder, const struct nvsp_camera *camera);

// Renders up to `most` of the prior's key frames that are not rendered yet, and waits for them. With them the encoder
// finds a camera that it has lost. Without this call they are rendered while a frame is lost, as many as
// nvsp_encoder_options.search_bound allows. After nvsp_encoder_set_camera or nvsp_encoder_reopen they are rendered
// again.
// Fails with NVSP_ERR_MEMORY, NVSP_ERR_VULKAN or NVSP_ERR_DEVICE_LOST.
// - `most`: key frames to render at most; 0: only count those that are left.
// - `left`: receives how many are not rendered yet. NULL: not wanted.
NVSP_CHECKED nvsp_status nvsp_encoder_prepare(struct nvsp_encoder *encoder, uint32_t most, uint32_t *left);

// Goes on with `prior`, opened again after its device was lost, or opened on another engine. It must have the same
// identity. Frame numbers and poses carry over. If it fails, nothing changes. See nvsp_engine_reopen.
// Fails with NVSP_ERR_OTHER_PRIOR, NVSP_ERR_MEMORY, NVSP_ERR_VULKAN or NVSP_ERR_DEVICE_LOST.
// - `prior`: a live prior that was opened with `engine`.
NVSP_CHECKED nvsp_status nvsp_encoder_reopen(struct nvsp_encoder *encoder, const struct nvsp_engine *engine,
    const struct nvsp_prior *prior);

// Forgets all earlier frames: the next one is searched for as the first was, and may have any time. Frame numbers go
// on. Call it if somebody carried the camera elsewhere, for example.
NVSP_CHECKED nvsp_status nvsp_encoder_reset(struct nvsp_encoder *encoder);

// For nvsp_size_bound: a packet, with number and tag by any keys. With NVSP_RATE_BYTES the budget's size is enough,
// too.
#define NVSP_SIZE_PACKET 0
#define NVSP_SIZE_TRUTH 1 // A truth map: a byte for each block.

// Tells how many bytes always suffice for a packet or a truth map of a picture of this size; 0 if no camera can have
// it.
// - `of`: NVSP_SIZE_*.
// - `width`, `height`: the camera's size, pixels.
size_t nvsp_size_bound(uint32_t of, uint32_t width, uint32_t height);

// Begins to encode a frame on the encoder's own thread. Before it returns, on the calling thread, it checks all that it
// was given and reads the image: it converts it to RGB and scales it to the camera's size. The first such call starts
// the thread, which blocks all signals. The prior's preprocessing, the search and the coding are the other thread's
// work. The call neither waits for the device nor allocates, except for the thread. Afterwards the image is yours
// again.
//
// Until nvsp_encode_finish or nvsp_cancel ends the frame, other calls on the encoder fail with NVSP_ERR_UNFINISHED,
// except nvsp_wait and nvsp_destroy. So no packet is dropped unless you say so. Only a packet that nvsp_encode or
// nvsp_encode_finish had no room for is dropped by the next frame.
//
// With nvsp_encoder_options.pipelined a second frame may be begun at any time while one is under way or not fetched. No
// packet is dropped then: a third frame fails with NVSP_ERR_UNFINISHED. Frames end in the order in which they were
// begun; nvsp_wait and nvsp_encode_finish are about the first. Other calls may be made while no frame is searched for,
// and are about the frames begun later; nvsp_encoder_get_picture is about the frame finished last. If coding a frame
// fails, it counts as one whose packet was lost on the way. Host memory is taken up to the third frame. Example, which
// is always one packet behind:
//
//     while (next_image(&image)) {
//         status = nvsp_encode_begin(encoder, &image, NULL); /* the first with a hint in place of NULL */
//         if (status == NVSP_OK && ++begun == 2) {
//             while (nvsp_wait(encoder, 20) == NVSP_PENDING) steer();
//             status = nvsp_encode_finish(encoder, packet, sizeof packet, &bytes, &stats);
//             begun--;
//         }
//     }
// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_IMAGE, NVSP_ERR_UNSUPPORTED or NVSP_ERR_MEMORY (no thread). If the frame
// itself fails, nvsp_encode_finish returns its status.
// - `image`: the frame.
// - `info`: as for nvsp_encode.
NVSP_CHECKED nvsp_status nvsp_encode_begin(struct nvsp_encoder *encoder, const struct nvsp_image *image,
    const struct nvsp_frame_info *info);

// Fetches the packet of the frame that was begun, or the packet that nvsp_encode had no room for. Returns NVSP_PENDING
// if the frame has not ended.
// Fails with NVSP_ERR_STATE if there is none, and as nvsp_encode does. After NVSP_ERR_BUFFER_TOO_SMALL the packet is
// still there.
// - `packet`: receives the packet.
// - `size`: bytes of `packet`; nvsp_size_bound always suffices.
// - `written`: receives the packet's length, bytes, also with NVSP_ERR_BUFFER_TOO_SMALL.
// - `stats`: receives what the frame took. NULL: not wanted.
NVSP_CHECKED nvsp_status nvsp_encode_finish(struct nvsp_encoder *encoder, uint8_t *packet, size_t size,
    size_t *written, struct nvsp_frame_stats *stats);

#define NVSP_PICTURE_SHOWN 0 // What the topside will show of the last frame.
#define NVSP_PICTURE_RENDER 1 // The prior's render alone.

// Copies a picture of the last frame encoded.
// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_BUFFER_TOO_SMALL, or NVSP_ERR_STATE if there is none.
// - `which`: NVSP_PICTURE_*.
// - `picture`: receives the picture. Its pixels are yours.
NVSP_CHECKED nvsp_status nvsp_encoder_get_picture(struct nvsp_encoder *encoder, uint32_t which,
    struct nvsp_picture *picture);

// ---- What an encoder's camera sees ----

// Brown-Conrady, OpenCV's usual model. `coefficients` in OpenCV's order: k1, k2, p1, p2, k3, k4, k5, k6, of which the
// first 4, the first 5 or all 8 are given.
#define NVSP_LENS_BROWN_CONRADY 1
#define NVSP_LENS_FISHEYE 2 // Kannala-Brandt, as in OpenCV's module `fisheye`. `coefficients`: k1, k2, k3, k4.

// A lens with distortion, as OpenCV's calibration gives it. Pixel (0, 0) covers [0, 1) x [0, 1). OpenCV's own
// calibration puts pixel centres at integers: add 0.5 to its cx and cy.
typedef struct nvsp_lens {
  uint32_t struct_size, abi_version;
  uint32_t model; // NVSP_LENS_*.
  uint32_t count; // How many of `coefficients` are given; the others are zero.
  uint32_t width; // Width of the images, pixels, 1 to 16384.
  uint32_t height; // Height of the images, pixels, 1 to 16384.
  double fx; // Focal length along x, pixels of the images.
  double fy; // Focal length along y, pixels of the images.
  double cx; // Principal point, x, pixels from the left edge of the images. It must lie on them.
  double cy; // Principal point, y, pixels from the upper edge of the images. It must lie on them.
  double coefficients[8]; // The distortion, without unit; see `model`.
} nvsp_lens;

// Which pixels of an encoder's images count: one byte per pixel, white counts (128 to 255), black does not (0 to 127).
// Read during the call only.
typedef struct nvsp_mask {
  uint32_t struct_size, abi_version;
  uint32_t width; // Pixels, 1 to 16384. With a lens its width; without one of the camera's shape (1 % is tolerated).
  uint32_t height; // Pixels, 1 to 16384; as `width`.
  const uint8_t *pixels; // First byte, of the upper left pixel.
  size_t stride; // Bytes from one row to the next.
  size_t size; // Bytes in all. Nothing beyond them is read.
} nvsp_mask;

// Sets the lens that all images from here on were taken through. Each image is freed of its distortion as it is read,
// in the pass that scales it: the encoder's camera stays a pinhole, and packets are about that one. Images must then
// have the lens's size. The camera may see more than the lens: pixels that the lens does not show count as masked, see
// nvsp_encoder_set_mask. A pixel is the mean of what its footprint on the image covers: the image is first reduced by
// area averaging to about the camera's resolution, then sampled with linear interpolation, at most one reduced pixel
// apart. All of it is integer arithmetic on a map that is made here, so that an image yields the same picture on every
// machine. Allocates the map, at most 4 bytes per pixel of the lens and 48 per pixel of the camera; no frame allocates
// for it. If the call fails, the lens before stays. Example:
//
//     nvsp_lens lens = NVSP_INITIALIZER(nvsp_lens);
//     lens.model = NVSP_LENS_BROWN_CONRADY;
//     lens.width = 1920;
//     lens.height = 1080;
//     lens.fx = 1335.4, lens.fy = 1334.9, lens.cx = 962.5, lens.cy = 538.1;
//     lens.count = 5; /* k1, k2, p1, p2, k3 */
//     memcpy(lens.coefficients, calibration, 5 * sizeof(double));
//     status = nvsp_encoder_set_lens(encoder, &lens);
// Fails with NVSP_ERR_MEMORY or NVSP_ERR_ARGUMENT: the text names the field, or the corner of the image that has no
// ray, as the distortion folds the image over itself nearer to its middle. It is also given if camera and lens see
// nothing in common, or if a mask is set that has not the lens's size: take the mask away first.
// - `lens`: the lens; NULL: no lens from here on, images are of a pinhole camera.
NVSP_CHECKED nvsp_status nvsp_encoder_set_lens(struct nvsp_encoder *encoder, const struct nvsp_lens *lens);

// Sets which pixels of all images from here on count. Mask what shows the vehicle itself: its arm, its frame, a lamp.
// Masked pixels count neither in the search for the pose nor in nvsp_frame_stats, and no bytes are spent on them: the
// topside shows the prior's render there. A coarse coding may change it a little beside pixels that count. The mask may
// change from frame to frame, as the arm moves. With a lens, it masks pixels of the lens's images. If the camera's size
// changes, the mask is scaled; a pixel counts if all that it shows counts. Allocates two bytes per pixel of the mask
// and 48 per pixel of the camera. If the call fails, the mask before stays. Example:
//
//     nvsp_mask mask = NVSP_INITIALIZER(nvsp_mask);
//     mask.width = mask.stride = 640;
//     mask.height = 360;
//     mask.pixels = arm; /* 0 for a pixel of the arm, else 255 */
//     mask.size = 640 * 360;
//     status = nvsp_encoder_set_mask(encoder, &mask);
// Fails with NVSP_ERR_IMAGE (size, stride or bytes), NVSP_ERR_MEMORY, or NVSP_ERR_ARGUMENT if its size is not the
// lens's, its shape not the camera's, or no pixel counts.
// - `mask`: which pixels count; NULL: all pixels count.
NVSP_CHECKED nvsp_status nvsp_encoder_set_mask(struct nvsp_encoder *encoder, const struct nvsp_mask *mask);

// Sets which parts of the picture get more of the bytes from here on: what the pilot looks at. `weights` has `columns`
// times `rows` values from 1 to 255, row by row, laid over the picture in cells of equal size. An error in a cell of
// weight 8 counts eight times as much as one in a cell of weight 1. At the same budget the other parts get fewer bytes;
// NVSP_RATE_PSNR stays that of the whole picture. The topside needs to know nothing of it. It may change from frame to
// frame, as the pilot's cursor moves. Allocates a byte per cell. If the call fails, the weights before stay. Example:
//
//     uint8_t weights[9] = {1, 1, 1, 1, 8, 1, 1, 1, 1}; /* the middle ninth */
//     status = nvsp_encoder_set_interest(encoder, 3, 3, weights, sizeof weights);
// Fails with NVSP_ERR_MEMORY, or NVSP_ERR_ARGUMENT if a side has no cells or more than 4096, `size` is not columns
// times rows, or a weight is 0.
// - `weights`: their values. NULL, with sides and size of 0: all parts count the same.
NVSP_CHECKED nvsp_status nvsp_encoder_set_interest(struct nvsp_encoder *encoder, uint32_t columns, uint32_t rows,
    const uint8_t *weights, size_t size);

// ---- Decoders ----

// Tells the decoder about a camera that packets only name. So a topside that joins late need not wait until the camera
// is sent again. The decoder knows the last 256 cameras.
// Fails with NVSP_ERR_ARGUMENT, or NVSP_ERR_MEMORY (more pixels than the engine allows).
// - `camera`: size, focal lengths and principal point, pixels.
NVSP_CHECKED nvsp_status nvsp_decoder_add_camera(struct nvsp_decoder *decoder, const struct nvsp_camera *camera);

// Has a small network filter decoded pictures from the next packet on, or not. A filtered picture looks more like what
// the camera saw, if the network knows the scene. Its weights are the prior's (which `nvsprior prior filter` trains),
// or the library's. At first it is off, as it takes time on the device. Nothing is predicted from a filtered picture:
// packets and their truth maps stay as they are. Pictures without a difference picture, and those of other coders than
// the wavelet coder, are not filtered; NVSP_DECODED_FILTERED tells.
//
// Builds a pipeline, and takes 20 bytes of device memory per pixel with the next packet of a camera. Fails with
// NVSP_ERR_ARGUMENT, NVSP_ERR_MEMORY, NVSP_ERR_VULKAN or NVSP_ERR_DEVICE_LOST; it is then off.
// - `on`: 1: filter pictures. 0: do not.
NVSP_CHECKED nvsp_status nvsp_decoder_set_filter(struct nvsp_decoder *decoder, uint32_t on);

// Goes on with `prior`, opened again after its device was lost, or opened on another engine. It must have the same
// identity. The known cameras carry over. See nvsp_engine_reopen.
// Fails with NVSP_ERR_OTHER_PRIOR.
// - `prior`: a live prior that was opened with `engine`.
NVSP_CHECKED nvsp_status nvsp_decoder_reopen(struct nvsp_decoder *decoder, const struct nvsp_engine *engine,
    const struct nvsp_prior *prior);

// Begins to decode a packet on the decoder's own thread. Before it returns, it checks what it was given and copies the
// packet; it does not wait. The first such call starts the thread. Until nvsp_decode_finish or nvsp_cancel ends the
// packet, other calls on the decoder fail with NVSP_ERR_UNFINISHED, except nvsp_wait and nvsp_destroy. A picture that
// nvsp_decode or nvsp_decode_finish had no room for is dropped by the next packet.
// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_MEMORY (no thread, or no copy of the packet), or, with keys, NVSP_ERR_FOREIGN
// or NVSP_ERR_REPLAYED. If the packet itself fails, nvsp_decode_finish returns its status.
// - `packet`: the packet.
// - `size`: bytes of `packet`.
// - `flags`: NVSP_DECODE_START, or 0.
NVSP_CHECKED nvsp_status nvsp_decode_begin(struct nvsp_decoder *decoder, const uint8_t *packet, size_t size,
    uint32_t flags);

// Fetches the picture of the packet that was begun, or the picture that nvsp_decode had no room for. Returns
// NVSP_PENDING if the packet has not ended.
// Fails with NVSP_ERR_STATE if there is none, and as nvsp_decode does. After NVSP_ERR_BUFFER_TOO_SMALL the picture is
// still there.
// - `picture`: receives the picture. Its pixels are yours. NULL: not wanted.
// - `info`: receives what the packet yielded. NULL: not wanted.
NVSP_CHECKED nvsp_status nvsp_decode_finish(struct nvsp_decoder *decoder, struct nvsp_picture *picture,
    struct nvsp_decoded *info);

// Draws the prior at a pose, as the camera of the packet decoded last sees it: for frames of which nothing came, at a
// pose between those of frames that did (nvsp_pose_between). Waits for a lock of the device's queue, and for the
// device. Memory as for nvsp_decode: nothing from the second call on.
// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_STATE (no packet was decoded), NVSP_ERR_BUFFER_TOO_SMALL, NVSP_ERR_MEMORY,
// NVSP_ERR_VULKAN or NVSP_ERR_DEVICE_LOST.
// - `pose`: the pose, from world to camera.
// - `picture`: receives the picture. Its pixels are yours.
NVSP_CHECKED nvsp_status nvsp_decoder_draw(struct nvsp_decoder *decoder, const struct nvsp_pose *pose,
    struct nvsp_picture *picture);

// Reads a packet's header without a device. Needs the latent part: the first 20 bytes of the packet, 24 if it states
// prior and camera. Of a packet with a tag give what is behind it. Gives the pose only if the packet is about `prior`.
// A packet that does not state its prior counts as about `prior`. Any thread may call it.
// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_PACKET (also if the pose is predicted from those of earlier packets), or
// NVSP_ERR_NEWER.
// - `packet`: the packet, or its start.
// - `size`: bytes of it that are there, 64 or more if it has as many.
// - `prior`: a live prior. NULL: the pose is not wanted.
// - `header`: receives what the packet says.
NVSP_CHECKED nvsp_status nvsp_decode_header(const uint8_t *packet, size_t size, const struct nvsp_prior *prior,
    struct nvsp_decoded *header);

// ---- How far a picture is from what the camera saw ----

#define NVSP_TRUTH_AS_SEEN 0 // A block is as the camera saw it.
#define NVSP_TRUTH_DIFFERS 1 // It differs from what the camera saw.
#define NVSP_TRUTH_WRONG 2 // It is wrong.
#define NVSP_TRUTH_NOT_SEEN 3 // Nothing is known of it: it is memory.

// What the levels of a truth map are about.
typedef struct nvsp_truth {
  uint32_t struct_size, abi_version;
  uint32_t columns; // Blocks in a row.
  uint32_t rows; // Rows of blocks.
  uint32_t block_size; // Pixels a side of a block. Those at the right and the lower edge of the picture may be smaller.
  // A block differs if a window of this size near it is off by more than that: the root of the mean squared error over
  // pixels and colours, values of 0 to 255. 0: nothing is known, and all blocks are NVSP_TRUTH_NOT_SEEN.
  float differs_above;
  float wrong_above; // It is wrong if one is off by more than that.
  uint32_t reserved; // Zero.
} nvsp_truth;

// Tells how far the picture that was decoded or drawn last is from what the camera saw, block by block. Show it with
// the picture: a prior draws what it remembers as sharply as what is there. The map never says less than what is true,
// also if the packet was cut. It may say more of a block, if it has no room to say what is true.
//
// All blocks are NVSP_TRUTH_NOT_SEEN if the packet had no map (nvsp_encoder_options.no_truth), if the difference
// picture that its map is about did not arrive, if the render is not the vehicle's (NVSP_DECODED_OTHER_RENDER), or if
// nvsp_decoder_draw drew the picture. A packet that is refused changes nothing: the map stays that of the picture
// before. Example:
//
//     nvsp_truth truth = NVSP_INITIALIZER(nvsp_truth);
//     size_t size = nvsp_size_bound(NVSP_SIZE_TRUTH, info.width, info.height);
//     status = nvsp_decoder_get_truth(decoder, levels, size, &bytes, &truth);
//     if (levels[y / truth.block_size * truth.columns + x / truth.block_size] == NVSP_TRUTH_WRONG) warn(x, y);
// Fails with NVSP_ERR_STATE (no picture yet) or NVSP_ERR_BUFFER_TOO_SMALL.
// - `levels`: receives NVSP_TRUTH_* of the blocks, row by row, a byte each.
// - `size`: bytes of `levels`; nvsp_size_bound suffices.
// - `written`: receives the bytes that the map takes.
// - `truth`: receives what they are about. NULL: not wanted.
NVSP_CHECKED nvsp_status nvsp_decoder_get_truth(struct nvsp_decoder *decoder, uint8_t *levels, size_t size,
    size_t *written, struct nvsp_truth *truth);

// ---- The vehicle's end of a link ----

#define NVSP_EVENT_HEARD 1 // The other end is heard for the first time, or again.
#define NVSP_EVENT_SILENT 2 // Nothing of the other end has come for `value` seconds. A vehicle sends all the same.
// `value` things came that are not of the other end, and nothing of it: both ends need the same MTU, keys and epoch.
#define NVSP_EVENT_STRANGERS 3
// Store `data` before more goes: with it as `state` in its options an end goes on after a restart. An end tells it at
// its beginning, and then rarely.
#define NVSP_EVENT_STORE 4
#define NVSP_EVENT_USER 5 // User bytes came: `data`. A topside tells of which frame: `frame`.
// Of a vehicle: a frame was coded and is on its way, or it failed: `frame`, `status`, and if that is NVSP_OK `bytes`,
// `certain` and `value`, its PSNR in dB.
#define NVSP_EVENT_FRAME 6
// Of a vehicle: the topside asks for prior and camera. The next packet of its encoder states them; without an encoder
// do it yourself (nvsp_encoder_announce).
#define NVSP_EVENT_ASKED 7
// Of a vehicle: the pilot's region of interest is another one: `region` and `weight`; a weight of 0: there is none.
#define NVSP_EVENT_REGION 8
// Of a vehicle: frames come too slowly, or as they should again: it plans for `value` per second from here on.
#define NVSP_EVENT_FRAME_RATE 9
// Of a topside: packets that come cannot be shown, and `status` says why; NVSP_OK: they can again.
#define NVSP_EVENT_REFUSED 10

#define NVSP_MAX_DATA 264 // Most bytes of nvsp_event.data.

// What an end tells. The comment of its kind names the fields that it sets; the others are zero.
typedef struct nvsp_event {
  uint32_t struct_size, abi_version;
  uint32_t kind; // NVSP_EVENT_*.
  uint32_t frame; // Number of the frame.
  double value; // A number: see the kind.
  nvsp_status status; // NVSP_OK, or why a frame failed.
  uint32_t bytes; // Bytes of the frame's packet.
  uint32_t certain; // 1: the picture confirms the frame's pose; else 0.
  uint32_t weight; // How much more an error in the region counts.
  float region[4]; // Left, top, right and bottom of the region, as parts of the picture, 0 to 1.
  uint32_t data_size; // Bytes of `data`.
  uint32_t reserved; // Zero.
  uint8_t data[NVSP_MAX_DATA]; // User bytes, or a state.
} nvsp_event;

// For the flags of both ends' options: times of calls are UTC in seconds. A picture's age is then known before a report
// came, if the clocks are right. Without it times are on any clock of that side.
#define NVSP_LINK_UTC 1
#define NVSP_LINK_NO_REPORTS 2 // There are no reports: the link has no way back. Give both ends the same.
// Of a vehicle: the modem asks for modem frames when it has room, as it also carries other traffic. `bit_rate` is 0.
#define NVSP_LINK_PULL 4
// Of a vehicle: packets go as they come, with NVSP_LINK_UNPROTECTED. `bit_rate` is 0, and the encoder keeps its rate.
#define NVSP_LINK_AS_THEY_COME 8
// Of a vehicle: no protection against losses: the link loses nothing, or what a report misses is sent again. Needs
// stream 0, and no user bytes travel. Below an MTU of 16 a packet has at most 8 modem frames, and the modem must find
// damage.
#define NVSP_LINK_UNPROTECTED 16
// Of a vehicle: packets do not tell when their frame was exposed, which takes two bytes. No user bytes travel then.
#define NVSP_LINK_NO_STAMPS 32
// Of a vehicle: poses are stated in full, even if the topside holds others that they could be predicted from.
#define NVSP_LINK_STATE_POSES 64
// Of a topside: the modem hands over no damaged frames. What comes then counts as valid.
#define NVSP_LINK_MODEM_CHECKS 128

#define NVSP_NONE -1.0 // For fields of both ends' options that have another default than 0: none, 0.

// How a vehicle sends. MTU, bit rate and frame rate must be stated; NVSP_LINK_PULL and NVSP_LINK_AS_THEY_COME do
// without a bit rate, and the latter without a frame rate.
typedef struct nvsp_vehicle_options {
  uint32_t struct_size, abi_version;
  // Most bytes of a modem frame, 8 to 65535; with protection from 16, with keys from as many more as they take. The
  // topside needs the same.
  uint32_t mtu;
  uint32_t flags; // NVSP_LINK_* flags.
  double bit_rate; // What the link carries, or the part of it that is for pictures, bit/s.
  double frame_rate; // Camera frames per second: numbers count all of them, also those that never come here.
  double picture_rate; // Most pictures per second. 0: as many as frames.
  // Longest time from the exposure of a frame to the end of its packet's last modem frame, seconds. 0: 1.5.
  double latency;
  double delay; // What of it is no transmission: search, coding, propagation; seconds. 0: 0.3. NVSP_NONE: none.
  // Seconds from a packet's first modem frame to its last one. Those of other packets lie between them, so a burst of
  // losses takes few of each. 0: a quarter of what the delay leaves. NVSP_NONE: they follow each other.
  double spread;
  double loss; // Chance that a modem frame is lost, below 1; reports tell how it is. 0: 0.1. NVSP_NONE: none is lost.
  double burst; // Mean number of modem frames that are lost in a row, 1 or more. 0: 1.
  // What each modem frame costs on the link beside its bytes (preamble, the modem's own header), as bytes.
  uint32_t overhead;
  uint32_t min_bytes; // Fewest bytes for a picture, all counted: below it frames are left out. 0: 40.
  // Most modem frames of a packet: up to 64, without protection up to 2048. 0: as many as MTU and rate take.
  uint32_t max_shares;
  uint32_t user_bytes; // User bytes that travel with each packet, up to 253; with it they come or are lost.
  uint32_t stream; // The stream, 0 to 3: up to four cameras share a link, each with a vehicle.
  uint32_t state_size; // Bytes of `state`.
  // Each modem frame gets a number and a tag by these keys, and reports need one, too. They take nvsp_keys.tag_bytes
  // and 2 bytes of each modem frame. Read during the call. NULL: none.
  const struct nvsp_keys *keys;
  // What this end had you store last (NVSP_EVENT_STORE), before it started again. Read during the call. NULL: it begins
  // anew.
  const uint8_t *state;
} nvsp_vehicle_options;

// Makes a vehicle's end. Takes all its memory here, as nvsp_vehicle_memory tells, and what nvsp_encoder_create takes.
// Fails with NVSP_ERR_ARGUMENT: the text names the option and what it allows. It is the engine's, and that of
// nvsp_last_error(NULL). Fails also with NVSP_ERR_MEMORY, and as nvsp_encoder_create.
// - `engine`: NULL, with `prior` and `camera`: there is no encoder. Give packets: nvsp_vehicle_packet.
// - `prior`: a live prior that was opened with `engine`.
// - `camera`: size, focal lengths and principal point, pixels.
// - `encoder_options`: how to encode. The vehicle sets the rate (but for NVSP_LINK_AS_THEY_COME), the first frame's
//   number and the keys: leave them at 0. NULL: all defaults.
// - `options`: how to send.
// - `vehicle`: receives the vehicle, which nvsp_destroy ends.
NVSP_CHECKED nvsp_status nvsp_vehicle_create(const struct nvsp_engine *engine, const struct nvsp_prior *prior,
    const struct nvsp_camera *camera, const struct nvsp_encoder_options *encoder_options,
    const struct nvsp_vehicle_options *options, struct nvsp_vehicle **vehicle);

// Tells how much memory a vehicle takes besides its encoder. Any thread may call it.
// Fails with NVSP_ERR_ARGUMENT, as nvsp_vehicle_create.
// - `options`: how to send.
// - `bytes`: receives the bytes.
NVSP_CHECKED nvsp_status nvsp_vehicle_memory(const struct nvsp_vehicle_options *options, uint64_t *bytes);

// Gives the vehicle's encoder, for its lens, mask, camera, reset and key frames (nvsp_encoder_prepare), and its
// pictures. It is the vehicle's: frames and rates come by the vehicle alone, and nvsp_destroy on it does nothing. NULL:
// there is none, or the vehicle is in use.
struct nvsp_encoder *nvsp_vehicle_encoder(struct nvsp_vehicle *vehicle);

// Counts a camera frame, and begins to code it on the encoder's own thread, as nvsp_encode_begin does. Give all frames
// of the camera. Returns NVSP_PENDING if it is left out: the link has no bytes for it, or the encoder is busy.
// NVSP_EVENT_FRAME tells what came of it; nvsp_vehicle_transmit sends it.
// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_IMAGE, NVSP_ERR_UNSUPPORTED or NVSP_ERR_MEMORY (no thread), and with
// NVSP_ERR_STATE if there is no encoder.
// - `image`: the frame.
// - `info`: what is known of the frame. Its `time` is the exposure, seconds on the clock of `now`; it has no
//   `left_out`. NULL: nothing is known, and it was exposed now.
// - `user`: user bytes that travel with it. NULL only if `user_size` is 0.
// - `user_size`: bytes of `user`: nvsp_vehicle_options.user_bytes.
NVSP_CHECKED nvsp_status nvsp_vehicle_frame(struct nvsp_vehicle *vehicle, double now, const struct nvsp_image *image,
    const struct nvsp_frame_info *info, const uint8_t *user, size_t user_size);

// Counts a camera frame that you encode yourself, and tells how: with NVSP_RATE_STEADY and as many bytes. Returns
// NVSP_PENDING if it is left out, as the link has no bytes for it, and writes nothing then. With NVSP_LINK_AS_THEY_COME
// no frame needs a plan.
// Fails with NVSP_ERR_STATE (the vehicle has an encoder).
// - `exposed`: when it was exposed, seconds.
// - `number`: receives its number: nvsp_frame_info.left_out makes it the encoder's. NULL: not wanted.
// - `bytes`: receives the bytes.
NVSP_CHECKED nvsp_status nvsp_vehicle_plan(struct nvsp_vehicle *vehicle, double now, double exposed, uint32_t *number,
    uint32_t *bytes);

// Takes the packet of the frame that was planned last. One that also tells the camera may be longer than planned: it
// takes more of the link for once.
// Fails with NVSP_ERR_ARGUMENT (the time, or `user_size`), NVSP_ERR_PACKET (not exactly one packet, or without
// protection longer than its modem frames hold), NVSP_ERR_STATE (no frame was planned, or the vehicle has an encoder),
// NVSP_ERR_BUDGET (all its modem frames do not hold a picture) or NVSP_ERR_UNFINISHED (too many modem frames wait:
// nobody takes them). Nothing of it is sent then.
// - `now`: when it is ready, seconds.
// - `packet`: the packet.
// - `size`: bytes of `packet`.
// - `user`: user bytes that travel with it. NULL only if `user_size` is 0.
// - `user_size`: bytes of `user`: nvsp_vehicle_options.user_bytes.
NVSP_CHECKED nvsp_status nvsp_vehicle_packet(struct nvsp_vehicle *vehicle, double now, const uint8_t *packet,
    size_t size, const uint8_t *user, size_t user_size);

// Takes what the modem received. Of a report the vehicle learns what the topside holds, which modem frames to send
// again, and what the link loses.
// Fails with NVSP_ERR_PACKET, NVSP_ERR_STATE, NVSP_ERR_FOREIGN or NVSP_ERR_REPLAYED if it is no report for this
// vehicle: that is no failure of the link.
// - `bytes`: what was received.
// - `size`: how many bytes.
NVSP_CHECKED nvsp_status nvsp_vehicle_receive(struct nvsp_vehicle *vehicle, double now, const uint8_t *bytes,
    size_t size);

// Takes what the encoder has finished, then writes the next modem frame that is due. Call it when the modem is free, or
// with NVSP_LINK_PULL when it asks. Returns NVSP_PENDING if none is due, or none of so few bytes waits.
// - `most`: bytes of `bytes`: the MTU, or what the modem has room for.
// - `bytes`: receives the modem frame.
// - `written`: receives its length, bytes.
// - `next`: receives when to call again at the latest, seconds, also with NVSP_PENDING. It may have passed. Infinite:
//   nothing waits. NULL: not wanted.
NVSP_CHECKED nvsp_status nvsp_vehicle_transmit(struct nvsp_vehicle *vehicle, double now, size_t most, uint8_t *bytes,
    size_t *written, double *next);

// Fetches the next event. Returns NVSP_PENDING if there is none. If nobody fetches them, the first ones go.
// - `event`: receives it.
NVSP_CHECKED nvsp_status nvsp_vehicle_event(struct nvsp_vehicle *vehicle, struct nvsp_event *event);

// Counts bytes that you give to the link besides, for example telemetry: pictures get the fewer.
// - `bytes`: their number, with what they cost beside themselves.
NVSP_CHECKED nvsp_status nvsp_vehicle_count(struct nvsp_vehicle *vehicle, double now, uint32_t bytes);

// Sets what the link is like from `now` on. Reports tell the loss by themselves.
// Fails with NVSP_ERR_ARGUMENT, or NVSP_ERR_STATE if the vehicle goes by no bit rate. Nothing changes then.
// - `bit_rate`: bit/s. Negative: it stays.
// - `loss`: chance that a modem frame is lost, below 1; here 0 means that none is. Negative: it stays.
// - `burst`: mean number of modem frames that are lost in a row, 1 or more. Negative: it stays.
NVSP_CHECKED nvsp_status nvsp_vehicle_set_link(struct nvsp_vehicle *vehicle, double now, double bit_rate, double loss,
    double burst);

// ---- The topside's end of a link ----

// How a topside receives. The MTU must be stated.
typedef struct nvsp_topside_options {
  uint32_t struct_size, abi_version;
  uint32_t mtu; // Most bytes of a modem frame, 8 to 65535: the vehicle's. What lies beyond it is padding.
  uint32_t flags; // NVSP_LINK_* flags.
  // 0: the newest picture, as it comes and as it gets better. Else each frame once, in order, as soon as its packet is
  // whole, and so many seconds after its exposure at the latest; between frames that came the prior is drawn at poses
  // between.
  double latency;
  // In order: the camera's frames per second. 0: not known; frames have the time at which they began to come.
  double frame_rate;
  // Seconds after which a packet is stale. Less than 128 of the camera's frames take; below an MTU of 16 less than 4.
  // 0: 4; in order 2 more than the latency, and no more than 60 frames take.
  double age;
  double report_every; // Seconds between two reports. 0: 1.
  // Modem frames of a packet that there is room for, up to 2048. Of a longer unprotected packet the start is kept. 0:
  // as many as 65536 bytes take, 16 or more.
  uint32_t max_shares;
  uint32_t packets; // Packets that are held, up to 64; below an MTU of 16 up to 4. 0: 64.
  uint32_t stream; // The stream that is taken, 0 to 3.
  uint32_t state_size; // Bytes of `state`.
  // Only modem frames that a vehicle has made with one of these keys are taken, and none a second time. Reports get a
  // tag by the first. Read during the call. NULL: none, and whatever comes is taken.
  const struct nvsp_keys *keys;
  // What this end had you store last (NVSP_EVENT_STORE), before it started again. Read during the call. NULL: it begins
  // anew.
  const uint8_t *state;
} nvsp_topside_options;

// Makes a topside's end. Takes its memory here, as nvsp_topside_memory tells; the decoder takes its own as nvsp_decode
// does. In order, a stream's pictures that came before their turn take more.
// Fails with NVSP_ERR_ARGUMENT: the text names the option and what it allows. It is the engine's, and that of
// nvsp_last_error(NULL). Fails also with NVSP_ERR_MEMORY.
// - `engine`: NULL, with `prior`: there is no decoder. Take packets: nvsp_topside_packet.
// - `prior`: a live prior that was opened with `engine`.
// - `options`: how to receive.
// - `topside`: receives the topside, which nvsp_destroy ends.
NVSP_CHECKED nvsp_status nvsp_topside_create(const struct nvsp_engine *engine, const struct nvsp_prior *prior,
    const struct nvsp_topside_options *options, struct nvsp_topside **topside);

// Tells how much memory a topside takes besides its decoder. Any thread may call it.
// Fails with NVSP_ERR_ARGUMENT, as nvsp_topside_create.
// - `options`: how to receive.
// - `bytes`: receives the bytes.
NVSP_CHECKED nvsp_status nvsp_topside_memory(const struct nvsp_topside_options *options, uint64_t *bytes);

// Gives the topside's decoder, for its filter, cameras and truth map (nvsp_decoder_get_truth: of the picture that was
// fetched last). It is the topside's: packets come by the topside alone, and nvsp_destroy on it does nothing. NULL:
// there is none, or the topside is in use.
struct nvsp_decoder *nvsp_topside_decoder(struct nvsp_topside *topside);

// Takes what the modem received. Modem frames may come in any order, repeated, padded or damaged, and mixed with
// others.
// Fails with NVSP_ERR_PACKET or NVSP_ERR_NEWER if it is none of the vehicle's, damaged, too late, of another stream, or
// of more than there is room for; with keys NVSP_ERR_FOREIGN or NVSP_ERR_REPLAYED. That is no failure of the link, and
// what came before is not lost.
// - `bytes`: what was received.
// - `size`: how many bytes.
NVSP_CHECKED nvsp_status nvsp_topside_receive(struct nvsp_topside *topside, double now, const uint8_t *bytes,
    size_t size);

// Fetches the next picture to show. If none is there, begins to decode what came on the decoder's own thread, and
// returns NVSP_PENDING: call it again, at once or after nvsp_wait. Packets that cannot be shown are no failure:
// NVSP_EVENT_REFUSED tells.
// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_BUFFER_TOO_SMALL (the picture is kept), NVSP_ERR_MEMORY, NVSP_ERR_VULKAN or
// NVSP_ERR_DEVICE_LOST, and with NVSP_ERR_STATE if there is no decoder.
// - `picture`: receives the picture. Its pixels are yours.
// - `shown`: receives what is known of it. NULL: not wanted.
NVSP_CHECKED nvsp_status nvsp_topside_picture(struct nvsp_topside *topside, double now, struct nvsp_picture *picture,
    struct nvsp_decoded *shown);

// For who decodes elsewhere: fetches the next packet, or the start of one that came. Give it to nvsp_decode with
// NVSP_DECODE_START. Returns NVSP_PENDING if there is none now.
// Fails with NVSP_ERR_ARGUMENT, NVSP_ERR_BUFFER_TOO_SMALL (the packet is kept until newer ones take its place), or
// NVSP_ERR_STATE (the topside has a decoder).
// - `packet`: receives the packet.
// - `size`: bytes of `packet`; nvsp_topside_options.max_shares times the MTU always suffices.
// - `written`: receives the number of bytes, also with NVSP_ERR_BUFFER_TOO_SMALL.
// - `shown`: receives what is known of it without decoding. NULL: not wanted.
NVSP_CHECKED nvsp_status nvsp_topside_packet(struct nvsp_topside *topside, double now, uint8_t *packet, size_t size,
    size_t *written, struct nvsp_decoded *shown);

// Writes the report that is due, as a modem frame for the way back. Returns NVSP_PENDING if none is; while a packet is
// decoded it waits for that. Reports are made only while the vehicle is heard.
// Fails with NVSP_ERR_BUFFER_TOO_SMALL: the MTU is needed.
// - `report`: receives the report.
// - `size`: bytes of `report`.
// - `written`: receives the number of bytes, also with NVSP_ERR_BUFFER_TOO_SMALL.
// - `next`: receives when to call again at the latest, seconds, for a report or a picture in order. Infinite: nothing
//   waits. NULL: not wanted.
NVSP_CHECKED nvsp_status nvsp_topside_report(struct nvsp_topside *topside, double now, uint8_t *report, size_t size,
    size_t *written, double *next);

// Fetches the next event. Returns NVSP_PENDING if there is none. If nobody fetches them, the first ones go.
// - `event`: receives it.
NVSP_CHECKED nvsp_status nvsp_topside_event(struct nvsp_topside *topside, struct nvsp_event *event);

// Has what the pilot looks at get more of the bytes, from the next report on, which is due at once.
// Fails with NVSP_ERR_ARGUMENT: the rectangle is empty, or not in the picture.
// - `left`, `top`, `right`, `bottom`: parts of the picture, 0 to 1.
// - `weight`: how much more an error in it counts, up to 255. 0: there is no region, and the others do not count.
NVSP_CHECKED nvsp_status nvsp_topside_set_region(struct nvsp_topside *topside, double left, double top, double right,
    double bottom, uint32_t weight);

// Sets the user bytes of all reports from here on. A report that has no room for them goes without.
// Fails with NVSP_ERR_ARGUMENT: more than 247.
// - `user`: the user bytes. NULL only if `size` is 0.
// - `size`: bytes of `user`, up to 247.
NVSP_CHECKED nvsp_status nvsp_topside_set_user(struct nvsp_topside *topside, const uint8_t *user, size_t size);

#ifdef __cplusplus
} /* extern "C" */
#endif

#endif /* NVSPRIOR_H */
