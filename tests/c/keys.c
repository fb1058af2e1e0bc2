// Keys: what goes over a link with them comes out, what strangers send does not, and packets without a modem.

#include "common.h"

#include <nvsprior_extra.h>

static uint8_t own_key[NVSP_KEY_BYTES], other_key[NVSP_KEY_BYTES];

static nvsp_keys keys_with(const uint8_t *key, uint64_t epoch) {
    nvsp_keys keys = NVSP_INITIALIZER(nvsp_keys);
    keys.keys = key;
    keys.count = 1;
    keys.epoch = epoch;
    return keys;
}

static nvsp_vehicle_options vehicle_with(const nvsp_keys *keys) {
    nvsp_vehicle_options options = vehicle_options(64, 40000, 4);
    options.keys = keys;
    return options;
}

static nvsp_vehicle *keyed_vehicle(const nvsp_keys *keys) {
    const nvsp_vehicle_options options = vehicle_with(keys);
    return new_vehicle(&options);
}

static nvsp_topside *keyed_topside(const nvsp_keys *keys) {
    nvsp_topside_options options = topside_options(64);
    options.keys = keys;
    return new_topside(&options);
}

// Sends a packet; each modem frame must bring `status` at the topside. Returns how many they were.
static uint32_t send(nvsp_vehicle *vehicle, nvsp_topside *topside, const packet *packet, double now,
                     nvsp_status status) {
    uint8_t frame[64];
    size_t size = 0;
    uint32_t budget = 0, count = 0;
    MUST(nvsp_vehicle_plan(vehicle, now, now, NULL, &budget));
    MUST(nvsp_vehicle_packet(vehicle, now, packet->bytes, packet->size, NULL, 0));
    while (nvsp_vehicle_transmit(vehicle, now + 1, sizeof frame, frame, &size, NULL) == NVSP_OK) {
        CHECK(size <= 64);
        EXPECT(status, nvsp_topside_receive(topside, now, frame, size));
        if (status == NVSP_OK) {
            EXPECT(NVSP_ERR_REPLAYED, nvsp_topside_receive(topside, now, frame, size));
        }
        frame[size / 2] ^= 4;
        EXPECT(NVSP_ERR_FOREIGN, nvsp_topside_receive(topside, now, frame, size));
        count++;
    }
    return count;
}

// What an end would have its owner store.
static nvsp_event vehicle_state(nvsp_vehicle *vehicle) {
    nvsp_event event = NVSP_INITIALIZER(nvsp_event);
    while (nvsp_vehicle_event(vehicle, &event) == NVSP_OK && event.kind != NVSP_EVENT_STORE) {
    }
    CHECK(event.kind == NVSP_EVENT_STORE && event.data_size > 0);
    return event;
}

static nvsp_event topside_state(nvsp_topside *topside) {
    nvsp_event event = NVSP_INITIALIZER(nvsp_event);
    while (nvsp_topside_event(topside, &event) == NVSP_OK && event.kind != NVSP_EVENT_STORE) {
    }
    CHECK(event.kind == NVSP_EVENT_STORE && event.data_size > 0);
    return event;
}

