// Packets as shares over a link that loses, swaps, repeats, pads, cuts and damages modem frames: sender and collector.

#include "common.h"

#include <float.h>
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
#define FRAMES_A_SECOND 15.0

static uint64_t seed = 1;

static nvsp_sender_options link_options(void) {
    nvsp_sender_options options = NVSP_INITIALIZER(nvsp_sender_options);
    options.bit_rate = RATE;
    options.frame_rate = FRAMES_A_SECOND;
    options.spread = 0.4;
    options.loss = 0.2;
    return options;
}

static nvsp_sender *new_sender(const nvsp_sender_options *options) {
    nvsp_sender *made = NULL;
    MUST(nvsp_sender_create(MTU, options, &made));
    return made;
}

static nvsp_collector *new_collector(uint32_t streams) {
    nvsp_collector *made = NULL;
    nvsp_collector_options options = NVSP_INITIALIZER(nvsp_collector_options);
    options.streams = streams;
    options.shares = 16;
    MUST(nvsp_collector_create(MTU, &options, &made));
    return made;
}

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

// Shares that are to arrive after those sent behind them.
static uint8_t late[16][MTU];
static size_t late_sizes[16], late_count;
static double late_since[16];
// Seconds that one is held back at most. 128 frames later its number would mean another frame.
#define LATEST 3.0

typedef struct tally {
    long planned, packets, complete, fetched, refused, ended;
} tally;

// The packets of the last frames, as they were sent.
#define KEPT 64
static uint8_t sent_bytes[KEPT][MAX_PACKET];
static size_t sent_sizes[KEPT];
static uint32_t sent_frames[KEPT];
static nvsp_division divisions[KEPT];

// What the collector gives must be the start of the packet of this frame number, and of no other.
static void check_fetched(nvsp_collector *collector, const nvsp_collected *state, tally *all) {
    uint8_t bytes[MAX_PACKET];
    size_t size = 0;
    nvsp_collected fetched = NVSP_INITIALIZER(nvsp_collected);
    EXPECT(NVSP_OK, nvsp_collector_fetch(collector, 0, state->frame, bytes, sizeof bytes, &size, &fetched));
    const uint32_t at = state->frame % KEPT;
    CHECK(fetched.frame == state->frame && fetched.bytes == size && size == state->bytes);
    CHECK(sent_frames[at] == state->frame && size <= sent_sizes[at]);
    CHECK(memcmp(bytes, sent_bytes[at], size) == 0);
    CHECK(fetched.complete == (size == sent_sizes[at]) && fetched.arrived <= fetched.sent);
    CHECK((bytes[2] | bytes[3] << 8) == (int)(state->frame & 0xffff));
    all->fetched++;
}

// As many shares as the division says must give a picture, or all that was sent.
static void check_enough(nvsp_collector *collector, const uint8_t *share, tally *all) {
    const uint32_t number = (uint32_t)(share[0] & 0xf) << 4 | share[1] >> 4;
    const uint32_t at = number % KEPT;
    if (sent_frames[at] % 256 == number) {
        uint8_t bits[32], bytes[MAX_PACKET];
        uint32_t sent = 0, arrived = 0;
        size_t size = 0;
        EXPECT(NVSP_OK, nvsp_collector_arrived(collector, 0, sent_frames[at], bits, sizeof bits, &sent));
        for (uint32_t i = 0; i < sent; i++) {
            arrived += bits[i / 8] >> i % 8 & 1;
        }
        const nvsp_division *division = &divisions[at];
        nvsp_collected state = NVSP_INITIALIZER(nvsp_collected);
        const nvsp_status status =
            nvsp_collector_fetch(collector, 0, sent_frames[at], bytes, sizeof bytes, &size, &state);
        CHECK(arrived > 0 && sent == division->shares);
        CHECK((status == NVSP_OK) == (arrived >= division->picture_shares));
        if (arrived >= division->whole_shares) {
            CHECK(size == division->packet_bytes && state.ended == 1);
            all->ended++;
        }
    }
}

static void deliver(nvsp_collector *collector, double now, const uint8_t *share, size_t size, int held_back,
                    tally *all) {
    uint8_t padded[MTU + 20];
    memset(padded, 0xee, sizeof padded);
    memcpy(padded, share, size);
    nvsp_collected state = NVSP_INITIALIZER(nvsp_collected);
    const size_t length = random_below(&seed, 2) ? size : sizeof padded;
    const nvsp_status status = nvsp_collector_push(collector, now, padded, length, &state);
    if (status != NVSP_OK) {
        // Held back for so long that the packet has gone by.
        CHECK(held_back && status == NVSP_ERR_MODEM);
        CHECK(says(collector, "newer one took its place"));
        all->refused++;
        return;
    }
    if (state.event == NVSP_EVENT_COMPLETE || state.event == NVSP_EVENT_GROWN) {
        all->complete += state.event == NVSP_EVENT_COMPLETE;
        check_fetched(collector, &state, all);
    } else {
        CHECK(state.event == NVSP_EVENT_KEPT || state.event == NVSP_EVENT_DUPLICATE
              || state.event == NVSP_EVENT_SURPLUS);
        CHECK(state.frame == 0 && state.bytes == 0);
    }
    check_enough(collector, share, all);
}

