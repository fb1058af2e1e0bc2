// Both ends of a link that loses, swaps, repeats, pads, cuts and damages modem frames: packets, then pictures.

#define _GNU_SOURCE

#include "common.h"

#include <math.h>
#include <nvsprior_extra.h>
#include <unistd.h>

#if defined(__has_feature)
#if __has_feature(address_sanitizer)
#define SANITIZED 1
#endif
#endif
#ifndef SANITIZED
#define SANITIZED 0
#endif

#define MTU 64
#define MAX_PACKET 4096
#define RATE 20000.0
// The camera's frames, of which every seventh is sent.
#define FRAMES_A_SECOND 105.0

static uint64_t seed = 1;

// A packet like one that was encoded, with another frame number and another payload of at most `budget` bytes in all;
// docs/format/packet.md has the format.
static size_t numbered(uint8_t *bytes, uint32_t frame, size_t budget) {
    const size_t most = budget < 150 ? budget : 150;
    const packet *like = &packets[1];
    CHECK((like->bytes[0] & 0x1f) == 0);
    memcpy(bytes, like->bytes, LATENT);
    bytes[0] = 3 << 5;  // A payload of no stream, and nothing else.
    bytes[1] &= 3 << 4;
    bytes[2] = (uint8_t)frame;
    bytes[3] = (uint8_t)(frame >> 8);
    seal_latent(bytes, LATENT);
    for (size_t i = LATENT + 2; i < most; i++) {
        bytes[i] = (uint8_t)random_bits(&seed);
    }
    bytes[most - 1] |= 1;  // A zero would be padding.
    seal_residual(bytes, LATENT, most);
    return most;
}

// Bytes that the process has in memory.
static size_t resident(void) {
    FILE *file = fopen("/proc/self/statm", "r");
    unsigned long all = 0, pages = 0;
    if (file == NULL || fscanf(file, "%lu %lu", &all, &pages) != 2) {
        give_up("no /proc/self/statm");
    }
    fclose(file);
    return pages * (size_t)sysconf(_SC_PAGESIZE);
}

// Modem frames that are to arrive after those sent behind them.
static uint8_t late[16][MTU];
static size_t late_sizes[16], late_count;
static double late_since[16];
// Seconds that one is held back at most. 128 frames later its number would mean another frame.
#define LATEST 0.4

typedef struct tally {
    long packets, whole, fetched, refused;
} tally;

// The packets of the last frames, as they were sent.
#define KEPT 512
static uint8_t sent_bytes[KEPT][MAX_PACKET];
static size_t sent_sizes[KEPT];
static uint32_t sent_frames[KEPT];

// What the topside gives must be the start of the packet of this frame number, and of no other.
static void check_packets(nvsp_topside *topside, double now, tally *all) {
    uint8_t bytes[MAX_PACKET];
    size_t size = 0;
    nvsp_decoded shown = NVSP_INITIALIZER(nvsp_decoded);
    while (nvsp_topside_packet(topside, now, bytes, sizeof bytes, &size, &shown) == NVSP_OK) {
        const uint32_t at = (uint32_t)shown.frame % KEPT;
        CHECK(sent_frames[at] == (uint32_t)shown.frame && size == shown.bytes && size <= sent_sizes[at]);
        CHECK(memcmp(bytes, sent_bytes[at], size) == 0);
        CHECK(((shown.flags & NVSP_DECODED_WHOLE) != 0) == (size == sent_sizes[at]) && shown.arrived <= shown.sent);
        all->whole += (shown.flags & NVSP_DECODED_WHOLE) != 0;
        all->fetched++;
    }
}

static void deliver(nvsp_topside *topside, double now, const uint8_t *frame, size_t size, int held_back, tally *all) {
    uint8_t padded[MTU + 20];
    memset(padded, 0xee, sizeof padded);
    memcpy(padded, frame, size);
    const size_t length = random_below(&seed, 2) ? size : sizeof padded;
    const nvsp_status status = nvsp_topside_receive(topside, now, padded, length);
    if (status != NVSP_OK) {
        // Held back for so long that the packet has gone by.
        CHECK(held_back && status == NVSP_ERR_PACKET && says(topside, "newer one took its place"));
        all->refused++;
    }
    check_packets(topside, now, all);
}

