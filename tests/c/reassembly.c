// Packets through modems of several MTUs, which lose, swap, repeat, pad, cut and damage frames.

#include "common.h"

#define MAX_MODEM_FRAMES 256
#define MAX_PACKET 4096

static scene dive;
static rig both;
static packet packets[MAX_FRAMES];
static uint64_t seed = 1;

// A packet as its modem frames.
typedef struct split {
    uint32_t count;
    size_t sizes[MAX_MODEM_FRAMES];
    uint8_t *frames[MAX_MODEM_FRAMES];
} split;

static split split_packet(const packet *packet, uint32_t mtu, int pad) {
    split done = {0};
    EXPECT(NVSP_OK, nvsp_modem_frame_count(packet->size, mtu, &done.count));
    if (done.count > MAX_MODEM_FRAMES) {
        give_up("a packet of too many modem frames");
    }
    size_t total = 0;
    for (uint32_t i = 0; i < done.count; i++) {
        uint8_t *frame = malloc(mtu);
        memset(frame, 0xa5, mtu);
        EXPECT(NVSP_OK, nvsp_modem_frame(packet->bytes, packet->size, mtu, i, frame, mtu,
                                         &done.sizes[i]));
        CHECK(done.sizes[i] <= mtu && all_are(frame + done.sizes[i], 0xa5, mtu - done.sizes[i]));
        CHECK(done.sizes[i] == mtu || i + 1 == done.count);
        total += done.sizes[i] - (i > 0 ? 4 : 0);
        done.sizes[i] = pad ? mtu : done.sizes[i];
        done.frames[i] = realloc(frame, done.sizes[i]);  // No larger: a memory checker sees more.
    }
    CHECK(total == packet->size);
    return done;
}

static void split_free(split *split) {
    for (uint32_t i = 0; i < split->count; i++) {
        free(split->frames[i]);
    }
}

static nvsp_reassembler *new_reassembler(uint32_t mtu, int checks) {
    nvsp_reassembler *made = NULL;
    nvsp_reassembler_options options;
    MUST(NVSP_INIT(&options));
    options.flags = checks ? NVSP_MODEM_CHECKS : 0;
    MUST(nvsp_reassembler_create(mtu, &options, &made));
    return made;
}

static uint32_t push(nvsp_reassembler *reassembler, const uint8_t *frame, size_t size) {
    nvsp_reassembly state;
    MUST(NVSP_INIT(&state));
    EXPECT(NVSP_OK, nvsp_reassembler_push(reassembler, frame, size, &state));
    return state.event;
}

// What there is of the packet must be its start, and make a picture; its state.
static nvsp_reassembly fetch_and_show(nvsp_reassembler *reassembler, const packet *packet) {
    uint8_t bytes[MAX_PACKET];
    size_t size = 0;
    nvsp_reassembly state;
    nvsp_decoded info;
    MUST(NVSP_INIT(&state));
    MUST(NVSP_INIT(&info));
    EXPECT(NVSP_OK, nvsp_reassembler_fetch(reassembler, bytes, sizeof bytes, &size, &state));
    CHECK(size >= 19 && size <= packet->size && state.bytes == size && state.event == 0);
    CHECK(memcmp(bytes, packet->bytes, size) == 0);
    CHECK(state.complete == (size == packet->size));
    EXPECT(NVSP_OK, nvsp_decode(both.decoder, bytes, size, NVSP_DECODE_START, NULL, &info));
    CHECK(info.frame == state.frame && (info.rows == info.height || !state.complete));
    return state;
}

