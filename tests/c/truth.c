// Truth maps: what they say of each block is true, whatever the rate is and however much of a packet came.

#include "common.h"

#include <math.h>

#define BLOCK 16
#define MAX_BLOCKS 64

static uint8_t *pixels;
static long found[4];  // Blocks of each level.

// The root of the mean squared error in a part of two pictures.
static double off_by(const uint8_t *a, const uint8_t *b, uint32_t left, uint32_t top, uint32_t right, uint32_t bottom) {
    double sum = 0;
    for (uint32_t y = top; y < bottom; y++) {
        for (uint32_t at = 3 * (y * dive.camera.width + left); at < 3 * (y * dive.camera.width + right); at++) {
            sum += ((double)a[at] - b[at]) * ((double)a[at] - b[at]);
        }
    }
    return sqrt(sum / (3.0 * (right - left) * (bottom - top)));
}

static double larger(double a, double b) { return a > b ? a : b; }

// How far each block is off: its worst window, of those whose centre lies in it.
static void measure(const uint8_t *frame, const uint8_t *shown, double *worst) {
    const uint32_t width = dive.camera.width, height = dive.camera.height, columns = (width + BLOCK - 1) / BLOCK;
    for (uint32_t i = 0; i < columns * ((height + BLOCK - 1) / BLOCK); i++) {
        const uint32_t left = i % columns * BLOCK, top = i / columns * BLOCK;
        const uint32_t right = left + BLOCK < width ? left + BLOCK : width;
        worst[i] = off_by(frame, shown, left, top, right, top + BLOCK < height ? top + BLOCK : height);
    }
    for (uint32_t top = 0; top + BLOCK <= height; top++) {
        for (uint32_t left = 0; left + BLOCK <= width; left++) {
            double *block = &worst[(top + BLOCK / 2) / BLOCK * columns + (left + BLOCK / 2) / BLOCK];
            *block = larger(*block, off_by(frame, shown, left, top, left + BLOCK, top + BLOCK));
        }
    }
}

// The map of the picture that was decoded or drawn last; it fits its bound.
static nvsp_truth map_of(nvsp_decoder *decoder, uint8_t *levels) {
    nvsp_truth truth = NVSP_INITIALIZER(nvsp_truth);
    size_t written = 0;
    const size_t room = nvsp_size_bound(NVSP_SIZE_TRUTH, dive.camera.width, dive.camera.height);
    EXPECT(NVSP_OK, nvsp_decoder_get_truth(decoder, levels, room, &written, &truth));
    CHECK(written == room && truth.columns * truth.rows == room && truth.block_size == BLOCK && truth.reserved == 0);
    CHECK(truth.columns == (dive.camera.width + BLOCK - 1) / BLOCK);
    return truth;
}

// Checks the map of the picture in `pixels` against the frame.
static nvsp_truth check_map(nvsp_decoder *decoder, const uint8_t *frame) {
    uint8_t levels[MAX_BLOCKS];
    double worst[MAX_BLOCKS];
    const nvsp_truth truth = map_of(decoder, levels);
    measure(frame, pixels, worst);
    for (uint32_t i = 0; i < truth.columns * truth.rows; i++) {
        CHECK(levels[i] <= NVSP_TRUTH_NOT_SEEN);
        found[levels[i] % 4]++;
        CHECK(levels[i] != NVSP_TRUTH_AS_SEEN || worst[i] <= truth.differs_above + 0.01);
        CHECK(levels[i] != NVSP_TRUTH_DIFFERS || worst[i] <= truth.wrong_above + 0.01);
        CHECK(levels[i] == NVSP_TRUTH_NOT_SEEN || truth.differs_above > 0);
    }
    CHECK(truth.differs_above < truth.wrong_above || truth.wrong_above == 0);
    return truth;
}

// Turns part of each frame into what the prior does not show: the brightness is reversed.
static void add_objects(void) {
    for (int frame = 0; frame < dive.frames; frame++) {
        for (uint32_t y = 20; y < 40; y++) {
            uint8_t *row = dive.pixels[frame] + 3 * (y * dive.camera.width + 50);
            for (int i = 0; i < 3 * 24; i++) {
                row[i] = (uint8_t)(255 - row[i]);
            }
        }
    }
}