// A copy that is cut, or has flipped bits, is refused and changes nothing.
static void damage(nvsp_topside *topside, double now, const uint8_t *frame, size_t size, tally *all) {
    uint8_t *copy = malloc(size);  // No larger: a memory checker sees more.
    size_t left = size;
    memcpy(copy, frame, size);
    if (random_below(&seed, 2)) {
        left = random_below(&seed, (uint32_t)size);
    } else {
        for (uint32_t flips = random_below(&seed, 2) + 1; flips > 0; flips--) {
            copy[random_below(&seed, (uint32_t)size)] ^= (uint8_t)(1u << random_below(&seed, 8));
        }
    }
    if (memcmp(copy, frame, size) != 0 || left < size) {
        uint8_t *cut = malloc(left > 0 ? left : 1);
        memcpy(cut, copy, left);
        const nvsp_status status = nvsp_topside_receive(topside, now, cut, left);
        // One flipped bit makes it look like one without protection, whose packet may be yet to come.
        CHECK(status == NVSP_ERR_PACKET || (left > 0 && copy[0] >> 6 == 3));
        all->refused += status == NVSP_ERR_PACKET;
        check_packets(topside, now, all);
        free(cut);
    }
    free(copy);
}

static void carry(nvsp_topside *topside, double now, const uint8_t *frame, size_t size, tally *all) {
    const uint32_t luck = random_below(&seed, 100);
    if (luck < 20) {
        return;  // Lost.
    }
    if (luck < 30 && late_count < 16) {
        memcpy(late[late_count], frame, size);
        late_since[late_count] = now;
        late_sizes[late_count++] = size;
        return;
    }
    if (luck < 35) {
        damage(topside, now, frame, size, all);
    }
    deliver(topside, now, frame, size, 0, all);
    if (luck < 45) {
        deliver(topside, now, frame, size, 0, all);
    }
    if (late_count > 0 && luck % 4 == 0) {
        const uint32_t which = random_below(&seed, (uint32_t)late_count);
        if (now - late_since[which] < LATEST) {
            deliver(topside, now, late[which], late_sizes[which], 1, all);
        }
        late_count--;
        memcpy(late[which], late[late_count], MTU);
        late_sizes[which] = late_sizes[late_count];
        late_since[which] = late_since[late_count];
    }
}

// 10,000 packets at 20 % loss, with modem frames swapped, repeated, padded, cut and damaged. No packet is taken for
// another, and no memory is taken after the first ones.
static void long_run(void) {
    nvsp_vehicle_options options = vehicle_options(MTU, RATE, FRAMES_A_SECOND);
    options.picture_rate = FRAMES_A_SECOND / 7;
    options.latency = 0.8;
    options.delay = NVSP_NONE;
    options.loss = 0.2;
    options.flags = NVSP_LINK_NO_REPORTS;
    nvsp_topside_options receives = topside_options(MTU);
    receives.age = 1.1;
    receives.flags = NVSP_LINK_NO_REPORTS;
    nvsp_vehicle *vehicle = new_vehicle(&options);
    nvsp_topside *topside = new_topside(&receives);
    // So many that the numbers in packets begin anew on the way.
    const long frames = few() ? 3000 : 73500, warm = few() ? 1500 : 7000;
    tally all = {0, 0, 0, 0};
    size_t before = 0;
    double free_at = 0, now = 0;
    for (long k = 0; k < frames; k++) {
        now = (double)k / FRAMES_A_SECOND;
        uint32_t budget = 0, frame = 0;
        const nvsp_status planned = nvsp_vehicle_plan(vehicle, now, now, &frame, &budget);
        CHECK(planned == NVSP_OK || planned == NVSP_PENDING);
        if (planned == NVSP_OK) {
            const uint32_t at = frame % KEPT;
            CHECK(frame == (uint32_t)k && budget >= 40 && budget < MAX_PACKET);
            sent_frames[at] = frame;
            sent_sizes[at] = numbered(sent_bytes[at], frame, budget);
            EXPECT(NVSP_OK, nvsp_vehicle_packet(vehicle, now, sent_bytes[at], sent_sizes[at], NULL, 0));
            all.packets++;
        }
        uint8_t bytes[MTU];
        size_t size = 0;
        while (free_at <= now && nvsp_vehicle_transmit(vehicle, now, MTU, bytes, &size, NULL) == NVSP_OK) {
            free_at = (free_at > now - 0.01 ? free_at : now) + 8.0 * (double)size / RATE;
            carry(topside, now, bytes, size, &all);
        }
        if (k == warm) {
            before = resident();
        }
    }
    const size_t after = resident();
    nvsp_vehicle_statistics sent = NVSP_INITIALIZER(nvsp_vehicle_statistics);
    nvsp_topside_statistics came = NVSP_INITIALIZER(nvsp_topside_statistics);
    EXPECT(NVSP_OK, nvsp_vehicle_get_statistics(vehicle, &sent));
    EXPECT(NVSP_OK, nvsp_topside_get_statistics(topside, &came));
    const double loss = 1 - (double)came.arrived / (double)came.sent;
    printf("%ld packets, %llu modem frames: %llu whole, %llu of them with losses; %ld fetched, %ld refused; loss %.3f; "
           "%ld bytes of memory more\n",
           all.packets, (unsigned long long)sent.shares, (unsigned long long)came.completed,
           (unsigned long long)came.repaired, all.fetched, all.refused, loss, (long)after - (long)before);
    CHECK(few() || all.packets >= 9000);
    CHECK((long)sent.packets == all.packets && (long)sent.left_out == frames - all.packets && sent.cut == 0);
    CHECK((long)came.rejected == all.refused && came.damaged == 0);
    // Some of those that were held back never came.
    CHECK(loss > 0.15 && loss < 0.3);
    CHECK(all.fetched > all.packets * 8 / 10 && all.whole > all.packets * 6 / 10);
    CHECK((long)came.completed > all.packets * 6 / 10 && came.repaired > came.completed / 4);
    // The program's own memory may shrink and grow by some pages. Memory checkers keep what it has freed.
    CHECK(after <= before + (64 << 10) || few() || SANITIZED);
    nvsp_destroy(vehicle);
    nvsp_destroy(topside);
}

