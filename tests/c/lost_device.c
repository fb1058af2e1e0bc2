// A device that is lost in the middle of a frame, and the way back: engine, prior, encoder and decoder.
// It runs under the layer of lost_device_layer.c.

#define _GNU_SOURCE

#include "common.h"

static packet valid[MAX_FRAMES];  // As they would be without losses.

// Counts the calls of vkQueueSubmit from here on: the one with this number loses the device.
static void lose(int number) {
    char text[16];
    snprintf(text, sizeof text, "%d", number);
    setenv("NVSP_LOSE_SUBMIT", text, 1);
}

static void lose_none(void) { unsetenv("NVSP_LOSE_SUBMIT"); }

static void without_losses(void) {
    rig_open(&both, &dive);
    rig_add(&both, &dive.camera, NULL);
    encode_all(&both, &dive, valid);
    rig_close(&both);
}

// Everything on the lost device fails, at once or begun, and writes nothing.
static void all_is_lost(rig *both, int frame) {
    const nvsp_image image = scene_image(&dive, frame);
    const nvsp_pose *pose = &dive.poses[frame];
    uint8_t bytes[4096];
    size_t size = 77;
    nvsp_encoder *encoder = NULL;
    nvsp_prior *prior = NULL;
    memset(bytes, 0xa5, sizeof bytes);
    for (int i = 0; i < 2; i++) {
        EXPECT(NVSP_ERR_DEVICE_LOST,
               nvsp_encode(both->encoder, &image, with_hint(pose), bytes, sizeof bytes, &size, NULL));
        EXPECT(NVSP_OK, nvsp_encode_begin(both->encoder, &image, with_hint(pose)));
        EXPECT(NVSP_OK, nvsp_wait(both->encoder, 60000));
        EXPECT(NVSP_ERR_DEVICE_LOST,
               nvsp_encode_finish(both->encoder, bytes, sizeof bytes, &size, NULL));
        EXPECT(NVSP_ERR_DEVICE_LOST,
               nvsp_decode(both->decoder, valid[0].bytes, valid[0].size, 0, NULL, NULL));
    }
    EXPECT(NVSP_ERR_DEVICE_LOST, nvsp_prior_open(both->engine, dive.prior, NULL, &prior));
    EXPECT(NVSP_ERR_DEVICE_LOST,
           nvsp_encoder_create(both->engine, both->prior, &dive.camera, NULL, &encoder));
    CHECK(says(both->engine, "lost"));
    CHECK(size == 77 && prior == NULL && encoder == NULL && all_are(bytes, 0xa5, sizeof bytes));
}

// Loses the device at a frame, and goes on from that frame. The packets are those without losses: frame
// numbers go on, and the decoder still knows the camera, which only the first packet carries.
static void lost_while_encoding(int frame, int submit) {
    rig_open(&both, &dive);
    rig_add(&both, &dive.camera, NULL);
    uint8_t bytes[4096];
    for (int i = 0; i < dive.frames; i++) {
        const nvsp_image image = scene_image(&dive, i);
        const nvsp_pose *hint = i == 0 ? &dive.poses[0] : NULL;
        size_t size = 77;
        if (i == frame) {
            lose(submit);
            EXPECT(NVSP_ERR_DEVICE_LOST,
                   nvsp_encode(both.encoder, &image, with_hint(hint), bytes, sizeof bytes, &size, NULL));
            lose_none();
            CHECK(size == 77);
            all_is_lost(&both, i);
            rig_reopen(&both);
        }
        EXPECT(NVSP_OK, nvsp_encode(both.encoder, &image, with_hint(hint), bytes, sizeof bytes, &size, NULL));
        CHECK(size == valid[i].size && memcmp(bytes, valid[i].bytes, size) == 0);
        EXPECT(NVSP_OK, nvsp_decode(both.decoder, bytes, size, 0, NULL, NULL));
    }
    rig_close(&both);
}

static void lost_while_decoding(void) {
    rig_open(&both, &dive);
    rig_add(&both, &dive.camera, NULL);
    EXPECT(NVSP_OK, nvsp_decode(both.decoder, valid[0].bytes, valid[0].size, 0, NULL, NULL));
    lose(1);
    nvsp_decoded info = NVSP_INITIALIZER(nvsp_decoded);
    EXPECT(NVSP_ERR_DEVICE_LOST,
           nvsp_decode(both.decoder, valid[1].bytes, valid[1].size, 0, NULL, &info));
    lose_none();
    CHECK(info.width == 0);
    rig_reopen(&both);
    EXPECT(NVSP_OK, nvsp_decode(both.decoder, valid[1].bytes, valid[1].size, 0, NULL, &info));
    CHECK(info.frame == 1 && info.rows == info.height);
    rig_close(&both);
}

int main(int argc, char **argv) {
    read_dive(argc, argv);
    lose_none();
    without_losses();
    // The first frame takes one submission for its start and one for its search. Each later frame takes one.
    lost_while_encoding(0, 1);
    lost_while_encoding(0, 2);
    lost_while_encoding(3, 1);
    lost_while_encoding(5, 1);
    lost_while_decoding();
    free_packets(valid);
    return tear_down();
}
