// The vehicle's end in a Goby application: a sketch, as it needs Goby 3 and a modem.
//
// It relies on these parts of Goby's acoustic drivers, as their headers have them in 2021 and later, and on no others:
// ModemDriverBase with startup, do_work, signal_receive and signal_data_request; and of ModemTransmission
// max_frame_bytes, max_num_frames, frame, dest and ack_requested.
//
// The MAC says when this node may send. The driver then asks for data: signal_data_request. So the link is pulled, and
// shares its turns with the application's other messages.

#include <goby/acomms/modemdriver/driver_base.h>
#include <goby/acomms/protobuf/modem_message.pb.h>
#include <nvsprior.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

using goby::acomms::protobuf::ModemTransmission;

double now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

bool done(nvsp_status status, const char *what) {
    char text[512] = "";
    if (status < NVSP_OK && nvsp_last_error(nullptr, text, sizeof text) == NVSP_OK) {
        std::fprintf(stderr, "%s: %s\n", what, text);
    }
    return status == NVSP_OK;
}

}  // namespace

class PictureLink {
public:
    // The driver's largest frame is the MTU: the topside needs the same.
    PictureLink(goby::acomms::ModemDriverBase &driver, int topside, uint32_t mtu, nvsp_engine *engine,
                nvsp_prior *prior, const nvsp_camera &camera)
        : topside_(topside), room_(mtu) {
        nvsp_vehicle_options options = NVSP_INITIALIZER(nvsp_vehicle_options);
        options.mtu = mtu;
        options.frame_rate = 15;
        options.picture_rate = 1;
        options.flags = NVSP_LINK_PULL;
        nvsp_vehicle *made = nullptr;
        if (!done(nvsp_vehicle_create(engine, prior, &camera, nullptr, &options, &made), "making a vehicle")) {
            throw std::runtime_error("no vehicle");
        }
        vehicle_.reset(made);
        driver.signal_data_request.connect([this](ModemTransmission *turn) { give(*turn); });
        driver.signal_receive.connect([this](const ModemTransmission &came) { take(came); });
    }

    // Each frame of the camera. It returns at once.
    void frame(const nvsp_image &image) {
        done(nvsp_vehicle_frame(vehicle_.get(), now(), &image, nullptr, nullptr, 0), "frame");
    }

private:
    // As many frames as the turn has room for.
    void give(ModemTransmission &turn) {
        size_t room = room_.size(), size = 0;
        if (turn.has_max_frame_bytes()) {
            room = std::min(room, static_cast<size_t>(turn.max_frame_bytes()));
        }
        turn.set_ack_requested(false);  // Reports tell what came.
        while (static_cast<uint32_t>(turn.frame_size()) < turn.max_num_frames()
               && done(nvsp_vehicle_transmit(vehicle_.get(), now(), room, room_.data(), &size, nullptr), "sending")) {
            turn.set_dest(topside_);
            turn.add_frame(std::string(room_.begin(), room_.begin() + static_cast<std::ptrdiff_t>(size)));
        }
    }

    void take(const ModemTransmission &came) {
        for (int i = 0; i < came.frame_size(); i++) {
            const std::string &bytes = came.frame(i);
            // What is no report is another message of the application.
            const auto *data = reinterpret_cast<const uint8_t *>(bytes.data());
            (void)!nvsp_vehicle_receive(vehicle_.get(), now(), data, bytes.size());
        }
    }

    struct Destroy {
        void operator()(void *handle) const { nvsp_destroy(handle); }
    };
    int topside_;
    std::vector<uint8_t> room_;
    std::unique_ptr<nvsp_vehicle, Destroy> vehicle_;
};

// The application's loop. `next` gives the camera's frames.
void run(goby::acomms::ModemDriverBase &driver, const goby::acomms::protobuf::DriverConfig &config, PictureLink &link,
         const std::function<bool(nvsp_image &)> &next) {
    driver.startup(config);
    for (;;) {
        nvsp_image image = NVSP_INITIALIZER(nvsp_image);
        if (next(image)) {
            link.frame(image);
        }
        driver.do_work();
    }
}
