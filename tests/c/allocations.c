// After the first frame, encoding, both ends of a link, repair of losses and decoding take nothing from the heap within
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

static nvsp_vehicle *vehicle, *unprotected;
static nvsp_topside *topside, *clean;
static uint8_t sent[8192], arrived[8192];
static uint8_t *pixels;

// The same packet over a link that loses some of it.
static void lossy_way(int number, size_t size) {
    const double now = number / 2.0;
    uint32_t budget = 0, lost = 0;
    uint8_t frame[64];
    size_t written = 0;
    nvsp_decoded known = NVSP_INITIALIZER(nvsp_decoded);
    nvsp_event event = NVSP_INITIALIZER(nvsp_event);
    nvsp_topside_statistics statistics = NVSP_INITIALIZER(nvsp_topside_statistics);
    if (nvsp_vehicle_plan(vehicle, now, now, NULL, &budget) != NVSP_OK) {
        return;
    }
    MUST(nvsp_vehicle_packet(vehicle, now, sent, size, NULL, 0));
    while (nvsp_vehicle_transmit(vehicle, now, sizeof frame, frame, &written, NULL) == NVSP_OK) {
        if (lost++ % 5 == (uint32_t)number % 5) {
            continue;
        }
        MUST(nvsp_topside_receive(topside, now, frame, written));
        // Twice, and damaged: it is refused, with a text.
        MUST(nvsp_topside_receive(topside, now, frame, written));
        frame[written - 1] ^= 1;
        CHECK(nvsp_topside_receive(topside, now, frame, written) == NVSP_ERR_PACKET);
    }
    if (nvsp_topside_packet(topside, now, arrived, sizeof arrived, &written, &known) == NVSP_OK) {
        MUST(nvsp_decode(both.decoder, arrived, written, NVSP_DECODE_START, NULL, NULL));
    }
    if (nvsp_topside_report(topside, now, frame, sizeof frame, &written, NULL) == NVSP_OK) {
        MUST(nvsp_vehicle_receive(vehicle, now, frame, written));
    }
    while (nvsp_vehicle_event(vehicle, &event) == NVSP_OK || nvsp_topside_event(topside, &event) == NVSP_OK) {
    }
    MUST(nvsp_topside_get_statistics(topside, &statistics));
    MUST(nvsp_vehicle_set_link(vehicle, now, -1, number % 2 ? 0.3 : 0.1, 2));
    memcpy(arrived, sent, size);
}

// Takes a frame from the camera to the topside's screen. Odd frames use the threads of encoder and decoder.
static void whole_way(int number) {
    const int turn = 2 * dive.frames - 2, at = number % turn;
    const nvsp_image image = scene_image(&dive, at < dive.frames ? at : turn - at);
    const nvsp_pose *hint = number == 0 ? &dive.poses[0] : NULL;
    nvsp_picture place = place_of(pixels, dive.camera.width, dive.camera.height);
    nvsp_decoded header;
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
    MUST(nvsp_vehicle_packet(unprotected, 0, sent, size, NULL, 0));
    uint8_t frame[64];
    size_t written = 0;
    while (nvsp_vehicle_transmit(unprotected, 0, sizeof frame, frame, &written, NULL) == NVSP_OK) {
        MUST(nvsp_topside_receive(clean, 0, frame, written));
    }
    MUST(nvsp_topside_packet(clean, 0, arrived, sizeof arrived, &size, NULL));
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

// Both ends with pixels: frames in, pictures out, with acknowledged reference frames, losses and reports.
static void both_ends(void) {
    const nvsp_vehicle_options sends = vehicle_options(64, 40000, 4);
    nvsp_topside_options receives = topside_options(64);
    nvsp_encoder_options encodes = NVSP_INITIALIZER(nvsp_encoder_options);
    encodes.mode = NVSP_MODE_ACKNOWLEDGED;
    encodes.camera_interval = 10;
    nvsp_vehicle *up = NULL;
    nvsp_topside *down = NULL;
    MUST(nvsp_vehicle_create(both.engine, both.prior, &dive.camera, &encodes, &sends, &up));
    MUST(nvsp_topside_create(both.engine, both.prior, &receives, &down));
    nvsp_picture place = place_of(pixels, dive.camera.width, dive.camera.height);
    long pictures = 0, lost = 0;
    for (int k = 0; k < 60; k++) {
        const double now = k / 4.0;
        const nvsp_image image = scene_image(&dive, 0);
        if (k == 20) {
            start_counting();
        }
        if (nvsp_vehicle_frame(up, now, &image, with_hint(k == 0 ? &dive.poses[0] : NULL), NULL, 0) == NVSP_OK) {
            MUST(nvsp_wait(up, 60000));
        }
        uint8_t bytes[64];
        size_t size = 0;
        while (nvsp_vehicle_transmit(up, now + 0.2, sizeof bytes, bytes, &size, NULL) == NVSP_OK) {
            if (lost++ % 7 > 0) {
                MUST(nvsp_topside_receive(down, now + 0.2, bytes, size));
            }
        }
        nvsp_status status;
        nvsp_decoded known = NVSP_INITIALIZER(nvsp_decoded);
        do {
            status = nvsp_topside_picture(down, now + 0.2, &place, &known);
            pictures += status == NVSP_OK;
        } while (status == NVSP_OK || nvsp_wait(down, 60000) == NVSP_OK);
        if (nvsp_topside_report(down, now + 0.2, bytes, sizeof bytes, &size, NULL) == NVSP_OK) {
            MUST(nvsp_vehicle_receive(up, now + 0.2, bytes, size));
        }
        nvsp_event event = NVSP_INITIALIZER(nvsp_event);
        while (nvsp_vehicle_event(up, &event) == NVSP_OK || nvsp_topside_event(down, &event) == NVSP_OK) {
        }
    }
    CHECK(stop_counting("both ends of a link, with pixels") == 0);
    CHECK(pictures > 30);
    nvsp_destroy(up);
    nvsp_destroy(down);
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
        nvsp_vehicle_options link = vehicle_options(64, 20000, 2);
        nvsp_topside_options room = topside_options(64);
        vehicle = new_vehicle(&link);
        topside = new_topside(&room);
        link = vehicle_options(64, 0, 0);
        link.flags = NVSP_LINK_UNPROTECTED | NVSP_LINK_AS_THEY_COME;
        unprotected = new_vehicle(&link);
        room.max_shares = sizeof sent / 60;
        clean = new_topside(&room);
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
        nvsp_topside_statistics counts = NVSP_INITIALIZER(nvsp_topside_statistics);
        MUST(nvsp_topside_get_statistics(topside, &counts));
        CHECK(counts.repaired > 0);
        nvsp_destroy(vehicle);
        nvsp_destroy(topside);
        nvsp_destroy(unprotected);
        nvsp_destroy(clean);
        nvsp_destroy(both.encoder);
        nvsp_destroy(both.decoder);
        both.encoder = NULL;
        both.decoder = NULL;
    }
    two_at_once();
    both_ends();
    CHECK(uncounted > 0);
    free(pixels);
    return tear_down();
}
