// Two frames under way at once: the same packets, in order, and any end of it.

#include "common.h"

static nvsp_encoder *encoder_of(uint32_t pipelined) {
    nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
    options.pipelined = pipelined;
    options.camera_interval = 3;
    return new_encoder(&options);
}

static const nvsp_pose *hint_of(int frame) { return frame == 0 ? &dive.poses[0] : NULL; }

static nvsp_status begin(nvsp_encoder *encoder, int frame) {
    const nvsp_image image = scene_image(&dive, frame);
    return nvsp_encode_begin(encoder, &image, with_hint(hint_of(frame)));
}

// Packets by nvsp_encode of an encoder of either kind.
static void encode_each(nvsp_encoder *encoder, packet *packets) {
    for (int i = 0; i < dive.frames; i++) {
        const nvsp_image image = scene_image(&dive, i);
        packets[i].bytes = malloc(8192);
        MUST(nvsp_encode(encoder, &image, with_hint(hint_of(i)), packets[i].bytes, 8192, &packets[i].size, NULL));
    }
}

static int is(const packet *packet, const uint8_t *bytes, size_t size) {
    return size == packet->size && memcmp(bytes, packet->bytes, size) == 0;
}

// Fetches the first frame, which must be `frame`, with its packet and its number.
static void finish(nvsp_encoder *encoder, const packet *packets, int frame) {
    uint8_t bytes[8192];
    size_t size = 0;
    nvsp_frame_stats stats = NVSP_INITIALIZER(nvsp_frame_stats);
    EXPECT(NVSP_OK, nvsp_wait(encoder, 60000));
    EXPECT(NVSP_OK, nvsp_wait(encoder, 0));
    EXPECT(NVSP_OK, nvsp_encode_finish(encoder, bytes, sizeof bytes, &size, &stats));
    CHECK(is(&packets[frame], bytes, size) && stats.frame == (uint32_t)frame && stats.bytes == size);
}

static void the_same_packets(const packet *packets) {
    nvsp_encoder *encoder = encoder_of(1);
    uint8_t bytes[8192];
    size_t size = 77;
    EXPECT(NVSP_ERR_STATE, nvsp_wait(encoder, 0));
    EXPECT(NVSP_ERR_STATE, nvsp_encode_finish(encoder, bytes, sizeof bytes, &size, NULL));
    EXPECT(NVSP_OK, begin(encoder, 0));
    for (int i = 1; i < dive.frames; i++) {
        EXPECT(NVSP_OK, begin(encoder, i));
        // Two are under way or kept, whatever the threads have done by now.
        EXPECT(NVSP_ERR_UNFINISHED, begin(encoder, i));
        finish(encoder, packets, i - 1);
    }
    finish(encoder, packets, dive.frames - 1);
    EXPECT(NVSP_ERR_STATE, nvsp_wait(encoder, 0));
    CHECK(size == 77);
    nvsp_destroy(encoder);

    // Frame by frame, too.
    encoder = encoder_of(7);
    packet own[MAX_FRAMES] = {{0}};
    encode_each(encoder, own);
    for (int i = 0; i < dive.frames; i++) {
        CHECK(is(&packets[i], own[i].bytes, own[i].size));
    }
    free_packets(own);
    nvsp_destroy(encoder);
}

// Images are read before the call returns, and a packet that does not fit stays in its place.
static void images_and_short_buffers(const packet *packets) {
    nvsp_encoder *encoder = encoder_of(1);
    uint8_t *pixels = malloc(dive.size), bytes[8192];
    nvsp_image image = scene_image(&dive, 0);
    image.planes[0] = pixels;
    for (int i = 0; i < 2; i++) {
        memcpy(pixels, dive.pixels[i], dive.size);
        EXPECT(NVSP_OK, nvsp_encode_begin(encoder, &image, with_hint(hint_of(i))));
        memset(pixels, 0x5a, dive.size);
    }
    size_t size = 0;
    EXPECT(NVSP_OK, nvsp_wait(encoder, 60000));
    for (int i = 0; i < 3; i++) {
        EXPECT(NVSP_ERR_BUFFER_TOO_SMALL, nvsp_encode_finish(encoder, bytes, 5, &size, NULL));
        CHECK(size == packets[0].size);
    }
    nvsp_picture place = place_of(pixels, dive.camera.width, dive.camera.height);
    EXPECT(NVSP_ERR_STATE, nvsp_encoder_get_picture(encoder, NVSP_PICTURE_SHOWN, &place));
    finish(encoder, packets, 0);
    EXPECT(NVSP_OK, nvsp_encoder_get_picture(encoder, NVSP_PICTURE_SHOWN, &place));
    // It is that of frame 0, as the topside shows it.
    uint8_t *shown = malloc(dive.size);
    nvsp_picture other = place_of(shown, dive.camera.width, dive.camera.height);
    EXPECT(NVSP_OK, nvsp_decode(both.decoder, packets[0].bytes, packets[0].size, 0, &other, NULL));
    CHECK(memcmp(pixels, shown, dive.size) == 0);
    finish(encoder, packets, 1);
    free(shown);
    free(pixels);
    nvsp_destroy(encoder);
}