// Every frame, in any order, some more than once: the packet.
static void any_order(const packet *packet, uint32_t mtu, int pad) {
    split frames = split_packet(packet, mtu, pad);
    nvsp_reassembler *reassembler = new_reassembler(mtu, 0);
    uint32_t order[MAX_MODEM_FRAMES], complete = 0, repeated = 0;
    for (uint32_t i = 0; i < frames.count; i++) {
        const uint32_t j = random_below(&seed, i + 1);
        order[i] = order[j];
        order[j] = i;
    }
    for (uint32_t i = 0; i < frames.count; i++) {
        const uint32_t at = order[i];
        complete += push(reassembler, frames.frames[at], frames.sizes[at]) == NVSP_EVENT_COMPLETE;
        const uint32_t before = order[random_below(&seed, i + 1)];
        repeated +=
            push(reassembler, frames.frames[before], frames.sizes[before]) == NVSP_EVENT_DUPLICATE;
    }
    nvsp_reassembler_statistics counts;
    MUST(NVSP_INIT(&counts));
    EXPECT(NVSP_OK, nvsp_reassembler_get_statistics(reassembler, &counts));
    CHECK(complete == 1 && repeated == frames.count);
    CHECK(counts.accepted == frames.count && counts.duplicates == frames.count);
    CHECK(counts.rejected == 0 && counts.waiting == 0 && counts.completed == 1);
    const nvsp_reassembly state = fetch_and_show(reassembler, packet);
    CHECK(state.complete == 1 && state.frames == frames.count && state.expected == frames.count);
    uint32_t missing[4], count = 77;
    EXPECT(NVSP_OK, nvsp_reassembler_missing(reassembler, missing, 4, &count));
    CHECK(count == 0);
    nvsp_reassembler_destroy(reassembler);
    split_free(&frames);
}

// Some frames are lost: the packet's start up to the first lost one is there. Then the lost ones are sent again.
static void losses(const packet *packet, uint32_t mtu, int pad) {
    split frames = split_packet(packet, mtu, pad);
    nvsp_reassembler *reassembler = new_reassembler(mtu, 1);
    int lost[MAX_MODEM_FRAMES] = {0};
    uint32_t first = frames.count, number = 0;
    for (uint32_t i = 1; i < frames.count; i++) {
        lost[i] = random_below(&seed, 4) == 0;
        number += (uint32_t)lost[i];
        first = lost[i] && i < first ? i : first;
    }
    for (uint32_t i = 0; i < frames.count; i++) {
        if (!lost[i]) {
            push(reassembler, frames.frames[i], frames.sizes[i]);
        }
    }
    const nvsp_reassembly state = fetch_and_show(reassembler, packet);
    // Until the packet's length has come, only frames without a gap are known to be the packet's.
    CHECK(state.frames == (state.expected == 0 ? first : frames.count - number));
    CHECK(state.expected == 0 || state.expected == frames.count);
    CHECK(first == frames.count ? state.complete : state.bytes == mtu + (size_t)(first - 1) * (mtu - 4));
    uint32_t missing[MAX_MODEM_FRAMES], count = 77, asked = 0, rounds = 0;
    EXPECT(NVSP_OK, nvsp_reassembler_missing(reassembler, missing, 0, &count));
    CHECK(count >= (state.complete ? 0u : 1u) && count <= number);
    do {
        EXPECT(NVSP_OK, nvsp_reassembler_missing(reassembler, missing, 3, &count));
        for (uint32_t i = 0; i < count && i < 3; i++) {
            CHECK(missing[i] < frames.count && lost[missing[i]]);
            asked += push(reassembler, frames.frames[missing[i]], frames.sizes[missing[i]])
                     != NVSP_EVENT_DUPLICATE;
        }
    } while (count > 0 && ++rounds < MAX_MODEM_FRAMES);
    CHECK(asked == number && fetch_and_show(reassembler, packet).complete == 1);
    nvsp_reassembler_destroy(reassembler);
    split_free(&frames);
}

// Frames that are cut short or have flipped bits are refused or change nothing. The whole frames then complete the
// packet.
static void damage(const packet *packet, uint32_t mtu) {
    split frames = split_packet(packet, mtu, 0);
    nvsp_reassembler *reassembler = new_reassembler(mtu, 0);
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
            const nvsp_status status = nvsp_reassembler_push(reassembler, cut, left, NULL);
            CHECK(status == NVSP_OK || status == NVSP_ERR_MODEM);
            free(cut);
            free(copy);
            if (nvsp_reassembler_fetch(reassembler, bytes, sizeof bytes, &size, NULL) == NVSP_OK) {
                CHECK(size <= packet->size && memcmp(bytes, packet->bytes, size) == 0);
            }
        }
        const nvsp_status status =
            nvsp_reassembler_push(reassembler, frames.frames[i], frames.sizes[i], NULL);
        EXPECT(NVSP_OK, status);
    }
    CHECK(fetch_and_show(reassembler, packet).complete == 1);
    nvsp_reassembler_destroy(reassembler);
    split_free(&frames);
}

