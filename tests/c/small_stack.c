// A host whose threads have 64 kB of stack, or the least that the system gives. What calls take of it is measured.

#define _GNU_SOURCE
#include "common.h"

#include <pthread.h>
#include <sys/mman.h>
#include <unistd.h>

#define WANTED (64u << 10)
#define MOST (32u << 10)
#define UNTOUCHED 0xa5

static uint8_t packet_bytes[8192], modem_frame[256];
static uint8_t *shown;

// Both ends of a link, over one frame.
static void over_a_link(void) {
    const nvsp_vehicle_options up = vehicle_options(sizeof modem_frame, 8000, 5);
    const nvsp_topside_options down = topside_options(sizeof modem_frame);
    nvsp_encoder_options coded = NVSP_INITIALIZER(nvsp_encoder_options);
    nvsp_vehicle *vehicle = NULL;
    nvsp_topside *topside = NULL;
    MUST(nvsp_vehicle_create(both.engine, both.prior, &dive.camera, &coded, &up, &vehicle));
    MUST(nvsp_topside_create(both.engine, both.prior, &down, &topside));
    const nvsp_image image = scene_image(&dive, 0);
    MUST(nvsp_vehicle_frame(vehicle, 0, &image, with_hint(&dive.poses[0]), NULL, 0));
    MUST(nvsp_wait(vehicle, 60000));
    size_t written = 0;
    int frames = 0;
    while (nvsp_vehicle_transmit(vehicle, 1, sizeof modem_frame, modem_frame, &written, NULL) == NVSP_OK) {
        EXPECT(NVSP_OK, nvsp_topside_receive(topside, 1, modem_frame, written));
        frames++;
    }
    CHECK(frames > 0);
    nvsp_destroy(topside);
    nvsp_destroy(vehicle);
}

static void *all_calls(void *unused) {
    (void)unused;
    rig_open(&both, &dive);
    rig_add(&both, &dive.camera, NULL);
    const nvsp_image image = scene_image(&dive, 0);
    size_t size = 0;
    MUST(nvsp_encode(both.encoder, &image, with_hint(&dive.poses[0]), packet_bytes, sizeof packet_bytes, &size, NULL));
    nvsp_picture place = place_of(shown, dive.camera.width, dive.camera.height);
    MUST(nvsp_decode(both.decoder, packet_bytes, size, 0, &place, NULL));
    EXPECT(NVSP_ERR_PACKET, nvsp_decode(both.decoder, packet_bytes, 3, 0, &place, NULL));
    CHECK(says(both.decoder, "latent part"));
    CHECK(says(NULL, "latent part"));
    MUST(nvsp_decoder_draw(both.decoder, &dive.poses[1], &place));
    over_a_link();
    rig_close(&both);
    return NULL;
}

// Bytes that were touched of a stack, which grows downwards.
static size_t touched(const uint8_t *stack, size_t size) {
    size_t left = 0;
    while (left < size && stack[left] == UNTOUCHED) left++;
    return size - left;
}

int main(int argc, char **argv) {
    read_dive(argc, argv);
    shown = malloc(dive.size);
    const long least = sysconf(_SC_THREAD_STACK_MIN);
    const size_t size = least > (long)WANTED ? (size_t)least : WANTED;
    uint8_t *stack = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (stack == MAP_FAILED || shown == NULL) give_up("no memory");
    memset(stack, UNTOUCHED, size);
    pthread_attr_t attributes;
    pthread_t thread = 0;
    if (pthread_attr_init(&attributes) != 0 || pthread_attr_setstack(&attributes, stack, size) != 0
        || pthread_create(&thread, &attributes, all_calls, NULL) != 0) {
        give_up("no thread with a stack of its own");
    }
    pthread_join(thread, NULL);
    pthread_attr_destroy(&attributes);
    printf("%zu bytes of the caller's stack, of %zu\n", touched(stack, size), size);
    CHECK(touched(stack, size) <= MOST);
    free(shown);
    return tear_down();
}
