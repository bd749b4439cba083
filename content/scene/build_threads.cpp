#include "content/scene/build_threads.hpp"

#include <algorithm>
#include <cmath>

#include "content/scene/find_body.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {
namespace {

constexpr size_t kMostPoints = 10'000;

// Points along a line through `corners`, `spacing` apart or a little less. None if they are too many.
std::vector<Vec3d> points_along(const std::vector<Vec3d>& corners, double spacing) {
    double length = 0;
    for (size_t i = 1; i < corners.size(); ++i) length += (corners[i] - corners[i - 1]).norm();
    const auto pieces = std::max<size_t>(1, static_cast<size_t>(std::ceil(length / spacing - 1e-9)));
    if (pieces >= kMostPoints) return {};
    std::vector<Vec3d> points{corners.front()};
    double passed = 0;  // at corner i - 1
    size_t i = 1;
    for (size_t k = 1; k < pieces; ++k) {
        const double goal = length * static_cast<double>(k) / static_cast<double>(pieces);
        while (i + 1 < corners.size() && passed + (corners[i] - corners[i - 1]).norm() < goal)
            passed += (corners[i] - corners[i - 1]).norm(), ++i;
        const Vec3d way = corners[i] - corners[i - 1];
        points.push_back(corners[i - 1] + (goal - passed) / way.norm() * way);
    }
    points.push_back(corners.back());
    return points;
}

ThreadHold end_hold(uint32_t thread, uint32_t body, const Vec3d& point, const Vec3d& place, double stiffness) {
    ThreadHold hold;
    hold.thread = thread, hold.body = body, hold.point = point, hold.before = place, hold.stiffness = stiffness;
    return hold;
}

void add_thread(const SceneFile& scene, const ThreadSpec& spec, World& world) {
    const std::string where = "thread \"" + spec.thread.name + "\": ";
    ThreadState& state = world.thread_state;
    Thread thread = spec.thread;
    const auto index = static_cast<uint32_t>(world.threads.thread.size());
    std::vector<Vec3d> corners = spec.path;
    ThreadHold needle;
    if (!spec.tool.empty()) {
        const uint32_t body = find_body(scene, spec.line, world, spec.tool, where);
        thread.tool = find_of_body(world.haptics.tool, body);
        if (thread.tool == kNone) refuse(scene, spec.line, where + "no tool has the body \"" + spec.tool + "\"");
        const Vec3d end = spec.end_given ? spec.end : world.haptics.tool[thread.tool].tip;
        corners.push_back(frame_to_world(surfaces_of(world), body, end));
        needle = end_hold(index, body, end, corners.back(), spec.grip);
    }
    for (size_t i = 1; i < corners.size(); ++i)
        if (!((corners[i] - corners[i - 1]).norm() > 1e-9)) refuse(scene, spec.line, where + "two points of its path are one");
    const std::vector<Vec3d> points = points_along(corners, thread.spacing);
    if (points.empty()) refuse(scene, spec.line, where + "more than 10,000 points: spacing is too small");
    for (size_t i = 1; i < points.size(); ++i)
        if (!((points[i] - points[i - 1]).norm() > 0.01 * thread.spacing))
            refuse(scene, spec.line, where + "its path turns back on itself");
    thread.most_bites = spec.bites;
    // every bite and the pieces beside it take up to three points; what is drawn through bites has points 7/8 of the spacing apart
    const auto count = static_cast<uint32_t>(points.size());
    thread.rows = {static_cast<uint32_t>(state.position.size()), count + count / 7 + 1 + 3 * spec.bites + 2};
    const size_t rows = thread.rows.end();
    state.material.resize(rows, 0.0), state.position.resize(rows, Vec3d::Zero()), state.velocity.resize(rows, Vec3d::Zero());
    state.held.resize(rows, kNone), state.touching.resize(kTouchesPerPoint * rows, kNone);
    for (size_t i = 0; i < points.size(); ++i) {
        const size_t row = thread.rows.first + i;
        state.position[row] = points[i];
        state.material[row] = i == 0 ? 0 : state.material[row - 1] + (points[i] - points[i - 1]).norm();
    }
    if (spec.fixed) {
        state.held[thread.rows.first] = static_cast<uint32_t>(state.hold.size());
        state.hold.push_back(end_hold(index, kNone, points.front(), points.front(), spec.grip));
    }
    if (thread.tool != kNone) {
        state.held[thread.rows.first + points.size() - 1] = static_cast<uint32_t>(state.hold.size());
        state.hold.push_back(needle);
    }
    state.count.push_back(static_cast<uint32_t>(points.size()));
    state.progress.emplace_back();
    world.threads.thread.push_back(thread);
}

// What a needle sews, and with which thread.
void add_sewn(const SceneFile& scene, const ActionSpec& spec, uint32_t index, World& world) {
    const std::string where = "a suture: ";
    const uint32_t thread = find_index(world.threads.thread, [&](const Thread& t) { return t.name == spec.thread; });
    if (thread == kNone) refuse(scene, spec.line, where + "no thread is named \"" + spec.thread + "\"");
    ToolAction& action = world.actions.action[index];
    if (world.threads.thread[thread].tool != action.tool)
        refuse(scene, spec.line, where + "thread \"" + spec.thread + "\" does not hang on the tool of the action");
    for (const ThreadHold& hold : world.thread_state.hold)
        if (hold.thread == thread && hold.body != kNone) action.edge = hold.point;
    for (const std::string& name : spec.bodies) {
        const uint32_t body = find_body(scene, spec.line, world, name, where);
        if (!is_deformable(world.bodies, body)) refuse(scene, spec.line, where + "body \"" + name + "\" must be deformable");
        // a bite stays on the triangle that it was made in
        const bool cut = std::ranges::any_of(scene.tools, [&](const ToolSpec& tool) {
            return std::ranges::any_of(tool.actions, [&](const ActionSpec& other) {
                return other.action.kind == ActionKind::kCut && std::ranges::find(other.bodies, name) != other.bodies.end();
            });
        });
        if (cut || std::ranges::find(world.tears.body, body, &TearBody::body) != world.tears.body.end())
            refuse(scene, spec.line, where + "body \"" + name + "\" is cut or tears: it cannot be sewn");
        if (scene.bodies[body].scatter.rate > 0) refuse(scene, spec.line, where + "bodies that come and go cannot be sewn");
        // as of a staple: four times the springs of the tissue
        const double stiffness =
            spec.action.stiffness > 0 ? spec.action.stiffness : 4 * static_cast<double>(world.bodies.spring_stiffness[body]);
        const Surfaces surfaces = surfaces_of(world);
        const auto count = static_cast<uint32_t>(mesh_view(surfaces.meshes, surfaces.bodies.mesh[body]).position.size());
        world.threads.sewn.push_back({index, body, thread, stiffness, {static_cast<uint32_t>(world.thread_state.before.size()), count}});
        for (uint32_t v = 0; v < count; ++v)
            world.thread_state.before.push_back(frame_to_world(surfaces, body, vertex_in_frame(surfaces, body, v)));
    }
}

}  // namespace

