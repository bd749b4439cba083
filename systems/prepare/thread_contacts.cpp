#include "systems/prepare/thread_contacts.hpp"

#include <algorithm>
#include <cmath>

#include "engine/geometry/point_triangle.hpp"
#include "engine/thread/rod.hpp"
#include "engine/tissue/embedded_surface.hpp"
namespace trocar {
namespace {

using Near = ThreadContactScratch::Near;

// needle: body on which the thread's end hangs, or kNone.
bool may_touch(const ActionPass& pass, uint32_t body, uint32_t needle) {
    if (pass.world.surfaces.bodies.mesh[body] == kNone || body == needle) return false;
    const bool away = pass.spawning && body < pass.spawning->away.size() && is_away(*pass.spawning, body);
    return !away && !(pass.node_state && body < pass.node_state->off.size() && is_off(*pass.node_state, body));
}

// m/s, of the body's point of a touch.
Vec3d velocity_under(const ActionPass& pass, const ThreadTouch& touch) {
    const Surfaces& s = pass.world.surfaces;
    if (!is_deformable(s.bodies, touch.body)) {
        const Vec3d arm = direction_to_world(s, touch.body, touch.point);
        return s.poses.velocity[touch.body] + s.poses.angular_velocity[touch.body].cross(arm);
    }
    const uint32_t first = s.bodies.particles[touch.body].first + embedded_count(pass.world.solids, s.bodies.mesh[touch.body]);
    Vec3d sum = Vec3d::Zero();
    for (uint32_t k = 0; k < 4 && touch.node[k] != kNone; ++k) {
        const uint32_t p = first + touch.node[k];
        sum += touch.weight[k] * Vec3d(s.particles.velocity_x[p], s.particles.velocity_y[p], s.particles.velocity_z[p]);
    }
    return sum;
}

// The points of a thread that may touch something. What slides along a surface is looked for where it will be in the middle of the pass:
// the plane there is that of the whole pass.
void list_points(const ActionPass& pass, const Thread& thread, const Rod& rod, const ThreadState& state, std::vector<Near>& near) {
    near.clear();
    const double seconds = pass.period;
    double last_held = -1e300;
    const double clear = 1.5 * thread.spacing;
    for (uint32_t i = 0; i < rod.count; ++i) {
        if (rod.held[i] != kNone) {
            last_held = rod.material[i];
            while (!near.empty() && last_held - rod.material[near.back().row] < clear) near.pop_back();
        } else if (rod.material[i] - last_held >= clear) {
            Near point;
            point.row = i, point.at = rod.position[i];
            if (rod.touching[i] != kNone) {
                const ThreadTouch& touch = state.touch[rod.touching[i]];
                const Vec3d way = 0.5 * seconds * (rod.velocity[i] - velocity_under(pass, touch));
                point.at += way - touch.normal.dot(way) * touch.normal;
            }
            point.reach = std::min(kFarReach, 1e-3 + thread.radius + 1.5 * seconds * rod.velocity[i].norm());
            point.squared = point.reach * point.reach;
            near.push_back(point);
        }
    }
}

void look_at_rigid(const ActionPass& pass, uint32_t body, std::vector<Near>& near) {
    const Surfaces& s = pass.world.surfaces;
    const uint32_t tree = s.bodies.tree[body];
    if (tree >= pass.world.trees.size() || !pass.world.trees[tree]) return;
    const Box box = s.meshes.info[s.bodies.mesh[body]].box;
    for (Near& n : near) {
        const Vec3d local = world_to_frame(s, body, n.at);
        if (((local - box.min).array() < -n.reach).any() || ((local - box.max).array() > n.reach).any()) continue;
        const SurfacePoint hit = pass.world.trees[tree]->query(local, n.reach);
        if (hit.triangle == kNone || !(hit.distance * hit.distance < n.squared)) continue;
        n.squared = hit.distance * hit.distance, n.body = body, n.triangle = hit.triangle;
        n.place = frame_to_world(s, body, hit.point), n.normal = direction_to_world(s, body, hit.normal);
        n.outward = has_inside(s, body) && hit.distance > -kShallow;
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

void look_at_deformable(const ActionPass& pass, uint32_t body, std::vector<Near>& near) {
    const Surfaces& s = pass.world.surfaces;
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
    if (near.empty()) return;
    Vec3d low = Vec3d::Constant(1e300), high = -low;
    for (const Near& n : near) low = low.cwiseMin(n.at - Vec3d::Constant(n.reach)), high = high.cwiseMax(n.at + Vec3d::Constant(n.reach));
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
        Vec3d corner[3];
        for (int k = 0; k < 3; ++k) corner[k] = vertex_position(s, body, mesh.triangle[t][k]);
        const Vec3d least = corner[0].cwiseMin(corner[1]).cwiseMin(corner[2]), most = corner[0].cwiseMax(corner[1]).cwiseMax(corner[2]);
        if ((least.array() > high.array()).any() || (most.array() < low.array()).any()) continue;
        for (Near& n : near) {
            if (((n.at - least).array() < -n.reach).any() || ((n.at - most).array() > n.reach).any()) continue;
            const TrianglePoint p = closest_point_on_triangle(n.at, corner[0], corner[1], corner[2]);
            const Vec3d normal = (corner[1] - corner[0]).cross(corner[2] - corner[0]).normalized();
            // of triangles that share the nearest corner or edge, the one that the point is farthest above or below tells the side
            const bool same = n.body == body && std::abs(p.squared_distance - n.squared) <= 1e-9 * n.squared + 1e-24;
            const double height = std::abs(normal.dot(p.offset));
            if (same ? height <= std::abs(n.normal.dot(n.place - n.at)) : !(p.squared_distance < n.squared)) continue;
            n.squared = p.squared_distance, n.body = body, n.triangle = t;
            n.place = n.at + p.offset, n.normal = normal;
            n.outward = has_inside(s, body) && normal.dot(p.offset) < kShallow;
        }
    }
}

ThreadTouch touch_of(const ActionPass& pass, const Thread& thread, uint32_t index, const Near& n) {
    const Surfaces& s = pass.world.surfaces;
    ThreadTouch touch;
    touch.thread = index, touch.body = n.body;
    touch.friction = s.bodies.tissue[n.body].friction;
    const Vec3d way = n.at - n.place;
    const double distance = way.norm();
    touch.normal = distance > 1e-9 ? Vec3d(way / distance) : n.normal;
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

// What is nearer than it should be, as thread is that comes out of a bite, is not thrown out: it keeps the distance that it has or had.
// last: its touch in the last pass, or null.
void keep_apart(const Vec3d& at, const ThreadTouch* last, ThreadTouch& touch) {
    double distance = touch.normal.dot(at - touch.before);
    if (last && last->body == touch.body) distance = std::max(distance, last->gap);
    touch.gap = std::min(touch.gap, distance);
    const double depth = touch.gap - touch.normal.dot(at - touch.before);
    touch.stored = depth > 0 ? 0.5 * kContactStiffness * depth * depth : 0;
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
        list_points(pass, thread, rod, state, scratch.near);
        const uint32_t needle = thread.tool == kNone ? kNone : pass.tools[thread.tool].body;
        for (uint32_t body = 0; body < s.bodies.mesh.size(); ++body) {
            if (!may_touch(pass, body, needle)) continue;
            is_deformable(s.bodies, body) ? look_at_deformable(pass, body, scratch.near) : look_at_rigid(pass, body, scratch.near);
        }
        auto first = static_cast<uint32_t>(scratch.found.size());
        for (const Near& n : scratch.near) {
            if (n.body == kNone) continue;
            ThreadTouch touch = touch_of(pass, thread, index, n);
            keep_apart(rod.position[n.row], rod.touching[n.row] == kNone ? nullptr : &state.touch[rod.touching[n.row]], touch);
            energy.work_contact += touch.stored;
            scratch.found.push_back(touch);
        }
        std::fill(rod.touching.begin(), rod.touching.end(), kNone);
        for (const Near& n : scratch.near)
            if (n.body != kNone) rod.touching[n.row] = first++;
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