// A copy that is cut, or has flipped bits, is refused and changes nothing.
static void damage(nvsp_collector *collector, double now, const uint8_t *share, size_t size, tally *all) {
    uint8_t *copy = malloc(size);  // No larger: a memory checker sees more.
    size_t left = size;
    memcpy(copy, share, size);
    if (random_below(&seed, 2)) {
        left = random_below(&seed, (uint32_t)size);
    } else {
        for (uint32_t flips = random_below(&seed, 2) + 1; flips > 0; flips--) {
            copy[random_below(&seed, (uint32_t)size)] ^= (uint8_t)(1u << random_below(&seed, 8));
        }
    }
    if (memcmp(copy, share, size) != 0 || left < size) {
        uint8_t *cut = malloc(left > 0 ? left : 1);
        memcpy(cut, copy, left);
        const nvsp_status status = nvsp_collector_push(collector, now, cut, left, NULL);
        // One flipped bit makes it look like a share without protection, whose packet may be yet to come.
        CHECK(status == NVSP_ERR_MODEM || (left > 0 && copy[0] >> 6 == 3));
        all->refused += status == NVSP_ERR_MODEM;
        free(cut);
    }
    free(copy);
}

static void carry(nvsp_collector *collector, double now, const uint8_t *share, size_t size, tally *all) {
    const uint32_t luck = random_below(&seed, 100);
    if (luck < 20) {
        return;  // Lost.
    }
    if (luck < 30 && late_count < 16) {
        memcpy(late[late_count], share, size);
        late_since[late_count] = now;
        late_sizes[late_count++] = size;
        return;
    }
    if (luck < 35) {
        damage(collector, now, share, size, all);
    }
    deliver(collector, now, share, size, 0, all);
    if (luck < 45) {
        deliver(collector, now, share, size, 0, all);
    }
    if (late_count > 0 && luck % 4 == 0) {
        const uint32_t which = random_below(&seed, (uint32_t)late_count);
        if (now - late_since[which] < LATEST) {
            deliver(collector, now, late[which], late_sizes[which], 1, all);
        }
        late_count--;
        memcpy(late[which], late[late_count], MTU);
        late_sizes[which] = late_sizes[late_count];
        late_since[which] = late_since[late_count];
    }
}

