// Packets without protection, through modems of several MTUs, which lose, swap, repeat, pad, cut and damage frames.

#include "common.h"

#include <nvsprior_extra.h>

#define MAX_MODEM_FRAMES 256
#define MAX_PACKET 4096

static uint64_t seed = 1;

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
    nvsp_sender *sender = NULL;
    nvsp_sender_options options = NVSP_INITIALIZER(nvsp_sender_options);
    nvsp_division division = NVSP_INITIALIZER(nvsp_division);
    options.flags = NVSP_SENDER_UNPROTECTED;
    MUST(nvsp_sender_create(mtu, &options, &sender));
    MUST(nvsp_sender_push(sender, 0, packet->bytes, packet->size, NULL, 0, &division));
    done.count = division.shares;
    if (done.count > MAX_MODEM_FRAMES) {
        give_up("a packet of too many modem frames");
    }
    CHECK(division.packet_bytes == packet->size && division.whole_shares == done.count);
    CHECK(division.picture_shares >= 1 && division.picture_shares <= done.count);
    CHECK(division.link_bytes == packet->size + (mtu < 16 ? done.count : 1 + 4 * (done.count - 1)));
    size_t total = 0;
    for (uint32_t i = 0; i < done.count; i++) {
        uint8_t *frame = malloc(mtu);
        memset(frame, 0xa5, mtu);
        EXPECT(NVSP_OK, nvsp_sender_next(sender, 0, frame, mtu, &done.sizes[i]));
        CHECK(done.sizes[i] <= mtu && all_are(frame + done.sizes[i], 0xa5, mtu - done.sizes[i]));
        CHECK(done.sizes[i] == mtu || i + 1 == done.count);
        total += done.sizes[i];
        if (pad) {
            memset(frame + done.sizes[i], 0, mtu - done.sizes[i]);
            done.sizes[i] = mtu;
        }
        done.frames[i] = realloc(frame, done.sizes[i]);  // No larger: a memory checker sees more.
    }
    double due = 77;
    CHECK(total == division.link_bytes && nvsp_sender_due(sender, &due) == NVSP_PENDING && due == 77);
    nvsp_destroy(sender);
    return done;
}

static void split_free(split *split) {
    for (uint32_t i = 0; i < split->count; i++) {
        free(split->frames[i]);
    }
}

static nvsp_collector *new_collector(uint32_t mtu, int checks) {
    nvsp_collector *made = NULL;
    nvsp_collector_options options = NVSP_INITIALIZER(nvsp_collector_options);
    options.flags = checks ? NVSP_COLLECTOR_MODEM_CHECKS : 0;
    options.shares = MAX_MODEM_FRAMES;
    options.packets = 4;
    MUST(nvsp_collector_create(mtu, &options, &made));
    return made;
}

static uint32_t push(nvsp_collector *collector, const uint8_t *frame, size_t size) {
    nvsp_collected state = NVSP_INITIALIZER(nvsp_collected);
    EXPECT(NVSP_OK, nvsp_collector_push(collector, 0, frame, size, &state));
    return state.event;
}

static uint32_t number_of(const packet *packet) { return (uint32_t)(packet - packets); }

static uint32_t missing_of(nvsp_collector *collector, const packet *packet, uint32_t *indices, uint32_t room) {
    uint32_t count = 77;
    EXPECT(NVSP_OK, nvsp_collector_missing(collector, 0, number_of(packet), indices, room, &count));
    return count;
}

// What there is of the packet must be its start, and make a picture; its state.
static nvsp_collected fetch_and_show(nvsp_collector *collector, const packet *packet) {
    uint8_t bytes[MAX_PACKET];
    size_t size = 0;
    nvsp_collected state = NVSP_INITIALIZER(nvsp_collected);
    nvsp_decoded info = NVSP_INITIALIZER(nvsp_decoded);
    EXPECT(NVSP_OK, nvsp_collector_fetch(collector, 0, number_of(packet), bytes, sizeof bytes, &size, &state));
    CHECK(size >= LATENT && size <= packet->size && state.bytes == size && state.event == 0);
    CHECK(memcmp(bytes, packet->bytes, size) == 0);
    CHECK(state.complete == (size == packet->size) && state.ended == state.complete && state.user_bytes == 0);
    EXPECT(NVSP_OK, nvsp_decode(both.decoder, bytes, size, NVSP_DECODE_START, NULL, &info));
    CHECK(info.frame == state.frame && (info.rows == info.height || !state.complete));
    return state;
}