// What both ends told.
typedef struct told {
    uint32_t heard, stores, users, frames, asked, regions, refused;
    nvsp_event state, region, user;
} told;

static void note(const nvsp_event *event, told *told) {
    told->heard += event->kind == NVSP_EVENT_HEARD;
    told->asked += event->kind == NVSP_EVENT_ASKED;
    told->refused += event->kind == NVSP_EVENT_REFUSED;
    if (event->kind == NVSP_EVENT_FRAME) {
        CHECK(event->status == NVSP_OK && event->bytes > 20 && event->certain == 1 && event->value > 20);
        told->frames++;
    }
    if (event->kind == NVSP_EVENT_STORE) {
        told->stores++;
        told->state = *event;
    }
    if (event->kind == NVSP_EVENT_REGION) {
        told->regions++;
        told->region = *event;
    }
    if (event->kind == NVSP_EVENT_USER) {
        told->users++;
        told->user = *event;
    }
}

static void drain(nvsp_vehicle *vehicle, nvsp_topside *topside, told *up, told *down) {
    nvsp_event event = NVSP_INITIALIZER(nvsp_event);
    while (nvsp_vehicle_event(vehicle, &event) == NVSP_OK) {
        note(&event, up);
    }
    while (nvsp_topside_event(topside, &event) == NVSP_OK) {
        note(&event, down);
    }
}

