// Encoding: what a call writes, into which memory, and what an error leaves unchanged.

#include "common.h"

#include <math.h>

static int is_packet(int frame, const uint8_t *bytes, size_t size) {
    return size == packets[frame].size && memcmp(bytes, packets[frame].bytes, size) == 0;
}

// Before the first frame, and with nothing to start from.
static void nothing_yet(void) {
    nvsp_encoder *encoder = new_encoder(NULL);
    uint8_t bytes[4096], *pixels = malloc(dive.size);
    size_t written = 77;
    memset(bytes, 0xa5, sizeof bytes);
    memset(pixels, 0xa5, dive.size);
    nvsp_picture place = place_of(pixels, dive.camera.width, dive.camera.height);
    const nvsp_image image = scene_image(&dive, 0);
    EXPECT(NVSP_ERR_STATE, nvsp_wait(encoder, 0));
    EXPECT(NVSP_ERR_STATE, nvsp_wait(encoder, 1));
    EXPECT(NVSP_ERR_STATE, nvsp_encode_finish(encoder, bytes, sizeof bytes, &written, NULL));
    EXPECT(NVSP_ERR_STATE, nvsp_encoder_get_picture(encoder, NVSP_PICTURE_SHOWN, &place));
    EXPECT(NVSP_ERR_NO_START, nvsp_encode(encoder, &image, NULL, bytes, sizeof bytes, &written, NULL));
    EXPECT(NVSP_ERR_STATE, nvsp_wait(encoder, 0));
    EXPECT(NVSP_OK, nvsp_encode_begin(encoder, &image, NULL));
    EXPECT(NVSP_OK, nvsp_wait(encoder, 60000));
    EXPECT(NVSP_ERR_NO_START, nvsp_encode_finish(encoder, bytes, sizeof bytes, &written, NULL));
    EXPECT(NVSP_ERR_STATE, nvsp_encode_finish(encoder, bytes, sizeof bytes, &written, NULL));
    nvsp_pose poses[3] = {dive.poses[0], dive.poses[0], dive.poses[0]};
    memset(poses[0].rotation, 0, sizeof poses[0].rotation);
    poses[1].rotation[1] = strtod("nan", NULL);
    poses[2].translation[2] = strtod("inf", NULL);
    for (int i = 0; i < 3; i++) {
        EXPECT(NVSP_ERR_ARGUMENT,
               nvsp_encode(encoder, &image, with_hint(&poses[i]), bytes, sizeof bytes, &written, NULL));
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_encode_begin(encoder, &image, with_hint(&poses[i])));
    }
    CHECK(written == 77 && all_are(bytes, 0xa5, sizeof bytes) && all_are(pixels, 0xa5, dive.size));
    // None of that was a frame.
    EXPECT(NVSP_OK,
           nvsp_encode(encoder, &image, with_hint(&dive.poses[0]), bytes, sizeof bytes, &written, NULL));
    CHECK(is_packet(0, bytes, written));
    free(pixels);
    nvsp_destroy(encoder);
}

// A packet that does not fit is kept, and nothing is written but how many bytes it takes.
static void short_buffers(void) {
    nvsp_encoder *encoder = new_encoder(NULL);
    uint8_t bytes[4096];
    size_t written = 77;
    nvsp_frame_stats stats;
    const nvsp_image image = scene_image(&dive, 0);
    MUST(NVSP_INIT(&stats));
    memset(bytes, 0xa5, sizeof bytes);
    EXPECT(NVSP_ERR_BUFFER_TOO_SMALL,
           nvsp_encode(encoder, &image, with_hint(&dive.poses[0]), bytes, 0, &written, &stats));
    const size_t rooms[] = {0, 1, SESSION_LATENT, packets[0].size - 1};
    for (size_t i = 0; i < 4; i++) {
        EXPECT(NVSP_ERR_BUFFER_TOO_SMALL,
               nvsp_encode_finish(encoder, bytes, rooms[i], &written, &stats));
    }
    CHECK(written == packets[0].size && all_are(bytes, 0xa5, sizeof bytes) && stats.bytes == 0);
    char needed[32];
    snprintf(needed, sizeof needed, "%zu", packets[0].size);
    CHECK(says(encoder, needed));
    EXPECT(NVSP_OK, nvsp_encode_finish(encoder, bytes, packets[0].size, &written, &stats));
    CHECK(is_packet(0, bytes, written) && stats.bytes == written);
    CHECK(all_are(bytes + written, 0xa5, sizeof bytes - written));
    EXPECT(NVSP_ERR_STATE, nvsp_encode_finish(encoder, bytes, sizeof bytes, &written, &stats));
    nvsp_destroy(encoder);
}

