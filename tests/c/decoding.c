// Decoding: the encoder's pictures byte for byte, headers, pictures in every format, what is refused.

#include "common.h"

#include <math.h>

static uint8_t *shown[MAX_FRAMES];  // What the encoder says that the topside will show.

// Encodes the dive, and keeps its pictures.
static void encode_dive(void) {
    for (int i = 0; i < dive.frames; i++) {
        const nvsp_image image = scene_image(&dive, i);
        const size_t room = nvsp_size_bound(NVSP_SIZE_PACKET, dive.camera.width, dive.camera.height);
        packets[i].bytes = malloc(room);
        MUST(nvsp_encode(both.encoder, &image, with_hint(i == 0 ? &dive.poses[0] : NULL), packets[i].bytes, room,
                         &packets[i].size, NULL));
        shown[i] = malloc(dive.size);
        nvsp_picture place = place_of(shown[i], dive.camera.width, dive.camera.height);
        MUST(nvsp_encoder_get_picture(both.encoder, NVSP_PICTURE_SHOWN, &place));
    }
    EXPECT(NVSP_ERR_ARGUMENT,
           nvsp_encoder_get_picture(both.encoder, 2, &(nvsp_picture){NVSP_HEAD(nvsp_picture), .format = 1}));
}

static void the_encoders_pictures(void) {
    uint8_t *pixels = malloc(dive.size);
    nvsp_picture place = place_of(pixels, dive.camera.width, dive.camera.height);
    for (int i = 0; i < dive.frames; i++) {
        nvsp_decoded info = NVSP_INITIALIZER(nvsp_decoded);
        memset(pixels, 0, dive.size);
        EXPECT(NVSP_OK,
               nvsp_decode(both.decoder, packets[i].bytes, packets[i].size, 0, &place, &info));
        CHECK(memcmp(pixels, shown[i], dive.size) == 0);
        CHECK(info.frame == (uint32_t)i && info.width == dive.camera.width);
        CHECK(info.height == dive.camera.height && info.rows == info.height);
        // With prior and camera, which the first packet states, comes a check of the render.
        const uint32_t checked = i == 0 ? NVSP_DECODED_SAME_RENDER : 0;
        CHECK(info.damage == NVSP_OK && info.flags == (NVSP_FRAME_POSITION_KNOWN | checked));
        CHECK(psnr(pixels, dive.pixels[i], dive.size) > 30);
    }
    // In any order, once the camera is known.
    for (int i = dive.frames - 1; i >= 0; i--) {
        EXPECT(NVSP_OK, nvsp_decode(both.decoder, packets[i].bytes, packets[i].size, 0, &place, NULL));
        CHECK(memcmp(pixels, shown[i], dive.size) == 0);
    }
    free(pixels);
}

// The filter changes the picture, says so, and leaves the rest alone.
static void filtered(void) {
    uint8_t *pixels = malloc(dive.size);
    nvsp_picture place = place_of(pixels, dive.camera.width, dive.camera.height);
    nvsp_decoded info = NVSP_INITIALIZER(nvsp_decoded);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_set_filter(both.decoder, 2));
    EXPECT(NVSP_OK, nvsp_decoder_set_filter(both.decoder, 1));
    EXPECT(NVSP_OK, nvsp_decode(both.decoder, packets[1].bytes, packets[1].size, 0, &place, &info));
    CHECK(info.flags == (NVSP_DECODED_FILTERED | NVSP_FRAME_POSITION_KNOWN) && info.rows == info.height);
    CHECK(psnr(pixels, shown[1], dive.size) > 30);
    EXPECT(NVSP_OK, nvsp_decoder_set_filter(both.decoder, 0));
    EXPECT(NVSP_OK, nvsp_decode(both.decoder, packets[1].bytes, packets[1].size, 0, &place, &info));
    CHECK(info.flags == NVSP_FRAME_POSITION_KNOWN && memcmp(pixels, shown[1], dive.size) == 0);
    free(pixels);
}

