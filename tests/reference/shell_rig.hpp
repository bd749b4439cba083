#pragma once
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "engine/geometry/quaternion.hpp"
#include "engine/haptics/point_shell.hpp"
#include "systems/haptics/contact/point_shell_contact.hpp"
#include "tests/reference/brute_force_distance.hpp"
#include "tests/reference/local_patches.hpp"
namespace trocar::reference {

// A model of a whole surface at rest, with adjacency of its triangles.
inline LocalContactModel make_joined_patch(const Mesh& mesh, double half_thickness = 0) {
    LocalContactModel model = make_patch(mesh, half_thickness);
    std::map<std::pair<uint32_t, uint32_t>, std::pair<uint32_t, uint32_t>> half_edge;
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t)
        for (uint32_t k = 0; k < 3; ++k) half_edge[{mesh.triangle[t][k], mesh.triangle[t][(k + 1) % 3]}] = {t, k};
    for (const auto& [edge, at] : half_edge) {
        const auto other = half_edge.find({edge.second, edge.first});
        if (other != half_edge.end()) model.neighbour[at.first][at.second] = other->second.first;
    }
    return model;
}

// An instrument with a point shell and a surface, ticked by the test. No friction or limits except those a
// test sets.
struct ShellRig {
    HapticParams params;
    LocalContactModel model;
    HandTool tool;
    PointShellScratch scratch;
    LocalContactScratch publishing;
    ToolState state;
    uint64_t tick = 0;

    ShellRig(LocalContactModel surface, std::vector<ShellPoint> point_shell) : model(std::move(surface)) {
        params.model_timeout = params.device_timeout = 1e9;
        model.reach = 0.04;
        tool.point_shell = std::move(point_shell);
        tool.shell_radius = trocar::shell_radius(tool.point_shell);
        tool.coupling_stiffness = 500;
        tool.turn_stiffness = 1;
        tool.surface_stiffness = 5e4;
        tool.friction = 0;
        tool.max_force = 1e9;
    }
    double time() const { return static_cast<double>(tick) * 1e-3; }
    // publishes the surface again, as a contact pass would
    void publish(bool moved = false) {
        ++model.sequence;
        if (moved) model.time = time();
        model.reach = 0.04;
        group_triangles(model);
        publish_point_shell_cache(params, tool, state, publishing, model);
    }
    Vec3d at(const Vec3d& position, const Quat& turn = {}) {
        DeviceState sample;
        sample.time = time();
        sample.position = position;
        sample.orientation = turn;
        return with(sample);
    }
    Vec3d with(const DeviceState& sample) {
        if (!state.device_valid) state.device = sample;
        if (tick % 16 == 0) publish();
        point_shell_tick(params, model, time(), tool, sample, scratch, state);
        ++tick;
        return state.command.force;
    }
    // moves straight to a pose
    Vec3d go(const Vec3d& target, const Quat& turn, uint32_t ticks) {
        const Vec3d begin = state.device.position;
        const Quat from = state.device.orientation;
        const Vec3d about = rotation_vector(from, turn);
        for (uint32_t k = 1; k <= ticks; ++k) {
            const double share = double(k) / ticks;
            at(begin + share * (target - begin), multiply(from_rotation_vector(share * about), from));
        }
        return state.command.force;
    }
    Vec3d go(const Vec3d& target, uint32_t ticks) { return go(target, state.device.orientation, ticks); }
    Vec3d rest(uint32_t ticks) {
        for (uint32_t k = 0; k < ticks; ++k) at(state.device.position, state.device.orientation);
        return state.command.force;
    }
};

// Energy (J) of coupling and surface springs with the instrument at a pose, with brute-force distances to a
// closed surface. A shell at rest must be at its minimum.
inline double shell_energy(const ShellRig& rig, const Vec3d& tip, const Quat& turn) {
    const HandTool& tool = rig.tool;
    double energy = 0.5 * tool.coupling_stiffness * (rig.state.device.position - tip).squaredNorm() +
                    0.5 * tool.turn_stiffness * rotation_vector(turn, rig.state.device.orientation).squaredNorm();
    for (const ShellPoint& p : tool.point_shell) {
        const Vec3d at = tip + rotate(turn, p.arm);
        if (brute_force_winding(rig.model.position, rig.model.triangle, at) < 0.5) continue;
        const double d = brute_force_distance(rig.model.position, rig.model.triangle, at).distance;
        energy += 0.5 * tool.surface_stiffness * d * d;
    }
    return energy;
}

}  // namespace trocar::reference