// Until a frame is finished, other calls on the encoder are refused.
static void busy_with(nvsp_encoder *encoder, const nvsp_image *image) {
    uint8_t bytes[4096];
    size_t written = 77;
    nvsp_picture place = {NVSP_HEAD(nvsp_picture), .format = NVSP_FORMAT_RGB8};
    EXPECT(NVSP_ERR_UNFINISHED, nvsp_encode_begin(encoder, image, NULL));
    EXPECT(NVSP_ERR_UNFINISHED, nvsp_encode(encoder, image, NULL, bytes, sizeof bytes, &written, NULL));
    EXPECT(NVSP_ERR_UNFINISHED, nvsp_encoder_set_rate(encoder, NVSP_RATE_QUALITY, 50));
    EXPECT(NVSP_ERR_UNFINISHED, nvsp_encoder_set_camera(encoder, &dive.camera));
    EXPECT(NVSP_ERR_UNFINISHED, nvsp_encoder_reopen(encoder, both.engine, both.prior));
    EXPECT(NVSP_ERR_UNFINISHED, nvsp_encoder_reset(encoder));
    EXPECT(NVSP_ERR_UNFINISHED, nvsp_encoder_get_picture(encoder, NVSP_PICTURE_SHOWN, &place));
    CHECK(written == 77);
    // The frame may have ended by now: then its packet finds no room, and is kept.
    const nvsp_status polled = nvsp_wait(encoder, 0), waited = nvsp_wait(encoder, 0);
    CHECK(polled == NVSP_PENDING || polled == NVSP_OK);
    CHECK(waited == NVSP_OK || (waited == NVSP_PENDING && polled == NVSP_PENDING));
    const nvsp_status finished = nvsp_encode_finish(encoder, bytes, 0, &written, NULL);
    CHECK(finished == NVSP_PENDING ? written == 77 && waited == NVSP_PENDING : finished == NVSP_ERR_BUFFER_TOO_SMALL);
}

// Frames on the encoder's own thread are the same. The image is not needed after nvsp_encode_begin.
static void begun_and_finished(void) {
    nvsp_encoder *encoder = new_encoder(NULL);
    uint8_t *pixels = malloc(dive.size), bytes[4096];
    for (int i = 0; i < dive.frames; i++) {
        nvsp_image image = scene_image(&dive, i);
        memcpy(pixels, dive.pixels[i], dive.size);
        image.planes[0] = pixels;
        EXPECT(NVSP_OK, nvsp_encode_begin(encoder, &image, with_hint(i == 0 ? &dive.poses[0] : NULL)));
        memset(pixels, 0, dive.size);
        if (i == 1) {
            busy_with(encoder, &image);
        }
        while (nvsp_wait(encoder, 1) == NVSP_PENDING) {
        }
        EXPECT(NVSP_OK, nvsp_wait(encoder, 0));
        size_t size = 0;
        EXPECT(NVSP_OK, nvsp_encode_finish(encoder, bytes, sizeof bytes, &size, NULL));
        CHECK(is_packet(i, bytes, size));
    }
    free(pixels);
    nvsp_destroy(encoder);
    // One that is destroyed meanwhile ends after its frame.
    encoder = new_encoder(NULL);
    const nvsp_image image = scene_image(&dive, 0);
    EXPECT(NVSP_OK, nvsp_encode_begin(encoder, &image, with_hint(&dive.poses[0])));
    nvsp_destroy(encoder);
}

// The covariance of a pose that may be off by the same amount in every direction.
static void covariance_of(double deviation, double *covariance) {
    for (int i = 0; i < 36; i++) {
        covariance[i] = i % 7 == 0 ? deviation * deviation : 0;
    }
}

// With nothing but a hint the packets are those of nvsp_encode. All else may be stated too.
static void known_frames(int all) {
    nvsp_encoder *encoder = new_encoder(NULL);
    uint8_t bytes[4096];
    double covariance[36];
    covariance_of(0.01, covariance);
    for (int i = 0; i < dive.frames; i++) {
        const nvsp_image image = scene_image(&dive, i);
        nvsp_frame_info info;
        nvsp_frame_stats stats;
        MUST(NVSP_INIT(&info));
        MUST(NVSP_INIT(&stats));
        info.hint = i == 0 ? &dive.poses[0] : NULL;
        if (all) {
            info.hint_covariance = i == 0 ? covariance : NULL;
            info.hint_age = i == 0 ? 0.2 : 0;
            info.time = -3 + 0.5 * i;
            info.given = NVSP_GIVEN_TIME;
        }
        size_t size = 0;
        if (i % 2 == 0) {
            EXPECT(NVSP_OK,
                   nvsp_encode(encoder, &image, &info, bytes, sizeof bytes, &size, &stats));
        } else {
            EXPECT(NVSP_OK, nvsp_encode_begin(encoder, &image, i == 1 ? NULL : &info));
            EXPECT(NVSP_OK, nvsp_wait(encoder, 60000));
            EXPECT(NVSP_OK, nvsp_encode_finish(encoder, bytes, sizeof bytes, &size, &stats));
        }
        CHECK(all || is_packet(i, bytes, size));
        CHECK(stats.frames_since_certain == 0);
        CHECK((stats.flags & NVSP_FRAME_UNCERTAIN) == 0 && stats.reference_distance == 0);
    }
    nvsp_destroy(encoder);
}

// Checks that a frame is refused with a text that names the field, and that the frame does not count.
static void refused(nvsp_encoder *encoder, const nvsp_frame_info *info, const char *field) {
    const nvsp_image image = scene_image(&dive, 1);
    uint8_t bytes[4096];
    size_t written = 77;
    memset(bytes, 0xa5, sizeof bytes);
    EXPECT(NVSP_ERR_ARGUMENT,
           nvsp_encode(encoder, &image, info, bytes, sizeof bytes, &written, NULL));
    CHECK(says(encoder, field));
    CHECK(written == 77 && all_are(bytes, 0xa5, sizeof bytes));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encode_begin(encoder, &image, info));
    EXPECT(NVSP_ERR_STATE, nvsp_wait(encoder, 0));
}

