#include "systems/app/run/recorded_exercise.hpp"

#include <cmath>

#include "systems/app/run/live_recording.hpp"
#include "systems/app/station/exercise_file.hpp"
namespace trocar {

Exercise read_recorded_exercise(const std::filesystem::path& file) {
    const LiveRecording r = read_live_recording(file);
    Exercise e;
    e.source = file.string(), e.has_organs = e.has_tissue = false, e.live = true, e.rate = 1000;
    for (uint32_t t = 0; t < r.tools; ++t) e.tool.push_back("tool " + std::to_string(t));
    std::vector<double> last(r.tools, -INFINITY);
    for (const LiveTick& tick : r.tick) {
        const DeviceState& d = tick.sample;
        if (!(tick.time > last[tick.tool]) || !d.position.allFinite()) continue;
        last[tick.tool] = tick.time;
        ExerciseSample s;
        s.time = tick.time, s.tool = tick.tool, s.tip = s.proxy = d.position, s.turn = d.orientation, s.grip = d.grip,
        s.buttons = d.buttons;
        s.hand = tick.force, s.torque = tick.torque, s.hand_peak = tick.force.norm();
        s.contacts = s.hand_peak > 0;
        e.sample.push_back(s);
    }
    add_touches(e);
    return e;
}

}  // namespace trocar
