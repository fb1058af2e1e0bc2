// Pictures from a vehicle to its topside through a slow link that loses frames.
//
// Two processes with a UDP socket on loopback between them. The vehicle's sender gives each frame of the camera its
// bytes, spreads the packet over modem frames, and says when each is due. A few of them, in any combination, yield a
// picture. Its modem is simulated: it sends at a set bit rate, and loses, swaps, repeats and pads modem frames. The
// topside's collector puts together what arrives. The topside shows the best possible picture of it, or the prior at a
// pose between those of other frames, and compares it with the original.

#include <arpa/inet.h>
#include <getopt.h>
#include <nvsprior_extra.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "example.h"

namespace {

using Clock = std::chrono::steady_clock;
using Bytes = std::vector<uint8_t>;

// Handles end by themselves, in any order.
struct Destroy {
    void operator()(void *handle) const { nvsp_destroy(handle); }
};
template <class T>
using Handle = std::unique_ptr<T, Destroy>;

// What is set on the command line.
struct Settings {
    double bit_rate = 20000;  // Bits per second.
    double frames_a_second = 2;
    double latency = 1.5;  // Seconds from a frame's exposure to its last modem frame, and until the topside shows it.
    uint32_t mtu = NVSP_MTU_64;
    double loss = 0.05, duplicates = 0.02, reorder = 0.02;  // Chances per modem frame.
    bool pad = false;
    unsigned seed = 1;
    std::string prior;
    nvsp_camera camera = NVSP_INITIALIZER(nvsp_camera);
    nvsp_pose start = NVSP_INITIALIZER(nvsp_pose);
    std::vector<std::string> frames;
};

// Says what failed, with the words of the handle that it failed on.
bool succeeded(nvsp_status status, const char *what, const void *handle) {
    if (status >= NVSP_OK) {
        return true;
    }
    char text[512] = "";
    nvsp_last_error(handle, text, sizeof text);
    std::fprintf(stderr, "%s: %s: %s\n", what, nvsp_status_text(status), text);
    return false;
}

bool open_prior(const std::string &path, Handle<nvsp_engine> &engine, Handle<nvsp_prior> &prior) {
    nvsp_engine *opened = nullptr;
    nvsp_prior *read = nullptr;
    const bool done = ::open_prior(path.c_str(), &opened, &read) != 0;
    engine.reset(opened);
    prior.reset(read);
    return done;
}

// ---- The modem, simulated -------------------------------------------------------------------------

// Sends modem frames at a bit rate, and does to them what water does.
class Modem {
public:
    Modem(int socket, const Settings &set) : socket_(socket), set_(set), random_(set.seed) {}

    // Returns when the frame has left, as a modem's serial port would.
    void send(Bytes frame) {
        if (set_.pad) {
            frame.resize(set_.mtu);
        }
        free_at_ = std::max(free_at_, Clock::now()) + seconds(8.0 * frame.size() / set_.bit_rate);
        std::this_thread::sleep_until(free_at_);
        sent++;
        bytes += frame.size();
        if (chance(set_.loss)) {
            return;
        }
        if (!late_ && chance(set_.reorder)) {
            late_ = std::move(frame);  // Arrives after the next one.
            return;
        }
        deliver(frame);
        if (chance(set_.duplicates)) {
            deliver(frame);
        }
        if (late_) {
            deliver(*late_);
            late_.reset();
        }
    }

    // Nothing more will come: an empty datagram, which no link loses.
    void end() {
        if (late_) {
            deliver(*late_);
        }
        deliver({});
    }

    size_t sent = 0, bytes = 0;

private:
    static Clock::duration seconds(double s) {
        return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(s));
    }
    bool chance(double p) { return std::uniform_real_distribution<>(0, 1)(random_) < p; }
    void deliver(const Bytes &frame) {
        if (::send(socket_, frame.data(), frame.size(), 0) < 0) {
            std::perror("sending");
        }
    }