static void refused_hints(nvsp_encoder *encoder) {
    const double nan = strtod("nan", NULL), ages[] = {-0.5, nan, strtod("inf", NULL)};
    double covariance[36];
    nvsp_pose none = dive.poses[0];
    none.translation[1] = nan;
    nvsp_frame_info info = NVSP_INITIALIZER(nvsp_frame_info);
    info.hint = &none;
    refused(encoder, &info, "nvsp_frame_info.hint:");
    info.hint = &dive.poses[0];
    info.hint_covariance = covariance;
    const struct {
        int at;
        double value;
    } wrong[] = {{0, -1}, {7, nan}, {35, strtod("-inf", NULL)}, {1, 1e-5}, {30, 0.5}};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        covariance_of(0.01, covariance);
        covariance[wrong[i].at] = wrong[i].value;
        refused(encoder, &info, "nvsp_frame_info.hint_covariance");
    }
    // Nothing is known of an axis: not with what is known of another.
    covariance_of(0.01, covariance);
    covariance[35] = strtod("inf", NULL);
    covariance[34] = covariance[29] = 1e-5;
    refused(encoder, &info, "nvsp_frame_info.hint_covariance");
    // Symmetric, and a correlation above 1.
    covariance_of(0.01, covariance);
    covariance[2] = covariance[12] = 2e-4;
    refused(encoder, &info, "nvsp_frame_info.hint_covariance");
    info.hint = NULL;
    covariance_of(0.01, covariance);
    refused(encoder, &info, "nvsp_frame_info.hint_covariance");
    info.hint_covariance = NULL;
    info.hint_age = 1;
    refused(encoder, &info, "nvsp_frame_info.hint_age");
    info.hint = &dive.poses[0];
    for (int i = 0; i < 3; i++) {
        info.hint_age = ages[i];
        refused(encoder, &info, "nvsp_frame_info.hint_age");
    }
}

static void refused_times(nvsp_encoder *encoder, double last) {
    const double times[] = {last - 0.001, strtod("nan", NULL), strtod("-inf", NULL)};
    nvsp_frame_info info = NVSP_INITIALIZER(nvsp_frame_info);
    info.given = NVSP_GIVEN_TIME;
    for (int i = 0; i < 3; i++) {
        info.time = times[i];
        refused(encoder, &info, "nvsp_frame_info.time");
    }
    info.time = last;
    info.given = 0;
    refused(encoder, &info, "nvsp_frame_info.time");
    info.given = NVSP_GIVEN_TIME | 2;
    refused(encoder, &info, "nvsp_frame_info.given");
}

// A refused frame changes no later packet. After a reset, the next frame is treated as a first one.
static void refused_and_reset(void) {
    nvsp_encoder *encoder = new_encoder(NULL), *plain = new_encoder(NULL);
    uint8_t bytes[4096], expected[4096];
    size_t size = 0, wanted = 0;
    nvsp_frame_info info = NVSP_INITIALIZER(nvsp_frame_info);
    info.hint = &dive.poses[0];
    info.given = NVSP_GIVEN_TIME;
    info.time = 20;
    nvsp_image image = scene_image(&dive, 0);
    MUST(nvsp_encode(plain, &image, &info, expected, sizeof expected, &wanted, NULL));
    EXPECT(NVSP_OK, nvsp_encode(encoder, &image, &info, bytes, sizeof bytes, &size, NULL));
    CHECK(size == wanted && memcmp(bytes, expected, size) == 0);
    refused_hints(encoder);
    refused_times(encoder, info.time);
    image = scene_image(&dive, 1);
    info.hint = NULL;
    info.time = 20.5;
    MUST(nvsp_encode(plain, &image, &info, expected, sizeof expected, &wanted, NULL));
    EXPECT(NVSP_OK, nvsp_encode(encoder, &image, &info, bytes, sizeof bytes, &size, NULL));
    CHECK(size == wanted && memcmp(bytes, expected, size) == 0);
    nvsp_destroy(plain);

    EXPECT(NVSP_OK, nvsp_encoder_reset(encoder));
    info.time = 3;
    EXPECT(NVSP_ERR_NO_START,
           nvsp_encode(encoder, &image, &info, bytes, sizeof bytes, &size, NULL));
    info.hint = &dive.poses[1];
    nvsp_frame_stats stats = NVSP_INITIALIZER(nvsp_frame_stats);
    EXPECT(NVSP_OK, nvsp_encode(encoder, &image, &info, bytes, sizeof bytes, &size, &stats));
    CHECK(stats.frame == 2 && stats.start == NVSP_START_HINT);
    nvsp_destroy(encoder);
}

