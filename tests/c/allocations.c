// After the first frame, encoding, sending, collecting, repair of losses and decoding take nothing from the heap within
// libnvsprior.so. The test prints what loader and driver take.
//
// This program's own malloc, calloc and so on replace the C library's. They count a call for the library that makes it.

#define _GNU_SOURCE

#include "common.h"
#include "heap_hooks.h"

#include <dlfcn.h>
#include <nvsprior_extra.h>
#include <pthread.h>

#define LIBRARIES 64
#define CALLERS 4096  // A power of two.

static struct {
    const char *path;  // As the dynamic linker has it: one pointer for a library.
    long calls;
} libraries[LIBRARIES];

static struct {
    const void *address;
    int library;
} callers[CALLERS];

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static int counting;  // Under the lock.
static long uncounted;

// The library that an address lies in; each distinct address is looked up once.
static int library_of(const void *address) {
    size_t at = ((size_t)address >> 2) * 0x9e3779b97f4a7c15u >> 52;
    while (callers[at].address != NULL && callers[at].address != address) {
        at = (at + 1) % CALLERS;
    }
    if (callers[at].address == address) {
        return callers[at].library;
    }
    Dl_info info;
    const char *path = dladdr(address, &info) != 0 ? info.dli_fname : "(none)";
    int library = 0;
    while (library < LIBRARIES - 1 && libraries[library].path != NULL
           && strcmp(libraries[library].path, path) != 0) {
        library++;
    }
    libraries[library].path = path;
    callers[at].address = address;
    callers[at].library = library;
    return library;
}

static int heap_refused(const void *caller) {
    static __thread int inside;  // What dladdr might take is not counted.
    if (inside) {
        return 0;
    }
    inside = 1;
    pthread_mutex_lock(&lock);
    if (counting) {
        libraries[library_of(caller)].calls++;
    } else {
        uncounted++;
    }
    pthread_mutex_unlock(&lock);
    inside = 0;
    return 0;
}

static void start_counting(void) {
    pthread_mutex_lock(&lock);
    for (int i = 0; i < LIBRARIES; i++) {
        libraries[i].calls = 0;
    }
    counting = 1;
    pthread_mutex_unlock(&lock);
}

// Stops, prints the counts, and gives that of libnvsprior.
static long stop_counting(const char *what) {
    pthread_mutex_lock(&lock);
    counting = 0;
    pthread_mutex_unlock(&lock);
    long own = 0;
    printf("%s:\n", what);
    for (int i = 0; i < LIBRARIES; i++) {
        if (libraries[i].path != NULL && libraries[i].calls > 0) {
            const char *slash = strrchr(libraries[i].path, '/');
            const char *name = slash == NULL ? libraries[i].path : slash + 1;
            printf("    %8ld  %s\n", libraries[i].calls, name);
            own += strncmp(name, "libnvsprior", 11) == 0 ? libraries[i].calls : 0;
        }
    }
    printf("    %8ld  from within libnvsprior\n", own);
    return own;
}

static nvsp_sender *sender, *unprotected;
static nvsp_collector *collector, *clean;
static uint8_t sent[8192], arrived[8192];
static uint8_t *pixels;

