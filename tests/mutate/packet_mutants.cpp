#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>

#include "content/scene/build_scene.hpp"
#include "content/scene/sweep_file.hpp"
#include "engine/base/check.hpp"
#include "engine/base/error.hpp"
#include "engine/devices/backends.hpp"
#include "engine/devices/device.hpp"
#include "engine/devices/packets.hpp"
#include "engine/files/state_hash.hpp"
#include "engine/files/text_file.hpp"
#include "engine/world/world.hpp"
#include "mutate/mutants.hpp"
#include "systems/app/run/live_recording.hpp"
#ifdef TROCAR_IGTL
#include <igtlPositionMessage.h>
#include <igtlTransformMessage.h>
#include <igtl_header.h>
#include <igtl_util.h>
#endif
namespace trocar::mutate {
namespace {

namespace fs = std::filesystem;

constexpr const char* kScene = R"(name = "mutant"
seconds = 0.5
gravity = [0.0, 0.0, -9.81]
staples = 2
[parameters]
soft = 5e3
[contact]
tolerance = 1e-4
iterations = 2
deep = "last_free"
[camera]
target = [0.0, 0.0, 0.0]
distance = 0.4
[[body]]
name = "a"
shape = "sphere"
size = 0.1
triangles = 80
motion = "deformable"
anchor = "shape"
tissue = {youngs_modulus = "$soft", density = 1000.0, damping = 20.0}
[[body.group]]
name = "top"
sphere = [0.0, 0.0, 0.05, 0.03]
[[body.region]]
group = "top"
stiffness = 3.0
[[body]]
name = "b"
shape = "box"
size = 0.2
triangles = 48
motion = "deformable"
model = "solid"
cells = 3
position = [0.0, 0.0, -0.3]
fixed_below = -0.05
tissue = "liver"
[[body]]
name = "rain"
shape = "sphere"
size = 0.05
triangles = 20
motion = "free"
position = [0.0, 0.0, 0.5]
velocity = [0.0, 0.0, -1.0]
[body.scatter]
count = 3
spacing = [0.1, 0.1, 0.1]
jitter = 0.1
[[body]]
name = "probe"
shape = "sphere"
size = 0.02
triangles = 80
motion = "hand"
position = [0.0, 0.0, 0.2]
mass = 0.05
[[tool]]
body = "probe"
tip_radius = 0.01
stiffness = 500.0
path = [{time = 0.0, position = [0.0, 0.0, 0.2]}, {time = 1.0, position = [0.0, 0.0, 0.1], rotation = [0.0, 1.0, 0.0, 30.0]}]
hand = {mass = 0.1, damping = 1.0, stiffness = 100.0}
[[tool.effect]]
kind = "vibration"
force = 0.2
frequency = 100.0
[[link]]
name = "hold"
body = "a"
to = "probe"
group = "top"
until = 0.4
break_strain = 0.5
[[cut]]
body = "a"
sphere = [0.05, 0.0, 0.0, 0.02]
time = 0.2
)";

constexpr const char* kSweep = R"(name = "mutant"
scene = "probe_on_liver"
seconds = 0.1
threads = 1
columns = ["wall_s", "contact.max_depth_m"]
[set]
"contact.tolerance" = 1e-4
[vary]
"liver.triangles" = [100, 200]
"contact.direction" = ["local", "thesis"]
)";

constexpr const char* kTrace =
    "time,x,y,z,qw,qx,qy,qz,vx,vy,vz,buttons,grip\n0,0,0,0.1,1,0,0,0,0,0,-1,0,0\n0.001,0,0,0.099,1,0,0,0,0,0,-1,1,0.1\n"
    "0.002,1e-3,0,0.098,0.8,0,0.6,0,0,0,-1,3,0.2\n";

constexpr const char* kHaply =
    R"({"inverse3":[{"device_id":"049D","state":{"cursor_position":{"x":0.01,"y":-0.02,"z":0.03},"cursor_velocity":{"x":0.1,"y":0.0,"z":-0.2}}}],)"
    R"("wireless_verse_grip":[{"device_id":"62F7","state":{"orientation":{"w":0.8,"x":0.0,"y":0.6,"z":0.0},"buttons":{"a":true,"b":false,"c":true}}}]})";