// Four frames of silt, then clear water. The encoder is lost at once, says so, and finds the pose again with the first
// clear frame, with a hint for every frame and without.
static void lost_frames(void) {
    static uint8_t grey[320 * 180 * 3];
    for (int hinted = 0; hinted < 2; hinted++) {
        nvsp_encoder *encoder = new_encoder(NULL);
        uint8_t bytes[16384];
        size_t size = 0;
        uint32_t noise = 1;
        for (uint32_t i = 0; i < 6; i++) {
            const int clear = i == 0 || i == 5;
            nvsp_image image = scene_image(&dive, 0);
            CHECK(image.sizes[0] <= sizeof grey);
            for (size_t k = 0; k < image.sizes[0] && k < sizeof grey; k++) {
                noise = noise * 1664525u + 1013904223u;
                grey[k] = (uint8_t)(110 + (noise >> 29));
            }
            if (!clear) image.planes[0] = grey;
            nvsp_frame_stats stats;
            nvsp_decoded header;
            MUST(NVSP_INIT(&stats));
            MUST(NVSP_INIT(&header));
            const nvsp_pose *hint = i == 0 || hinted ? &dive.poses[0] : NULL;
            EXPECT(NVSP_OK, nvsp_encode(encoder, &image, with_hint(hint), bytes, sizeof bytes, &size, &stats));
            EXPECT(NVSP_OK, nvsp_decode_header(bytes, size, NULL, &header));
            const uint32_t uncertain = clear ? 0 : NVSP_FRAME_UNCERTAIN;
            CHECK((stats.flags & NVSP_FRAME_UNCERTAIN) == uncertain);
            CHECK((header.flags & NVSP_FRAME_UNCERTAIN) == uncertain);
            CHECK(stats.frames_since_certain == (clear ? 0 : i));
            // Whether the position is known goes with it, in the packet too.
            const uint32_t known = clear ? NVSP_FRAME_POSITION_KNOWN : 0;
            CHECK((stats.flags & NVSP_FRAME_POSITION_KNOWN) == known);
            CHECK((header.flags & NVSP_FRAME_POSITION_KNOWN) == known);
            for (size_t axis = 0; axis < 6; axis++) {
                const double deviation = sqrt(stats.pose_covariance[7 * axis]);
                const double bound = axis < 3 ? stats.position_deviation : stats.rotation_deviation;
                CHECK(clear ? deviation > 0 && deviation <= bound && isfinite(bound) : isinf(deviation));
            }
        }
        nvsp_destroy(encoder);
    }
}

static void rates(void) {
    const nvsp_image image = scene_image(&dive, 0);
    const struct {
        uint32_t mode;
        float value;
    } wrong[] = {{NVSP_RATE_QUALITY, -1}, {NVSP_RATE_QUALITY, 101},        {NVSP_RATE_BYTES, -1},
                 {6, 1},                  {UINT32_MAX, 1},                 {NVSP_RATE_PSNR, strtof("nan", NULL)},
                 {NVSP_RATE_BYTES, strtof("inf", NULL)}, {NVSP_RATE_QUALITY, strtof("nan", NULL)}};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        EXPECT(NVSP_ERR_ARGUMENT,
               nvsp_encoder_set_rate(both.encoder, wrong[i].mode, wrong[i].value));
    }
    const size_t bound = nvsp_size_bound(NVSP_SIZE_PACKET, dive.camera.width, dive.camera.height);
    uint8_t *bytes = malloc(bound);
    for (int budget = 40; budget < 3000; budget += budget / 2) {
        nvsp_frame_stats stats = NVSP_INITIALIZER(nvsp_frame_stats);
        size_t size = 0;
        EXPECT(NVSP_OK, nvsp_encoder_set_rate(both.encoder, NVSP_RATE_BYTES, (float)budget));
        EXPECT(NVSP_OK, nvsp_encode(both.encoder, &image, with_hint(&dive.poses[0]), bytes, (size_t)budget, &size,
                                    &stats));
        CHECK(size <= (size_t)budget && size >= LATENT && stats.latent_bytes == LATENT);
    }
    size_t size = 77;
    EXPECT(NVSP_OK, nvsp_encoder_set_rate(both.encoder, NVSP_RATE_BYTES, LATENT - 1));
    EXPECT(NVSP_ERR_BUDGET, nvsp_encode(both.encoder, &image, NULL, bytes, bound, &size, NULL));
    CHECK(size == 77);
    EXPECT(NVSP_OK, nvsp_encoder_set_rate(both.encoder, NVSP_RATE_NONE, 0));
    EXPECT(NVSP_OK, nvsp_encode(both.encoder, &image, NULL, bytes, bound, &size, NULL));
    CHECK(size == LATENT);
    // Prior and camera come together.
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_announce(NULL));
    EXPECT(NVSP_OK, nvsp_encoder_announce(both.encoder));
    EXPECT(NVSP_OK, nvsp_encode(both.encoder, &image, NULL, bytes, bound, &size, NULL));
    CHECK(size == SESSION_LATENT + SESSION + RENDER_CHECK);
    // Once a frame was acknowledged, the check does not come with them, unless the device needs it.
    nvsp_frame_stats stats = NVSP_INITIALIZER(nvsp_frame_stats);
    EXPECT(NVSP_OK, nvsp_encoder_acknowledge(both.encoder, 3));
    EXPECT(NVSP_OK, nvsp_encoder_announce(both.encoder));
    EXPECT(NVSP_OK, nvsp_encode(both.encoder, &image, NULL, bytes, bound, &size, &stats));
    const size_t needed = stats.flags & NVSP_FRAME_NOT_PORTABLE ? RENDER_CHECK : 0;
    CHECK(size == SESSION_LATENT + SESSION + needed);
    EXPECT(NVSP_OK, nvsp_encoder_set_rate(both.encoder, NVSP_RATE_PSNR, 38));
    EXPECT(NVSP_OK, nvsp_encode(both.encoder, &image, NULL, bytes, bound, &size, &stats));
    CHECK(stats.psnr >= 38 && (stats.flags & NVSP_FRAME_RATE_MISSED) == 0);
    EXPECT(NVSP_OK, nvsp_encoder_set_rate(both.encoder, NVSP_RATE_PSNR, 98));
    EXPECT(NVSP_OK, nvsp_encode(both.encoder, &image, NULL, bytes, bound, &size, &stats));
    CHECK(stats.flags & NVSP_FRAME_RATE_MISSED);
    EXPECT(NVSP_OK, nvsp_encoder_set_rate(both.encoder, NVSP_RATE_QUALITY, 100));
    EXPECT(NVSP_OK, nvsp_encode(both.encoder, &image, NULL, bytes, bound, &size, NULL));
    CHECK(size <= bound);
    free(bytes);
    const uint32_t none[][2] = {{0, 5}, {5, 4097}, {UINT32_MAX, UINT32_MAX}};
    for (int i = 0; i < 3; i++) {
        CHECK(nvsp_size_bound(NVSP_SIZE_PACKET, none[i][0], none[i][1]) == 0);
    }
    CHECK(nvsp_size_bound(NVSP_SIZE_PACKET, 4096, 4096) > 0);
}