    int socket_;
    const Settings &set_;
    std::mt19937 random_;
    Clock::time_point free_at_{};
    std::optional<Bytes> late_;
};

// ---- The vehicle ----------------------------------------------------------------------------------

// Seconds since the program began.
double clock_seconds() {
    static const auto since = Clock::now();
    return std::chrono::duration<double>(Clock::now() - since).count();
}

class Vehicle {
public:
    Vehicle(Modem &modem, const Settings &set) : modem_(modem), set_(set) {}

    bool open() {
        if (!open_prior(set_.prior, engine_, prior_)) {
            return false;
        }
        nvsp_encoder_options options;
        NVSP_INIT(&options);
        options.camera_interval = NVSP_CAMERA_ONCE;  // The topside is told of the camera.
        nvsp_encoder *encoder = nullptr;
        nvsp_status status =
            nvsp_encoder_create(engine_.get(), prior_.get(), &set_.camera, &options, &encoder);
        encoder_.reset(encoder);
        if (!succeeded(status, "making an encoder", engine_.get())) {
            return false;
        }
        nvsp_sender_options link;
        NVSP_INIT(&link);
        link.bit_rate = set_.bit_rate;
        link.frame_rate = set_.frames_a_second;
        link.latency = set_.latency;
        link.delay = 0.1;                  // For search and coding.
        link.spread = 0.3 * set_.latency;  // So long a burst of losses takes few modem frames of each packet.
        link.loss = set_.loss > 0 ? std::min(set_.loss, 0.9) : NVSP_LOSS_NONE;
        link.shares = most_shares;
        nvsp_sender *sender = nullptr;
        status = nvsp_sender_create(set_.mtu, &link, &sender);
        sender_.reset(sender);
        if (status != NVSP_OK) {
            std::fprintf(stderr, "making a sender: %s\n", nvsp_status_text(status));
        }
        packet_.resize(nvsp_size_bound(NVSP_SIZE_PACKET, set_.camera.width, set_.camera.height));
        return status == NVSP_OK;
    }

    // Sends a frame that was exposed at a time, or leaves it out. Modem frames go on leaving meanwhile.
    bool take(double exposed, const std::string &path, const nvsp_pose *hint) {
        uint32_t budget = 0;
        nvsp_status status = nvsp_sender_plan(sender_.get(), exposed, &budget);
        if (!succeeded(status, "planning", sender_.get())) {
            return false;
        }
        if (budget == 0) {
            std::printf("vehicle: a frame is left out\n");
            left_out_++;
            return true;
        }
        // A packet that tells the camera takes more, for once: the sender gives the next ones less.
        size_t size = 0;
        nvsp_frame_stats stats;
        NVSP_INIT(&stats);
        status = encode(path, hint, NVSP_RATE_STEADY, static_cast<float>(budget), size, stats);
        if (!succeeded(status, path.c_str(), encoder_.get())) {
            return false;
        }
        nvsp_division division;
        NVSP_INIT(&division);
        status = nvsp_sender_push(sender_.get(), clock_seconds(), packet_.data(), size, nullptr, 0, &division);
        std::printf("vehicle: frame %2u  %4u bytes in %4.0f ms, "
                    "%2u modem frames, any %2u give a picture, %2u all of it\n",
                    stats.frame, stats.bytes, stats.milliseconds, division.shares, division.picture_shares,
                    division.whole_shares);
        return succeeded(status, "sharing", sender_.get());
    }

    // Sends what is due until a time.
    void pump(double until) {
        while (clock_seconds() < until) {
            if (!send_next()) {
                std::this_thread::sleep_for(std::chrono::milliseconds(2));
            }
        }
    }

    // Sends all that waits.
    void drain() {
        double due = 0;
        while (nvsp_sender_due(sender_.get(), &due) == NVSP_OK) {
            if (!send_next()) {
                std::this_thread::sleep_for(std::chrono::milliseconds(2));
            }
        }
    }

private:
    static constexpr uint32_t most_shares = 32;

