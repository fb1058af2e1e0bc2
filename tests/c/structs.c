// Structures of every size and version, through every function that takes one.

#define _GNU_SOURCE

#include "common.h"

#include <nvsprior_extra.h>

static packet first;
static nvsp_vehicle *vehicle;
static nvsp_topside *topside;

// Calls a function with a structure. If it fails, all else that it would write must stay as it is.
typedef nvsp_status (*caller)(void *structure);

static nvsp_status engine_options(void *structure) {
    nvsp_engine *engine = NULL;
    const nvsp_status status = nvsp_engine_create(structure, &engine);
    CHECK((status == NVSP_OK) == (engine != NULL));
    nvsp_destroy(engine);
    return status;
}

static nvsp_status engine_info(void *structure) { return nvsp_engine_get_info(both.engine, structure); }

static nvsp_status prior_options(void *structure) {
    nvsp_prior *prior = NULL;
    const nvsp_status status = nvsp_prior_open(both.engine, dive.prior, structure, &prior);
    CHECK((status == NVSP_OK) == (prior != NULL));
    nvsp_destroy(prior);
    return status;
}

static nvsp_status prior_info(void *structure) { return nvsp_prior_get_info(both.prior, structure); }

static nvsp_status encoder_options(void *structure) {
    nvsp_encoder *encoder = NULL;
    const nvsp_status status =
        nvsp_encoder_create(both.engine, both.prior, &dive.camera, structure, &encoder);
    CHECK((status == NVSP_OK) == (encoder != NULL));
    nvsp_destroy(encoder);
    return status;
}

static nvsp_status frame_stats(void *structure) {
    const nvsp_image image = scene_image(&dive, 0);
    uint8_t bytes[4096];
    memset(bytes, 0xa5, sizeof bytes);
    size_t written = 77;
    const nvsp_status status =
        nvsp_encode(both.encoder, &image, with_hint(&dive.poses[0]), bytes, sizeof bytes, &written, structure);
    CHECK(status == NVSP_OK ? written != 77 : written == 77 && all_are(bytes, 0xa5, sizeof bytes));
    return status;
}

static nvsp_status frame_info(void *structure) {
    const nvsp_image image = scene_image(&dive, 0);
    uint8_t bytes[4096];
    memset(bytes, 0xa5, sizeof bytes);
    size_t written = 77;
    const nvsp_status status =
        nvsp_encode(both.encoder, &image, structure, bytes, sizeof bytes, &written, NULL);
    CHECK(status == NVSP_OK ? written != 77 : written == 77 && all_are(bytes, 0xa5, sizeof bytes));
    return status;
}

static nvsp_status begun_info(void *structure) {
    const nvsp_image image = scene_image(&dive, 0);
    uint8_t bytes[4096];
    size_t written = 77;
    const nvsp_status status = nvsp_encode_begin(both.encoder, &image, structure);
    if (status == NVSP_OK) {
        MUST(nvsp_wait(both.encoder, 60000));
        MUST(nvsp_encode_finish(both.encoder, bytes, sizeof bytes, &written, NULL));
    }
    return status;
}

static nvsp_status decoded(void *structure) {
    uint8_t *pixels = malloc(dive.size);
    memset(pixels, 0xa5, dive.size);
    nvsp_picture place = place_of(pixels, dive.camera.width, dive.camera.height);
    const nvsp_status status = nvsp_decode(both.decoder, first.bytes, first.size, 0, &place, structure);
    CHECK((status == NVSP_OK) != all_are(pixels, 0xa5, dive.size));
    free(pixels);
    return status;
}

static nvsp_status header(void *structure) {
    return nvsp_decode_header(first.bytes, first.size, both.prior, structure);
}

// A modem frame of a packet, which the topside gets anew for each call.
static nvsp_status shown_packet(void *structure) {
    static double now = 1;
    uint8_t bytes[4096];
    size_t size = 0, written = 77;
    uint32_t budget = 0;
    now += 10;
    MUST(nvsp_vehicle_plan(vehicle, now, now, NULL, &budget));
    MUST(nvsp_vehicle_packet(vehicle, now, first.bytes, first.size, NULL, 0));
    const nvsp_topside_options options = topside_options(64);
    nvsp_topside *made = new_topside(&options);
    while (nvsp_vehicle_transmit(vehicle, now + 5, 64, bytes, &size, NULL) == NVSP_OK) {
        MUST(nvsp_topside_receive(made, now, bytes, size));
    }
    const nvsp_status status = nvsp_topside_packet(made, now, bytes, sizeof bytes, &written, structure);
    CHECK((status == NVSP_OK) == (written != 77));
    nvsp_destroy(made);
    return status;
}

