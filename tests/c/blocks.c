// A prior in blocks: the packets and pictures of the whole prior, within the memory that is given; refusals.

#include "common.h"

// Opens the scene's prior in blocks.
static nvsp_status open_blocks(uint32_t memory, uint32_t given, nvsp_prior **prior) {
    nvsp_prior_options options = NVSP_INITIALIZER(nvsp_prior_options);
    options.blocks_memory = memory;
    options.given = given;
    return nvsp_prior_open(both.engine, dive.blocked_prior, &options, prior);
}

// Encodes the scene's frames on a prior, and decodes them on another. Returns the packets.
static void fly(nvsp_prior *vehicle, nvsp_prior *topside, packet *sent) {
    rig rig = {both.engine, vehicle, NULL, NULL};
    MUST(nvsp_encoder_create(both.engine, vehicle, &dive.camera, NULL, &rig.encoder));
    MUST(nvsp_decoder_create(both.engine, topside, NULL, &rig.decoder));
    encode_all(&rig, &dive, sent);
    uint8_t *shown = malloc(2 * dive.size), *decoded = shown + dive.size;
    for (int i = 0; i < dive.frames; i++) {
        nvsp_picture picture = place_of(decoded, dive.camera.width, dive.camera.height);
        EXPECT(NVSP_OK, nvsp_decode(rig.decoder, sent[i].bytes, sent[i].size, 0, &picture, NULL));
        CHECK(psnr(decoded, dive.pixels[i], dive.size) > 25);
    }
    nvsp_picture last = place_of(shown, dive.camera.width, dive.camera.height);
    EXPECT(NVSP_OK, nvsp_encoder_get_picture(rig.encoder, NVSP_PICTURE_SHOWN, &last));
    CHECK(memcmp(shown, decoded, dive.size) == 0);
    free(shown);
    nvsp_destroy(rig.encoder);
    nvsp_destroy(rig.decoder);
}

static void refusals(void) {
    nvsp_prior *prior = NULL;
    EXPECT(NVSP_ERR_ARGUMENT, open_blocks(16, NVSP_PRIOR_NEAR, &prior));
    CHECK(says(both.engine, "not with blocks_memory"));
    nvsp_prior_options options = NVSP_INITIALIZER(nvsp_prior_options);
    options.blocks_memory = 16;
    EXPECT(NVSP_ERR_PRIOR, nvsp_prior_open(both.engine, dive.compact_prior, &options, &prior));
    EXPECT(NVSP_ERR_FILE, nvsp_prior_open(both.engine, "nowhere.nvsb", &options, &prior));
    size_t size = 0;
    uint8_t *bytes = read_all(dive.blocked_prior, &size);
    options.content = bytes;
    options.content_size = size;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_prior_open(both.engine, NULL, &options, &prior));
    CHECK(says(both.engine, "from a file"));
    CHECK(prior == NULL);
    free(bytes);
}

int main(int argc, char **argv) {
    set_up(argc, argv);
    refusals();
    nvsp_prior *whole = NULL, *in_blocks = NULL;
    MUST(nvsp_prior_open(both.engine, dive.blocked_prior, NULL, &whole));
    MUST(open_blocks(2, 0, &in_blocks));
    nvsp_prior_info infos[2] = {NVSP_INITIALIZER(nvsp_prior_info), NVSP_INITIALIZER(nvsp_prior_info)};
    EXPECT(NVSP_OK, nvsp_prior_get_info(whole, &infos[0]));
    EXPECT(NVSP_OK, nvsp_prior_get_info(in_blocks, &infos[1]));
    // What it is is the same; the rest tells which part is loaded.
    CHECK(memcmp(&infos[0], &infos[1], offsetof(nvsp_prior_info, loaded_blocks)) == 0);
    CHECK(infos[0].splat_room == 0 && infos[1].splat_room > 0);
    packet sent[2][MAX_FRAMES];
    fly(whole, whole, sent[0]);
    fly(in_blocks, in_blocks, sent[1]);
    for (int i = 0; i < dive.frames; i++) {
        CHECK(sent[0][i].size == sent[1][i].size);
        CHECK(memcmp(sent[0][i].bytes, sent[1][i].bytes, sent[0][i].size) == 0);
    }
    nvsp_prior_info now = NVSP_INITIALIZER(nvsp_prior_info);
    EXPECT(NVSP_OK, nvsp_prior_get_info(in_blocks, &now));
    CHECK(now.loaded_blocks > 0 && now.loaded_splats > 0 && now.loaded_splats <= now.splat_room);
    CHECK(now.splat_room <= now.splats && now.host_bytes > 0 && now.host_bytes < 2 << 20 && now.block_changes > 0);
    CHECK(now.incomplete_searches == 0);
    free_packets(sent[0]);
    free_packets(sent[1]);
    nvsp_destroy(whole);
    nvsp_destroy(in_blocks);
    return tear_down();
}