    // Encodes a frame on the encoder's own thread, and sends meanwhile.
    nvsp_status encode(const std::string &path, const nvsp_pose *hint, uint32_t rate, float value, size_t &size,
                       nvsp_frame_stats &stats) {
        nvsp_status status = nvsp_encoder_set_rate(encoder_.get(), rate, value);
        ppm frame{};
        if (status != NVSP_OK || !ppm_read(path.c_str(), &frame)) {
            return status == NVSP_OK ? NVSP_ERR_FILE : status;
        }
        const nvsp_image image = ppm_image(&frame);
        nvsp_frame_info info;
        NVSP_INIT(&info);
        info.hint = hint;
        info.left_out = std::exchange(left_out_, 0);
        status = nvsp_encode_begin(encoder_.get(), &image, &info);
        std::free(frame.pixels);
        if (status != NVSP_OK) {
            return status;
        }
        while (nvsp_wait(encoder_.get(), 0) == NVSP_PENDING) {
            if (!send_next()) {
                (void)!nvsp_wait(encoder_.get(), 2);
            }
        }
        return nvsp_encode_finish(encoder_.get(), packet_.data(), packet_.size(), &size, &stats);
    }

    // Sends one modem frame, if one is due.
    bool send_next() {
        Bytes share(set_.mtu);
        size_t size = 0;
        if (nvsp_sender_next(sender_.get(), clock_seconds(), share.data(), share.size(), &size) != NVSP_OK) {
            return false;
        }
        if (set_.pad) {
            // The modem fills it up: the link carries that, too.
            const auto padding = static_cast<uint32_t>(set_.mtu - size);
            (void)!nvsp_sender_count(sender_.get(), clock_seconds(), padding);
        }
        share.resize(size);
        modem_.send(std::move(share));
        return true;
    }

    Modem &modem_;
    const Settings &set_;
    Handle<nvsp_engine> engine_;
    Handle<nvsp_prior> prior_;
    Handle<nvsp_encoder> encoder_;
    Handle<nvsp_sender> sender_;
    Bytes packet_;
    uint32_t left_out_ = 0;  // Since the last packet.
};

bool dive(Modem &modem, const Settings &set) {
    Vehicle vehicle(modem, set);
    if (!vehicle.open()) {
        return false;
    }
    const double start = clock_seconds();
    for (size_t i = 0; i < set.frames.size(); i++) {
        const double exposed = start + static_cast<double>(i) / set.frames_a_second;
        vehicle.pump(exposed);
        if (!vehicle.take(exposed, set.frames[i], i == 0 ? &set.start : nullptr)) {
            return false;
        }
    }
    vehicle.drain();
    return true;
}

int vehicle(int socket, const Settings &set) {
    Modem modem(socket, set);
    const bool done = dive(modem, set);
    modem.end();
    std::printf("vehicle: %zu modem frames sent, %zu bytes\n", modem.sent, modem.bytes);
    return done ? 0 : 1;
}

// ---- The topside ----------------------------------------------------------------------------------

// PSNR of a picture against a PPM of the same size, dB. NaN if there is no such PPM.
double psnr(const Bytes &picture, const std::string &path) {
    ppm original{};
    if (!ppm_read(path.c_str(), &original)) {
        return NAN;
    }
    double sum = 0;
    const bool fits = ppm_size(&original) == picture.size();
    for (size_t i = 0; fits && i < picture.size(); i++) {
        const double difference = picture[i] - original.pixels[i];
        sum += difference * difference;
    }
    std::free(original.pixels);
    return fits ? 10 * std::log10(255.0 * 255.0 * static_cast<double>(picture.size()) / sum) : NAN;
}

class Topside {
public:
    explicit Topside(const Settings &set) : set_(set), packet_(1 << 16) {
        picture_.resize(size_t{3} * set.camera.width * set.camera.height);
    }

