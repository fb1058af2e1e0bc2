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

static nvsp_sender *new_sender(const nvsp_keys *keys) {
    nvsp_sender *made = NULL;
    nvsp_sender_options options = NVSP_INITIALIZER(nvsp_sender_options);
    options.bit_rate = 40000;
    options.frame_rate = 4;
    options.flags = NVSP_SENDER_EXPECT_REPORTS;
    options.keys = keys;
    MUST(nvsp_sender_create(NVSP_MTU_64, &options, &made));
    return made;
}

static nvsp_collector *new_collector(const nvsp_keys *keys) {
    nvsp_collector *made = NULL;
    nvsp_collector_options options = NVSP_INITIALIZER(nvsp_collector_options);
    uint64_t memory = 0;
    options.keys = keys;
    MUST(nvsp_collector_memory(NVSP_MTU_64, &options, &memory));
    CHECK(memory > 0);
    MUST(nvsp_collector_create(NVSP_MTU_64, &options, &made));
    return made;
}

// Sends a packet; each modem frame must bring `status` at the collector. Returns how many they were.
static uint32_t send(nvsp_sender *sender, nvsp_collector *collector, const packet *packet, double now,
                     nvsp_status status, uint32_t *event) {
    uint8_t frame[64];
    size_t size = 0;
    uint32_t budget = 0, count = 0;
    nvsp_collected state = NVSP_INITIALIZER(nvsp_collected);
    MUST(nvsp_sender_plan(sender, now, &budget));
    MUST(nvsp_sender_push(sender, now, packet->bytes, packet->size, NULL, 0, NULL));
    while (nvsp_sender_next(sender, now + 1, frame, sizeof frame, &size) == NVSP_OK) {
        CHECK(size <= 64);
        EXPECT(status, nvsp_collector_push(collector, now, frame, size, &state));
        if (status == NVSP_OK) {
            *event = state.event;
            EXPECT(NVSP_ERR_REPLAYED, nvsp_collector_push(collector, now, frame, size, NULL));
        }
        frame[size / 2] ^= 4;
        EXPECT(NVSP_ERR_FOREIGN, nvsp_collector_push(collector, now, frame, size, NULL));
        count++;
    }
    return count;
}

