// A camera that does not wait, and an encoder that always takes the newest frame.
//
// The camera's thread fills one of three buffers at a fixed rate, in NV12 as camera drivers deliver it. The encoder's
// thread takes the newest full buffer. A full buffer that a newer one replaces is dropped. No buffer is copied, and
// neither thread waits for the other.

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

#include "example.h"

namespace {

using Clock = std::chrono::steady_clock;
using Bytes = std::vector<uint8_t>;

// A frame in NV12: Y, then U and V in turns, one pair for two by two pixels.
struct Nv12 {
    uint32_t width = 0, height = 0;
    Bytes y, uv;
    Clock::time_point taken{};

    nvsp_image image() const {
        nvsp_image image = NVSP_INITIALIZER(nvsp_image);
        image.format = NVSP_FORMAT_NV12;
        image.colour = NVSP_COLOUR_BT601_LIMITED;
        image.width = width;
        image.height = height;
        image.planes[0] = y.data();
        image.planes[1] = uv.data();
        image.strides[0] = width;
        image.strides[1] = size_t{2} * ((width + 1) / 2);
        image.sizes[0] = y.size();
        image.sizes[1] = uv.size();
        return image;
    }
};

uint8_t rounded(double value) { return static_cast<uint8_t>(std::clamp(value + 0.5, 0.0, 255.0)); }

// Converts as a camera does: BT.601, limited range.
Nv12 to_nv12(const ppm &picture) {
    const uint32_t w = picture.width, h = picture.height, cw = (w + 1) / 2, ch = (h + 1) / 2;
    Nv12 frame{w, h, Bytes(size_t{w} * h), Bytes(size_t{2} * cw * ch), {}};
    std::vector<double> u(size_t{cw} * ch), v(u), n(u);
    for (uint32_t i = 0; i < w * h; i++) {
        const double r = picture.pixels[3 * i], g = picture.pixels[3 * i + 1],
                     b = picture.pixels[3 * i + 2];
        frame.y[i] = rounded(16 + 0.256788 * r + 0.504129 * g + 0.097906 * b);
        const uint32_t pair = i / w / 2 * cw + i % w / 2;
        u[pair] += -0.148223 * r - 0.290993 * g + 0.439216 * b;
        v[pair] += 0.439216 * r - 0.367788 * g - 0.071427 * b;
        n[pair] += 1;
    }
    for (size_t i = 0; i < u.size(); i++) {
        frame.uv[2 * i] = rounded(128 + u[i] / n[i]);
        frame.uv[2 * i + 1] = rounded(128 + v[i] / n[i]);
    }
    return frame;
}

// Three buffers: one that the camera fills, the newest full one, and one that is being encoded.
class Ring {
public:
    explicit Ring(const Nv12 &like) : filling_(like), newest_(like), encoding_(like) {}

    // The camera's buffer, for its thread alone.
    Nv12 &filling() { return filling_; }

    // The camera's buffer is full, and another is to fill.
    void push() {
        const std::lock_guard lock(mutex_);
        std::swap(filling_, newest_);  // Swaps pointers, not pixels.
        dropped_ += fresh_ ? 1 : 0;
        fresh_ = true;
        changed_.notify_one();
    }

    // The newest frame. The encoder's thread may use it until its next call. Null when all is over.
    const Nv12 *take() {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [this] { return fresh_ || over_; });
        if (over_) {
            return nullptr;
        }
        std::swap(newest_, encoding_);
        fresh_ = false;
        return &encoding_;
    }

    void end() {
        const std::lock_guard lock(mutex_);
        over_ = true;
        changed_.notify_one();
    }

    size_t dropped() const { return dropped_; }

private:
    Nv12 filling_, newest_, encoding_;
    bool fresh_ = false, over_ = false;
    size_t dropped_ = 0;
    std::mutex mutex_;
    std::condition_variable changed_;
};

// The camera: delivers the frames forth and back, `rate` per second.
void film(Ring &ring, const std::vector<Nv12> &frames, double rate, double seconds) {
    const auto period =
        std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1 / rate));
    const size_t turn = std::max<size_t>(1, 2 * frames.size() - 2);
    auto next = Clock::now();
    for (size_t i = 0; static_cast<double>(i) < rate * seconds; i++) {
        const size_t at = i % turn;
        const Nv12 &frame = frames[std::min(at, turn - at)];
        Nv12 &buffer = ring.filling();
        std::copy(frame.y.begin(), frame.y.end(), buffer.y.begin());  // The sensor's DMA.
        std::copy(frame.uv.begin(), frame.uv.end(), buffer.uv.begin());
        buffer.taken = Clock::now();
        ring.push();
        next += period;
        std::this_thread::sleep_until(next);
    }
    ring.end();
}

