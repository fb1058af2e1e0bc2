// Packets without protection, through modems of several MTUs, which lose, swap, repeat, pad, cut and damage frames.

#include "common.h"

#include <math.h>
#include <nvsprior_extra.h>

#define MAX_MODEM_FRAMES 256
#define MAX_PACKET 4096

static uint64_t seed = 1;
static int damaged;

// A packet as its modem frames.
typedef struct split {
    uint32_t count;
    size_t sizes[MAX_MODEM_FRAMES];
    uint8_t *frames[MAX_MODEM_FRAMES];
} split;

// Bytes of a packet that the first shares hold. Its modem frames state the low byte of its frame number, or all of it
// travels in shares of one byte of header.
static size_t held_by(uint32_t mtu, uint32_t shares) {
    return mtu < 16 ? (size_t)shares * (mtu - 1) : 1 + (mtu - 2) + (size_t)(shares - 1) * (mtu - 4);
}

static split split_packet(const packet *packet, uint32_t mtu, int pad) {
    split done = {0};
    nvsp_vehicle_options options = vehicle_options(mtu, 0, 0);
    options.flags = NVSP_LINK_UNPROTECTED | NVSP_LINK_AS_THEY_COME;
    nvsp_vehicle *vehicle = new_vehicle(&options);
    MUST(nvsp_vehicle_packet(vehicle, 0, packet->bytes, packet->size, NULL, 0));
    size_t total = 0;
    double next = 77;
    for (uint32_t i = 0;; i++) {
        uint8_t *frame = malloc(mtu);
        memset(frame, 0xa5, mtu);
        const nvsp_status status = nvsp_vehicle_transmit(vehicle, 0, mtu, frame, &done.sizes[i], &next);
        if (status == NVSP_PENDING) {
            free(frame);
            break;
        }
        EXPECT(NVSP_OK, status);
        done.count++;
        CHECK(done.sizes[i] <= mtu && all_are(frame + done.sizes[i], 0xa5, mtu - done.sizes[i]));
        total += done.sizes[i];
        if (pad) {
            memset(frame + done.sizes[i], 0, mtu - done.sizes[i]);
            done.sizes[i] = mtu;
        }
        done.frames[i] = realloc(frame, done.sizes[i]);  // No larger: a memory checker sees more.
        if (done.count == MAX_MODEM_FRAMES) {
            give_up("a packet of too many modem frames");
        }
    }
    CHECK(total == packet->size + (mtu < 16 ? done.count : 1 + 4 * (done.count - 1)) && isinf(next));
    nvsp_destroy(vehicle);
    return done;
}

static void split_free(split *split) {
    for (uint32_t i = 0; i < split->count; i++) {
        free(split->frames[i]);
    }
}

static nvsp_topside *topside_with(uint32_t mtu, int checks) {
    nvsp_topside_options options = topside_options(mtu);
    options.flags = checks ? NVSP_LINK_MODEM_CHECKS : 0;
    options.max_shares = MAX_MODEM_FRAMES;
    options.packets = 4;
    return new_topside(&options);
}

static void push(nvsp_topside *topside, const uint8_t *frame, size_t size) {
    EXPECT(NVSP_OK, nvsp_topside_receive(topside, 0, frame, size));
}

static uint64_t duplicates_of(nvsp_topside *topside) {
    nvsp_topside_statistics counts = NVSP_INITIALIZER(nvsp_topside_statistics);
    EXPECT(NVSP_OK, nvsp_topside_get_statistics(topside, &counts));
    return counts.duplicates;
}

// What there is of the packet must be its start, and make a picture; what is known of it. Nothing new: all zero.
static nvsp_decoded fetch_and_show(nvsp_topside *topside, const packet *packet) {
    uint8_t bytes[MAX_PACKET];
    size_t size = 0;
    nvsp_decoded shown = NVSP_INITIALIZER(nvsp_decoded);
    nvsp_decoded info = NVSP_INITIALIZER(nvsp_decoded);
    if (nvsp_topside_packet(topside, 0, bytes, sizeof bytes, &size, &shown) != NVSP_OK) {
        return shown;
    }
    const int whole = (shown.flags & NVSP_DECODED_WHOLE) != 0;
    CHECK(size >= LATENT && size <= packet->size && shown.bytes == size && memcmp(bytes, packet->bytes, size) == 0);
    CHECK(whole == (size == packet->size));
    EXPECT(NVSP_OK, nvsp_decode(both.decoder, bytes, size, NVSP_DECODE_START, NULL, &info));
    // A flipped bit may have changed the number that a modem frame states. Small packets may have a pose alone.
    CHECK((damaged || info.frame == (uint32_t)shown.frame) && (info.rows == info.height || !whole || size < 128));
    return shown;
}

