// Garbage: random bytes, damaged packets, and damaged packets whose checks are made right. Every
// call must give a result or an error, and must stay within its memory, which a memory checker
// tests.

#include "common.h"

#define MTU 64
#define MAX_HELD (1 << 17)

static nvsp_topside *topside;
static nvsp_vehicle *vehicle, *unprotected;
static uint64_t seed = 7;
static long shown, refused;
static double now;

// As large as `size`, so that a memory checker sees what is read beyond it.
static uint8_t *copy_of(const uint8_t *bytes, size_t size) {
    uint8_t *copy = malloc(size > 0 ? size : 1);
    memcpy(copy, bytes, size);
    return copy;
}

// A packet's first modem frame without protection. Returns its length.
static size_t start_of(const uint8_t *packet, size_t size, uint8_t *frame) {
    const size_t length = size + 1 < MTU ? size + 1 : MTU;
    frame[0] = 0x80 | (size + 1 <= MTU ? 0x20 : 0);
    frame[1] = packet[2];
    memcpy(frame + 2, packet, 2);
    memcpy(frame + 4, packet + 3, length - 4);
    return length;
}

// Gives the bytes to everything that takes bytes of a link.
static void offer(const uint8_t *bytes, size_t size) {
    uint8_t *copy = copy_of(bytes, size), frame[256];
    size_t written = 0;
    nvsp_decoded header;
    nvsp_decoded info;
    MUST(NVSP_INIT(&header));
    const nvsp_status read = nvsp_decode_header(copy, size, both.prior, &header);
    CHECK(read == NVSP_OK || read == NVSP_ERR_PACKET || read == NVSP_ERR_NEWER);
    for (uint32_t flags = 0; flags <= NVSP_DECODE_START; flags += NVSP_DECODE_START) {
        MUST(NVSP_INIT(&info));
        const nvsp_status status = nvsp_decode(both.decoder, copy, size, flags, NULL, &info);
        CHECK(status == NVSP_OK || status == NVSP_ERR_PACKET || status == NVSP_ERR_OTHER_PRIOR
              || status == NVSP_ERR_CAMERA_UNKNOWN || (status == NVSP_ERR_NEWER && read == status));
        CHECK(status != NVSP_OK || (read == NVSP_OK && info.rows <= info.height));
        shown += status == NVSP_OK;
        refused += status != NVSP_OK;
    }
    uint8_t *start = size < 3 ? NULL : malloc(size + 1);
    for (int i = 0; i < (start == NULL ? 1 : 2); i++) {
        // As a modem frame, and as the packet of one.
        const size_t length = i == 0 ? size : start_of(copy, size, start);
        const nvsp_status taken = nvsp_topside_receive(topside, now, i == 0 ? copy : start, length);
        CHECK(taken == NVSP_OK || taken == NVSP_ERR_PACKET || (taken == NVSP_ERR_NEWER && read == taken));
    }
    free(start);
    uint32_t budget = 0;
    now += 10;
    // What is no report is refused, and what comes of packets is their start.
    const nvsp_status report = nvsp_vehicle_receive(vehicle, now, copy, size);
    CHECK(report == NVSP_OK || report == NVSP_ERR_PACKET);
    uint8_t *held = malloc(MAX_HELD);
    while (nvsp_topside_packet(topside, now, held, MAX_HELD, &written, NULL) == NVSP_OK) {
        CHECK(written > 0);
    }
    free(held);
    EXPECT(NVSP_OK, nvsp_vehicle_plan(vehicle, now, now, NULL, &budget));
    nvsp_vehicle *const vehicles[] = {vehicle, unprotected};
    for (int i = 0; i < 2; i++) {
        const nvsp_status sent = nvsp_vehicle_packet(vehicles[i], now, copy, size, NULL, 0);
        CHECK(sent == NVSP_OK || sent == NVSP_ERR_PACKET || (sent == NVSP_ERR_NEWER && read == sent));
        while (nvsp_vehicle_transmit(vehicles[i], now, sizeof frame, frame, &written, NULL) == NVSP_OK) {
            CHECK(sent == NVSP_OK && written <= MTU);
        }
    }
    free(copy);
}

static void random_bytes(void) {
    uint8_t bytes[600];
    const size_t size = random_below(&seed, sizeof bytes);
    for (size_t i = 0; i < size; i++) {
        bytes[i] = (uint8_t)random_bits(&seed);
    }
    if (size > 0 && random_below(&seed, 2)) {
        const uint8_t firsts[] = {0x60, 0x67, 0x79, 0x80, 0xa0, 0x40};  // As packets and shares begin.
        bytes[0] = firsts[random_below(&seed, 6)];
    }
    offer(bytes, size);
}