static nvsp_status event_out(void *structure) {
    const nvsp_vehicle_options options = vehicle_options(64, 40000, 4);
    nvsp_vehicle *made = new_vehicle(&options);
    const nvsp_status status = nvsp_vehicle_event(made, structure);
    nvsp_destroy(made);
    return status;
}

static nvsp_status vehicle_statistics(void *structure) { return nvsp_vehicle_get_statistics(vehicle, structure); }

static nvsp_status topside_statistics(void *structure) { return nvsp_topside_get_statistics(topside, structure); }

static void make_link(void) {
    const nvsp_vehicle_options options = vehicle_options(64, 40000, 4);
    const nvsp_topside_options receives = topside_options(64);
    vehicle = new_vehicle(&options);
    topside = new_topside(&receives);
    uint8_t bytes[64];
    size_t size = 0;
    uint32_t budget = 0;
    MUST(nvsp_vehicle_plan(vehicle, 0, 0, NULL, &budget));
    MUST(nvsp_vehicle_packet(vehicle, 0, first.bytes, first.size, NULL, 0));
    while (nvsp_vehicle_transmit(vehicle, 5, sizeof bytes, bytes, &size, NULL) == NVSP_OK) {
        MUST(nvsp_topside_receive(topside, 0, bytes, size));
    }
}

static nvsp_status device_info(void *structure) { return nvsp_device_get_info(0, structure, NULL); }

static nvsp_status estimate(void *structure) { return nvsp_prior_estimate(dive.prior, &dive.camera, structure); }

static nvsp_status truth(void *structure) {
    uint8_t levels[64];
    size_t written = 77;
    const nvsp_status status = nvsp_decoder_get_truth(both.decoder, levels, sizeof levels, &written, structure);
    CHECK((status == NVSP_OK) == (written != 77));
    return status;
}

static nvsp_status between_out(void *structure) {
    return nvsp_pose_between(&dive.poses[0], &dive.poses[0], 0.5, structure);
}

static const struct {
    size_t size;
    caller call;
    int output;
} structures[] = {
    {sizeof(nvsp_engine_options), engine_options, 0},
    {sizeof(nvsp_engine_info), engine_info, 1},
    {sizeof(nvsp_device_info), device_info, 1},
    {sizeof(nvsp_memory_estimate), estimate, 1},
    {sizeof(nvsp_prior_options), prior_options, 0},
    {sizeof(nvsp_prior_info), prior_info, 1},
    {sizeof(nvsp_encoder_options), encoder_options, 0},
    {sizeof(nvsp_frame_info), frame_info, 0},
    {sizeof(nvsp_frame_info), begun_info, 0},
    {sizeof(nvsp_frame_stats), frame_stats, 1},
    {sizeof(nvsp_decoded), decoded, 1},
    {sizeof(nvsp_truth), truth, 1},
    {sizeof(nvsp_decoded), header, 1},
    {sizeof(nvsp_pose), between_out, 1},
    {sizeof(nvsp_decoded), shown_packet, 1},
    {sizeof(nvsp_event), event_out, 1},
    {sizeof(nvsp_vehicle_statistics), vehicle_statistics, 1},
    {sizeof(nvsp_topside_statistics), topside_statistics, 1},
};

// Calls with a structure of `room` bytes that says it has `size`, filled with `fill` after its head. If the call fails,
// the structure must be as it was.
static nvsp_status call_with(caller call, size_t room, uint32_t size, uint32_t version, int fill,
                             uint8_t *after) {
    uint32_t *words = malloc(room);  // No larger: a memory checker sees what goes beyond.
    uint8_t *before = malloc(room);
    memset(words, fill, room);
    words[0] = size;
    words[1] = version;
    memcpy(before, words, room);
    const nvsp_status status = call(words);
    CHECK(status == NVSP_OK || memcmp(before, words, room) == 0);
    if (after != NULL) {
        memcpy(after, words, room);
    }
    free(before);
    free(words);
    return status;
}