void add_scene_threads(const SceneFile& scene, World& world) {
    uint32_t bites = 0;
    for (const ThreadSpec& spec : scene.threads) {
        if (std::ranges::count_if(scene.threads, [&](const ThreadSpec& other) { return other.thread.name == spec.thread.name; }) > 1)
            refuse(scene, spec.line, "two threads are named \"" + spec.thread.name + "\"");
        add_thread(scene, spec, world);
        bites += spec.bites;
    }
    uint32_t index = 0;
    for (const ToolSpec& tool : scene.tools)
        for (const ActionSpec& action : tool.actions) {
            if (action.action.kind == ActionKind::kSuture) add_sewn(scene, action, index, world);
            ++index;
        }
    if (scene.threads.empty()) return;
    constexpr uint32_t kHoles = 8;  // that a needle sticks in at once, per body
    world.threads.most_holes = static_cast<uint32_t>(world.threads.sewn.size()) * kHoles;
    // each hole holds the needle
    world.threads.most_holds = static_cast<uint32_t>(world.thread_state.hold.size()) + bites + world.threads.most_holes;
    world.thread_state.hold.reserve(world.threads.most_holds);
    world.thread_state.hole.reserve(world.threads.most_holes);
    world.thread_state.touch.reserve(world.thread_state.touching.size());
    world.thread_state.stable_dt.reserve(world.bodies.mesh.size());
}

}  // namespace trocar