// 10,000 packets at 20 % loss, with shares swapped, repeated, padded, cut and damaged. No packet is taken for another,
// and no memory is taken after the first ones.
static void long_run(void) {
    const nvsp_sender_options options = link_options();
    nvsp_sender *sender = new_sender(&options);
    nvsp_collector *collector = new_collector(1);
    const long frames = few() ? 400 : 10500, warm = few() ? 200 : 1000;
    tally all = {0, 0, 0, 0, 0, 0};
    size_t before = 0;
    double free_at = 0, now = 0;
    const uint32_t first = 65000;  // The numbers in packets begin anew on the way.
    for (long k = 0; k < frames; k++) {
        const uint32_t frame = first + (uint32_t)k;
        now = (double)k / FRAMES_A_SECOND;
        uint32_t budget = 77;
        EXPECT(NVSP_OK, nvsp_sender_plan(sender, now, &budget));
        if (budget > 0) {
            all.planned++;
            nvsp_division division = NVSP_INITIALIZER(nvsp_division);
            const uint32_t at = frame % KEPT;
            CHECK(budget >= 40 && budget < MAX_PACKET);
            sent_frames[at] = frame;
            sent_sizes[at] = numbered(sent_bytes[at], frame, budget);
            EXPECT(NVSP_OK, nvsp_sender_push(sender, now, sent_bytes[at], sent_sizes[at], NULL, 0, &division));
            divisions[at] = division;
            CHECK(division.shares > 0 && division.share_bytes <= MTU && division.packet_bytes == sent_sizes[at]);
            CHECK(division.picture_shares > 0 && division.picture_shares <= division.whole_shares);
            CHECK(division.whole_shares <= division.shares && division.link_bytes <= 4 * budget + 200);
            all.packets++;
        }
        double due = 0;
        while (free_at <= now && nvsp_sender_due(sender, &due) == NVSP_OK && due <= now) {
            uint8_t share[MTU];
            size_t size = 0;
            EXPECT(NVSP_OK, nvsp_sender_next(sender, now, share, sizeof share, &size));
            free_at = (free_at > due ? free_at : due) + 8.0 * (double)size / RATE;
            carry(collector, now, share, size, &all);
        }
        if (k == warm) {
            before = resident();
        }
    }
    const size_t after = resident();
    nvsp_sender_statistics sent = NVSP_INITIALIZER(nvsp_sender_statistics);
    nvsp_collector_statistics came = NVSP_INITIALIZER(nvsp_collector_statistics);
    EXPECT(NVSP_OK, nvsp_sender_get_statistics(sender, &sent));
    EXPECT(NVSP_OK, nvsp_collector_get_statistics(collector, &came));
    const double loss = 1 - (double)came.arrived / (double)came.sent;
    printf("%ld packets, %llu shares, %llu bytes: %ld whole, %llu of them with losses; %ld fetched, %ld refused; loss "
        "%.3f; "
           "%ld bytes of memory more\n",
           all.packets, (unsigned long long)sent.shares, (unsigned long long)sent.bytes, all.complete,
           (unsigned long long)came.repaired, all.fetched, all.refused, loss, (long)after - (long)before);
    CHECK(few() || all.packets >= 10000);
    CHECK((long)sent.packets == all.packets && (long)sent.left_out == frames - all.planned && sent.cut == 0);
    CHECK((long)came.completed == all.complete && (long)came.rejected == all.refused && came.damaged == 0);
    // Some of the shares that were held back never came.
    CHECK(loss > 0.15 && loss < 0.3);
    CHECK(all.ended > all.packets / 2 && all.fetched > all.packets * 8 / 10);
    CHECK(all.complete > all.packets * 6 / 10 && came.repaired > came.completed / 4);
    // The program's own memory may shrink and grow by some pages. Memory checkers keep what it has freed.
    CHECK(after <= before + (64 << 10) || few() || SANITIZED);
    nvsp_destroy(sender);
    nvsp_destroy(collector);
}

// From pictures to pictures: what any shares give is decoded, and is the packet's.
static void pictures(void) {
    nvsp_sender_options options = link_options();
    options.user_bytes = 5;
    options.stream = 2;
    options.spread = 0;
    options.bit_rate = 60000;
    options.frame_rate = 5;
    nvsp_sender *sender = new_sender(&options);
    nvsp_collector *collector = new_collector(3);
    MUST(nvsp_decoder_add_camera(both.decoder, &dive.camera));
    for (int i = 0; i < dive.frames; i++) {
        const double now = i / 5.0;
        uint32_t budget = 0;
        EXPECT(NVSP_OK, nvsp_sender_plan(sender, now, &budget));
        CHECK(budget > 300);
        EXPECT(NVSP_OK, nvsp_sender_push(sender, now, packets[i].bytes, packets[i].size, (const uint8_t *)"hello", 5,
                                         NULL));
        uint8_t share[MTU], bytes[MAX_PACKET], user[5], bits[32];
        size_t size = 0, skipped = 0, seen = 0;
        uint32_t lost_index = UINT32_MAX;
        nvsp_collected state = NVSP_INITIALIZER(nvsp_collected);
        while (nvsp_sender_next(sender, now, share, sizeof share, &size) == NVSP_OK) {
            if (skipped == 0 && random_below(&seed, 4) == 0) {
                lost_index = (uint32_t)seen;
                skipped++;
            } else {
                EXPECT(NVSP_OK, nvsp_collector_push(collector, now, share, size, &state));
            }
            seen++;
        }
        EXPECT(NVSP_OK, nvsp_collector_newest(collector, 2, &state));
        CHECK(state.frame == (uint32_t)i && state.stream == 2 && state.user_bytes == 5 && state.event == 0);
        CHECK(state.sent == seen && state.arrived == seen - skipped);
        EXPECT(NVSP_OK, nvsp_collector_fetch(collector, 2, (uint32_t)i, bytes, sizeof bytes, &size, NULL));
        CHECK(size <= packets[i].size && memcmp(bytes, packets[i].bytes, size) == 0);
        nvsp_decoded info = NVSP_INITIALIZER(nvsp_decoded);
        EXPECT(NVSP_OK, nvsp_decode(both.decoder, bytes, size, NVSP_DECODE_START, NULL, &info));
        CHECK(info.frame == (uint32_t)i);
        EXPECT(NVSP_OK, nvsp_collector_fetch_user(collector, 2, (uint32_t)i, user, sizeof user, &size));
        CHECK(size == 5 && memcmp(user, "hello", 5) == 0);
        EXPECT(NVSP_ERR_BUFFER_TOO_SMALL, nvsp_collector_fetch_user(collector, 2, (uint32_t)i, user, 4, &size));
        uint32_t sent = 77, missing[4], count = 77;
        EXPECT(NVSP_OK, nvsp_collector_arrived(collector, 2, (uint32_t)i, bits, sizeof bits, &sent));
        CHECK(sent == seen);
        for (uint32_t at = 0; at < 8 * sizeof bits; at++) {
            CHECK((bits[at / 8] >> at % 8 & 1) == (at < sent && at != lost_index));
        }
        EXPECT(NVSP_OK, nvsp_collector_missing(collector, 2, (uint32_t)i, missing, 4, &count));
        CHECK(state.complete ? count == 0 : count == skipped && missing[0] == lost_index);
        // Another frame of the same number modulo 256, and another stream.
        const uint32_t other = (uint32_t)i + 256;
        EXPECT(NVSP_ERR_STATE, nvsp_collector_fetch(collector, 2, other, bytes, sizeof bytes, &size, NULL));
        EXPECT(NVSP_ERR_STATE, nvsp_collector_fetch(collector, 1, (uint32_t)i, bytes, sizeof bytes, &size, NULL));
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_fetch(collector, 3, (uint32_t)i, bytes, sizeof bytes, &size, NULL));
        EXPECT(NVSP_OK, nvsp_collector_arrived(collector, 2, other, bits, 0, &sent));
        CHECK(sent == 0);
    }
    nvsp_destroy(sender);
    nvsp_destroy(collector);
}