// The frames of several packets are mixed. The newest packet is given, and none has bytes of another.
static void mixed(uint32_t mtu) {
    nvsp_reassembler *reassembler = new_reassembler(mtu, 0);
    split frames[3];
    for (int p = 0; p < 3; p++) {
        frames[p] = split_packet(&packets[p], mtu, p % 2);
    }
    int complete = 0;
    for (uint32_t i = 0; i < MAX_MODEM_FRAMES; i++) {
        for (int p = 0; p < 3; p++) {
            if (i < frames[p].count) {
                complete += push(reassembler, frames[p].frames[i], frames[p].sizes[i])
                            == NVSP_EVENT_COMPLETE;
            }
        }
    }
    CHECK(complete == 3);
    const nvsp_reassembly state = fetch_and_show(reassembler, &packets[2]);
    CHECK(state.frame == 2 && state.complete == 1);
    for (int p = 0; p < 3; p++) {
        split_free(&frames[p]);
    }
    nvsp_reassembler_destroy(reassembler);
}

static void nothing_to_fetch(void) {
    nvsp_reassembler *reassembler = new_reassembler(64, 0);
    split frames = split_packet(&packets[0], 64, 0);
    uint8_t bytes[MAX_PACKET];
    size_t size = 77;
    uint32_t indices[2] = {77, 77}, count = 77;
    char text[256];
    memset(bytes, 0xa5, sizeof bytes);
    EXPECT(NVSP_ERR_STATE, nvsp_reassembler_fetch(reassembler, bytes, sizeof bytes, &size, NULL));
    EXPECT(NVSP_ERR_STATE, nvsp_reassembler_missing(reassembler, indices, 2, &count));
    CHECK(push(reassembler, frames.frames[1], frames.sizes[1]) == NVSP_EVENT_KEPT);
    EXPECT(NVSP_ERR_STATE, nvsp_reassembler_fetch(reassembler, bytes, sizeof bytes, &size, NULL));
    EXPECT(NVSP_ERR_MODEM, nvsp_reassembler_push(reassembler, bytes, 0, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_reassembler_push(reassembler, bytes, SIZE_MAX, NULL));
    EXPECT(NVSP_OK, nvsp_reassembler_last_error(reassembler, text, sizeof text));
    CHECK(strlen(text) > 3);
    push(reassembler, frames.frames[0], frames.sizes[0]);
    // Nothing is written but the size needed.
    CHECK(size == 77);
    EXPECT(NVSP_ERR_BUFFER_TOO_SMALL, nvsp_reassembler_fetch(reassembler, bytes, 30, &size, NULL));
    const size_t fetched = size;
    CHECK(fetched > 30 && fetched <= 64 + 60);
    EXPECT(NVSP_ERR_BUFFER_TOO_SMALL, nvsp_reassembler_fetch(reassembler, bytes, 0, &size, NULL));
    CHECK(size == fetched && count == 77 && indices[0] == 77 && all_are(bytes, 0xa5, sizeof bytes));
    split_free(&frames);
    nvsp_reassembler_destroy(reassembler);
}

static void out_of_range(void) {
    const packet one = packets[0];
    nvsp_reassembler *made = NULL;
    nvsp_reassembler_options options;
    uint8_t frame[256];
    size_t size = 77;
    uint32_t count = 77;
    memset(frame, 0xa5, sizeof frame);
    const uint32_t mtus[] = {0, 1, 30, 65536, UINT32_MAX};
    for (int i = 0; i < 5; i++) {
        EXPECT(NVSP_ERR_MODEM, nvsp_modem_frame_count(one.size, mtus[i], &count));
        EXPECT(NVSP_ERR_MODEM,
               nvsp_modem_frame(one.bytes, one.size, mtus[i], 0, frame, sizeof frame, &size));
        EXPECT(NVSP_ERR_MODEM, nvsp_reassembler_create(mtus[i], NULL, &made));
    }
    EXPECT(NVSP_ERR_MODEM, nvsp_modem_frame_count(SIZE_MAX, 31, &count));
    EXPECT(NVSP_ERR_MODEM, nvsp_modem_frame_count(31 + 4095 * 27 + 1, 31, &count));
    const uint32_t indices[] = {1000, 4096, UINT32_MAX};
    for (int i = 0; i < 3; i++) {
        EXPECT(NVSP_ERR_MODEM, nvsp_modem_frame(one.bytes, one.size, 64, indices[i], frame,
                                                sizeof frame, &size));
    }
    CHECK(size == 77);
    EXPECT(NVSP_ERR_BUFFER_TOO_SMALL, nvsp_modem_frame(one.bytes, one.size, 64, 0, frame, 63, &size));
    CHECK(size == 64);
    EXPECT(NVSP_ERR_MODEM, nvsp_modem_frame(frame, sizeof frame, 64, 0, frame, 64, &size));
    EXPECT(NVSP_ERR_MODEM, nvsp_modem_frame(one.bytes, 0, 64, 0, frame, 64, &size));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_modem_frame(one.bytes, SIZE_MAX, 64, 0, frame, 64, &size));
    MUST(NVSP_INIT(&options));
    options.flags = 2;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_reassembler_create(64, &options, &made));
    CHECK(made == NULL && size == 64 && count == 77 && all_are(frame, 0xa5, sizeof frame));
    EXPECT(NVSP_OK, nvsp_modem_frame_count(31 + 4095 * 27, 31, &count));
    CHECK(count == 4096);

    // A packet that is too long gives its start. Room for the largest packet may be asked for.
    options.flags = 0;
    options.max_packet_bytes = 150;
    MUST(nvsp_reassembler_create(64, &options, &made));
    split frames = split_packet(&one, 64, 0);
    for (uint32_t i = 0; i < frames.count; i++) {
        const nvsp_status status =
            nvsp_reassembler_push(made, frames.frames[i], frames.sizes[i], NULL);
        CHECK(status == (i < 3 ? NVSP_OK : NVSP_ERR_MODEM));
    }
    const nvsp_reassembly state = fetch_and_show(made, &one);
    CHECK(state.complete == 0 && state.bytes >= 150);
    split_free(&frames);
    nvsp_reassembler_destroy(made);
    options.max_packet_bytes = UINT32_MAX;
    EXPECT(NVSP_OK, nvsp_reassembler_create(31, &options, &made));
    nvsp_reassembler_destroy(made);
}

