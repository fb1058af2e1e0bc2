// Passes NULL for every pointer of every function in turn. A pointer that must not be NULL gives
// NVSP_ERR_ARGUMENT, and nothing is written through the others.

#include "common.h"

#include <nvsprior_extra.h>

static packet first;

static void engines_and_priors(void) {
    nvsp_engine_info info;
    nvsp_prior_info prior_info;
    nvsp_prior *prior = NULL;
    char text[64];
    MUST(NVSP_INIT(&info));
    MUST(NVSP_INIT(&prior_info));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_engine_create(NULL, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_engine_reopen(NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_engine_get_info(NULL, &info));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_engine_get_info(both.engine, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_last_error(NULL, text, sizeof text));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_last_error(both.engine, NULL, 5));
    EXPECT(NVSP_ERR_BUFFER_TOO_SMALL, nvsp_last_error(both.engine, text, 0));

    EXPECT(NVSP_ERR_ARGUMENT, nvsp_prior_open(NULL, dive.prior, NULL, &prior));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_prior_open(both.engine, NULL, NULL, &prior));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_prior_open(both.engine, dive.prior, NULL, NULL));
    nvsp_prior_options options = NVSP_INITIALIZER(nvsp_prior_options);
    options.content_size = 9;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_prior_open(both.engine, NULL, &options, &prior));
    CHECK(says(both.engine, "content is NULL"));
    options.content = first.bytes;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_prior_open(both.engine, dive.prior, &options, &prior));
    CHECK(says(both.engine, "path and nvsp_prior_options.content"));
    EXPECT(NVSP_ERR_FILE, nvsp_prior_open(both.engine, "no/such/file.ply", NULL, &prior));
    CHECK(prior == NULL);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_prior_get_info(NULL, &prior_info));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_prior_get_info(both.prior, NULL));
}

static void encoders(void) {
    nvsp_encoder *made = NULL;
    const nvsp_camera *camera = &dive.camera;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_create(NULL, both.prior, camera, NULL, &made));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_create(both.engine, NULL, camera, NULL, &made));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_create(both.engine, both.prior, NULL, NULL, &made));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_create(both.engine, both.prior, camera, NULL, NULL));
    CHECK(made == NULL);

    nvsp_encoder *encoder = both.encoder;
    const nvsp_image image = scene_image(&dive, 0);
    nvsp_picture place = {NVSP_HEAD(nvsp_picture), .format = NVSP_FORMAT_RGB8};
    uint8_t bytes[4096];
    size_t written = 77;
    nvsp_frame_stats stats = NVSP_INITIALIZER(nvsp_frame_stats);
    memset(bytes, 0xa5, sizeof bytes);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_rate(NULL, NVSP_RATE_QUALITY, 5));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_camera(NULL, camera));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_set_camera(encoder, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_reopen(NULL, both.engine, both.prior));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_reopen(encoder, NULL, both.prior));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_reopen(encoder, both.engine, NULL));
    const size_t size = sizeof bytes;
    const nvsp_pose *pose = &dive.poses[0];
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encode(NULL, &image, with_hint(pose), bytes, size, &written, &stats));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encode(encoder, NULL, with_hint(pose), bytes, size, &written, &stats));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encode(encoder, &image, with_hint(pose), NULL, size, &written, &stats));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encode(encoder, &image, with_hint(pose), NULL, 0, &written, &stats));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encode(encoder, &image, with_hint(pose), bytes, size, NULL, &stats));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encode_begin(NULL, &image, with_hint(pose)));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_set_allocator(NULL));
    nvsp_dmabuf *dmabuf = NULL;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_dmabuf_import(NULL, 0, 0, &dmabuf));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_dmabuf_import(both.engine, 0, 0, NULL));
    nvsp_destroy(NULL);
    CHECK(dmabuf == NULL);
    nvsp_memory_estimate estimate = NVSP_INITIALIZER(nvsp_memory_estimate);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_prior_estimate(NULL, camera, &estimate));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_prior_estimate(dive.prior, camera, NULL));
    EXPECT(NVSP_OK, nvsp_device_get_info(0, NULL, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_engine_get_pipeline_cache(NULL, bytes, sizeof bytes, &written));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_engine_get_pipeline_cache(both.engine, NULL, 9, &written));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_engine_get_pipeline_cache(both.engine, bytes, sizeof bytes, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encode_begin(encoder, NULL, with_hint(pose)));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_reset(NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_prepare(NULL, 1, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encode_finish(NULL, bytes, size, &written, &stats));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encode_finish(encoder, NULL, size, &written, &stats));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encode_finish(encoder, bytes, size, NULL, &stats));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_get_picture(NULL, NVSP_PICTURE_SHOWN, &place));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_encoder_get_picture(encoder, NVSP_PICTURE_SHOWN, NULL));
    CHECK(written == 77 && all_are(bytes, 0xa5, sizeof bytes) && stats.bytes == 0);
}

