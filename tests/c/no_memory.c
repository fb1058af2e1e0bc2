// A host without memory: the calls that take memory give NVSP_ERR_MEMORY, and work again once there is some.
//
// This program's own malloc, calloc and so on replace the C library's. Calls from within libnvsprior.so fail on demand:
// the n-th one alone, or the n-th one and all after it. Calls of the Vulkan loader and driver never fail here, as a
// driver may end the process then: Mesa's does.
//
// As a second part the program runs itself under limited address space. There the driver's calls fail too. So what the
// driver compiles is compiled before the limit is set.
//
// With the variable NVSP_TEST_EVERY every n is tried, which takes long; else those of the calls that set memory aside,
// and a sample of the others.

#define _GNU_SOURCE

#include "common.h"
#include "heap_hooks.h"

#include <malloc.h>
#include <stdatomic.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

// Which calls fail; 0: none. Calls are counted while `armed` is set.
static atomic_long fail_at, fail_from, calls;
static atomic_int armed;

static int from_library(const void *caller) {
    return atomic_load(&armed) && in_library(caller);
}

// Whether a call fails.
static int heap_refused(const void *caller) {
    if (!from_library(caller)) {
        return 0;
    }
    const long call = atomic_fetch_add(&calls, 1) + 1;
    const long from = atomic_load(&fail_from);
    return call == atomic_load(&fail_at) || (from != 0 && call >= from);
}

// What is tried: each makes something, and undoes it.
static nvsp_status try_vehicle(void) {
    nvsp_vehicle *made = NULL;
    nvsp_vehicle_options options = vehicle_options(4096, 100000, 10);
    nvsp_status status = nvsp_vehicle_create(NULL, NULL, NULL, NULL, &options, &made);
    CHECK((status == NVSP_OK) == (made != NULL));
    uint32_t budget = 0;
    if (status == NVSP_OK) {
        MUST(nvsp_vehicle_plan(made, 0, 0, NULL, &budget));
        MUST(nvsp_vehicle_packet(made, 0, packets[0].bytes, packets[0].size, NULL, 0));
    }
    nvsp_destroy(made);
    return status;
}

static nvsp_status try_topside(void) {
    nvsp_topside *made = NULL;
    nvsp_topside_options options = topside_options(4096);
    options.max_shares = 256;
    const nvsp_status status = nvsp_topside_create(NULL, NULL, &options, &made);
    CHECK((status == NVSP_OK) == (made != NULL));
    nvsp_destroy(made);
    return status;
}

static nvsp_status try_prior(void) {
    nvsp_prior *made = NULL;
    const nvsp_status status = nvsp_prior_open(both.engine, dive.prior, NULL, &made);
    CHECK((status == NVSP_OK) == (made != NULL));
    nvsp_destroy(made);
    return status;
}

static nvsp_status try_compact_prior(void) {
    nvsp_prior *made = NULL;
    const nvsp_status status = nvsp_prior_open(both.engine, dive.compact_prior, NULL, &made);
    CHECK((status == NVSP_OK) == (made != NULL));
    nvsp_destroy(made);
    return status;
}

// Opens the prior in blocks, and encodes a frame with it: blocks are read.
static nvsp_status try_blocked_prior(void) {
    nvsp_prior *made = NULL;
    nvsp_prior_options options = NVSP_INITIALIZER(nvsp_prior_options);
    options.blocks_memory = 2;
    nvsp_status status = nvsp_prior_open(both.engine, dive.blocked_prior, &options, &made);
    CHECK((status == NVSP_OK) == (made != NULL));
    nvsp_encoder *encoder = NULL;
    if (status == NVSP_OK) {
        status = nvsp_encoder_create(both.engine, made, &dive.camera, NULL, &encoder);
    }
    if (status == NVSP_OK) {
        const nvsp_image image = scene_image(&dive, 0);
        uint8_t bytes[65536];
        size_t written = 77;
        status = nvsp_encode(encoder, &image, with_hint(&dive.poses[0]), bytes, sizeof bytes, &written, NULL);
        CHECK((status == NVSP_OK) == (written != 77));
    }
    nvsp_destroy(encoder);
    nvsp_destroy(made);
    return status;
}

static nvsp_status encode_with(const nvsp_camera *camera) {
    nvsp_encoder *made = NULL;
    nvsp_status status = nvsp_encoder_create(both.engine, both.prior, camera, NULL, &made);
    CHECK((status == NVSP_OK) == (made != NULL));
    if (status == NVSP_OK) {
        const nvsp_image image = scene_image(&dive, 0);
        uint8_t bytes[65536];
        size_t written = 77;
        status = nvsp_encode(made, &image, with_hint(&dive.poses[0]), bytes, sizeof bytes, &written, NULL);
        CHECK((status == NVSP_OK) == (written != 77));
        if (status == NVSP_OK && camera == &dive.camera) {
            CHECK(written == packets[0].size && memcmp(bytes, packets[0].bytes, written) == 0);
        }
    }
    nvsp_destroy(made);
    return status;
}