// Noise that the prior knows nothing of: the packet that takes the most.
static void bound_of_noise(void) {
    nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
    options.rate = NVSP_RATE_QUALITY;
    options.rate_value = 100;
    nvsp_encoder *encoder = new_encoder(&options);
    uint64_t seed = 5;
    uint8_t *pixels = malloc(dive.size);
    for (size_t i = 0; i < dive.size; i++) {
        pixels[i] = (uint8_t)random_bits(&seed);
    }
    nvsp_image image = scene_image(&dive, 0);
    image.planes[0] = pixels;
    const size_t bound = nvsp_size_bound(NVSP_SIZE_PACKET, dive.camera.width, dive.camera.height);
    uint8_t *bytes = malloc(bound);
    size_t size = 0;
    EXPECT(NVSP_OK, nvsp_encode(encoder, &image, with_hint(&dive.poses[0]), bytes, bound, &size, NULL));
    CHECK(size > 1000 && size <= bound);
    free(bytes);
    free(pixels);
    nvsp_destroy(encoder);
}

// The size of the packet of an image, with its pose as the hint.
static size_t packet_of(nvsp_prior *prior, const nvsp_encoder_options *options, const nvsp_image *image,
                        uint8_t *bytes, size_t room) {
    nvsp_encoder *encoder = NULL;
    size_t size = 0;
    MUST(nvsp_encoder_create(both.engine, prior, &dive.camera, options, &encoder));
    EXPECT(NVSP_OK, nvsp_encode(encoder, image, with_hint(&dive.poses[0]), bytes, room, &size, NULL));
    nvsp_destroy(encoder);
    return size;
}

// The prior says how its frames are treated, whatever their format. Frames may come treated already.
static void preprocessing(void) {
    nvsp_prior *prior = NULL;
    nvsp_prior_info info, plain;
    MUST(NVSP_INIT(&info));
    MUST(NVSP_INIT(&plain));
    MUST(nvsp_prior_open(both.engine, dive.preprocessed_prior, NULL, &prior));
    EXPECT(NVSP_OK, nvsp_prior_get_info(prior, &info));
    EXPECT(NVSP_OK, nvsp_prior_get_info(both.prior, &plain));
    CHECK(info.id == plain.id);
    CHECK(info.white_balance == NVSP_WHITE_BALANCE_GRAY_WORLD && info.clahe_tiles == 8);
    CHECK(info.clahe_clip_limit == 2.5f);
    CHECK(plain.white_balance == NVSP_WHITE_BALANCE_NONE && plain.clahe_tiles == 0);
    CHECK(plain.clahe_clip_limit == 0);

    uint8_t expected[4096], bytes[4096], *swapped = malloc(dive.size);
    nvsp_image image = scene_image(&dive, 0);
    image.planes[0] = dive.treated;
    const size_t wanted = packet_of(both.prior, NULL, &image, expected, sizeof expected);
    CHECK(!is_packet(0, expected, wanted));
    nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
    options.frames_treated = 1;
    size_t size = packet_of(prior, &options, &image, bytes, sizeof bytes);
    CHECK(size == wanted && memcmp(bytes, expected, size) == 0);

    image.planes[0] = dive.pixels[0];
    size = packet_of(prior, NULL, &image, bytes, sizeof bytes);
    CHECK(size == wanted && memcmp(bytes, expected, size) == 0);
    for (size_t i = 0; i < dive.size; i += 3) {
        swapped[i] = dive.pixels[0][i + 2];
        swapped[i + 1] = dive.pixels[0][i + 1];
        swapped[i + 2] = dive.pixels[0][i];
    }
    image.planes[0] = swapped;
    image.format = NVSP_FORMAT_BGR8;
    size = packet_of(prior, NULL, &image, bytes, sizeof bytes);
    CHECK(size == wanted && memcmp(bytes, expected, size) == 0);
    // The decoder needs no preprocessing, and shows the treated picture.
    uint8_t *shown = malloc(dive.size);
    nvsp_picture place = place_of(shown, dive.camera.width, dive.camera.height);
    EXPECT(NVSP_OK, nvsp_decode(both.decoder, bytes, size, 0, &place, NULL));
    CHECK(psnr(shown, dive.treated, dive.size) > psnr(shown, dive.pixels[0], dive.size));
    free(shown);
    free(swapped);
    nvsp_destroy(prior);
}

