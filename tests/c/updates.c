// Updates of the prior: from a vehicle over a link to a topside, which then shows what the vehicle saw.

#define NVSP_NO_ATTRIBUTES  // NULL is tested, too.

#include "common.h"

#include <math.h>
#include <nvsprior_extra.h>

#define MTU 64
#define UPDATES 2

static packet updates[UPDATES];

static void read_updates(const char *folder) {
    for (int k = 0; k < UPDATES; k++) {
        char path[600];
        snprintf(path, sizeof path, "%s/update-%d.nvsu", folder, k + 1);
        updates[k].bytes = read_all(path, &updates[k].size);
    }
}

// Opens the prior with room for updates, and both ends on it.
static void open_for_updates(void) {
    nvsp_engine_options options = patient_options();
    nvsp_prior_options prior = NVSP_INITIALIZER(nvsp_prior_options);
    prior.given = NVSP_PRIOR_UPDATES;
    MUST(nvsp_engine_create(&options, &both.engine));
    MUST(nvsp_prior_open(both.engine, dive.prior, &prior, &both.prior));
    rig_add(&both, &dive.camera, NULL);
}

// Encodes a frame, and has a decoder show it. Returns what that says; the picture is the vehicle's if `same`.
static nvsp_decoded show(nvsp_encoder *encoder, nvsp_decoder *decoder, int frame, int same) {
    uint8_t bytes[8192];
    size_t size = 0;
    uint8_t *vehicle = malloc(dive.size), *topside = malloc(dive.size);
    const nvsp_image image = scene_image(&dive, frame);
    nvsp_decoded decoded = NVSP_INITIALIZER(nvsp_decoded);
    MUST(nvsp_encode(encoder, &image, with_hint(&dive.poses[frame]), bytes, sizeof bytes, &size, NULL));
    nvsp_picture place = place_of(vehicle, dive.camera.width, dive.camera.height);
    MUST(nvsp_encoder_get_picture(encoder, NVSP_PICTURE_SHOWN, &place));
    place = place_of(topside, dive.camera.width, dive.camera.height);
    EXPECT(NVSP_OK, nvsp_decode(decoder, bytes, size, 0, &place, &decoded));
    CHECK((memcmp(vehicle, topside, dive.size) == 0) == same);
    free(vehicle);
    free(topside);
    return decoded;
}

static uint32_t newest(nvsp_encoder *encoder) {
    nvsp_learning learning = NVSP_INITIALIZER(nvsp_learning);
    EXPECT(NVSP_OK, nvsp_encoder_get_learning(encoder, &learning));
    CHECK(learning.newest == 0 || learning.splats > 0);
    return learning.newest;
}

// A topside without an update says so, and adds no difference to the wrong render.
static void check_missing(void) {
    uint32_t number = 0;
    CHECK(newest(both.encoder) == 0);
    nvsp_decoded decoded = show(both.encoder, both.decoder, 0, 1);
    CHECK((decoded.flags & NVSP_DECODED_UPDATE_MISSING) == 0 && decoded.missing_update == 0);
    EXPECT(NVSP_OK, nvsp_encoder_add_update(both.encoder, updates[0].bytes, updates[0].size));
    CHECK(newest(both.encoder) == 1);
    decoded = show(both.encoder, both.decoder, 1, 0);
    CHECK((decoded.flags & NVSP_DECODED_UPDATE_MISSING) != 0 && decoded.missing_update == 1);
    CHECK(decoded.rows == 0 && decoded.damage == NVSP_ERR_UPDATE);
    // The second one alone does not help.
    EXPECT(NVSP_ERR_UPDATE, nvsp_decoder_add_update(both.decoder, updates[1].bytes, updates[1].size, &number));
    EXPECT(NVSP_OK, nvsp_decoder_add_update(both.decoder, updates[0].bytes, updates[0].size, &number));
    CHECK(number == 1);
    decoded = show(both.encoder, both.decoder, 2, 1);
    CHECK((decoded.flags & NVSP_DECODED_UPDATE_MISSING) == 0 && decoded.damage == NVSP_OK);
}

