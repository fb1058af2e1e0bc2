// Pictures from a vehicle to its topside over two UDP sockets that lose datagrams, with reports back, and keys.
//
// The topside shows each frame in its order, or the prior at a pose between others.

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <random>
#include <vector>

#include "example.h"

constexpr uint32_t mtu = 64;

struct Settings {
    nvsp_camera camera;
    nvsp_pose start;
    nvsp_keys keys;
    double bit_rate, frames_a_second, loss;
    std::vector<ppm> frames;
};

static double now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

static bool done(nvsp_status status, const char *what) {
    if (status >= NVSP_OK) return true;
    char text[512] = "";
    nvsp_last_error(nullptr, text, sizeof text);
    std::fprintf(stderr, "%s: %s\n", what, text);
    return false;
}

// Sends a modem frame, or loses it.
static void send_or_lose(int socket, const uint8_t *bytes, size_t size, double loss) {
    static std::mt19937 random(1);
    if (std::uniform_real_distribution<>(0, 1)(random) >= loss) (void)!send(socket, bytes, size, 0);
}

// Waits for a datagram at most until a time; its bytes, or -1.
static ssize_t receive(int socket, uint8_t *bytes, double until) {
    pollfd wanted{socket, POLLIN, 0};
    const int ms = static_cast<int>(std::fmin(std::fmax((until - now()) * 1000, 0), 1000));
    return poll(&wanted, 1, ms) > 0 ? recv(socket, bytes, mtu, 0) : -1;
}

// Two sockets on loopback that send to each other.
static bool udp_pair(int (&sockets)[2]) {
    sockaddr_in places[2] = {};
    socklen_t size = sizeof places[0];
    for (int i = 0; i < 2; i++) {
        auto *place = reinterpret_cast<sockaddr *>(&places[i]);
        places[i].sin_family = AF_INET, places[i].sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        sockets[i] = socket(AF_INET, SOCK_DGRAM, 0);
        if (bind(sockets[i], place, size) != 0 || getsockname(sockets[i], place, &size) != 0) return false;
    }
    auto *first = reinterpret_cast<sockaddr *>(&places[0]), *second = reinterpret_cast<sockaddr *>(&places[1]);
    return connect(sockets[0], second, size) == 0 && connect(sockets[1], first, size) == 0;
}

static bool run_vehicle(int socket, const Settings &set, nvsp_engine *engine, nvsp_prior *prior) {
    nvsp_vehicle_options options = NVSP_INITIALIZER(nvsp_vehicle_options);
    options.mtu = mtu, options.keys = &set.keys;
    options.bit_rate = set.bit_rate, options.frame_rate = set.frames_a_second, options.loss = set.loss;
    nvsp_vehicle *vehicle = nullptr;
    if (!done(nvsp_vehicle_create(engine, prior, &set.camera, nullptr, &options, &vehicle), "vehicle")) return false;
    const double begin = now();
    uint8_t bytes[mtu];
    size_t size = 0, taken = 0;
    // Two seconds more, until all has been sent.
    for (double next = begin; now() < begin + set.frames.size() / set.frames_a_second + 2;) {
        const double due = begin + taken / set.frames_a_second;
        if (taken < set.frames.size() && now() >= due) {
            const nvsp_image image = ppm_image(&set.frames[taken]);
            nvsp_frame_info info = NVSP_INITIALIZER(nvsp_frame_info);
            info.hint = taken++ == 0 ? &set.start : nullptr;
            done(nvsp_vehicle_frame(vehicle, now(), &image, &info, nullptr, 0), "frame");
        }
        while (nvsp_vehicle_transmit(vehicle, now(), mtu, bytes, &size, &next) == NVSP_OK)
            send_or_lose(socket, bytes, size, set.loss);
        const ssize_t came = receive(socket, bytes, std::fmin(next, taken < set.frames.size() ? due : now() + 0.1));
        if (came > 0) done(nvsp_vehicle_receive(vehicle, now(), bytes, static_cast<size_t>(came)), "report");
        nvsp_event event = NVSP_INITIALIZER(nvsp_event);
        while (nvsp_vehicle_event(vehicle, &event) == NVSP_OK)  // Store what NVSP_EVENT_STORE has.
            if (event.kind == NVSP_EVENT_FRAME && done(event.status, "encoding"))
                std::printf("vehicle: frame %u: %u bytes, %.1f dB\n", event.frame, event.bytes, event.value);
    }
    send(socket, bytes, 0, 0), nvsp_destroy(vehicle);  // An empty datagram: the end.
    return true;
}