// Frames of which nothing came: the prior at a pose between those of others.
static void between(void) {
    nvsp_header header[2] = {NVSP_INITIALIZER(nvsp_header), NVSP_INITIALIZER(nvsp_header)};
    nvsp_pose middle = NVSP_INITIALIZER(nvsp_pose), back = NVSP_INITIALIZER(nvsp_pose);
    uint8_t *pixels = malloc(dive.size), *shown = malloc(dive.size);
    nvsp_picture place = place_of(pixels, dive.camera.width, dive.camera.height);
    nvsp_decoder *fresh = NULL;
    MUST(nvsp_decoder_create(both.engine, both.prior, NULL, &fresh));
    EXPECT(NVSP_ERR_STATE, nvsp_decoder_draw(fresh, &dive.poses[0], &place));
    nvsp_destroy(fresh);
    for (int i = 0; i < 2; i++) {
        EXPECT(NVSP_OK, nvsp_decode_header(packets[2 * i].bytes, packets[2 * i].size, both.prior, &header[i]));
        CHECK(header[i].flags & NVSP_HEADER_POSE);
    }
    EXPECT(NVSP_OK, nvsp_pose_between(&header[0].pose, &header[1].pose, 0.5, &middle));
    EXPECT(NVSP_OK, nvsp_pose_between(&header[1].pose, &header[0].pose, 0.5, &back));
    for (int i = 0; i < 3; i++) {
        CHECK(fabs(middle.translation[i] - back.translation[i]) < 1e-9);
    }
    MUST(nvsp_decode(both.decoder, packets[0].bytes, packets[0].size, 0, NULL, NULL));
    EXPECT(NVSP_OK, nvsp_decoder_draw(both.decoder, &middle, &place));
    memcpy(shown, pixels, dive.size);
    const double at_middle = psnr(shown, dive.pixels[1], dive.size);
    EXPECT(NVSP_OK, nvsp_decoder_draw(both.decoder, &header[0].pose, &place));
    const double at_first = psnr(pixels, dive.pixels[1], dive.size);
    printf("frame 1: %.2f dB at the pose between, %.2f dB at that of frame 0\n", at_middle, at_first);
    CHECK(at_middle > at_first);
    place.size = dive.size - 1;
    EXPECT(NVSP_ERR_BUFFER_TOO_SMALL, nvsp_decoder_draw(both.decoder, &middle, &place));
    CHECK(place.needed == dive.size);
    nvsp_pose none = NVSP_INITIALIZER(nvsp_pose);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_draw(both.decoder, &none, &place));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_pose_between(&none, &middle, 0.5, &back));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_pose_between(&header[0].pose, &middle, NAN, &back));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_pose_between(&header[0].pose, &middle, INFINITY, &back));
    free(pixels);
    free(shown);
}