static void options_and_cameras(void) {
    nvsp_encoder *encoder = NULL;
    nvsp_encoder_options options;
    for (int i = 0; i < 5; i++) {
        MUST(NVSP_INIT(&options));
        options.tune = i == 0 ? 3 : 0;
        options.search_bound = i == 1 ? NVSP_BOUND_MILLISECONDS(0) : i == 2 ? NVSP_BOUND_MILLISECONDS(1) : 0;
        options.rate = i == 3 ? 6 : i == 4 ? NVSP_RATE_QUALITY : 0;
        options.rate_value = i == 4 ? 200 : 0;
        EXPECT(NVSP_ERR_ARGUMENT,
               nvsp_encoder_create(both.engine, both.prior, &dive.camera, &options, &encoder));
        CHECK(i != 2 || says(both.engine, "ms"));
    }
    // Bounds that a frame keeps: its first packet is that of a search without one.
    const uint32_t bounds[] = {NVSP_BOUND_RENDERS(96), NVSP_BOUND_RENDERS(INT32_MAX), NVSP_BOUND_MILLISECONDS(600000)};
    const nvsp_image image = scene_image(&dive, 0);
    for (size_t i = 0; i < sizeof bounds / sizeof *bounds; i++) {
        uint8_t bytes[4096];
        size_t size = 0;
        MUST(NVSP_INIT(&options));
        options.search_bound = bounds[i];
        nvsp_encoder *bounded = new_encoder(&options);
        EXPECT(NVSP_OK, nvsp_encode(bounded, &image, with_hint(&dive.poses[0]), bytes, sizeof bytes, &size, NULL));
        CHECK(is_packet(0, bytes, size));
        nvsp_destroy(bounded);
    }
    const float nan = strtof("nan", NULL), infinite = strtof("inf", NULL);
    nvsp_camera cameras[10];
    for (int i = 0; i < 10; i++) {
        cameras[i] = dive.camera;
    }
    cameras[0].width = 0;
    cameras[1].height = 0;
    cameras[2].width = 4097;
    cameras[3].height = UINT32_MAX;
    cameras[4].fx = 0;
    cameras[5].fy = -1;
    cameras[6].fx = nan;
    cameras[7].cx = nan;
    cameras[8].cy = infinite;
    cameras[9].fy = infinite;
    for (int i = 0; i < 10; i++) {
        EXPECT(NVSP_ERR_ARGUMENT,
               nvsp_encoder_create(both.engine, both.prior, &cameras[i], NULL, &encoder));
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_camera(both.encoder, &cameras[i]));
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_add_camera(both.decoder, &cameras[i]));
    }
    CHECK(encoder == NULL);
}

// Another size from one frame to the next, and back.
static void another_camera(void) {
    nvsp_encoder *encoder = new_encoder(NULL);
    const nvsp_image image = scene_image(&dive, 0);
    uint8_t bytes[4096], *pixels = malloc(dive.size);
    const uint32_t widths[] = {64, 96, 48};
    for (int i = 0; i < 3; i++) {
        const nvsp_camera camera = scaled_camera(&dive, widths[i]);
        nvsp_picture place = place_of(pixels, camera.width, camera.height);
        nvsp_decoded header = NVSP_INITIALIZER(nvsp_decoded);
        size_t size = 0;
        EXPECT(NVSP_OK, nvsp_encoder_set_camera(encoder, &camera));
        EXPECT(NVSP_OK, nvsp_encode(encoder, &image, with_hint(&dive.poses[0]), bytes, sizeof bytes, &size, NULL));
        EXPECT(NVSP_OK, nvsp_decode_header(bytes, size, NULL, &header));
        CHECK(header.width == camera.width && header.height == camera.height);
        CHECK(header.frame == (uint32_t)i);
        // The packet carries the camera: a decoder that never heard of it can use it.
        EXPECT(NVSP_OK, nvsp_decode(both.decoder, bytes, size, 0, &place, NULL));
    }
    free(pixels);
    nvsp_destroy(encoder);
}

// Encoder and decoder stay usable when the handles that they were made with are gone.
static void order_of_ends(void) {
    rig ends;
    rig_open(&ends, &dive);
    rig_add(&ends, &dive.camera, NULL);
    nvsp_destroy(ends.engine);
    nvsp_destroy(ends.prior);
    ends.engine = NULL;
    ends.prior = NULL;
    const nvsp_image image = scene_image(&dive, 0);
    uint8_t bytes[4096];
    size_t size = 0;
    EXPECT(NVSP_OK,
           nvsp_encode(ends.encoder, &image, with_hint(&dive.poses[0]), bytes, sizeof bytes, &size, NULL));
    CHECK(is_packet(0, bytes, size));
    EXPECT(NVSP_OK, nvsp_decode(ends.decoder, bytes, size, 0, NULL, NULL));
    nvsp_prior *other = NULL;
    MUST(nvsp_prior_open(both.engine, dive.other_prior, NULL, &other));
    EXPECT(NVSP_ERR_OTHER_PRIOR, nvsp_encoder_reopen(ends.encoder, both.engine, other));
    EXPECT(NVSP_ERR_OTHER_PRIOR, nvsp_decoder_reopen(ends.decoder, both.engine, other));
    nvsp_destroy(other);
    for (int i = 1; i < dive.frames; i++) {
        const nvsp_image next = scene_image(&dive, i);
        if (i == 2) {
            EXPECT(NVSP_OK, nvsp_encoder_reopen(ends.encoder, both.engine, both.prior));
            EXPECT(NVSP_OK, nvsp_decoder_reopen(ends.decoder, both.engine, both.prior));
        }
        EXPECT(NVSP_OK, nvsp_encode(ends.encoder, &next, NULL, bytes, sizeof bytes, &size, NULL));
        CHECK(is_packet(i, bytes, size));
        EXPECT(NVSP_OK, nvsp_decode(ends.decoder, bytes, size, 0, NULL, NULL));
    }
    rig_close(&ends);
}

