#include "engine/devices/packets.hpp"

#include <bit>
#include <cmath>
#include <cstring>

#include "engine/base/check.hpp"
#include "engine/geometry/quaternion.hpp"
namespace trocar {
namespace {

static_assert(std::endian::native == std::endian::little, "packets are written as they lie in memory");

constexpr uint32_t kStateMagic = 0x53445254, kForceMagic = 0x46445254;  // "TRDS", "TRDF"
constexpr double kLargest = 1e6;

// One layout for both directions: `visit` is called with every field of a packet in order.
template <typename State, typename Visitor>
void visit_state(State& p, Visitor& visit) {
    visit(p.sequence), visit(p.state.time);
    for (int k = 0; k < 3; ++k) visit(p.state.position[k]);
    visit(p.state.orientation.w), visit(p.state.orientation.x), visit(p.state.orientation.y), visit(p.state.orientation.z);
    for (int k = 0; k < 3; ++k) visit(p.state.velocity[k]);
    visit(p.state.grip), visit(p.state.buttons);
}
template <typename Force, typename Visitor>
void visit_force(Force& p, Visitor& visit) {
    visit(p.sequence), visit(p.answers), visit(p.time);
    for (int k = 0; k < 3; ++k) visit(p.command.force[k]);
    for (int k = 0; k < 3; ++k) visit(p.command.torque[k]);
    for (int k = 0; k < 3; ++k) visit(p.command.at[k]);
    for (auto& element : p.command.stiffness) visit(element);
}

struct Writer {
    std::span<std::byte> bytes;
    size_t next = 0;
    template <typename T>
    void operator()(const T& value) {
        TROCAR_ASSERT(next + sizeof value <= bytes.size());
        std::memcpy(bytes.data() + next, &value, sizeof value);
        next += sizeof value;
    }
};
struct Reader {
    std::span<const std::byte> bytes;
    size_t next = 0;
    template <typename T>
    void operator()(T& value) {
        TROCAR_ASSERT(next + sizeof value <= bytes.size());
        std::memcpy(&value, bytes.data() + next, sizeof value);
        next += sizeof value;
    }
};

template <size_t size>
Writer start(std::array<std::byte, size>& bytes, uint32_t magic) {
    Writer write{bytes};
    write(magic), write(kPacketVersion), write(static_cast<uint16_t>(size));
    return write;
}

PacketFault check_head(Reader& read, uint32_t magic, size_t size) {
    if (read.bytes.size() < 8) return PacketFault::kShort;
    uint32_t found_magic = 0;
    uint16_t version = 0, said = 0;
    read(found_magic), read(version), read(said);
    if (found_magic != magic) return PacketFault::kForeign;
    if (version != kPacketVersion) return PacketFault::kVersion;
    if (read.bytes.size() < size) return PacketFault::kShort;
    if (read.bytes.size() > size || said != size) return PacketFault::kLong;
    return PacketFault::kNone;
}

bool is_sound(double value) { return std::isfinite(value) && std::abs(value) <= kLargest; }
bool is_sound(const Vec3d& v) { return is_sound(v.x()) && is_sound(v.y()) && is_sound(v.z()); }

}  // namespace

bool is_sound(DeviceState& state) {
    const Quat& q = state.orientation;
    const double length2 = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z;
    if (!std::isfinite(state.time) || !is_sound(state.position) || !is_sound(state.velocity) || !is_sound(state.grip)) return false;
    if (!(std::abs(length2 - 1) < 2e-3)) return false;
    state.orientation = normalized(q);
    return true;
}

std::array<std::byte, kStatePacketSize> encode_packet(const StatePacket& packet) {
    std::array<std::byte, kStatePacketSize> bytes{};
    Writer write = start(bytes, kStateMagic);
    visit_state(packet, write);
    return bytes;
}

std::array<std::byte, kForcePacketSize> encode_packet(const ForcePacket& packet) {
    std::array<std::byte, kForcePacketSize> bytes{};
    Writer write = start(bytes, kForceMagic);
    visit_force(packet, write);
    return bytes;
}

PacketFault decode_packet(std::span<const std::byte> bytes, StatePacket& packet) {
    Reader read{bytes};
    const PacketFault fault = check_head(read, kStateMagic, kStatePacketSize);
    if (fault != PacketFault::kNone) return fault;
    StatePacket found;
    visit_state(found, read);
    if (found.sequence == 0 || !is_sound(found.state)) return PacketFault::kValue;
    packet = found;
    return PacketFault::kNone;
}

PacketFault decode_packet(std::span<const std::byte> bytes, ForcePacket& packet) {
    Reader read{bytes};
    const PacketFault fault = check_head(read, kForceMagic, kForcePacketSize);
    if (fault != PacketFault::kNone) return fault;
    ForcePacket found;
    visit_force(found, read);
    const DeviceCommand& c = found.command;
    bool sound = found.sequence > 0 && std::isfinite(found.time) && is_sound(c.force) && is_sound(c.torque) && is_sound(c.at);
    for (const double k : c.stiffness) sound = sound && std::isfinite(k) && std::abs(k) <= 1e9;
    if (!sound) return PacketFault::kValue;
    packet = found;
    return PacketFault::kNone;
}

SequenceGate::Verdict SequenceGate::pass(uint64_t sequence, int64_t now_ns, uint64_t& lost) {
    const bool fresh = last == 0 || now_ns - heard_ns > kSilence;
    if (!fresh && sequence <= last) return Verdict::kStale;
    if (!fresh && sequence - last > kMostLost) return Verdict::kStale;  // accepted, it would make all later packets stale
    if (!fresh) lost += sequence - last - 1;
    last = sequence;
    heard_ns = now_ns;
    return Verdict::kNext;
}

}  // namespace trocar