static void links(void) {
    const nvsp_keys own = keys_with(own_key, 7), other = keys_with(other_key, 7), past = keys_with(own_key, 6);
    nvsp_vehicle *vehicle = keyed_vehicle(&own);
    nvsp_topside *topside = keyed_topside(&own);
    const uint32_t count = send(vehicle, topside, &packets[0], 0, NVSP_OK);
    uint8_t bytes[4096];
    size_t written = 0;
    EXPECT(NVSP_OK, nvsp_topside_packet(topside, 0, bytes, sizeof bytes, &written, NULL));
    CHECK(written == packets[0].size && memcmp(bytes, packets[0].bytes, written) == 0);

    nvsp_vehicle *strangers[] = {keyed_vehicle(&other), keyed_vehicle(&past), keyed_vehicle(NULL)};
    uint32_t strange = 0;
    for (size_t i = 0; i < 3; i++) {
        strange += send(strangers[i], topside, &packets[1], 0, NVSP_ERR_FOREIGN);
        nvsp_destroy(strangers[i]);
    }
    EXPECT(NVSP_PENDING, nvsp_topside_packet(topside, 0, bytes, sizeof bytes, &written, NULL));
    nvsp_topside_statistics came = NVSP_INITIALIZER(nvsp_topside_statistics);
    MUST(nvsp_topside_get_statistics(topside, &came));
    CHECK(came.accepted == count && came.replayed == count && came.foreign == count + 2 * strange);
    CHECK(came.rejected == 0);

    // Reports, the other way.
    uint8_t report[64];
    nvsp_event event = NVSP_INITIALIZER(nvsp_event);
    MUST(nvsp_topside_set_user(topside, (const uint8_t *)"user", 4));
    MUST(nvsp_topside_report(topside, 1, report, sizeof report, &written, NULL));
    EXPECT(NVSP_OK, nvsp_vehicle_receive(vehicle, 1, report, written));
    const nvsp_event kept = vehicle_state(vehicle);
    while (nvsp_vehicle_event(vehicle, &event) == NVSP_OK && event.kind != NVSP_EVENT_USER) {
    }
    CHECK(event.data_size == 4 && memcmp(event.data, "user", 4) == 0);
    EXPECT(NVSP_ERR_REPLAYED, nvsp_vehicle_receive(vehicle, 1, report, written));
    report[written - 1] ^= 1;
    EXPECT(NVSP_ERR_FOREIGN, nvsp_vehicle_receive(vehicle, 1, report, written));
    CHECK(says(vehicle, "no key"));
    nvsp_vehicle_statistics sent = NVSP_INITIALIZER(nvsp_vehicle_statistics);
    MUST(nvsp_vehicle_get_statistics(vehicle, &sent));
    CHECK(sent.foreign == 1 && sent.replayed == 1);

    // Both sides start again within the epoch: their states tell the numbers.
    const nvsp_event seen = topside_state(topside);
    nvsp_vehicle_options vehicle_options = vehicle_with(&own);
    vehicle_options.state = kept.data;
    vehicle_options.state_size = kept.data_size;
    nvsp_topside_options topside_again = topside_options(64);
    topside_again.keys = &own;
    topside_again.state = seen.data;
    topside_again.state_size = seen.data_size;
    nvsp_vehicle *again = new_vehicle(&vehicle_options), *forgetful = keyed_vehicle(&own);
    nvsp_topside *remembers = new_topside(&topside_again);
    send(forgetful, remembers, &packets[0], 0, NVSP_ERR_REPLAYED);
    CHECK(send(again, remembers, &packets[1], 0, NVSP_OK) > 0);
    // An epoch that lies before that of the state is refused.
    vehicle_options.keys = &past;
    nvsp_vehicle *none = NULL;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_create(NULL, NULL, NULL, NULL, &vehicle_options, &none));
    CHECK(none == NULL && says(NULL, "epoch 6"));
    nvsp_destroy(vehicle);
    nvsp_destroy(again);
    nvsp_destroy(forgetful);
    nvsp_destroy(topside);
    nvsp_destroy(remembers);
}

static nvsp_decoder *new_decoder(const nvsp_keys *keys) {
    nvsp_decoder *made = NULL;
    MUST(nvsp_decoder_create(both.engine, both.prior, keys, &made));
    return made;
}

static nvsp_encoder *keyed_encoder(const nvsp_keys *keys) {
    nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
    options.keys = keys;
    return new_encoder(&options);
}

// Encodes the first frame.
static nvsp_status encode(nvsp_encoder *encoder, uint8_t *bytes, size_t room, size_t *written,
                          nvsp_frame_stats *stats) {
    const nvsp_image image = scene_image(&dive, 0);
    return nvsp_encode(encoder, &image, with_hint(&dive.poses[0]), bytes, room, written, stats);
}

// Checks that a decoder refuses a packet, and reads nothing of it.
static void refuse(nvsp_status wanted, nvsp_decoder *decoder, const uint8_t *bytes, size_t size) {
    nvsp_decoded info = NVSP_INITIALIZER(nvsp_decoded);
    EXPECT(wanted, nvsp_decode_begin(decoder, bytes, size, 0));
    EXPECT(NVSP_ERR_STATE, nvsp_wait(decoder, 0));
    EXPECT(wanted, nvsp_decode(decoder, bytes, size, 0, NULL, &info));
    CHECK(info.width == 0 && info.taken == 0);
}

