// Streams: frames that are predicted from frames, and those whose reference is missing.

#include "common.h"

static nvsp_encoder_options stream_options(uint32_t mode) {
    nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
    options.mode = mode;
    options.rate = NVSP_RATE_QUALITY;
    options.rate_value = 30;
    return options;
}

// The packets of all frames, the pictures that the topside is to show, and how far back each one's reference lies.
typedef struct run {
    packet packets[MAX_FRAMES];
    uint8_t *shown[MAX_FRAMES];
    uint32_t reference_distance[MAX_FRAMES];
} run;

// The camera stands still: prediction saves most.
static void encode_frame(nvsp_encoder *encoder, int frame, run *run) {
    const nvsp_image image = scene_image(&dive, 0);
    nvsp_frame_stats stats = NVSP_INITIALIZER(nvsp_frame_stats);
    run->packets[frame].bytes = malloc(8192);
    run->shown[frame] = malloc(dive.size);
    MUST(nvsp_encode(encoder, &image, with_hint(frame == 0 ? &dive.poses[0] : NULL), run->packets[frame].bytes, 8192,
                     &run->packets[frame].size, &stats));
    nvsp_picture place = place_of(run->shown[frame], dive.camera.width, dive.camera.height);
    MUST(nvsp_encoder_get_picture(encoder, NVSP_PICTURE_SHOWN, &place));
    run->reference_distance[frame] = stats.reference_distance;
}

static void free_run(run *run) {
    for (int i = 0; i < dive.frames; i++) {
        free(run->packets[i].bytes);
        free(run->shown[i]);
    }
}

// Decodes a packet, and tells what came of it.
static nvsp_decoded decode(const run *run, int frame, int whole) {
    uint8_t *pixels = malloc(dive.size);
    nvsp_picture place = place_of(pixels, dive.camera.width, dive.camera.height);
    nvsp_decoded decoded = NVSP_INITIALIZER(nvsp_decoded);
    const packet *packet = &run->packets[frame];
    EXPECT(NVSP_OK, nvsp_decode(both.decoder, packet->bytes, packet->size, 0, &place, &decoded));
    CHECK((memcmp(pixels, run->shown[frame], dive.size) == 0) == whole);
    const int leans = run->reference_distance[frame] > 0;
    CHECK(((decoded.flags & NVSP_DECODED_INTER) != 0) == leans);
    CHECK(decoded.reference == (leans ? (uint32_t)frame - run->reference_distance[frame] : 0));
    CHECK(((decoded.flags & NVSP_DECODED_KEPT) != 0) == whole);
    CHECK(decoded.damage == (whole ? NVSP_OK : NVSP_ERR_REFERENCE));
    CHECK(decoded.rows == (whole ? dive.camera.height : 0));
    free(pixels);
    return decoded;
}

static void a_chain_and_a_loss(void) {
    const nvsp_encoder_options options = stream_options(NVSP_MODE_CHAIN | NVSP_KEY_EVERY(5));
    nvsp_encoder *encoder = new_encoder(&options);
    run chain = {0};
    for (int i = 0; i < dive.frames; i++) {
        encode_frame(encoder, i, &chain);
        CHECK(i % 5 > 0 || chain.reference_distance[i] == 0);
    }
    CHECK(chain.reference_distance[1] == 1 && chain.reference_distance[2] == 1);
    for (int i = 0; i < dive.frames; i++) {
        decode(&chain, i, 1);
    }
    // A topside that has nothing of it: the second frame is lost.
    nvsp_destroy(both.decoder);
    MUST(nvsp_decoder_create(both.engine, both.prior, NULL, &both.decoder));
    decode(&chain, 0, 1);
    int lost = 1;
    for (int i = 2; i < dive.frames; i++) {
        lost = lost && chain.reference_distance[i] > 0;
        decode(&chain, i, !lost);
    }
    // It comes after all.
    decode(&chain, 1, 1);
    decode(&chain, 2, 1);
    nvsp_destroy(encoder);
    free_run(&chain);
}