    bool open() {
        if (!open_prior(set_.prior, engine_, prior_)) {
            return false;
        }
        nvsp_decoder *decoder = nullptr;
        nvsp_status status = nvsp_decoder_create(engine_.get(), prior_.get(), nullptr, &decoder);
        decoder_.reset(decoder);
        if (status == NVSP_OK) {
            status = nvsp_decoder_add_camera(decoder, &set_.camera);
        }
        if (!succeeded(status, "making a decoder", engine_.get())) {
            return false;
        }
        nvsp_collector_options options;
        NVSP_INIT(&options);
        options.packets = 64;
        options.age = std::min(4 * set_.latency, 60 / set_.frames_a_second);
        nvsp_collector *collector = nullptr;
        status = nvsp_collector_create(set_.mtu, &options, &collector);
        collector_.reset(collector);
        if (status != NVSP_OK) {
            std::fprintf(stderr, "making a collector: %s\n", nvsp_status_text(status));
        }
        return status == NVSP_OK;
    }

    // Takes a modem frame.
    void take(const uint8_t *frame, size_t size) {
        bytes += size;
        nvsp_collected state;
        NVSP_INIT(&state);
        const double now = clock_seconds();
        if (nvsp_collector_push(collector_.get(), now, frame, size, &state) != NVSP_OK) {
            return;  // No share, or damaged.
        }
        const bool more = state.event == NVSP_EVENT_GROWN || state.event == NVSP_EVENT_COMPLETE;
        if (more && state.frame >= next_) {
            waiting_.emplace(state.frame, now);
        }
    }

    // Shows what there is: frames in their order, each once all of it has come, or when its time is over.
    void show_due(bool all) {
        while (!waiting_.empty()) {
            const auto [frame, since] = *waiting_.begin();
            size_t size = 0;
            nvsp_collected state;
            NVSP_INIT(&state);
            const nvsp_status status = nvsp_collector_fetch(collector_.get(), 0, frame, packet_.data(), packet_.size(),
                                                            &size, &state);
            const bool patient = !all && clock_seconds() - since < set_.latency;
            if (status == NVSP_OK && patient && (state.ended == 0 || frame > next_)) {
                return;  // More of it may come, or an earlier one.
            }
            waiting_.erase(waiting_.begin());
            if (status == NVSP_OK) {
                show(state, size);
            }
        }
    }

    void report(double seconds) const {
        nvsp_collector_statistics counts;
        NVSP_INIT(&counts);
        if (nvsp_collector_get_statistics(collector_.get(), &counts) != NVSP_OK) {
            return;
        }
        std::printf("topside: modem frames %llu used, %llu repeated, %llu refused\n",
                    static_cast<unsigned long long>(counts.accepted),
                    static_cast<unsigned long long>(counts.duplicates),
                    static_cast<unsigned long long>(counts.rejected));
        std::printf("topside: %llu packets came whole, %zu of them by a part of their modem frames; "
                    "%zu frames were drawn between\n",
                    static_cast<unsigned long long>(counts.completed), repaired, drawn);
        std::printf("topside: %zu of %zu pictures, %.2f per second, mean %.2f dB, %.0f bit/s\n", pictures,
                    set_.frames.size(), static_cast<double>(pictures) / seconds,
                    sum_psnr / static_cast<double>(pictures), 8.0 * static_cast<double>(bytes) / seconds);
    }

    size_t pictures = 0, drawn = 0, repaired = 0, bytes = 0;
    double sum_psnr = 0;

private:
    nvsp_picture place() {
        nvsp_picture place = NVSP_INITIALIZER(nvsp_picture);
        place.format = NVSP_FORMAT_RGB8;
        place.pixels = picture_.data();
        place.size = picture_.size();
        return place;
    }

    double quality(uint32_t frame) const {
        return frame < set_.frames.size() ? psnr(picture_, set_.frames[frame]) : NAN;
    }