static void check_refused(void) {
    uint32_t number = 0;
    size_t written = 0;
    uint8_t byte = 0;
    nvsp_prior *plain = NULL;
    nvsp_decoder *decoder = NULL;
    packet *update = &updates[1];
    EXPECT(NVSP_ERR_NULL, nvsp_decoder_add_update(both.decoder, NULL, 1, &number));
    EXPECT(NVSP_ERR_NULL, nvsp_decoder_add_update(both.decoder, update->bytes, update->size, NULL));
    EXPECT(NVSP_ERR_NULL, nvsp_encoder_add_update(NULL, update->bytes, update->size));
    EXPECT(NVSP_ERR_NULL, nvsp_encoder_get_learning(both.encoder, NULL));
    EXPECT(NVSP_ERR_UPDATE, nvsp_decoder_add_update(both.decoder, update->bytes, update->size - 1, &number));
    for (size_t at = 0; at < update->size; at++) {
        update->bytes[at] ^= 0x40;
        const nvsp_status status = nvsp_decoder_add_update(both.decoder, update->bytes, update->size, &number);
        CHECK(status == NVSP_ERR_UPDATE || status == NVSP_ERR_NEWER);
        update->bytes[at] ^= 0x40;
    }
    CHECK(number == 0);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_adopt_update(both.encoder, 65536));
    EXPECT(NVSP_ERR_NULL, nvsp_encoder_take_update(both.encoder, NULL, 0, &written));
    const nvsp_status taken = nvsp_encoder_take_update(both.encoder, &byte, 1, &written);
    CHECK(taken == NVSP_PENDING || taken == NVSP_ERR_UNSUPPORTED);
    // A prior without room.
    MUST(nvsp_prior_open(both.engine, dive.prior, NULL, &plain));
    MUST(nvsp_decoder_create(both.engine, plain, &decoder));
    EXPECT(NVSP_ERR_STATE, nvsp_decoder_add_update(decoder, updates[0].bytes, updates[0].size, &number));
    CHECK(says(decoder, "room"));
    nvsp_decoder_destroy(decoder);
    nvsp_prior_destroy(plain);
}

static void check_options(void) {
    nvsp_sender *sender = NULL;
    nvsp_collector *collector = NULL;
    nvsp_sender_options options = NVSP_INITIALIZER(nvsp_sender_options);
    options.bit_rate = 20000;
    options.frame_rate = 3;
    options.update_share = 0.5;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_create(MTU, &options, &sender));
    options.flags = NVSP_SENDER_UPDATES;
    options.update_share = 1;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_create(MTU, &options, &sender));
    options.update_share = 0;
    options.reserved = 1;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_create(MTU, &options, &sender));
    options.reserved = 0;
    options.flags = 0;
    MUST(nvsp_sender_create(MTU, &options, &sender));
    EXPECT(NVSP_ERR_STATE, nvsp_sender_push_update(sender, 0, updates[0].bytes, updates[0].size));
    double price = 0;
    EXPECT(NVSP_ERR_STATE, nvsp_sender_update_price(sender, &price));
    nvsp_sender_destroy(sender);
    nvsp_collector_options own = NVSP_INITIALIZER(nvsp_collector_options);
    own.reserved = 1;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_create(MTU, &own, &collector));
}

static nvsp_sender *sender;
static nvsp_collector *collector;
static nvsp_decoder *decoder;  // Another topside than that of `both`.

static void open_link(uint32_t flags) {
    nvsp_sender_options options = NVSP_INITIALIZER(nvsp_sender_options);
    options.bit_rate = 20000;
    options.frame_rate = 3;
    options.loss = 0.2;
    options.flags = flags;
    nvsp_collector_options own = NVSP_INITIALIZER(nvsp_collector_options);
    own.update_bytes = 4000;
    MUST(nvsp_sender_create(MTU, &options, &sender));
    MUST(nvsp_collector_create(MTU, &own, &collector));
    MUST(nvsp_decoder_create(both.engine, both.prior, &decoder));
}