// All frames at a rate, each whole and cut at some places.
static void at_rate(uint32_t rate, float value, uint32_t mode) {
    nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
    options.rate = rate;
    options.rate_value = value;
    options.mode = mode;
    nvsp_encoder *encoder = new_encoder(&options);
    nvsp_picture place = place_of(pixels, dive.camera.width, dive.camera.height);
    for (int frame = 0; frame < (few() ? 2 : dive.frames); frame++) {
        const nvsp_image image = scene_image(&dive, frame);
        nvsp_frame_stats stats = NVSP_INITIALIZER(nvsp_frame_stats);
        uint8_t bytes[16384];
        size_t size = 0;
        MUST(nvsp_encode(encoder, &image, with_hint(frame == 0 ? &dive.poses[0] : NULL), bytes, sizeof bytes, &size,
                         &stats));
        // 8 % of the packet or of its budget, or six bytes. Without a difference picture it has a length of its own, of
        // one byte, and a check of four.
        const float most = rate == NVSP_RATE_BYTES ? value : (float)size;
        CHECK(size <= most && stats.truth_bytes > 0);
        CHECK(stats.truth_bytes <= 6 + 5 || 100 * (float)stats.truth_bytes <= 8 * most);
        for (size_t end = size; end > stats.latent_bytes; end -= (end + 5) / 6) {
            EXPECT(NVSP_OK, nvsp_decode(both.decoder, bytes, end, NVSP_DECODE_START, &place, NULL));
            const nvsp_truth truth = check_map(both.decoder, dive.pixels[frame]);
            CHECK(end < size || truth.differs_above > 0);
        }
    }
    nvsp_destroy(encoder);
}

static void all_rates(void) {
    const float budgets[] = {64, 100, 200, 600};
    for (int i = 0; i < 4; i++) {
        at_rate(NVSP_RATE_BYTES, budgets[i], NVSP_MODE_INTRA);
    }
    at_rate(NVSP_RATE_QUALITY, 10, NVSP_MODE_INTRA);
    at_rate(NVSP_RATE_QUALITY, 10, NVSP_MODE_CHAIN);
    at_rate(NVSP_RATE_PSNR, 40, NVSP_MODE_INTRA);
    printf("blocks as seen %ld, different %ld, wrong %ld, not seen %ld\n", found[NVSP_TRUTH_AS_SEEN],
           found[NVSP_TRUTH_DIFFERS], found[NVSP_TRUTH_WRONG], found[NVSP_TRUTH_NOT_SEEN]);
    CHECK(found[0] > 20 && found[1] > 20 && found[2] > 20 && found[3] > 20);
}

// A packet with and one without a map.
static packet encoded(uint32_t no_truth) {
    static uint8_t bytes[2][16384];
    nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
    options.no_truth = no_truth;
    nvsp_encoder *encoder = new_encoder(&options);
    nvsp_frame_stats stats = NVSP_INITIALIZER(nvsp_frame_stats);
    const nvsp_image image = scene_image(&dive, 0);
    packet made = {bytes[no_truth], 0};
    MUST(nvsp_encode(encoder, &image, with_hint(&dive.poses[0]), made.bytes, sizeof bytes[0], &made.size, &stats));
    CHECK((stats.truth_bytes == 0) == (no_truth != 0));
    nvsp_destroy(encoder);
    return made;
}

static void nothing_is_known(nvsp_decoder *decoder) {
    uint8_t levels[MAX_BLOCKS];
    const nvsp_truth truth = map_of(decoder, levels);
    CHECK(all_are(levels, NVSP_TRUTH_NOT_SEEN, truth.columns * truth.rows));
    CHECK(truth.differs_above == 0 && truth.wrong_above == 0);
}

