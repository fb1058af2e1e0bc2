// Camera images of every format, with padding, of other sizes; and images that are not valid.

#include "common.h"

#include <math.h>

// Encodes frame 0, given as `image`, with a new encoder; the packet's bytes, in `bytes`.
static size_t encode(const nvsp_image *image, const nvsp_encoder_options *options, uint8_t *bytes,
                     size_t room, uint8_t *shown) {
    nvsp_encoder *encoder = NULL;
    size_t size = 0;
    MUST(nvsp_encoder_create(both.engine, both.prior, &dive.camera, options, &encoder));
    EXPECT(NVSP_OK, nvsp_encode(encoder, image, with_hint(&dive.poses[0]), bytes, room, &size, NULL));
    if (shown != NULL) {
        nvsp_picture place = place_of(shown, dive.camera.width, dive.camera.height);
        EXPECT(NVSP_OK, nvsp_encoder_get_picture(encoder, NVSP_PICTURE_SHOWN, &place));
    }
    nvsp_destroy(encoder);
    return size;
}

// Frame 0 in another order of channels, with `padding` bytes of garbage after each row but the last.
static nvsp_image reordered(uint32_t format, size_t padding, uint8_t **bytes) {
    const uint32_t width = dive.camera.width, height = dive.camera.height;
    const size_t step = format == NVSP_FORMAT_RGBA8 ? 4 : 3, row = width * step;
    const size_t size = (row + padding) * (height - 1) + row;
    *bytes = malloc(size);
    memset(*bytes, 0x5a, size);
    for (size_t i = 0; i < (size_t)width * height; i++) {
        uint8_t *to = *bytes + i / width * (row + padding) + i % width * step;
        for (size_t c = 0; c < 3; c++) {
            to[format == NVSP_FORMAT_BGR8 ? 2 - c : c] = dive.pixels[0][3 * i + c];
        }
    }
    return (nvsp_image){NVSP_HEAD(nvsp_image), .format = format,
                        .width = width,
                        .height = height,
                        .planes = {*bytes},
                        .strides = {row + padding},
                        .sizes = {size}};
}

static void channels_and_strides(void) {
    uint8_t plain[4096], other[4096];
    const nvsp_image image = scene_image(&dive, 0);
    const size_t size = encode(&image, NULL, plain, sizeof plain, NULL);
    const uint32_t formats[] = {NVSP_FORMAT_RGB8, NVSP_FORMAT_BGR8, NVSP_FORMAT_RGBA8};
    for (size_t i = 0; i < 3; i++) {
        for (size_t padding = 0; padding <= 13; padding += 13) {
            uint8_t *bytes = NULL;
            nvsp_image same = reordered(formats[i], padding, &bytes);
            same.colour = (uint32_t)padding;  // Means something for YUV alone.
            const size_t found = encode(&same, NULL, other, sizeof other, NULL);
            CHECK(found == size && memcmp(plain, other, size) == 0);
            free(bytes);
        }
    }
}

// Doubled in both directions: scaled back, it is the frame itself.
static void scaled(void) {
    uint8_t plain[4096], other[4096];
    const nvsp_image image = scene_image(&dive, 0);
    const size_t size = encode(&image, NULL, plain, sizeof plain, NULL);
    const size_t width = dive.camera.width, height = dive.camera.height;
    uint8_t *bytes = malloc(4 * dive.size);
    for (size_t i = 0; i < 4 * width * height; i++) {
        const size_t x = i % (2 * width), y = i / (2 * width);
        memcpy(bytes + 3 * i, dive.pixels[0] + 3 * (y / 2 * width + x / 2), 3);
    }
    const nvsp_image doubled = {NVSP_HEAD(nvsp_image), .format = NVSP_FORMAT_RGB8,
                                .width = 2 * dive.camera.width,
                                .height = 2 * dive.camera.height,
                                .planes = {bytes},
                                .strides = {6 * width},
                                .sizes = {4 * dive.size}};
    const size_t found = encode(&doubled, NULL, other, sizeof other, NULL);
    CHECK(found == size && memcmp(plain, other, size) == 0);
    free(bytes);
}

