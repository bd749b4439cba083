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
constexpr uint64_t kVersion = 6, kWithoutCommands = 5;
constexpr size_t kOldHeaderWords = 7, kHeaderWords = 9, kTickWords = 23;
constexpr uint64_t kLockstepFlag = 1, kViewedFlag = 2;

// Shared by reading and writing: the visitor is called with every field in order, each one word of the file.
template <typename Recording, typename Visit>
void visit_passes(Recording& r, const Visit& visit) {
    for (size_t pass = 0; pass < r.slip.size(); ++pass) {
        visit(r.slip[pass]);
        for (uint32_t t = 0; t < r.tools; ++t) visit(r.taken[pass * r.tools + t]);
    }
    for (auto& t : r.tick) {
        visit(t.tick), visit(t.time), visit(t.tool), visit(t.model_sequence), visit(t.sample.time);
        for (int i = 0; i < 3; ++i) visit(t.sample.position[i]);
        visit(t.sample.orientation.w), visit(t.sample.orientation.x), visit(t.sample.orientation.y), visit(t.sample.orientation.z);
        for (int i = 0; i < 3; ++i) visit(t.sample.velocity[i]);
        visit(t.sample.buttons), visit(t.sample.grip);
        for (int i = 0; i < 3; ++i) visit(t.force[i]);
        for (int i = 0; i < 3; ++i) visit(t.torque[i]);
    }
}

uint64_t hash_of(std::span<const uint64_t> words) {
    StateHash hash;
    for (const uint64_t word : words) hash.add_word(word);
    return hash.value;
}

// Number of words in a recording with these counts, with its hash; 0 if more than `available`.
size_t words_wanted(size_t header, uint64_t tools, uint64_t passes, uint64_t ticks, uint64_t commands, size_t available) {
    if (tools > kMaxTools || passes > available || ticks > available || commands > available) return 0;
    return header + passes * (1 + tools) + ticks * kTickWords + commands + 1;
}

std::vector<uint64_t> words_of(const std::vector<ViewCommand>& commands) {
    std::string text;
    for (const ViewCommand& command : commands) text += text_of(command) + '\n';
    text.resize((text.size() + sizeof(uint64_t) - 1) / sizeof(uint64_t) * sizeof(uint64_t), ' ');
    std::vector<uint64_t> words(text.size() / sizeof(uint64_t));
    if (!words.empty()) std::memcpy(words.data(), text.data(), text.size());
    return words;
}

// Throws InputError.
std::vector<ViewCommand> commands_of(std::span<const uint64_t> words) {
    const std::string text(reinterpret_cast<const char*>(words.data()), words.size_bytes());
    std::vector<ViewCommand> commands;
    for (size_t at = 0, end = 0; (end = text.find('\n', at)) != std::string::npos; at = end + 1) {
        commands.push_back(read_view_command(text.substr(at, end - at)));
        if (commands.size() > 1 && commands.back().pass < commands[commands.size() - 2].pass)
            throw InputError("a command before an earlier one");
    }
    return commands;
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
    uint64_t magic;
    std::memcpy(&magic, kMagic, sizeof magic);
    const std::vector<uint64_t> commands = words_of(r.command);
    const uint64_t flags = (r.lockstep ? kLockstepFlag : 0) | (r.viewed ? kViewedFlag : 0);
    std::vector<uint64_t> words = {magic,        kVersion,     r.tools, r.slip.size(),  r.tick.size(),
                                   r.start_hash, r.state_hash, flags,   commands.size()};
    visit_passes(r, [&](auto value) {
        if constexpr (std::is_floating_point_v<decltype(value)>)
            words.push_back(std::bit_cast<uint64_t>(value));
        else
            words.push_back(value);
    });
    words.insert(words.end(), commands.begin(), commands.end());
    words.push_back(hash_of(words));
    write_whole_file(path, std::as_bytes(std::span<const uint64_t>(words)));
}

LiveRecording read_live_recording(const std::filesystem::path& path) {
    const auto fail = [&](const std::string& reason) { throw InputError(path.string() + ": " + reason); };
    const std::string bytes = read_file_bytes(path);
    if (bytes.size() < sizeof(uint64_t) || bytes.compare(0, sizeof(uint64_t), kMagic) != 0) fail("is not a recording of a live run");
    std::vector<uint64_t> words(bytes.size() / sizeof(uint64_t));
    std::memcpy(words.data(), bytes.data(), words.size() * sizeof(uint64_t));
    if (words.size() < kOldHeaderWords) fail("recording is cut short inside its header");
    if (words[1] != kVersion && words[1] != kWithoutCommands)
        fail("recording of version " + std::to_string(words[1]) + "; this program reads versions " + std::to_string(kWithoutCommands) +
             " and " + std::to_string(kVersion));
    const bool old = words[1] == kWithoutCommands;
    const size_t header = old ? kOldHeaderWords : kHeaderWords;
    if (words.size() < header) fail("recording is cut short inside its header");
    const uint64_t flags = old ? 0 : words[7], commands = old ? 0 : words[8];
    const uint64_t tools = words[2], passes = words[3], ticks = words[4];
    const size_t wanted = words_wanted(header, tools, passes, ticks, commands, bytes.size());
    if (wanted == 0 || bytes.size() < wanted * sizeof(uint64_t))
        fail("recording of " + std::to_string(passes) + " contact passes and " + std::to_string(ticks) +
             " haptic ticks is cut short after " + describe_bytes(bytes.size()));
    if (bytes.size() != wanted * sizeof(uint64_t)) fail("recording is followed by something else");
    if (hash_of(std::span<const uint64_t>(words).first(wanted - 1)) != words.back())
        fail("recording is damaged: its checksum does not match");
    LiveRecording r;
    r.tools = static_cast<uint32_t>(tools);
    r.lockstep = (flags & kLockstepFlag) != 0, r.viewed = (flags & kViewedFlag) != 0;
    r.start_hash = words[5];
    r.state_hash = words[6];
    r.slip.resize(passes);
    r.taken.resize(passes * tools);
    r.tick.resize(ticks);
    size_t next = header;
    visit_passes(r, [&](auto& value) {
        if constexpr (std::is_floating_point_v<std::remove_reference_t<decltype(value)>>)
            value = std::bit_cast<double>(words[next++]);
        else
            value = static_cast<std::remove_reference_t<decltype(value)>>(words[next++]);
    });
    try {
        r.command = commands_of(std::span<const uint64_t>(words).subspan(next, commands));
    } catch (const InputError& error) {
        fail(std::string("recording is inconsistent: ") + error.what());
    }
    if ((flags & ~(kLockstepFlag | kViewedFlag)) != 0 || (r.lockstep && (tools > 0 || ticks > 0)) || (!r.viewed && !r.command.empty()))
        fail("recording is inconsistent: its flags do not fit what it holds");
    for (const LiveTick& tick : r.tick)
        if (tick.tool >= tools) fail("recording is inconsistent: a tick of a tool that does not exist");
    return r;
}

}  // namespace trocar