// The same packet as shares, some of which are lost.
static void lossy_way(int number, size_t size) {
    const double now = number / 2.0;
    uint32_t budget = 0, lost = 0;
    uint8_t share[64], bits[32];
    size_t written = 0;
    nvsp_collected state;
    nvsp_collector_statistics statistics;
    MUST(NVSP_INIT(&state));
    MUST(NVSP_INIT(&statistics));
    MUST(nvsp_sender_plan(sender, now, &budget));
    if (budget == 0) {
        return;
    }
    MUST(nvsp_sender_push(sender, now, sent, size, NULL, 0, NULL));
    while (nvsp_sender_next(sender, now, share, sizeof share, &written) == NVSP_OK) {
        if (lost++ % 5 == (uint32_t)number % 5) {
            continue;
        }
        MUST(nvsp_collector_push(collector, now, share, written, &state));
        // Twice, and damaged: it is refused, with a text.
        MUST(nvsp_collector_push(collector, now, share, written, NULL));
        share[written - 1] ^= 1;
        CHECK(nvsp_collector_push(collector, now, share, written, NULL) == NVSP_ERR_MODEM);
    }
    if (nvsp_collector_newest(collector, 0, &state) == NVSP_OK) {
        MUST(nvsp_collector_fetch(collector, 0, state.frame, arrived, sizeof arrived, &written, &state));
        MUST(nvsp_collector_arrived(collector, 0, state.frame, bits, sizeof bits, &lost));
        MUST(nvsp_collector_missing(collector, 0, state.frame, NULL, 0, &lost));
        MUST(nvsp_decode(both.decoder, arrived, written, NVSP_DECODE_START, NULL, NULL));
    }
    MUST(nvsp_collector_get_statistics(collector, &statistics));
    MUST(nvsp_sender_set_loss(sender, number % 2 ? 0.3 : 0.1, 2));
    memcpy(arrived, sent, size);
}

// Takes a frame from the camera to the topside's screen. Odd frames use the threads of encoder and decoder.
static void whole_way(int number) {
    const int turn = 2 * dive.frames - 2, at = number % turn;
    const nvsp_image image = scene_image(&dive, at < dive.frames ? at : turn - at);
    const nvsp_pose *hint = number == 0 ? &dive.poses[0] : NULL;
    nvsp_picture place = place_of(pixels, dive.camera.width, dive.camera.height);
    nvsp_header header;
    nvsp_decoded info;
    nvsp_frame_stats stats;
    MUST(NVSP_INIT(&header));
    MUST(NVSP_INIT(&info));
    MUST(NVSP_INIT(&stats));
    size_t size = 0;
    if (number % 2) {
        MUST(nvsp_encode_begin(both.encoder, &image, with_hint(hint)));
        MUST(nvsp_wait(both.encoder, 60000));
        MUST(nvsp_encode_finish(both.encoder, sent, sizeof sent, &size, &stats));
    } else {
        MUST(nvsp_encode(both.encoder, &image, with_hint(hint), sent, sizeof sent, &size, &stats));
    }
    MUST(nvsp_encoder_get_picture(both.encoder, NVSP_PICTURE_SHOWN, &place));
    MUST(nvsp_sender_push(unprotected, 0, sent, size, NULL, 0, NULL));
    uint8_t frame[64];
    size_t written = 0;
    nvsp_collected state = NVSP_INITIALIZER(nvsp_collected);
    while (nvsp_sender_next(unprotected, 0, frame, sizeof frame, &written) == NVSP_OK) {
        MUST(nvsp_collector_push(clean, 0, frame, written, &state));
    }
    MUST(nvsp_collector_fetch(clean, 0, state.frame, arrived, sizeof arrived, &size, NULL));
    lossy_way(number, size);
    MUST(nvsp_decode_header(arrived, size, both.prior, &header));
    if (number % 2) {
        MUST(nvsp_decode_begin(both.decoder, arrived, size, NVSP_DECODE_START));
        MUST(nvsp_wait(both.decoder, 60000));
        MUST(nvsp_decode_finish(both.decoder, &place, &info));
    } else {
        MUST(nvsp_decode(both.decoder, arrived, size, 0, &place, &info));
    }
    // And the start of it, as after a loss.
    MUST(nvsp_decode(both.decoder, arrived, size - size / 3, NVSP_DECODE_START, &place, &info));
    MUST(nvsp_decoder_draw(both.decoder, &dive.poses[0], &place));
}