// Luma's weights of red and blue, and whether the range is full, of each NVSP_COLOUR_*.
static const struct {
    double red, blue;
    int full;
} colours[] = {{0.299, 0.114, 0}, {0.299, 0.114, 1}, {0.2126, 0.0722, 0}, {0.2126, 0.0722, 1}};

static uint8_t rounded(double v) { return (uint8_t)(v < 0 ? 0 : v > 255 ? 255 : floor(v + 0.5)); }

// Frame 0 as three planes, the standards' formulas in double.
static void to_yuv(int colour, uint8_t *y, uint8_t *u, uint8_t *v) {
    const size_t width = dive.camera.width, height = dive.camera.height, half = (width + 1) / 2;
    const double red = colours[colour].red, blue = colours[colour].blue;
    const double luma = colours[colour].full ? 1 : 219.0 / 255, black = colours[colour].full ? 0 : 16;
    const double chroma = colours[colour].full ? 1 : 224.0 / 255;
    double *sums = calloc(3 * half * ((height + 1) / 2), sizeof *sums);
    for (size_t i = 0; i < width * height; i++) {
        const uint8_t *p = dive.pixels[0] + 3 * i;
        const double grey = red * p[0] + (1 - red - blue) * p[1] + blue * p[2];
        y[i] = rounded(black + luma * grey);
        double *sum = sums + 3 * (i / width / 2 * half + i % width / 2);
        sum[0] += 0.5 * (p[2] - grey) / (1 - blue);
        sum[1] += 0.5 * (p[0] - grey) / (1 - red);
        sum[2] += 1;
    }
    for (size_t i = 0; i < half * ((height + 1) / 2); i++) {
        u[i] = rounded(128 + chroma * sums[3 * i] / sums[3 * i + 2]);
        v[i] = rounded(128 + chroma * sums[3 * i + 1] / sums[3 * i + 2]);
    }
    free(sums);
}

static void planes_of_yuv(void) {
    const uint32_t width = dive.camera.width, height = dive.camera.height;
    const size_t half = (width + 1) / 2, pairs = half * ((height + 1) / 2);
    uint8_t *y = malloc((size_t)width * height), *u = malloc(pairs), *v = malloc(pairs),
            *uv = malloc(2 * pairs), *from_rgb = malloc(dive.size), *shown = malloc(dive.size);
    uint8_t first[8192], second[8192];
    nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
    options.rate = NVSP_RATE_QUALITY;
    options.rate_value = 95;
    const nvsp_image rgb = scene_image(&dive, 0);
    encode(&rgb, &options, first, sizeof first, from_rgb);
    double closest[4][4];
    const uint32_t count = few() ? 1 : 4;
    for (uint32_t colour = 0; colour < count; colour++) {
        to_yuv((int)colour, y, u, v);
        for (size_t i = 0; i < pairs; i++) {
            uv[2 * i] = u[i];
            uv[2 * i + 1] = v[i];
        }
        for (uint32_t said = 0; said < count; said++) {
            const nvsp_image i420 = {NVSP_HEAD(nvsp_image), .format = NVSP_FORMAT_I420,
                                     .colour = said,
                                     .width = width,
                                     .height = height,
                                     .planes = {y, u, v},
                                     .strides = {width, half, half},
                                     .sizes = {(size_t)width * height, pairs, pairs}};
            const size_t size = encode(&i420, &options, first, sizeof first, shown);
            closest[colour][said] = psnr(shown, from_rgb, dive.size);
            nvsp_image nv12 = i420;
            nv12.format = NVSP_FORMAT_NV12;
            nv12.planes[1] = uv;
            nv12.planes[2] = NULL;
            nv12.strides[1] = 2 * half;
            nv12.sizes[1] = 2 * pairs;
            CHECK(encode(&nv12, &options, second, sizeof second, NULL) == size);
            CHECK(memcmp(first, second, size) == 0);
        }
    }
    for (uint32_t colour = 0; colour < count; colour++) {
        CHECK(closest[colour][colour] > 30);
        for (uint32_t said = 0; said < count; said++) {  // With another colour code the picture differs.
            CHECK(said == colour || closest[colour][said] < closest[colour][colour] - 0.5);
        }
    }
    free(y);
    free(u);
    free(v);
    free(uv);
    free(from_rgb);
    free(shown);
}