int main(int argc, char **argv) {
    if (argc != 2) {
        give_up("usage: reassembly SCENE");
    }
    scene_read(&dive, argv[1]);
    rig_open(&both, &dive);
    nvsp_encoder_options options;
    MUST(NVSP_INIT(&options));
    options.rate = NVSP_RATE_BYTES;
    options.rate_value = 900;
    rig_add(&both, &dive.camera, &options);
    encode_all(&both, &dive, packets);
    MUST(nvsp_decoder_add_camera(both.decoder, &dive.camera));

    const uint32_t mtus[] = {NVSP_MTU_31, NVSP_MTU_64, NVSP_MTU_256, NVSP_MTU_1024, 100};
    for (int m = 0; m < 5; m++) {
        for (int i = 0; i < (few() ? 2 : dive.frames); i++) {
            any_order(&packets[i], mtus[m], i % 2);
            losses(&packets[i], mtus[m], i % 2);
        }
        damage(&packets[0], mtus[m]);
        damage(&packets[1], mtus[m]);
        mixed(mtus[m]);
    }
    nothing_to_fetch();
    out_of_range();
    for (int i = 0; i < dive.frames; i++) {
        free(packets[i].bytes);
    }
    rig_close(&both);
    scene_free(&dive);
    return report("reassembly");
}
