#include "content/scene/plausibility.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "content/scene/find_body.hpp"
#include "engine/base/format.hpp"
#include "engine/mesh/surfaces.hpp"
#include "engine/tissue/embedded_surface.hpp"
namespace trocar {
namespace {

constexpr double kSmallest = 1e-3, kLargest = 2;  // m
constexpr double kSoftest = 500;                  // Pa
constexpr double kFar = 0.3;                      // m, about the length of an instrument

Box world_box(const World& w, uint32_t body) {
    const Surfaces s = surfaces_of(w);
    Box box;
    for (uint32_t v = 0; v < w.meshes.info[w.bodies.mesh[body]].vertices.count; ++v) grow(box, vertex_position(s, body, v));
    return box;
}

void doubt_size(const BodySpec& spec, const World& w, uint32_t body, std::vector<std::string>& doubts) {
    const Box& box = w.meshes.info[w.bodies.mesh[body]].box;
    const double extent = (box.max - box.min).maxCoeff();
    if (spec.file.empty() || (extent >= kSmallest && extent <= kLargest)) return;
    doubts.push_back(format("body \"%s\" is %.3g m large: is the unit of \"%s\" right? scale is metres per unit of the file",
                            spec.name.c_str(), extent, spec.file.c_str()));
}

// Lowest and highest z (m, body frame) of the particles that fixed_below may fix: those of the surface, unless it is embedded, and
// the nodes inside.
std::array<double, 2> heights(const World& w, uint32_t body) {
    const uint32_t mesh = w.bodies.mesh[body];
    const MeshInfo& info = w.meshes.info[mesh];
    std::array<double, 2> z{INFINITY, -INFINITY};
    const auto take = [&](double at) { z = {std::min(z[0], at), std::max(z[1], at)}; };
    if (embedded_count(w.solids, mesh) == 0)
        for (uint32_t v = info.vertices.first; v < info.vertices.end(); ++v) take(w.meshes.position[v].z());
    if (!has_own_nodes(w.solids, mesh)) return z;
    const Range inner = w.solids.info[mesh].inner;
    for (uint32_t i = inner.first; i < inner.end(); ++i) take(w.solids.position[i].z());
    return z;
}

void doubt_fixed(const BodySpec& spec, const World& w, uint32_t body, std::vector<std::string>& doubts) {
    if (spec.fixed_below <= -1e300 || !is_deformable(w.bodies, body)) return;
    const auto [lowest, highest] = heights(w, body);
    if (spec.fixed_below <= lowest)
        doubts.push_back(format("body \"%s\": fixed_below = %g fixes nothing: its lowest point is at %.4g m in the body frame",
                                spec.name.c_str(), spec.fixed_below, lowest));
    if (spec.fixed_below > highest)
        doubts.push_back(format("body \"%s\": fixed_below = %g fixes all of it", spec.name.c_str(), spec.fixed_below));
}

// m, from a point to a box; 0 inside.
double distance(const Vec3d& p, const Box& box) { return (p - p.cwiseMax(box.min).cwiseMin(box.max)).norm(); }

void doubt_tool(const ToolSpec& tool, const World& w, const std::vector<Box>& boxes, std::vector<std::string>& doubts) {
    const uint32_t own = find_body(w, tool.body);
    if (tool.path.empty() || own == kNone || boxes.size() < 2) return;
    const double reach = kFar + w.meshes.info[w.bodies.mesh[own]].radius;
    double nearest = INFINITY;
    for (const Keyframe& key : tool.path)
        for (uint32_t b = 0; b < boxes.size(); ++b)
            if (b != own && w.bodies.motion[b] != Motion::kHand) nearest = std::min(nearest, distance(key.position, boxes[b]));
    if (std::isfinite(nearest) && nearest > reach)
        doubts.push_back(format("the tool \"%s\" stays %.3g m from everything", tool.body.c_str(), nearest));
}

}  // namespace

std::vector<std::string> find_doubts(const SceneFile& scene, const World& world) {
    std::vector<std::string> doubts;
    if (world.bodies.mesh.empty()) doubts.push_back("the scene has no [[body]]");
    for (uint32_t body = 0; body < scene.bodies.size(); ++body) {
        const BodySpec& spec = scene.bodies[body];
        if (spec.copy > 0) continue;
        doubt_size(spec, world, body, doubts);
        doubt_fixed(spec, world, body, doubts);
        if (spec.motion == Motion::kDeformable && spec.tissue.youngs_modulus < kSoftest)
            doubts.push_back(
                format("body \"%s\": youngs_modulus = %g Pa is softer than any organ", spec.name.c_str(), spec.tissue.youngs_modulus));
    }
    if (scene.tools.empty()) return doubts;
    std::vector<Box> boxes;
    for (uint32_t body = 0; body < world.bodies.mesh.size(); ++body) boxes.push_back(world_box(world, body));
    if (scene.nodes.empty())
        for (const ToolSpec& tool : scene.tools) doubt_tool(tool, world, boxes, doubts);
    return doubts;
}

}  // namespace trocar
