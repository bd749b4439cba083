#include "systems/prepare/thread_contacts.hpp"

#include <algorithm>
#include <cmath>

#include "engine/geometry/point_triangle.hpp"
#include "engine/thread/rod.hpp"
#include "engine/thread/touch.hpp"
#include "engine/tissue/embedded_surface.hpp"
namespace trocar {
namespace {

using Near = ThreadContactScratch::Near;
using Place = ThreadContactScratch::Place;

// needle: body on which the thread's end hangs, or kNone.
bool may_touch(const ActionPass& pass, uint32_t body, uint32_t needle) {
    if (pass.world.surfaces.bodies.mesh[body] == kNone || body == needle) return false;
    const bool away = pass.spawning && body < pass.spawning->away.size() && is_away(*pass.spawning, body);
    return !away && !(pass.node_state && body < pass.node_state->off.size() && is_off(*pass.node_state, body));
}

// m/s, of a point (m, world) of a rigid body.
Vec3d rigid_velocity_at(const Surfaces& s, uint32_t body, const Vec3d& point) {
    return s.poses.velocity[body] + s.poses.angular_velocity[body].cross(point - s.poses.origin[body]);
}

// m/s, of the body's point of a touch.
Vec3d velocity_under(const ActionPass& pass, const ThreadTouch& touch) {
    const Surfaces& s = pass.world.surfaces;
    if (!is_deformable(s.bodies, touch.body)) return rigid_velocity_at(s, touch.body, frame_to_world(s, touch.body, touch.point));
    const uint32_t first = s.bodies.particles[touch.body].first + embedded_count(pass.world.solids, s.bodies.mesh[touch.body]);
    Vec3d sum = Vec3d::Zero();
    for (uint32_t k = 0; k < 4 && touch.node[k] != kNone; ++k) {
        const uint32_t p = first + touch.node[k];
        sum += touch.weight[k] * Vec3d(s.particles.velocity_x[p], s.particles.velocity_y[p], s.particles.velocity_z[p]);
    }
    return sum;
}

// m/s, of the fastest particle of a deformable body.
double fastest_particle_speed(const Surfaces& s, uint32_t body) {
    const Range rows = s.bodies.particles[body];
    double squared = 0;
    for (uint32_t p = rows.first; p < rows.end(); ++p)
        squared = std::max(squared, Vec3d(s.particles.velocity_x[p], s.particles.velocity_y[p], s.particles.velocity_z[p]).squaredNorm());
    return std::sqrt(squared);
}

// The points of a thread that may touch something.
void list_points(const Thread& thread, const Rod& rod, std::vector<Near>& near) {
    near.clear();
    double last_held = -1e300;
    const double clear = 1.5 * thread.spacing;
    for (uint32_t i = 0; i < rod.count; ++i) {
        if (rod.held[i] != kNone) {
            last_held = rod.material[i];
            while (!near.empty() && last_held - rod.material[near.back().row] < clear) near.pop_back();
        } else if (rod.material[i] - last_held >= clear) {
            near.emplace_back().row = i;
        }
    }
}

// The touch of a point with a body in the last pass, or null.
const ThreadTouch* touch_with(const ThreadState& state, const Rod& rod, uint32_t row, uint32_t body) {
    for (const uint32_t k : touches_of(rod, row))
        if (k != kNone && state.touch[k].body == body) return &state.touch[k];
    return nullptr;
}

// Where, and how far around, the points look for a body. What slides along it is looked for where it will be in the middle of the pass: the
// plane there is that of the whole pass.
void aim_at(const ActionPass& pass, uint32_t body, const Thread& thread, const Rod& rod, const ThreadState& state,
            std::vector<Near>& near) {
    constexpr double kFaster = 1.5, kBeside = 1e-3;  // of what moves faster in the pass than at its start; m
    const Surfaces& s = pass.world.surfaces;
    const bool soft = is_deformable(s.bodies, body);
    const double fastest = soft ? fastest_particle_speed(s, body) : 0;
    for (Near& n : near) {
        n.found = {}, n.from = rod.position[n.row];
        const Vec3d& velocity = rod.velocity[n.row];
        n.displacement = pass.period * (soft ? velocity : Vec3d(velocity - rigid_velocity_at(s, body, n.from)));
        const ThreadTouch* last = touch_with(state, rod, n.row, body);
        n.touched = last != nullptr;
        if (last) {
            const Vec3d half = 0.5 * pass.period * (velocity - velocity_under(pass, *last));
            n.from += half - last->normal.dot(half) * last->normal;
        }
        const double distance = n.displacement.norm() + pass.period * fastest;
        n.reach = std::min(kFarReach, kBeside + thread.radius + 0.5 * s.bodies.thickness[body] + kFaster * distance);
        n.found.squared = n.reach * n.reach;
    }
}

// Follows the point on its way relative to a rigid body, each time by its distance from it: there is nothing nearer.
void look_at_rigid(const ActionPass& pass, uint32_t body, double gap, std::vector<Near>& near) {
    constexpr double kMet = 1e-4;  // m
    constexpr int kMostLooks = 8;
    const Surfaces& s = pass.world.surfaces;
    const uint32_t tree = s.bodies.tree[body];
    if (tree >= pass.world.trees.size() || !pass.world.trees[tree]) return;
    const Box box = s.meshes.info[s.bodies.mesh[body]].box;
    for (Near& n : near) {
        const Vec3d start = world_to_frame(s, body, n.from);
        if (((start - box.min).array() < -n.reach).any() || ((start - box.max).array() > n.reach).any()) continue;
        SurfacePoint hit = pass.world.trees[tree]->query(start, n.reach);
        if (hit.triangle == kNone) continue;
        const double all = n.displacement.norm();
        double passed = 0;
        Vec3d from = n.from;
        for (int k = 1; k < kMostLooks && !n.touched && passed < all && hit.distance - gap > kMet; ++k) {
            passed = std::min(all, passed + hit.distance - gap);
            const Vec3d next = n.from + passed / all * n.displacement;
            const SurfacePoint there = pass.world.trees[tree]->query(world_to_frame(s, body, next), n.reach);
            if (there.triangle == kNone) break;
            hit = there, from = next;
        }
        n.found.body = body, n.found.triangle = hit.triangle, n.found.from = from;
        n.found.squared = hit.distance * hit.distance, n.found.ahead = passed + hit.distance - gap;
        n.found.place = frame_to_world(s, body, hit.point), n.found.normal = direction_to_world(s, body, hit.normal);
        n.found.outward = has_inside(s, body) && hit.distance > -kShallow;
    }
}

// Barycentric coordinates of a point of a triangle, from the areas that it parts it into.
Vec3d weights_in(const Vec3d& at, const Vec3d corner[3]) {
    const Vec3d normal = (corner[1] - corner[0]).cross(corner[2] - corner[0]);
    Vec3d w;
    for (int k = 0; k < 3; ++k)
        w[k] = std::max(0.0, normal.dot((corner[(k + 2) % 3] - corner[(k + 1) % 3]).cross(at - corner[(k + 1) % 3])));
    const double sum = w.sum();
    return sum > 0 ? Vec3d(w / sum) : Vec3d(1, 0, 0);
}

void look_at_deformable(const ActionPass& pass, uint32_t body, double gap, std::vector<Near>& near) {
    const Surfaces& s = pass.world.surfaces;
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
    if (near.empty()) return;
    Vec3d low = Vec3d::Constant(1e300), high = -low;
    for (const Near& n : near)
        low = low.cwiseMin(n.from - Vec3d::Constant(n.reach)), high = high.cwiseMax(n.from + Vec3d::Constant(n.reach));
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
        Vec3d corner[3];
        for (int k = 0; k < 3; ++k) corner[k] = vertex_position(s, body, mesh.triangle[t][k]);
        const Vec3d least = corner[0].cwiseMin(corner[1]).cwiseMin(corner[2]), most = corner[0].cwiseMax(corner[1]).cwiseMax(corner[2]);
        if ((least.array() > high.array()).any() || (most.array() < low.array()).any()) continue;
        for (Near& n : near) {
            if (((n.from - least).array() < -n.reach).any() || ((n.from - most).array() > n.reach).any()) continue;
            const TrianglePoint p = closest_point_on_triangle(n.from, corner[0], corner[1], corner[2]);
            const Vec3d normal = (corner[1] - corner[0]).cross(corner[2] - corner[0]).normalized();
            Place& found = n.found;
            // of triangles that share the nearest corner or edge, the one that the point is farthest above or below tells the side
            const bool same = found.body == body && std::abs(p.squared_distance - found.squared) <= 1e-9 * found.squared + 1e-24;
            const double height = std::abs(normal.dot(p.offset));
            if (same ? height <= std::abs(found.normal.dot(found.place - n.from)) : !(p.squared_distance < found.squared)) continue;
            found.squared = p.squared_distance, found.body = body, found.triangle = t, found.from = n.from;
            found.ahead = std::sqrt(p.squared_distance) - gap;
            found.place = n.from + p.offset, found.normal = normal;
            found.outward = has_inside(s, body) && normal.dot(p.offset) < kShallow;
        }
    }
}

// Keeps the bodies that the point meets first; of those as near, the ones that come first.
void keep_found(Near& n) {
    if (n.found.body == kNone) return;
    Place place = n.found;
    for (Place& kept : n.kept)
        if (kept.body == kNone || place.ahead < kept.ahead) std::swap(place, kept);
}

// Whether a thread has been drawn into a closed body on its way from the first end to a point, and not out of it.
bool is_sewn_in(const ThreadState& state, const Rod& rod, uint32_t row, uint32_t body) {
    bool inside = false;
    for (uint32_t i = 0; i < row; ++i)
        if (rod.held[i] != kNone && state.hold[rod.held[i]].slides && state.hold[rod.held[i]].body == body) inside = !inside;
    return inside;
}

ThreadTouch touch_of(const ActionPass& pass, const Thread& thread, uint32_t index, const Place& n) {
    const Surfaces& s = pass.world.surfaces;
    ThreadTouch touch;
    touch.thread = index, touch.body = n.body;
    touch.friction = s.bodies.tissue[n.body].friction;
    const Vec3d offset = n.from - n.place;
    const double distance = offset.norm();
    touch.normal = distance > 1e-9 ? Vec3d(offset / distance) : n.normal;
    if (n.outward && touch.normal.dot(n.normal) < 0) touch.normal = -touch.normal;
    touch.gap = thread.radius + 0.5 * s.bodies.thickness[n.body];
    if (!is_deformable(s.bodies, n.body)) {
        touch.point = world_to_frame(s, n.body, n.place), touch.before = n.place;
        return touch;
    }
    const Triangle triangle = mesh_view(s.meshes, s.bodies.mesh[n.body]).triangle[n.triangle];
    Vec3d corner[3];
    for (int k = 0; k < 3; ++k) corner[k] = vertex_position(s, n.body, triangle[k]);
    const SewnNodes under = nodes_under(pass, n.body, n.triangle, weights_in(n.place, corner));
    touch.node = under.node, touch.weight = under.weight;
    touch.point = n.place - sewn_place(pass, n.body, touch.node, touch.weight);
    touch.before = touch.point + sewn_place_at_velocity(pass, n.body, touch.node, touch.weight);
    return touch;
}

// What is nearer than it should be is not thrown out: it is pressed as in the last pass, wherever the plane lies, and steps let it out
// slowly. last: its touch with the same body in the last pass, or null.
void keep_apart(const Vec3d& at, const ThreadTouch* last, ThreadTouch& touch) {
    const double pressed = last ? std::max(0.0, last->gap - last->normal.dot(at - last->before)) : 0;
    touch.gap = std::min(touch.gap, touch.normal.dot(at - touch.before) + pressed);
    touch.stored = energy_of_touch(touch, at, touch.before);
}

}  // namespace

