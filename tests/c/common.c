#include "common.h"

#include <math.h>
#include <pthread.h>
#include <unistd.h>

#if defined(__has_feature)
#if __has_feature(address_sanitizer)
// Drivers stay loaded, so that what they leak is reported with their name and can be told apart.
int dlclose(void *library);
int dlclose(void *library) {
    (void)library;
    return 0;
}
#endif
#endif

static pthread_mutex_t counting = PTHREAD_MUTEX_INITIALIZER;
static long checks, failures;

static int count(int valid) {
    pthread_mutex_lock(&counting);
    checks++;
    failures += !valid;
    pthread_mutex_unlock(&counting);
    return valid;
}

int check(int valid, const char *text, const char *file, int line) {
    if (!valid) {
        fprintf(stderr, "%s:%d: not so: %s\n", file, line, text);
    }
    return count(valid);
}

int expect(nvsp_status wanted, nvsp_status found, const char *text, const char *file, int line) {
    if (wanted != found) {
        fprintf(stderr, "%s:%d: %s\n    returned %d (%s), not %d (%s)\n", file, line, text, found,
                nvsp_status_text(found), wanted, nvsp_status_text(wanted));
    }
    return count(wanted == found);
}

void must(nvsp_status status, const char *text, const char *file, int line) {
    if (status != NVSP_OK) {
        fprintf(stderr, "%s:%d: %s\n    returned %d (%s)\n", file, line, text, status,
                nvsp_status_text(status));
        // Several threads may come here at once, which exit does not allow.
        fflush(stdout);
        _exit(1);
    }
}

void give_up(const char *what) {
    fprintf(stderr, "cannot test: %s\n", what);
    exit(1);
}

int few(void) { return getenv("NVSP_TEST_FEW") != NULL; }

uint8_t *read_picture(const scene *scene, const char *path) {
    size_t size = 0;
    uint8_t *bytes = read_all(path, &size);
    // The pixels are the end of the file.
    uint8_t *pixels = malloc(scene->size);
    if (pixels == NULL || size < scene->size) {
        give_up(path);
    }
    memcpy(pixels, bytes + size - scene->size, scene->size);
    free(bytes);
    return pixels;
}

void scene_read(scene *scene, const char *folder) {
    memset(scene, 0, sizeof *scene);
    snprintf(scene->prior, sizeof scene->prior, "%s/prior.ply", folder);
    snprintf(scene->other_prior, sizeof scene->other_prior, "%s/other.ply", folder);
    snprintf(scene->compact_prior, sizeof scene->compact_prior, "%s/prior.nvsg", folder);
    snprintf(scene->blocked_prior, sizeof scene->blocked_prior, "%s/prior.nvsb", folder);
    snprintf(scene->preprocessed_prior, sizeof scene->preprocessed_prior, "%s/preprocessed.ply", folder);
    char path[600];
    snprintf(path, sizeof path, "%s/scene.txt", folder);
    FILE *file = fopen(path, "r");
    MUST(NVSP_INIT(&scene->camera));
    for (int i = 0; i < MAX_FRAMES; i++) {
        MUST(NVSP_INIT(&scene->poses[i]));
    }
    nvsp_camera *camera = &scene->camera;
    if (file == NULL
        || fscanf(file, "%u,%u,%f,%f,%f,%f", &camera->width, &camera->height, &camera->fx, &camera->fy,
                  &camera->cx, &camera->cy) != 6) {
        give_up(path);
    }
    scene->size = (size_t)camera->width * camera->height * 3;
    while (scene->frames < MAX_FRAMES) {
        double *q = scene->poses[scene->frames].rotation, *t = scene->poses[scene->frames].translation;
        if (fscanf(file, "%lf,%lf,%lf,%lf,%lf,%lf,%lf", &q[0], &q[1], &q[2], &q[3], &t[0], &t[1], &t[2])
            != 7) {
            break;
        }
        snprintf(path, sizeof path, "%s/frame-%d.ppm", folder, scene->frames);
        scene->pixels[scene->frames++] = read_picture(scene, path);
    }
    fclose(file);
    snprintf(path, sizeof path, "%s/treated-0.ppm", folder);
    scene->treated = read_picture(scene, path);
    if (scene->frames < 4) {
        give_up("the scene has too few frames");
    }
}

void scene_free(scene *scene) {
    for (int i = 0; i < scene->frames; i++) {
        free(scene->pixels[i]);
    }
    free(scene->treated);
    memset(scene, 0, sizeof *scene);
}

nvsp_image scene_image(const scene *scene, int frame) {
    const size_t row = (size_t)scene->camera.width * 3;
    return (nvsp_image){NVSP_HEAD(nvsp_image), .format = NVSP_FORMAT_RGB8,
                        .width = scene->camera.width,
                        .height = scene->camera.height,
                        .planes = {scene->pixels[frame]},
                        .strides = {row},
                        .sizes = {scene->size}};
}

