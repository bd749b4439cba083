#include "systems/prepare/thread_contacts.hpp"

#include <algorithm>
#include <cmath>

#include "engine/thread/rod.hpp"
namespace trocar {
namespace {

using Near = ThreadContactScratch::Near;

bool may_touch(const ActionPass& pass, uint32_t body) {
    const Bodies& bodies = pass.world.surfaces.bodies;
    if (bodies.mesh[body] == kNone || (bodies.motion[body] != Motion::kStatic && bodies.motion[body] != Motion::kKinematic)) return false;
    const bool away = pass.spawning && body < pass.spawning->away.size() && is_away(*pass.spawning, body);
    return !away && !(pass.node_state && body < pass.node_state->off.size() && is_off(*pass.node_state, body));
}

// The points of a thread that may touch something.
void list_points(const Thread& thread, const Rod& rod, double seconds, std::vector<Near>& near) {
    near.clear();
    double last_held = -1e300;
    const double clear = 1.5 * thread.spacing;
    for (uint32_t i = 0; i < rod.count; ++i) {
        if (rod.held[i] != kNone) {
            last_held = rod.material[i];
            while (!near.empty() && last_held - rod.material[near.back().row] < clear) near.pop_back();
        } else if (rod.material[i] - last_held >= clear) {
            Near point;
            point.row = i, point.at = rod.position[i];
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
    touch.point = world_to_frame(s, n.body, n.place), touch.before = n.place;
    return touch;
}

}  // namespace

void find_thread_contacts(const ActionPass& pass, const Threads& threads, ThreadContactScratch& scratch, ThreadState& state, Energy& energy) {
    const Surfaces& s = pass.world.surfaces;
    for (const ThreadTouch& touch : state.touch) energy.work_contact -= touch.stored;
    state.touch.clear();
    std::fill(state.touching.begin(), state.touching.end(), kNone);
    scratch.near.reserve(state.touching.size());
    for (uint32_t index = 0; index < threads.thread.size(); ++index) {
        const Thread& thread = threads.thread[index];
        if (!thread.contact) continue;
        Rod rod = rod_of(thread, index, state);
        list_points(thread, rod, pass.period, scratch.near);
        for (uint32_t body = 0; body < s.bodies.mesh.size(); ++body) {
            if (may_touch(pass, body)) look_at_rigid(pass, body, scratch.near);
        }
        for (const Near& n : scratch.near) {
            if (n.body == kNone) continue;
            ThreadTouch touch = touch_of(pass, thread, index, n);
            const double depth = touch.gap - touch.normal.dot(n.at - touch.before);
            touch.stored = depth > 0 ? 0.5 * kContactStiffness * depth * depth : 0;
            energy.work_contact += touch.stored;
            rod.touching[n.row] = static_cast<uint32_t>(state.touch.size());
            state.touch.push_back(touch);
        }
    }
}

}  // namespace trocar
