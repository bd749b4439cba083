#include "systems/fast_bodies.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/parallel.hpp"
namespace trocar {
namespace {

constexpr uint32_t kPairsPerChunk = 8;

const FastBody* find_fast(std::span<const FastBody> fast, uint32_t body) {
    const auto at = std::ranges::lower_bound(fast, body, {}, &FastBody::body);
    return at != fast.end() && at->body == body ? &*at : nullptr;
}

// The way of a body as another one sees it that goes with `velocity`.
RigidSweep seen_from(const Surfaces& s, uint32_t other, const RigidSweep& sweep, const Vec3d& velocity) {
    const Quat turn = is_deformable(s.bodies, other) ? Quat{} : s.poses.orientation[other];
    RigidSweep seen = sweep;
    seen.place = rotate_back(turn, sweep.place - s.poses.origin[other]);
    seen.velocity = rotate_back(turn, sweep.velocity - velocity);
    seen.orientation = multiply(conjugate(turn), sweep.orientation);
    seen.spin = rotate_back(turn, sweep.spin);
    return seen;
}

// Whether the ball that the mover turns in stays so far from the other body, which goes with `velocity`, that no touch is found: that
// may be by up to two tolerances before there is one.
bool passes_by(const ContactInputs& in, uint32_t mover, const RigidSweep& sweep, uint32_t other, const Vec3d& velocity, double tolerance) {
    const Surfaces& s = in.surfaces;
    const double arm = s.meshes.info[s.bodies.mesh[mover]].radius + sweep.pivot.norm();
    double apart = 0;
    if (is_deformable(s.bodies, other)) {
        const Box& box = in.boxes.box[other];
        apart = (sweep.place - sweep.place.cwiseMax(box.min).cwiseMin(box.max)).norm();
    } else {
        apart = (sweep.place - s.poses.origin[other]).norm() - s.meshes.info[s.bodies.mesh[other]].radius;
    }
    return apart > arm + (sweep.velocity - velocity).norm() * in.period + 3 * tolerance;
}

// When a pair with a fast body first touches, s, or infinity.
double touch_of(const ContactInputs& in, std::span<const FastBody> fast, uint32_t mover, uint32_t other) {
    constexpr double kNever = std::numeric_limits<double>::infinity();
    const Surfaces& s = in.surfaces;
    const Bodies& bodies = s.bodies;
    const FastBody* own = find_fast(fast, mover);
    if (own == nullptr) {
        std::swap(mover, other);
        own = find_fast(fast, mover);
    }
    if (own == nullptr) return kNever;
    // tissue gives way to a hand: held at its surface, the tool would stay far behind the hand, and the hand feel nothing
    if (bodies.motion[mover] == Motion::kHand && is_deformable(bodies, other)) return kNever;
    const FastBody* second = find_fast(fast, other);
    Vec3d velocity = Vec3d::Zero();
    if (second != nullptr) {
        velocity = second->sweep.velocity;
    } else if (!is_deformable(bodies, other)) {
        velocity = s.poses.velocity[other];
    }
    const double least = in.params.tolerance + 0.5 * bodies.thickness[other];
    if (passes_by(in, mover, own->sweep, other, velocity, least)) return kNever;
    return first_touch(mesh_view(s.meshes, bodies.mesh[mover]), *in.trees[bodies.tree[mover]], mesh_view(s.meshes, bodies.mesh[other]),
                       *in.trees[bodies.tree[other]], seen_from(s, other, own->sweep, velocity), in.period, least);
}

void cover_ways(std::span<const FastBody> fast, double seconds, const Surfaces& surfaces, BodyBoxes& boxes) {
    for (const FastBody& f : fast) {
        const double arm = surfaces.meshes.info[surfaces.bodies.mesh[f.body]].radius + f.sweep.pivot.norm();
        const Vec3d reach = Vec3d::Constant(arm + boxes.margin[f.body]);
        const Vec3d end = f.sweep.place + seconds * f.sweep.velocity;
        Box& box = boxes.box[f.body];
        box.min = box.min.cwiseMin(f.sweep.place.cwiseMin(end) - reach);
        box.max = box.max.cwiseMax(f.sweep.place.cwiseMax(end) + reach);
    }
}

}  // namespace

void find_fast_bodies(const FastBodiesInputs& in, std::vector<FastBody>& fast, BodyBoxes& boxes) {
    const auto& [period, gravity, s, tools, devices, node_state] = in;
    const Poses& poses = s.poses;
    fast.clear();
    const auto add = [&](uint32_t body, const RigidSweep& sweep) {
        if (is_off(in.node_state, body)) return;
        const double arm = in.surfaces.meshes.info[in.surfaces.bodies.mesh[body]].radius + sweep.pivot.norm();
        const double way = (boxes.speed[body] + in.surfaces.poses.angular_velocity[body].norm() * arm) * in.period;
        if (way > boxes.margin[body] && std::isfinite(way)) fast.push_back({body, sweep});
    };
    for (size_t t = 0; t < tools.size(); ++t) {
        const HandTool& tool = tools[t];
        const DeviceState& end = devices.end(t);
        const Vec3d from = poses.origin[tool.body], to = end.position - rotate(end.orientation, tool.tip);
        const Quat& turn = poses.orientation[tool.body];
        add(tool.body, {Vec3d::Zero(), from, (to - from) / period, turn, rotation_vector(turn, end.orientation) / period});
    }
    for (const RigidMass& free : s.bodies.rigid_mass) {
        const uint32_t body = static_cast<uint32_t>(free.body);
        const Vec3d& spin = poses.angular_velocity[body];
        const Vec3d arm = rotate(poses.orientation[body], free.centre);
        const Vec3d velocity = poses.velocity[body] + spin.cross(arm) + 0.5 * period * gravity;
        add(body, {free.centre, poses.origin[body] + arm, velocity, poses.orientation[body], spin});
    }
    std::ranges::sort(fast, {}, &FastBody::body);
    cover_ways(fast, period, s, boxes);
}

void find_stops(const ContactInputs& in, std::span<const FastBody> fast, std::vector<double>& touch, std::vector<double>& stop) {
    const CandidatePairs& pairs = in.pairs;
    stop.assign(fast.empty() ? 0 : in.surfaces.bodies.mesh.size(), std::numeric_limits<double>::infinity());
    if (fast.empty()) return;
    touch.resize(pairs.a.size());
    parallel_for(static_cast<uint32_t>(pairs.a.size()), kPairsPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t pair = begin; pair < end; ++pair) touch[pair] = touch_of(in, fast, pairs.a[pair], pairs.b[pair]);
    });
    for (uint32_t pair = 0; pair < pairs.a.size(); ++pair) {
        if (!(touch[pair] > 0)) continue;  // contact rows have it
        for (const uint32_t body : {pairs.a[pair], pairs.b[pair]})
            if (find_fast(fast, body)) stop[body] = std::min(stop[body], touch[pair]);
    }
}

}  // namespace trocar