// The number of a frame after some that were left out.
static void skipped_frames(void) {
    const nvsp_image image = scene_image(&dive, 0);
    uint8_t bytes[65536];
    size_t size = 0;
    nvsp_frame_stats stats = NVSP_INITIALIZER(nvsp_frame_stats);
    MUST(nvsp_encode(both.encoder, &image, with_hint(&dive.poses[0]), bytes, sizeof bytes, &size, &stats));
    const uint32_t before = stats.frame;
    nvsp_frame_info info = *with_hint(&dive.poses[0]);
    info.left_out = 3;
    MUST(nvsp_encode(both.encoder, &image, &info, bytes, sizeof bytes, &size, &stats));
    CHECK(stats.frame == before + 4);
    // A frame that fails is none, and so are those left out before it.
    MUST(nvsp_encoder_set_rate(both.encoder, NVSP_RATE_BYTES, 1));
    EXPECT(NVSP_ERR_BUDGET, nvsp_encode(both.encoder, &image, &info, bytes, sizeof bytes, &size, &stats));
    MUST(nvsp_encoder_set_rate(both.encoder, NVSP_RATE_DEFAULT, 0));
    MUST(nvsp_encode_begin(both.encoder, &image, &info));
    MUST(nvsp_wait(both.encoder, 60000));
    MUST(nvsp_encode_finish(both.encoder, bytes, sizeof bytes, &size, &stats));
    CHECK(stats.frame == before + 8);
}

static void wrong_states(void) {
    const nvsp_sender_options options = link_options();
    nvsp_sender *sender = new_sender(&options);
    nvsp_collector *collector = new_collector(1);
    uint8_t bytes[MAX_PACKET];
    size_t size = 77;
    uint32_t budget = 0;
    double due = 77;
    char text[256];
    nvsp_collected state = NVSP_INITIALIZER(nvsp_collected);
    memset(bytes, 0xa5, sizeof bytes);
    EXPECT(NVSP_PENDING, nvsp_sender_next(sender, 0, bytes, sizeof bytes, &size));
    EXPECT(NVSP_PENDING, nvsp_sender_due(sender, &due));
    EXPECT(NVSP_ERR_STATE, nvsp_sender_push(sender, 0, packets[1].bytes, packets[1].size, NULL, 0, NULL));
    CHECK(says(sender, "planned"));
    EXPECT(NVSP_OK, nvsp_sender_plan(sender, 0, &budget));
    EXPECT(NVSP_ERR_MODEM, nvsp_sender_push(sender, 0, bytes, 100, NULL, 0, NULL));
    EXPECT(NVSP_ERR_MODEM, nvsp_sender_push(sender, 0, packets[1].bytes, packets[1].size - 1, NULL, 0, NULL));
    EXPECT(NVSP_ERR_MODEM, nvsp_sender_push(sender, 0, packets[1].bytes, 0, NULL, 0, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_push(sender, 0, packets[1].bytes, SIZE_MAX, NULL, 0, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_push(sender, 0, packets[1].bytes, packets[1].size, bytes, 3, NULL));
    const double times[] = {NAN, INFINITY, -INFINITY};
    for (int i = 0; i < 3; i++) {
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_plan(sender, times[i], &budget));
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_push(sender, times[i], packets[1].bytes, packets[1].size, NULL, 0, NULL));
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_next(sender, times[i], bytes, sizeof bytes, &size));
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_count(sender, times[i], 5));
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_set_bit_rate(sender, times[i], 5000));
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_set_bit_rate(sender, 0, times[i]));
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_set_loss(sender, times[i], 1));
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_push(collector, times[i], bytes, 64, &state));
    }
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_set_bit_rate(sender, 0, 0));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_set_loss(sender, 1, 1));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_set_loss(sender, 0.1, 0.5));
    EXPECT(NVSP_OK, nvsp_sender_set_loss(sender, 0, 0));
    EXPECT(NVSP_OK, nvsp_sender_set_loss(sender, 0.3, 4));
    EXPECT(NVSP_OK, nvsp_sender_set_bit_rate(sender, 0, 8000));
    EXPECT(NVSP_OK, nvsp_sender_count(sender, 0, 10));
    nvsp_sender_statistics sent = NVSP_INITIALIZER(nvsp_sender_statistics);
    EXPECT(NVSP_OK, nvsp_sender_get_statistics(sender, &sent));
    CHECK(sent.loss == 0.3 && sent.burst == 4 && sent.bit_rate == 8000 && sent.packets == 0 && sent.waiting == 0);
    // The plan is still there. Then nothing is written but the size needed.
    EXPECT(NVSP_OK, nvsp_sender_push(sender, 1, packets[1].bytes, packets[1].size, NULL, 0, NULL));
    EXPECT(NVSP_PENDING, nvsp_sender_next(sender, 0.9, bytes, sizeof bytes, &size));
    CHECK(size == 77 && due == 77);
    EXPECT(NVSP_OK, nvsp_sender_due(sender, &due));
    EXPECT(NVSP_ERR_BUFFER_TOO_SMALL, nvsp_sender_next(sender, 1, bytes, 3, &size));
    CHECK(due == 1 && size > 8 && size <= MTU && all_are(bytes, 0xa5, sizeof bytes));
    EXPECT(NVSP_OK, nvsp_sender_next(sender, 1, bytes, size, &size));
    EXPECT(NVSP_OK, nvsp_collector_push(collector, 1, bytes, size, &state));
    EXPECT(NVSP_OK, nvsp_collector_push(collector, 1, bytes, size, &state));
    CHECK(state.event == NVSP_EVENT_DUPLICATE);
    EXPECT(NVSP_ERR_MODEM, nvsp_collector_push(collector, 1, bytes, 0, &state));
    // A share of the same packet, but without protection.
    EXPECT(NVSP_ERR_MODEM, nvsp_collector_push(collector, 1, packets[1].bytes, packets[1].size, &state));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_push(collector, 1, bytes, SIZE_MAX, &state));
    EXPECT(NVSP_OK, nvsp_last_error(collector, text, sizeof text));
    CHECK(strlen(text) > 3);
    uint32_t count = 77;
    EXPECT(NVSP_ERR_BUFFER_TOO_SMALL, nvsp_collector_arrived(collector, 0, 1, bytes, 0, &count));
    CHECK(count > 0 && count <= 16);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_arrived(collector, 1, 1, bytes, 32, &count));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_missing(collector, 4, 1, NULL, 0, &count));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_newest(collector, UINT32_MAX, &state));

    // Nobody takes the shares.
    nvsp_status status = NVSP_OK;
    for (int k = 1; k < 100000 && status == NVSP_OK; k++) {
        EXPECT(NVSP_OK, nvsp_sender_plan(sender, 1 + k / FRAMES_A_SECOND, &budget));
        if (budget > 0) {
            status = nvsp_sender_push(sender, 1, packets[1].bytes, packets[1].size, NULL, 0, NULL);
        }
    }
    CHECK(status == NVSP_ERR_UNFINISHED);
    nvsp_destroy(sender);
    nvsp_destroy(collector);
}

