// Decodes one packet to a picture.

#include "example.h"

static const char usage[] = "usage: decode_frame PRIOR.ply PACKET PICTURE.ppm\n";

// No packet of a picture of 320 x 180 pixels comes near this.
#define MOST_BYTES (1 << 20)

// What a packet says first: anyone can read it, without a device.
static int print_header(const uint8_t *packet, size_t size, const nvsp_prior *prior, ppm *picture) {
    nvsp_decoded header;
    NVSP_INIT(&header);
    const nvsp_status status = nvsp_decode_header(packet, size, prior, &header);
    if (status != NVSP_OK) {
        fprintf(stderr, "reading the header: %s\n", nvsp_status_text(status));
        return 0;
    }
    if (!(header.flags & NVSP_DECODED_SESSION)) {
        // Only a decoder that has seen the packet that states them can decode it.
        fprintf(stderr, "prior and camera are those that an earlier packet states, by tag %04x\n", header.tag);
        return 0;
    }
    printf("prior           %08x\n", header.prior_id);
    printf("frame           %u, %u x %u pixels\n", header.frame, header.width, header.height);
    printf("latent part     %u bytes\n", header.latent_bytes);
    if (header.flags & NVSP_DECODED_POSE) {
        const double *q = header.pose.rotation, *t = header.pose.translation;
        printf("pose            %.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f\n", q[0], q[1], q[2], q[3], t[0],
               t[1], t[2]);
    }
    picture->width = header.width;
    picture->height = header.height;
    return 1;
}

// Decodes into memory of the size that the header states. If it fails, prints why and returns 0.
static int decode(nvsp_decoder *decoder, const uint8_t *packet, size_t size, ppm *picture) {
    picture->pixels = malloc(ppm_size(picture));
    if (picture->pixels == NULL) {
        fprintf(stderr, "out of memory\n");
        return 0;
    }
    nvsp_picture place = {NVSP_HEAD(nvsp_picture),
                          .format = NVSP_FORMAT_RGB8,
                          .pixels = picture->pixels,
                          .size = ppm_size(picture)};
    nvsp_decoded info;
    NVSP_INIT(&info);
    const nvsp_status status = nvsp_decode(decoder, packet, size, 0, &place, &info);
    if (status != NVSP_OK) {
        char text[512] = "";
        nvsp_last_error(decoder, text, sizeof text);
        fprintf(stderr, "decoding: %s: %s\n", nvsp_status_text(status), text);
        return 0;
    }
    printf("difference      %u of %u rows\n", info.rows, info.height);
    if (info.flags & NVSP_FRAME_UNCERTAIN) {
        printf("                the pose may be wrong\n");
    }
    if (info.damage != NVSP_OK) {
        printf("                shown without a part of the packet: %s\n", nvsp_status_text(info.damage));
    }
    return 1;
}

// How much of the picture shows what the camera saw, and how much is memory.
static void print_truth(nvsp_decoder *decoder, const ppm *picture) {
    const size_t room = nvsp_size_bound(NVSP_SIZE_TRUTH, picture->width, picture->height);
    uint8_t *levels = malloc(room);
    nvsp_truth truth;
    size_t blocks = 0, of_level[4] = {0};
    NVSP_INIT(&truth);
    if (levels != NULL && nvsp_decoder_get_truth(decoder, levels, room, &blocks, &truth) == NVSP_OK) {
        for (size_t i = 0; i < blocks; i++) {
            of_level[levels[i]]++;
        }
        printf("truth           %u x %u blocks: %zu as seen, %zu different, %zu wrong, %zu not seen\n",
               truth.columns, truth.rows, of_level[NVSP_TRUTH_AS_SEEN], of_level[NVSP_TRUTH_DIFFERS],
               of_level[NVSP_TRUTH_WRONG], of_level[NVSP_TRUTH_NOT_SEEN]);
    }
    free(levels);
}

int main(int argc, char **argv) {
    if (argc != 4) {
        fputs(usage, stderr);
        return 2;
    }
    nvsp_engine *engine = NULL;
    nvsp_prior *prior = NULL;
    nvsp_decoder *decoder = NULL;
    ppm picture = {0, 0, NULL};
    int done = 0;

    uint8_t *packet = malloc(MOST_BYTES);
    const size_t size = packet == NULL ? 0 : read_file(argv[2], packet, MOST_BYTES);
    if (size > 0 && open_prior(argv[1], &engine, &prior)
        && print_header(packet, size, prior, &picture)) {
        const nvsp_status status = nvsp_decoder_create(engine, prior, NULL, &decoder);
        if (status == NVSP_OK) {
            done = decode(decoder, packet, size, &picture) && ppm_write(argv[3], &picture);
            if (done) {
                print_truth(decoder, &picture);
            }
        } else {
            char text[512] = "";
            nvsp_last_error(engine, text, sizeof text);
            fprintf(stderr, "making a decoder: %s: %s\n", nvsp_status_text(status), text);
        }
    }

    nvsp_destroy(decoder);  // NULL is allowed.
    nvsp_destroy(prior);
    nvsp_destroy(engine);
    free(picture.pixels);
    free(packet);
    return done ? 0 : 1;
}