// What the map is about, from one call to the next.
static void which_picture(void) {
    const packet with = encoded(0), without = encoded(1);
    nvsp_decoder *decoder = NULL;
    nvsp_picture place = place_of(pixels, dive.camera.width, dive.camera.height);
    uint8_t levels[MAX_BLOCKS];
    size_t written = 77;
    MUST(nvsp_decoder_create(both.engine, both.prior, NULL, &decoder));
    EXPECT(NVSP_ERR_STATE, nvsp_decoder_get_truth(decoder, levels, sizeof levels, &written, NULL));
    EXPECT(NVSP_ERR_PACKET, nvsp_decode(decoder, with.bytes, 5, 0, &place, NULL));
    EXPECT(NVSP_ERR_STATE, nvsp_decoder_get_truth(decoder, levels, sizeof levels, &written, NULL));
    CHECK(written == 77);
    EXPECT(NVSP_OK, nvsp_decode(decoder, without.bytes, without.size, 0, &place, NULL));
    nothing_is_known(decoder);
    EXPECT(NVSP_OK, nvsp_decode(decoder, with.bytes, with.size, 0, &place, NULL));
    CHECK(check_map(decoder, dive.pixels[0]).differs_above > 0);
    // One that is refused leaves the picture before, and its map.
    EXPECT(NVSP_ERR_PACKET, nvsp_decode(decoder, with.bytes, 5, 0, &place, NULL));
    CHECK(check_map(decoder, dive.pixels[0]).differs_above > 0);
    EXPECT(NVSP_OK, nvsp_decoder_draw(decoder, &dive.poses[1], &place));
    nothing_is_known(decoder);
    // The pose alone: the difference picture did not arrive.
    EXPECT(NVSP_OK, nvsp_decode(decoder, with.bytes, with.size - 1, 0, &place, NULL));
    nothing_is_known(decoder);
    EXPECT(NVSP_OK, nvsp_decode_begin(decoder, with.bytes, with.size, 0));
    EXPECT(NVSP_ERR_UNFINISHED, nvsp_decoder_get_truth(decoder, levels, sizeof levels, &written, NULL));
    EXPECT(NVSP_OK, nvsp_wait(decoder, 60000));
    EXPECT(NVSP_OK, nvsp_decode_finish(decoder, &place, NULL));
    CHECK(check_map(decoder, dive.pixels[0]).differs_above > 0);
    nvsp_destroy(decoder);
}

static void places(void) {
    const uint32_t width = dive.camera.width, height = dive.camera.height;
    const size_t room = nvsp_size_bound(NVSP_SIZE_TRUTH, width, height);
    uint8_t levels[MAX_BLOCKS];
    size_t written = 77;
    memset(levels, 0xa5, sizeof levels);
    CHECK(room == (size_t)((width + 15) / 16) * ((height + 15) / 16) && room <= sizeof levels);
    const uint32_t sizes[][3] = {{1, 1, 1}, {17, 16, 2}, {4096, 4096, 65536}, {0, 54, 0}, {96, 0, 0}, {4097, 54, 0},
                                 {96, UINT32_MAX, 0}};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        CHECK(nvsp_size_bound(NVSP_SIZE_TRUTH, sizes[i][0], sizes[i][1]) == sizes[i][2]);
    }
    CHECK(nvsp_size_bound(2, 96, 54) == 0);
    nvsp_decoder *decoder = both.decoder;
    nvsp_truth truth = NVSP_INITIALIZER(nvsp_truth);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_get_truth(decoder, levels, SIZE_MAX, &written, &truth));
    CHECK(written == 77);
    EXPECT(NVSP_ERR_BUFFER_TOO_SMALL, nvsp_decoder_get_truth(decoder, levels, room - 1, &written, &truth));
    CHECK(written == room && truth.columns == 0 && all_are(levels, 0xa5, sizeof levels));
    EXPECT(NVSP_OK, nvsp_decoder_get_truth(decoder, levels, sizeof levels, &written, NULL));
    CHECK(all_are(levels + room, 0xa5, sizeof levels - room));
}

int main(int argc, char **argv) {
    set_up(argc, argv);
    rig_add(&both, &dive.camera, NULL);
    pixels = malloc(dive.size);
    add_objects();
    all_rates();
    which_picture();
    places();
    free(pixels);
    return tear_down();
}
