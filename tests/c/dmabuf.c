// Frames in DMA-BUFs: the same packets as from the caller's memory, reading only between the two ioctls, and buffers
// that are refused.
//
// Where /dev/udmabuf is, its buffers are used. Most machines that build this have none. There a memfd stands for a
// buffer, and this program's own ioctl for the kernel's: the frame is in the memfd only between begin and end, garbage
// before and after, as with a cache that is not coherent. poll stands for a device that is still writing.

#define _GNU_SOURCE

#include "common.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/dma-buf.h>
#include <linux/udmabuf.h>
#include <nvsprior_extra.h>
#include <stdarg.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

// A memfd in place of a DMA-BUF.
typedef struct buffer {
    int fd;
    ino_t inode;
    size_t size;
    uint8_t *frame;   // What the camera wrote.
    uint8_t *memory;  // What the CPU sees.
    int reading, begun;
    int fails, failures;  // An errno for this many calls.
    int written;          // Whether the camera has written all.
} buffer;

static buffer buffers[8];
static int count;

static buffer *buffer_of(int fd) {
    struct stat status;
    for (int i = 0; fstat(fd, &status) == 0 && i < count; i++) {
        if (buffers[i].inode == status.st_ino) {
            return &buffers[i];
        }
    }
    return NULL;
}

int ioctl(int fd, unsigned long request, ...) {
    va_list arguments;
    va_start(arguments, request);
    void *argument = va_arg(arguments, void *);
    va_end(arguments);
    buffer *of = request == DMA_BUF_IOCTL_SYNC ? buffer_of(fd) : NULL;
    if (of == NULL) {
        return (int)syscall(SYS_ioctl, fd, request, argument);
    }
    const uint64_t flags = ((const struct dma_buf_sync *)argument)->flags;
    const int end = (flags & DMA_BUF_SYNC_END) != 0;
    CHECK((flags & ~(uint64_t)DMA_BUF_SYNC_END) == DMA_BUF_SYNC_READ);
    if (!end && of->failures > 0) {
        of->failures--;
        errno = of->fails;
        return -1;
    }
    of->reading += end ? -1 : 1;
    of->begun += !end;
    CHECK(of->reading == 0 || of->reading == 1);
    if (end) {
        memset(of->memory, 0xa5, of->size);
    } else {
        memcpy(of->memory, of->frame, of->size);
    }
    return 0;
}

// poll.h says that poll does not read what it is given.
struct pollfd {
    int fd;
    short events, revents;
};

int poll(struct pollfd *descriptors, unsigned long number, int timeout);

int poll(struct pollfd *descriptors, unsigned long number, int timeout) {
    const buffer *of = number == 1 ? buffer_of(descriptors->fd) : NULL;
    if (of != NULL && !of->written) {
        CHECK(timeout == 0);
        return 0;
    }
    const struct timespec time = {timeout / 1000, timeout % 1000 * 1000000};
    return (int)syscall(SYS_ppoll, descriptors, number, timeout < 0 ? NULL : &time, NULL, 0);
}

static int memory_file(size_t size) {
    const int fd = memfd_create("frame", MFD_ALLOW_SEALING | MFD_CLOEXEC);
    if (fd < 0 || ftruncate(fd, (off_t)size) != 0) {
        give_up("memfd_create");
    }
    return fd;
}

static buffer *make_buffer(size_t size) {
    buffer *made = &buffers[count];
    struct stat status;
    *made = (buffer){.fd = memory_file(size), .size = size, .written = 1};
    fstat(made->fd, &status);
    made->inode = status.st_ino;
    made->frame = malloc(size);
    made->memory = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED, made->fd, 0);
    if (made->memory == MAP_FAILED) {
        give_up("mmap");
    }
    memset(made->memory, 0xa5, size);
    count++;
    return made;
}

static void end_buffers(void) {
    for (int i = 0; i < count; i++) {
        CHECK(buffers[i].reading == 0);
        munmap(buffers[i].memory, buffers[i].size);
        free(buffers[i].frame);
        if (buffers[i].fd >= 0) {
            close(buffers[i].fd);
        }
    }
    count = 0;
}

static nvsp_dmabuf *import(int fd) {
    nvsp_dmabuf *made = NULL;
    MUST(nvsp_dmabuf_import(both.engine, fd, 0, &made));
    return made;
}

// Descriptors and mappings that the process has.
static int descriptors(void) {
    int found = 0;
    DIR *folder = opendir("/proc/self/fd");
    while (folder != NULL && readdir(folder) != NULL) {
        found++;
    }
    closedir(folder);
    return found;
}

