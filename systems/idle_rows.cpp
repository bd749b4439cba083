#include "systems/idle_rows.hpp"

#include <algorithm>
#include <limits>

#include "engine/contact_rows.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/parallel.hpp"
#include "engine/reach.hpp"
namespace trocar {
namespace {

constexpr double kAnyWay = std::numeric_limits<double>::infinity();
constexpr uint32_t kRowsPerChunk = 512;

Vec3d velocity_of(const Surfaces& s, uint32_t body, uint32_t vertex) {
    const uint32_t i = s.bodies.particles[body].first + vertex;
    return {s.particles.velocity_x[i], s.particles.velocity_y[i], s.particles.velocity_z[i]};
}

// Whether a row of something that deforms, with nothing else but what stands still, may act.
bool may_act(const ComingPeriod& coming, const ContactRows& rows, uint32_t row) {
    constexpr double kTurning = 0.25;  // of a speed, that may turn towards the plane
    const Surfaces& s = coming.surfaces;
    const Bodies& bodies = s.bodies;
    const uint32_t body = rows.body[row], other = rows.other[row];
    const double period = coming.seconds;
    const double near = fall_in_period(coming.gravity, period) + reach_at_rest(s, body) + reach_at_rest(s, other);
    if (rows.distance[row] < near) return true;
    Vec3d v = Vec3d::Zero();
    if (is_deformable(bodies, body)) {
        const double along = rows.along[row], across = rows.across[row];
        v += (1 - along - across) * velocity_of(s, body, rows.vertex[row][0]) + along * velocity_of(s, body, rows.vertex[row][1]);
        if (rows.third[row] != kNone) v += across * velocity_of(s, body, rows.third[row]);
    }
    if (is_deformable(bodies, other))
        for (int k = 0; k < 3; ++k) v -= rows.weight[row][k] * velocity_of(s, other, rows.triangle[row][k]);
    const Vec3d normal = is_deformable(bodies, other) ? rows.normal[row] : rotate(s.poses.orientation[other], rows.normal[row]);
    const double jolts = jolt_along(coming.jolt, body, -normal) + jolt_along(coming.jolt, other, normal);
    const double towards = std::max(0.0, -v.dot(normal)) + kTurning * v.norm();
    return !(rows.distance[row] > near + towards * period + jolts);
}

// What each body may do by itself.
void own_ways(const ComingPeriod& coming, const ContactRows& rows, std::vector<double>& way) {
    const Surfaces& s = coming.surfaces;
    const Bodies& bodies = s.bodies;
    way.assign(bodies.mesh.size(), kAnyWay);
    for (uint32_t body = 0; body < way.size(); ++body)
        if (bodies.motion[body] == Motion::kStatic) way[body] = 0;
    for (const RigidMass& free : bodies.rigid_mass) {
        const uint32_t body = static_cast<uint32_t>(free.body);
        const double turning = s.poses.angular_velocity[body].norm() * s.meshes.info[bodies.mesh[body]].radius;
        way[body] = 2 * coming.seconds * (s.poses.velocity[body].norm() + turning);
    }
    for (const auto& [a, b] : coming.joined) way[a] = way[b] = kAnyWay;
    for (const NodeDrive& drive : coming.drive) way[drive.body] = kAnyWay;
    for (uint32_t row = 0; row < rows.body.size(); ++row)
        for (const uint32_t body : {rows.body[row], rows.other[row]})
            if (bodies.motion[body] == Motion::kFree) way[body] = std::max(way[body], -2 * rows.distance[row]);
}

// Bodies pass their ways on to those they may reach, until nothing changes: forwards and backwards in turn, as chains run
// either way.
void pass_ways_on(const Bodies& bodies, const ContactRows& rows, std::vector<double>& way) {
    const uint32_t count = static_cast<uint32_t>(rows.body.size());
    bool changed = true;
    const auto pass = [&](uint32_t row) {
        const uint32_t a = rows.body[row], b = rows.other[row];
        const double gap = std::max(0.0, rows.distance[row]);
        const auto push = [&](uint32_t from, uint32_t to) {
            if (bodies.motion[to] != Motion::kFree || !(way[from] - gap > way[to])) return;
            way[to] = way[from] - gap;
            changed = true;
        };
        push(a, b), push(b, a);
    };
    while (changed) {
        changed = false;
        for (uint32_t row = 0; row < count; ++row) pass(row);
        for (uint32_t row = count; changed && row-- > 0;) pass(row);
    }
}

}  // namespace

void drop_idle_rows(const ComingPeriod& coming, IdleRowsScratch& scratch, ContactRows& rows) {
    const Bodies& bodies = coming.surfaces.bodies;
    const uint32_t count = static_cast<uint32_t>(rows.body.size());
    if (!bodies.rigid_mass.empty()) {
        own_ways(coming, rows, scratch.way);
        pass_ways_on(bodies, rows, scratch.way);
    }
    const double turned_fall = coming.gravity.norm() * coming.seconds * coming.seconds;
    const auto is_moved = [&](uint32_t body) { return !is_deformable(bodies, body) && bodies.motion[body] != Motion::kStatic; };
    const auto stays = [&](uint32_t row) {
        if (row < coming.pressed.size() && coming.pressed[row]) return true;
        const uint32_t body = rows.body[row], other = rows.other[row];
        if (!is_moved(body) && !is_moved(other)) return may_act(coming, rows, row);
        if (bodies.rigid_mass.empty() || is_deformable(bodies, body) || is_deformable(bodies, other)) return true;
        return !(rows.distance[row] > scratch.way[body] + scratch.way[other] + turned_fall);
    };
    scratch.dropped.resize(count);
    parallel_for(count, kRowsPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t row = begin; row < end; ++row) scratch.dropped[row] = !stays(row);
    });
    take_out_rows(scratch.dropped, rows);
}

}  // namespace trocar
