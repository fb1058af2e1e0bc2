// A device that does not end its work: the watchdog, cancelling, destroying, and the way back.
// It runs under the layer of lost_device_layer.c.

#define _GNU_SOURCE

#include "common.h"

#include <time.h>

#define WATCHDOG 2000  // Milliseconds: more than a slow driver takes to compile what a frame needs.

// From here on no fence is signalled.
static void hang(void) { setenv("NVSP_HANG_WAITS", "1", 1); }

static void hang_no_more(void) { unsetenv("NVSP_HANG_WAITS"); }

static double now(void) {
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec * 1e3 + (double)time.tv_nsec * 1e-6;
}

static void open_rig(rig *both) {
    nvsp_engine_options options = NVSP_INITIALIZER(nvsp_engine_options);
    options.watchdog_milliseconds = WATCHDOG;
    memset(both, 0, sizeof *both);
    hang_no_more();
    MUST(nvsp_engine_create(&options, &both->engine));
    MUST(nvsp_prior_open(both->engine, dive.prior, NULL, &both->prior));
    rig_add(both, &dive.camera, NULL);
}

static nvsp_status encode(rig *both, int frame, uint8_t *bytes, size_t *size) {
    const nvsp_image image = scene_image(&dive, frame);
    return nvsp_encode(both->encoder, &image, with_hint(&dive.poses[frame]), bytes, 4096, size, NULL);
}

static void ends_in_time(void) {
    open_rig(&both);
    uint8_t bytes[4096];
    size_t size = 77;
    hang();
    double began = now();
    EXPECT(NVSP_ERR_DEVICE_LOST, encode(&both, 0, bytes, &size));
    double took = now() - began;
    CHECK(took >= WATCHDOG && took < 10 * WATCHDOG && size == 77);
    CHECK(says(both.encoder, "watchdog"));
    // From here on nothing waits any more.
    began = now();
    EXPECT(NVSP_ERR_DEVICE_LOST, encode(&both, 0, bytes, &size));
    nvsp_encoder *encoder = NULL;
    EXPECT(NVSP_ERR_DEVICE_LOST, nvsp_encoder_create(both.engine, both.prior, &dive.camera, NULL, &encoder));
    CHECK(now() - began < WATCHDOG);
    printf("a frame that hangs: %.0f ms until the error\n", took);
    rig_close(&both);
}

static void cancelled(void) {
    open_rig(&both);
    const nvsp_image image = scene_image(&dive, 0);
    uint8_t bytes[4096];
    size_t size = 77;
    hang();
    EXPECT(NVSP_OK, nvsp_encode_begin(both.encoder, &image, with_hint(&dive.poses[0])));
    EXPECT(NVSP_PENDING, nvsp_wait(both.encoder, WATCHDOG / 10));
    EXPECT(NVSP_PENDING, nvsp_cancel(both.encoder));
    EXPECT(NVSP_ERR_UNFINISHED, nvsp_encoder_reset(both.encoder));
    EXPECT(NVSP_ERR_STATE, nvsp_wait(both.encoder, 20 * WATCHDOG));
    EXPECT(NVSP_OK, nvsp_cancel(both.encoder));
    EXPECT(NVSP_ERR_STATE, nvsp_encode_finish(both.encoder, bytes, sizeof bytes, &size, NULL));
    EXPECT(NVSP_ERR_DEVICE_LOST, encode(&both, 0, bytes, &size));
    // The way back is that of a lost device.
    hang_no_more();
    rig_reopen(&both);
    EXPECT(NVSP_OK, encode(&both, 0, bytes, &size));
    EXPECT(NVSP_OK, nvsp_decode(both.decoder, bytes, size, 0, NULL, NULL));
    rig_close(&both);
}

static void destroyed(void) {
    open_rig(&both);
    const nvsp_image image = scene_image(&dive, 0);
    uint8_t bytes[4096];
    size_t size = 0;
    MUST(encode(&both, 0, bytes, &size));
    hang();
    EXPECT(NVSP_OK, nvsp_encode_begin(both.encoder, &image, NULL));
    EXPECT(NVSP_OK, nvsp_decode_begin(both.decoder, bytes, size, 0));
    const double began = now();
    rig_close(&both);
    CHECK(now() - began < 10 * WATCHDOG);
    hang_no_more();
}

static void decoding(void) {
    open_rig(&both);
    uint8_t bytes[4096];
    size_t size = 0;
    MUST(encode(&both, 0, bytes, &size));
    // A packet that was cancelled is none that was decoded; the encoder goes on in full.
    const nvsp_image image = scene_image(&dive, 1);
    EXPECT(NVSP_OK, nvsp_encode_begin(both.encoder, &image, NULL));
    EXPECT(NVSP_OK, nvsp_wait(both.encoder, 60000));
    EXPECT(NVSP_OK, nvsp_cancel(both.encoder));
    MUST(encode(&both, 2, bytes, &size));
    nvsp_decoded header = NVSP_INITIALIZER(nvsp_decoded);
    MUST(nvsp_decode_header(bytes, size, NULL, &header));
    CHECK(header.frame == 2 && (header.flags & NVSP_DECODED_SESSION));
    hang();
    EXPECT(NVSP_ERR_DEVICE_LOST, nvsp_decode(both.decoder, bytes, size, 0, NULL, NULL));
    EXPECT(NVSP_ERR_DEVICE_LOST, nvsp_decode(both.decoder, bytes, size, 0, NULL, NULL));
    rig_close(&both);
    hang_no_more();
}

int main(int argc, char **argv) {
    read_dive(argc, argv);
    ends_in_time();
    cancelled();
    destroyed();
    decoding();
    return tear_down();
}