// Frames in, pictures out. One modem frame in six is lost, and one report in four.
static uint32_t show_all(nvsp_vehicle *vehicle, nvsp_topside *topside, double *now, int frames, told *up, told *down) {
    uint8_t *pixels = malloc(dive.size), bytes[MTU];
    uint32_t pictures = 0;
    int64_t last = -1;
    for (int k = 0; k < frames; k++, *now += 0.25) {
        const int turn = k % (2 * dive.frames - 2), at = turn < dive.frames ? turn : 2 * dive.frames - 2 - turn;
        const nvsp_image image = scene_image(&dive, at);
        const nvsp_pose *hint = k == 0 ? &dive.poses[0] : NULL;
        const nvsp_status taken =
            nvsp_vehicle_frame(vehicle, *now, &image, with_hint(hint), (const uint8_t *)"depth", 5);
        CHECK(taken == NVSP_OK || taken == NVSP_PENDING);
        if (taken == NVSP_OK) {
            EXPECT(NVSP_OK, nvsp_wait(vehicle, 60000));
        }
        size_t size = 0;
        double next = 0;
        for (double then = *now; then < *now + 0.25; then += 0.01) {
            while (nvsp_vehicle_transmit(vehicle, then, MTU, bytes, &size, &next) == NVSP_OK) {
                if (random_below(&seed, 6) > 0) {
                    CHECK(nvsp_topside_receive(topside, then, bytes, size) == NVSP_OK);
                }
            }
            CHECK(next > then);
            nvsp_picture place = place_of(pixels, dive.camera.width, dive.camera.height);
            nvsp_decoded shown = NVSP_INITIALIZER(nvsp_decoded);
            nvsp_status status;
            do {
                status = nvsp_topside_picture(topside, then, &place, &shown);
            } while (status == NVSP_PENDING && nvsp_wait(topside, 60000) == NVSP_OK);
            CHECK(status == NVSP_OK || status == NVSP_PENDING);
            if (status == NVSP_OK) {
                const int seen = (int)shown.frame % (2 * dive.frames - 2);
                const int like = seen < dive.frames ? seen : 2 * dive.frames - 2 - seen;
                CHECK(shown.width == dive.camera.width && shown.bytes > 0 && shown.arrived > 0 && shown.age >= 0);
                // A frame that was on its way when the decoder was given anew lacks its reference.
                const int lacks = k == 0 && shown.damage == NVSP_ERR_REFERENCE;
                CHECK(shown.old >= 3 && (shown.damage == NVSP_OK || lacks || !(shown.flags & NVSP_DECODED_WHOLE)));
                CHECK(psnr(pixels, dive.pixels[like], dive.size) > 20);
                pictures += (shown.flags & NVSP_DECODED_WHOLE) && shown.frame != last;
                last = shown.flags & NVSP_DECODED_WHOLE ? shown.frame : last;
            }
            if (nvsp_topside_report(topside, then, bytes, sizeof bytes, &size, &next) == NVSP_OK
                && random_below(&seed, 4) > 0) {
                EXPECT(NVSP_OK, nvsp_vehicle_receive(vehicle, then + 0.1, bytes, size));
            }
            drain(vehicle, topside, up, down);
        }
    }
    free(pixels);
    return pictures;
}

static nvsp_vehicle *pixel_vehicle(const nvsp_vehicle_options *options) {
    nvsp_vehicle *made = NULL;
    nvsp_encoder_options encodes = NVSP_INITIALIZER(nvsp_encoder_options);
    encodes.mode = NVSP_MODE_ACKNOWLEDGED;
    MUST(nvsp_vehicle_create(both.engine, both.prior, &dive.camera, &encodes, options, &made));
    return made;
}

