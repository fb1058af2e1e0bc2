// Host memory that encoders and decoders hold is within what the header states of them.
//
// The library takes its memory from this program's functions, which count it.

#define _GNU_SOURCE

#include "common.h"

#include <nvsprior_extra.h>

static _Atomic long held;

static void *allocate(void *user, size_t size, size_t alignment) {
    (void)user;
    void *block = NULL;
    if (posix_memalign(&block, alignment < sizeof(void *) ? sizeof(void *) : alignment, size) != 0) {
        return NULL;
    }
    held += (long)size;
    return block;
}

static void release(void *user, void *block, size_t size, size_t alignment) {
    (void)user, (void)alignment;
    held -= (long)size;
    free(block);
}

// Pixels, with sides rounded up to multiples of 16.
static long pixels_of(const nvsp_camera *camera) {
    return (long)((camera->width + 15) / 16 * 16) * (long)((camera->height + 15) / 16 * 16);
}

// Encodes the first frame, enlarged to the camera's size, and decodes it; then once more.
static void both_ways(nvsp_encoder *encoder, nvsp_decoder *decoder) {
    const nvsp_image image = scene_image(&dive, 0);
    static uint8_t bytes[1 << 20];
    for (int time = 0; time < 2; time++) {
        size_t size = 0;
        MUST(nvsp_encode(encoder, &image, with_hint(&dive.poses[0]), bytes, sizeof bytes, &size, NULL));
        MUST(nvsp_decode(decoder, bytes, size, 0, NULL, NULL));
        // And the start of it, as after a loss.
        MUST(nvsp_decode(decoder, bytes, size - size / 3, NVSP_DECODE_START, NULL, NULL));
    }
}

static void at_width(uint32_t width, uint32_t mode) {
    const nvsp_camera camera = scaled_camera(&dive, width);
    const long pixels = pixels_of(&camera), stream = mode == NVSP_MODE_CHAIN;
    nvsp_memory_estimate estimate = NVSP_INITIALIZER(nvsp_memory_estimate);
    MUST(nvsp_prior_estimate(dive.prior, &camera, &estimate));
    nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
    options.mode = mode;
    const long before = held;
    MUST(nvsp_encoder_create(both.engine, both.prior, &camera, &options, &both.encoder));
    MUST(nvsp_decoder_create(both.engine, both.prior, NULL, &both.decoder));
    both_ways(both.encoder, both.decoder);
    const long all = held - before;
    nvsp_destroy(both.encoder);
    const long decoder = held - before, encoder = all - decoder;
    nvsp_destroy(both.decoder);
    both.encoder = NULL;
    both.decoder = NULL;
    printf("%u x %u%s: encoder %ld bytes, decoder %ld: %.1f and %.1f per pixel\n", camera.width, camera.height,
           stream ? ", stream" : "", encoder, decoder, (double)encoder / (double)pixels,
           (double)decoder / (double)pixels);
    // The counter counts: there is a picture at least.
    CHECK(decoder > 3 * pixels && encoder > 3 * pixels);
    CHECK(decoder <= (2 << 20) + (stream ? 136 + 272 : 136) * pixels);
    CHECK(decoder <= (long)estimate.decoder_host + (stream ? 273 * pixels + (1 << 20) : 0));
    CHECK(encoder <= (long)estimate.encoder_host + (stream ? 327 * pixels + (1 << 20) : 0));
}

int main(int argc, char **argv) {
    read_dive(argc, argv);
    EXPECT(NVSP_OK, nvsp_set_allocator(allocate, release, NULL));
    rig_open(&both, &dive);
    const uint32_t widths[] = {96, 160, 320, 640, 1280};
    for (int i = 0; i < (few() ? 1 : 5); i++) {
        at_width(widths[i], NVSP_MODE_INTRA);
        at_width(widths[i], NVSP_MODE_CHAIN);
    }
    return tear_down();
}