static int is_whole(const nvsp_decoded *shown) { return (shown->flags & NVSP_DECODED_WHOLE) != 0; }

// Frames in any order, some of them lost and some more than once: the packet's start up to the first lost one is there.
// Then the lost ones are sent again.
static void losses(const packet *packet, uint32_t mtu, int pad) {
    split frames = split_packet(packet, mtu, pad);
    nvsp_topside *topside = topside_with(mtu, 1);
    uint32_t order[MAX_MODEM_FRAMES], lost[MAX_MODEM_FRAMES] = {0};
    uint32_t first = frames.count, number = 0, repeated = 0;
    for (uint32_t i = 0; i < frames.count; i++) {
        const uint32_t j = random_below(&seed, i + 1);
        order[i] = order[j];
        order[j] = i;
        lost[i] = i > 0 && random_below(&seed, 4) == 0;
        number += lost[i];
        first = lost[i] && i < first ? i : first;
    }
    for (uint32_t i = 0; i < frames.count; i++) {
        const uint32_t at = order[i], before = order[random_below(&seed, i + 1)];
        if (!lost[at]) {
            push(topside, frames.frames[at], frames.sizes[at]);
        }
        if (!lost[before]) {
            push(topside, frames.frames[before], frames.sizes[before]);
            CHECK(duplicates_of(topside) == ++repeated);
        }
    }
    nvsp_decoded shown = fetch_and_show(topside, packet);
    if (held_by(mtu, first) < (packet == packets ? SESSION_LATENT : LATENT)) {
        CHECK(shown.bytes == 0);  // Not even a pose has come.
    } else {
        CHECK(shown.arrived == frames.count - number);
        CHECK(shown.sent == 0 || shown.sent == frames.count);
        CHECK(first == frames.count ? is_whole(&shown) : shown.bytes == held_by(mtu, first));
    }
    nvsp_topside_statistics counts = NVSP_INITIALIZER(nvsp_topside_statistics);
    EXPECT(NVSP_OK, nvsp_topside_get_statistics(topside, &counts));
    CHECK(counts.accepted + counts.waiting == frames.count - number && counts.rejected == 0);
    CHECK(counts.completed == (uint64_t)is_whole(&shown));
    for (uint32_t i = 0; i < frames.count; i++) {
        if (lost[i]) {
            push(topside, frames.frames[i], frames.sizes[i]);
        }
    }
    CHECK(duplicates_of(topside) == repeated);
    if (number > 0) {
        shown = fetch_and_show(topside, packet);
    }
    CHECK(is_whole(&shown) && shown.arrived == frames.count && shown.sent == frames.count);
    nvsp_destroy(topside);
    split_free(&frames);
}

// Frames that are cut short or have flipped bits are refused or change nothing. The whole frames then complete the
// packet.
static void damage(const packet *packet, uint32_t mtu) {
    split frames = split_packet(packet, mtu, 0);
    nvsp_topside *topside = topside_with(mtu, 0);
    nvsp_decoded shown = NVSP_INITIALIZER(nvsp_decoded), last = shown;
    damaged = 1;
    for (uint32_t i = 0; i < frames.count; i++) {
        for (int turn = 0; turn < 6; turn++) {
            uint8_t *copy = malloc(frames.sizes[i]);
            size_t left = frames.sizes[i];
            memcpy(copy, frames.frames[i], left);
            if (turn % 2) {
                left = random_below(&seed, (uint32_t)left);
            } else {
                copy[random_below(&seed, (uint32_t)left)] ^= (uint8_t)(1u << random_below(&seed, 8));
            }
            uint8_t *cut = malloc(left > 0 ? left : 1);
            memcpy(cut, copy, left);
            const nvsp_status status = nvsp_topside_receive(topside, 0, cut, left);
            CHECK(status == NVSP_OK || status == NVSP_ERR_PACKET);
            free(cut);
            free(copy);
        }
        push(topside, frames.frames[i], frames.sizes[i]);
        shown = fetch_and_show(topside, packet);
        last = shown.bytes > 0 ? shown : last;
    }
    damaged = 0;
    CHECK(is_whole(&last));
    nvsp_destroy(topside);
    split_free(&frames);
}