// Frames in any order, some of them lost and some more than once: the packet's start up to the first lost one is there.
// Then the lost ones are sent again.
static void losses(const packet *packet, uint32_t mtu, int pad) {
    split frames = split_packet(packet, mtu, pad);
    nvsp_collector *collector = new_collector(mtu, 1);
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
            push(collector, frames.frames[at], frames.sizes[at]);
        }
        if (!lost[before]) {
            CHECK(push(collector, frames.frames[before], frames.sizes[before]) == NVSP_EVENT_DUPLICATE);
            repeated++;
        }
    }
    nvsp_collected state = NVSP_INITIALIZER(nvsp_collected);
    if (held_by(mtu, first) < (number_of(packet) == 0 ? SESSION_LATENT : LATENT)) {
        // Not even a pose has come.
        uint8_t bytes[MAX_PACKET];
        size_t size = 0;
        EXPECT(NVSP_ERR_STATE, nvsp_collector_fetch(collector, 0, number_of(packet), bytes, sizeof bytes, &size, NULL));
    } else {
        state = fetch_and_show(collector, packet);
        CHECK(state.arrived == frames.count - number);
        CHECK(state.sent == 0 || state.sent == frames.count);
        CHECK(first == frames.count ? state.complete : state.bytes == held_by(mtu, first));
    }
    nvsp_collector_statistics counts = NVSP_INITIALIZER(nvsp_collector_statistics);
    EXPECT(NVSP_OK, nvsp_collector_get_statistics(collector, &counts));
    CHECK(counts.accepted + counts.waiting == frames.count - number && counts.duplicates == repeated);
    CHECK(counts.rejected == 0 && counts.completed == state.complete);
    uint32_t missing[MAX_MODEM_FRAMES], asked = 0, rounds = 0, known = 77;
    uint32_t count = missing_of(collector, packet, NULL, 0);
    CHECK(count >= (state.complete ? 0u : 1u) && count <= number);
    do {
        count = missing_of(collector, packet, missing, 3);
        for (uint32_t i = 0; i < count && i < 3; i++) {
            CHECK(missing[i] < frames.count && lost[missing[i]]);
            asked += push(collector, frames.frames[missing[i]], frames.sizes[missing[i]])
                     != NVSP_EVENT_DUPLICATE;
        }
    } while (count > 0 && ++rounds < MAX_MODEM_FRAMES);
    CHECK(asked == number && fetch_and_show(collector, packet).complete == 1);
    uint8_t bits[MAX_MODEM_FRAMES / 8];
    EXPECT(NVSP_OK, nvsp_collector_arrived(collector, 0, number_of(packet), bits, sizeof bits, &known));
    CHECK(known == frames.count);
    for (uint32_t i = 0; i < known; i++) {
        CHECK(bits[i / 8] >> i % 8 & 1);
    }
    nvsp_destroy(collector);
    split_free(&frames);
}

// Frames that are cut short or have flipped bits are refused or change nothing. The whole frames then complete the
// packet.
static void damage(const packet *packet, uint32_t mtu) {
    split frames = split_packet(packet, mtu, 0);
    nvsp_collector *collector = new_collector(mtu, 0);
    uint8_t bytes[MAX_PACKET];
    size_t size = 0;
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
            const nvsp_status status = nvsp_collector_push(collector, 0, cut, left, NULL);
            CHECK(status == NVSP_OK || status == NVSP_ERR_MODEM);
            free(cut);
            free(copy);
            if (nvsp_collector_fetch(collector, 0, number_of(packet), bytes, sizeof bytes, &size, NULL) == NVSP_OK) {
                CHECK(size <= packet->size && memcmp(bytes, packet->bytes, size) == 0);
            }
        }
        const nvsp_status status =
            nvsp_collector_push(collector, 0, frames.frames[i], frames.sizes[i], NULL);
        EXPECT(NVSP_OK, status);
    }
    CHECK(fetch_and_show(collector, packet).complete == 1);
    nvsp_destroy(collector);
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
            uint8_t bytes[8 * 15], held[8 * 15];
            packet one = {bytes, 0};
            const nvsp_image image = scene_image(&dive, i);
            MUST(nvsp_encode(encoder, &image, with_hint(&dive.poses[i]), bytes, sizeof bytes, &one.size, NULL));
            split frames = split_packet(&one, mtu, i % 2);
            CHECK(frames.count <= 8 && one.size > held_by(mtu, frames.count - 1));
            nvsp_collector *collector = new_collector(mtu, 1);
            const uint32_t lost = 1 + random_below(&seed, frames.count - 1);
            for (uint32_t k = frames.count; k-- > 0;) {
                if (k != lost) {
                    push(collector, frames.frames[k], frames.sizes[k]);
                    CHECK(push(collector, frames.frames[k], frames.sizes[k]) == NVSP_EVENT_DUPLICATE);
                }
            }
            size_t size = 0;
            nvsp_collected state = NVSP_INITIALIZER(nvsp_collected);
            const nvsp_status status =
                nvsp_collector_fetch(collector, 0, (uint32_t)i, held, sizeof held, &size, &state);
            CHECK((status == NVSP_OK) == (held_by(mtu, lost) >= (i == 0 ? SESSION_LATENT : LATENT)));
            if (status == NVSP_OK) {
                CHECK(size == held_by(mtu, lost) && state.complete == 0 && memcmp(held, bytes, size) == 0);
                EXPECT(NVSP_OK, nvsp_decode(both.decoder, held, size, NVSP_DECODE_START, NULL, NULL));
            }
            CHECK(push(collector, frames.frames[lost], frames.sizes[lost]) == NVSP_EVENT_COMPLETE);
            EXPECT(NVSP_OK, nvsp_collector_fetch(collector, 0, (uint32_t)i, held, sizeof held, &size, &state));
            CHECK(state.complete == 1 && size == one.size && memcmp(held, bytes, size) == 0);
            EXPECT(NVSP_OK, nvsp_decode(both.decoder, held, size, 0, NULL, NULL));
            nvsp_destroy(collector);
            split_free(&frames);
        }
        nvsp_destroy(encoder);
    }
}