static void pictures(void) {
    nvsp_vehicle_options options = vehicle_options(MTU, 60000, 4);
    options.user_bytes = 5;
    options.stream = 2;
    nvsp_topside_options receives = topside_options(MTU);
    receives.stream = 2;
    nvsp_vehicle *vehicle = pixel_vehicle(&options);
    nvsp_topside *topside = NULL;
    MUST(nvsp_topside_create(both.engine, both.prior, &receives, &topside));
    nvsp_encoder *encoder = nvsp_vehicle_encoder(vehicle);
    nvsp_decoder *decoder = nvsp_topside_decoder(topside);
    CHECK(encoder != NULL && decoder != NULL);
    told up = {0}, down = {0};
    MUST(nvsp_topside_set_region(topside, 0.25, 0.25, 0.5, 0.75, 4));
    MUST(nvsp_topside_set_user(topside, (const uint8_t *)"lamp", 4));
    double now = 100;
    const int frames = few() ? 12 : 24;
    const uint32_t whole = show_all(vehicle, topside, &now, frames, &up, &down);
    printf("%u frames sent, %u pictures whole, user bytes of %u packets and %u reports\n", up.frames, whole, down.users,
           up.users);
    CHECK(up.frames > (uint32_t)frames / 2 && whole > up.frames / 2 && down.users >= whole);
    CHECK(up.heard == 1 && down.heard == 1 && up.stores > 0 && up.state.data_size > 20);
    CHECK(down.user.data_size == 5 && memcmp(down.user.data, "depth", 5) == 0);
    CHECK(up.user.data_size == 4 && memcmp(up.user.data, "lamp", 4) == 0);
    CHECK(up.regions == 1 && up.region.weight == 4 && fabs(up.region.region[3] - 0.75) < 0.01);
    uint8_t levels[64];
    size_t size = 0;
    nvsp_truth truth = NVSP_INITIALIZER(nvsp_truth);
    EXPECT(NVSP_OK, nvsp_decoder_get_truth(decoder, levels, sizeof levels, &size, &truth));
    CHECK(size > 0);

    // Encoder and decoder are these handles' own.
    const nvsp_image image = scene_image(&dive, 0);
    uint8_t bytes[MAX_PACKET];
    EXPECT(NVSP_ERR_STATE, nvsp_encode(encoder, &image, NULL, bytes, sizeof bytes, &size, NULL));
    CHECK(says(encoder, "vehicle"));
    EXPECT(NVSP_ERR_STATE, nvsp_encoder_set_rate(encoder, NVSP_RATE_DEFAULT, 0));
    EXPECT(NVSP_ERR_STATE, nvsp_cancel(encoder));
    EXPECT(NVSP_ERR_STATE, nvsp_decode(decoder, packets[0].bytes, packets[0].size, 0, NULL, NULL));
    EXPECT(NVSP_ERR_STATE, nvsp_vehicle_packet(vehicle, now, packets[0].bytes, packets[0].size, bytes, 5));
    EXPECT(NVSP_ERR_STATE, nvsp_topside_packet(topside, now, bytes, sizeof bytes, &size, NULL));
    nvsp_destroy(encoder);
    nvsp_destroy(decoder);
    EXPECT(NVSP_OK, nvsp_encoder_reset(encoder));
    EXPECT(NVSP_OK, nvsp_decoder_add_camera(decoder, &dive.camera));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_frame(vehicle, now, &image, NULL, bytes, 4));

    // A frame that is coded can be dropped, and the next one goes on.
    EXPECT(NVSP_ERR_STATE, nvsp_wait(vehicle, 0));
    if (nvsp_vehicle_frame(vehicle, now + 5, &image, with_hint(&dive.poses[0]), bytes, 5) == NVSP_OK) {
        while (nvsp_cancel(vehicle) == NVSP_PENDING) {
            usleep(1000);
        }
    }
    EXPECT(NVSP_ERR_STATE, nvsp_wait(vehicle, 0));
    nvsp_destroy(vehicle);

    // The vehicle starts again, and its numbers go on.
    options.state = up.state.data;
    options.state_size = up.state.data_size;
    vehicle = pixel_vehicle(&options);
    EXPECT(NVSP_OK, nvsp_vehicle_frame(vehicle, 1, &image, with_hint(&dive.poses[0]), bytes, 5));
    EXPECT(NVSP_OK, nvsp_wait(vehicle, 60000));
    EXPECT(NVSP_OK, nvsp_vehicle_transmit(vehicle, 2, MTU, bytes, &size, NULL));
    nvsp_event event = NVSP_INITIALIZER(nvsp_event);
    while (nvsp_vehicle_event(vehicle, &event) == NVSP_OK && event.kind != NVSP_EVENT_FRAME) {
    }
    CHECK(event.kind == NVSP_EVENT_FRAME && event.frame >= up.frames);
    options.state_size--;
    nvsp_vehicle *none = NULL;
    EXPECT(NVSP_ERR_ARGUMENT,
           nvsp_vehicle_create(both.engine, both.prior, &dive.camera, NULL, &options, &none));
    CHECK(none == NULL && says(both.engine, "state"));
    nvsp_destroy(vehicle);
    nvsp_destroy(topside);
}

// What encoder and decoder of both ends are given anew after a lost device, and frames go on.
static void reopened(void) {
    nvsp_vehicle_options options = vehicle_options(MTU, 60000, 4);
    options.user_bytes = 5;
    const nvsp_topside_options receives = topside_options(MTU);
    nvsp_vehicle *vehicle = pixel_vehicle(&options);
    nvsp_topside *topside = NULL;
    nvsp_prior *anew = NULL, *other = NULL;
    MUST(nvsp_topside_create(both.engine, both.prior, &receives, &topside));
    MUST(nvsp_prior_open(both.engine, dive.prior, NULL, &anew));
    MUST(nvsp_prior_open(both.engine, dive.other_prior, NULL, &other));
    told up = {0}, down = {0};
    double now = 0;
    // As many as show_all shows before it begins with the first again.
    const int turn = 2 * dive.frames - 2;
    const uint32_t before = show_all(vehicle, topside, &now, turn, &up, &down);
    nvsp_encoder *encoder = nvsp_vehicle_encoder(vehicle);
    nvsp_decoder *decoder = nvsp_topside_decoder(topside);
    EXPECT(NVSP_ERR_OTHER_PRIOR, nvsp_encoder_reopen(encoder, both.engine, other));
    EXPECT(NVSP_ERR_OTHER_PRIOR, nvsp_decoder_reopen(decoder, both.engine, other));
    EXPECT(NVSP_OK, nvsp_encoder_reopen(encoder, both.engine, anew));
    EXPECT(NVSP_OK, nvsp_decoder_reopen(decoder, both.engine, anew));
    const uint32_t frames = up.frames, after = show_all(vehicle, topside, &now, turn, &up, &down);
    printf("%u of %u pictures whole before encoder and decoder were given anew, %u of %u after it\n", before, frames,
           after, up.frames - frames);
    CHECK(before > frames / 2 && up.frames > frames + (uint32_t)turn / 2 && after > (up.frames - frames) / 2);
    CHECK(down.heard == 1 && down.refused == 0);
    nvsp_destroy(other);
    nvsp_destroy(anew);
    nvsp_destroy(vehicle);
    nvsp_destroy(topside);
}