static void close_link(void) {
    nvsp_decoder_destroy(decoder);
    nvsp_collector_destroy(collector);
    nvsp_sender_destroy(sender);
}

// Both updates over a link that loses every seventh modem frame.
static void check_link(void) {
    open_link(NVSP_SENDER_UPDATES);
    uint32_t held = 0, added = 0, frames = 0;
    EXPECT(NVSP_PENDING, nvsp_sender_held_update(sender, &held));
    EXPECT(NVSP_ERR_NULL, nvsp_sender_held_update(sender, NULL));
    double price = 0;
    EXPECT(NVSP_ERR_NULL, nvsp_sender_update_price(sender, NULL));
    EXPECT(NVSP_OK, nvsp_sender_update_price(sender, &price));
    CHECK(price >= 1 && price < 10);
    EXPECT(NVSP_ERR_NULL, nvsp_sender_push_update(sender, 0, NULL, 1));
    EXPECT(NVSP_ERR_NULL, nvsp_collector_fetch_update(collector, 0, NULL, 1, NULL));
    EXPECT(NVSP_ERR_UPDATE, nvsp_sender_push_update(sender, 0, updates[0].bytes, updates[0].size - 1));
    for (int k = 0; k < UPDATES; k++) {
        MUST(nvsp_sender_push_update(sender, 0, updates[k].bytes, updates[k].size));
    }
    for (double now = 0; now < 30 && added < UPDATES; now += 0.02) {
        uint8_t frame[MTU], update[4000];
        size_t size = 0;
        while (nvsp_sender_next(sender, now, frame, sizeof frame, &size) == NVSP_OK) {
            nvsp_collected state = NVSP_INITIALIZER(nvsp_collected);
            if (frames++ % 7 == 3) {
                continue;
            }
            EXPECT(NVSP_OK, nvsp_collector_push(collector, now, frame, size, &state));
            if (state.event != NVSP_EVENT_UPDATE) {
                continue;
            }
            while (nvsp_collector_fetch_update(collector, state.stream, update, sizeof update, &size) == NVSP_OK) {
                uint32_t number = 0;
                const nvsp_status status = nvsp_decoder_add_update(decoder, update, size, &number);
                CHECK(status == NVSP_OK && number == ++added);
                EXPECT(NVSP_OK, nvsp_collector_settle_update(collector, state.stream, status == NVSP_OK));
            }
        }
    }
    CHECK(added == UPDATES);
    EXPECT(NVSP_OK, nvsp_sender_held_update(sender, &held));
    CHECK(held >= 1);
    size_t none = 0;
    uint8_t byte;
    EXPECT(NVSP_PENDING, nvsp_collector_fetch_update(collector, 0, &byte, 1, &none));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_settle_update(collector, 4, 1));
    // The vehicle draws with both from here on.
    EXPECT(NVSP_OK, nvsp_encoder_add_update(both.encoder, updates[1].bytes, updates[1].size));
    CHECK(newest(both.encoder) == 2);
    EXPECT(NVSP_OK, nvsp_encoder_announce(both.encoder));
    const nvsp_decoded decoded = show(both.encoder, decoder, 3, 1);
    CHECK((decoded.flags & NVSP_DECODED_UPDATE_MISSING) == 0);
    close_link();
}

