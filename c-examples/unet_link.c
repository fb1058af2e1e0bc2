// Pictures over a UnetStack network, an agent for each side: a sketch, as it needs a modem (or UnetStack's simulator).
//
// It relies on these calls of UnetStack's C API (unetsocket/c of https://github.com/org-arl/unet-contrib,
// read in its version for UnetStack 3), and on no others:
//   unetsocket_t unetsocket_open(const char *hostname, int port);
//   int unetsocket_bind(unetsocket_t, int protocol);                     0: done
//   void unetsocket_set_timeout(unetsocket_t, long milliseconds);        -1: for ever
//   int unetsocket_send(unetsocket_t, uint8_t *data, int size, int to, int protocol);   0: accepted
//   fjage_msg_t unetsocket_receive(unetsocket_t);                        NULL: nothing within the time
//   int fjage_msg_get_byte_array(fjage_msg_t, const char *key, uint8_t *value, int room);
//                                                                        bytes that there are, or -1
//   void fjage_msg_destroy(fjage_msg_t);
//   int unetsocket_close(unetsocket_t);
// and on the number USER, the first that programs may use for a protocol of their own.
//
// A datagram holds one modem frame. MTU must not be larger than what the node's link carries in one frame. Else
// UnetStack splits datagrams again, and the loss of one part costs the whole. UnetStack hands over no damaged
// datagrams, hence NVSP_LINK_MODEM_CHECKS. It takes a datagram when it has room for one, hence NVSP_LINK_PULL.

#define _POSIX_C_SOURCE 199309L

#include "example.h"

#include <string.h>
#include <time.h>
#include <unet.h>

static const char usage[] =
    "usage: unet_link vehicle HOST PORT MTU NODE PRIOR.ply CAMERA START FRAME.ppm...\n"
    "       unet_link topside HOST PORT MTU NODE PRIOR.ply CAMERA FOLDER\n"
    "HOST and PORT (1100) of the modem; NODE: address of the other side\n"
    "FOLDER: each picture replaces FOLDER/FRAME.ppm as more of its packet arrives\n";

#define PROTOCOL USER
#define MAX_BYTES (1 << 16)
#define FRAMES_A_SECOND 2

static uint8_t bytes[MAX_BYTES];