static int mappings(void) {
    char line[1000];
    int found = 0;
    FILE *maps = fopen("/proc/self/maps", "r");
    while (maps != NULL && fgets(line, sizeof line, maps) != NULL) {
        found += strstr(line, "memfd:frame") != NULL;
    }
    fclose(maps);
    return found;
}

// Encodes an image as the first frame; the packet's bytes, in `bytes`.
static size_t encode(const nvsp_image *image, uint8_t *bytes, size_t room, int on_thread) {
    nvsp_encoder *encoder = NULL;
    size_t size = 0;
    MUST(nvsp_encoder_create(both.engine, both.prior, &dive.camera, NULL, &encoder));
    if (on_thread) {
        EXPECT(NVSP_OK, nvsp_encode_begin(encoder, image, with_hint(&dive.poses[0])));
        for (int i = 0; i < count; i++) {
            CHECK(buffers[i].reading == 0);  // The image is the caller's again.
        }
        EXPECT(NVSP_OK, nvsp_wait(encoder, 600000));
        EXPECT(NVSP_OK, nvsp_encode_finish(encoder, bytes, room, &size, NULL));
    } else {
        EXPECT(NVSP_OK, nvsp_encode(encoder, image, with_hint(&dive.poses[0]), bytes, room, &size, NULL));
    }
    nvsp_destroy(encoder);
    return size;
}

// The first frame in NV12 as a camera delivers it: rows with padding, and the chroma after the luma. Its bytes are
// written to `at`.
#define STRIDE 128
static nvsp_image camera_frame(uint8_t *at) {
    const uint32_t width = dive.camera.width, height = dive.camera.height;
    const size_t chroma = (size_t)STRIDE * height, rows = (height + 1) / 2;
    memset(at, 0x5a, chroma + STRIDE * rows);
    for (size_t y = 0; y < height; y++) {
        for (size_t x = 0; x < width; x++) {
            at[y * STRIDE + x] = dive.pixels[0][3 * (y * width + x) + 1];
            at[chroma + y / 2 * STRIDE + x] = (uint8_t)(128 + (x + y) % 9);
        }
    }
    return (nvsp_image){NVSP_HEAD(nvsp_image), .format = NVSP_FORMAT_NV12,
                        .width = width,
                        .height = height,
                        .planes = {at, at + chroma},
                        .strides = {STRIDE, STRIDE},
                        .sizes = {chroma, STRIDE * rows}};
}

static size_t frame_size(void) { return (size_t)STRIDE * (dive.camera.height + (dive.camera.height + 1) / 2); }

// The same image in one DMA-BUF, `before` bytes from its start.
static nvsp_image in_dmabuf(const nvsp_image *image, const nvsp_dmabuf *dmabuf, size_t before) {
    nvsp_image moved = *image;
    for (int i = 0; i < 2; i++) {
        moved.offsets[i] = before + (size_t)(image->planes[i] - image->planes[0]);
        moved.planes[i] = NULL;
    }
    moved.dmabufs[0] = dmabuf;
    return moved;
}

static void same_packets(void) {
    const size_t before = 4096, size = before + frame_size();
    const int open_before = descriptors();
    uint8_t plain[8192], found[8192];
    uint8_t *memory = malloc(size);
    const nvsp_image image = camera_frame(memory + before);
    const size_t bytes = encode(&image, plain, sizeof plain, 0);
    buffer *of = make_buffer(size);
    memset(of->frame, 0x33, before);
    camera_frame(of->frame + before);
    nvsp_dmabuf *dmabuf = import(of->fd);
    CHECK(mappings() == 2);
    close(of->fd);  // The library has a descriptor of its own.
    of->fd = -1;
    nvsp_image moved = in_dmabuf(&image, dmabuf, before);
    for (int turn = 0; turn < 4; turn++) {
        of->begun = 0;
        CHECK(encode(&moved, found, sizeof found, turn % 2) == bytes && memcmp(plain, found, bytes) == 0);
        CHECK(of->begun == 1);  // Once, though there are two planes.
        moved.sizes[0] = moved.sizes[1] = 0;  // To the buffer's end.
        of->fails = turn == 1 ? EINTR : EAGAIN;
        of->failures = 3;  // As if signals came.
    }
    of->failures = 0;
    // A buffer for each plane.
    const size_t chroma = image.sizes[0];
    buffer *of_y = make_buffer(chroma), *of_uv = make_buffer(image.sizes[1]);
    memcpy(of_y->frame, of->frame + before, chroma);
    memcpy(of_uv->frame, of->frame + before + chroma, image.sizes[1]);
    nvsp_dmabuf *y = import(of_y->fd), *uv = import(of_uv->fd);
    moved.dmabufs[0] = y;
    moved.dmabufs[1] = uv;
    moved.offsets[0] = moved.offsets[1] = 0;
    CHECK(encode(&moved, found, sizeof found, 0) == bytes && memcmp(plain, found, bytes) == 0);
    nvsp_destroy(dmabuf);
    nvsp_destroy(y);
    nvsp_destroy(uv);
    nvsp_destroy(NULL);
    CHECK(mappings() == 3);  // This program's own.
    end_buffers();
    CHECK(descriptors() == open_before);
    free(memory);
}

