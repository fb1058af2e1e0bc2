// Lenses and masks: what they do to packets, and what is refused.

#include "common.h"

// Encodes frame 0 from its pose as an encoder's next one; the packet's size.
static size_t encode(nvsp_encoder *encoder, const nvsp_image *image, uint8_t *bytes, nvsp_frame_stats *stats) {
    size_t size = 0;
    MUST(nvsp_encode(encoder, image, with_hint(&dive.poses[0]), bytes, 8192, &size, stats));
    return size;
}

// The lens that is no lens: the scene's camera.
static nvsp_lens straight(void) {
    nvsp_lens lens = NVSP_INITIALIZER(nvsp_lens);
    lens.model = NVSP_LENS_BROWN_CONRADY;
    lens.count = 4;
    lens.width = dive.camera.width;
    lens.height = dive.camera.height;
    lens.fx = (double)dive.camera.fx;
    lens.fy = (double)dive.camera.fy;
    lens.cx = (double)dive.camera.cx;
    lens.cy = (double)dive.camera.cy;
    return lens;
}

static nvsp_mask mask_of(const uint8_t *pixels) {
    nvsp_mask mask = NVSP_INITIALIZER(nvsp_mask);
    mask.width = dive.camera.width;
    mask.height = dive.camera.height;
    mask.pixels = pixels;
    mask.stride = mask.width;
    mask.size = (size_t)mask.width * mask.height;
    return mask;
}

// A lens without distortion changes no byte; one with distortion does, and set away it leaves nothing.
static void lenses_in_use(void) {
    uint8_t plain[8192], other[8192];
    const nvsp_image image = scene_image(&dive, 0);
    nvsp_encoder *encoder = new_encoder(NULL);
    nvsp_frame_stats valid = NVSP_INITIALIZER(nvsp_frame_stats);
    const size_t size = encode(encoder, &image, plain, &valid);
    nvsp_destroy(encoder);
    nvsp_lens lens = straight();
    encoder = new_encoder(NULL);
    EXPECT(NVSP_OK, nvsp_encoder_set_lens(encoder, &lens));
    CHECK(encode(encoder, &image, other, NULL) == size && memcmp(plain, other, size) == 0);
    nvsp_destroy(encoder);

    encoder = new_encoder(NULL);
    lens.coefficients[0] = -0.25;
    lens.coefficients[1] = 0.06;
    EXPECT(NVSP_OK, nvsp_encoder_set_lens(encoder, &lens));
    nvsp_frame_stats bent = NVSP_INITIALIZER(nvsp_frame_stats);
    encode(encoder, &image, other, &bent);
    CHECK(bent.render_psnr < valid.render_psnr - 1);
    MUST(nvsp_encoder_reset(encoder));
    EXPECT(NVSP_OK, nvsp_encoder_set_lens(encoder, NULL));
    nvsp_frame_stats again = NVSP_INITIALIZER(nvsp_frame_stats);
    encode(encoder, &image, other, &again);
    CHECK(again.render_psnr > valid.render_psnr - 0.1 && again.render_psnr < valid.render_psnr + 0.1);
    // Every format and stride goes the same way.
    nvsp_lens fisheye = straight();
    fisheye.model = NVSP_LENS_FISHEYE;
    EXPECT(NVSP_OK, nvsp_encoder_set_lens(encoder, &fisheye));
    MUST(nvsp_encoder_reset(encoder));
    const size_t fish = encode(encoder, &image, plain, NULL);
    CHECK(fish > 0);
    nvsp_destroy(encoder);
}

static void refused_lenses(void) {
    nvsp_encoder *encoder = new_encoder(NULL);
    const nvsp_lens valid = straight();
    nvsp_lens lens = valid;
#define REFUSED(field, value, text)                                          \
    lens = valid;                                                            \
    lens.field = value;                                                      \
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_lens(encoder, &lens));        \
    CHECK(says(encoder, text))
    REFUSED(model, 0, "nvsp_lens.model");
    REFUSED(model, 3, "nvsp_lens.model");
    REFUSED(count, 6, "nvsp_lens.count");
    REFUSED(count, 0, "nvsp_lens.count");
    REFUSED(model = NVSP_LENS_FISHEYE; lens.count, 5, "nvsp_lens.count");
    REFUSED(coefficients[4], 0.1, "nvsp_lens.coefficients");
    REFUSED(coefficients[2], strtod("nan", NULL), "distortion coefficient");
    REFUSED(coefficients[2], strtod("inf", NULL), "distortion coefficient");
    REFUSED(width, 0, "nvsp_lens.width");
    REFUSED(height, 16385, "nvsp_lens.width");
    REFUSED(fx, 0, "lens fx");
    REFUSED(fy, -1, "lens fy");
    REFUSED(cx, strtod("nan", NULL), "lens cx");
    REFUSED(coefficients[0] = 0.1; lens.cy, -9, "principal point");
    REFUSED(coefficients[0], -2, "corner (0, 0) has no ray");
    REFUSED(cx, 1e5, "no pixel of the camera's picture");