// A packet that states prior and camera has as many bytes more as these take, and one without room for more than its
// pose has that.
static void steady_bytes(void) {
    nvsp_encoder *made = NULL;
    nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
    options.rate = NVSP_RATE_STEADY;
    options.rate_value = 200;
    MUST(nvsp_encoder_create(both.engine, both.prior, &dive.camera, &options, &made));
    uint8_t bytes[MAX_PACKET];
    size_t sizes[3];
    for (int i = 0; i < 3; i++) {
        const nvsp_image image = scene_image(&dive, i);
        if (i == 2) {
            EXPECT(NVSP_OK, nvsp_encoder_set_rate(made, NVSP_RATE_STEADY, 1));
        }
        EXPECT(NVSP_OK, nvsp_encode(made, &image, with_hint(i == 0 ? &dive.poses[0] : NULL), bytes, sizeof bytes,
                                    &sizes[i], NULL));
    }
    CHECK(sizes[0] > 200 && sizes[0] <= 200 + SESSION_LATENT + SESSION + RENDER_CHECK - LATENT);
    CHECK(sizes[1] > 150 && sizes[1] <= 200 && sizes[2] <= LATENT + 2);
    nvsp_destroy(made);
}

// The topside tells what came: pictures that lack shares get them again, and the vehicle is told of bytes and frames.
static void reports(void) {
    nvsp_sender_options options = link_options();
    options.latency = 3;
    options.flags = NVSP_SENDER_EXPECT_REPORTS;
    nvsp_sender *sender = new_sender(&options);
    nvsp_collector *collector = new_collector(1);
    uint8_t bytes[MTU], packet[MAX_PACKET];
    size_t size = 77;
    nvsp_processed_report processed = NVSP_INITIALIZER(nvsp_processed_report);
    EXPECT(NVSP_PENDING, nvsp_collector_report(collector, 0, NULL, 0, NULL, 0, bytes, MTU, &size));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_report(collector, 1, NULL, 0, NULL, 0, bytes, MTU, &size));
    // Of frame 3 nothing comes.
    for (uint32_t frame = 0; frame < 14; frame++) {
        const double now = frame / FRAMES_A_SECOND;
        uint32_t budget = 0;
        EXPECT(NVSP_OK, nvsp_sender_plan(sender, now, &budget));
        const size_t bytes_of = numbered(packet, frame, budget);
        EXPECT(NVSP_OK, nvsp_sender_push(sender, now, packet, bytes_of, NULL, 0, NULL));
        nvsp_collected state = NVSP_INITIALIZER(nvsp_collected);
        while (nvsp_sender_next(sender, now + 3, bytes, MTU, &size) == NVSP_OK) {
            if (frame != 3) {
                EXPECT(NVSP_OK, nvsp_collector_push(collector, now, bytes, size, &state));
            }
        }
    }
    const uint32_t kept[] = {65536 + 7, 2, 900};
    const uint8_t user[] = "turn left";
    EXPECT(NVSP_ERR_MODEM, nvsp_collector_report(collector, 0, kept, 3, user, sizeof user, bytes, 12, &size));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_report(collector, 0, kept, 3, packet, 256, bytes, MTU, &size));
    EXPECT(NVSP_OK, nvsp_collector_report(collector, 0, kept, 3, user, sizeof user, bytes, MTU, &size));
    CHECK(size > 12 && size <= MTU);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_process_report(sender, NAN, bytes, size, &processed));
    for (size_t bit = 0; bit < 8 * size; bit++) {
        bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
        EXPECT(NVSP_ERR_MODEM, nvsp_sender_process_report(sender, 1, bytes, size, &processed));
        bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
    }
    for (size_t cut = 0; cut < size; cut++) {
        EXPECT(NVSP_ERR_MODEM, nvsp_sender_process_report(sender, 1, bytes, cut, &processed));
    }
    EXPECT(NVSP_OK, nvsp_sender_process_report(sender, 1, bytes, MTU, &processed));
    CHECK(processed.newest == 13 && processed.reported == 16);
    CHECK(processed.kept_count == 2 && processed.kept[0] == 7 && processed.kept[1] == 2);
    CHECK(processed.user_bytes == sizeof user && memcmp(bytes + processed.user_offset, user, sizeof user) == 0);
    CHECK(processed.loss > 0.1 && processed.loss < 0.3 && processed.resent_shares > 0 && processed.resent_bytes > 0);
    nvsp_collected state = NVSP_INITIALIZER(nvsp_collected);
    for (uint32_t k = 0; k < processed.resent_shares; k++) {
        EXPECT(NVSP_OK, nvsp_sender_next(sender, 1, bytes, MTU, &size));
        EXPECT(NVSP_OK, nvsp_collector_push(collector, 1.2, bytes, size, &state));
    }
    CHECK(state.frame == 3 && state.bytes >= LATENT);
    EXPECT(NVSP_PENDING, nvsp_sender_next(sender, 1, bytes, MTU, &size));
    nvsp_sender_statistics sent = NVSP_INITIALIZER(nvsp_sender_statistics);
    EXPECT(NVSP_OK, nvsp_sender_get_statistics(sender, &sent));
    CHECK(sent.resent == processed.resent_shares);
    // Once only. A sender that remembers nothing says so.
    EXPECT(NVSP_OK, nvsp_collector_report(collector, 0, NULL, 0, NULL, 0, bytes, MTU, &size));
    EXPECT(NVSP_OK, nvsp_sender_process_report(sender, 1.3, bytes, size, &processed));
    CHECK(processed.resent_shares == 0 && processed.kept_count == 0 && processed.user_bytes == 0);
    CHECK(processed.loss == -1);
    nvsp_destroy(sender);
    options.flags = 0;
    sender = new_sender(&options);
    EXPECT(NVSP_ERR_STATE, nvsp_sender_process_report(sender, 1, bytes, size, &processed));
    nvsp_destroy(sender);
    nvsp_destroy(collector);
}