// Fails to begin what cannot be encoded; the frames under way go on.
static void refusals(const packet *packets) {
    nvsp_encoder *encoder = encoder_of(1);
    EXPECT(NVSP_OK, begin(encoder, 0));
    nvsp_image image = scene_image(&dive, 1);
    image.sizes[0]--;
    EXPECT(NVSP_ERR_IMAGE, nvsp_encode_begin(encoder, &image, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encode_begin(encoder, NULL, NULL));
    nvsp_pose pose = dive.poses[0];
    pose.translation[1] = strtod("nan", NULL);
    image = scene_image(&dive, 1);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encode_begin(encoder, &image, with_hint(&pose)));
    uint8_t bytes[8192];
    size_t size = 0;
    // The first frame is not this call's, before its end and after.
    EXPECT(NVSP_ERR_UNFINISHED, nvsp_encode(encoder, &image, NULL, bytes, sizeof bytes, &size, NULL));
    EXPECT(NVSP_OK, nvsp_wait(encoder, 60000));
    EXPECT(NVSP_ERR_UNFINISHED, nvsp_encode(encoder, &image, NULL, bytes, sizeof bytes, &size, NULL));
    finish(encoder, packets, 0);
    EXPECT(NVSP_ERR_BUFFER_TOO_SMALL, nvsp_encode(encoder, &image, NULL, bytes, 1, &size, NULL));
    nvsp_destroy(encoder);

    // A frame that fails in its search is no frame: the next one gets its number and its packet.
    encoder = encoder_of(1);
    image = scene_image(&dive, 0);
    EXPECT(NVSP_OK, nvsp_encode_begin(encoder, &image, NULL));
    EXPECT(NVSP_OK, begin(encoder, 0));
    EXPECT(NVSP_OK, nvsp_wait(encoder, 60000));
    EXPECT(NVSP_ERR_NO_START, nvsp_encode_finish(encoder, bytes, sizeof bytes, &size, NULL));
    finish(encoder, packets, 0);
    nvsp_destroy(encoder);

    // A frame that cannot be coded is lost, and with it the camera; the next tells it again.
    encoder = encoder_of(1);
    MUST(nvsp_encoder_set_rate(encoder, NVSP_RATE_BYTES, 10));
    EXPECT(NVSP_OK, begin(encoder, 0));
    EXPECT(NVSP_OK, nvsp_wait(encoder, 60000));
    MUST(nvsp_encoder_set_rate(encoder, NVSP_RATE_DEFAULT, 0));
    EXPECT(NVSP_ERR_BUDGET, nvsp_encode_finish(encoder, bytes, sizeof bytes, &size, NULL));
    image = scene_image(&dive, 1);
    EXPECT(NVSP_OK, nvsp_encode(encoder, &image, NULL, bytes, sizeof bytes, &size, NULL));
    nvsp_decoder *fresh = NULL;
    MUST(nvsp_decoder_create(both.engine, both.prior, NULL, &fresh));
    EXPECT(NVSP_OK, nvsp_decode(fresh, bytes, size, 0, NULL, NULL));
    nvsp_destroy(fresh);
    nvsp_destroy(encoder);
}