    // Decodes what there is of a packet. Frames before it of which nothing came are drawn first.
    void show(const nvsp_collected &state, size_t size) {
        nvsp_header header;
        nvsp_decoded info;
        NVSP_INIT(&header);
        NVSP_INIT(&info);
        nvsp_status status = nvsp_decode_header(packet_.data(), size, prior_.get(), &header);
        if (status == NVSP_OK) {
            draw_between(state.frame, header);
            nvsp_picture picture = place();
            status = nvsp_decode(decoder_.get(), packet_.data(), size, NVSP_DECODE_START, &picture, &info);
        }
        if (!succeeded(status, "decoding", decoder_.get())) {
            return;
        }
        next_ = state.frame + 1;
        last_ = header;
        const double found = quality(state.frame);
        std::printf("topside: frame %2u  %4zu bytes, %2u of %2u modem frames came, %s, rows %3u of %3u, %5.2f dB\n",
                    state.frame, size, state.arrived, state.sent, state.complete ? "whole" : "part ",
                    info.rows, info.height, found);
        pictures++;
        repaired += state.complete && state.arrived < state.sent;
        sum_psnr += found;
    }

    // Draws the prior for frames between the last one shown and this one, if the vehicle was certain of both poses.
    void draw_between(uint32_t shown, const nvsp_header &header) {
        const auto certain = [](const nvsp_header &h) {
            return (h.flags & NVSP_HEADER_POSE) != 0 && (h.flags & NVSP_FRAME_UNCERTAIN) == 0;
        };
        for (uint32_t frame = next_; certain(last_) && certain(header) && frame < shown; frame++) {
            nvsp_pose pose = NVSP_INITIALIZER(nvsp_pose);
            nvsp_picture picture = place();
            const double part = double(frame + 1 - next_) / double(shown + 1 - next_);
            if (nvsp_pose_between(&last_.pose, &header.pose, part, &pose) != NVSP_OK
                || nvsp_decoder_draw(decoder_.get(), &pose, &picture) != NVSP_OK) {
                return;
            }
            drawn++;
            std::printf("topside: frame %2u  did not come: the prior at a pose between, %5.2f dB\n", frame,
                        quality(frame));
        }
    }

    const Settings &set_;
    Handle<nvsp_engine> engine_;
    Handle<nvsp_prior> prior_;
    Handle<nvsp_decoder> decoder_;
    Handle<nvsp_collector> collector_;
    Bytes packet_, picture_;
    std::map<uint32_t, double> waiting_;  // By frame number: when it first gave a picture.
    uint32_t next_ = 0;                   // The number after the last one shown.
    nvsp_header last_ = NVSP_INITIALIZER(nvsp_header);  // Of the last one shown.
};

int topside(int socket, int ready, const Settings &set) {
    Topside top(set);
    if (!top.open() || write(ready, "", 1) != 1) {
        return 1;
    }
    const timeval tick = {0, 20000};
    setsockopt(socket, SOL_SOCKET, SO_RCVTIMEO, &tick, sizeof tick);
    Bytes frame(65536);
    const double since = clock_seconds();
    double heard = since;
    ssize_t size;
    while ((size = recv(socket, frame.data(), frame.size(), 0)) != 0) {
        if (size > 0) {
            heard = clock_seconds();
            top.take(frame.data(), static_cast<size_t>(size));
        } else if ((errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR) || clock_seconds() > heard + 30) {
            std::perror("receiving");
            break;
        }
        top.show_due(false);
    }
    top.show_due(true);
    top.report(clock_seconds() - since);
    return size == 0 && top.pictures > 0 ? 0 : 1;
}

// ---- Two processes --------------------------------------------------------------------------------