// Each is refused by nvsp_encode and by nvsp_encode_begin, and nothing is written.
static void refuse(nvsp_status status, nvsp_image image) {
    uint8_t bytes[4096];
    size_t written = 77;
    memset(bytes, 0xa5, sizeof bytes);
    EXPECT(status, nvsp_encode(both.encoder, &image, with_hint(&dive.poses[0]), bytes, sizeof bytes, &written,
                               NULL));
    EXPECT(status, nvsp_encode_begin(both.encoder, &image, with_hint(&dive.poses[0])));
    EXPECT(NVSP_ERR_STATE, nvsp_wait(both.encoder, 0));
    CHECK(written == 77 && all_are(bytes, 0xa5, sizeof bytes));
}

static void invalid_planes(void) {
    const nvsp_image valid = scene_image(&dive, 0);
    nvsp_image image = valid;
    image.planes[0] = NULL;
    refuse(NVSP_ERR_ARGUMENT, image);
    const size_t strides[] = {0, 1, valid.strides[0] - 1, SIZE_MAX, SIZE_MAX / 2, SIZE_MAX / 54};
    for (size_t i = 0; i < sizeof strides / sizeof *strides; i++) {
        image = valid;
        image.strides[0] = strides[i];
        refuse(NVSP_ERR_IMAGE, image);
    }
    const size_t sizes[] = {0, 1, valid.sizes[0] - 1};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        image = valid;
        image.sizes[0] = sizes[i];
        refuse(NVSP_ERR_IMAGE, image);
    }
    image = valid;
    image.sizes[0] = SIZE_MAX;
    refuse(NVSP_ERR_ARGUMENT, image);
    image = valid;
    image.format = NVSP_FORMAT_NV12;  // Its second plane is missing.
    refuse(NVSP_ERR_ARGUMENT, image);
    image.planes[1] = valid.planes[0];
    refuse(NVSP_ERR_IMAGE, image);
    image.format = NVSP_FORMAT_I420;
    refuse(NVSP_ERR_ARGUMENT, image);
}

static void invalid_sizes_and_codes(void) {
    const nvsp_image valid = scene_image(&dive, 0);
    const uint32_t sizes[][2] = {{0, 0},          {0, 54},        {96, 0},           {65536, 54},
                                 {65536, 36864},  {96, 65536},    {UINT32_MAX, 54},  {96, UINT32_MAX},
                                 {16385, 9216},   {96, 96},       {1, 16384},        {16384, 9216},
                                 {96, 52},        {UINT32_MAX, UINT32_MAX}};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        nvsp_image image = valid;
        image.width = sizes[i][0];
        image.height = sizes[i][1];
        refuse(NVSP_ERR_IMAGE, image);
    }
    const uint32_t formats[] = {0, 6, 99, UINT32_MAX};
    for (size_t i = 0; i < sizeof formats / sizeof *formats; i++) {
        nvsp_image image = valid;
        image.format = formats[i];
        refuse(NVSP_ERR_ARGUMENT, image);
        image = valid;
        image.format = NVSP_FORMAT_NV12;
        image.colour = formats[i] == 0 ? 4 : formats[i];
        refuse(NVSP_ERR_ARGUMENT, image);
    }
}

int main(int argc, char **argv) {
    set_up(argc, argv);
    rig_add(&both, &dive.camera, NULL);

    channels_and_strides();
    scaled();
    planes_of_yuv();
    invalid_planes();
    invalid_sizes_and_codes();
    // What was refused was not seen: the next frame is the first.
    uint8_t plain[4096], late[4096];
    const nvsp_image image = scene_image(&dive, 0);
    const size_t size = encode(&image, NULL, plain, sizeof plain, NULL);
    size_t found = 0;
    EXPECT(NVSP_OK, nvsp_encode(both.encoder, &image, with_hint(&dive.poses[0]), late, sizeof late, &found, NULL));
    CHECK(found == size && memcmp(plain, late, size) == 0);

    return tear_down();
}