static void refusals(caller call, size_t size) {
    const uint32_t wrong_sizes[] = {0, 1, 7, 8, (uint32_t)size - 1, 4097, 1u << 31, UINT32_MAX};
    for (size_t i = 0; i < sizeof wrong_sizes / sizeof *wrong_sizes; i++) {
        const uint32_t wrong = wrong_sizes[i];
        // Of a size that no structure has, the head alone may be looked at.
        const size_t room = wrong == (uint32_t)size - 1 ? size : 8;
        EXPECT(NVSP_ERR_STRUCTURE, call_with(call, room, wrong, NVSP_ABI_VERSION, 0, NULL));
    }
    const uint32_t wrong_versions[] = {0, NVSP_ABI_VERSION + 1, UINT32_MAX};
    for (size_t i = 0; i < sizeof wrong_versions / sizeof *wrong_versions; i++) {
        EXPECT(NVSP_ERR_STRUCTURE,
               call_with(call, size, (uint32_t)size, wrong_versions[i], 0, NULL));
    }
}

// A program with a newer header, whose structure is larger.
static void newer(caller call, size_t size, int output) {
    uint8_t after[4096];
    EXPECT(NVSP_OK, call_with(call, size + 24, (uint32_t)size + 24, NVSP_ABI_VERSION, 0, after));
    EXPECT(NVSP_OK, call_with(call, 4096, 4096, NVSP_ABI_VERSION, 0, after));
    if (output) {
        // What it had there is replaced, and what this library does not know is zero.
        EXPECT(NVSP_OK, call_with(call, size + 24, (uint32_t)size + 24, NVSP_ABI_VERSION, 0xa5, after));
        uint32_t head[2];
        memcpy(head, after, sizeof head);
        CHECK(head[0] == size + 24 && head[1] == NVSP_ABI_VERSION);
        CHECK(all_are(after + size, 0, 24));
        CHECK(!all_are(after + 8, 0xa5, size - 8));
        return;
    }
    // An option that this library does not know must not be ignored.
    uint32_t *words = calloc(1, size + 24);
    words[0] = (uint32_t)size + 24;
    words[1] = NVSP_ABI_VERSION;
    ((uint8_t *)words)[size + 23] = 1;
    EXPECT(NVSP_ERR_STRUCTURE, call(words));
    free(words);
}

static nvsp_camera camera;
static nvsp_pose pose;
static nvsp_image image;
static nvsp_picture picture;
static nvsp_lens lens;
static nvsp_mask mask;
static nvsp_vehicle_options sends;
static nvsp_topside_options receives;
static nvsp_keys keys;

static nvsp_status camera_in(void *structure) { return nvsp_decoder_add_camera(both.decoder, structure); }

static nvsp_status encode_with(const void *frame, const void *hint) {
    uint8_t bytes[4096];
    size_t written = 77;
    const nvsp_status status = nvsp_encode(both.encoder, frame, with_hint(hint), bytes, sizeof bytes, &written, NULL);
    CHECK((status == NVSP_OK) == (written != 77));
    return status;
}

static nvsp_status image_in(void *structure) { return encode_with(structure, &pose); }

static nvsp_status pose_in(void *structure) { return encode_with(&image, structure); }

static nvsp_status picture_in(void *structure) {
    return nvsp_decode(both.decoder, first.bytes, first.size, 0, structure, NULL);
}

static nvsp_status lens_in(void *structure) {
    const nvsp_status status = nvsp_encoder_set_lens(both.encoder, structure);
    MUST(nvsp_encoder_set_lens(both.encoder, NULL));
    return status;
}

static nvsp_status mask_in(void *structure) {
    const nvsp_status status = nvsp_encoder_set_mask(both.encoder, structure);
    MUST(nvsp_encoder_set_mask(both.encoder, NULL));
    return status;
}

static nvsp_status keys_in(void *structure) {
    nvsp_decoder *made = NULL;
    const nvsp_status status = nvsp_decoder_create(both.engine, both.prior, structure, &made);
    CHECK((status == NVSP_OK) == (made != NULL));
    nvsp_destroy(made);
    return status;
}