static void headers(void) {
    nvsp_prior_info prior;
    nvsp_decoded header, alone;
    nvsp_decoded info;
    MUST(NVSP_INIT(&prior));
    MUST(NVSP_INIT(&header));
    MUST(NVSP_INIT(&alone));
    MUST(NVSP_INIT(&info));
    EXPECT(NVSP_OK, nvsp_prior_get_info(both.prior, &prior));
    CHECK(prior.splats == 4800 && prior.dropped == 0 && prior.sh_degree == 0 && prior.spread > 0);
    CHECK(prior.key_frames == 0);
    // The first packet states prior and camera; the second names them by a tag.
    const uint32_t tag = crc32(0, packets[0].bytes + SESSION_LATENT, SESSION - 2) & 0xffff;
    for (uint32_t which = 0; which < 2; which++) {
        const packet one = packets[which];
        const uint32_t latent = which == 0 ? SESSION_LATENT : LATENT, session = which == 0 ? NVSP_DECODED_SESSION : 0;
        const uint32_t start = which == 0 ? SESSION_LATENT + SESSION : LATENT;
        EXPECT(NVSP_OK, nvsp_decode_header(one.bytes, one.size, both.prior, &header));
        EXPECT(NVSP_OK, nvsp_decode_header(one.bytes, start, both.prior, &alone));
        CHECK(memcmp(&header, &alone, sizeof header) == 0);
        CHECK(header.frame == which && header.latent_bytes == latent);
        CHECK(header.prior_id == (which == 0 ? prior.id : 0) && header.tag == tag);
        CHECK(header.width == (which == 0 ? dive.camera.width : 0));
        CHECK(header.height == (which == 0 ? dive.camera.height : 0));
        CHECK(header.flags == (NVSP_DECODED_POSE | NVSP_FRAME_POSITION_KNOWN | session));
        EXPECT(NVSP_OK, nvsp_decode(both.decoder, one.bytes, one.size, 0, NULL, &info));
        CHECK(memcmp(&info.pose, &header.pose, sizeof info.pose) == 0);
        EXPECT(NVSP_OK, nvsp_decode_header(one.bytes, one.size, NULL, &header));
        CHECK(header.flags == (NVSP_FRAME_POSITION_KNOWN | session) && header.pose.rotation[0] == 0);
        // The latent part alone.
        EXPECT(NVSP_OK, nvsp_decode_header(one.bytes, latent, both.prior, &header));
        CHECK(header.flags == (NVSP_DECODED_POSE | NVSP_FRAME_POSITION_KNOWN) && header.width == 0);
        CHECK(header.tag == tag && header.position_deviation == info.position_deviation);
        CHECK(memcmp(&header.pose, &alone.pose, sizeof header.pose) == 0);
        for (size_t size = 0; size < latent; size++) {
            EXPECT(NVSP_ERR_PACKET, nvsp_decode_header(one.bytes, size, both.prior, &header));
        }
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_decode_header(one.bytes, SIZE_MAX, both.prior, &header));
    }
    // One about another prior: the pose is not told.
    uint8_t other[SESSION_LATENT + SESSION];
    memcpy(other, packets[0].bytes, sizeof other);
    other[SESSION_LATENT] ^= 1;
    seal_session(other);
    EXPECT(NVSP_OK, nvsp_decode_header(other, sizeof other, both.prior, &header));
    CHECK(header.flags == (NVSP_DECODED_SESSION | NVSP_FRAME_POSITION_KNOWN));
    CHECK(isinf(header.position_deviation) && isinf(header.rotation_deviation));
    CHECK(header.prior_id == (prior.id ^ 1) && header.tag != tag);
    // A pose that is predicted from one that is not held: kind and frame number, the frame before, no base, no steps.
    uint8_t predicted[11] = {0x19, 0, 5};
    EXPECT(NVSP_ERR_PACKET, nvsp_decode_header(predicted, sizeof predicted, both.prior, &header));
    EXPECT(NVSP_ERR_PACKET, nvsp_decode(both.decoder, predicted, sizeof predicted, 0, NULL, NULL));
}

