#include "engine/devices/device.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>
#include <string_view>

#include "engine/base/check.hpp"
#include "engine/base/error.hpp"
#include "engine/files/text_file.hpp"
#include "engine/files/whole_file.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/motion/keyframe_path.hpp"
namespace trocar {
namespace {

constexpr std::string_view kHeader = "time,x,y,z,qw,qx,qy,qz,vx,vy,vz,buttons", kGrip = ",grip";
constexpr size_t kColumns = 12, kMostColumns = 13;

DeviceState read_scripted(const Device& device, double time) {
    const PathPoint point = sample_path(device.path, time);
    DeviceState state;
    state.time = time;
    state.position = point.position;
    state.orientation = point.orientation;
    state.velocity = point.velocity;
    state.grip = point.grip;
    if (device.tremor.amplitude > 0) {
        // three incommensurable frequencies, so that the path does not repeat
        constexpr double kDetune[3] = {1.0, 0.8793852415718169, 1.1371580426032577};
        for (int axis = 0; axis < 3; ++axis) {
            const double rate = 2 * std::numbers::pi * device.tremor.frequency * kDetune[axis];
            state.position[axis] += device.tremor.amplitude * std::sin(rate * time);
            state.velocity[axis] += device.tremor.amplitude * rate * std::cos(rate * time);
        }
    }
    return state;
}

DeviceState read_recorded(const Device& device, double time) {
    const auto after =
        std::upper_bound(device.trace.begin(), device.trace.end(), time, [](double t, const DeviceState& s) { return t < s.time; });
    return after == device.trace.begin() ? device.trace.front() : *(after - 1);
}

// one line of a recording with its position in the file
struct TraceLine {
    const std::filesystem::path& path;
    size_t number;
    std::string_view text;

    [[noreturn]] void fail(size_t column, const std::string& reason) const {
        throw InputError(path.string() + ":" + std::to_string(number) + ":" + std::to_string(column + 1) + ": " + reason);
    }
};

template <typename Number>
Number read_number(const TraceLine& line, size_t first, size_t end) {
    Number value{};
    const char* const begin = line.text.data() + first;
    const auto [stop, error] = std::from_chars(begin, line.text.data() + end, value);
    if (error != std::errc() || stop != line.text.data() + end)
        line.fail(first, '"' + std::string(line.text.substr(first, std::min<size_t>(end - first, 40))) + "\" is not a number in range");
    if constexpr (std::is_floating_point_v<Number>)
        if (!std::isfinite(value)) line.fail(first, "number is not finite");
    return value;
}

DeviceState read_sample(const TraceLine& line, size_t columns) {
    std::array<double, kMostColumns> value{};
    DeviceState state;
    size_t first = 0;
    for (size_t column = 0; column < columns; ++column) {
        const size_t comma = line.text.find(',', first);
        const bool last = column + 1 == columns;
        if (!last && comma == std::string_view::npos)
            line.fail(line.text.size(), "expected " + std::to_string(columns) + " numbers, found " + std::to_string(column + 1));
        if (last && comma != std::string_view::npos) line.fail(comma, "more than " + std::to_string(columns) + " numbers");
        const size_t end = last ? line.text.size() : comma;
        if (column == kColumns - 1)
            state.buttons = read_number<uint32_t>(line, first, end);
        else
            value[column] = read_number<double>(line, first, end);
        first = end + 1;
    }
    state.time = value[0];
    state.position = {value[1], value[2], value[3]};
    state.orientation = {value[4], value[5], value[6], value[7]};
    state.velocity = {value[8], value[9], value[10]};
    state.grip = value[kColumns];
    const Quat& q = state.orientation;
    const double length2 = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z;
    if (!(std::abs(length2 - 1) < 1e-6)) line.fail(0, "orientation is not a unit quaternion");
    if (std::abs(length2 - 1) > 1e-12) state.orientation = normalized(q);  // unit quaternions keep their recorded bits
    return state;
}

// shortest digits that read back to the same bits (at most 17)
void append_number(std::string& text, double value) {
    char digits[32];
    const auto [end, error] = std::to_chars(digits, digits + sizeof digits, value);
    TROCAR_ASSERT(error == std::errc());
    text.append(digits, end);
    text += ',';
}

}  // namespace

Device device_of(const Haptics& haptics, const Paths& paths, const HandTool& tool) {
    Device device;
    if (tool.trace != kNone) {
        device.trace = haptics.trace[tool.trace].sample;
    } else {
        const Range keys = paths.keys[tool.path];
        device.path = std::span(paths.key).subspan(keys.first, keys.count);
        device.tremor = {tool.hand.tremor, tool.hand.tremor_rate};
    }
    return device;
}

std::span<const HapticEffect> effects_of(const Haptics& haptics, const HandTool& tool) {
    return std::span(haptics.effect).subspan(tool.effects.first, tool.effects.count);
}

DeviceState read_device(const Device& device, double time) {
    return device.trace.empty() ? read_scripted(device, time) : read_recorded(device, time);
}

DeviceTrace read_device_trace(const std::filesystem::path& path) {
    const std::string text = read_text_file(path);
    DeviceTrace trace;
    size_t number = 0;
    bool with_grip = false;
    for (size_t first = 0; first < text.size();) {
        const size_t end = std::min(text.find('\n', first), text.size());
        TraceLine line{path, ++number, std::string_view(text).substr(first, end - first)};
        if (line.text.ends_with('\r')) line.text.remove_suffix(1);
        first = end + 1;
        if (number == 1) {
            with_grip = line.text.starts_with(kHeader) && line.text.substr(kHeader.size()) == kGrip;
            if (line.text != kHeader && !with_grip) line.fail(0, "expected the header \"" + std::string(kHeader) + "\"");
            continue;
        }
        if (line.text.empty()) continue;
        trace.sample.push_back(read_sample(line, with_grip ? kMostColumns : kColumns));
        const size_t rows = trace.sample.size();
        if (rows > 1 && !(trace.sample[rows - 1].time > trace.sample[rows - 2].time)) line.fail(0, "time does not ascend");
    }
    if (trace.sample.empty()) throw InputError(path.string() + ": recording holds no sample");
    return trace;
}

void write_device_trace(const std::filesystem::path& path, std::span<const DeviceState> samples) {
    // an empty column is omitted
    const bool with_grip = std::any_of(samples.begin(), samples.end(), [](const DeviceState& s) { return s.grip != 0; });
    std::string text(kHeader);
    if (with_grip) text += kGrip;
    text += '\n';
    for (const DeviceState& s : samples) {
        const Quat& q = s.orientation;
        for (const double value :
             {s.time, s.position.x(), s.position.y(), s.position.z(), q.w, q.x, q.y, q.z, s.velocity.x(), s.velocity.y(), s.velocity.z()})
            append_number(text, value);
        text += std::to_string(s.buttons);
        if (with_grip) {
            text += ',';
            append_number(text, s.grip);
            text.pop_back();  // the comma behind a number
        }
        text += '\n';
    }
    write_whole_file(path, text);
}

}  // namespace trocar
