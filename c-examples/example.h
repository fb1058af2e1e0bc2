// What the examples share: binary PPM files, lists of numbers, the log, and failures in words.

#ifndef EXAMPLE_H
#define EXAMPLE_H

#include <nvsprior.h>
#include <stdio.h>
#include <stdlib.h>

// A picture of `width * height` pixels, three bytes each, without padding.
typedef struct ppm {
    uint32_t width;
    uint32_t height;
    uint8_t *pixels;  // From malloc.
} ppm;

static inline size_t ppm_size(const ppm *picture) {
    return (size_t)picture->width * picture->height * 3;
}

// Reads a number of a PPM's header. Skips white space and comments. Returns -1 if there is no number.
static inline long ppm_number(FILE *file) {
    int c = getc(file);
    while (c == ' ' || c == '\t' || c == '\n' || c == '\r' || c == '#') {
        while (c == '#' && c != EOF) {
            do {
                c = getc(file);
            } while (c != '\n' && c != EOF);
        }
        c = getc(file);
    }
    long number = -1;
    while (c >= '0' && c <= '9' && number < 100000) {
        number = (number < 0 ? 0 : number) * 10 + (c - '0');
        c = getc(file);
    }
    return number;  // The white space after the number was read too.
}

// Reads a PPM of the kind P6 with 8 bits per channel. If it fails, prints why and returns 0.
static inline int ppm_read(const char *path, ppm *picture) {
    ppm found = {0, 0, NULL};
    FILE *file = fopen(path, "rb");
    int valid = file != NULL && getc(file) == 'P' && getc(file) == '6';
    if (valid) {
        const long width = ppm_number(file);
        const long height = ppm_number(file);
        const long peak = ppm_number(file);
        valid = width > 0 && width <= 16384 && height > 0 && height <= 16384 && peak == 255;
        if (valid) {
            found.width = (uint32_t)width;
            found.height = (uint32_t)height;
            found.pixels = (uint8_t *)malloc(ppm_size(&found));
            valid = found.pixels != NULL
                    && fread(found.pixels, 1, ppm_size(&found), file) == ppm_size(&found);
        }
    }
    if (file != NULL) {
        fclose(file);
    }
    if (!valid) {
        fprintf(stderr, "%s: no PPM of the kind P6 with 8 bits per channel\n", path);
        free(found.pixels);
        return 0;
    }
    *picture = found;
    return 1;
}

// Writes a PPM. If it fails, prints why and returns 0.
static inline int ppm_write(const char *path, const ppm *picture) {
    FILE *file = fopen(path, "wb");
    int valid = file != NULL && fprintf(file, "P6\n%u %u\n255\n", picture->width, picture->height) > 0
                && fwrite(picture->pixels, 1, ppm_size(picture), file) == ppm_size(picture);
    if (file != NULL && fclose(file) != 0) {
        valid = 0;
    }
    if (!valid) {
        fprintf(stderr, "%s: cannot be written\n", path);
    }
    return valid;
}

// Reads a file of at most `room` bytes and returns its size. If it fails, prints why and returns 0.
static inline size_t read_file(const char *path, uint8_t *bytes, size_t room) {
    FILE *file = fopen(path, "rb");
    size_t size = 0;
    if (file != NULL) {
        size = fread(bytes, 1, room, file);
        if (getc(file) != EOF) {
            size = 0;
        }
        fclose(file);
    }
    if (size == 0) {
        fprintf(stderr, "%s: cannot be read, is empty, or has more than %zu bytes\n", path, room);
    }
    return size;
}

// An image for the encoder: the PPM's pixels, without a copy.
static inline nvsp_image ppm_image(const ppm *picture) {
    nvsp_image image = NVSP_INITIALIZER(nvsp_image);
    image.format = NVSP_FORMAT_RGB8;
    image.width = picture->width;
    image.height = picture->height;
    image.planes[0] = picture->pixels;
    image.strides[0] = (size_t)picture->width * 3;
    image.sizes[0] = ppm_size(picture);
    return image;
}

// Reads `count` numbers with commas between them. Returns 0 if the text is something else.
static inline int numbers(const char *text, double *values, int count) {
    for (int i = 0; i < count; i++) {
        char *end = NULL;
        values[i] = strtod(text, &end);
        if (end == text || *end != (i + 1 < count ? ',' : '\0')) {
            return 0;
        }
        text = end + 1;
    }
    return 1;
}

// Reads a camera: width,height,fx,fy,cx,cy in pixels.
static inline int camera_of(const char *text, nvsp_camera *camera) {
    double v[6];
    if (!numbers(text, v, 6) || v[0] < 1 || v[0] > 4096 || v[1] < 1 || v[1] > 4096) {
        fprintf(stderr, "%s: no camera, which is width,height,fx,fy,cx,cy\n", text);
        return 0;
    }
    NVSP_INIT(camera);
    camera->width = (uint32_t)v[0];
    camera->height = (uint32_t)v[1];
    camera->fx = (float)v[2];
    camera->fy = (float)v[3];
    camera->cx = (float)v[4];
    camera->cy = (float)v[5];
    return 1;
}

// Reads a pose, world to camera: qw,qx,qy,qz,tx,ty,tz.
static inline int pose_of(const char *text, nvsp_pose *pose) {
    double v[7];
    if (!numbers(text, v, 7)) {
        fprintf(stderr, "%s: no pose, which is qw,qx,qy,qz,tx,ty,tz\n", text);
        return 0;
    }
    NVSP_INIT(pose);
    for (int i = 0; i < 4; i++) {
        pose->rotation[i] = v[i];
    }
    for (int i = 0; i < 3; i++) {
        pose->translation[i] = v[4 + i];
    }
    return 1;
}

// Prints the library's messages: which device and prior, what is odd, why a call fails.
static inline void print_log(void *user, int32_t level, const char *message) {
    (void)user;
    const char *kind = level == NVSP_LOG_ERROR ? "error: " : level == NVSP_LOG_WARNING ? "warning: " : "";
    fprintf(stderr, "nvsprior: %s%s\n", kind, message);
}

// Opens a prior, and an engine that logs to standard error. If it fails, prints why and returns 0.
static inline int open_prior(const char *path, nvsp_engine **engine, nvsp_prior **prior) {
    nvsp_engine_options options;
    nvsp_status status = NVSP_INIT(&options);
    if (status != NVSP_OK) {
        fprintf(stderr, "library %s: %s\n", nvsp_version(NULL, NULL), nvsp_status_text(status));
        return 0;
    }
    options.log = print_log;
    status = nvsp_engine_create(&options, engine);
    if (status != NVSP_OK) {  // The details were logged: there is no handle to ask.
        fprintf(stderr, "opening a device: %s\n", nvsp_status_text(status));
        return 0;
    }
    status = nvsp_prior_open(*engine, path, NULL, prior);
    if (status != NVSP_OK) {
        char text[512] = "";
        nvsp_last_error(*engine, text, sizeof text);
        fprintf(stderr, "opening %s: %s: %s\n", path, nvsp_status_text(status), text);
        return 0;
    }
    return 1;
}

#endif