#undef REFUSED
    lens = valid;
    lens.struct_size = 40;
    EXPECT(NVSP_ERR_STRUCTURE, nvsp_encoder_set_lens(encoder, &lens));
    lens = valid;
    lens.abi_version = 9;
    EXPECT(NVSP_ERR_STRUCTURE, nvsp_encoder_set_lens(encoder, &lens));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_lens(NULL, &valid));

    // Images have the lens's size then.
    uint8_t bytes[8192];
    size_t size = 0;
    nvsp_image image = scene_image(&dive, 0);
    lens = valid;
    lens.width *= 2;
    lens.height *= 2;
    lens.fx *= 2, lens.fy *= 2, lens.cx *= 2, lens.cy *= 2;
    EXPECT(NVSP_OK, nvsp_encoder_set_lens(encoder, &lens));
    EXPECT(NVSP_ERR_IMAGE, nvsp_encode(encoder, &image, with_hint(&dive.poses[0]), bytes, sizeof bytes, &size, NULL));
    CHECK(says(encoder, "the lens is for images of"));
    // A camera that sees nothing of it is refused, and the old one stays.
    nvsp_camera aside = dive.camera;
    aside.cx = 1e5f;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_camera(encoder, &aside));
    EXPECT(NVSP_OK, nvsp_encoder_set_lens(encoder, NULL));
    EXPECT(NVSP_OK, nvsp_encode(encoder, &image, with_hint(&dive.poses[0]), bytes, sizeof bytes, &size, NULL));
    nvsp_destroy(encoder);
}

// What the masked part shows changes no byte, and costs none.
static void masks_in_use(void) {
    const uint32_t width = dive.camera.width, height = dive.camera.height;
    uint8_t *pixels = malloc((size_t)width * height), *arm = malloc(dive.size);
    uint8_t plain[8192], masked[8192], naked[8192], other[8192];
    memcpy(arm, dive.pixels[0], dive.size);
    for (uint32_t i = 0; i < width * height; i++) {
        const uint32_t x = i % width, y = i / width;
        const int covered = x + y > width - 4;
        pixels[i] = covered ? 127 : 128;
        if (covered) {
            memset(arm + 3 * i, (x + 2 * y) % 9 < 4 ? 255 : 190, 3);
        }
    }
    const nvsp_image image = scene_image(&dive, 0);
    nvsp_image with_arm = image;
    with_arm.planes[0] = arm;
    nvsp_mask mask = mask_of(pixels);
    nvsp_encoder *encoder = new_encoder(NULL);
    nvsp_frame_stats stats = NVSP_INITIALIZER(nvsp_frame_stats);
    const size_t size = encode(encoder, &image, plain, NULL);
    nvsp_destroy(encoder);
    encoder = new_encoder(NULL);
    const size_t full = encode(encoder, &with_arm, naked, NULL);
    CHECK(full > size);
    nvsp_destroy(encoder);
    encoder = new_encoder(NULL);
    EXPECT(NVSP_OK, nvsp_encoder_set_mask(encoder, &mask));
    const size_t less = encode(encoder, &with_arm, masked, &stats);
    // The poses found differ in their last digits, so a byte or two are chance.
    CHECK(less <= size + 2 && (stats.flags & NVSP_FRAME_UNCERTAIN) == 0 && stats.psnr > 30);
    nvsp_decoded decoded = NVSP_INITIALIZER(nvsp_decoded);
    EXPECT(NVSP_OK, nvsp_decode(both.decoder, masked, less, 0, NULL, &decoded));
    nvsp_destroy(encoder);
    encoder = new_encoder(NULL);
    EXPECT(NVSP_OK, nvsp_encoder_set_mask(encoder, &mask));
    CHECK(encode(encoder, &image, other, NULL) == less && memcmp(masked, other, less) == 0);
    // With a lens the mask is about the lens's images. The straight one leaves it as it is.
    nvsp_destroy(encoder);
    encoder = new_encoder(NULL);
    const nvsp_lens lens = straight();
    EXPECT(NVSP_OK, nvsp_encoder_set_lens(encoder, &lens));
    EXPECT(NVSP_OK, nvsp_encoder_set_mask(encoder, &mask));
    CHECK(encode(encoder, &with_arm, other, NULL) == less && memcmp(masked, other, less) == 0);
    // It stays through another camera and another device, and can be taken off.
    const nvsp_camera half = scaled_camera(&dive, width / 2);
    EXPECT(NVSP_OK, nvsp_encoder_set_camera(encoder, &half));
    encode(encoder, &with_arm, other, &stats);
    CHECK(stats.psnr > 28);
    EXPECT(NVSP_OK, nvsp_encoder_set_camera(encoder, &dive.camera));
    EXPECT(NVSP_OK, nvsp_encoder_reopen(encoder, both.engine, both.prior));
    encode(encoder, &with_arm, other, &stats);
    CHECK(stats.psnr > 30);
    EXPECT(NVSP_OK, nvsp_encoder_set_mask(encoder, NULL));
    nvsp_frame_stats without = NVSP_INITIALIZER(nvsp_frame_stats);
    encode(encoder, &with_arm, other, &without);
    CHECK(without.render_psnr < stats.render_psnr - 6);
    nvsp_destroy(encoder);
    free(pixels);
    free(arm);
}

