#pragma once
#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "engine/devices/link.hpp"
namespace trocar {

// "[HOST:]PORT" with defaults for missing parts.
struct NetworkAddress {
    std::string host;
    uint16_t port = 0;
};

// Each opens one kind of device from the part of the specification after its keyword and colon;
// `specification` is all of it, for messages. Throw InputError like open_device.
std::unique_ptr<DeviceLink> open_udp_device(const std::string& specification, const NetworkAddress& address);
std::unique_ptr<DeviceLink> open_plugin_device(const std::string& specification, const std::string& rest);
std::unique_ptr<DeviceLink> open_haply_device(const std::string& specification, const NetworkAddress& address);
std::unique_ptr<DeviceLink> open_igtl_device(const std::string& specification, const NetworkAddress& address);
bool haply_is_built();
bool igtl_is_built();

// Content of one message of the Haply service: its first Inverse3 and, if present, the first VerseGrip
// (orientation, buttons a, b, c as bits 0, 1, 2). False for other messages; outputs are then unchanged.
bool read_haply_message(std::string_view text, std::string& device_id, DeviceState& state);
// Command to the service: {"inverse3":[{"device_id":...,"commands":{"set_cursor_force":{"vector":...}}}]}.
std::string haply_command(const std::string& device_id, const Vec3d& force);

// Pose of a complete OpenIGTLink message (header and body) of type TRANSFORM or POSITION, from millimetres.
// False for other types, wrong checksums, contradictory lengths, and matrices that are not rotations.
bool read_igtl_message(std::span<const std::byte> message, DeviceState& state);

// Throws InputError "device specification: reason".
[[noreturn]] void refuse_device(const std::string& specification, const std::string& reason);

}  // namespace trocar