static long lines;
static const uint8_t bytes_of_none[1];

static void count_lines(void *user, int32_t level, const char *message) {
    (void)user;
    lines += level == NVSP_LOG_ERROR;
    CHECK(strlen(message) > 3);
}

// What a caller states must make sense, and the text names the field.
static void named(nvsp_status wanted, nvsp_status found, const nvsp_engine *engine, const char *field) {
    EXPECT(wanted, found);
    CHECK(says(engine, field));
}

static void absurd_numbers(void) {
    nvsp_encoder *made = NULL;
    nvsp_prior *prior = NULL;
    const float rates[][2] = {{NVSP_RATE_PSNR, -5},       {NVSP_RATE_PSNR, 0},         {NVSP_RATE_PSNR, INFINITY},
                              {NVSP_RATE_DEFAULT, 30},    {NVSP_RATE_NONE, 1},         {NVSP_RATE_BYTES, -1},
                              {NVSP_RATE_QUALITY, NAN},   {NVSP_RATE_QUALITY, 100.5f}, {NVSP_RATE_DEFAULT, NAN}};
    for (size_t i = 0; i < sizeof rates / sizeof *rates; i++) {
        nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
        options.rate = (uint32_t)rates[i][0];
        options.rate_value = rates[i][1];
        named(NVSP_ERR_ARGUMENT, nvsp_encoder_create(both.engine, both.prior, &dive.camera, &options, &made),
              both.engine, "rate_value");
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_rate(both.encoder, options.rate, options.rate_value));
    }
    const float bad[] = {-1e9f, 1e9f, NAN, INFINITY};
    for (int i = 0; i < 16; i++) {
        const char *const names[] = {"fx", "fy", "cx", "cy"};
        nvsp_camera camera = dive.camera;
        float *const fields[] = {&camera.fx, &camera.fy, &camera.cx, &camera.cy};
        *fields[i / 4] = bad[i % 4];
        named(NVSP_ERR_ARGUMENT, nvsp_encoder_create(both.engine, both.prior, &camera, NULL, &made), both.engine,
              names[i / 4]);
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_camera(both.encoder, &camera));
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_add_camera(both.decoder, &camera));
    }
    for (int i = 0; i < 5; i++) {
        const char *const names[] = {"near_plane", "alpha_max", "antialiased", "background", "trained_focal"};
        nvsp_prior_options render = NVSP_INITIALIZER(nvsp_prior_options);
        render.near_plane = i == 0 ? 0.3f : 0;
        render.alpha_max = i == 1 ? 0.9f : 0;
        render.antialiased = i == 2;
        render.background[2] = i == 3 ? NAN : 0;
        render.trained_focal = i == 4 ? 300 : 0;
        named(NVSP_ERR_ARGUMENT, nvsp_prior_open(both.engine, dive.prior, &render, &prior), both.engine, names[i]);
    }
    const nvsp_image image = scene_image(&dive, 0);
    uint8_t bytes[4096];
    size_t written = 77;
    for (int i = 0; i < 7; i++) {
        nvsp_pose hint = dive.poses[0];
        double *const numbers[] = {&hint.rotation[0],    &hint.rotation[3],    &hint.translation[0],
                                   &hint.translation[1], &hint.translation[2], &hint.translation[0],
                                   &hint.translation[2]};
        *numbers[i] = i < 2 ? NAN : i < 5 ? 1e30 : -1e30;
        EXPECT(NVSP_ERR_ARGUMENT,
               nvsp_encode(both.encoder, &image, with_hint(&hint), bytes, sizeof bytes, &written, NULL));
        CHECK(says(both.encoder, "nvsp_frame_info.hint"));
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_encode_begin(both.encoder, &image, with_hint(&hint)));
    }
    CHECK(written == 77 && made == NULL && prior == NULL);
}

// The focal length that a prior was trained at can be stated; that makes it another prior.
static void trained_focal(void) {
    nvsp_prior_options options = NVSP_INITIALIZER(nvsp_prior_options);
    nvsp_prior_info infos[2] = {NVSP_INITIALIZER(nvsp_prior_info), NVSP_INITIALIZER(nvsp_prior_info)};
    nvsp_prior *prior = NULL;
    options.given = NVSP_PRIOR_TRAINED_FOCAL;
    options.trained_focal = 300;
    MUST(nvsp_prior_open(both.engine, dive.prior, &options, &prior));
    EXPECT(NVSP_OK, nvsp_prior_get_info(both.prior, &infos[0]));
    EXPECT(NVSP_OK, nvsp_prior_get_info(prior, &infos[1]));
    CHECK(infos[0].trained_focal == 0 && infos[1].trained_focal == 300);
    CHECK(infos[0].id != infos[1].id && infos[0].splats == infos[1].splats);
    nvsp_destroy(prior);
    prior = NULL;
    options.trained_focal = 0.5f;
    named(NVSP_ERR_ARGUMENT, nvsp_prior_open(both.engine, dive.prior, &options, &prior), both.engine, "trained_focal");
    CHECK(prior == NULL);
}