// Waits until a cancelled encoder is free.
static void cancel(nvsp_encoder *encoder) {
    nvsp_status status = nvsp_cancel(encoder);
    CHECK(status == NVSP_OK || status == NVSP_PENDING);
    while (status == NVSP_PENDING) {
        const nvsp_status waited = nvsp_wait(encoder, 60000);
        CHECK(waited == NVSP_PENDING || waited == NVSP_ERR_STATE);
        status = nvsp_cancel(encoder);
    }
    EXPECT(NVSP_OK, status);
    EXPECT(NVSP_ERR_STATE, nvsp_wait(encoder, 0));
}

static void cancelled(void) {
    nvsp_encoder *encoder = encoder_of(1);
    uint8_t bytes[8192];
    size_t size = 0;
    const int rounds = few() ? 2 : 6;
    for (int i = 0; i < rounds; i++) {
        EXPECT(NVSP_OK, begin(encoder, 0));
        if (i % 3 > 0) {
            EXPECT(NVSP_OK, begin(encoder, 1));
        }
        if (i % 3 == 2) {
            EXPECT(NVSP_OK, nvsp_wait(encoder, 60000));
        }
        cancel(encoder);
    }
    // The next packet is for a topside that saw none of them.
    EXPECT(NVSP_OK, begin(encoder, 0));
    EXPECT(NVSP_OK, nvsp_wait(encoder, 60000));
    EXPECT(NVSP_OK, nvsp_encode_finish(encoder, bytes, sizeof bytes, &size, NULL));
    nvsp_decoder *fresh = NULL;
    MUST(nvsp_decoder_create(both.engine, both.prior, NULL, &fresh));
    EXPECT(NVSP_OK, nvsp_decode(fresh, bytes, size, 0, NULL, NULL));
    nvsp_destroy(fresh);
    nvsp_destroy(encoder);
}

// With none, one and two frames under way, right away and later.
static void destroyed(void) {
    for (int frames = 0; frames <= 2; frames++) {
        for (int later = 0; later < 2; later++) {
            nvsp_encoder *encoder = encoder_of(1);
            for (int i = 0; i < frames; i++) {
                EXPECT(NVSP_OK, begin(encoder, i));
            }
            if (later && frames > 0) {
                EXPECT(NVSP_OK, nvsp_wait(encoder, 60000));
            }
            nvsp_destroy(encoder);
        }
    }
    nvsp_encoder *encoder = encoder_of(1);
    EXPECT(NVSP_OK, begin(encoder, 0));
    EXPECT(NVSP_OK, begin(encoder, 1));
    CHECK(nvsp_cancel(encoder) >= NVSP_OK);
    nvsp_destroy(encoder);
}

// Another size, a mask and a lens between frames; the frame that is coded meanwhile keeps its own.
static void changes(void) {
    nvsp_encoder *encoder = encoder_of(1);
    const nvsp_camera half = scaled_camera(&dive, dive.camera.width / 2);
    uint8_t bytes[8192];
    size_t size = 0;
    for (int round = 0; round < 2; round++) {
        for (int i = 0; i < 2; i++) {
            EXPECT(NVSP_OK, begin(encoder, 0));
            EXPECT(NVSP_OK, nvsp_wait(encoder, 60000));
            EXPECT(NVSP_OK, nvsp_encoder_set_camera(encoder, i == 0 ? &half : &dive.camera));
            EXPECT(NVSP_OK, nvsp_encode_finish(encoder, bytes, sizeof bytes, &size, NULL));
            nvsp_decoded info = NVSP_INITIALIZER(nvsp_decoded);
            EXPECT(NVSP_OK, nvsp_decode(both.decoder, bytes, size, 0, NULL, &info));
        }
    }
    EXPECT(NVSP_OK, begin(encoder, 0));
    const nvsp_status status = nvsp_encoder_set_camera(encoder, &half);
    CHECK(status == NVSP_ERR_UNFINISHED || status == NVSP_OK);
    nvsp_destroy(encoder);
}

int main(int argc, char **argv) {
    set_up(argc, argv);
    rig_add(&both, &dive.camera, NULL);
    nvsp_encoder *plain = encoder_of(0);
    encode_each(plain, packets);
    nvsp_destroy(plain);

    the_same_packets(packets);
    images_and_short_buffers(packets);
    refusals(packets);
    cancelled();
    destroyed();
    changes();
    return tear_down();
}
