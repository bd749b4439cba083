#pragma once
#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "engine/device_link.hpp"
namespace trocar {

// "[HOST:]PORT" with what is left out filled in.
struct NetworkPlace {
    std::string host;
    uint16_t port = 0;
};

// Each opens one kind of device from what follows its word and a colon in the specification; `specification` is the
// whole of it, for messages. Throw InputError as open_device does.
std::unique_ptr<DeviceLink> open_udp_device(const std::string& specification, const NetworkPlace& place);
std::unique_ptr<DeviceLink> open_plugin_device(const std::string& specification, const std::string& rest);
std::unique_ptr<DeviceLink> open_haply_device(const std::string& specification, const NetworkPlace& place);
std::unique_ptr<DeviceLink> open_igtl_device(const std::string& specification, const NetworkPlace& place);
bool haply_is_built();
bool igtl_is_built();

// What one message of the Haply service says of its first Inverse3 and, where there is one, the first VerseGrip
// (orientation, buttons a, b, c as bits 0, 1, 2). False for anything else; then the others are as they were.
bool read_haply_message(std::string_view text, std::string& device_id, DeviceState& state);
// What the service is told: {"inverse3":[{"device_id":...,"commands":{"set_cursor_force":{"vector":...}}}]}.
std::string haply_command(const std::string& device_id, const Vec3d& force);

// Pose of a whole OpenIGTLink message (header and body) of type TRANSFORM or POSITION, from millimetres. False for
// other types, wrong checksums, lengths that contradict each other, and matrices that are no rotation.
bool read_igtl_message(std::span<const std::byte> message, DeviceState& state);

// Throws InputError "device specification: reason".
[[noreturn]] void refuse_device(const std::string& specification, const std::string& reason);

}  // namespace trocar