// Key frames are read from the file beside a prior.
static void key_frames(void) {
    nvsp_prior *other;
    nvsp_prior_info info = NVSP_INITIALIZER(nvsp_prior_info);
    MUST(nvsp_prior_open(both.engine, dive.other_prior, NULL, &other));
    EXPECT(NVSP_OK, nvsp_prior_get_info(other, &info));
    CHECK(info.key_frames == 3);
    nvsp_destroy(other);
}

// A place of another format, with `padding` bytes after each row and a guard at the end.
static void place_with_padding(uint32_t format, size_t padding) {
    const size_t step = format == NVSP_FORMAT_RGBA8 ? 4 : 3, width = dive.camera.width;
    const size_t stride = width * step + padding, rows = dive.camera.height;
    const size_t size = stride * (rows - 1) + width * step;
    uint8_t *pixels = malloc(size + 64);
    memset(pixels, 0xa5, size + 64);
    nvsp_picture place = {NVSP_HEAD(nvsp_picture), .format = format, .pixels = pixels, .stride = stride, .size = size};
    EXPECT(NVSP_OK, nvsp_decode(both.decoder, packets[0].bytes, packets[0].size, 0, &place, NULL));
    int same = 1;
    for (size_t y = 0; y < rows; y++) {
        for (size_t x = 0; x < width; x++) {
            const uint8_t *p = pixels + y * stride + x * step, *q = shown[0] + 3 * (y * width + x);
            const int flip = format == NVSP_FORMAT_BGR8 ? 2 : 0;
            same &= p[flip] == q[0] && p[1] == q[1] && p[2 - flip] == q[2];
            same &= step == 3 || p[3] == 255;
        }
        same &= y + 1 == rows || all_are(pixels + y * stride + width * step, 0xa5, padding);
    }
    CHECK(same && all_are(pixels + size, 0xa5, 64));
    free(pixels);
}