// A vehicle searches for a frame while the one before is coded. All that it takes come, in order.
static void two_under_way(void) {
    const nvsp_vehicle_options options = vehicle_options(MTU, 60000, 4);
    nvsp_encoder_options encodes = NVSP_INITIALIZER(nvsp_encoder_options);
    encodes.pipelined = 1;
    nvsp_vehicle *vehicle = NULL;
    MUST(nvsp_vehicle_create(both.engine, both.prior, &dive.camera, &encodes, &options, &vehicle));
    uint8_t bytes[MTU];
    uint32_t taken = 0, coded = 0, most = 0;
    int64_t last = -1;
    const uint32_t enough = few() ? 6 : 40;
    int k = 0;
    for (; (taken < enough || coded < taken) && k < 60000; k++) {
        const nvsp_image image = scene_image(&dive, k / 4 % dive.frames);
        const nvsp_pose *hint = k == 0 ? &dive.poses[0] : NULL;
        if (taken < enough) {
            const nvsp_status status = nvsp_vehicle_frame(vehicle, 0.25 * k, &image, with_hint(hint), NULL, 0);
            CHECK(status == NVSP_OK || (k > 0 && status == NVSP_PENDING));
            taken += status == NVSP_OK;
        }
        size_t size = 0;
        while (nvsp_vehicle_transmit(vehicle, 0.25 * k, MTU, bytes, &size, NULL) == NVSP_OK) {
        }
        nvsp_event event = NVSP_INITIALIZER(nvsp_event);
        while (nvsp_vehicle_event(vehicle, &event) == NVSP_OK) {
            if (event.kind == NVSP_EVENT_FRAME) {
                CHECK(event.status == NVSP_OK && event.bytes > 20 && event.frame > last);
                last = event.frame;
                coded++;
            }
        }
        most = taken - coded > most ? taken - coded : most;
        usleep(3000);
    }
    printf("%u of %d frames taken, %u coded, at most %u under way\n", taken, k, coded, most);
    CHECK(taken == enough && coded == taken && most <= 2);
    nvsp_destroy(vehicle);
}

// In order, each frame once; what did not come is drawn between others. The modem asks for frames.
static void in_order_and_pulled(void) {
    nvsp_vehicle_options options = vehicle_options(MTU, 0, 4);
    options.flags = NVSP_LINK_PULL;
    nvsp_topside_options receives = topside_options(MTU);
    receives.latency = 1.5;
    receives.frame_rate = 4;
    nvsp_vehicle *vehicle = NULL;
    nvsp_topside *topside = NULL;
    MUST(nvsp_vehicle_create(both.engine, both.prior, &dive.camera, NULL, &options, &vehicle));
    MUST(nvsp_topside_create(both.engine, both.prior, &receives, &topside));
    uint8_t *pixels = malloc(dive.size), bytes[MTU];
    int64_t last = -1;
    uint32_t pictures = 0;
    for (int k = 0; k < 60; k++) {
        const double now = 0.1 * k;
        const nvsp_image image = scene_image(&dive, k / 10 % dive.frames);
        if (k % 3 == 0 && nvsp_vehicle_frame(vehicle, now, &image, with_hint(k == 0 ? &dive.poses[0] : NULL), NULL, 0)
                              == NVSP_OK) {
            EXPECT(NVSP_OK, nvsp_wait(vehicle, 60000));
        }
        for (int turn = 0; turn < 3; turn++) {
            size_t size = 0;
            const size_t room = turn == 1 ? 40 : MTU;
            if (nvsp_vehicle_transmit(vehicle, now, room, bytes, &size, NULL) == NVSP_OK) {
                CHECK(size <= room);
                EXPECT(NVSP_OK, nvsp_topside_receive(topside, now, bytes, size));
            }
        }
        nvsp_picture place = place_of(pixels, dive.camera.width, dive.camera.height);
        nvsp_decoded shown = NVSP_INITIALIZER(nvsp_decoded);
        nvsp_status status;
        do {
            status = nvsp_topside_picture(topside, now, &place, &shown);
        } while (status == NVSP_PENDING && nvsp_wait(topside, 60000) == NVSP_OK);
        if (status == NVSP_OK) {
            CHECK(shown.frame > last);
            last = shown.frame;
            pictures++;
        }
    }
    printf("%u pictures in order, pulled\n", pictures);
    CHECK(pictures > 4);
    free(pixels);
    nvsp_destroy(vehicle);
    nvsp_destroy(topside);
}