// The encoder makes number and tag, and the decoder checks them.
static void packets_without_a_modem(void) {
    const nvsp_keys own = keys_with(own_key, 7), other = keys_with(other_key, 7), past = keys_with(own_key, 6);
    nvsp_encoder *encoder = keyed_encoder(&own);
    nvsp_decoder *decoder = new_decoder(&own);
    uint8_t bytes[4096];
    size_t written = 0;
    nvsp_frame_stats stats = NVSP_INITIALIZER(nvsp_frame_stats);
    // A packet that finds no room takes no number.
    const size_t size = packets[0].size + 6;
    EXPECT(NVSP_ERR_BUFFER_TOO_SMALL, encode(encoder, bytes, size - 1, &written, &stats));
    CHECK(written == size && stats.next_number == 0);
    EXPECT(NVSP_OK, nvsp_encode_finish(encoder, bytes, size, &written, &stats));
    CHECK(written == size && stats.bytes == size && stats.next_number == 1);
    CHECK(memcmp(bytes + 6, packets[0].bytes, packets[0].size) == 0);
    for (size_t i = 0; i < size; i++) {
        refuse(NVSP_ERR_FOREIGN, decoder, bytes, i);
        bytes[i] ^= 16;
        refuse(NVSP_ERR_FOREIGN, decoder, bytes, size);
        bytes[i] ^= 16;
    }
    refuse(NVSP_ERR_FOREIGN, decoder, packets[0].bytes, packets[0].size);
    CHECK(says(decoder, "no key"));
    const nvsp_keys *const strangers[] = {&other, &past};
    for (int i = 0; i < 2; i++) {
        nvsp_decoder *strange = new_decoder(strangers[i]);
        refuse(NVSP_ERR_FOREIGN, strange, bytes, size);
        nvsp_destroy(strange);
    }
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decode(decoder, bytes, size, 2, NULL, NULL));
    nvsp_decoded info = NVSP_INITIALIZER(nvsp_decoded);
    EXPECT(NVSP_OK, nvsp_decode(decoder, bytes, size, 0, NULL, &info));
    CHECK(info.width == dive.camera.width && info.taken == 1 && info.damage == NVSP_OK);
    refuse(NVSP_ERR_REPLAYED, decoder, bytes, size);

    // On threads of their own, and both sides start again within the epoch.
    nvsp_keys vehicle = own, topside = own;
    vehicle.number = stats.next_number;
    topside.taken = info.taken;
    nvsp_encoder *again = keyed_encoder(&vehicle), *forgetful = keyed_encoder(&own);
    nvsp_decoder *remembers = new_decoder(&topside);
    MUST(encode(forgetful, bytes, sizeof bytes, &written, NULL));
    refuse(NVSP_ERR_REPLAYED, remembers, bytes, written);
    MUST(encode(again, bytes, sizeof bytes, &written, &stats));
    CHECK(stats.next_number == 2);
    EXPECT(NVSP_OK, nvsp_decode_begin(remembers, bytes, written, 0));
    EXPECT(NVSP_OK, nvsp_wait(remembers, 60000));
    EXPECT(NVSP_OK, nvsp_decode_finish(remembers, NULL, &info));
    CHECK(info.taken == 2);
    nvsp_destroy(again);
    nvsp_destroy(forgetful);
    nvsp_destroy(remembers);
    nvsp_destroy(encoder);
    nvsp_destroy(decoder);
}

// Number and tag are a part of the packet, by which the budget counts, and the bound, whatever tags take.
static void budgets_with_tags(void) {
    nvsp_keys keys = keys_with(own_key, 7);
    keys.tag_bytes = 16;
    nvsp_encoder *encoder = keyed_encoder(&keys);
    uint8_t bytes[4096];
    size_t written = 0;
    nvsp_frame_stats stats = NVSP_INITIALIZER(nvsp_frame_stats);
    MUST(encode(encoder, bytes, sizeof bytes, &written, NULL));
    for (size_t budget = LATENT + 18; budget < 1500; budget += 1 + budget / 3) {
        MUST(nvsp_encoder_set_rate(encoder, NVSP_RATE_BYTES, (float)budget));
        EXPECT(NVSP_OK, encode(encoder, bytes, budget, &written, &stats));
        CHECK(written <= budget && stats.bytes == written);
    }
    MUST(nvsp_encoder_set_rate(encoder, NVSP_RATE_BYTES, LATENT + 17));
    EXPECT(NVSP_ERR_BUDGET, encode(encoder, bytes, sizeof bytes, &written, NULL));
    CHECK(says(encoder, "37") && says(encoder, "38"));
    nvsp_destroy(encoder);
    const nvsp_camera *camera = &dive.camera;
    CHECK(nvsp_size_bound(NVSP_SIZE_PACKET, camera->width, camera->height) > 18 + packets[0].size);
}

