// The figures that a firmware engineer asks for first: what a frame takes of the calling thread, what an idle poll
// takes, the library's size, and how often a frame takes memory. It prints them; it checks only what holds everywhere.
//
// This program's own malloc, calloc and so on replace the C library's, to count the calls from within libnvsprior.so.

#define _GNU_SOURCE

#include "common.h"
#include "heap_hooks.h"

#include <stdatomic.h>
#include <sys/stat.h>
#include <time.h>

static atomic_long allocations;

static int heap_refused(const void *caller) {
    allocations += in_library(caller);
    return 0;
}

// Milliseconds of the wall clock, or of this thread's own work.
static double now(clockid_t clock) {
    struct timespec time;
    clock_gettime(clock, &time);
    return (double)time.tv_sec * 1e3 + (double)time.tv_nsec * 1e-6;
}

static int ascending(const void *a, const void *b) {
    const double difference = *(const double *)a - *(const double *)b;
    return (difference > 0) - (difference < 0);
}

// A frame of the scene, enlarged to an image of `scale` times the camera's size.
static nvsp_image enlarged(const nvsp_camera *camera, uint32_t scale, uint32_t format, uint8_t **bytes) {
    const size_t width = (size_t)camera->width * scale, height = (size_t)camera->height * scale;
    const size_t step = format == NVSP_FORMAT_NV12 ? 1 : 3, stride = width * step + 64;
    const size_t chroma = format == NVSP_FORMAT_NV12 ? stride * (height + 1) / 2 : 0;
    *bytes = malloc(stride * height + chroma);
    memset(*bytes, 128, stride * height + chroma);
    for (size_t y = 0; y < height; y++) {
        for (size_t x = 0; x < width; x++) {
            const size_t from = y * dive.camera.height / height * dive.camera.width + x * dive.camera.width / width;
            for (size_t c = 0; c < step; c++) {
                (*bytes)[y * stride + x * step + c] = dive.pixels[0][3 * from + (step == 1 ? 1 : 2 - c)];
            }
        }
    }
    return (nvsp_image){NVSP_HEAD(nvsp_image), .format = format,
                        .width = (uint32_t)width,
                        .height = (uint32_t)height,
                        .planes = {*bytes, chroma > 0 ? *bytes + stride * height : NULL},
                        .strides = {stride, stride},
                        .sizes = {stride * height, chroma}};
}

#define FRAMES 30

static void calling_thread(uint32_t width, uint32_t scale, uint32_t format, const char *name) {
    const nvsp_camera camera = scaled_camera(&dive, width);
    uint8_t *bytes = NULL, packet[65536];
    const nvsp_image image = enlarged(&camera, scale, format, &bytes);
    nvsp_encoder *encoder = NULL;
    MUST(nvsp_encoder_create(both.engine, both.prior, &camera, NULL, &encoder));
    double wall[FRAMES], own[FRAMES], finish[FRAMES];
    long taken = 0;
    const int warm = 3, frames = few() ? 5 : FRAMES;
    for (int frame = -warm; frame < frames; frame++) {
        const double began = now(CLOCK_MONOTONIC), began_own = now(CLOCK_THREAD_CPUTIME_ID);
        const long before = allocations;
        MUST(nvsp_encode_begin(encoder, &image, with_hint(frame == -warm ? &dive.poses[0] : NULL)));
        const double ended = now(CLOCK_MONOTONIC), ended_own = now(CLOCK_THREAD_CPUTIME_ID);
        MUST(nvsp_wait(encoder, 600000));
        const double fetching = now(CLOCK_MONOTONIC);
        size_t size = 0;
        MUST(nvsp_encode_finish(encoder, packet, sizeof packet, &size, NULL));
        if (frame >= 0) {
            wall[frame] = ended - began;
            own[frame] = ended_own - began_own;
            finish[frame] = now(CLOCK_MONOTONIC) - fetching;
            taken += allocations - before;
        }
    }
    qsort(wall, (size_t)frames, sizeof *wall, ascending);
    qsort(own, (size_t)frames, sizeof *own, ascending);
    qsort(finish, (size_t)frames, sizeof *finish, ascending);
    printf("nvsp_encode_begin, %s %u x %u to %u x %u: %.3f ms, %.3f ms of the thread's own time, at most %.3f ms; "
           "nvsp_encode_finish %.3f ms; %ld allocations in %d frames\n",
           name, image.width, image.height, camera.width, camera.height, wall[frames / 2], own[frames / 2],
           wall[frames - 1], finish[frames / 2], taken, frames);
    CHECK(taken == 0);
    nvsp_destroy(encoder);
    free(bytes);
}

// A poll while a frame is under way.
static void polls(void) {
    const nvsp_image image = scene_image(&dive, 0);
    uint8_t packet[65536];
    size_t size = 0;
    long pending = 0;
    double longest = 0, spent = 0;
    for (int frame = 0; frame < (few() ? 2 : FRAMES); frame++) {
        MUST(nvsp_encode_begin(both.encoder, &image, with_hint(&dive.poses[0])));
        for (nvsp_status status = NVSP_PENDING; status == NVSP_PENDING; pending++) {
            const double began = now(CLOCK_MONOTONIC);
            status = nvsp_wait(both.encoder, 0);
            const double took = now(CLOCK_MONOTONIC) - began;
            spent += took;
            longest = took > longest ? took : longest;
        }
        MUST(nvsp_encode_finish(both.encoder, packet, sizeof packet, &size, NULL));
    }
    printf("nvsp_wait of 0 ms, a frame under way: %.0f ns (%ld polls, at most %.3f ms)\n",
           spent / (double)pending * 1e6, pending, longest);
}

// A poll although nothing was begun: an error each time.
static void idle_polls(void) {
    const long count = few() ? 100 : 100000, before = allocations;
    const double began = now(CLOCK_MONOTONIC);
    for (long i = 0; i < count; i++) {
        if (nvsp_wait(both.encoder, 0) != NVSP_ERR_STATE) {
            CHECK(0);
        }
    }
    printf("nvsp_wait of 0 ms, nothing begun: %.0f ns, %ld allocations in %ld polls\n",
           (now(CLOCK_MONOTONIC) - began) / (double)count * 1e6, allocations - before, count);
}

int main(int argc, char **argv) {
    find_library();
    set_up(argc, argv);
    rig_add(&both, &dive.camera, NULL);
    struct stat status;
    if (stat(library_path, &status) == 0) {
        printf("%s: %ld bytes, %ld of them code\n", strrchr(library_path, '/') + 1, (long)status.st_size,
               (long)(code_end - code_start));
    }
    nvsp_engine_info info = NVSP_INITIALIZER(nvsp_engine_info);
    MUST(nvsp_engine_get_info(both.engine, &info));
    printf("%s\n", info.device);
    CHECK(allocations > 0);  // The counter counts.
    calling_thread(dive.camera.width, 1, NVSP_FORMAT_BGR8, "BGR8");
    calling_thread(640, 1, NVSP_FORMAT_BGR8, "BGR8");
    calling_thread(640, 2, NVSP_FORMAT_BGR8, "BGR8");
    calling_thread(640, 3, NVSP_FORMAT_NV12, "NV12");
    polls();
    idle_polls();
    return tear_down();
}
