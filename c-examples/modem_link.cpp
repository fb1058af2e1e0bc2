// Pictures from a vehicle to its topside through a slow link that loses frames.
//
// Two processes with a UDP socket on loopback between them. The vehicle encodes a frame while the one before is on its
// way. Its byte budget is what the link carries per frame. Its modem is simulated: it sends at a set bit rate, and
// loses, swaps, repeats and pads modem frames. The topside puts together what arrives, shows the best possible picture
// of it, and compares it with the original.

#include <arpa/inet.h>
#include <getopt.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "example.h"

namespace {

using Clock = std::chrono::steady_clock;
using Bytes = std::vector<uint8_t>;

// Handles end by themselves, in any order.
struct Destroy {
    void operator()(nvsp_engine *e) const { nvsp_engine_destroy(e); }
    void operator()(nvsp_prior *p) const { nvsp_prior_destroy(p); }
    void operator()(nvsp_encoder *e) const { nvsp_encoder_destroy(e); }
    void operator()(nvsp_decoder *d) const { nvsp_decoder_destroy(d); }
    void operator()(nvsp_reassembler *r) const { nvsp_reassembler_destroy(r); }
};
template <class T>
using Handle = std::unique_ptr<T, Destroy>;

// What is set on the command line.
struct Settings {
    double bit_rate = 20000;  // Bits per second.
    double frames_a_second = 2;
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
template <class T>
bool sound(nvsp_status status, const char *what, const T *handle,
           nvsp_status (*last_error)(const T *, char *, size_t)) {
    if (status >= NVSP_OK) {
        return true;
    }
    char text[512] = "";
    last_error(handle, text, sizeof text);
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

// Bytes of a packet that fills the modem frames that the link carries in one frame's time.
size_t packet_budget(const Settings &set, double link_bytes) {
    const size_t modem_frames = std::max(1.0, std::floor(link_bytes / set.mtu));
    return modem_frames * set.mtu - 4 * (modem_frames - 1);  // All but the first have a header of 4 bytes.
}

bool send_packet(Modem &modem, const Bytes &packet, const Settings &set) {
    uint32_t count = 0;
    nvsp_status status = nvsp_modem_frame_count(packet.size(), set.mtu, &count);
    for (uint32_t i = 0; status == NVSP_OK && i < count; i++) {
        Bytes frame(set.mtu);
        size_t size = 0;
        status = nvsp_modem_frame(packet.data(), packet.size(), set.mtu, i, frame.data(),
                                  frame.size(), &size);
        if (status == NVSP_OK) {
            frame.resize(size);
            modem.send(std::move(frame));
        }
    }
    if (status != NVSP_OK) {
        std::fprintf(stderr, "splitting: %s\n", nvsp_status_text(status));
    }
    return status == NVSP_OK;
}

// Begins to encode a frame and returns at once. The picture is not needed afterwards.
bool begin(nvsp_encoder *encoder, const std::string &path, const nvsp_pose *hint, double link_bytes,
           const Settings &set) {
    const float budget = static_cast<float>(packet_budget(set, link_bytes));
    if (!sound(nvsp_encoder_set_rate(encoder, NVSP_RATE_BYTES, budget), "setting the rate", encoder,
               nvsp_encoder_last_error)) {
        return false;
    }
    ppm frame{};
    if (!ppm_read(path.c_str(), &frame)) {
        return false;
    }
    const nvsp_image image = ppm_image(&frame);
    const nvsp_status status = nvsp_encode_begin(encoder, &image, hint);
    std::free(frame.pixels);
    return sound(status, path.c_str(), encoder, nvsp_encoder_last_error);
}

// Fetches the packet that was begun. Waits for it if the link was faster than the encoder.
bool finish(nvsp_encoder *encoder, Bytes &packet, nvsp_frame_stats &stats) {
    const bool ready = nvsp_encode_poll(encoder) == NVSP_OK;
    while (nvsp_encode_wait(encoder, 100) == NVSP_PENDING) {
    }
    size_t size = 0;
    const nvsp_status status =
        nvsp_encode_finish(encoder, packet.data(), packet.size(), &size, &stats);
    if (!sound(status, "encoding", encoder, nvsp_encoder_last_error)) {
        return false;
    }
    std::printf("vehicle: frame %2u  %4u bytes in %4.0f ms, %s\n", stats.frame, stats.bytes,
                stats.milliseconds, ready ? "ready before the link was" : "the link waited");
    packet.resize(size);
    return true;
}

bool dive(Modem &modem, const Settings &set) {
    Handle<nvsp_engine> engine;
    Handle<nvsp_prior> prior;
    if (!open_prior(set.prior, engine, prior)) {
        return false;
    }
    nvsp_encoder_options options;
    NVSP_INIT(&options);
    options.threshold = 1e-2f;
    options.camera_interval = NVSP_CAMERA_ONCE;  // The topside is told of the camera.
    nvsp_encoder *made = nullptr;
    const nvsp_status status =
        nvsp_encoder_create(engine.get(), prior.get(), &set.camera, &options, &made);
    if (!sound(status, "making an encoder", engine.get(), nvsp_engine_last_error)) {
        return false;
    }
    const Handle<nvsp_encoder> encoder(made);

    const size_t bound = nvsp_packet_bound(set.camera.width, set.camera.height);
    const double share = set.bit_rate / 8 / set.frames_a_second;
    double link_bytes = share;
    if (!begin(encoder.get(), set.frames[0], &set.start, link_bytes, set)) {
        return false;
    }
    for (size_t i = 0; i < set.frames.size(); i++) {
        Bytes packet(bound);
        nvsp_frame_stats stats;
        NVSP_INIT(&stats);
        if (!finish(encoder.get(), packet, stats)) {
            return false;
        }
        // The next frame is encoded while this one is on its way. It may use the bytes that this one leaves.
        const double left = link_bytes - static_cast<double>(packet.size());
        link_bytes = share + std::clamp(left, 0.0, share);
        if (i + 1 < set.frames.size()
            && !begin(encoder.get(), set.frames[i + 1], nullptr, link_bytes, set)) {
            return false;
        }
        if (!send_packet(modem, packet, set)) {
            return false;
        }
    }
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
        nvsp_reassembler *reassembler = nullptr;
        nvsp_reassembler_options options;
        NVSP_INIT(&options);
        options.flags = NVSP_MODEM_CHECKS;  // UDP hands over no damaged datagrams.
        nvsp_status status = nvsp_decoder_create(engine_.get(), prior_.get(), &decoder);
        decoder_.reset(decoder);
        if (status == NVSP_OK) {
            status = nvsp_decoder_add_camera(decoder, &set_.camera);
        }
        if (!sound(status, "making a decoder", engine_.get(), nvsp_engine_last_error)) {
            return false;
        }
        status = nvsp_reassembler_create(set_.mtu, &options, &reassembler);
        reassembler_.reset(reassembler);
        if (status != NVSP_OK) {
            std::fprintf(stderr, "making a reassembler: %s\n", nvsp_status_text(status));
        }
        return status == NVSP_OK;
    }

    // Takes a modem frame, and keeps the best of the newest packet.
    void take(const uint8_t *frame, size_t size) {
        bytes += size;
        nvsp_reassembly state;
        NVSP_INIT(&state);
        if (nvsp_reassembler_push(reassembler_.get(), frame, size, &state) != NVSP_OK) {
            return;  // No modem frame, or damaged.
        }
        if (state.event != NVSP_EVENT_GROWN && state.event != NVSP_EVENT_COMPLETE) {
            if (held_ > 0 && state.frame == state_.frame) {
                state_.frames = state.frames;  // Repeated, or behind one that is missing.
            }
            return;
        }
        size_t written = 0;
        if (nvsp_reassembler_fetch(reassembler_.get(), spare_.data(), spare_.size(), &written, &state)
            != NVSP_OK) {
            return;
        }
        if (held_ > 0 && state.frame != state_.frame) {
            show();  // A newer one has begun: nothing more comes of the one before.
        }
        std::swap(packet_, spare_);
        held_ = written;
        state_ = state;
        if (state.complete != 0) {
            show();
        }
    }

    // Decodes what there is of the packet, once.
    void show() {
        if (held_ == 0 || state_.frame == shown_) {
            return;
        }
        nvsp_picture place = NVSP_INITIALIZER(nvsp_picture);
        place.format = NVSP_FORMAT_RGB8;
        place.pixels = picture_.data();
        place.size = picture_.size();
        nvsp_decoded info;
        NVSP_INIT(&info);
        const nvsp_status status =
            nvsp_decode(decoder_.get(), packet_.data(), held_, NVSP_DECODE_START, &place, &info);
        if (!sound(status, "decoding", decoder_.get(), nvsp_decoder_last_error)) {
            return;
        }
        shown_ = state_.frame;
        const double quality =
            info.frame < set_.frames.size() ? psnr(picture_, set_.frames[info.frame]) : NAN;
        std::printf("topside: frame %2u  %4zu bytes, ", info.frame, held_);
        if (state_.expected > 0) {
            std::printf("%2u of %2u modem frames lost", state_.expected - state_.frames,
                        state_.expected);
        } else {
            std::printf("the most of it lost    ");
        }
        std::printf(", rows %3u of %3u, %5.2f dB\n", info.rows, info.height, quality);
        pictures++;
        sum_psnr += quality;
    }

    void report(double seconds) const {
        nvsp_reassembler_statistics counts;
        NVSP_INIT(&counts);
        if (nvsp_reassembler_get_statistics(reassembler_.get(), &counts) != NVSP_OK) {
            return;
        }
        std::printf("topside: modem frames %llu used, %llu repeated, %llu refused\n",
                    static_cast<unsigned long long>(counts.accepted),
                    static_cast<unsigned long long>(counts.duplicates),
                    static_cast<unsigned long long>(counts.rejected));
        std::printf("topside: %zu of %zu pictures, %.2f per second, mean %.2f dB, %.0f bit/s\n", pictures,
                    set_.frames.size(), static_cast<double>(pictures) / seconds,
                    sum_psnr / static_cast<double>(pictures), 8.0 * static_cast<double>(bytes) / seconds);
    }

    size_t pictures = 0, bytes = 0;
    double sum_psnr = 0;

private:
    const Settings &set_;
    Handle<nvsp_engine> engine_;
    Handle<nvsp_prior> prior_;
    Handle<nvsp_decoder> decoder_;
    Handle<nvsp_reassembler> reassembler_;
    Bytes packet_, spare_ = Bytes(1 << 16), picture_;
    size_t held_ = 0;
    nvsp_reassembly state_{};
    uint32_t shown_ = UINT32_MAX;
};

int topside(int socket, int ready, const Settings &set) {
    Topside top(set);
    if (!top.open() || write(ready, "", 1) != 1) {
        return 1;
    }
    const timeval patience = {30, 0};
    setsockopt(socket, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    Bytes frame(65536);
    const auto since = Clock::now();
    ssize_t size;
    while ((size = recv(socket, frame.data(), frame.size(), 0)) > 0) {
        top.take(frame.data(), static_cast<size_t>(size));
    }
    top.show();
    if (size < 0) {
        std::perror("receiving");
    }
    top.report(std::chrono::duration<double>(Clock::now() - since).count());
    return size == 0 && top.pictures > 0 ? 0 : 1;
}

// ---- Two processes --------------------------------------------------------------------------------

const char usage[] =
    "usage: modem_link [OPTIONS] PRIOR.ply CAMERA START FRAME.ppm...\n"
    "CAMERA            width,height,fx,fy,cx,cy in pixels, the frames' size\n"
    "START             qw,qx,qy,qz,tx,ty,tz: the camera's rough pose at the first frame, world to camera\n"
    "--bit-rate N      bits per second (20000)\n"
    "--fps N           frames per second, which share the bits (2)\n"
    "--mtu N           bytes of a modem frame, 31 to 65000 (64)\n"
    "--loss P --duplicates P --reorder P\n"
    "                  chances for each modem frame (0.05, 0.02, 0.02)\n"
    "--pad             fill up every modem frame to the MTU\n"
    "--seed N          of these chances (1)\n";

bool parse(int argc, char **argv, Settings &set) {
    static const option options[] = {
        {"bit-rate", required_argument, nullptr, 'b'}, {"fps", required_argument, nullptr, 'f'},
        {"mtu", required_argument, nullptr, 'm'},      {"loss", required_argument, nullptr, 'l'},
        {"duplicates", required_argument, nullptr, 'd'}, {"reorder", required_argument, nullptr, 'r'},
        {"pad", no_argument, nullptr, 'p'},            {"seed", required_argument, nullptr, 's'},
        {nullptr, 0, nullptr, 0}};
    for (int c; (c = getopt_long(argc, argv, "", options, nullptr)) != -1;) {
        const double value = optarg ? std::atof(optarg) : 0;
        switch (c) {
        case 'b': set.bit_rate = value; break;
        case 'f': set.frames_a_second = value; break;
        case 'm': set.mtu = static_cast<uint32_t>(value); break;
        case 'l': set.loss = value; break;
        case 'd': set.duplicates = value; break;
        case 'r': set.reorder = value; break;
        case 'p': set.pad = true; break;
        case 's': set.seed = static_cast<unsigned>(value); break;
        default: return false;
        }
    }
    if (argc - optind < 4 || !(set.bit_rate > 0) || !(set.frames_a_second > 0) || set.mtu < 31
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