nvsp_camera scaled_camera(const scene *scene, uint32_t width) {
    nvsp_camera camera = scene->camera;
    const float factor = (float)width / (float)camera.width;
    camera.width = width;
    camera.height = (uint32_t)((float)camera.height * factor + 0.5f);
    camera.fx *= factor;
    camera.fy *= factor;
    camera.cx *= factor;
    camera.cy *= factor;
    return camera;
}

nvsp_engine_options patient_options(void) {
    nvsp_engine_options options = NVSP_INITIALIZER(nvsp_engine_options);
    // Under a memory checker the CPU driver takes minutes.
    options.watchdog_milliseconds = few() ? NVSP_WATCHDOG_NONE : 0;
    return options;
}

void rig_open(rig *rig, const scene *scene) {
    const nvsp_engine_options options = patient_options();
    memset(rig, 0, sizeof *rig);
    MUST(nvsp_engine_create(&options, &rig->engine));
    MUST(nvsp_prior_open(rig->engine, scene->prior, NULL, &rig->prior));
}

void rig_add(rig *rig, const nvsp_camera *camera, const nvsp_encoder_options *options) {
    MUST(nvsp_encoder_create(rig->engine, rig->prior, camera, options, &rig->encoder));
    MUST(nvsp_decoder_create(rig->engine, rig->prior, NULL, &rig->decoder));
}

void rig_close(rig *rig) {
    nvsp_destroy(rig->decoder);
    nvsp_destroy(rig->encoder);
    nvsp_destroy(rig->prior);
    nvsp_destroy(rig->engine);
    memset(rig, 0, sizeof *rig);
}

scene dive;
rig both;
packet packets[MAX_FRAMES];
static const char *program;

void read_dive(int argc, char **argv) {
    const char *slash = strrchr(argv[0], '/');
    program = slash == NULL ? argv[0] : slash + 1;
    if (argc < 2) {
        give_up("give it the scene's folder");
    }
    scene_read(&dive, argv[1]);
}

void set_up(int argc, char **argv) {
    read_dive(argc, argv);
    rig_open(&both, &dive);
}

void rig_reopen(rig *rig) {
    nvsp_prior *anew = NULL;
    EXPECT(NVSP_OK, nvsp_engine_reopen(rig->engine));
    MUST(nvsp_prior_open(rig->engine, dive.prior, NULL, &anew));
    EXPECT(NVSP_OK, nvsp_encoder_reopen(rig->encoder, rig->engine, anew));
    EXPECT(NVSP_OK, nvsp_decoder_reopen(rig->decoder, rig->engine, anew));
    nvsp_destroy(rig->prior);
    rig->prior = anew;
}

nvsp_encoder *new_encoder(const nvsp_encoder_options *options) {
    nvsp_encoder *encoder = NULL;
    MUST(nvsp_encoder_create(both.engine, both.prior, &dive.camera, options, &encoder));
    return encoder;
}

int says(const void *handle, const char *words) {
    char text[600];
    MUST(nvsp_last_error(handle, text, sizeof text));
    if (strstr(text, words) == NULL) {
        fprintf(stderr, "\"%s\" is not in: %s\n", words, text);
        return 0;
    }
    return 1;
}

int tear_down(void) {
    free_packets(packets);
    rig_close(&both);
    scene_free(&dive);
    printf("%s: %ld checks, %ld failed\n", program, checks, failures);
    return checks > 0 && failures == 0 ? 0 : 1;
}

nvsp_picture place_of(uint8_t *pixels, uint32_t width, uint32_t height) {
    const size_t row = (size_t)width * 3;
    return (nvsp_picture){NVSP_HEAD(nvsp_picture), .format = NVSP_FORMAT_RGB8, .pixels = pixels, .stride = row,
                          .size = row * height};
}

const nvsp_frame_info *with_hint(const nvsp_pose *hint) {
    static __thread nvsp_frame_info info;
    MUST(NVSP_INIT(&info));
    info.hint = hint;
    return hint == NULL ? NULL : &info;
}

void encode_all(rig *rig, const scene *scene, packet *packets) {
    const size_t room = nvsp_size_bound(NVSP_SIZE_PACKET, scene->camera.width, scene->camera.height);
    for (int i = 0; i < scene->frames; i++) {
        const nvsp_image image = scene_image(scene, i);
        uint8_t *bytes = malloc(room);
        size_t size = 0;
        MUST(nvsp_encode(rig->encoder, &image, with_hint(i == 0 ? &scene->poses[0] : NULL), bytes, room, &size,
                         NULL));
        // As large as the packet: what reads beyond it is caught by a memory checker.
        packets[i] = (packet){realloc(bytes, size), size};
        if (packets[i].bytes == NULL) {
            give_up("out of memory");
        }
    }
}