// Refused by both ways in; nothing is written, and nothing stays open.
static void refuse(nvsp_status status, const nvsp_image *image, const char *named) {
    uint8_t bytes[4096];
    size_t written = 77;
    EXPECT(status, nvsp_encode(both.encoder, image, with_hint(&dive.poses[0]), bytes, sizeof bytes, &written, NULL));
    CHECK(written == 77 && says(both.encoder, named));
    EXPECT(status, nvsp_encode_begin(both.encoder, image, with_hint(&dive.poses[0])));
    for (int i = 0; i < count; i++) {
        CHECK(buffers[i].reading == 0);
    }
}

static void invalid_images(void) {
    const size_t size = frame_size();
    buffer *of = make_buffer(size);
    const nvsp_image image = camera_frame(of->frame);
    nvsp_dmabuf *dmabuf = import(of->fd);
    const nvsp_image valid = in_dmabuf(&image, dmabuf, 0);
    nvsp_image wrong = valid;
    wrong.planes[1] = of->frame;
    refuse(NVSP_ERR_ARGUMENT, &wrong, "planes and dmabufs");
    wrong = image;
    wrong.offsets[1] = 1;
    refuse(NVSP_ERR_ARGUMENT, &wrong, "offsets");
    wrong = valid;
    wrong.dmabufs[0] = NULL;
    wrong.dmabufs[1] = dmabuf;
    refuse(NVSP_ERR_ARGUMENT, &wrong, "dmabufs");
    const size_t beyond[] = {size + 1, SIZE_MAX, SIZE_MAX / 2};
    for (int i = 0; i < 3; i++) {
        wrong = valid;
        wrong.offsets[1] = beyond[i];
        refuse(NVSP_ERR_IMAGE, &wrong, "offsets");
        wrong = valid;
        wrong.sizes[0] = beyond[i];
        refuse(NVSP_ERR_IMAGE, &wrong, "sizes");
        wrong = valid;
        wrong.strides[1] = beyond[i];
        refuse(NVSP_ERR_IMAGE, &wrong, "UV");
    }
    wrong = valid;
    wrong.sizes[1] = 0;
    wrong.offsets[1] = size;  // No bytes are left.
    refuse(NVSP_ERR_IMAGE, &wrong, "UV");
    wrong = valid;
    wrong.format = NVSP_FORMAT_I420;  // Its third plane is the buffer's start: of the wrong stride.
    refuse(NVSP_ERR_IMAGE, &wrong, "V");
    of->written = 0;
    refuse(NVSP_ERR_IMAGE, &valid, "still being written");
    of->written = 1;
    of->fails = EACCES;
    of->failures = 2;
    refuse(NVSP_ERR_UNSUPPORTED, &valid, "may not read");
    of->fails = EAGAIN;  // For ever: no hang.
    of->failures = 1 << 20;
    refuse(NVSP_ERR_UNSUPPORTED, &valid, "may not read");
    of->failures = 0;
    // None of that was seen.
    uint8_t plain[8192], found[8192];
    size_t written = 0;
    const size_t bytes = encode(&image, plain, sizeof plain, 0);
    EXPECT(NVSP_OK, nvsp_encode(both.encoder, &valid, with_hint(&dive.poses[0]), found, sizeof found, &written, NULL));
    CHECK(written == bytes && memcmp(plain, found, bytes) == 0);
    nvsp_destroy(dmabuf);
    end_buffers();
}

static void refuse_import(nvsp_status status, int fd, uint64_t modifier, const char *named) {
    nvsp_dmabuf *made = NULL;
    const int open_before = descriptors(), mapped_before = mappings();
    EXPECT(status, nvsp_dmabuf_import(both.engine, fd, modifier, &made));
    CHECK(made == NULL && says(both.engine, named));
    CHECK(descriptors() == open_before && mappings() == mapped_before);
}

