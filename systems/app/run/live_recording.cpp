#include "systems/app/run/live_recording.hpp"

#include <bit>
#include <cstring>
#include <span>
#include <string>

#include "engine/base/error.hpp"
#include "engine/files/state_hash.hpp"
#include "engine/files/text_file.hpp"
#include "engine/files/whole_file.hpp"
namespace trocar {
namespace {

constexpr char kMagic[] = "trocarLR";
constexpr uint64_t kVersion = 5;
constexpr size_t kHeaderWords = 7, kTickWords = 23;

// Shared by reading and writing: the visitor is called with every field of a tick in order.
template <typename Tick, typename Visitor>
void visit_tick(Tick& t, Visitor& visit) {
    visit(t.tick), visit(t.time), visit(t.tool), visit(t.model_sequence), visit(t.sample.time);
    for (int i = 0; i < 3; ++i) visit(t.sample.position[i]);
    visit(t.sample.orientation.w), visit(t.sample.orientation.x), visit(t.sample.orientation.y);
    visit(t.sample.orientation.z);
    for (int i = 0; i < 3; ++i) visit(t.sample.velocity[i]);
    visit(t.sample.buttons), visit(t.sample.grip);
    for (int i = 0; i < 3; ++i) visit(t.force[i]);
    for (int i = 0; i < 3; ++i) visit(t.torque[i]);
}

struct WordWriter {
    std::vector<uint64_t>& words;
    void operator()(double value) { words.push_back(std::bit_cast<uint64_t>(value)); }
    void operator()(uint64_t value) { words.push_back(value); }
    void operator()(uint32_t value) { words.push_back(value); }
};

struct WordReader {
    std::span<const uint64_t> words;
    size_t next = 0;
    void operator()(double& value) { value = std::bit_cast<double>(words[next++]); }
    void operator()(uint64_t& value) { value = words[next++]; }
    void operator()(uint32_t& value) { value = static_cast<uint32_t>(words[next++]); }
};

uint64_t hash_of(std::span<const uint64_t> words) {
    StateHash hash;
    for (const uint64_t word : words) hash.add_word(word);
    return hash.value;
}

// Number of words in a recording with these counts, with its hash; 0 if more than `available`.
size_t words_wanted(uint64_t tools, uint64_t passes, uint64_t ticks, size_t available) {
    if (tools > kMaxTools || passes > available || ticks > available) return 0;
    return kHeaderWords + passes * (1 + tools) + ticks * kTickWords + 1;
}

}  // namespace

uint64_t scene_hash(const World& world) {
    StateHash hash;
    for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r)
        if (resource_kind(static_cast<Resource>(r)) == ResourceKind::kConstant)
            hash.add_word(resource_hash(world, static_cast<Resource>(r)));
    hash.add_word(state_hash(world));
    return hash.value;
}

void write_live_recording(const std::filesystem::path& path, const LiveRecording& r) {
    std::vector<uint64_t> words;
    words.reserve(kHeaderWords + r.slip.size() * (1 + r.tools) + r.tick.size() * kTickWords + 1);
    uint64_t magic;
    std::memcpy(&magic, kMagic, sizeof magic);
    WordWriter write{words};
    for (const uint64_t word :
         {magic, kVersion, uint64_t{r.tools}, uint64_t{r.slip.size()}, uint64_t{r.tick.size()}, r.start_hash, r.state_hash})
        write(word);
    for (size_t pass = 0; pass < r.slip.size(); ++pass) {
        write(r.slip[pass]);
        for (uint32_t t = 0; t < r.tools; ++t) write(r.taken[pass * r.tools + t]);
    }
    for (const LiveTick& tick : r.tick) visit_tick(tick, write);
    write(hash_of(words));
    write_whole_file(path, std::as_bytes(std::span<const uint64_t>(words)));
}

LiveRecording read_live_recording(const std::filesystem::path& path) {
    const auto fail = [&](const std::string& reason) { throw InputError(path.string() + ": " + reason); };
    const std::string bytes = read_file_bytes(path);
    if (bytes.size() < sizeof(uint64_t) || bytes.compare(0, sizeof(uint64_t), kMagic) != 0) fail("is not a recording of a live run");
    std::vector<uint64_t> words(bytes.size() / sizeof(uint64_t));
    std::memcpy(words.data(), bytes.data(), words.size() * sizeof(uint64_t));
    if (words.size() < kHeaderWords) fail("recording is cut short inside its header");
    if (words[1] != kVersion)
        fail("recording of version " + std::to_string(words[1]) + "; this program reads version " + std::to_string(kVersion));
    const uint64_t tools = words[2], passes = words[3], ticks = words[4];
    const size_t wanted = words_wanted(tools, passes, ticks, bytes.size());
    if (wanted == 0 || bytes.size() < wanted * sizeof(uint64_t))
        fail("recording of " + std::to_string(passes) + " contact passes and " + std::to_string(ticks) +
             " haptic ticks is cut short after " + describe_bytes(bytes.size()));
    if (bytes.size() != wanted * sizeof(uint64_t)) fail("recording is followed by something else");
    if (hash_of(std::span<const uint64_t>(words).first(wanted - 1)) != words.back())
        fail("recording is damaged: its checksum does not match");
    LiveRecording r;
    r.tools = static_cast<uint32_t>(tools);
    r.start_hash = words[5];
    r.state_hash = words[6];
    r.slip.resize(passes);
    r.taken.resize(passes * tools);
    r.tick.resize(ticks);
    WordReader read{words, kHeaderWords};
    for (size_t pass = 0; pass < passes; ++pass) {
        read(r.slip[pass]);
        for (uint32_t t = 0; t < tools; ++t) read(r.taken[pass * tools + t]);
    }
    for (LiveTick& tick : r.tick) {
        visit_tick(tick, read);
        if (tick.tool >= tools) fail("recording is inconsistent: a tick of a tool that does not exist");
    }
    return r;
}

}  // namespace trocar