// With reports: the vehicle knows of an update once the topside has told that it holds it.
static void check_reports(void) {
    open_link(NVSP_SENDER_UPDATES | NVSP_SENDER_EXPECT_REPORTS);
    uint8_t frame[MTU], packet[8192], update[4000], report[256];
    uint32_t budget = 0, number = 0, added = 0;
    size_t size = 0, length = 0;
    const nvsp_image image = scene_image(&dive, 0);
    MUST(nvsp_sender_plan(sender, 0, &budget));
    EXPECT(NVSP_OK, nvsp_encoder_set_rate(both.encoder, NVSP_RATE_BYTES, (float)budget));
    MUST(nvsp_encode(both.encoder, &image, with_hint(&dive.poses[0]), packet, sizeof packet, &size, NULL));
    MUST(nvsp_sender_push(sender, 0, packet, size, NULL, 0, NULL));
    for (int k = 0; k < UPDATES; k++) {
        MUST(nvsp_sender_push_update(sender, 0, updates[k].bytes, updates[k].size));
    }
    for (double now = 0; now < 30 && added < UPDATES; now += 0.1) {
        while (nvsp_sender_next(sender, now, frame, sizeof frame, &size) == NVSP_OK) {
            EXPECT(NVSP_OK, nvsp_collector_push(collector, now, frame, size, NULL));
        }
        while (nvsp_collector_fetch_update(collector, 0, update, sizeof update, &size) == NVSP_OK) {
            EXPECT(NVSP_OK, nvsp_decoder_add_update(decoder, update, size, &number));
            EXPECT(NVSP_OK, nvsp_collector_settle_update(collector, 0, 1));
            added++;
            CHECK(nvsp_sender_held_update(sender, &number) == (added > 1 ? NVSP_OK : NVSP_PENDING));
        }
        if (nvsp_collector_report(collector, 0, NULL, 0, NULL, 0, report, sizeof report, &size) == NVSP_OK) {
            nvsp_processed_report processed = NVSP_INITIALIZER(nvsp_processed_report);
            EXPECT(NVSP_OK, nvsp_decoder_tell_updates(decoder, report, size, sizeof report, &length));
            CHECK(length >= size);
            EXPECT(NVSP_OK, nvsp_sender_process_report(sender, now, report, length, &processed));
        }
    }
    CHECK(added == UPDATES);
    EXPECT(NVSP_OK, nvsp_sender_held_update(sender, &number));
    CHECK(number == UPDATES);
    MUST(nvsp_collector_report(collector, 0, NULL, 0, NULL, 0, report, sizeof report, &size));
    EXPECT(NVSP_ERR_NULL, nvsp_decoder_tell_updates(decoder, NULL, size, sizeof report, &length));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_tell_updates(decoder, report, sizeof report + 1, sizeof report, &length));
    EXPECT(NVSP_ERR_MODEM, nvsp_decoder_tell_updates(decoder, report, size - 1, sizeof report, &length));
    close_link();
}

// An encoder that learns sees nothing new on a wall that it knows; a library that does not learn says so.
static void check_learning(void) {
    nvsp_encoder *encoder = NULL;
    nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
    options.learn = 8;
    const nvsp_status made = nvsp_encoder_create(both.engine, both.prior, &dive.camera, &options, &encoder);
    if (made == NVSP_ERR_UNSUPPORTED) {
        CHECK(encoder == NULL && says(both.engine, "training"));
        return;
    }
    EXPECT(NVSP_OK, made);
    uint8_t *update = malloc(NVSP_UPDATE_BYTES);
    for (int frame = 0; frame < dive.frames; frame++) {
        size_t size = 0;
        show(encoder, both.decoder, frame, 1);
        EXPECT(NVSP_OK, nvsp_encoder_learn(encoder, 1));
        EXPECT(NVSP_OK, nvsp_encoder_learn(encoder, 1));
        EXPECT(NVSP_PENDING, nvsp_encoder_take_update(encoder, update, NVSP_UPDATE_BYTES, &size));
    }
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_learn(encoder, 0.5));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_learn(encoder, NAN));
    EXPECT(NVSP_PENDING, nvsp_encoder_adopt_update(encoder, 1));
    EXPECT(NVSP_OK, nvsp_encoder_drop_update(encoder));
    free(update);
    nvsp_encoder_destroy(encoder);
}

int main(int argc, char **argv) {
    read_dive(argc, argv);
    read_updates(argv[1]);
    open_for_updates();
    check_missing();
    check_refused();
    check_options();
    check_link();
    check_reports();
    check_learning();
    for (int k = 0; k < UPDATES; k++) {
        free(updates[k].bytes);
    }
    return tear_down();
}