// The reference frames of the other modes, and how often key frames come.
static void modes(void) {
    const struct {
        uint32_t mode;
        uint32_t distances[MAX_FRAMES];
    } all[] = {{NVSP_MODE_INTRA, {0}},
               {NVSP_MODE_CHAIN, {0, 1, 1, 1, 1, 1, 1, 1}},
               {NVSP_MODE_CHAIN | NVSP_KEY_ONCE, {0, 1, 1, 1, 1, 1, 1, 1}},
               {NVSP_MODE_LAYERS | NVSP_KEY_EVERY(8), {0, 1, 2, 1, 4, 1, 2, 1}},
               {NVSP_MODE_KEYS | NVSP_KEY_EVERY(3), {0, 1, 2, 0, 1, 2, 0, 1}}};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++) {
        const nvsp_encoder_options options = stream_options(all[i].mode);
        nvsp_encoder *encoder = new_encoder(&options);
        run run = {0};
        for (int frame = 0; frame < dive.frames; frame++) {
            encode_frame(encoder, frame, &run);
            CHECK(run.reference_distance[frame] == all[i].distances[frame]);
        }
        nvsp_destroy(encoder);
        free_run(&run);
    }
}

static void acknowledged_frames_are_reference_frames(void) {
    const nvsp_encoder_options options = stream_options(NVSP_MODE_ACKNOWLEDGED);
    nvsp_encoder *encoder = new_encoder(&options);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_acknowledge(NULL, 0));
    run run = {0};
    encode_frame(encoder, 0, &run);
    encode_frame(encoder, 1, &run);
    CHECK(run.reference_distance[0] == 0 && run.reference_distance[1] == 0);
    decode(&run, 0, 1);
    const nvsp_decoded second = decode(&run, 1, 1);
    EXPECT(NVSP_OK, nvsp_encoder_acknowledge(encoder, second.frame));
    EXPECT(NVSP_OK, nvsp_encoder_acknowledge(encoder, 12345));
    encode_frame(encoder, 2, &run);
    CHECK(run.reference_distance[2] == 1);
    decode(&run, 2, 1);
    // The next one is intra, if that is asked for.
    EXPECT(NVSP_OK, nvsp_encoder_announce(encoder));
    encode_frame(encoder, 3, &run);
    CHECK(run.reference_distance[3] == 0);
    nvsp_destroy(encoder);
    free_run(&run);
}

// The packets of two frames under way are those of one, and a frame that was cancelled is no reference of others.
static void pipelined(void) {
    nvsp_encoder_options options = stream_options(NVSP_MODE_CHAIN | NVSP_KEY_ONCE);
    options.pipelined = 1;
    nvsp_encoder *encoder = new_encoder(&options);
    run run = {0};
    for (int i = 0; i < 3; i++) {
        encode_frame(encoder, i, &run);
        decode(&run, i, 1);
    }
    CHECK(run.reference_distance[1] == 1 && run.reference_distance[2] == 1);
    const nvsp_image image = scene_image(&dive, 0);
    MUST(nvsp_encode_begin(encoder, &image, NULL));
    MUST(nvsp_wait(encoder, 60000));
    MUST(nvsp_cancel(encoder));
    nvsp_frame_stats stats = NVSP_INITIALIZER(nvsp_frame_stats);
    uint8_t bytes[8192];
    size_t size = 0;
    MUST(nvsp_encode(encoder, &image, NULL, bytes, sizeof bytes, &size, &stats));
    CHECK(stats.reference_distance == 0);
    nvsp_destroy(encoder);
    free_run(&run);
}

static void refusals(void) {
    const uint32_t wrong[] = {5, NVSP_MODE_INTRA | NVSP_KEY_EVERY(8), NVSP_MODE_ACKNOWLEDGED | NVSP_KEY_EVERY(8),
                              NVSP_MODE_ACKNOWLEDGED | NVSP_KEY_ONCE, UINT32_MAX};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        const nvsp_encoder_options options = stream_options(wrong[i]);
        nvsp_encoder *encoder = NULL;
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_create(both.engine, both.prior, &dive.camera, &options, &encoder));
        CHECK(encoder == NULL && says(both.engine, "nvsp_encoder_options.mode"));
    }
    CHECK(strstr(nvsp_status_text(NVSP_ERR_REFERENCE), "reference frame") != NULL);
}

int main(int argc, char **argv) {
    set_up(argc, argv);
    rig_add(&both, &dive.camera, NULL);
    a_chain_and_a_loss();
    modes();
    acknowledged_frames_are_reference_frames();
    pipelined();
    refusals();
    return tear_down();
}