void free_packets(packet *packets) {
    for (int i = 0; i < dive.frames; i++) {
        free(packets[i].bytes);
    }
}

uint8_t *read_all(const char *path, size_t *size) {
    FILE *file = fopen(path, "rb");
    if (file == NULL || fseek(file, 0, SEEK_END) != 0) {
        give_up(path);
    }
    const long end = ftell(file);
    rewind(file);
    uint8_t *bytes = malloc(end > 0 ? (size_t)end : 1);
    if (end <= 0 || bytes == NULL || fread(bytes, 1, (size_t)end, file) != (size_t)end) {
        give_up(path);
    }
    fclose(file);
    *size = (size_t)end;
    return bytes;
}

uint64_t random_bits(uint64_t *state) {
    uint64_t z = (*state += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

uint32_t random_below(uint64_t *state, uint32_t limit) {
    return (uint32_t)((random_bits(state) >> 32) * limit >> 32);
}

double psnr(const uint8_t *a, const uint8_t *b, size_t size) {
    double sum = 0;
    for (size_t i = 0; i < size; i++) {
        const double difference = (double)a[i] - b[i];
        sum += difference * difference;
    }
    return sum == 0 ? 99 : 10 * log10(255.0 * 255.0 * (double)size / sum);
}

uint16_t crc16(uint16_t crc, const uint8_t *bytes, size_t size) {
    for (size_t i = 0; i < size; i++) {
        crc ^= (uint16_t)(bytes[i] << 8);
        for (int bit = 0; bit < 8; bit++) {
            crc = (uint16_t)(crc & 0x8000 ? crc << 1 ^ 0x1021 : crc << 1);
        }
    }
    return crc;
}

uint32_t crc32(uint32_t crc, const uint8_t *bytes, size_t size) {
    crc = ~crc;
    for (size_t i = 0; i < size; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++) {
            crc = crc & 1 ? crc >> 1 ^ 0xedb88320u : crc >> 1;
        }
    }
    return ~crc;
}

// The low byte first.
static void put16(uint8_t *at, uint16_t value) {
    at[0] = (uint8_t)value;
    at[1] = (uint8_t)(value >> 8);
}

void seal_latent(uint8_t *packet, size_t latent) { put16(packet + latent - 2, crc16(0xffff, packet, latent - 2)); }

void seal_session(uint8_t *packet) {
    uint8_t *session = packet + SESSION_LATENT;
    put16(session + SESSION - 2, crc16(0xffff, session, SESSION - 2));
    put16(packet + 4, (uint16_t)crc32(0, session, SESSION - 2));
    seal_latent(packet, SESSION_LATENT);
}

void seal_residual(uint8_t *packet, size_t latent, size_t size) {
    const uint32_t before = crc32(0, packet, latent);
    const uint8_t start[4] = {(uint8_t)before, (uint8_t)(before >> 8), (uint8_t)(before >> 16),
                              (uint8_t)(before >> 24)};
    put16(packet + latent, crc16(crc16(0xffff, start, 4), packet + latent + 2, size - latent - 2));
}

int all_are(const void *bytes, uint8_t value, size_t size) {
    const uint8_t *at = bytes;
    for (size_t i = 0; i < size; i++) {
        if (at[i] != value) {
            return 0;
        }
    }
    return 1;
}

nvsp_vehicle_options vehicle_options(uint32_t mtu, double bit_rate, double frame_rate) {
    nvsp_vehicle_options options = NVSP_INITIALIZER(nvsp_vehicle_options);
    options.mtu = mtu;
    options.bit_rate = bit_rate;
    options.frame_rate = frame_rate;
    return options;
}

nvsp_topside_options topside_options(uint32_t mtu) {
    nvsp_topside_options options = NVSP_INITIALIZER(nvsp_topside_options);
    options.mtu = mtu;
    return options;
}

nvsp_vehicle *new_vehicle(const nvsp_vehicle_options *options) {
    nvsp_vehicle *made = NULL;
    uint64_t memory = 0;
    MUST(nvsp_vehicle_memory(options, &memory));
    CHECK(memory > 0);
    MUST(nvsp_vehicle_create(NULL, NULL, NULL, NULL, options, &made));
    return made;
}

nvsp_topside *new_topside(const nvsp_topside_options *options) {
    nvsp_topside *made = NULL;
    uint64_t memory = 0;
    MUST(nvsp_topside_memory(options, &memory));
    CHECK(memory > 0);
    MUST(nvsp_topside_create(NULL, NULL, options, &made));
    return made;
}