static void decoders(void) {
    nvsp_decoder *made = NULL;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_create(NULL, both.prior, NULL, &made));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_create(both.engine, NULL, NULL, &made));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_create(both.engine, both.prior, NULL, NULL));
    CHECK(made == NULL);

    nvsp_decoder *decoder = both.decoder;
    nvsp_picture place = place_of(NULL, dive.camera.width, dive.camera.height);
    nvsp_decoded info;
    nvsp_header header;
    MUST(NVSP_INIT(&info));
    MUST(NVSP_INIT(&header));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_add_camera(NULL, &dive.camera));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_add_camera(decoder, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_reopen(NULL, both.engine, both.prior));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_reopen(decoder, NULL, both.prior));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_reopen(decoder, both.engine, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_set_filter(NULL, 1));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decode(NULL, first.bytes, first.size, 0, NULL, &info));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decode(decoder, NULL, first.size, 0, NULL, &info));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decode(decoder, NULL, 0, 0, NULL, &info));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decode(decoder, first.bytes, first.size, 0, &place, &info));
    CHECK(info.width == 0);
    EXPECT(NVSP_OK, nvsp_decode(decoder, first.bytes, first.size, 0, NULL, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_cancel(NULL));
    uint8_t levels[64];
    size_t written = 77;
    nvsp_truth truth = NVSP_INITIALIZER(nvsp_truth);
    memset(levels, 0xa5, sizeof levels);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_get_truth(NULL, levels, sizeof levels, &written, &truth));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_get_truth(decoder, NULL, sizeof levels, &written, &truth));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_get_truth(decoder, NULL, 0, &written, &truth));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_get_truth(decoder, levels, sizeof levels, NULL, &truth));
    CHECK(written == 77 && truth.columns == 0 && all_are(levels, 0xa5, sizeof levels));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decode_begin(NULL, first.bytes, first.size, 0));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decode_begin(decoder, NULL, first.size, 0));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decode_finish(NULL, NULL, &info));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decode_header(NULL, first.size, both.prior, &header));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decode_header(first.bytes, first.size, both.prior, NULL));
    CHECK(header.width == 0);
    EXPECT(NVSP_OK, nvsp_decode_header(first.bytes, first.size, NULL, &header));
}