std::span<const std::byte> bytes_of(const std::string& text) { return std::as_bytes(std::span(text)); }

template <typename Bytes>
std::string text_of(const Bytes& bytes) {
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

// A file with these bytes that exists as long as this object.
struct WrittenFile {
    fs::path path;
    WrittenFile(const std::string& name, const std::string& bytes)
        : path(fs::temp_directory_path() / ("trocar_" + std::to_string(::getpid()) + "_" + name)) {
        std::ofstream(path, std::ios::binary) << bytes;
    }
    ~WrittenFile() {
        std::error_code error;
        fs::remove(path, error);
    }
};

void check_state(const DeviceState& state) {
    TROCAR_ASSERT(state.position.allFinite() && state.velocity.allFinite() && std::isfinite(state.time) && std::isfinite(state.grip));
    const Quat& q = state.orientation;
    TROCAR_ASSERT(std::abs(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z - 1) < 1e-9);
}

// Small enough to be built quickly.
bool is_small(const SceneFile& scene) {
    if (scene.bodies.size() > 20 || scene.staples > 1000) return false;
    for (const BodySpec& body : scene.bodies) {
        if (body.triangles > 500 || !body.file.empty() || body.cells > 6 || body.spacing > 0) return false;
    }
    return true;
}

// Scenes that can be read are built; a built scene must have no fault.
bool try_scene(const fs::path& path) {
    const SceneFile scene = read_scene_file(path, {});
    if (!is_small(scene)) return true;
    const BuiltScene built = build_scene(scene, Looks::kPlain);
    const std::string fault = find_fault(built.world);
    if (!fault.empty()) std::fprintf(stderr, "%s\n", fault.c_str());
    TROCAR_ASSERT(fault.empty());
    return true;
}

LiveRecording some_recording() {
    LiveRecording r;
    r.tools = 2;
    r.slip = {0, 1e-3, 2e-3};
    r.taken = {0, 0, 16, 16, 33, 33};
    for (uint64_t n = 0; n < 8; ++n) {
        LiveTick tick{};
        tick.tick = n / 2;
        tick.tool = n % 2;
        tick.time = 1e-3 * static_cast<double>(n / 2);
        tick.sample.position.x() = 0.1;
        r.tick.push_back(tick);
    }
    return r;
}

std::string make_recording() {
    const WrittenFile file("seed.recording", "");
    write_live_recording(file.path, some_recording());
    return read_file_bytes(file.path);
}

// Updates the checksum at the end of a damaged recording: as written by a program that makes wrong
// recordings.
std::string with_checksum(std::string bytes) {
    const size_t words = bytes.size() / 8;
    if (words < 2) return bytes;
    StateHash hash;
    for (size_t k = 0; k + 1 < words; ++k) {
        uint64_t word;
        std::memcpy(&word, bytes.data() + 8 * k, 8);
        hash.add_word(word);
    }
    std::memcpy(bytes.data() + 8 * (words - 1), &hash.value, 8);
    bytes.resize(8 * words);
    return bytes;
}

bool try_recording(const Seed& mutant) {
    const WrittenFile file(mutant.name, with_checksum(mutant.bytes));
    const LiveRecording r = read_live_recording(file.path);
    TROCAR_ASSERT(r.taken.size() == r.slip.size() * r.tools);
    for (const LiveTick& tick : r.tick) TROCAR_ASSERT(tick.tool < r.tools);
    return true;
}

bool try_trace(const Seed& mutant) {
    const WrittenFile file(mutant.name, mutant.bytes);
    const DeviceTrace trace = read_device_trace(file.path);
    TROCAR_ASSERT(!trace.sample.empty());
    for (const DeviceState& state : trace.sample) check_state(state);
    return true;
}

bool try_udp(const std::string& bytes) {
    StatePacket state;
    if (decode_packet(bytes_of(bytes), state) == PacketFault::kNone) {
        check_state(state.state);
        return true;
    }
    ForcePacket force;
    if (decode_packet(bytes_of(bytes), force) != PacketFault::kNone) return false;
    TROCAR_ASSERT(force.command.force.allFinite() && force.command.torque.allFinite());
    return true;
}

bool try_haply(const std::string& text) {
    std::string id;
    DeviceState state;
    if (!read_haply_message(text, id, state)) return false;
    check_state(state);
    TROCAR_ASSERT(!id.empty());
    return true;
}

#ifdef TROCAR_IGTL
std::vector<Seed> make_igtl_seeds() {
    igtl::TransformMessage::Pointer transform = igtl::TransformMessage::New();
    transform->SetDeviceName("tool");
    igtl::Matrix4x4 m;
    igtl::IdentityMatrix(m);
    m[0][3] = 10;
    transform->SetMatrix(m);
    transform->Pack();
    igtl::PositionMessage::Pointer position = igtl::PositionMessage::New();
    position->SetPosition(1, 2, 3);
    position->SetQuaternion(0, 0.6f, 0, 0.8f);
    position->Pack();
    const auto bytes = [](auto& message) {
        return std::string(static_cast<const char*>(message->GetPackPointer()), static_cast<size_t>(message->GetPackSize()));
    };
    return {{"a.igtl", bytes(transform)}, {"b.igtl", bytes(position)}};
}

// With an updated checksum of the body.
bool try_igtl(std::string bytes) {
    if (bytes.size() > IGTL_HEADER_SIZE) {
        igtl_uint64 sum = crc64(reinterpret_cast<unsigned char*>(bytes.data()) + IGTL_HEADER_SIZE, bytes.size() - IGTL_HEADER_SIZE, 0);
        for (size_t k = 0; k < 8; ++k) bytes[IGTL_HEADER_SIZE - 8 + k] = static_cast<char>(sum >> (8 * (7 - k)));
    }
    DeviceState state;
    if (!read_igtl_message(bytes_of(bytes), state)) return false;
    check_state(state);
    return true;
}
#endif

bool try_one(const Seed& mutant) {
    const auto is = [&](const char* ending) { return mutant.name.ends_with(ending); };
    if (is(".udp")) return try_udp(mutant.bytes);
    if (is(".json")) return try_haply(mutant.bytes);
#ifdef TROCAR_IGTL
    if (is(".igtl")) return try_igtl(mutant.bytes);
#endif
    if (is(".recording")) return try_recording(mutant);
    if (is(".csv")) return try_trace(mutant);
    const WrittenFile file(mutant.name, mutant.bytes);
    if (is(".sweep")) return read_sweep_file(file.path).axes.size() > 0;
    return try_scene(file.path);
}

}  // namespace