double milliseconds(Clock::duration d) { return std::chrono::duration<double, std::milli>(d).count(); }

// Encodes what the ring has, until it ends. Returns false if a frame fails.
bool encode(nvsp_encoder *encoder, const nvsp_camera &camera, const nvsp_pose &start, Ring &ring) {
    Bytes packet(nvsp_size_bound(NVSP_SIZE_PACKET, camera.width, camera.height));
    size_t encoded = 0;
    double sum = 0, most = 0;
    for (const Nv12 *frame; (frame = ring.take()) != nullptr; encoded++) {
        const nvsp_image image = frame->image();
        const double waited = milliseconds(Clock::now() - frame->taken);
        nvsp_frame_info info;
        NVSP_INIT(&info);
        info.hint = encoded == 0 ? &start : nullptr;
        nvsp_frame_stats stats;
        NVSP_INIT(&stats);
        size_t size = 0;
        const nvsp_status status =
            nvsp_encode(encoder, &image, &info, packet.data(), packet.size(), &size, &stats);
        if (status != NVSP_OK) {
            char text[512] = "";
            nvsp_last_error(encoder, text, sizeof text);
            std::fprintf(stderr, "encoding: %s: %s\n", nvsp_status_text(status), text);
            return false;
        }
        const double latency = milliseconds(Clock::now() - frame->taken);
        std::printf("frame %3u  %4zu bytes  %5.2f dB  waited %4.0f ms, latency %4.0f ms\n", stats.frame,
                    size, stats.psnr, waited, latency);
        sum += latency;
        most = std::max(most, latency);
    }
    std::printf("%zu frames encoded, %zu dropped; latency %.0f ms, at most %.0f ms\n", encoded,
                ring.dropped(), encoded > 0 ? sum / static_cast<double>(encoded) : 0.0, most);
    return encoded > 0;
}

struct Destroy {
    void operator()(void *handle) const { nvsp_destroy(handle); }
};

const char usage[] =
    "usage: camera_ring PRIOR.ply CAMERA START RATE SECONDS FRAME.ppm...\n"
    "CAMERA   width,height,fx,fy,cx,cy in pixels: what to encode at; frames are scaled to it\n"
    "START    qw,qx,qy,qz,tx,ty,tz: the camera's rough pose at the first frame, world to camera\n"
    "RATE     frames per second that the camera delivers, for SECONDS\n"
    "FRAMEs   of one size; shown forth and back\n";

// Reads the frames. Returns none if one cannot be read or has another size.
std::vector<Nv12> read_frames(char **paths, int count) {
    std::vector<Nv12> frames;
    for (int i = 0; i < count; i++) {
        ppm picture{};
        if (!ppm_read(paths[i], &picture)) {
            return {};
        }
        frames.push_back(to_nv12(picture));
        std::free(picture.pixels);
        if (frames[i].y.size() != frames[0].y.size() || frames[i].width != frames[0].width) {
            std::fprintf(stderr, "%s: of another size\n", paths[i]);
            return {};
        }
    }
    return frames;
}

}  // namespace

int main(int argc, char **argv) {
    nvsp_camera camera;
    nvsp_pose start;
    const double rate = argc > 6 ? std::atof(argv[4]) : 0, seconds = argc > 6 ? std::atof(argv[5]) : 0;
    if (!(rate > 0) || !(seconds > 0) || !camera_of(argv[2], &camera) || !pose_of(argv[3], &start)) {
        std::fputs(usage, stderr);
        return 2;
    }
    const std::vector<Nv12> frames = read_frames(argv + 6, argc - 6);
    nvsp_engine *engine = nullptr;
    nvsp_prior *prior = nullptr;
    nvsp_encoder *encoder = nullptr;
    const bool opened = !frames.empty() && open_prior(argv[1], &engine, &prior);
    const std::unique_ptr<nvsp_engine, Destroy> engine_owner(engine);
    const std::unique_ptr<nvsp_prior, Destroy> prior_owner(prior);
    if (!opened) {
        return 1;
    }
    const nvsp_status status = nvsp_encoder_create(engine, prior, &camera, nullptr, &encoder);
    const std::unique_ptr<nvsp_encoder, Destroy> encoder_owner(encoder);
    if (status != NVSP_OK) {
        char text[512] = "";
        nvsp_last_error(engine, text, sizeof text);
        std::fprintf(stderr, "making an encoder: %s: %s\n", nvsp_status_text(status), text);
        return 1;
    }

    Ring ring(frames[0]);
    bool encoded = false;
    std::thread encoding([&] { encoded = encode(encoder, camera, start, ring); });
    film(ring, frames, rate, seconds);
    encoding.join();
    return encoded ? 0 : 1;
}
