#include "systems/app/study/curve.hpp"

#include <algorithm>
#include <cmath>
#include <mutex>

#include "content/scene/build_scene.hpp"
#include "content/scene/find_body.hpp"
#include "engine/base/error.hpp"
#include "engine/base/format.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "systems/app/report/tool_record.hpp"
#include "systems/app/station/exercise_file.hpp"
#include "systems/frame/frame.hpp"
namespace trocar {
namespace {

// m, how deep a ball is below the nearest surface of the bodies as they are, but the tool's and those that hands hold.
double depth_of(const World& w, const Vec3d& centre, double radius) {
    const Surfaces s = surfaces_of(w);
    double nearest = INFINITY;
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b)
        if (w.bodies.motion[b] != Motion::kHand)
            nearest = std::min(nearest, w.trees[w.bodies.tree[b]]->query(world_to_frame(s, b, centre)).distance);
    return radius - nearest;
}

World build_world(const SceneFile& scene) {
    static std::mutex mutex;  // worlds are built one after the other, and step side by side
    const std::lock_guard lock(mutex);
    return build_scene(scene, Looks::kPlain).world;
}

uint32_t tool_of(const SceneFile& scene, const World& w, const std::string& name) {
    for (uint32_t t = 0; t < w.haptics.tool.size(); ++t)
        if (name.empty() || w.bodies.name[w.haptics.tool[t].body] == name) return t;
    throw InputError(scene.path.string() + (name.empty() ? ": has no [[tool]]" : ": no tool holds a body \"" + name + "\""));
}

}  // namespace

ForceCurve read_curve(const std::filesystem::path& file) {
    const CsvTable t = read_csv(file);
    const size_t none = t.column.size(), force = t.find("force_n"), time = t.find("time_s"), depth = t.find("depth_m");
    if (force == none || (time == none) == (depth == none))
        throw InputError(t.file + ":1: a curve has the column force_n and one of time_s and depth_m");
    ForceCurve curve;
    curve.by_depth = depth != none;
    for (size_t r = 0; r < t.row.size(); ++r) {
        curve.at.push_back(t.number(r, curve.by_depth ? depth : time));
        curve.force.push_back(t.number(r, force));
        if (r > 0 && !(curve.at[r] > curve.at[r - 1]))
            throw InputError(t.file + ":" + std::to_string(r + 2) + ": " + t.column[curve.by_depth ? depth : time] + " must ascend");
    }
    if (curve.at.size() < 2) throw InputError(t.file + ": a curve has two points or more");
    return curve;
}

ForceCurve simulate_curve(const SceneFile& scene, const std::string& tool, bool by_depth, double seconds) {
    const FloatModeScope ours;
    FrameOptions options;
    options.pictures = options.account_energy = false;
    Frame frame(build_world(scene), options);
    const uint32_t t = tool_of(scene, frame.world(), tool);
    const HandTool& hand = frame.world().haptics.tool[t];
    const auto is_held = [&](const ToolSpec& spec) { return spec.body == frame.world().bodies.name[hand.body]; };
    const auto spec = std::ranges::find_if(scene.tools, is_held);
    if (by_depth && spec != scene.tools.end() && spec->dof != 3)
        throw InputError(scene.path.string() + ": a curve over depth needs a tool with dof = 3, whose tip is a ball; give one over time");
    std::vector<ToolSample> samples, all;
    while (1e-3 * static_cast<double>(frame.world().clock.tick) < seconds - 1e-9) {
        frame.step();
        samples.clear();
        record_tools(frame, samples);
        all.push_back(samples[t]);
    }
    // surfaces at rest: the tool goes where its path says, whatever it meets
    const World rest = by_depth ? build_world(scene) : World{};
    ForceCurve curve;
    curve.by_depth = by_depth;
    for (size_t i = 1; i < all.size(); ++i) {
        const double at =
            by_depth ? depth_of(rest, 0.5 * (all[i - 1].device + all[i].device), hand.tip_radius) : 0.5 * (all[i - 1].time + all[i].time);
        if (!curve.at.empty() && !(at > curve.at.back())) continue;
        curve.at.push_back(at);
        curve.force.push_back(all[i].tissue.norm());
    }
    return curve;
}

std::vector<double> force_at(const ForceCurve& simulated, const std::vector<double>& at) {
    std::vector<double> force;
    const std::vector<double>& x = simulated.at;
    for (const double a : at) {
        const auto above = std::ranges::lower_bound(x, a);
        const bool inside = above != x.end() && (above != x.begin() || *above == a);
        if (!inside)
            throw InputError(x.empty() ? std::string("the run gave no curve")
                                       : format("the run reaches %s from %.4g to %.4g, but the curve has a point at %.4g",
                                                simulated.by_depth ? "depths (m)" : "times (s)", x.front(), x.back(), a));
        const auto i = static_cast<size_t>(above - x.begin());
        const double share = *above == a ? 1 : (a - x[i - 1]) / (x[i] - x[i - 1]);
        force.push_back(share == 1 ? simulated.force[i] : (1 - share) * simulated.force[i - 1] + share * simulated.force[i]);
    }
    return force;
}

}  // namespace trocar