static void invalid_buffers(void) {
    buffer *of = make_buffer(frame_size());
    nvsp_dmabuf *made = NULL;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_dmabuf_import(NULL, of->fd, 0, &made));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_dmabuf_import(both.engine, of->fd, 0, NULL));
    const struct {
        uint64_t modifier;
        const char *named;
    } modifiers[] = {{0x0300000000606015, "NVIDIA"}, {0x0300000000606015, "0x0300000000606015"},
                     {0x0800000000000041, "Arm"},    {0x0700000000000006, "Broadcom"},
                     {0x0100000000000001, "Intel"},  {0x00ffffffffffffff, "DRM_FORMAT_MOD_INVALID"},
                     {1, "unknown"},                 {UINT64_MAX, "DRM_FORMAT_MOD_LINEAR"}};
    for (size_t i = 0; i < sizeof modifiers / sizeof *modifiers; i++) {
        refuse_import(NVSP_ERR_UNSUPPORTED, of->fd, modifiers[i].modifier, modifiers[i].named);
    }
    const int none[] = {-1, 9999, INT32_MAX, INT32_MIN};
    for (int i = 0; i < 4; i++) {
        refuse_import(NVSP_ERR_ARGUMENT, none[i], 0, "not open");
    }
    // Other kinds of files.
    const int memory = memory_file(4096), file = open(dive.prior, O_RDONLY | O_CLOEXEC);
    int ends[2];
    if (pipe(ends) != 0) {
        give_up("pipe");
    }
    refuse_import(NVSP_ERR_ARGUMENT, memory, 0, "no DMA-BUF");
    refuse_import(NVSP_ERR_ARGUMENT, file, 0, "no DMA-BUF");
    refuse_import(NVSP_ERR_ARGUMENT, ends[0], 0, "no DMA-BUF");
    close(memory);
    close(file);
    close(ends[0]);
    close(ends[1]);
    // Buffers that the CPU may not read: protected memory; an exporter that maps nothing.
    of->fails = EACCES;
    of->failures = 1;
    refuse_import(NVSP_ERR_UNSUPPORTED, of->fd, 0, "may not read");
    char path[64];
    snprintf(path, sizeof path, "/proc/self/fd/%d", of->fd);
    const int write_only = open(path, O_WRONLY | O_CLOEXEC);
    refuse_import(NVSP_ERR_UNSUPPORTED, write_only, 0, "cannot be mapped");
    close(write_only);
    end_buffers();
}

// With the kernel's own DMA-BUFs, if it has any for us.
static void real_buffers(void) {
    const int device = open("/dev/udmabuf", O_RDWR | O_CLOEXEC);
    if (device < 0) {
        printf("no /dev/udmabuf: only a memfd in its place was tried\n");
        return;
    }
    const size_t page = (size_t)sysconf(_SC_PAGESIZE), size = (frame_size() + page - 1) / page * page;
    const int memory = memory_file(size);
    fcntl(memory, F_ADD_SEALS, F_SEAL_SHRINK);
    struct udmabuf_create create = {.memfd = (uint32_t)memory, .flags = UDMABUF_FLAGS_CLOEXEC, .size = size};
    const int fd = ioctl(device, UDMABUF_CREATE, &create);
    close(device);
    if (fd < 0) {
        printf("no udmabuf: %s\n", strerror(errno));
        close(memory);
        return;
    }
    uint8_t plain[8192], found[8192];
    uint8_t *at = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED, memory, 0);
    const nvsp_image image = camera_frame(at);
    const size_t bytes = encode(&image, plain, sizeof plain, 0);
    nvsp_dmabuf *dmabuf = import(fd);
    const nvsp_image moved = in_dmabuf(&image, dmabuf, 0);
    CHECK(encode(&moved, found, sizeof found, 1) == bytes && memcmp(plain, found, bytes) == 0);
    nvsp_destroy(dmabuf);
    munmap(at, size);
    close(fd);
    close(memory);
    printf("with a buffer of /dev/udmabuf, too\n");
}

int main(int argc, char **argv) {
    read_dive(argc, argv);
    if (dive.camera.width > STRIDE) {
        give_up("the scene's frames are wider than STRIDE");
    }
    rig_open(&both, &dive);
    rig_add(&both, &dive.camera, NULL);
    same_packets();
    invalid_images();
    invalid_buffers();
    real_buffers();
    return tear_down();
}