// Packets of at most eight small modem frames, swapped, padded and repeated, one of which is lost and comes later.
static void small_modems(void) {
    for (uint32_t mtu = 8; mtu < 16; mtu++) {
        nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
        options.rate = NVSP_RATE_BYTES;
        options.rate_value = 8 * ((float)mtu - 1);
        nvsp_encoder *encoder = new_encoder(&options);
        for (int i = 0; i < 4; i++) {
            uint8_t bytes[8 * 15];
            packet one = {bytes, 0};
            const nvsp_image image = scene_image(&dive, i);
            MUST(nvsp_encode(encoder, &image, with_hint(&dive.poses[i]), bytes, sizeof bytes, &one.size, NULL));
            split frames = split_packet(&one, mtu, i % 2);
            CHECK(frames.count <= 8 && one.size > held_by(mtu, frames.count - 1));
            nvsp_topside *topside = topside_with(mtu, 1);
            const uint32_t lost = 1 + random_below(&seed, frames.count - 1);
            for (uint32_t k = frames.count; k-- > 0;) {
                if (k != lost) {
                    push(topside, frames.frames[k], frames.sizes[k]);
                    push(topside, frames.frames[k], frames.sizes[k]);
                }
            }
            CHECK(duplicates_of(topside) == frames.count - 1);
            nvsp_decoded shown = fetch_and_show(topside, &one);
            CHECK((shown.bytes > 0) == (held_by(mtu, lost) >= (i == 0 ? SESSION_LATENT : LATENT)));
            CHECK(!is_whole(&shown) && (shown.bytes == 0 || shown.bytes == held_by(mtu, lost)));
            push(topside, frames.frames[lost], frames.sizes[lost]);
            shown = fetch_and_show(topside, &one);
            CHECK(is_whole(&shown));
            nvsp_destroy(topside);
            split_free(&frames);
        }
        nvsp_destroy(encoder);
    }
}

static void nothing_to_fetch(void) {
    nvsp_topside *topside = topside_with(64, 0);
    split frames = split_packet(&packets[0], 64, 0);
    uint8_t bytes[MAX_PACKET];
    size_t size = 77;
    memset(bytes, 0xa5, sizeof bytes);
    EXPECT(NVSP_PENDING, nvsp_topside_packet(topside, 0, bytes, sizeof bytes, &size, NULL));
    push(topside, frames.frames[1], frames.sizes[1]);
    EXPECT(NVSP_PENDING, nvsp_topside_packet(topside, 0, bytes, sizeof bytes, &size, NULL));
    EXPECT(NVSP_ERR_PACKET, nvsp_topside_receive(topside, 0, bytes, 0));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_receive(topside, 0, bytes, SIZE_MAX));
    push(topside, frames.frames[0], frames.sizes[0]);
    // Nothing is written but the size needed, and the packet stays.
    CHECK(size == 77);
    EXPECT(NVSP_ERR_BUFFER_TOO_SMALL, nvsp_topside_packet(topside, 0, bytes, 30, &size, NULL));
    CHECK(size > 30 && size <= 64 + 60 && all_are(bytes, 0xa5, sizeof bytes));
    EXPECT(NVSP_OK, nvsp_topside_packet(topside, 0, bytes, size, &size, NULL));
    CHECK(memcmp(bytes, packets[0].bytes, size) == 0);
    EXPECT(NVSP_PENDING, nvsp_topside_packet(topside, 0, bytes, size, &size, NULL));
    split_free(&frames);
    nvsp_destroy(topside);
}

// A vehicle with a bit rate gives each frame its bytes, and sends again what a report says is missing.
static void paced(void) {
    nvsp_vehicle_options options = vehicle_options(64, 60000, 5);
    options.latency = 3;
    options.flags = NVSP_LINK_UNPROTECTED;
    nvsp_vehicle *vehicle = new_vehicle(&options);
    nvsp_topside *topside = topside_with(64, 0);
    uint8_t bytes[64];
    size_t size = 0;
    uint32_t budget = 0, lost = 0;
    nvsp_decoded shown = NVSP_INITIALIZER(nvsp_decoded);
    EXPECT(NVSP_ERR_STATE, nvsp_vehicle_packet(vehicle, 0, packets[0].bytes, packets[0].size, NULL, 0));
    for (int i = 0; i < 3; i++) {
        EXPECT(NVSP_OK, nvsp_vehicle_plan(vehicle, i, i, NULL, &budget));
        CHECK(budget > 900);
        EXPECT(NVSP_OK, nvsp_vehicle_packet(vehicle, i, packets[i].bytes, packets[i].size, NULL, 0));
        for (uint32_t k = 0; nvsp_vehicle_transmit(vehicle, i, sizeof bytes, bytes, &size, NULL) == NVSP_OK; k++) {
            if (i == 1 && k % 3 == 1) {
                lost++;
            } else {
                push(topside, bytes, size);
            }
        }
        shown = fetch_and_show(topside, &packets[i]);
        CHECK(shown.frame == (uint32_t)i && is_whole(&shown) == (i != 1));
    }
    CHECK(lost > 1);
    EXPECT(NVSP_OK, nvsp_topside_report(topside, 0, bytes, sizeof bytes, &size, NULL));
    EXPECT(NVSP_OK, nvsp_vehicle_receive(vehicle, 2.1, bytes, size));
    uint32_t again = 0;
    while (nvsp_vehicle_transmit(vehicle, 2.1, sizeof bytes, bytes, &size, NULL) == NVSP_OK) {
        push(topside, bytes, size);
        again++;
    }
    nvsp_vehicle_statistics sent = NVSP_INITIALIZER(nvsp_vehicle_statistics);
    EXPECT(NVSP_OK, nvsp_vehicle_get_statistics(vehicle, &sent));
    shown = fetch_and_show(topside, &packets[1]);
    CHECK(again == lost && sent.resent == lost && shown.frame == 1 && is_whole(&shown));
    nvsp_destroy(vehicle);
    nvsp_destroy(topside);
}