const char usage[] =
    "usage: modem_link [OPTIONS] PRIOR.ply CAMERA START FRAME.ppm...\n"
    "CAMERA            width,height,fx,fy,cx,cy in pixels, the frames' size\n"
    "START             qw,qx,qy,qz,tx,ty,tz: the camera's rough pose at the first frame, world to camera\n"
    "--bit-rate N      bits per second (20000)\n"
    "--fps N           frames per second, which share the bits (2)\n"
    "--latency S       seconds from a frame's exposure to its last modem frame, and until it is shown (1.5)\n"
    "--mtu N           bytes of a modem frame, 16 to 65000 (64)\n"
    "--loss P --duplicates P --reorder P\n"
    "                  chances for each modem frame (0.05, 0.02, 0.02)\n"
    "--pad             fill up every modem frame to the MTU\n"
    "--seed N          of these chances (1)\n";

bool parse(int argc, char **argv, Settings &set) {
    static const option options[] = {
        {"bit-rate", required_argument, nullptr, 'b'}, {"fps", required_argument, nullptr, 'f'},
        {"latency", required_argument, nullptr, 't'},  {"mtu", required_argument, nullptr, 'm'},
        {"loss", required_argument, nullptr, 'l'},
        {"duplicates", required_argument, nullptr, 'd'}, {"reorder", required_argument, nullptr, 'r'},
        {"pad", no_argument, nullptr, 'p'},            {"seed", required_argument, nullptr, 's'},
        {nullptr, 0, nullptr, 0}};
    for (int c; (c = getopt_long(argc, argv, "", options, nullptr)) != -1;) {
        const double value = optarg ? std::atof(optarg) : 0;
        switch (c) {
        case 'b': set.bit_rate = value; break;
        case 'f': set.frames_a_second = value; break;
        case 't': set.latency = value; break;
        case 'm': set.mtu = static_cast<uint32_t>(value); break;
        case 'l': set.loss = value; break;
        case 'd': set.duplicates = value; break;
        case 'r': set.reorder = value; break;
        case 'p': set.pad = true; break;
        case 's': set.seed = static_cast<unsigned>(value); break;
        default: return false;
        }
    }
    if (argc - optind < 4 || !(set.bit_rate > 0) || !(set.frames_a_second > 0) || !(set.latency > 0) || set.mtu < 16
        || set.mtu > 65000) {
        return false;
    }
    set.prior = argv[optind];
    set.frames.assign(argv + optind + 3, argv + argc);
    return camera_of(argv[optind + 1], &set.camera) && pose_of(argv[optind + 2], &set.start);
}

// A socket that receives on loopback, and one that sends to it.
bool connect_sockets(int &in, int &out) {
    in = socket(AF_INET, SOCK_DGRAM, 0);
    out = socket(AF_INET, SOCK_DGRAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    auto *generic = reinterpret_cast<sockaddr *>(&address);
    return in >= 0 && out >= 0 && bind(in, generic, size) == 0 && getsockname(in, generic, &size) == 0
           && connect(out, generic, size) == 0;
}

}  // namespace

int main(int argc, char **argv) {
    Settings set;
    if (!parse(argc, argv, set)) {
        std::fputs(usage, stderr);
        return 2;
    }
    std::setvbuf(stdout, nullptr, _IOLBF, 0);
    int in = -1, out = -1, ready[2];
    if (!connect_sockets(in, out) || pipe(ready) != 0) {
        std::perror("making sockets");
        return 1;
    }
    // Before any call of the library: a child may not use its parent's handles.
    const pid_t child = fork();
    if (child < 0) {
        std::perror("fork");
        return 1;
    }
    if (child == 0) {
        close(ready[0]);
        return topside(in, ready[1], set);
    }
    close(ready[1]);
    char byte;
    const bool listening = read(ready[0], &byte, 1) == 1;
    const int status = listening ? vehicle(out, set) : 1;
    int ended = 0;
    waitpid(child, &ended, 0);
    return status == 0 && WIFEXITED(ended) && WEXITSTATUS(ended) == 0 ? 0 : 1;
}