static bool run_topside(int socket, const Settings &set, nvsp_engine *engine, nvsp_prior *prior) {
    nvsp_topside_options options = NVSP_INITIALIZER(nvsp_topside_options);
    options.mtu = mtu, options.latency = 2, options.frame_rate = set.frames_a_second;
    options.keys = &set.keys;
    nvsp_topside *topside = nullptr;
    if (!done(nvsp_topside_create(engine, prior, &options, &topside), "topside")) return false;
    std::vector<uint8_t> pixels(size_t{3} * set.camera.width * set.camera.height);
    nvsp_picture place = NVSP_INITIALIZER(nvsp_picture);
    place.format = NVSP_FORMAT_RGB8;
    uint8_t bytes[mtu];
    size_t size = 0, pictures = 0;
    for (ssize_t came = -1; came != 0;) {
        came = receive(socket, bytes, now() + 0.02);
        if (came > 0) done(nvsp_topside_receive(topside, now(), bytes, static_cast<size_t>(came)), "modem frame");
        place.pixels = pixels.data(), place.size = pixels.size();
        nvsp_decoded shown = NVSP_INITIALIZER(nvsp_decoded);
        if (nvsp_topside_picture(topside, now(), &place, &shown) == NVSP_OK) {
            const bool own = !(shown.flags & NVSP_DECODED_BETWEEN);
            std::printf("topside: frame %u: %s, %u of %u modem frames, %.1f s old\n", shown.frame,
                        own ? "its own" : "between others", shown.arrived, shown.sent, shown.age);
            pictures += own;
        }
        if (nvsp_topside_report(topside, now(), bytes, mtu, &size, nullptr) == NVSP_OK)
            send_or_lose(socket, bytes, size, set.loss);
    }
    std::printf("topside: %zu of %zu pictures\n", pictures, set.frames.size());
    nvsp_destroy(topside);
    return true;
}

int main(int argc, char **argv) {
    Settings set{};
    double link[3];
    const uint8_t key[NVSP_KEY_BYTES] = {1, 2, 3};  // Of a real one all bytes are random.
    if (argc < 6 || !camera_of(argv[2], &set.camera) || !pose_of(argv[3], &set.start) || !numbers(argv[4], link, 3)) {
        std::fputs("usage: modem_link PRIOR.ply CAMERA START BIT_RATE,FRAMES_A_SECOND,LOSS FRAME.ppm...\n", stderr);
        return 2;
    }
    set.bit_rate = link[0], set.frames_a_second = link[1], set.loss = link[2];
    set.keys = NVSP_INITIALIZER(nvsp_keys), set.keys.keys = key, set.keys.count = 1;
    for (int i = 5; i < argc; i++)
        if (set.frames.emplace_back(); !ppm_read(argv[i], &set.frames.back())) return 1;
    int sockets[2], ended = 0;
    if (!udp_pair(sockets)) return 1;
    const bool above = fork() == 0;
    nvsp_engine *engine = nullptr;
    nvsp_prior *prior = nullptr;
    bool right = open_prior(argv[1], &engine, &prior);
    if (right) right = (above ? run_topside : run_vehicle)(sockets[above], set, engine, prior);
    nvsp_destroy(prior), nvsp_destroy(engine);
    if (!above) wait(&ended);
    return right && ended == 0 ? 0 : 1;
}