static void out_of_range(void) {
    const packet one = packets[0];
    nvsp_vehicle *vehicle = NULL;
    nvsp_vehicle_options options = vehicle_options(64, 0, 0);
    options.flags = NVSP_LINK_UNPROTECTED | NVSP_LINK_AS_THEY_COME;
    const uint32_t mtus[] = {0, 1, 7, 65536, UINT32_MAX};
    for (int i = 0; i < 5; i++) {
        nvsp_vehicle_options wrong = options;
        wrong.mtu = mtus[i];
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_create(NULL, NULL, NULL, NULL, &wrong, &vehicle));
        CHECK(says(NULL, "mtu"));
    }
    for (int i = 0; i < 4; i++) {
        nvsp_vehicle_options wrong = options;
        wrong.stream = i == 0;
        wrong.user_bytes = i == 1;
        wrong.flags |= i == 2 ? 1u << 31 : 0;
        wrong.bit_rate = i == 3 ? -1 : 0;
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_create(NULL, NULL, NULL, NULL, &wrong, &vehicle));
    }
    // More than indices tell apart count as so many.
    const struct {
        uint32_t mtu, shares, most;
    } counts[] = {{64, 2049, 2048}, {64, UINT32_MAX, 2048}, {16, 0, 2048}, {15, 9, 8}, {8, 0, 8}};
    uint32_t budget = 0;
    for (int i = 0; i < 5; i++) {
        options.mtu = counts[i].mtu;
        options.max_shares = counts[i].shares;
        vehicle = new_vehicle(&options);
        EXPECT(NVSP_OK, nvsp_vehicle_plan(vehicle, 0, 0, NULL, &budget));
        CHECK(budget == held_by(counts[i].mtu, counts[i].most));
        nvsp_destroy(vehicle);
    }
    options.mtu = 64;
    options.max_shares = 3;
    vehicle = new_vehicle(&options);
    EXPECT(NVSP_ERR_PACKET, nvsp_vehicle_packet(vehicle, 0, one.bytes, one.size, NULL, 0));
    EXPECT(NVSP_ERR_PACKET, nvsp_vehicle_packet(vehicle, 0, one.bytes, one.size - 1, NULL, 0));
    EXPECT(NVSP_ERR_STATE, nvsp_vehicle_set_link(vehicle, 0, 5000, -1, -1));
    EXPECT(NVSP_OK, nvsp_vehicle_plan(vehicle, 0, 0, NULL, &budget));
    CHECK(budget == held_by(64, 3));
    nvsp_destroy(vehicle);

    // Of a packet that is too long the start is kept. Room for the largest packet may be asked for.
    nvsp_topside_options room = topside_options(64);
    room.max_shares = 3;
    nvsp_topside *topside = new_topside(&room);
    split frames = split_packet(&one, 64, 0);
    for (uint32_t i = 0; i < frames.count; i++) {
        const nvsp_status status = nvsp_topside_receive(topside, 0, frames.frames[i], frames.sizes[i]);
        CHECK(status == (i < 3 ? NVSP_OK : NVSP_ERR_PACKET));
    }
    const nvsp_decoded shown = fetch_and_show(topside, &packets[0]);
    CHECK(!is_whole(&shown) && shown.bytes == held_by(64, 3) && shown.sent == 0);
    split_free(&frames);
    nvsp_destroy(topside);
    room.mtu = 31;
    room.max_shares = 2048;
    nvsp_destroy(new_topside(&room));
}

int main(int argc, char **argv) {
    set_up(argc, argv);
    nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
    options.rate = NVSP_RATE_BYTES;
    options.rate_value = 900;
    rig_add(&both, &dive.camera, &options);
    encode_all(&both, &dive, packets);
    MUST(nvsp_decoder_add_camera(both.decoder, &dive.camera));

    const uint32_t mtus[] = {16, 31, 64, 256, 1024, 100};
    for (int m = 0; m < 6; m++) {
        for (int i = 0; i < (few() ? 2 : dive.frames); i++) {
            losses(&packets[i], mtus[m], i % 2);
        }
        damage(&packets[0], mtus[m]);
        damage(&packets[1], mtus[m]);
    }
    small_modems();
    nothing_to_fetch();
    paced();
    out_of_range();
    return tear_down();
}