// A packet that the topside has no memory for may come again; it is the same for a device that is lost.
static void no_memory(void) {
    const nvsp_keys keys = keys_with(own_key, 7);
    nvsp_engine_options options = patient_options();
    options.frame_size_limit = dive.camera.width * dive.camera.height - 1;
    rig small = {0};
    MUST(nvsp_engine_create(&options, &small.engine));
    MUST(nvsp_prior_open(small.engine, dive.prior, NULL, &small.prior));
    MUST(nvsp_decoder_create(small.engine, small.prior, &keys, &small.decoder));
    nvsp_encoder *encoder = keyed_encoder(&keys);
    uint8_t bytes[4096];
    size_t written = 0;
    MUST(encode(encoder, bytes, sizeof bytes, &written, NULL));
    for (int i = 0; i < 3; i++) {
        EXPECT(NVSP_ERR_MEMORY, nvsp_decode(small.decoder, bytes, written, 0, NULL, NULL));
        EXPECT(NVSP_OK, nvsp_decode_begin(small.decoder, bytes, written, 0));
        EXPECT(NVSP_OK, nvsp_wait(small.decoder, 60000));
        EXPECT(NVSP_ERR_MEMORY, nvsp_decode_finish(small.decoder, NULL, NULL));
    }
    nvsp_destroy(encoder);
    rig_close(&small);
}

// Keys that cannot be used: nothing is made.
static void refusals(void) {
    nvsp_decoder *made = NULL;
    uint8_t five[5 * NVSP_KEY_BYTES];
    memset(five, 0, sizeof five);
    for (uint32_t count = 0; count <= 5; count++) {
        // The keys are the same, which is refused, too.
        nvsp_keys keys = keys_with(five, 0);
        keys.count = count;
        const nvsp_status status = nvsp_decoder_create(both.engine, both.prior, &keys, &made);
        CHECK(status == (count == 1 ? NVSP_OK : NVSP_ERR_ARGUMENT));
        nvsp_destroy(count == 1 ? made : NULL);
    }
    made = NULL;
    for (uint32_t bytes = 0; bytes <= 17; bytes++) {
        nvsp_keys keys = keys_with(own_key, 0);
        keys.tag_bytes = bytes;
        const nvsp_status status = nvsp_decoder_create(both.engine, both.prior, &keys, &made);
        CHECK(status == (bytes == 1 || bytes == 17 ? NVSP_ERR_ARGUMENT : NVSP_OK));
        nvsp_destroy(status == NVSP_OK ? made : NULL);
    }
    made = NULL;
    nvsp_keys keys = keys_with(own_key, 0);
    keys.number = (uint64_t)1 << 48;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_create(both.engine, both.prior, &keys, &made));
    keys = keys_with(NULL, 0);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_create(both.engine, both.prior, &keys, &made));
    // An MTU that has no room for tags and a packet's bytes.
    keys = keys_with(own_key, 0);
    nvsp_vehicle *vehicle = NULL;
    nvsp_vehicle_options options = vehicle_with(&keys);
    options.mtu = 21;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_create(NULL, NULL, NULL, NULL, &options, &vehicle));
    options.mtu = 22;
    nvsp_destroy(new_vehicle(&options));
    // Without protection modem frames of 8 bytes will do, and on the other side always.
    options.flags = NVSP_LINK_UNPROTECTED;
    options.mtu = 13;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_create(NULL, NULL, NULL, NULL, &options, &vehicle));
    options.mtu = 14;
    nvsp_destroy(new_vehicle(&options));
    nvsp_topside *topside = NULL;
    nvsp_topside_options receives = topside_options(13);
    uint64_t memory = 77;
    receives.keys = &keys;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_create(NULL, NULL, &receives, &topside));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_memory(&receives, &memory));
    CHECK(memory == 77 && topside == NULL);
    receives.mtu = 14;
    nvsp_destroy(new_topside(&receives));
    keys.struct_size = 5;
    EXPECT(NVSP_ERR_STRUCTURE, nvsp_vehicle_create(NULL, NULL, NULL, NULL, &options, &vehicle));
    CHECK(made == NULL && vehicle == NULL);
}

int main(int argc, char **argv) {
    set_up(argc, argv);
    rig_add(&both, &dive.camera, NULL);
    encode_all(&both, &dive, packets);
    memset(own_key, 1, sizeof own_key);
    memset(other_key, 2, sizeof other_key);
    links();
    packets_without_a_modem();
    budgets_with_tags();
    no_memory();
    refusals();
    return tear_down();
}