// A prior belongs to its engine; above the limits nothing is made; repeated errors are counted, not repeated.
static void another_engine(void) {
    nvsp_engine_options options = NVSP_INITIALIZER(nvsp_engine_options);
    nvsp_engine *other = NULL;
    nvsp_prior *prior = NULL;
    nvsp_encoder *encoder = NULL;
    nvsp_decoder *decoder = NULL;
    options.log = count_lines;
    options.frame_size_limit = dive.camera.width * dive.camera.height;
    options.host_memory_limit = 64 << 20;
    MUST(nvsp_engine_create(&options, &other));
    MUST(nvsp_prior_open(other, dive.prior, NULL, &prior));
    named(NVSP_ERR_ARGUMENT, nvsp_encoder_create(other, both.prior, &dive.camera, NULL, &encoder), other, "prior");
    named(NVSP_ERR_ARGUMENT, nvsp_decoder_create(other, both.prior, NULL, &decoder), other, "prior");
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_reopen(both.encoder, other, both.prior));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_reopen(both.decoder, both.engine, prior));
    MUST(nvsp_decoder_create(other, prior, NULL, &decoder));
    const nvsp_camera large = scaled_camera(&dive, dive.camera.width + 16);
    named(NVSP_ERR_MEMORY, nvsp_encoder_create(other, prior, &large, NULL, &encoder), other, "pixels");
    EXPECT(NVSP_ERR_MEMORY, nvsp_decoder_add_camera(decoder, &large));
    EXPECT(NVSP_OK, nvsp_decoder_add_camera(decoder, &dive.camera));
    CHECK(encoder == NULL);
    lines = 0;
    for (int i = 0; i < 100000; i++) {
        CHECK(nvsp_wait(decoder, 0) == NVSP_ERR_STATE);
    }
    CHECK(lines == 6);  // The first, then its counts: 10, 100 and so on.
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decode(decoder, bytes_of_none, 1, 99, NULL, NULL));
    CHECK(lines == 7);
    nvsp_destroy(decoder);
    nvsp_destroy(prior);
    nvsp_destroy(other);

    // A limit that nothing fits into.
    options.host_memory_limit = 1000;
    MUST(nvsp_engine_create(&options, &other));
    named(NVSP_ERR_MEMORY, nvsp_prior_open(other, dive.prior, NULL, &prior), other, "limit is");
    nvsp_destroy(other);
    options.host_memory_limit = 0;
    options.frame_size_limit = 0;
    options.device_memory_limit = 2000000;
    const nvsp_camera wide = scaled_camera(&dive, 640);
    MUST(nvsp_engine_create(&options, &other));
    nvsp_prior *small = NULL;
    nvsp_encoder *none = NULL;
    MUST(nvsp_prior_open(other, dive.prior, NULL, &small));
    named(NVSP_ERR_MEMORY, nvsp_encoder_create(other, small, &wide, NULL, &none), other, "limit is 2000000");
    CHECK(none == NULL);
    nvsp_destroy(small);
    nvsp_destroy(other);
}

// A limit of device memory holds for what is taken from the driver, too.
static void device_memory(void) {
    nvsp_engine_options options = patient_options();
    for (uint32_t mebibytes = 1; mebibytes <= 16; mebibytes *= 2) {
        rig own = {0};
        options.device_memory_limit = (uint64_t)mebibytes << 20;
        MUST(nvsp_engine_create(&options, &own.engine));
        MUST(nvsp_prior_open(own.engine, dive.prior, NULL, &own.prior));
        nvsp_status status = nvsp_encoder_create(own.engine, own.prior, &dive.camera, NULL, &own.encoder);
        if (status == NVSP_OK) {
            const nvsp_image image = scene_image(&dive, 0);
            uint8_t bytes[4096];
            size_t size = 0;
            status = nvsp_encode(own.encoder, &image, with_hint(&dive.poses[0]), bytes, sizeof bytes, &size, NULL);
            CHECK(status != NVSP_OK || is_packet(0, bytes, size));
        }
        CHECK(status == NVSP_ERR_MEMORY || status == NVSP_OK);
        CHECK(mebibytes < 16 || status == NVSP_OK);
        nvsp_engine_info info = NVSP_INITIALIZER(nvsp_engine_info);
        MUST(nvsp_engine_get_info(own.engine, &info));
        CHECK(info.memory_used > 0 && info.memory_used <= info.memory_reserved);
        CHECK(info.memory_reserved <= options.device_memory_limit);
        printf("limit %u MiB: %s, %llu bytes in %llu buffers\n", mebibytes, nvsp_status_text(status),
               (unsigned long long)info.memory_reserved, (unsigned long long)info.buffers);
        rig_close(&own);
    }
}

int main(int argc, char **argv) {
    set_up(argc, argv);
    rig_add(&both, &dive.camera, NULL);
    encode_all(&both, &dive, packets);

    nothing_yet();
    short_buffers();
    begun_and_finished();
    known_frames(0);
    known_frames(1);
    refused_and_reset();
    lost_frames();
    rates();
    bound_of_noise();
    preprocessing();
    options_and_cameras();
    another_camera();
    order_of_ends();
    absurd_numbers();
    trained_focal();
    another_engine();
    device_memory();
    return tear_down();
}