void find_thread_contacts(const ActionPass& pass, const Threads& threads, ThreadContactScratch& scratch, ThreadState& state,
                          Energy& energy) {
    const Surfaces& s = pass.world.surfaces;
    for (const ThreadTouch& touch : state.touch) energy.work_contact -= touch.stored;
    scratch.near.reserve(state.touching.size());
    scratch.found.reserve(state.touching.size());
    scratch.found.clear();
    for (uint32_t index = 0; index < threads.thread.size(); ++index) {
        const Thread& thread = threads.thread[index];
        if (!thread.contact) continue;
        Rod rod = rod_of(thread, index, state);
        list_points(thread, rod, scratch.near);
        const uint32_t needle = thread.tool == kNone ? kNone : pass.tools[thread.tool].body;
        for (uint32_t body = 0; body < s.bodies.mesh.size(); ++body) {
            if (!may_touch(pass, body, needle)) continue;
            const double gap = thread.radius + 0.5 * s.bodies.thickness[body];
            aim_at(pass, body, thread, rod, state, scratch.near);
            is_deformable(s.bodies, body) ? look_at_deformable(pass, body, gap, scratch.near)
                                          : look_at_rigid(pass, body, gap, scratch.near);
            std::ranges::for_each(scratch.near, keep_found);
        }
        auto first = static_cast<uint32_t>(scratch.found.size());
        for (Near& n : scratch.near)
            for (Place& place : n.kept) {
                if (place.body == kNone) continue;
                place.outward = place.outward && !is_sewn_in(state, rod, n.row, place.body);
                ThreadTouch touch = touch_of(pass, thread, index, place);
                keep_apart(rod.position[n.row], touch_with(state, rod, n.row, place.body), touch);
                energy.work_contact += touch.stored;
                scratch.found.push_back(touch);
            }
        std::ranges::fill(rod.touching, kNone);
        for (const Near& n : scratch.near)
            for (uint32_t k = 0; k < kTouchesPerPoint; ++k)
                if (n.kept[k].body != kNone) touches_of(rod, n.row)[k] = first++;
    }
    state.touch.assign(scratch.found.begin(), scratch.found.end());
}