static void nothing_to_fetch(void) {
    nvsp_collector *collector = new_collector(64, 0);
    split frames = split_packet(&packets[0], 64, 0);
    uint8_t bytes[MAX_PACKET];
    size_t size = 77;
    uint32_t indices[2] = {77, 77};
    char text[256];
    memset(bytes, 0xa5, sizeof bytes);
    EXPECT(NVSP_ERR_STATE, nvsp_collector_fetch(collector, 0, 0, bytes, sizeof bytes, &size, NULL));
    CHECK(missing_of(collector, &packets[0], indices, 2) == 0);
    CHECK(push(collector, frames.frames[1], frames.sizes[1]) == NVSP_EVENT_KEPT);
    EXPECT(NVSP_ERR_STATE, nvsp_collector_fetch(collector, 0, 0, bytes, sizeof bytes, &size, NULL));
    EXPECT(NVSP_ERR_MODEM, nvsp_collector_push(collector, 0, bytes, 0, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_push(collector, 0, bytes, SIZE_MAX, NULL));
    EXPECT(NVSP_OK, nvsp_last_error(collector, text, sizeof text));
    CHECK(strlen(text) > 3);
    push(collector, frames.frames[0], frames.sizes[0]);
    // Nothing is written but the size needed.
    CHECK(size == 77);
    EXPECT(NVSP_ERR_BUFFER_TOO_SMALL, nvsp_collector_fetch(collector, 0, 0, bytes, 30, &size, NULL));
    const size_t fetched = size;
    CHECK(fetched > 30 && fetched <= 64 + 60);
    EXPECT(NVSP_ERR_BUFFER_TOO_SMALL, nvsp_collector_fetch(collector, 0, 0, bytes, 0, &size, NULL));
    CHECK(size == fetched && indices[0] == 77 && all_are(bytes, 0xa5, sizeof bytes));
    split_free(&frames);
    nvsp_destroy(collector);
}

// A sender with a bit rate gives each frame its bytes, and sends again what a report says is missing.
static void paced(void) {
    nvsp_sender_options options = NVSP_INITIALIZER(nvsp_sender_options);
    options.bit_rate = 60000;
    options.frame_rate = 5;
    options.latency = 3;
    options.flags = NVSP_SENDER_UNPROTECTED | NVSP_SENDER_EXPECT_REPORTS;
    nvsp_sender *sender = NULL;
    nvsp_collector *collector = new_collector(64, 0);
    MUST(nvsp_sender_create(64, &options, &sender));
    uint8_t bytes[64];
    size_t size = 0;
    uint32_t budget = 0, lost = 0;
    EXPECT(NVSP_ERR_STATE, nvsp_sender_push(sender, 0, packets[0].bytes, packets[0].size, NULL, 0, NULL));
    for (int i = 0; i < 3; i++) {
        EXPECT(NVSP_OK, nvsp_sender_plan(sender, i, &budget));
        CHECK(budget > 900);
        EXPECT(NVSP_OK, nvsp_sender_push(sender, i, packets[i].bytes, packets[i].size, NULL, 0, NULL));
        for (uint32_t k = 0; nvsp_sender_next(sender, i, bytes, sizeof bytes, &size) == NVSP_OK; k++) {
            if (i == 1 && k % 3 == 1) {
                lost++;
            } else {
                push(collector, bytes, size);
            }
        }
    }
    CHECK(lost > 1 && fetch_and_show(collector, &packets[1]).complete == 0);
    EXPECT(NVSP_OK, nvsp_collector_report(collector, 0, NULL, 0, NULL, 0, bytes, sizeof bytes, &size));
    nvsp_processed_report processed = NVSP_INITIALIZER(nvsp_processed_report);
    EXPECT(NVSP_OK, nvsp_sender_process_report(sender, 2.1, bytes, size, &processed));
    CHECK(processed.resent_shares == lost && processed.newest == 2);
    while (nvsp_sender_next(sender, 2.1, bytes, sizeof bytes, &size) == NVSP_OK) {
        push(collector, bytes, size);
    }
    CHECK(fetch_and_show(collector, &packets[1]).complete == 1);
    nvsp_destroy(sender);
    nvsp_destroy(collector);
}

static void out_of_range(void) {
    const packet one = packets[0];
    nvsp_sender *sender = NULL;
    nvsp_sender_options options = NVSP_INITIALIZER(nvsp_sender_options);
    options.flags = NVSP_SENDER_UNPROTECTED;
    const uint32_t mtus[] = {0, 1, 7, 65536, UINT32_MAX};
    for (int i = 0; i < 5; i++) {
        EXPECT(NVSP_ERR_MODEM, nvsp_sender_create(mtus[i], &options, &sender));
    }
    for (int i = 0; i < 5; i++) {
        nvsp_sender_options wrong = options;
        wrong.stream = i == 0;
        wrong.user_bytes = i == 1;
        wrong.flags |= i == 2 ? 8 : i == 3 ? NVSP_SENDER_EXPECT_REPORTS : 0;
        wrong.bit_rate = i == 4 ? -1 : 0;
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_create(64, &wrong, &sender));
    }
    // More shares than indices tell apart count as so many.
    const struct {
        uint32_t mtu, shares, most;
    } counts[] = {{64, 2049, 2048}, {64, UINT32_MAX, 2048}, {16, 0, 2048}, {15, 9, 8}, {8, 0, 8}};
    uint32_t budget = 0;
    for (int i = 0; i < 5; i++) {
        options.shares = counts[i].shares;
        MUST(nvsp_sender_create(counts[i].mtu, &options, &sender));
        EXPECT(NVSP_OK, nvsp_sender_plan(sender, 0, &budget));
        CHECK(budget == held_by(counts[i].mtu, counts[i].most));
        nvsp_destroy(sender);
    }
    // A collector whose MTU no packet has takes nothing.
    nvsp_collector *collector = new_collector(7, 0);
    split small = split_packet(&one, 64, 0);
    EXPECT(NVSP_ERR_MODEM, nvsp_collector_push(collector, 0, small.frames[0], small.sizes[0], NULL));
    split_free(&small);
    nvsp_destroy(collector);
    options.shares = 3;
    MUST(nvsp_sender_create(64, &options, &sender));
    EXPECT(NVSP_ERR_MODEM, nvsp_sender_push(sender, 0, one.bytes, one.size, NULL, 0, NULL));
    EXPECT(NVSP_ERR_MODEM, nvsp_sender_push(sender, 0, one.bytes, one.size - 1, NULL, 0, NULL));
    EXPECT(NVSP_ERR_STATE, nvsp_sender_set_bit_rate(sender, 0, 5000));
    EXPECT(NVSP_OK, nvsp_sender_plan(sender, 0, &budget));
    CHECK(budget == held_by(64, 3));
    nvsp_destroy(sender);

    // Of a packet that is too long the start is kept. Room for the largest packet may be asked for.
    nvsp_collector_options room = NVSP_INITIALIZER(nvsp_collector_options);
    room.shares = 3;
    MUST(nvsp_collector_create(64, &room, &collector));
    split frames = split_packet(&one, 64, 0);
    for (uint32_t i = 0; i < frames.count; i++) {
        const nvsp_status status = nvsp_collector_push(collector, 0, frames.frames[i], frames.sizes[i], NULL);
        CHECK(status == (i < 3 ? NVSP_OK : NVSP_ERR_MODEM));
    }
    const nvsp_collected state = fetch_and_show(collector, &packets[0]);
    CHECK(state.complete == 0 && state.bytes == held_by(64, 3) && state.sent == 0);
    split_free(&frames);
    nvsp_destroy(collector);
    room.shares = 2048;
    EXPECT(NVSP_OK, nvsp_collector_create(31, &room, &collector));
    nvsp_destroy(collector);
    room.shares = 2049;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_create(31, &room, &collector));
}

int main(int argc, char **argv) {
    set_up(argc, argv);
    nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
    options.rate = NVSP_RATE_BYTES;
    options.rate_value = 900;
    rig_add(&both, &dive.camera, &options);
    encode_all(&both, &dive, packets);
    MUST(nvsp_decoder_add_camera(both.decoder, &dive.camera));

    const uint32_t mtus[] = {16, NVSP_MTU_31, NVSP_MTU_64, NVSP_MTU_256, NVSP_MTU_1024, 100};
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
