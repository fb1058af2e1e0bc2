// Several threads: on handles that share an engine and a prior, and on one handle at once.

#define _GNU_SOURCE

#include "common.h"

#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdatomic.h>
#include <unistd.h>

// Encodes and decodes the dive on its own handles, while other threads do the same.
static void *alone(void *unused) {
    (void)unused;
    rig own = {.engine = both.engine, .prior = both.prior};
    rig_add(&own, &dive.camera, NULL);
    packet found[MAX_FRAMES];
    encode_all(&own, &dive, found);
    for (int i = 0; i < dive.frames; i++) {
        CHECK(found[i].size == packets[i].size
              && memcmp(found[i].bytes, packets[i].bytes, found[i].size) == 0);
        EXPECT(NVSP_OK, nvsp_decode(own.decoder, found[i].bytes, found[i].size, 0, NULL, NULL));
        free(found[i].bytes);
        nvsp_engine_info info = NVSP_INITIALIZER(nvsp_engine_info);
        EXPECT(NVSP_OK, nvsp_engine_get_info(both.engine, &info));
    }
    nvsp_destroy(own.decoder);
    nvsp_destroy(own.encoder);
    return NULL;
}

static void start(pthread_t *thread, void *(*body)(void *)) {
    if (pthread_create(thread, NULL, body, NULL) != 0) {
        give_up("no thread");
    }
}

static void side_by_side(void) {
    pthread_t threads[3];
    for (int i = 0; i < 3; i++) {
        start(&threads[i], alone);
    }
    for (int i = 0; i < 3; i++) {
        pthread_join(threads[i], NULL);
    }
}

static atomic_int over, intrusions;

// Calls on a handle that another thread uses. The call is refused, or done if that thread is between two calls.
static void *intrude(void *unused) {
    (void)unused;
    const nvsp_image image = NVSP_INITIALIZER(nvsp_image);
    while (!over) {
        const nvsp_status statuses[] = {
            nvsp_wait(both.encoder, 0),
            nvsp_wait(both.encoder, 0),
            nvsp_encode_begin(both.encoder, &image, NULL),
            nvsp_encoder_set_rate(both.encoder, NVSP_RATE_DEFAULT, 0),
            nvsp_wait(both.decoder, 0),
            nvsp_decoder_add_camera(both.decoder, &dive.camera),
            nvsp_decode(both.decoder, packets[0].bytes, 12, 0, NULL, NULL),
        };
        for (size_t i = 0; i < sizeof statuses / sizeof *statuses; i++) {
            intrusions += statuses[i] == NVSP_ERR_BUSY;
            CHECK(statuses[i] == NVSP_ERR_BUSY || statuses[i] == NVSP_ERR_UNFINISHED
                  || statuses[i] == NVSP_ERR_STATE
                  || statuses[i] == NVSP_ERR_ARGUMENT || statuses[i] == NVSP_ERR_PACKET
                  || statuses[i] == NVSP_OK);
        }
        char text[512];
        CHECK(nvsp_last_error(both.encoder, text, sizeof text) == NVSP_OK);
        usleep(100);
    }
    return NULL;
}

// The owner's frames are as they would be without the other thread. A call that finds the handle in
// use is repeated.
static void intruded_upon(void) {
    pthread_t thread;
    start(&thread, intrude);
    uint8_t bytes[4096];
    for (int i = 0; i < dive.frames; i++) {
        const nvsp_image image = scene_image(&dive, i);
        size_t size = 0;
        nvsp_status status;
        do {
            status = nvsp_encode(both.encoder, &image, with_hint(i == 0 ? &dive.poses[0] : NULL), bytes,
                                 sizeof bytes, &size, NULL);
        } while (status == NVSP_ERR_BUSY);
        EXPECT(NVSP_OK, status);
        CHECK(size == packets[i].size && memcmp(bytes, packets[i].bytes, size) == 0);
        do {
            status = nvsp_decode(both.decoder, bytes, size, 0, NULL, NULL);
        } while (status == NVSP_ERR_BUSY);
        EXPECT(NVSP_OK, status);
    }
    over = 1;
    pthread_join(thread, NULL);
    CHECK(intrusions > 0);
}

static int started;

// Runs on the library's own threads.
static void on_start(void *user, const char *name) {
    sigset_t blocked;
    char own[16];
    pthread_sigmask(SIG_SETMASK, NULL, &blocked);
    CHECK(sigismember(&blocked, SIGTERM) == 1 && sigismember(&blocked, SIGALRM) == 1
          && sigismember(&blocked, SIGUSR1) == 1 && sigismember(&blocked, SIGSEGV) == 0);
    CHECK(pthread_getname_np(pthread_self(), own, sizeof own) == 0 && strcmp(own, name) == 0);
    CHECK(strcmp(name, "nvsp-encoder") == 0 || strcmp(name, "nvsp-decoder") == 0);
    CHECK(!pthread_equal(pthread_self(), *(const pthread_t *)user));
    cpu_set_t first;
    CPU_ZERO(&first);
    CPU_SET(0, &first);
    sched_setaffinity(0, sizeof first, &first);
    pthread_setname_np(pthread_self(), "of the caller");
    started++;
}

// Each thread calls the callback once, before its first work. The caller's own signals stay as they were.
static void threads_that_start(void) {
    pthread_t self = pthread_self();
    nvsp_engine_options options = NVSP_INITIALIZER(nvsp_engine_options);
    options.thread_start = on_start;
    options.thread_start_user = &self;
    rig own = {0};
    MUST(nvsp_engine_create(&options, &own.engine));
    MUST(nvsp_prior_open(own.engine, dive.prior, NULL, &own.prior));
    rig_add(&own, &dive.camera, NULL);
    const nvsp_image image = scene_image(&dive, 0);
    uint8_t bytes[4096];
    size_t size = 0;
    for (int i = 0; i < 2; i++) {
        MUST(nvsp_encode_begin(own.encoder, &image, with_hint(&dive.poses[0])));
        MUST(nvsp_wait(own.encoder, 600000));
        MUST(nvsp_encode_finish(own.encoder, bytes, sizeof bytes, &size, NULL));
        CHECK(started == (i == 0 ? 1 : 2));
        MUST(nvsp_decode_begin(own.decoder, bytes, size, 0));
        MUST(nvsp_wait(own.decoder, 600000));
        MUST(nvsp_decode_finish(own.decoder, NULL, NULL));
        CHECK(started == 2);
    }
    sigset_t blocked;
    pthread_sigmask(SIG_SETMASK, NULL, &blocked);
    CHECK(sigismember(&blocked, SIGTERM) == 0);
    rig_close(&own);
}

int main(int argc, char **argv) {
    read_dive(argc, argv);
    threads_that_start();
    rig_open(&both, &dive);
    rig_add(&both, &dive.camera, NULL);
    encode_all(&both, &dive, packets);
    nvsp_destroy(both.encoder);
    nvsp_destroy(both.decoder);
    rig_add(&both, &dive.camera, NULL);

    side_by_side();
    intruded_upon();
    return tear_down();
}