// Two frames under way at once, through a lens, with a mask.
static void two_at_once(void) {
    nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
    options.pipelined = 1;
    options.camera_interval = 10;
    rig_add(&both, &dive.camera, &options);
    nvsp_lens lens = {NVSP_HEAD(nvsp_lens), .model = NVSP_LENS_FISHEYE, .count = 4, .width = dive.camera.width,
                      .height = dive.camera.height, .fx = 78, .fy = 78, .cx = 48, .cy = 27};
    MUST(nvsp_encoder_set_lens(both.encoder, &lens));
    memset(pixels, 255, dive.size);
    memset(pixels, 0, 20);
    const nvsp_mask mask = {NVSP_HEAD(nvsp_mask), .width = dive.camera.width, .height = dive.camera.height,
                            .pixels = pixels, .stride = dive.camera.width, .size = dive.size};
    MUST(nvsp_encoder_set_mask(both.encoder, &mask));
    for (int frame = 0; frame < 24; frame++) {
        const nvsp_image image = scene_image(&dive, frame % dive.frames);
        if (frame == 4) {
            start_counting();
        }
        MUST(nvsp_encode_begin(both.encoder, &image, with_hint(frame == 0 ? &dive.poses[0] : NULL)));
        if (frame > 0) {
            size_t size = 0;
            MUST(nvsp_wait(both.encoder, 60000));
            MUST(nvsp_encode_finish(both.encoder, sent, sizeof sent, &size, NULL));
        }
    }
    CHECK(stop_counting("two frames at once, through a lens") == 0);
    nvsp_destroy(both.encoder);
    nvsp_destroy(both.decoder);
    both.encoder = NULL;
    both.decoder = NULL;
}

int main(int argc, char **argv) {
    read_dive(argc, argv);
    pixels = malloc(dive.size);
    rig_open(&both, &dive);

    // The counter counts: this call says that it allocates.
    nvsp_engine_info info = NVSP_INITIALIZER(nvsp_engine_info);
    start_counting();
    MUST(nvsp_engine_get_info(both.engine, &info));
    CHECK(stop_counting("nvsp_engine_get_info") > 0);

    const uint32_t rates[] = {NVSP_RATE_QUALITY, NVSP_RATE_BYTES, NVSP_RATE_PSNR, NVSP_RATE_QUALITY};
    const float values[] = {30, 400, 36, 30};
    const int frames[] = {10, 50, 10, 40};
    for (int i = 0; i < 4; i++) {
        nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
        options.rate = rates[i];
        options.rate_value = values[i];
        options.camera_interval = 10;
        options.mode = i == 3 ? NVSP_MODE_CHAIN : NVSP_MODE_INTRA;
        rig_add(&both, &dive.camera, &options);
        nvsp_sender_options link = NVSP_INITIALIZER(nvsp_sender_options);
        link.bit_rate = 20000;
        link.frame_rate = 2;
        link.spread = 0.6;
        link.shares = 32;
        MUST(nvsp_sender_create(64, &link, &sender));
        MUST(nvsp_collector_create(64, NULL, &collector));
        nvsp_sender_options plain = NVSP_INITIALIZER(nvsp_sender_options);
        nvsp_collector_options room = NVSP_INITIALIZER(nvsp_collector_options);
        plain.flags = NVSP_SENDER_UNPROTECTED;
        room.shares = sizeof sent / 60;
        MUST(nvsp_sender_create(64, &plain, &unprotected));
        MUST(nvsp_collector_create(64, &room, &clean));
        start_counting();
        // Two: the second starts the threads of encoder and decoder.
        whole_way(0);
        whole_way(1);
        stop_counting("the first frames");
        start_counting();
        for (int frame = 2; frame < 2 + frames[i]; frame++) {
            whole_way(frame);
        }
        CHECK(stop_counting("the frames after them") == 0);
        nvsp_collector_statistics counts = NVSP_INITIALIZER(nvsp_collector_statistics);
        MUST(nvsp_collector_get_statistics(collector, &counts));
        CHECK(counts.repaired > 0);
        nvsp_destroy(sender);
        nvsp_destroy(collector);
        nvsp_destroy(unprotected);
        nvsp_destroy(clean);
        nvsp_destroy(both.encoder);
        nvsp_destroy(both.decoder);
        both.encoder = NULL;
        both.decoder = NULL;
    }
    two_at_once();
    CHECK(uncounted > 0);
    free(pixels);
    return tear_down();
}
