#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "components/device.hpp"
namespace trocar {

// The packets of the UDP protocol; see the table in docs/devices.md. Little endian, fixed sizes.
inline constexpr size_t kStatePacketSize = 120, kForcePacketSize = 176;
inline constexpr uint16_t kPacketVersion = 1;

// From the device.
struct StatePacket {
    uint64_t sequence = 0;  // ascending from 1
    DeviceState state;      // time by the device's own clock
};
// To the device.
struct ForcePacket {
    uint64_t sequence = 0;  // ascending from 1
    uint64_t answers = 0;   // sequence of the newest state used
    double time = 0;        // s, by the device's clock: of that state
    DeviceCommand command;
};

enum class PacketFault : uint8_t {
    kNone,
    kShort,    // cut
    kLong,     // more than a packet
    kForeign,  // other magic bytes
    kVersion,
    kValue,  // not finite, out of range, or not a unit quaternion
};

std::array<std::byte, kStatePacketSize> encode_packet(const StatePacket& packet);
std::array<std::byte, kForcePacketSize> encode_packet(const ForcePacket& packet);

// Leaves `packet` unchanged unless all of it is valid: finite, no component above 1e6, orientation of length
// 1 within 1e-3 (it is normalised), sequence not 0.
PacketFault decode_packet(std::span<const std::byte> bytes, StatePacket& packet);
PacketFault decode_packet(std::span<const std::byte> bytes, ForcePacket& packet);

// Whether a state is valid for any device: the checks of decode_packet; normalises the orientation.
bool is_sound(DeviceState& state);

// Accepts packets in ascending order. A late or repeated one is rejected; after half a second of silence any
// number starts a new count (the device was restarted).
struct SequenceGate {
    static constexpr int64_t kSilence = 500'000'000;  // ns
    static constexpr uint64_t kMostLost = 1'000'000;  // more than any device sends within kSilence
    uint64_t last = 0;
    int64_t heard_ns = 0;

    enum class Verdict : uint8_t { kNext, kStale };
    // `lost` increases by the numbers skipped. A number more than kMostLost ahead counts as stale.
    Verdict pass(uint64_t sequence, int64_t now_ns, uint64_t& lost);
};

}  // namespace trocar