static nvsp_status vehicle_options_in(void *structure) {
    nvsp_vehicle *made = NULL;
    uint64_t bytes = 77;
    const nvsp_status status = nvsp_vehicle_create(NULL, NULL, NULL, NULL, structure, &made);
    CHECK((status == NVSP_OK) == (made != NULL));
    EXPECT(status, nvsp_vehicle_memory(structure, &bytes));
    nvsp_destroy(made);
    return status;
}

static nvsp_status topside_options_in(void *structure) {
    nvsp_topside *made = NULL;
    uint64_t bytes = 77;
    const nvsp_status status = nvsp_topside_create(NULL, NULL, structure, &made);
    CHECK((status == NVSP_OK) == (made != NULL));
    EXPECT(status, nvsp_topside_memory(structure, &bytes));
    nvsp_destroy(made);
    return status;
}

static nvsp_status draw_pose(void *structure) { return nvsp_decoder_draw(both.decoder, structure, &picture); }

static nvsp_status draw_picture(void *structure) { return nvsp_decoder_draw(both.decoder, &pose, structure); }

static nvsp_status between_poses(void *structure) {
    nvsp_pose found = NVSP_INITIALIZER(nvsp_pose);
    const nvsp_status status = nvsp_pose_between(structure, &pose, 0.5, &found);
    CHECK((status == NVSP_OK) == (found.rotation[0] != 0));
    return status;
}

// Structures that mean nothing if they are all zero: they are valid ones with another head, or with more after them.
static void others(void) {
    camera = dive.camera;
    pose = dive.poses[0];
    image = scene_image(&dive, 0);
    uint8_t *pixels = malloc(dive.size);
    picture = place_of(pixels, camera.width, camera.height);
    memset(pixels, 255, dive.size);
    lens = (nvsp_lens){NVSP_HEAD(nvsp_lens), .model = NVSP_LENS_FISHEYE, .count = 4, .width = camera.width,
                       .height = camera.height, .fx = 78, .fy = 78, .cx = 48, .cy = 27};
    mask = (nvsp_mask){NVSP_HEAD(nvsp_mask), .width = camera.width, .height = camera.height, .pixels = pixels,
                       .stride = camera.width, .size = dive.size};
    static const uint8_t key[NVSP_KEY_BYTES] = {1};
    keys = (nvsp_keys){NVSP_HEAD(nvsp_keys), .keys = key, .count = 1};
    sends = vehicle_options(64, 5000, 5);
    receives = topside_options(64);
    MUST(nvsp_decode(both.decoder, first.bytes, first.size, 0, NULL, NULL));
    const struct {
        const void *valid;
        size_t size;
        caller call;
    } all[] = {
        {&camera, sizeof camera, camera_in},
        {&pose, sizeof pose, pose_in},
        {&image, sizeof image, image_in},
        {&picture, sizeof picture, picture_in},
        {&lens, sizeof lens, lens_in},
        {&mask, sizeof mask, mask_in},
        {&sends, sizeof sends, vehicle_options_in},
        {&receives, sizeof receives, topside_options_in},
        {&keys, sizeof keys, keys_in},
        {&pose, sizeof pose, draw_pose},
        {&picture, sizeof picture, draw_picture},
        {&pose, sizeof pose, between_poses},
    };
    for (size_t i = 0; i < sizeof all / sizeof *all; i++) {
        const size_t size = all[i].size;
        uint32_t *words = calloc(1, size + 24);
        memcpy(words, all[i].valid, size);
        EXPECT(NVSP_OK, all[i].call(words));
        words[0] = (uint32_t)size + 24;
        EXPECT(NVSP_OK, all[i].call(words));
        memcpy(words, all[i].valid, size);
        words[0] = (uint32_t)size + 24;
        ((uint8_t *)words)[size + 23] = 1;
        EXPECT(NVSP_ERR_STRUCTURE, all[i].call(words));
        const uint32_t bad[] = {0, 7, (uint32_t)size - 1, 4097, UINT32_MAX};
        for (size_t b = 0; b < sizeof bad / sizeof *bad; b++) {
            words[0] = bad[b];
            EXPECT(NVSP_ERR_STRUCTURE, all[i].call(words));
        }
        words[0] = (uint32_t)size;
        words[1] = NVSP_ABI_VERSION + 1;
        EXPECT(NVSP_ERR_STRUCTURE, all[i].call(words));
        free(words);
    }
    // A pose that the library gives is one to give back.
    nvsp_frame_stats stats = NVSP_INITIALIZER(nvsp_frame_stats);
    uint8_t bytes[4096];
    size_t written = 0;
    MUST(nvsp_encode(both.encoder, &image, with_hint(&pose), bytes, sizeof bytes, &written, &stats));
    EXPECT(NVSP_OK, encode_with(&image, &stats.pose));
    free(pixels);
}