// A packet with some bytes turned over, cut out, doubled, or with its end lost.
static size_t damaged(uint8_t *bytes, size_t size, size_t room) {
    for (uint32_t turn = random_below(&seed, 4) + 1; turn > 0 && size > 1; turn--) {
        const size_t at = random_below(&seed, (uint32_t)size);
        switch (random_below(&seed, 4)) {
        case 0:
            bytes[at] ^= (uint8_t)(1u << random_below(&seed, 8));
            break;
        case 1:
            bytes[at] = (uint8_t)random_bits(&seed);
            break;
        case 2:
            memmove(bytes + at, bytes + at + 1, size - at - 1);
            size--;
            break;
        default:
            if (random_below(&seed, 8) == 0) {
                size = at;
            } else if (size < room) {
                memmove(bytes + at + 1, bytes + at, size - at);
                size++;
            }
        }
    }
    return size;
}

static void damaged_packets(void) {
    uint8_t bytes[4096];
    const packet one = packets[random_below(&seed, (uint32_t)dive.frames)];
    memcpy(bytes, one.bytes, one.size);
    offer(bytes, damaged(bytes, one.size, sizeof bytes));
}

// A packet of a later version: another kind of pose. Its check tells it from garbage.
static void newer_packets(void) {
    const size_t latent = 18;
    uint8_t bytes[64], frame[64];
    size_t written = 77;
    nvsp_decoded header = NVSP_INITIALIZER(nvsp_decoded);
    memcpy(bytes, packets[0].bytes, sizeof bytes);
    bytes[0] = 0x1e;
    EXPECT(NVSP_ERR_PACKET, nvsp_decode_header(bytes, sizeof bytes, NULL, &header));
    seal_latent(bytes, latent);
    EXPECT(NVSP_ERR_NEWER, nvsp_decode_header(bytes, sizeof bytes, NULL, &header));
    CHECK(header.latent_bytes == 0 && header.frame == 0 && header.flags == 0);
    EXPECT(NVSP_ERR_NEWER, nvsp_decode(both.decoder, bytes, sizeof bytes, 0, NULL, NULL));
    const size_t length = start_of(bytes, sizeof bytes, frame);
    EXPECT(NVSP_ERR_NEWER, nvsp_topside_receive(topside, 0, frame, length));
    EXPECT(NVSP_ERR_NEWER, nvsp_vehicle_packet(unprotected, 0, bytes, sizeof bytes, NULL, 0));
    EXPECT(NVSP_PENDING, nvsp_vehicle_transmit(unprotected, 0, sizeof frame, frame, &written, NULL));
    CHECK(written == 77);
}

// A damaged difference picture, with its truth map, behind a matching check. Packet 1 has nothing else behind its
// latent part.
static void sealed_residuals(void) {
    const packet one = packets[1];
    const size_t head = LATENT + 2;
    uint8_t bytes[4096 + LATENT + 2], payload[4096];
    size_t size = one.size - head;
    memcpy(payload, one.bytes + head, size);
    size = damaged(payload, size, sizeof payload - 64);
    if (random_below(&seed, 4) == 0) {
        for (size_t i = 20 + random_below(&seed, 40); i < size; i++) {
            payload[i] = (uint8_t)random_bits(&seed);
        }
    }
    while (size > 0 && payload[size - 1] == 0) {
        size--;  // Zeros at the end are padding.
    }
    memcpy(bytes, one.bytes, LATENT);
    memcpy(bytes + head, payload, size);
    seal_residual(bytes, LATENT, head + size);
    offer(bytes, head + size);
}

// A latent part with random content and a matching check. The session stays.
static void sealed_latents(void) {
    uint8_t bytes[4096];
    const packet one = packets[random_below(&seed, (uint32_t)dive.frames)];
    memcpy(bytes, one.bytes, one.size);
    const size_t latent = (bytes[0] & 0x1f) == 0 ? LATENT : SESSION_LATENT;
    for (uint32_t turn = random_below(&seed, 6); turn > 0; turn--) {
        const uint32_t at = 1 + random_below(&seed, (uint32_t)latent - 3);
        if (at != 4 && at != 5) {  // Not the tag.
            bytes[at] = (uint8_t)random_bits(&seed);
        }
    }
    seal_latent(bytes, latent);
    offer(bytes, one.size);
}

// Cameras of any intrinsics and size, with matching checks. The decoder must render with them or refuse them.
static void sealed_cameras(void) {
    uint8_t bytes[SESSION_LATENT + SESSION];
    memcpy(bytes, packets[0].bytes, sizeof bytes);
    uint8_t *camera = bytes + SESSION_LATENT + 4;
    const uint32_t width = random_below(&seed, 300), height = random_below(&seed, 300);
    camera[0] = (uint8_t)width;
    camera[1] = (uint8_t)(width >> 8 | height << 4);
    camera[2] = (uint8_t)(height >> 4);
    for (int i = 0; i < 4; i++) {
        const float numbers[] = {0, -1, 1e-30f, 1e30f, 50, (float)width, strtof("nan", NULL),
                                 strtof("inf", NULL)};
        memcpy(camera + 3 + 4 * i, &numbers[random_below(&seed, 8)], 4);
    }
    seal_session(bytes);
    offer(bytes, sizeof bytes);
}