SewnNodes nodes_under(const ActionPass& pass, uint32_t body, uint32_t triangle, const Vec3d& weight) {
    const Surfaces& s = pass.world.surfaces;
    const uint32_t prototype = s.bodies.mesh[body];
    const Triangle t = mesh_view(s.meshes, prototype).triangle[triangle];
    const Range skin = prototype < pass.world.solids.info.size() ? pass.world.solids.info[prototype].skin : Range{};
    if (skin.count > 0) {
        Eigen::Index nearest;
        weight.maxCoeff(&nearest);
        const uint32_t row = skin.first + t[static_cast<size_t>(nearest)];
        return {pass.world.solids.embedding_node[row], pass.world.solids.embedding_weight[row]};
    }
    return {{t[0], t[1], t[2], kNone}, {weight[0], weight[1], weight[2], 0}};
}

Vec3d sewn_place(const ActionPass& pass, uint32_t body, const std::array<uint32_t, 4>& node, const std::array<double, 4>& weight) {
    const Surfaces& s = pass.world.surfaces;
    const uint32_t first = s.bodies.particles[body].first + embedded_count(pass.world.solids, s.bodies.mesh[body]);
    Vec3d sum = Vec3d::Zero();
    for (uint32_t k = 0; k < 4 && node[k] != kNone; ++k) {
        const Float4& o = s.particles.offset[first + node[k]];
        sum += weight[k] * (s.poses.origin[body] + Vec3d(o.x, o.y, o.z));
    }
    return sum;
}

Vec3d sewn_place_at_velocity(const ActionPass& pass, uint32_t body, const std::array<uint32_t, 4>& node,
                             const std::array<double, 4>& weight) {
    const Surfaces& s = pass.world.surfaces;
    const uint32_t first = s.bodies.particles[body].first + embedded_count(pass.world.solids, s.bodies.mesh[body]);
    Vec3d rate = Vec3d::Zero();
    for (uint32_t k = 0; k < 4 && node[k] != kNone; ++k) {
        const uint32_t p = first + node[k];
        rate += weight[k] * Vec3d(s.particles.velocity_x[p], s.particles.velocity_y[p], s.particles.velocity_z[p]);
    }
    return sewn_place(pass, body, node, weight) - 0.5 * s.particles.last_dt[body] * rate;
}

}  // namespace trocar
