// A firmware's control loop: camera frames in, modem frames out, never waiting. board.h stands for the board's drivers.

#include <board.h>
#include <nvsprior.h>

static int failed(nvsp_status status) {
    char text[256] = "";
    if (status < NVSP_OK && nvsp_last_error(NULL, text, sizeof text) == NVSP_OK) {
        board_log(nvsp_status_text(status), text);
    }
    return status < NVSP_OK;
}

int main(void) {
    static const nvsp_camera camera = {NVSP_HEAD(nvsp_camera), 640, 360, 500, 500, 320, 180};
    static uint8_t bytes[1024], state[NVSP_MAX_DATA];
    nvsp_engine *engine = NULL;
    nvsp_prior *prior = NULL;
    nvsp_vehicle *vehicle = NULL;
    nvsp_encoder_options encodes = NVSP_INITIALIZER(nvsp_encoder_options);
    encodes.search_bound = NVSP_BOUND_MILLISECONDS(200);
    nvsp_vehicle_options options = NVSP_INITIALIZER(nvsp_vehicle_options);
    options.mtu = sizeof bytes;
    options.bit_rate = 20000;
    options.frame_rate = 15;
    options.picture_rate = 2;
    options.state = state;
    options.state_size = (uint32_t)board_load(state, sizeof state);  // 0: this dive begins anew.
    if (failed(nvsp_engine_create(NULL, &engine)) || failed(nvsp_prior_open(engine, "/data/site.nvsg", NULL, &prior))
        || failed(nvsp_vehicle_create(engine, prior, &camera, &encodes, &options, &vehicle))) {
        return 1;
    }
    while (board_runs()) {
        board_steer();
        nvsp_image image = NVSP_INITIALIZER(nvsp_image);
        nvsp_frame_info info = NVSP_INITIALIZER(nvsp_frame_info);
        info.given = NVSP_GIVEN_TIME;
        if (board_frame(&image, &info.time)) {  // NVSP_PENDING: it is left out.
            failed(nvsp_vehicle_frame(vehicle, board_seconds(), &image, &info, NULL, 0));
        }
        size_t size = 0;
        while ((size = board_received(bytes, sizeof bytes)) > 0) {
            failed(nvsp_vehicle_receive(vehicle, board_seconds(), bytes, size));
        }
        if (board_modem_is_free()
            && nvsp_vehicle_transmit(vehicle, board_seconds(), sizeof bytes, bytes, &size, NULL) == NVSP_OK) {
            board_send(bytes, size);
        }
        nvsp_event event = NVSP_INITIALIZER(nvsp_event);
        while (nvsp_vehicle_event(vehicle, &event) == NVSP_OK) {
            if (event.kind == NVSP_EVENT_STORE) {
                board_store(event.data, event.data_size);
            }
        }
    }
    nvsp_destroy(vehicle);
    nvsp_destroy(prior);
    nvsp_destroy(engine);
    return 0;
}
