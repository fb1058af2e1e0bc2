// Packets over a UnetStack network: a sketch, as it needs a modem (or UnetStack's simulator).
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
// datagrams, hence NVSP_COLLECTOR_MODEM_CHECKS.

#include "example.h"

#include <string.h>
#include <unet.h>

static const char usage[] =
    "usage: unet_link send HOST PORT MTU NODE PACKET...\n"
    "       unet_link receive HOST PORT MTU PRIOR.ply FOLDER\n"
    "HOST and PORT (1100) of the modem; NODE: address to send to, 0 for all\n"
    "FOLDER: each picture replaces FOLDER/FRAME.ppm as more of its packet arrives\n";

#define PROTOCOL USER
#define MAX_BYTES (1 << 16)

// Sends a packet, its first modem frame first: that makes a picture by itself.
static int send_packet(unetsocket_t modem, int node, nvsp_sender *sender, const uint8_t *packet, size_t size) {
    static uint8_t frame[MAX_BYTES];
    size_t written = 0;
    const nvsp_status status = nvsp_sender_push(sender, 0, packet, size, NULL, 0, NULL);
    if (status != NVSP_OK) {
        fprintf(stderr, "sending: %s\n", nvsp_status_text(status));
        return 0;
    }
    while (nvsp_sender_next(sender, 0, frame, sizeof frame, &written) == NVSP_OK) {
        if (unetsocket_send(modem, frame, (int)written, node, PROTOCOL) != 0) {
            fprintf(stderr, "the modem refuses a modem frame\n");  // The others are of use.
        }
    }
    return 1;
}

static int send_all(unetsocket_t modem, uint32_t mtu, int node, char **paths, int count) {
    static uint8_t packet[MAX_BYTES];
    nvsp_sender *sender = NULL;
    nvsp_sender_options options;
    NVSP_INIT(&options);
    options.flags = NVSP_SENDER_UNPROTECTED;
    const nvsp_status status = nvsp_sender_create(mtu, &options, &sender);
    if (status != NVSP_OK) {
        fprintf(stderr, "making a sender: %s\n", nvsp_status_text(status));
    }
    int done = status == NVSP_OK;
    for (int i = 0; i < count && done; i++) {
        const size_t size = read_file(paths[i], packet, sizeof packet);
        done = size > 0 && send_packet(modem, node, sender, packet, size);
    }
    nvsp_destroy(sender);
    return done;
}

// Shows a packet as far as it has come: a picture in a file.
static int show(nvsp_decoder *decoder, nvsp_collector *collector, uint32_t frame, const char *folder) {
    static uint8_t packet[MAX_BYTES];
    size_t size = 0;
    nvsp_header header;
    NVSP_INIT(&header);
    nvsp_status status = nvsp_collector_fetch(collector, 0, frame, packet, sizeof packet, &size, NULL);
    if (status == NVSP_OK) {
        status = nvsp_decode_header(packet, size, NULL, &header);
    }
    if (status != NVSP_OK) {
        fprintf(stderr, "fetching: %s\n", nvsp_status_text(status));
        return 0;
    }
    // A packet that does not state its camera has a picture of the size of the one before.
    static uint32_t width, height;
    if (header.flags & NVSP_HEADER_SESSION) {
        width = header.width;
        height = header.height;
    }
    if (width == 0) {
        fprintf(stderr, "no packet has stated prior and camera yet\n");
        return 0;
    }
    ppm picture = {width, height, NULL};
    picture.pixels = malloc(ppm_size(&picture));
    if (picture.pixels == NULL) {
        fprintf(stderr, "out of memory\n");
        return 0;
    }
    nvsp_picture place = {NVSP_HEAD(nvsp_picture),
                          .format = NVSP_FORMAT_RGB8,
                          .pixels = picture.pixels,
                          .size = ppm_size(&picture)};
    nvsp_decoded decoded;
    NVSP_INIT(&decoded);
    status = nvsp_decode(decoder, packet, size, NVSP_DECODE_START, &place, &decoded);
    int done = 0;
    if (status == NVSP_OK) {
        char path[4096];
        snprintf(path, sizeof path, "%s/%u.ppm", folder, decoded.frame);
        done = ppm_write(path, &picture);
    } else {
        char text[512] = "";
        nvsp_last_error(decoder, text, sizeof text);
        fprintf(stderr, "decoding: %s: %s\n", nvsp_status_text(status), text);
    }
    free(picture.pixels);
    return done;
}

// Receives until nothing came for ten minutes.
static void receive_all(unetsocket_t modem, nvsp_decoder *decoder, nvsp_collector *collector, const char *folder) {
    static uint8_t frame[MAX_BYTES];
    unetsocket_set_timeout(modem, 600000);
    for (fjage_msg_t message; (message = unetsocket_receive(modem)) != NULL;) {
        const int size = fjage_msg_get_byte_array(message, "data", frame, sizeof frame);
        fjage_msg_destroy(message);
        nvsp_collected state;
        NVSP_INIT(&state);
        if (size > 0 && size <= (int)sizeof frame
            && nvsp_collector_push(collector, 0, frame, (size_t)size, &state) == NVSP_OK
            && (state.event == NVSP_EVENT_GROWN || state.event == NVSP_EVENT_COMPLETE)) {
            show(decoder, collector, state.frame, folder);
        }
    }
}

// Shares of the longest packet that the sender takes.
static uint32_t most_shares(uint32_t mtu) {
    if (mtu < 16) {
        return 8;
    }
    const uint32_t shares = 1 + MAX_BYTES / (mtu - 4);
    return shares < 2048 ? shares : 2048;
}

static int topside(unetsocket_t modem, uint32_t mtu, const char *prior_path, const char *folder) {
    nvsp_engine *engine = NULL;
    nvsp_prior *prior = NULL;
    nvsp_decoder *decoder = NULL;
    nvsp_collector *collector = NULL;
    nvsp_collector_options options;
    int done = 0;
    if (open_prior(prior_path, &engine, &prior)) {
        NVSP_INIT(&options);
        options.flags = NVSP_COLLECTOR_MODEM_CHECKS;
        options.shares = most_shares(mtu);
        nvsp_status status = nvsp_decoder_create(engine, prior, NULL, &decoder);
        if (status == NVSP_OK) {
            status = nvsp_collector_create(mtu, &options, &collector);
        }
        done = status == NVSP_OK && unetsocket_bind(modem, PROTOCOL) == 0;
        if (done) {
            receive_all(modem, decoder, collector, folder);
        } else {
            fprintf(stderr, "starting to receive: %s\n", nvsp_status_text(status));
        }
    }
    nvsp_destroy(collector);
    nvsp_destroy(decoder);
    nvsp_destroy(prior);
    nvsp_destroy(engine);
    return done;
}

int main(int argc, char **argv) {
    const int sends = argc > 6 && strcmp(argv[1], "send") == 0;
    if (!sends && !(argc == 7 && strcmp(argv[1], "receive") == 0)) {
        fputs(usage, stderr);
        return 2;
    }
    unetsocket_t modem = unetsocket_open(argv[2], atoi(argv[3]));
    if (modem == NULL) {
        fprintf(stderr, "no modem at %s:%s\n", argv[2], argv[3]);
        return 1;
    }
    const uint32_t mtu = (uint32_t)strtoul(argv[4], NULL, 10);
    const int done = sends ? send_all(modem, mtu, atoi(argv[5]), argv + 6, argc - 6)
                           : topside(modem, mtu, argv[5], argv[6]);
    unetsocket_close(modem);
    return done ? 0 : 1;
}