// Opens a prior from a file's content.
static nvsp_status open_content(const uint8_t *bytes, size_t size, nvsp_prior **prior) {
    nvsp_prior_options options = NVSP_INITIALIZER(nvsp_prior_options);
    options.content = bytes;
    options.content_size = size;
    return nvsp_prior_open(both.engine, NULL, &options, prior);
}

// Priors that are damaged in their header or in their splats.
static void damaged_priors(int rounds) {
    size_t size = 0;
    uint8_t *valid = read_all(dive.prior, &size), *bytes = malloc(size + 8);
    const uint8_t *end = (const uint8_t *)strstr((const char *)valid, "end_header\n");
    const size_t header = end == NULL ? 400 : (size_t)(end - valid) + 11;
    long opened = 0;
    for (int i = 0; i < rounds; i++) {
        memcpy(bytes, valid, size);
        size_t left = size;
        if (i % 3 == 0) {  // The header, and its length.
            const size_t longer = damaged(bytes, header, header + 4);
            memcpy(bytes + longer, valid + header, size - header);
            left = longer + size - header;
        } else if (i % 3 == 1) {
            for (uint32_t turn = random_below(&seed, 300); turn > 0; turn--) {
                bytes[header + random_below(&seed, (uint32_t)(size - header))] ^=
                    (uint8_t)(1u << random_below(&seed, 8));
            }
        } else {
            left = random_below(&seed, (uint32_t)size);
        }
        uint8_t *copy = copy_of(bytes, left);
        nvsp_prior *prior = NULL;
        const nvsp_status status = open_content(copy, left, &prior);
        CHECK(status == NVSP_OK || status == NVSP_ERR_PRIOR || status == NVSP_ERR_ARGUMENT);
        CHECK((status == NVSP_OK) == (prior != NULL));
        opened += prior != NULL;
        nvsp_destroy(prior);
        free(copy);
    }
    CHECK(opened > 0 && opened < rounds);
    free(bytes);
    free(valid);
}

// Files that promise more splats than anyone has.
static void absurd_priors(void) {
    const char *const counts[] = {"0", "4294967295", "4294967296", "18446744073709551615",
                                  "99999999999999999999999", "-1", "1e9", "0x10", ""};
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++) {
        char text[512];
        snprintf(text, sizeof text,
                 "ply\nformat binary_little_endian 1.0\nelement vertex %s\nproperty float x\n"
                 "property float y\nproperty float z\nend_header\n0123456789ab",
                 counts[i]);
        uint8_t *copy = copy_of((const uint8_t *)text, strlen(text));
        nvsp_prior *prior = NULL;
        EXPECT(NVSP_ERR_PRIOR, open_content(copy, strlen(text), &prior));
        free(copy);
    }
}

int main(int argc, char **argv) {
    const int rounds = few() ? 15 : 400;
    set_up(argc, argv);
    nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
    options.rate = NVSP_RATE_BYTES;
    options.rate_value = 900;
    rig_add(&both, &dive.camera, &options);
    encode_all(&both, &dive, packets);
    MUST(nvsp_decoder_add_camera(both.decoder, &dive.camera));
    const nvsp_topside_options receives = topside_options(MTU);
    topside = new_topside(&receives);
    nvsp_vehicle_options link = vehicle_options(MTU, 20000, 4);
    link.spread = NVSP_NONE;
    vehicle = new_vehicle(&link);
    link = vehicle_options(MTU, 0, 0);
    link.flags = NVSP_LINK_UNPROTECTED | NVSP_LINK_AS_THEY_COME;
    unprotected = new_vehicle(&link);

    newer_packets();
    for (int i = 0; i < rounds; i++) {
        random_bytes();
        damaged_packets();
        sealed_residuals();
        sealed_latents();
        if (i % 20 == 0) {
            sealed_cameras();
        }
    }
    CHECK(shown > rounds && refused > rounds);
    damaged_priors(rounds / 4 + 6);
    absurd_priors();
    // And still it works.
    EXPECT(NVSP_OK, nvsp_decode(both.decoder, packets[0].bytes, packets[0].size, 0, NULL, NULL));
    const nvsp_image image = scene_image(&dive, 0);
    uint8_t bytes[4096];
    size_t size = 0;
    EXPECT(NVSP_OK, nvsp_encode(both.encoder, &image, NULL, bytes, sizeof bytes, &size, NULL));
    nvsp_destroy(topside);
    nvsp_destroy(vehicle);
    nvsp_destroy(unprotected);
    printf("garbage: %ld shown, %ld refused\n", shown, refused);
    return tear_down();
}
