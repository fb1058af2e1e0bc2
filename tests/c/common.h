// What the tests in C share: checks, the scene's files, handles, numbers.

#ifndef COMMON_H
#define COMMON_H

#include <nvsprior.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

// Counts a check, and prints it if it fails. Several threads may call both.
#define CHECK(condition) check((condition) ? 1 : 0, #condition, __FILE__, __LINE__)
// The same for a call and the status that it must return.
#define EXPECT(status, call) expect((status), (call), #call, __FILE__, __LINE__)
// For a call that the rest of a test needs: ends the program if it does not return NVSP_OK.
#define MUST(call) must((call), #call, __FILE__, __LINE__)

int check(int valid, const char *text, const char *file, int line);
int expect(nvsp_status wanted, nvsp_status found, const char *text, const char *file, int line);
void must(nvsp_status status, const char *text, const char *file, int line);

// Ends the program: the test cannot be run.
void give_up(const char *what);

// Whether NVSP_TEST_FEW is set: tests then repeat things less often, as a memory checker is slow.
int few(void);

#define MAX_FRAMES 8

// The folder that tests/capi writes.
typedef struct scene {
    // Paths.
    char prior[512], other_prior[512], preprocessed_prior[512], compact_prior[512], blocked_prior[512];
    nvsp_camera camera;
    int frames;
    nvsp_pose poses[MAX_FRAMES];
    uint8_t *pixels[MAX_FRAMES];  // RGB, of the camera's size.
    uint8_t *treated;             // The first, as the preprocessed prior wants it.
    size_t size;                  // Bytes of each.
} scene;

void scene_read(scene *scene, const char *folder);
void scene_free(scene *scene);

// A frame as an image, without a copy.
nvsp_image scene_image(const scene *scene, int frame);

// The scene's camera, scaled to another width.
nvsp_camera scaled_camera(const scene *scene, uint32_t width);

// Both ends of a link.
typedef struct rig {
    nvsp_engine *engine;
    nvsp_prior *prior;
    nvsp_encoder *encoder;
    nvsp_decoder *decoder;
} rig;

// A packet in memory of its own.
typedef struct packet {
    uint8_t *bytes;
    size_t size;
} packet;

// What the programs work with: the scene, both ends of a link, the scene's packets.
extern scene dive;
extern rig both;
extern packet packets[MAX_FRAMES];

// Reads the scene that the program's first argument names.
void read_dive(int argc, char **argv);
// The same, and opens engine and prior.
void set_up(int argc, char **argv);
// Ends all of them, whatever is there, and prints a summary; the program's exit code.
int tear_down(void);

// Defaults; without a watchdog if NVSP_TEST_FEW is set.
nvsp_engine_options patient_options(void);

// Opens engine and prior, without a log; `rig_add` makes encoder and decoder.
void rig_open(rig *rig, const scene *scene);
void rig_add(rig *rig, const nvsp_camera *camera, const nvsp_encoder_options *options);
void rig_close(rig *rig);
// The way back after a lost device, as the header says: engine, prior, encoder and decoder.
void rig_reopen(rig *rig);

// Another encoder on the link's prior, for the scene's camera.
nvsp_encoder *new_encoder(const nvsp_encoder_options *options);

// Both ends of a link: options that state what must be, and ends without encoder and decoder.
nvsp_vehicle_options vehicle_options(uint32_t mtu, double bit_rate, double frame_rate);
nvsp_topside_options topside_options(uint32_t mtu);
nvsp_vehicle *new_vehicle(const nvsp_vehicle_options *options);
nvsp_topside *new_topside(const nvsp_topside_options *options);

// Whether the text of a handle's last failure has these words; prints it if not. NULL: this thread's.
int says(const void *handle, const char *words);

// A place for a picture, RGB without padding.
nvsp_picture place_of(uint8_t *pixels, uint32_t width, uint32_t height);

// Encodes the scene's frames with the rig's encoder, the first from its pose.
void encode_all(rig *rig, const scene *scene, packet *packets);
void free_packets(packet *packets);

// What is known of a frame: a pose, until the thread's next call. NULL: nothing is known.
const nvsp_frame_info *with_hint(const nvsp_pose *hint);

// The content of a file, from malloc.
uint8_t *read_all(const char *path, size_t *size);
// The pixels of a PPM of the scene's size, from malloc.
uint8_t *read_picture(const scene *scene, const char *path);

// Uniform random numbers, the same for a seed everywhere (SplitMix64).
uint64_t random_bits(uint64_t *state);
uint32_t random_below(uint64_t *state, uint32_t limit);

// PSNR of two pictures, dB; 99 if they are equal.
double psnr(const uint8_t *a, const uint8_t *b, size_t size);

// The checks of packets and modem frames, going on from `crc`: CRC-16/IBM-3740, which begins with 0xffff, and CRC-32 of
// IEEE 802.3.
uint16_t crc16(uint16_t crc, const uint8_t *bytes, size_t size);
uint32_t crc32(uint32_t crc, const uint8_t *bytes, size_t size);

// Bytes of a latent part that states its pose by itself: in a packet that states prior and camera, as the first one
// does, and in any other. And those of the session part behind the former.
#define SESSION_LATENT 24
#define LATENT 20
#define SESSION 25
// Bytes of a check of the render, which comes with both as long as nothing is acknowledged.
#define RENDER_CHECK 6

// Makes the check of a latent part right.
void seal_latent(uint8_t *packet, size_t latent);
// For a packet that states prior and camera: the session part's check, the tag, and the latent part's check.
void seal_session(uint8_t *packet);
// Makes the check of a residual part right that ends a packet of `size` bytes, and comes right behind the latent part.
void seal_residual(uint8_t *packet, size_t latent, size_t size);

// Whether all bytes are `value`.
int all_are(const void *bytes, uint8_t value, size_t size);

#endif