static double now(void) {
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

// Reports a failure that ends nothing: a link brings what cannot be read.
static int done(nvsp_status status, const char *what) {
    char text[512] = "";
    if (status < NVSP_OK && nvsp_last_error(NULL, text, sizeof text) == NVSP_OK) {
        fprintf(stderr, "%s: %s\n", what, text);
    }
    return status == NVSP_OK;
}

// What came within 20 ms; its size, or 0.
static size_t received(unetsocket_t modem) {
    fjage_msg_t message = unetsocket_receive(modem);
    if (message == NULL) {
        return 0;
    }
    const int size = fjage_msg_get_byte_array(message, "data", bytes, sizeof bytes);
    fjage_msg_destroy(message);
    return size > 0 && size <= (int)sizeof bytes ? (size_t)size : 0;
}

static int vehicle_agent(unetsocket_t modem, uint32_t mtu, int node, nvsp_engine *engine, nvsp_prior *prior,
                         const nvsp_camera *camera, const nvsp_pose *start, char **paths, int count) {
    nvsp_vehicle *vehicle = NULL;
    nvsp_vehicle_options options = NVSP_INITIALIZER(nvsp_vehicle_options);
    options.mtu = mtu;
    options.frame_rate = FRAMES_A_SECOND;
    options.flags = NVSP_LINK_PULL;
    const int made = done(nvsp_vehicle_create(engine, prior, camera, NULL, &options, &vehicle), "making a vehicle");
    const double begin = now();
    for (int i = 0; made && i < count;) {
        ppm picture = {0, 0, NULL};
        if (now() >= begin + (double)i / FRAMES_A_SECOND && ppm_read(paths[i++], &picture)) {
            const nvsp_image image = ppm_image(&picture);
            nvsp_frame_info info = NVSP_INITIALIZER(nvsp_frame_info);
            info.hint = i == 1 ? start : NULL;
            done(nvsp_vehicle_frame(vehicle, now(), &image, &info, NULL, 0), "encoding");
            free(picture.pixels);
        }
        size_t size = received(modem);
        if (size > 0) {
            done(nvsp_vehicle_receive(vehicle, now(), bytes, size), "receiving");
        }
        // It returns once the datagram is accepted.
        if (nvsp_vehicle_transmit(vehicle, now(), mtu, bytes, &size, NULL) == NVSP_OK
            && unetsocket_send(modem, bytes, (int)size, node, PROTOCOL) != 0) {
            fprintf(stderr, "the modem refuses a modem frame\n");  // The others are of use.
        }
    }
    nvsp_destroy(vehicle);
    return made;
}

static int topside_agent(unetsocket_t modem, uint32_t mtu, int node, nvsp_engine *engine, nvsp_prior *prior,
                         const nvsp_camera *camera, const char *folder) {
    nvsp_topside *topside = NULL;
    nvsp_topside_options options = NVSP_INITIALIZER(nvsp_topside_options);
    options.mtu = mtu;
    options.flags = NVSP_LINK_MODEM_CHECKS;
    ppm picture = {camera->width, camera->height, malloc((size_t)3 * camera->width * camera->height)};
    const int made = done(nvsp_topside_create(engine, prior, &options, &topside), "making a topside");
    while (made && picture.pixels != NULL) {
        size_t size = received(modem);
        if (size > 0) {
            done(nvsp_topside_receive(topside, now(), bytes, size), "receiving");
        }
        nvsp_picture place = {NVSP_HEAD(nvsp_picture), .format = NVSP_FORMAT_RGB8, .pixels = picture.pixels,
                              .size = ppm_size(&picture)};
        nvsp_decoded shown = NVSP_INITIALIZER(nvsp_decoded);
        if (done(nvsp_topside_picture(topside, now(), &place, &shown), "decoding")) {
            char path[4096];
            snprintf(path, sizeof path, "%s/%u.ppm", folder, shown.frame);
            ppm_write(path, &picture);
        }
        if (nvsp_topside_report(topside, now(), bytes, sizeof bytes, &size, NULL) == NVSP_OK) {
            unetsocket_send(modem, bytes, (int)size, node, PROTOCOL);
        }
    }
    free(picture.pixels);
    nvsp_destroy(topside);
    return made;
}

int main(int argc, char **argv) {
    nvsp_camera camera = NVSP_INITIALIZER(nvsp_camera);
    nvsp_pose start = NVSP_INITIALIZER(nvsp_pose);
    const int sends = argc > 9 && strcmp(argv[1], "vehicle") == 0;
    if (!(sends || (argc == 9 && strcmp(argv[1], "topside") == 0)) || !camera_of(argv[7], &camera)
        || (sends && !pose_of(argv[8], &start))) {
        fputs(usage, stderr);
        return 2;
    }
    unetsocket_t modem = unetsocket_open(argv[2], atoi(argv[3]));
    if (modem == NULL || unetsocket_bind(modem, PROTOCOL) != 0) {
        fprintf(stderr, "no modem at %s:%s\n", argv[2], argv[3]);
        return 1;
    }
    unetsocket_set_timeout(modem, 20);
    nvsp_engine *engine = NULL;
    nvsp_prior *prior = NULL;
    const uint32_t mtu = (uint32_t)strtoul(argv[4], NULL, 10);
    const int node = atoi(argv[5]);
    int right = open_prior(argv[6], &engine, &prior);
    if (right) {
        right = sends ? vehicle_agent(modem, mtu, node, engine, prior, &camera, &start, argv + 9, argc - 9)
                      : topside_agent(modem, mtu, node, engine, prior, &camera, argv[8]);
    }
    nvsp_destroy(prior);
    nvsp_destroy(engine);
    unetsocket_close(modem);
    return right ? 0 : 1;
}