std::vector<Seed> make_input_seeds() {
    StatePacket state;
    state.sequence = 3;
    state.state.time = 3e-3;
    state.state.position = {0.01, -0.02, 0.03};
    state.state.buttons = 5;
    std::vector<Seed> seeds = {{"a.toml", kScene},
                               {"a.sweep", kSweep},
                               {"a.csv", kTrace},
                               {"state.udp", text_of(encode_packet(state))},
                               {"force.udp", text_of(encode_packet(ForcePacket{1, 2, 3, {{1, 2, 3}, {4, 5, 6}, {7, 8, 9}, {}}}))},
                               {"a.recording", make_recording()}};
    if (haply_is_built()) seeds.push_back({"a.json", kHaply});
#ifdef TROCAR_IGTL
    for (Seed& seed : make_igtl_seeds()) seeds.push_back(std::move(seed));
#endif
    return seeds;
}

bool is_input(const Seed& seed) {
    for (const char* ending : {".toml", ".sweep", ".csv", ".udp", ".recording", ".json", ".igtl"})
        if (seed.name.ends_with(ending)) return true;
    return false;
}

Fate try_input(const Seed& mutant) {
    try {
        return try_one(mutant) ? Fate::kRead : Fate::kRefused;
    } catch (const InputError& error) {
        TROCAR_ASSERT(std::string(error.what()).find('\n') == std::string::npos);
        return Fate::kRefused;
    }
}

}  // namespace trocar::mutate
