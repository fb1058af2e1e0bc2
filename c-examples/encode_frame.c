// Encodes one picture to a packet.

#include "example.h"

static const char usage[] =
    "usage: encode_frame PRIOR.ply FRAME.ppm CAMERA START PACKET [BYTES]\n"
    "CAMERA  width,height,fx,fy,cx,cy in pixels: what to encode at; the frame is scaled to it\n"
    "START   qw,qx,qy,qz,tx,ty,tz: the camera's rough pose, world to camera\n"
    "BYTES   most bytes of the packet; without: quality 10\n";

static void print_stats(const nvsp_frame_stats *stats) {
    static const char *const starts[] = {"hint", "previous", "predicted", "uncertain"};
    static const char *const stops[] = {"gradient", "progress", "no descent", "iterations"};
    printf("bytes           %u, of which the latent part %u\n", stats->bytes, stats->latent_bytes);
    printf("PSNR            %.2f dB, of the render alone %.2f dB\n", stats->psnr, stats->render_psnr);
    printf("start, stop     %s, %s\n", starts[stats->start % 4], stops[stats->stop % 4]);
    printf("took            %.0f ms, %u full renders\n", stats->milliseconds, stats->full_renders);
    const double *q = stats->pose.rotation, *t = stats->pose.translation;
    printf("pose            %.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f\n", q[0], q[1], q[2], q[3], t[0], t[1],
           t[2]);
    if (stats->flags & NVSP_FRAME_UNCERTAIN) {
        printf("                the pose may be wrong\n");
    }
    if (stats->flags & NVSP_FRAME_RATE_MISSED) {
        printf("                the bytes do not hold a difference picture\n");
    }
}

// Encodes the frame into `packet` and returns its bytes. If it fails, prints why and returns 0.
static size_t encode(nvsp_encoder *encoder, const ppm *frame, const nvsp_pose *start, uint8_t *packet,
                     size_t room) {
    const nvsp_image image = ppm_image(frame);
    nvsp_frame_stats stats;
    NVSP_INIT(&stats);
    size_t written = 0;
    nvsp_frame_info info;
    NVSP_INIT(&info);
    info.hint = start;
    const nvsp_status status = nvsp_encode(encoder, &image, &info, packet, room, &written, &stats);
    if (status != NVSP_OK) {
        char text[512] = "";
        nvsp_last_error(encoder, text, sizeof text);
        fprintf(stderr, "encoding: %s: %s\n", nvsp_status_text(status), text);
        return 0;
    }
    print_stats(&stats);
    return written;
}

static int write_file(const char *path, const uint8_t *bytes, size_t size) {
    FILE *file = fopen(path, "wb");
    int valid = file != NULL && fwrite(bytes, 1, size, file) == size;
    if (file != NULL && fclose(file) != 0) {
        valid = 0;
    }
    if (!valid) {
        fprintf(stderr, "%s: cannot be written\n", path);
    }
    return valid;
}

int main(int argc, char **argv) {
    nvsp_camera camera;
    nvsp_pose start;
    if (argc < 6 || argc > 7 || !camera_of(argv[3], &camera) || !pose_of(argv[4], &start)) {
        fputs(usage, stderr);
        return 2;
    }
    nvsp_engine *engine = NULL;
    nvsp_prior *prior = NULL;
    nvsp_encoder *encoder = NULL;
    ppm frame = {0, 0, NULL};
    int done = 0;

    const size_t room = nvsp_size_bound(NVSP_SIZE_PACKET, camera.width, camera.height);
    uint8_t *packet = malloc(room);
    nvsp_encoder_options options;
    NVSP_INIT(&options);
    if (argc == 7) {
        options.rate = NVSP_RATE_BYTES;
        options.rate_value = strtof(argv[6], NULL);
    }
    if (packet != NULL && ppm_read(argv[2], &frame) && open_prior(argv[1], &engine, &prior)) {
        const nvsp_status status = nvsp_encoder_create(engine, prior, &camera, &options, &encoder);
        if (status == NVSP_OK) {
            const size_t size = encode(encoder, &frame, &start, packet, room);
            done = size > 0 && write_file(argv[5], packet, size);
        } else {
            char text[512] = "";
            nvsp_last_error(engine, text, sizeof text);
            fprintf(stderr, "making an encoder: %s: %s\n", nvsp_status_text(status), text);
        }
    }

    nvsp_destroy(encoder);  // NULL is allowed.
    nvsp_destroy(prior);
    nvsp_destroy(engine);
    free(frame.pixels);
    free(packet);
    return done ? 0 : 1;
}