// Invalid places are refused before or after decoding. Nothing is written in either case.
static void invalid_places(void) {
    uint8_t *pixels = malloc(dive.size);
    memset(pixels, 0xa5, dive.size);
    nvsp_picture valid = place_of(pixels, dive.camera.width, dive.camera.height);
    const packet one = packets[0];
#define PLACE(f, r, p, s, n) \
    {NVSP_HEAD(nvsp_picture), .format = f, .reserved = r, .pixels = p, .stride = s, .size = n}
    struct {
        nvsp_status status;
        nvsp_picture place;
    } places[] = {
        {NVSP_ERR_ARGUMENT, PLACE(valid.format, 0, NULL, valid.stride, valid.size)},
        {NVSP_ERR_ARGUMENT, PLACE(0, 0, pixels, valid.stride, valid.size)},
        {NVSP_ERR_ARGUMENT, PLACE(NVSP_FORMAT_NV12, 0, pixels, valid.stride, valid.size)},
        {NVSP_ERR_ARGUMENT, PLACE(NVSP_FORMAT_I420, 0, pixels, valid.stride, valid.size)},
        {NVSP_ERR_ARGUMENT, PLACE(99, 0, pixels, valid.stride, valid.size)},
        {NVSP_ERR_ARGUMENT, PLACE(valid.format, 1, pixels, valid.stride, valid.size)},
        {NVSP_ERR_ARGUMENT, PLACE(valid.format, 0, pixels, valid.stride - 1, valid.size)},
        {NVSP_ERR_ARGUMENT, PLACE(NVSP_FORMAT_RGBA8, 0, pixels, valid.stride, valid.size)},
        {NVSP_ERR_ARGUMENT, PLACE(valid.format, 0, pixels, valid.stride, SIZE_MAX)},
        {NVSP_ERR_BUFFER_TOO_SMALL, PLACE(valid.format, 0, pixels, valid.stride, valid.size - 1)},
        {NVSP_ERR_BUFFER_TOO_SMALL, PLACE(valid.format, 0, pixels, valid.stride, 0)},
        {NVSP_ERR_BUFFER_TOO_SMALL, PLACE(valid.format, 0, pixels, SIZE_MAX, valid.size)},
        {NVSP_ERR_BUFFER_TOO_SMALL, PLACE(valid.format, 0, pixels, SIZE_MAX / 53, valid.size)},
    };
    for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
        EXPECT(places[i].status,
               nvsp_decode(both.decoder, one.bytes, one.size, 0, &places[i].place, NULL));
        EXPECT(places[i].status,
               nvsp_encoder_get_picture(both.encoder, NVSP_PICTURE_SHOWN, &places[i].place));
        CHECK(all_are(pixels, 0xa5, dive.size));
        if (places[i].status == NVSP_ERR_BUFFER_TOO_SMALL) {
            CHECK(places[i].place.width == dive.camera.width && places[i].place.height == dive.camera.height);
            CHECK(places[i].place.needed > places[i].place.size);
        } else {
            CHECK(places[i].place.needed == 0);
        }
    }
    // A place without pixels asks for the size. A stride of 0 is that of rows without padding.
    nvsp_picture asks = {NVSP_HEAD(nvsp_picture), .format = NVSP_FORMAT_RGB8};
    EXPECT(NVSP_ERR_BUFFER_TOO_SMALL, nvsp_encoder_get_picture(both.encoder, NVSP_PICTURE_SHOWN, &asks));
    CHECK(asks.needed == dive.size);
    // The picture that had no room is still there, once.
    EXPECT(NVSP_OK, nvsp_decode_finish(both.decoder, &valid, NULL));
    CHECK(memcmp(pixels, shown[0], dive.size) == 0);
    EXPECT(NVSP_ERR_STATE, nvsp_decode_finish(both.decoder, &valid, NULL));
    free(pixels);
}

static void begun_and_finished(void) {
    nvsp_decoder *decoder = NULL;
    uint8_t *pixels = malloc(dive.size);
    nvsp_picture place = place_of(pixels, dive.camera.width, dive.camera.height);
    MUST(nvsp_decoder_create(both.engine, both.prior, NULL, &decoder));
    EXPECT(NVSP_ERR_STATE, nvsp_wait(decoder, 0));
    EXPECT(NVSP_ERR_STATE, nvsp_wait(decoder, 1));
    EXPECT(NVSP_ERR_STATE, nvsp_decode_finish(decoder, &place, NULL));
    for (int i = 0; i < dive.frames; i++) {
        uint8_t *bytes = malloc(packets[i].size);
        memcpy(bytes, packets[i].bytes, packets[i].size);
        nvsp_decoded info = NVSP_INITIALIZER(nvsp_decoded);
        EXPECT(NVSP_OK, nvsp_decode_begin(decoder, bytes, packets[i].size, 0));
        free(bytes);  // Not needed any more.
        EXPECT(NVSP_ERR_UNFINISHED, nvsp_decode_begin(decoder, packets[i].bytes, packets[i].size, 0));
        EXPECT(NVSP_OK, nvsp_wait(decoder, 60000));
        EXPECT(NVSP_OK, nvsp_wait(decoder, 0));
        EXPECT(NVSP_ERR_UNFINISHED, nvsp_decode_begin(decoder, packets[i].bytes, packets[i].size, 0));
        EXPECT(NVSP_OK, nvsp_decode_finish(decoder, &place, &info));
        CHECK(memcmp(pixels, shown[i], dive.size) == 0 && info.frame == (uint32_t)i);
    }
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decode_begin(decoder, packets[0].bytes, packets[0].size, 2));
    EXPECT(NVSP_OK, nvsp_decode_begin(decoder, packets[0].bytes, SESSION_LATENT - 1, 0));
    EXPECT(NVSP_OK, nvsp_wait(decoder, 60000));
    EXPECT(NVSP_ERR_PACKET, nvsp_decode_finish(decoder, &place, NULL));
    EXPECT(NVSP_ERR_STATE, nvsp_decode_finish(decoder, &place, NULL));
    EXPECT(NVSP_OK, nvsp_decode_begin(decoder, packets[0].bytes, packets[0].size, 0));
    nvsp_destroy(decoder);
    free(pixels);
}