static nvsp_status try_encoder(void) { return encode_with(&dive.camera); }

static nvsp_status try_large_encoder(void) {
    const nvsp_camera large = scaled_camera(&dive, 640);
    return encode_with(&large);
}

static nvsp_status decode_with(nvsp_decoder *decoder, const uint8_t *bytes, size_t size) {
    nvsp_status status = nvsp_decode_begin(decoder, bytes, size, 0);
    if (status == NVSP_OK) {
        MUST(nvsp_wait(decoder, 600000));
        status = nvsp_decode_finish(decoder, NULL, NULL);
    }
    return status;
}

// On the decoder's own thread.
static nvsp_status try_decoder(void) {
    nvsp_decoder *made = NULL;
    nvsp_status status = nvsp_decoder_create(both.engine, both.prior, NULL, &made);
    CHECK((status == NVSP_OK) == (made != NULL));
    if (status == NVSP_OK) {
        status = decode_with(made, packets[0].bytes, packets[0].size);
    }
    nvsp_destroy(made);
    return status;
}

// Two frames of a stream, on both sides: the first takes memory for reference frames.
static nvsp_status try_stream(void) {
    nvsp_encoder_options options = NVSP_INITIALIZER(nvsp_encoder_options);
    options.mode = NVSP_MODE_CHAIN;
    nvsp_encoder *encoder = NULL;
    nvsp_decoder *decoder = NULL;
    nvsp_status status = nvsp_encoder_create(both.engine, both.prior, &dive.camera, &options, &encoder);
    if (status == NVSP_OK) {
        status = nvsp_decoder_create(both.engine, both.prior, NULL, &decoder);
    }
    for (int frame = 0; frame < 2 && status == NVSP_OK; frame++) {
        const nvsp_image image = scene_image(&dive, frame);
        uint8_t bytes[65536];
        size_t written = 0;
        status = nvsp_encode(encoder, &image, with_hint(&dive.poses[frame]), bytes, sizeof bytes, &written, NULL);
        if (status == NVSP_OK) {
            nvsp_decoded decoded = NVSP_INITIALIZER(nvsp_decoded);
            status = nvsp_decode(decoder, bytes, written, 0, NULL, &decoded);
            CHECK(status != NVSP_OK || (decoded.flags & NVSP_DECODED_KEPT));
        }
    }
    nvsp_destroy(encoder);
    nvsp_destroy(decoder);
    return status;
}

// A valid packet of 49 bytes that names a picture of 2048 by 2048.
static uint8_t hostile[SESSION_LATENT + SESSION];

// The first packet with another size and camera, without a difference picture: docs/format/packet.md has the format.
static void make_hostile(void) {
    const uint32_t side = 2047, size = side | side << 12;
    const float camera[4] = {2000, 2000, 1024, 1024};
    memcpy(hostile, packets[0].bytes, sizeof hostile);
    hostile[0] &= 0x1f;
    hostile[1] = 4;
    for (int i = 0; i < 3; i++) {
        hostile[SESSION_LATENT + 4 + i] = (uint8_t)(size >> 8 * i);
    }
    memcpy(hostile + SESSION_LATENT + 7, camera, 16);
    seal_session(hostile);
}

static nvsp_status try_hostile(void) {
    nvsp_decoder *made = NULL;
    nvsp_status status = nvsp_decoder_create(both.engine, both.prior, NULL, &made);
    if (status == NVSP_OK) {
        status = nvsp_decode(made, hostile, sizeof hostile, 0, NULL, NULL);
    }
    nvsp_destroy(made);
    return status;
}

static nvsp_status try_engine(void) {
    nvsp_engine *made = NULL;
    const nvsp_status status = nvsp_engine_create(NULL, &made);
    CHECK((status == NVSP_OK) == (made != NULL));
    nvsp_destroy(made);
    return status;
}

static const struct attempt {
    const char *name;
    nvsp_status (*call)(void);
    int most;  // Places at which calls are made to fail, at most, unless all are tried.
    int large;  // Whether it takes more than what is left over from before.
} attempts[] = {
    {"vehicle", try_vehicle, 400, 0},
    {"topside", try_topside, 400, 1},
    {"prior", try_prior, 400, 1},
    {"compact prior", try_compact_prior, 400, 1},
    {"blocked prior", try_blocked_prior, 200, 0},
    {"encoder", try_encoder, 400, 1},
    {"decoder", try_decoder, 400, 0},
    {"stream", try_stream, 200, 1},
    {"hostile packet", try_hostile, 40, 1},
    {"engine", try_engine, 12, 1},
    {"large encoder", try_large_encoder, 12, 1},
};
#define ATTEMPTS (sizeof attempts / sizeof *attempts)