// A wrong option is named, with what it allows.
static void wrong_options(void) {
    const struct {
        const char *name;
        nvsp_vehicle_options options;
    } vehicles[] = {
        {"mtu", {.mtu = 15, .bit_rate = 5000, .frame_rate = 5}},
        {"mtu", {.mtu = 65536, .bit_rate = 5000, .frame_rate = 5}},
        {"bit_rate", {.mtu = 64, .frame_rate = 5}},
        {"bit_rate", {.mtu = 64, .bit_rate = 5000, .frame_rate = 5, .flags = NVSP_LINK_PULL}},
        {"frame_rate", {.mtu = 64, .bit_rate = 5000}},
        {"frame_rate", {.mtu = 64, .bit_rate = 5000, .frame_rate = -1}},
        {"picture_rate", {.mtu = 64, .bit_rate = 5000, .frame_rate = 5, .picture_rate = -1}},
        {"latency", {.mtu = 64, .bit_rate = 5000, .frame_rate = 5, .latency = NAN}},
        {"delay", {.mtu = 64, .bit_rate = 5000, .frame_rate = 5, .delay = 2}},
        {"spread", {.mtu = 64, .bit_rate = 5000, .frame_rate = 5, .spread = 2}},
        {"loss", {.mtu = 64, .bit_rate = 5000, .frame_rate = 5, .loss = 1}},
        {"burst", {.mtu = 64, .bit_rate = 5000, .frame_rate = 5, .burst = 0.5}},
        {"max_shares", {.mtu = 64, .bit_rate = 5000, .frame_rate = 5, .max_shares = 65}},
        {"user_bytes", {.mtu = 64, .bit_rate = 5000, .frame_rate = 5, .user_bytes = 254}},
        {"stream", {.mtu = 64, .bit_rate = 5000, .frame_rate = 5, .stream = 4}},
        {"flags", {.mtu = 64, .bit_rate = 5000, .frame_rate = 5, .flags = NVSP_LINK_MODEM_CHECKS}},
        {"pacing", {.mtu = 64, .flags = NVSP_LINK_AS_THEY_COME}},
        {"state", {.mtu = 64, .bit_rate = 5000, .frame_rate = 5, .state = (const uint8_t *)"abc", .state_size = 3}},
    };
    for (size_t i = 0; i < sizeof vehicles / sizeof *vehicles; i++) {
        nvsp_vehicle_options options = vehicles[i].options;
        options.struct_size = sizeof options;
        options.abi_version = NVSP_ABI_VERSION;
        nvsp_vehicle *none = NULL;
        uint64_t bytes = 77;
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_create(NULL, NULL, NULL, NULL, &options, &none));
        CHECK(none == NULL && says(NULL, vehicles[i].name));
        if (strcmp(vehicles[i].name, "state") != 0) {
            EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_memory(&options, &bytes));
            CHECK(bytes == 77);
        }
    }
    const struct {
        const char *name;
        nvsp_topside_options options;
    } topsides[] = {
        {"mtu", {.mtu = 7}},
        {"latency", {.mtu = 64, .latency = -1}},
        {"frame_rate", {.mtu = 64, .frame_rate = 5}},
        {"frame_rate", {.mtu = 64, .latency = 1, .frame_rate = -5}},
        {"report_every", {.mtu = 64, .report_every = -2}},
        {"stream", {.mtu = 64, .stream = 4}},
        {"packets", {.mtu = 64, .packets = 65}},
        {"age", {.mtu = 64, .age = -1}},
        {"shares", {.mtu = 64, .max_shares = 2049}},
        {"flags", {.mtu = 64, .flags = NVSP_LINK_PULL}},
    };
    for (size_t i = 0; i < sizeof topsides / sizeof *topsides; i++) {
        nvsp_topside_options options = topsides[i].options;
        options.struct_size = sizeof options;
        options.abi_version = NVSP_ABI_VERSION;
        nvsp_topside *none = NULL;
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_create(NULL, NULL, &options, &none));
        CHECK(none == NULL && says(NULL, topsides[i].name));
    }
    // What the vehicle has is none of its encoder's options.
    const nvsp_vehicle_options options = vehicle_options(MTU, 5000, 5);
    nvsp_encoder_options encodes = NVSP_INITIALIZER(nvsp_encoder_options);
    nvsp_vehicle *none = NULL;
    encodes.first_frame = 5;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_create(both.engine, both.prior, &dive.camera, &encodes, &options, &none));
    CHECK(says(both.engine, "first_frame"));
    encodes.first_frame = 0;
    encodes.rate = NVSP_RATE_NONE;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_create(both.engine, both.prior, &dive.camera, &encodes, &options, &none));
    CHECK(none == NULL && says(both.engine, "nvsp_encoder_options.rate"));
}

