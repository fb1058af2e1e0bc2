// What c-examples/goby_link.cpp relies on of Goby 3's modem messages, to check that it compiles without Goby.

#ifndef MOCK_GOBY_MODEM_MESSAGE_H
#define MOCK_GOBY_MODEM_MESSAGE_H

#include <cstdint>
#include <string>

namespace goby {
namespace acomms {
namespace protobuf {

class ModemTransmission {
public:
    bool has_max_frame_bytes() const;
    uint32_t max_frame_bytes() const;
    uint32_t max_num_frames() const;
    int frame_size() const;
    const std::string &frame(int index) const;
    void add_frame(const std::string &bytes);
    void set_dest(int32_t id);
    void set_ack_requested(bool wanted);
};

}  // namespace protobuf
}  // namespace acomms
}  // namespace goby

#endif