static void links(void) {
    nvsp_sender_options options = NVSP_INITIALIZER(nvsp_sender_options);
    nvsp_sender *sender = NULL;
    nvsp_collector *collector = NULL;
    options.bit_rate = 20000;
    options.frame_rate = 5;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_create(64, NULL, &sender));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_create(64, &options, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_create(64, NULL, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_memory(64, NULL, NULL));
    CHECK(sender == NULL);
    MUST(nvsp_sender_create(64, &options, &sender));
    MUST(nvsp_collector_create(64, NULL, &collector));

    uint8_t bytes[256];
    size_t written = 77;
    uint32_t count = 77;
    double due = 77;
    memset(bytes, 0xa5, sizeof bytes);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_plan(NULL, 0, &count));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_plan(sender, 0, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_push(NULL, 0, first.bytes, first.size, NULL, 0, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_push(sender, 0, NULL, first.size, NULL, 0, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_push(sender, 0, first.bytes, first.size, NULL, 1, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_next(NULL, 0, bytes, sizeof bytes, &written));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_next(sender, 0, NULL, sizeof bytes, &written));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_next(sender, 0, bytes, sizeof bytes, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_due(NULL, &due));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_due(sender, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_count(NULL, 0, 5));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_set_bit_rate(NULL, 0, 5000));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_set_loss(NULL, 0.1, 1));
    nvsp_processed_report processed = NVSP_INITIALIZER(nvsp_processed_report);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_process_report(NULL, 0, bytes, sizeof bytes, &processed));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_process_report(sender, 0, NULL, sizeof bytes, &processed));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_process_report(sender, 0, bytes, sizeof bytes, NULL));
    nvsp_sender_statistics sent = NVSP_INITIALIZER(nvsp_sender_statistics);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_get_statistics(NULL, &sent));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_sender_get_statistics(sender, NULL));

    // So that there is something to fetch.
    uint32_t budget = 0;
    MUST(nvsp_sender_plan(sender, 0, &budget));
    MUST(nvsp_sender_push(sender, 0, first.bytes, first.size, NULL, 0, NULL));
    size_t size = 0;
    uint8_t share[64];
    while (nvsp_sender_next(sender, 9, share, sizeof share, &size) == NVSP_OK) {
        MUST(nvsp_collector_push(collector, 0, share, size, NULL));
    }
    nvsp_collected state = NVSP_INITIALIZER(nvsp_collected);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_push(NULL, 0, share, size, &state));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_push(collector, 0, NULL, size, &state));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_fetch(NULL, 0, 0, bytes, sizeof bytes, &written, &state));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_fetch(collector, 0, 0, NULL, sizeof bytes, &written, &state));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_fetch(collector, 0, 0, bytes, sizeof bytes, NULL, &state));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_fetch_user(NULL, 0, 0, bytes, sizeof bytes, &written));
    EXPECT(NVSP_ERR_STATE, nvsp_collector_fetch_user(collector, 0, 0, bytes, sizeof bytes, &written));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_newest(NULL, 0, &state));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_newest(collector, 0, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_arrived(NULL, 0, 0, bytes, 32, &count));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_arrived(collector, 0, 0, NULL, 32, &count));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_arrived(collector, 0, 0, bytes, 32, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_missing(NULL, 0, 0, &count, 1, &count));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_missing(collector, 0, 0, NULL, 1, &count));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_missing(collector, 0, 0, &count, 1, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_report(NULL, 0, NULL, 0, NULL, 0, bytes, sizeof bytes, &written));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_report(collector, 0, NULL, 1, NULL, 0, bytes, sizeof bytes, &written));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_report(collector, 0, NULL, 0, NULL, 1, bytes, sizeof bytes, &written));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_report(collector, 0, NULL, 0, NULL, 0, NULL, sizeof bytes, &written));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_report(collector, 0, NULL, 0, NULL, 0, bytes, sizeof bytes, NULL));
    nvsp_collector_statistics came = NVSP_INITIALIZER(nvsp_collector_statistics);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_get_statistics(NULL, &came));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_collector_get_statistics(collector, NULL));
    CHECK(state.bytes == 0 && sent.packets == 0 && came.accepted == 0 && due == 77);
    CHECK(written == 77 && count == 77 && all_are(bytes, 0xa5, sizeof bytes));
    nvsp_destroy(sender);
    nvsp_destroy(collector);

    nvsp_pose pose = NVSP_INITIALIZER(nvsp_pose);
    nvsp_picture place = NVSP_INITIALIZER(nvsp_picture);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_pose_between(NULL, &dive.poses[0], 0.5, &pose));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_pose_between(&dive.poses[0], NULL, 0.5, &pose));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_pose_between(&dive.poses[0], &dive.poses[0], 0.5, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_draw(NULL, &dive.poses[0], &place));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_draw(both.decoder, NULL, &place));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_decoder_draw(both.decoder, &dive.poses[0], NULL));
    CHECK(pose.rotation[0] == 0 && place.needed == 0);
}

// What takes any handle, and not each kind.
static void any_handle(void) {
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_wait(NULL, 1));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_cancel(NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_wait(both.engine, 1));
    CHECK(says(both.engine, "no encoder, no decoder"));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_cancel(both.prior));
    CHECK(says(both.prior, "no encoder, no decoder"));
    EXPECT(NVSP_ERR_STATE, nvsp_wait(both.encoder, 1));
    EXPECT(NVSP_ERR_STATE, nvsp_wait(both.decoder, 1));
    EXPECT(NVSP_OK, nvsp_cancel(both.encoder));
    EXPECT(NVSP_OK, nvsp_cancel(both.decoder));
    nvsp_destroy(NULL);
}

static void texts(void) {
    CHECK(strchr(nvsp_version(NULL, NULL), '.') != NULL);
    for (nvsp_status status = -40; status < 10; status++) {
        CHECK(nvsp_status_text(status)[0] != '\0');
    }
    CHECK(strcmp(nvsp_status_text(INT32_MIN), nvsp_status_text(INT32_MAX)) == 0);
}

// A caller's own check of a pointer, behind the library's: no attribute may let a compiler take it away.
#if defined(__GNUC__) && !defined(__clang__)
__attribute__((noinline, optimize("O2")))
#endif
static int is_null_to_its_caller(const nvsp_engine *engine, nvsp_engine_info *info) {
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_engine_get_info(engine, info));
    return engine == NULL;
}

int main(int argc, char **argv) {
    set_up(argc, argv);
    rig_add(&both, &dive.camera, NULL);
    encode_all(&both, &dive, packets);
    first = packets[0];

    engines_and_priors();
    encoders();
    decoders();
    links();
    any_handle();
    texts();
    nvsp_engine_info info = NVSP_INITIALIZER(nvsp_engine_info);
    CHECK(is_null_to_its_caller(NULL, &info));
    return tear_down();
}