static void out_of_range(void) {
    nvsp_sender *sender = NULL;
    nvsp_collector *collector = NULL;
    const uint32_t mtus[] = {0, 1, 15, 65536, UINT32_MAX};
    const nvsp_sender_options good = link_options();
    for (int i = 0; i < 5; i++) {
        EXPECT(NVSP_ERR_MODEM, nvsp_sender_create(mtus[i], &good, &sender));
    }
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_create(0, NULL, &collector));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_create(65536, NULL, &collector));
    for (int field = 0; field < 7; field++) {
        const double wrong[] = {-2, NAN, INFINITY, -INFINITY, -DBL_MAX};
        for (int i = 0; i < 5; i++) {
            nvsp_sender_options options = good;
            double *fields[] = {&options.bit_rate, &options.frame_rate, &options.latency, &options.delay,
                                &options.spread, &options.loss, &options.burst};
            *fields[field] = wrong[i];
            EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_create(MTU, &options, &sender));
        }
        // However large or small, a number gives a sender or a status.
        const double odd[] = {DBL_MAX, 1e300, 1e30, 1e-30, DBL_MIN, 0.5, 2};
        for (int i = 0; i < 7; i++) {
            nvsp_sender_options options = good;
            double *fields[] = {&options.bit_rate, &options.frame_rate, &options.latency, &options.delay,
                                &options.spread, &options.loss, &options.burst};
            *fields[field] = odd[i];
            options.overhead = i % 2 ? UINT32_MAX : 0;
            const nvsp_status status = nvsp_sender_create(MTU, &options, &sender);
            CHECK(status == NVSP_OK || status == NVSP_ERR_ARGUMENT || status == NVSP_ERR_MEMORY);
            if (status == NVSP_OK) {
                uint32_t budget = 0;
                EXPECT(NVSP_OK, nvsp_sender_plan(sender, 1, &budget));
                EXPECT(NVSP_OK, nvsp_sender_plan(sender, DBL_MAX, &budget));
                const nvsp_status pushed =
                    nvsp_sender_push(sender, 0, packets[1].bytes, packets[1].size, NULL, 0, NULL);
                CHECK(pushed == NVSP_OK || pushed == NVSP_ERR_STATE || pushed == NVSP_ERR_BUDGET);
                nvsp_destroy(sender);
                sender = NULL;
            }
        }
    }
    for (int i = 0; i < 6; i++) {
        nvsp_sender_options options = good;
        options.bit_rate = i == 0 ? 0 : options.bit_rate;
        options.frame_rate = i == 1 ? 0 : options.frame_rate;
        options.shares = i == 2 ? 65 : 0;
        options.user_bytes = i == 3 ? 256 : 0;
        options.stream = i == 4 ? 4 : 0;
        options.flags = i == 5 ? 8 : NVSP_SENDER_EXPECT_REPORTS;
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_create(MTU, &options, &sender));
    }
    for (int i = 0; i < 6; i++) {
        nvsp_collector_options options = NVSP_INITIALIZER(nvsp_collector_options);
        uint64_t bytes = 77;
        options.shares = i == 0 ? 2049 : 0;
        options.packets = i == 1 ? 65 : 0;
        options.streams = i == 2 ? 5 : 0;
        options.age = i == 3 ? -1 : i == 4 ? NAN : 0;
        options.flags = i == 5 ? 2 : 0;
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_create(MTU, &options, &collector));
        EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_memory(MTU, &options, &bytes));
        CHECK(bytes == 77);
    }
    CHECK(sender == NULL && collector == NULL);
    uint64_t bytes = 0;
    EXPECT(NVSP_OK, nvsp_collector_memory(MTU, NULL, &bytes));
    CHECK(bytes >= 16 * 32 * MTU && bytes < 3 * 16 * 32 * MTU);
    EXPECT(NVSP_OK, nvsp_collector_create(65535, NULL, &collector));
    nvsp_destroy(collector);
}