// Packets of another prior, what comes after one, and packets of a camera that was in a packet that is missing.
static void unknown_to_the_topside(void) {
    nvsp_prior *other = NULL;
    nvsp_decoder *decoder = NULL;
    nvsp_decoded info = NVSP_INITIALIZER(nvsp_decoded);
    MUST(nvsp_prior_open(both.engine, dive.other_prior, NULL, &other));
    MUST(nvsp_decoder_create(both.engine, other, NULL, &decoder));
    EXPECT(NVSP_ERR_OTHER_PRIOR,
           nvsp_decode(decoder, packets[0].bytes, packets[0].size, 0, NULL, &info));
    nvsp_destroy(decoder);
    nvsp_destroy(other);
    MUST(nvsp_decoder_create(both.engine, both.prior, NULL, &decoder));
    EXPECT(NVSP_ERR_CAMERA_UNKNOWN,
           nvsp_decode(decoder, packets[1].bytes, packets[1].size, 0, NULL, &info));
    CHECK(info.width == 0);
    EXPECT(NVSP_OK, nvsp_decoder_add_camera(decoder, &dive.camera));
    EXPECT(NVSP_OK, nvsp_decode(decoder, packets[1].bytes, packets[1].size, 0, NULL, &info));
    EXPECT(NVSP_ERR_ARGUMENT,
           nvsp_decode(decoder, packets[1].bytes, packets[1].size, 2, NULL, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decode(decoder, packets[1].bytes, SIZE_MAX, 0, NULL, NULL));
    // After a packet of another prior nothing is shown until one states this prior.
    uint8_t strange[SESSION_LATENT + SESSION];
    memcpy(strange, packets[0].bytes, sizeof strange);
    strange[SESSION_LATENT] ^= 1;
    seal_session(strange);
    EXPECT(NVSP_ERR_OTHER_PRIOR, nvsp_decode(decoder, strange, sizeof strange, 0, NULL, &info));
    EXPECT(NVSP_ERR_OTHER_PRIOR, nvsp_decode(decoder, packets[1].bytes, packets[1].size, 0, NULL, &info));
    CHECK(says(decoder, "wait for one that states this prior"));
    EXPECT(NVSP_OK, nvsp_decode(decoder, packets[0].bytes, packets[0].size, 0, NULL, &info));
    EXPECT(NVSP_OK, nvsp_decode(decoder, packets[1].bytes, packets[1].size, 0, NULL, &info));
    nvsp_destroy(decoder);
}

// A packet without its end gives the render alone. With NVSP_DECODE_START it gives what came of the
// difference picture.
static void starts_of_packets(void) {
    uint8_t *render = malloc(dive.size), *pixels = malloc(dive.size);
    nvsp_picture render_place = place_of(render, dive.camera.width, dive.camera.height);
    nvsp_picture place = place_of(pixels, dive.camera.width, dive.camera.height);
    const packet one = packets[1];
    EXPECT(NVSP_OK, nvsp_decode(both.decoder, one.bytes, LATENT, 0, &render_place, NULL));
    uint32_t rows = 0;
    for (size_t size = LATENT; size <= one.size; size++) {
        nvsp_decoded info = NVSP_INITIALIZER(nvsp_decoded);
        EXPECT(NVSP_OK, nvsp_decode(both.decoder, one.bytes, size, 0, &place, &info));
        CHECK(size == one.size ? info.rows == info.height && info.damage == NVSP_OK
                               : info.rows == 0 && info.damage == NVSP_ERR_RESIDUAL);
        CHECK(memcmp(pixels, size == one.size ? shown[1] : render, dive.size) == 0);
        EXPECT(NVSP_OK, nvsp_decode(both.decoder, one.bytes, size, NVSP_DECODE_START, &place, &info));
        CHECK(info.rows >= rows && (size == one.size) == (info.damage == NVSP_OK));
        rows = info.rows;
        // The wavelet coder's start reaches all rows, or is too short for any.
        CHECK(rows == 0 || rows == info.height);
        CHECK(rows > 0 || memcmp(pixels, render, dive.size) == 0);
        CHECK(size < one.size || memcmp(pixels, shown[1], dive.size) == 0);
    }
    CHECK(rows == dive.camera.height);
    free(render);
    free(pixels);
}

// What came of opening, failing and succeeding, as the log has it.
static int logged[4];

static void count_messages(void *user, int32_t level, const char *message) {
    CHECK(user == logged && level >= 1 && level <= 3 && message[0] != '\0');
    logged[level]++;
}

static void messages(void) {
    nvsp_engine_options options = patient_options();
    options.log = count_messages;
    options.log_user = logged;
    rig link = {0};
    options.device = "no such device";
    EXPECT(NVSP_ERR_NO_DEVICE, nvsp_engine_create(&options, &link.engine));
    CHECK(link.engine == NULL && logged[NVSP_LOG_ERROR] == 1);
    options.device = "\xff";
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_engine_create(&options, &link.engine));
    options.device = NULL;
    options.flags = 2;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_engine_create(&options, &link.engine));
    options.flags = 0;
    options.reserved = 1;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_engine_create(&options, &link.engine));
    options.reserved = 0;
    memset(logged, 0, sizeof logged);
    MUST(nvsp_engine_create(&options, &link.engine));
    MUST(nvsp_prior_open(link.engine, dive.prior, NULL, &link.prior));
    CHECK(logged[NVSP_LOG_INFO] == 2 && logged[NVSP_LOG_ERROR] == 0);
    rig_add(&link, &dive.camera, NULL);
    memset(logged, 0, sizeof logged);
    packet again[MAX_FRAMES];
    encode_all(&link, &dive, again);
    for (int i = 0; i < dive.frames; i++) {
        EXPECT(NVSP_OK, nvsp_decode(link.decoder, again[i].bytes, again[i].size, 0, NULL, NULL));
        free(again[i].bytes);
    }
    CHECK(logged[1] + logged[2] + logged[3] == 0);
    EXPECT(NVSP_ERR_PACKET, nvsp_decode(link.decoder, shown[0], 9, 0, NULL, NULL));
    CHECK(logged[NVSP_LOG_ERROR] == 1);
    char text[512];
    memset(text, 'x', sizeof text);
    EXPECT(NVSP_OK, nvsp_last_error(link.decoder, text, sizeof text));
    CHECK(strlen(text) > 5);
    EXPECT(NVSP_OK, nvsp_last_error(link.decoder, text, 4));
    CHECK(strlen(text) <= 3);
    rig_close(&link);
}

int main(int argc, char **argv) {
    set_up(argc, argv);
    rig_add(&both, &dive.camera, NULL);
    encode_dive();

    the_encoders_pictures();
    filtered();
    headers();
    key_frames();
    const uint32_t formats[] = {NVSP_FORMAT_RGB8, NVSP_FORMAT_BGR8, NVSP_FORMAT_RGBA8};
    for (int i = 0; i < 6; i++) {
        place_with_padding(formats[i % 3], i < 3 ? 0 : 11);
    }
    invalid_places();
    begun_and_finished();
    unknown_to_the_topside();
    starts_of_packets();
    messages();
    for (int i = 0; i < dive.frames; i++) {
        free(shown[i]);
    }
    return tear_down();
}