static void links(void) {
    const nvsp_keys own = keys_with(own_key, 7), other = keys_with(other_key, 7), past = keys_with(own_key, 6);
    nvsp_sender *sender = new_sender(&own);
    nvsp_collector *collector = new_collector(&own);
    uint32_t event = 0;
    const uint32_t count = send(sender, collector, &packets[0], 0, NVSP_OK, &event);
    CHECK(event == NVSP_EVENT_COMPLETE || event == NVSP_EVENT_SURPLUS);
    uint8_t bytes[4096];
    size_t written = 0;
    EXPECT(NVSP_OK, nvsp_collector_fetch(collector, 0, 0, bytes, sizeof bytes, &written, NULL));
    CHECK(written == packets[0].size && memcmp(bytes, packets[0].bytes, written) == 0);

    nvsp_sender *strangers[] = {new_sender(&other), new_sender(&past), new_sender(NULL)};
    uint32_t strange = 0;
    for (size_t i = 0; i < 3; i++) {
        strange += send(strangers[i], collector, &packets[1], 0, NVSP_ERR_FOREIGN, &event);
        nvsp_sender_destroy(strangers[i]);
    }
    EXPECT(NVSP_ERR_STATE, nvsp_collector_fetch(collector, 0, 1, bytes, sizeof bytes, &written, NULL));
    nvsp_collector_statistics came = NVSP_INITIALIZER(nvsp_collector_statistics);
    MUST(nvsp_collector_get_statistics(collector, &came));
    CHECK(came.accepted == count && came.replayed == count && came.foreign == count + 2 * strange);
    CHECK(came.rejected == 0 && came.taken[0] == count && came.taken[1] == 0 && came.next_number == 0);

    // Reports, the other way.
    uint8_t report[64];
    nvsp_processed_report processed = NVSP_INITIALIZER(nvsp_processed_report);
    MUST(nvsp_collector_report(collector, 0, NULL, 0, (const uint8_t *)"user", 4, report, sizeof report, &written));
    EXPECT(NVSP_OK, nvsp_sender_process_report(sender, 1, report, written, &processed));
    CHECK(processed.user_bytes == 4 && memcmp(report + processed.user_offset, "user", 4) == 0);
    EXPECT(NVSP_ERR_REPLAYED, nvsp_sender_process_report(sender, 1, report, written, &processed));
    report[written - 1] ^= 1;
    EXPECT(NVSP_ERR_FOREIGN, nvsp_sender_process_report(sender, 1, report, written, &processed));
    CHECK(says(sender, "no key"));
    nvsp_sender_statistics sent = NVSP_INITIALIZER(nvsp_sender_statistics);
    MUST(nvsp_sender_get_statistics(sender, &sent));
    CHECK(sent.foreign == 1 && sent.replayed == 1 && sent.next_number == count && sent.taken[0] == 1);

    // Both sides start again within the epoch.
    nvsp_keys vehicle = own, topside = own;
    vehicle.number = sent.next_number;
    memcpy(topside.taken, came.taken, sizeof topside.taken);
    nvsp_sender *again = new_sender(&vehicle), *forgetful = new_sender(&own);
    nvsp_collector *remembers = new_collector(&topside);
    send(forgetful, remembers, &packets[0], 0, NVSP_ERR_REPLAYED, &event);
    CHECK(send(again, remembers, &packets[1], 0, NVSP_OK, &event) > 0);
    nvsp_sender_destroy(sender);
    nvsp_sender_destroy(again);
    nvsp_sender_destroy(forgetful);
    nvsp_collector_destroy(collector);
    nvsp_collector_destroy(remembers);
}

// A packet in a file, say.
static void packets_without_a_modem(void) {
    const nvsp_keys keys = keys_with(own_key, 7);
    nvsp_authenticator *authenticator = NULL;
    nvsp_verifier *verifier = NULL, *reports = NULL;
    MUST(nvsp_authenticator_create(&keys, NVSP_CONTENT_PACKET, &authenticator));
    MUST(nvsp_verifier_create(&keys, NVSP_CONTENT_PACKET, &verifier));
    MUST(nvsp_verifier_create(&keys, NVSP_CONTENT_REPORT, &reports));
    uint8_t bytes[4096];
    size_t written = 0, offset = 77;
    const size_t size = packets[0].size;
    EXPECT(NVSP_ERR_BUFFER_TOO_SMALL,
           nvsp_authenticate(authenticator, 0, packets[0].bytes, size, bytes, size + 5, &written));
    CHECK(written == size + 6);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_authenticate(authenticator, 4, packets[0].bytes, size, bytes, 4096, &written));
    uint64_t number = 77;
    EXPECT(NVSP_OK, nvsp_authenticator_next_number(authenticator, &number));
    CHECK(number == 0);
    EXPECT(NVSP_OK, nvsp_authenticate(authenticator, 0, packets[0].bytes, size, bytes, size + 6, &written));
    EXPECT(NVSP_ERR_FOREIGN, nvsp_verify(reports, bytes, written, &offset));
    for (size_t cut = 0; cut < written; cut++) {
        EXPECT(NVSP_ERR_FOREIGN, nvsp_verify(verifier, bytes, cut, &offset));
    }
    CHECK(offset == 77);
    EXPECT(NVSP_OK, nvsp_verify(verifier, bytes, written, &offset));
    CHECK(offset == 6 && memcmp(bytes + offset, packets[0].bytes, size) == 0);
    EXPECT(NVSP_ERR_REPLAYED, nvsp_verify(verifier, bytes, written, &offset));
    nvsp_authenticator_destroy(authenticator);
    nvsp_verifier_destroy(verifier);
    nvsp_verifier_destroy(reports);
}