// Times, rates and losses that cannot be are refused, and nothing changes.
static void wrong_calls(void) {
    const nvsp_vehicle_options options = vehicle_options(MTU, 5000, 5);
    const nvsp_topside_options receives = topside_options(MTU);
    nvsp_vehicle *vehicle = new_vehicle(&options);
    nvsp_topside *topside = new_topside(&receives);
    uint8_t bytes[MTU] = {0};
    uint32_t budget = 77;
    size_t size = 77;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_plan(vehicle, NAN, 0, NULL, &budget));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_plan(vehicle, 0, INFINITY, NULL, &budget));
    EXPECT(NVSP_ERR_STATE, nvsp_vehicle_packet(vehicle, 0, packets[0].bytes, packets[0].size, NULL, 0));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_transmit(vehicle, NAN, MTU, bytes, &size, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_count(vehicle, NAN, 5));
    EXPECT(NVSP_OK, nvsp_vehicle_count(vehicle, 1, 5));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_set_link(vehicle, 1, 0, 0.5, -1));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_set_link(vehicle, 1, 9000, 1, -1));
    nvsp_vehicle_statistics sent = NVSP_INITIALIZER(nvsp_vehicle_statistics);
    EXPECT(NVSP_OK, nvsp_vehicle_get_statistics(vehicle, &sent));
    CHECK(sent.bit_rate == 5000 && sent.loss == 0.1 && sent.burst == 1);
    EXPECT(NVSP_OK, nvsp_vehicle_set_link(vehicle, 1, 9000, 0, 2));
    EXPECT(NVSP_OK, nvsp_vehicle_get_statistics(vehicle, &sent));
    CHECK(sent.bit_rate == 9000 && sent.loss == 0 && sent.burst == 2);
    EXPECT(NVSP_ERR_PACKET, nvsp_vehicle_receive(vehicle, 1, bytes, sizeof bytes));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_receive(topside, NAN, bytes, sizeof bytes));
    EXPECT(NVSP_ERR_PACKET, nvsp_topside_receive(topside, 0, bytes, 0));
    EXPECT(NVSP_ERR_BUFFER_TOO_SMALL, nvsp_topside_report(topside, 0, bytes, MTU - 1, &size, NULL));
    CHECK(size == MTU && budget == 77);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_set_region(topside, 0.5, 0, 0.5, 1, 3));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_set_region(topside, 0, 0, 1, 1, 256));
    EXPECT(NVSP_OK, nvsp_topside_set_region(topside, 0, 0, 0, 0, 0));
    uint8_t user[248] = {0};
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_set_user(topside, user, sizeof user));
    EXPECT(NVSP_OK, nvsp_topside_set_user(topside, user, sizeof user - 1));
    CHECK(nvsp_vehicle_encoder(vehicle) == NULL && nvsp_topside_decoder(topside) == NULL);
    nvsp_picture place = place_of(NULL, 16, 16);
    EXPECT(NVSP_ERR_STATE, nvsp_topside_picture(topside, 0, &place, NULL));
    nvsp_destroy(vehicle);
    nvsp_destroy(topside);
}

int main(int argc, char **argv) {
    set_up(argc, argv);
    nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
    rig_add(&both, &dive.camera, &options);
    encode_all(&both, &dive, packets);
    long_run();
    pictures();
    reopened();
    two_under_way();
    in_order_and_pulled();
    wrong_options();
    wrong_calls();
    return tear_down();
}
