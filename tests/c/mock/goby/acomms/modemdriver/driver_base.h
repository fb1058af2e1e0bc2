// What c-examples/goby_link.cpp relies on of Goby 3's acoustic drivers, to check that it compiles without Goby.

#ifndef MOCK_GOBY_DRIVER_BASE_H
#define MOCK_GOBY_DRIVER_BASE_H

#include <functional>

namespace goby {
namespace acomms {
namespace protobuf {

class ModemTransmission;
class DriverConfig {};

}  // namespace protobuf

template <class Function>
struct Signal {
    void connect(std::function<Function> slot);
};

class ModemDriverBase {
public:
    virtual ~ModemDriverBase() = default;
    virtual void startup(const protobuf::DriverConfig &config) = 0;
    virtual void do_work() = 0;
    Signal<void(const protobuf::ModemTransmission &)> signal_receive;
    Signal<void(protobuf::ModemTransmission *)> signal_data_request;
};

}  // namespace acomms
}  // namespace goby

#endif