static nvsp_status with_failures(const struct attempt *attempt, long at, long from) {
    atomic_store(&calls, 0);
    atomic_store(&fail_at, at);
    atomic_store(&fail_from, from);
    atomic_store(&armed, 1);
    const nvsp_status status = attempt->call();
    atomic_store(&armed, 0);
    return status;
}

static void every_call_fails(const struct attempt *attempt) {
    EXPECT(NVSP_OK, attempt->call());
    EXPECT(NVSP_OK, with_failures(attempt, 0, 0));
    const long count = atomic_load(&calls);
    // The large encoder makes the small one's calls, only larger: a sample will do.
    const int every = getenv("NVSP_TEST_EVERY") != NULL && attempt->call != try_large_encoder;
    const int few_places = attempt->most < 40 && !every;
    const long step = every ? 1 : few() ? count / 8 + 1 : (count + attempt->most - 1) / attempt->most;
    long tried = 0, ended[2] = {0, 0};
    // Every one of the first calls: they set memory aside.
    for (long n = 1; n <= count; n += n < 32 && !few_places ? 1 : step, tried++) {
        for (int lasting = 0; lasting < 2; lasting++) {
            const nvsp_status status = with_failures(attempt, lasting ? 0 : n, lasting ? n : 0);
            CHECK(status == NVSP_OK || status == NVSP_ERR_MEMORY);
            ended[lasting] += status == NVSP_ERR_MEMORY;
        }
    }
    EXPECT(NVSP_OK, attempt->call());
    printf("%-14s %5ld calls, %3ld of them made to fail: NVSP_ERR_MEMORY at %ld if one fails, at %ld if all fail from "
           "there on\n",
           attempt->name, count, tried, ended[0], ended[1]);
    CHECK((few_places || ended[0] > 0) && ended[1] > 0);
}

static void open_all(int argc, char **argv) {
    set_up(argc, argv);
    rig_add(&both, &dive.camera, NULL);
    encode_all(&both, &dive, packets);
    EXPECT(NVSP_OK, nvsp_decode(both.decoder, packets[0].bytes, packets[0].size, 0, NULL, NULL));
    make_hostile();
}

// The bytes of address space that the process has now.
static size_t address_space(void) {
    FILE *file = fopen("/proc/self/statm", "r");
    unsigned long pages = 0;
    if (file == NULL || fscanf(file, "%lu", &pages) != 1) {
        give_up("no /proc/self/statm");
    }
    fclose(file);
    return pages * (size_t)sysconf(_SC_PAGESIZE);
}

// In a process of its own: what an attempt comes to if only so much more address space is left.
static int limited(int argc, char **argv) {
    const struct attempt *attempt = &attempts[atoi(argv[2])];
    open_all(argc, argv);
    MUST(attempt->call());
    malloc_trim(0);
    const size_t limit = address_space() + ((size_t)atol(argv[3]) << 10);
    const struct rlimit space = {limit, limit};
    if (setrlimit(RLIMIT_AS, &space) != 0) {
        give_up("setrlimit");
    }
    const nvsp_status status = attempt->call();
    return status == NVSP_OK ? 0 : status == NVSP_ERR_MEMORY ? 1 : 2;
}

static void under_limits(const char *program, const char *folder, size_t which) {
    const int largest = 1 << 21;
    int ends[3] = {0, 0, 0}, killed = 0;
    for (int kibibytes = 64; kibibytes <= largest; kibibytes *= few() ? 32 : 3) {
        char command[2000];
        snprintf(command, sizeof command, "'%s' '%s' %zu %d >/dev/null", program, folder, which, kibibytes);
        const int ended = system(command);
        const int code = WIFEXITED(ended) ? WEXITSTATUS(ended) : 99;
        if (code <= 1) {
            ends[code]++;
        } else if (code == 2) {
            ends[2]++;
        } else {
            killed++;
            printf("%s with %d KiB: ended with %d\n", attempts[which].name, kibibytes, code);
        }
    }
    printf("%-14s under limits: %d valid, %d NVSP_ERR_MEMORY, %d another error, %d killed\n", attempts[which].name,
           ends[0], ends[1], ends[2], killed);
    CHECK(ends[0] > 0 && ends[2] == 0 && killed == 0);
    CHECK(ends[1] > 0 || !attempts[which].large);
}

int main(int argc, char **argv) {
    if (argc == 4) {
        return limited(argc, argv);
    }
    find_library();
    CHECK(code_end > code_start);
    open_all(argc, argv);
    for (size_t i = 0; i < ATTEMPTS; i++) {
        every_call_fails(&attempts[i]);
    }
    for (size_t i = 0; i < 8; i++) {
        under_limits(argv[0], argv[1], i);
    }
    return tear_down();
}
