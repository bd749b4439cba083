#include "systems/app/interface/tool_motion.hpp"

#include "engine/devices/device.hpp"
#include "engine/geometry/quaternion.hpp"
namespace trocar {
namespace {

// The numbers of a device state but its time.
template <typename State, typename Visit>
void each_number_of(State& s, const Visit& visit) {
    for (int k = 0; k < 3; ++k) visit(s.position[k]);
    visit(s.orientation.w), visit(s.orientation.x), visit(s.orientation.y), visit(s.orientation.z);
    for (int k = 0; k < 3; ++k) visit(s.velocity[k]);
    visit(s.grip);
}

}  // namespace

DeviceState pose_at(const ToolMotion& m, uint64_t tick) {
    DeviceState pose = m.to;
    pose.time = static_cast<double>(tick) * 1e-3;
    pose.velocity = Vec3d::Zero();
    if (tick >= m.end) return pose;
    const double span = static_cast<double>(m.end - m.begin), share = static_cast<double>(tick - m.begin) / span;
    pose.position = m.from.position + share * (m.to.position - m.from.position);
    pose.velocity = (m.to.position - m.from.position) / (1e-3 * span);
    const Vec3d turn = rotation_vector(m.from.orientation, m.to.orientation);
    pose.orientation = normalized(multiply(from_rotation_vector(share * turn), m.from.orientation));
    pose.grip = m.from.grip + share * (m.to.grip - m.from.grip);
    return pose;
}

DeviceState hand_at(const ToolMotion& m, uint32_t tool, uint64_t tick, World& w) {
    if (m.on) return pose_at(m, tick);
    w.haptics.tool[tool].trace = m.script;
    return read_device(device_of(w.haptics, w.paths, w.haptics.tool[tool]), static_cast<double>(tick) * 1e-3);
}

void write_traces(std::span<ToolMotion> motions, bool keep, World& w) {
    const uint64_t begin = w.clock.tick, end = pass_tick(w.clock.pass + 1, w.clock.contact_rate);
    for (size_t t = 0; t < motions.size(); ++t) {
        ToolMotion& m = motions[t];
        HandTool& tool = w.haptics.tool[t];
        if (!m.on && (!keep || m.script != kNone)) {
            tool.trace = m.script;
            continue;
        }
        if (m.trace == kNone) {
            m.trace = static_cast<uint32_t>(w.haptics.trace.size());
            w.haptics.trace.emplace_back();
        }
        tool.trace = kNone;
        const Device script = m.on ? Device{} : device_of(w.haptics, w.paths, tool);
        tool.trace = m.trace;
        std::vector<DeviceState>& samples = w.haptics.trace[m.trace].sample;
        if (!keep) samples.clear();
        if (!samples.empty()) samples.pop_back();  // the end of the pass before is the start of this one
        for (uint64_t tick = begin; tick <= end; ++tick)
            samples.push_back(m.on ? pose_at(m, tick) : read_device(script, static_cast<double>(tick) * 1e-3));
    }
}

MotionNumbers to_numbers(const ToolMotion& m) {
    MotionNumbers numbers{};
    size_t at = 0;
    const auto put = [&](double v) { numbers[at++] = v; };
    put(m.on), put(static_cast<double>(m.begin)), put(static_cast<double>(m.end));
    for (const DeviceState* s : {&m.from, &m.to}) put(s->time), put(s->buttons), each_number_of(*s, put);
    return numbers;
}

void from_numbers(const MotionNumbers& numbers, ToolMotion& m) {
    size_t at = 0;
    const auto next = [&] { return numbers[at++]; };
    m.on = next() != 0;
    m.begin = static_cast<uint64_t>(next()), m.end = static_cast<uint64_t>(next());
    for (DeviceState* s : {&m.from, &m.to}) {
        s->time = next(), s->buttons = static_cast<uint32_t>(next());
        each_number_of(*s, [&](double& v) { v = next(); });
    }
}

}  // namespace trocar