// Keys that cannot be used: nothing is made.
static void refusals(void) {
    nvsp_verifier *made = NULL;
    uint8_t five[5 * NVSP_KEY_BYTES];
    memset(five, 0, sizeof five);
    for (uint32_t count = 0; count <= 5; count++) {
        // The keys are the same, which is refused, too.
        nvsp_keys keys = keys_with(five, 0);
        keys.count = count;
        const nvsp_status status = nvsp_verifier_create(&keys, NVSP_CONTENT_FRAME, &made);
        CHECK(status == (count == 1 ? NVSP_OK : NVSP_ERR_ARGUMENT));
        nvsp_verifier_destroy(count == 1 ? made : NULL);
    }
    made = NULL;
    for (uint32_t bytes = 0; bytes <= 17; bytes++) {
        nvsp_keys keys = keys_with(own_key, 0);
        keys.tag_bytes = bytes;
        const nvsp_status status = nvsp_verifier_create(&keys, NVSP_CONTENT_FRAME, &made);
        CHECK(status == (bytes == 1 || bytes == 17 ? NVSP_ERR_ARGUMENT : NVSP_OK));
        nvsp_verifier_destroy(status == NVSP_OK ? made : NULL);
    }
    made = NULL;
    nvsp_keys keys = keys_with(own_key, 0);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_verifier_create(&keys, 4, &made));
    keys.number = (uint64_t)1 << 48;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_verifier_create(&keys, NVSP_CONTENT_FRAME, &made));
    keys = keys_with(NULL, 0);
    EXPECT(NVSP_ERR_NULL, nvsp_verifier_create(&keys, NVSP_CONTENT_FRAME, &made));
    // An MTU that has no room for tags and shares.
    nvsp_sender *sender = NULL;
    nvsp_sender_options options = NVSP_INITIALIZER(nvsp_sender_options);
    keys = keys_with(own_key, 0);
    options.bit_rate = 40000;
    options.frame_rate = 4;
    options.keys = &keys;
    EXPECT(NVSP_ERR_MODEM, nvsp_sender_create(21, &options, &sender));
    EXPECT(NVSP_OK, nvsp_sender_create(22, &options, &sender));
    nvsp_sender_destroy(sender);
    sender = NULL;
    // Without protection modem frames of 8 bytes will do, and on the other side always.
    options.flags = NVSP_SENDER_UNPROTECTED;
    EXPECT(NVSP_ERR_MODEM, nvsp_sender_create(13, &options, &sender));
    EXPECT(NVSP_OK, nvsp_sender_create(14, &options, &sender));
    nvsp_sender_destroy(sender);
    sender = NULL;
    nvsp_collector *collector = NULL;
    nvsp_collector_options collects = NVSP_INITIALIZER(nvsp_collector_options);
    uint64_t memory = 77;
    collects.keys = &keys;
    EXPECT(NVSP_ERR_MODEM, nvsp_collector_create(13, &collects, &collector));
    EXPECT(NVSP_ERR_MODEM, nvsp_collector_memory(13, &collects, &memory));
    CHECK(memory == 77 && collector == NULL);
    EXPECT(NVSP_OK, nvsp_collector_create(14, &collects, &collector));
    nvsp_collector_destroy(collector);
    keys.struct_size = 5;
    EXPECT(NVSP_ERR_STRUCT_SIZE, nvsp_sender_create(NVSP_MTU_64, &options, &sender));
    CHECK(made == NULL && sender == NULL);
}

int main(int argc, char **argv) {
    set_up(argc, argv);
    rig_add(&both, &dive.camera, NULL);
    encode_all(&both, &dive, packets);
    memset(own_key, 1, sizeof own_key);
    memset(other_key, 2, sizeof other_key);
    links();
    packets_without_a_modem();
    refusals();
    return tear_down();
}