static uint64_t memory_used(nvsp_engine *engine) {
    nvsp_engine_info info = NVSP_INITIALIZER(nvsp_engine_info);
    MUST(nvsp_engine_get_info(engine, &info));
    return info.memory_used;
}

static void devices(void) {
    nvsp_device_info info = NVSP_INITIALIZER(nvsp_device_info);
    uint32_t count = 0, fit = 0;
    EXPECT(NVSP_OK, nvsp_device_get_info(0, &info, &count));
    CHECK(count > 0);
    for (uint32_t i = 0; i < count; i++) {
        EXPECT(NVSP_OK, nvsp_device_get_info(i, &info, NULL));
        CHECK(info.name[0] != 0 && info.driver[0] != 0 && info.vulkan_major > 0 && info.memory > 0);
        CHECK(info.kind >= NVSP_DEVICE_DISCRETE_GPU && info.kind <= NVSP_DEVICE_OTHER);
        fit += info.unfit[0] == 0;
    }
    CHECK(fit > 0);
    uint32_t again = 0;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_device_get_info(count, &info, &again));
    CHECK(again == count);
}

// What is taken is within the estimate, and the estimate is no wild guess.
static void estimates(void) {
    const uint32_t widths[] = {96, 320, 640, 1280};
    for (int i = 0; i < (few() ? 2 : 4); i++) {
        const nvsp_camera size = scaled_camera(&dive, widths[i]);
        nvsp_memory_estimate found = NVSP_INITIALIZER(nvsp_memory_estimate);
        EXPECT(NVSP_OK, nvsp_prior_estimate(dive.prior, &size, &found));
        nvsp_engine_options options = patient_options();
        options.host_memory_limit = found.prior_host;
        if (options.host_memory_limit < found.encoder_host) {
            options.host_memory_limit = found.encoder_host;
        }
        rig own = {0};
        MUST(nvsp_engine_create(&options, &own.engine));
        MUST(nvsp_prior_open(own.engine, dive.prior, NULL, &own.prior));
        const uint64_t prior = memory_used(own.engine);
        CHECK(prior > 0 && prior <= found.prior_device && found.prior_device < 2 * prior);
        MUST(nvsp_encoder_create(own.engine, own.prior, &size, NULL, &own.encoder));
        uint8_t bytes[65536];
        size_t written = 0;
        const nvsp_image frame = scene_image(&dive, 0);
        MUST(nvsp_encode(own.encoder, &frame, with_hint(&dive.poses[0]), bytes, sizeof bytes, &written, NULL));
        const uint64_t encoder = memory_used(own.engine) - prior;
        CHECK(encoder <= found.encoder_device && found.encoder_device < 3 * encoder);
        MUST(nvsp_decoder_create(own.engine, own.prior, NULL, &own.decoder));
        MUST(nvsp_decode(own.decoder, bytes, written, 0, NULL, NULL));
        const uint64_t decoder = memory_used(own.engine) - prior - encoder;
        CHECK(decoder <= found.decoder_device && found.decoder_device < 3 * decoder);
        rig_close(&own);
    }
    nvsp_memory_estimate found = NVSP_INITIALIZER(nvsp_memory_estimate);
    EXPECT(NVSP_OK, nvsp_prior_estimate(dive.compact_prior, NULL, &found));
    CHECK(found.splats > 0 && found.prior_device > 0 && found.encoder_device == 0);
    char path[600];
    snprintf(path, sizeof path, "%s.none", dive.prior);
    EXPECT(NVSP_ERR_FILE, nvsp_prior_estimate(path, NULL, &found));
    EXPECT(NVSP_ERR_PRIOR, nvsp_prior_estimate("/dev/zero", NULL, &found));
}

