// Garbage: random bytes, damaged packets, and damaged packets whose checks are made right. Every
// call must give a result or an error, and must stay within its memory, which a memory checker
// tests.

#include "common.h"

static nvsp_collector *collector;
static nvsp_sender *sender, *unprotected;
static uint64_t seed = 7;
static long shown, refused;
static double now;

// As large as `size`, so that a memory checker sees what is read beyond it.
static uint8_t *copy_of(const uint8_t *bytes, size_t size) {
    uint8_t *copy = malloc(size > 0 ? size : 1);
    memcpy(copy, bytes, size);
    return copy;
}

// Gives the bytes to everything that takes bytes of a link.
static void offer(const uint8_t *bytes, size_t size) {
    uint8_t *copy = copy_of(bytes, size), frame[256];
    size_t written = 0;
    nvsp_header header;
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
    const nvsp_status taken = nvsp_collector_push(collector, now, copy, size, NULL);
    CHECK(taken == NVSP_OK || taken == NVSP_ERR_MODEM || (taken == NVSP_ERR_NEWER && read == taken));
    uint32_t budget = 0;
    now += 10;
    EXPECT(NVSP_OK, nvsp_sender_plan(sender, now, &budget));
    nvsp_sender *const senders[] = {sender, unprotected};
    for (int i = 0; i < 2; i++) {
        const nvsp_status sent = nvsp_sender_push(senders[i], now, copy, size, NULL, 0, NULL);
        CHECK(sent == NVSP_OK || sent == NVSP_ERR_MODEM || (sent == NVSP_ERR_NEWER && read == sent));
        while (nvsp_sender_next(senders[i], now, frame, sizeof frame, &written) == NVSP_OK) {
            CHECK(sent == NVSP_OK && written <= 64);
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
        const uint8_t firsts[] = {0xb1, 0xb4, 0x40};  // As packets and shares begin.
        bytes[0] = firsts[random_below(&seed, 3)];
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

// A packet of a later version: its check tells it from garbage.
static void newer_packets(void) {
    const size_t latents[] = {31, 19};
    for (int i = 0; i < 2; i++) {
        uint8_t bytes[64], frame[64];
        size_t written = 77;
        nvsp_header header = NVSP_INITIALIZER(nvsp_header);
        const size_t latent = latents[i];
        memcpy(bytes, packets[i].bytes, sizeof bytes);
        bytes[0] = 0xb9;
        EXPECT(NVSP_ERR_PACKET, nvsp_decode_header(bytes, sizeof bytes, NULL, &header));
        const uint16_t sum = crc16(0xffff, bytes, latent - 2);
        memcpy(bytes + latent - 2, &sum, 2);
        EXPECT(NVSP_ERR_NEWER, nvsp_decode_header(bytes, sizeof bytes, NULL, &header));
        CHECK(header.wire_version == 9 && header.frame == 0 && header.flags == 0);
        EXPECT(NVSP_ERR_NEWER, nvsp_decode(both.decoder, bytes, sizeof bytes, 0, NULL, NULL));
        EXPECT(NVSP_ERR_NEWER, nvsp_collector_push(collector, 0, bytes, sizeof bytes, NULL));
        EXPECT(NVSP_ERR_NEWER, nvsp_sender_push(unprotected, 0, bytes, sizeof bytes, NULL, 0, NULL));
        EXPECT(NVSP_PENDING, nvsp_sender_next(unprotected, 0, frame, sizeof frame, &written));
        CHECK(written == 77);
    }
}

// Appends a matching check to a damaged difference picture. Packet 1 has the short form.
static void sealed_residuals(void) {
    const packet one = packets[1];
    const size_t latent = 19, head = latent + 2;  // The length takes two bytes from 128 to 16383.
    uint8_t bytes[4096], payload[4096];
    size_t size = one.size - head - 2;
    memcpy(payload, one.bytes + head, size);
    size = damaged(payload, size, sizeof payload - 64);
    if (random_below(&seed, 4) == 0) {
        for (size_t i = 20 + random_below(&seed, 40); i < size; i++) {
            payload[i] = (uint8_t)random_bits(&seed);
        }
    }
    if (size < 128) {
        return;
    }
    memcpy(bytes, one.bytes, latent);
    bytes[latent] = (uint8_t)(size | 0x80);
    bytes[latent + 1] = (uint8_t)(size >> 7);
    memcpy(bytes + head, payload, size);
    // A CRC-16 of the latent part's CRC-32, and of length and payload.
    uint8_t covered[4 + 2 + sizeof payload];
    const uint32_t latent_crc = crc32(0, bytes, latent);
    for (int i = 0; i < 4; i++) {
        covered[i] = (uint8_t)(latent_crc >> 8 * i);
    }
    memcpy(covered + 4, bytes + latent, 2 + size);
    const uint16_t crc = crc16(0xffff, covered, 4 + 2 + size);
    bytes[head + size] = (uint8_t)crc;
    bytes[head + size + 1] = (uint8_t)(crc >> 8);
    offer(bytes, head + size + 2);
}

// A latent part with random content and a matching check. The prior's identity, or the session, stays.
static void sealed_latents(void) {
    uint8_t bytes[4096];
    const packet one = packets[random_below(&seed, (uint32_t)dive.frames)];
    memcpy(bytes, one.bytes, one.size);
    const int full = (bytes[0] & 15) < 4;
    const uint32_t covered = full ? 29 : 17;
    for (uint32_t turn = random_below(&seed, 6); turn > 0; turn--) {
        const uint32_t at = 1 + random_below(&seed, covered - 1);
        // Not the prior, nor the picture's size, which the camera's check covers.
        if (full ? at < 5 || at > 11 : at != 4) {
            bytes[at] = (uint8_t)random_bits(&seed);
        }
    }
    const uint16_t crc = crc16(0xffff, bytes, covered);
    bytes[covered] = (uint8_t)crc;
    bytes[covered + 1] = (uint8_t)(crc >> 8);
    offer(bytes, one.size);
}

// Cameras of any intrinsics and size, with matching checks. The decoder must render with them or refuse them.
static void sealed_cameras(void) {
    uint8_t bytes[49];
    memcpy(bytes, packets[0].bytes, sizeof bytes);
    const uint32_t width = random_below(&seed, 300), height = random_below(&seed, 300);
    bytes[9] = (uint8_t)width;
    bytes[10] = (uint8_t)(width >> 8 | height << 4);
    bytes[11] = (uint8_t)(height >> 4);
    for (int i = 0; i < 4; i++) {
        const float numbers[] = {0, -1, 1e-30f, 1e30f, 50, (float)width, strtof("nan", NULL),
                                 strtof("inf", NULL)};
        memcpy(bytes + 31 + 4 * i, &numbers[random_below(&seed, 8)], 4);
    }
    uint8_t covered[19];
    memcpy(covered, bytes + 9, 3);
    memcpy(covered + 3, bytes + 31, 16);
    const uint16_t camera = crc16(0xffff, covered, sizeof covered);
    bytes[47] = (uint8_t)camera;
    bytes[48] = (uint8_t)(camera >> 8);
    bytes[28] = (uint8_t)camera;
    const uint16_t crc = crc16(0xffff, bytes, 29);
    bytes[29] = (uint8_t)crc;
    bytes[30] = (uint8_t)(crc >> 8);
    offer(bytes, sizeof bytes);
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
        const nvsp_status status = nvsp_prior_open_memory(both.engine, copy, left, NULL, &prior);
        CHECK(status == NVSP_OK || status == NVSP_ERR_PRIOR || status == NVSP_ERR_ARGUMENT);
        CHECK((status == NVSP_OK) == (prior != NULL));
        opened += prior != NULL;
        nvsp_prior_destroy(prior);
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
        EXPECT(NVSP_ERR_PRIOR,
               nvsp_prior_open_memory(both.engine, copy, strlen(text), NULL, &prior));
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
    MUST(nvsp_collector_create(64, NULL, &collector));
    nvsp_sender_options link = NVSP_INITIALIZER(nvsp_sender_options);
    link.bit_rate = 20000;
    link.frame_rate = 4;
    MUST(nvsp_sender_create(64, &link, &sender));
    link = (nvsp_sender_options)NVSP_INITIALIZER(nvsp_sender_options);
    link.flags = NVSP_SENDER_UNPROTECTED;
    MUST(nvsp_sender_create(64, &link, &unprotected));

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
    nvsp_collector_destroy(collector);
    nvsp_sender_destroy(sender);
    nvsp_sender_destroy(unprotected);
    printf("garbage: %ld shown, %ld refused\n", shown, refused);
    return tear_down();
}
