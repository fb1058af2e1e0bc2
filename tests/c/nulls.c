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
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_last_error(NULL, NULL, 5));
    EXPECT(NVSP_OK, nvsp_last_error(NULL, text, sizeof text));
    CHECK(strlen(text) > 3);
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
    EXPECT(NVSP_ERR_STATE, nvsp_set_allocator(NULL, NULL, NULL));
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
    nvsp_decoded header;
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
    const nvsp_vehicle_options options = vehicle_options(64, 20000, 5);
    const nvsp_topside_options receives = topside_options(64);
    nvsp_vehicle *vehicle = NULL;
    nvsp_topside *topside = NULL;
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_create(NULL, NULL, NULL, NULL, NULL, &vehicle));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_create(NULL, NULL, NULL, NULL, &options, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_create(NULL, both.prior, NULL, NULL, &options, &vehicle));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_create(NULL, NULL, &dive.camera, NULL, &options, &vehicle));
    CHECK(says(NULL, "engine"));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_create(both.engine, NULL, &dive.camera, NULL, &options, &vehicle));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_create(both.engine, both.prior, NULL, NULL, &options, &vehicle));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_create(both.engine, both.prior, &dive.camera, NULL, NULL, &vehicle));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_create(both.engine, both.prior, &dive.camera, NULL, &options, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_create(NULL, NULL, NULL, &topside));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_create(NULL, NULL, &receives, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_create(NULL, both.prior, &receives, &topside));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_create(both.engine, NULL, &receives, &topside));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_memory(NULL, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_memory(&options, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_memory(NULL, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_memory(&receives, NULL));
    CHECK(vehicle == NULL && topside == NULL);
    vehicle = new_vehicle(&options);
    topside = new_topside(&receives);
    CHECK(nvsp_vehicle_encoder(NULL) == NULL && nvsp_topside_decoder(NULL) == NULL);

    uint8_t bytes[256];
    size_t written = 77;
    uint32_t count = 77;
    double next = 77;
    memset(bytes, 0xa5, sizeof bytes);
    const nvsp_image image = scene_image(&dive, 0);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_frame(NULL, 0, &image, NULL, NULL, 0));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_frame(vehicle, 0, NULL, NULL, NULL, 0));
    EXPECT(NVSP_ERR_STATE, nvsp_vehicle_frame(vehicle, 0, &image, NULL, NULL, 0));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_plan(NULL, 0, 0, NULL, &count));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_plan(vehicle, 0, 0, &count, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_packet(NULL, 0, first.bytes, first.size, NULL, 0));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_packet(vehicle, 0, NULL, first.size, NULL, 0));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_packet(vehicle, 0, first.bytes, first.size, NULL, 1));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_transmit(NULL, 0, 64, bytes, &written, &next));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_transmit(vehicle, 0, 64, NULL, &written, &next));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_transmit(vehicle, 0, 64, bytes, NULL, &next));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_count(NULL, 0, 5));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_set_link(NULL, 0, 5000, 0.1, 1));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_receive(NULL, 0, bytes, sizeof bytes));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_receive(vehicle, 0, NULL, sizeof bytes));
    nvsp_event event = NVSP_INITIALIZER(nvsp_event);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_event(NULL, &event));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_event(vehicle, NULL));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_event(NULL, &event));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_event(topside, NULL));
    nvsp_vehicle_statistics sent = NVSP_INITIALIZER(nvsp_vehicle_statistics);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_get_statistics(NULL, &sent));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_vehicle_get_statistics(vehicle, NULL));

    // So that there is something to fetch.
    uint32_t budget = 0;
    MUST(nvsp_vehicle_plan(vehicle, 0, 0, NULL, &budget));
    MUST(nvsp_vehicle_packet(vehicle, 0, first.bytes, first.size, NULL, 0));
    size_t size = 0;
    uint8_t frame[64];
    while (nvsp_vehicle_transmit(vehicle, 9, sizeof frame, frame, &size, NULL) == NVSP_OK) {
        MUST(nvsp_topside_receive(topside, 0, frame, size));
    }
    nvsp_decoded shown = NVSP_INITIALIZER(nvsp_decoded);
    nvsp_picture none = NVSP_INITIALIZER(nvsp_picture);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_receive(NULL, 0, frame, size));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_receive(topside, 0, NULL, size));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_picture(NULL, 0, &none, &shown));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_picture(topside, 0, NULL, &shown));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_packet(NULL, 0, bytes, sizeof bytes, &written, &shown));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_packet(topside, 0, NULL, sizeof bytes, &written, &shown));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_packet(topside, 0, bytes, sizeof bytes, NULL, &shown));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_report(NULL, 0, bytes, sizeof bytes, &written, &next));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_report(topside, 0, NULL, sizeof bytes, &written, &next));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_report(topside, 0, bytes, sizeof bytes, NULL, &next));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_set_region(NULL, 0, 0, 1, 1, 2));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_set_user(NULL, bytes, 4));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_set_user(topside, NULL, 4));
    nvsp_topside_statistics came = NVSP_INITIALIZER(nvsp_topside_statistics);
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_get_statistics(NULL, &came));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_topside_get_statistics(topside, NULL));
    CHECK(shown.bytes == 0 && sent.packets == 0 && came.accepted == 0 && next == 77 && event.kind == 0);
    CHECK(written == 77 && count == 77 && all_are(bytes, 0xa5, sizeof bytes));
    EXPECT(NVSP_OK, nvsp_vehicle_event(vehicle, &event));
    nvsp_destroy(vehicle);
    nvsp_destroy(topside);

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
    CHECK(says(both.engine, "none that works beside its caller"));
    EXPECT(NVSP_ERR_ARGUMENT, nvsp_cancel(both.prior));
    CHECK(says(both.prior, "none that works beside its caller"));
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
