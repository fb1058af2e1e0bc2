// Thousands of frames, encoded and decoded: memory stays as it was.

#define _GNU_SOURCE

#include "common.h"

#include <malloc.h>
#include <unistd.h>

// What the process and its device hold.
typedef struct held {
    long rss;  // KiB.
    nvsp_engine_info device;
} held;

static held measure(void) {
    held now;
    long pages = 0, resident = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    if (file == NULL || fscanf(file, "%ld %ld", &pages, &resident) != 2) {
        give_up("/proc/self/statm");
    }
    fclose(file);
    now.rss = resident * (sysconf(_SC_PAGESIZE) / 1024);
    MUST(NVSP_INIT(&now.device));
    MUST(nvsp_engine_get_info(both.engine, &now.device));
    return now;
}

static void print(int frame, const held *now) {
    printf("frame %5d: RSS %ld KiB; device %llu bytes used, %llu reserved, %llu buffers\n", frame,
           now->rss, (unsigned long long)now->device.memory_used,
           (unsigned long long)now->device.memory_reserved, (unsigned long long)now->device.buffers);
    fflush(stdout);
}

static void whole_way(int number) {
    static uint8_t bytes[8192], pixels[96 * 54 * 3];
    const int turn = 2 * dive.frames - 2, at = number % turn;
    const nvsp_image image = scene_image(&dive, at < dive.frames ? at : turn - at);
    const nvsp_camera camera = scaled_camera(&dive, 64);
    nvsp_picture place = place_of(pixels, camera.width, camera.height);
    size_t size = 0;
    MUST(nvsp_encode(both.encoder, &image, with_hint(number == 0 ? &dive.poses[0] : NULL), bytes, sizeof bytes,
                     &size, NULL));
    EXPECT(NVSP_OK, nvsp_decode(both.decoder, bytes, size, 0, &place, NULL));
    if (number % 10 == 0) {  // An error now and then leaves nothing behind either.
        EXPECT(NVSP_ERR_PACKET, nvsp_decode(both.decoder, bytes, 18, 0, &place, NULL));
    }
}

int main(int argc, char **argv) {
    const int frames = argc > 2 ? atoi(argv[2]) : 2000, warm = 50;
    // What is freed goes back to the system at once, so that RSS shows what is held.
    mallopt(M_TRIM_THRESHOLD, 0);
    set_up(argc, argv);
    const nvsp_camera camera = scaled_camera(&dive, 64);
    rig_add(&both, &camera, NULL);
    held start = {0};
    for (int i = 0; i < frames; i++) {
        if (i == warm) {
            start = measure();
            print(i, &start);
        }
        whole_way(i);
        if (i > warm && i % 500 == 0) {
            const held now = measure();
            print(i, &now);
        }
    }
    const held end = measure();
    print(frames, &end);
    // A leak of 500 bytes per frame would show.
    CHECK(end.rss - start.rss < 1024);
    CHECK(end.device.memory_used == start.device.memory_used);
    CHECK(end.device.memory_reserved == start.device.memory_reserved);
    CHECK(end.device.buffers == start.device.buffers);
    return tear_down();
}