// A region of interest gets more of the bytes.
static void interest(void) {
    const nvsp_image image = scene_image(&dive, 0);
    uint8_t packets[3][4096];
    size_t sizes[3];
    const uint8_t weights[6] = {1, 1, 200, 1, 1, 1}, even[1] = {9};
    nvsp_encoder *encoder = NULL;
    for (int i = 0; i < 3; i++) {
        encoder = new_encoder(NULL);
        if (i == 1) {
            EXPECT(NVSP_OK, nvsp_encoder_set_interest(encoder, 3, 2, weights, sizeof weights));
        } else if (i == 2) {
            EXPECT(NVSP_OK, nvsp_encoder_set_interest(encoder, 3, 2, weights, sizeof weights));
            EXPECT(NVSP_OK, nvsp_encoder_set_interest(encoder, 1, 1, even, sizeof even));
        }
        EXPECT(NVSP_OK, nvsp_encoder_set_rate(encoder, NVSP_RATE_BYTES, 250));
        sizes[i] = encode(encoder, &image, packets[i], NULL);
        if (i < 2) {
            nvsp_destroy(encoder);
        }
    }
    CHECK(sizes[0] <= 250 && sizes[1] <= 250);
    CHECK(sizes[0] != sizes[1] || memcmp(packets[0], packets[1], sizes[0]) != 0);
    CHECK(sizes[0] == sizes[2] && memcmp(packets[0], packets[2], sizes[0]) == 0);

    const uint8_t none[6] = {1, 1, 0, 1, 1, 1};
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_interest(encoder, 3, 2, none, 6));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_interest(encoder, 3, 2, weights, 5));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_interest(encoder, 0, 0, weights, 0));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_interest(encoder, 5000, 1, weights, 6));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_interest(encoder, UINT32_MAX, UINT32_MAX, weights, 6));
    CHECK(says(encoder, "none of them 0"));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_interest(encoder, 3, 2, NULL, 6));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_interest(NULL, 3, 2, weights, 6));
    EXPECT(NVSP_OK, nvsp_encoder_set_interest(encoder, 0, 0, NULL, 0));
    nvsp_destroy(encoder);
}

static void refused_masks(void) {
    const size_t count = (size_t)dive.camera.width * dive.camera.height;
    uint8_t *pixels = calloc(count, 1);
    nvsp_encoder *encoder = new_encoder(NULL);
    nvsp_mask mask = mask_of(pixels);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_mask(encoder, &mask));
    CHECK(says(encoder, "no pixel counts"));
    pixels[count / 2] = 255;
    EXPECT(NVSP_OK, nvsp_encoder_set_mask(encoder, &mask));
    mask.size--;
    EXPECT(NVSP_ERR_IMAGE, nvsp_encoder_set_mask(encoder, &mask));
    mask = mask_of(pixels);
    mask.stride--;
    EXPECT(NVSP_ERR_IMAGE, nvsp_encoder_set_mask(encoder, &mask));
    mask = mask_of(NULL);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_mask(encoder, &mask));
    mask = mask_of(pixels);
    mask.height /= 2;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_mask(encoder, &mask));
    CHECK(says(encoder, "nvsp_mask.width, height: not of the camera's shape"));
    const uint32_t sides[][2] = {{0, 54}, {96, 0}, {16385, 54}, {UINT32_MAX, UINT32_MAX}};
    for (size_t i = 0; i < 4; i++) {
        mask = mask_of(pixels);
        mask.width = sides[i][0];
        mask.height = sides[i][1];
        EXPECT(NVSP_ERR_IMAGE, nvsp_encoder_set_mask(encoder, &mask));
    }
    mask = mask_of(pixels);
    mask.struct_size = 8;
    EXPECT(NVSP_ERR_STRUCTURE, nvsp_encoder_set_mask(encoder, &mask));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_mask(NULL, &mask));
    // A lens of another size than the mask's.
    nvsp_lens lens = straight();
    lens.width *= 2;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_lens(encoder, &lens));
    CHECK(says(encoder, "nvsp_mask.width, height: not those of the lens"));
    EXPECT(NVSP_OK, nvsp_encoder_set_mask(encoder, NULL));
    nvsp_destroy(encoder);
    free(pixels);
}

int main(int argc, char **argv) {
    set_up(argc, argv);
    rig_add(&both, &dive.camera, NULL);
    lenses_in_use();
    refused_lenses();
    masks_in_use();
    interest();
    refused_masks();
    return tear_down();
}