// What the driver compiled is taken back, and garbage in its place does no harm.
static void pipeline_cache(void) {
    size_t size = 77, again = 77;
    EXPECT(NVSP_ERR_BUFFER_TOO_SMALL, nvsp_engine_get_pipeline_cache(both.engine, NULL, 0, &size));
    CHECK(size > 4 && size != 77);
    uint8_t *bytes = malloc(size);
    EXPECT(NVSP_OK, nvsp_engine_get_pipeline_cache(both.engine, bytes, size, &again));
    CHECK(again == size);
    for (int i = 0; i < 4; i++) {
        nvsp_engine_options options = patient_options();
        nvsp_engine *engine = NULL;
        options.pipeline_cache = bytes;
        options.pipeline_cache_size = i == 2 ? size / 2 : i == 3 ? 3 : size;
        bytes[size / 2] ^= (uint8_t)(i == 1);
        EXPECT(NVSP_OK, nvsp_engine_create(&options, &engine));
        nvsp_destroy(engine);
    }
    free(bytes);
}

static void versions(void) {
    char text[32];
    snprintf(text, sizeof text, "%d.%d.%d", NVSP_VERSION_MAJOR, NVSP_VERSION_MINOR, NVSP_VERSION_PATCH);
    uint32_t number = 0, abi_version = 0;
    CHECK(strcmp(text, nvsp_version(&number, &abi_version)) == 0);
    CHECK(number == NVSP_VERSION_NUMBER && abi_version == NVSP_ABI_VERSION);
}

static void initialising(void) {
    uint32_t words[4] = {9, 9, 9, 9};
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_struct_init(NULL, 16, NVSP_ABI_VERSION));
    EXPECT(NVSP_ERR_STRUCTURE, nvsp_struct_init(words, 7, NVSP_ABI_VERSION));
    EXPECT(NVSP_ERR_STRUCTURE, nvsp_struct_init(words, 4097, NVSP_ABI_VERSION));
    EXPECT(NVSP_ERR_STRUCTURE, nvsp_struct_init(words, SIZE_MAX, NVSP_ABI_VERSION));
    EXPECT(NVSP_ERR_STRUCTURE, nvsp_struct_init(words, 16, NVSP_ABI_VERSION + 1));
    CHECK(words[0] == 9 && words[1] == 9 && words[2] == 9 && words[3] == 9);
    EXPECT(NVSP_OK, nvsp_struct_init(words, 12, NVSP_ABI_VERSION));
    CHECK(words[0] == 12 && words[1] == NVSP_ABI_VERSION && words[2] == 0 && words[3] == 9);
}

static _Atomic long blocks, taken;

static void *allocate(void *user, size_t size, size_t alignment) {
    CHECK(user == &dive && alignment > 0 && (alignment & (alignment - 1)) == 0);
    void *block = NULL;
    if (posix_memalign(&block, alignment < sizeof(void *) ? sizeof(void *) : alignment, size) != 0) {
        return NULL;
    }
    blocks++;
    taken++;
    return block;
}

static void release(void *user, void *block, size_t size, size_t alignment) {
    CHECK(user == &dive && block != NULL && size > 0 && alignment > 0);
    blocks--;
    free(block);
}

// All host memory of the library comes from the caller's functions and goes back to them.
static void allocators(void) {
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_set_allocator(NULL, release, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_set_allocator(allocate, NULL, NULL));
    EXPECT(NVSP_OK, nvsp_set_allocator(allocate, release, &dive));
    rig held;
    rig_open(&held, &dive);
    CHECK(taken > 100 && blocks > 10);
    EXPECT(NVSP_ERR_STATE, nvsp_set_allocator(allocate, release, &dive));
    rig_close(&held);
    CHECK(blocks == 0);
    EXPECT(NVSP_OK, nvsp_set_allocator(NULL, NULL, NULL));
    const long before = taken;
    rig_open(&held, &dive);
    rig_close(&held);
    CHECK(taken == before);
}

int main(int argc, char **argv) {
    read_dive(argc, argv);
    allocators();
    rig_open(&both, &dive);
    rig_add(&both, &dive.camera, NULL);
    encode_all(&both, &dive, packets);
    first = packets[0];
    make_link();

    initialising();
    versions();
    others();
    devices();
    estimates();
    pipeline_cache();
    for (size_t i = 0; i < sizeof structures / sizeof *structures; i++) {
        refusals(structures[i].call, structures[i].size);
        newer(structures[i].call, structures[i].size, structures[i].output);
    }
    nvsp_destroy(vehicle);
    nvsp_destroy(topside);
    return tear_down();
}