// Nonsense, and shares whose checks are made right: each call gives a result or a status.
static void garbage(void) {
    nvsp_collector *collector = new_collector(4);
    for (int k = 0; k < (few() ? 2000 : 200000); k++) {
        const size_t size = random_below(&seed, 40);
        uint8_t *bytes = malloc(size > 0 ? size : 1);
        for (size_t i = 0; i < size; i++) {
            bytes[i] = (uint8_t)random_bits(&seed);
        }
        if (size >= 9 && k % 4 != 0) {
            bytes[0] = 0x40 | (bytes[0] & 0x30);  // A share of few frame numbers.
            bytes[1] &= 0x1f;
            uint8_t *lengths = bytes + (bytes[1] & 8 ? 4 : 3);  // Index and count take two bytes, or one.
            lengths[0] = (uint8_t)(1 + lengths[0] % 4);
            lengths[1] %= 4;
            const size_t header = (size_t)(lengths + 2 - bytes), data = (size_t)lengths[0] + lengths[1];
            if (header + 2 + data <= size) {
                const uint16_t check = crc16(crc16(0xffff, bytes, header), bytes + header + 2, data);
                memcpy(bytes + header, &check, 2);
            }
        }
        nvsp_collected state = NVSP_INITIALIZER(nvsp_collected);
        const nvsp_status status = nvsp_collector_push(collector, k * 0.01, bytes, size, &state);
        CHECK(status == NVSP_OK || status == NVSP_ERR_MODEM || status == NVSP_ERR_NEWER);
        CHECK(status != NVSP_OK || (state.event >= NVSP_EVENT_KEPT && state.bytes == 0));
        free(bytes);
    }
    nvsp_destroy(collector);
}

int main(int argc, char **argv) {
    set_up(argc, argv);
    nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
    options.rate = NVSP_RATE_BYTES;
    options.rate_value = 400;
    rig_add(&both, &dive.camera, &options);
    encode_all(&both, &dive, packets);

    long_run();
    pictures();
    between();
    skipped_frames();
    wrong_states();
    steady_bytes();
    reports();
    out_of_range();
    garbage();
    return tear_down();
}
