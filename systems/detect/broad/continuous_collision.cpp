#include "systems/detect/broad/continuous_collision.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/jobs/parallel.hpp"
namespace trocar {
namespace {

constexpr uint32_t kFastPairsPerChunk = 8;

const CcdBody* find_ccd_body(std::span<const CcdBody> ccd_bodies, uint32_t body) {
    const auto at = std::ranges::lower_bound(ccd_bodies, body, {}, &CcdBody::body);
    return at != ccd_bodies.end() && at->body == body ? &*at : nullptr;
}

// Motion of a body relative to another one that moves with `velocity`.
RigidSweep seen_from(const Surfaces& s, uint32_t other, const RigidSweep& sweep, const Vec3d& velocity) {
    const Quat turn = is_deformable(s.bodies, other) ? Quat{} : s.poses.orientation[other];
    RigidSweep seen = sweep;
    seen.position = rotate_back(turn, sweep.position - s.poses.origin[other]);
    seen.velocity = rotate_back(turn, sweep.velocity - velocity);
    seen.orientation = multiply(conjugate(turn), sweep.orientation);
    seen.spin = rotate_back(turn, sweep.spin);
    return seen;
}

// Whether the mover's bounding ball stays so far from the other body, which moves with `velocity`, that the
// query finds no touch; the query may report a touch up to two tolerances early.
bool passes_by(const ContactInputs& in, uint32_t mover, const RigidSweep& sweep, uint32_t other, const Vec3d& velocity, double tolerance) {
    const Surfaces& s = in.surfaces;
    const double arm = s.meshes.info[s.bodies.mesh[mover]].radius + sweep.pivot.norm();
    double apart = 0;
    if (is_deformable(s.bodies, other)) {
        const Box& box = in.boxes.box[other];
        apart = (sweep.position - sweep.position.cwiseMax(box.min).cwiseMin(box.max)).norm();
    } else {
        apart = (sweep.position - s.poses.origin[other]).norm() - s.meshes.info[s.bodies.mesh[other]].radius;
    }
    return apart > arm + (sweep.velocity - velocity).norm() * in.period + 3 * tolerance;
}

// Time of first touch of a pair with a fast body, s, or infinity.
double time_of_impact_of(const ContactInputs& in, std::span<const CcdBody> ccd_bodies, uint32_t mover, uint32_t other) {
    constexpr double kNever = std::numeric_limits<double>::infinity();
    const Surfaces& s = in.surfaces;
    const Bodies& bodies = s.bodies;
    const CcdBody* own = find_ccd_body(ccd_bodies, mover);
    if (own == nullptr) {
        std::swap(mover, other);
        own = find_ccd_body(ccd_bodies, mover);
    }
    if (own == nullptr) return kNever;
    // tissue yields to a hand: stopped at its surface, the tool would stay behind and give no force. It may go in by half
    // the body's mean thickness: so far the contacts of the next pass find from which side
    double seconds_inside = 0;
    if (bodies.motion[mover] == Motion::kHand && is_deformable(bodies, other)) {
        const double arm = s.meshes.info[bodies.mesh[mover]].radius, speed = own->sweep.velocity.norm() + own->sweep.spin.norm() * arm;
        const MeshInfo& info = s.meshes.info[bodies.mesh[other]];
        seconds_inside = (info.admission == Admission::kSheet ? 0.5 * bodies.thickness[other] : info.volume / info.area) / speed;
        if (!(seconds_inside < in.period)) return kNever;
    }
    const CcdBody* second = find_ccd_body(ccd_bodies, other);
    Vec3d velocity = Vec3d::Zero();
    if (second != nullptr) {
        velocity = second->sweep.velocity;
    } else if (!is_deformable(bodies, other)) {
        velocity = s.poses.velocity[other];
    }
    const double least = in.params.tolerance + 0.5 * bodies.thickness[other];
    if (passes_by(in, mover, own->sweep, other, velocity, least)) return kNever;
    const double touch =
        first_touch(mesh_view(s.meshes, bodies.mesh[mover]), *in.trees[bodies.tree[mover]], mesh_view(s.meshes, bodies.mesh[other]),
                    *in.trees[bodies.tree[other]], seen_from(s, other, own->sweep, velocity), in.period, least);
    return touch > 0 ? touch + seconds_inside : touch;
}

void cover_motions(std::span<const CcdBody> ccd_bodies, double seconds, const Surfaces& surfaces, BodyBoxes& boxes) {
    for (const CcdBody& f : ccd_bodies) {
        const double arm = surfaces.meshes.info[surfaces.bodies.mesh[f.body]].radius + f.sweep.pivot.norm();
        const Vec3d margin = Vec3d::Constant(arm + boxes.margin[f.body]);
        const Vec3d end = f.sweep.position + seconds * f.sweep.velocity;
        Box& box = boxes.box[f.body];
        box.min = box.min.cwiseMin(f.sweep.position.cwiseMin(end) - margin);
        box.max = box.max.cwiseMax(f.sweep.position.cwiseMax(end) + margin);
    }
}

}  // namespace

void find_ccd_bodies(const FastBodiesInputs& in, std::vector<CcdBody>& ccd_bodies, BodyBoxes& boxes) {
    const auto& [period, gravity, s, tools, devices, node_state] = in;
    const Poses& poses = s.poses;
    ccd_bodies.clear();
    // `travel`: m, of a hand in the pass, which may begin at rest
    const auto add = [&](uint32_t body, const RigidSweep& sweep, double travel = 0) {
        if (is_off(in.node_state, body)) return;
        const double arm = in.surfaces.meshes.info[in.surfaces.bodies.mesh[body]].radius + sweep.pivot.norm();
        const double distance = std::max(travel, (boxes.speed[body] + in.surfaces.poses.angular_velocity[body].norm() * arm) * in.period);
        if (distance > boxes.margin[body] && std::isfinite(distance)) ccd_bodies.push_back({body, sweep});
    };
    for (size_t t = 0; t < tools.size(); ++t) {
        const HandTool& tool = tools[t];
        const DeviceState& end = devices.end(t);
        const Vec3d from = poses.origin[tool.body], to = end.position - rotate(end.orientation, tool.tip);
        const Quat& turn = poses.orientation[tool.body];
        add(tool.body, {Vec3d::Zero(), from, (to - from) / period, turn, rotation_vector(turn, end.orientation) / period},
            (end.position - devices.start(t).position).norm());
    }
    for (const RigidMass& free : s.bodies.rigid_mass) {
        const uint32_t body = static_cast<uint32_t>(free.body);
        const Vec3d& spin = poses.angular_velocity[body];
        const Vec3d arm = rotate(poses.orientation[body], free.centre);
        const Vec3d velocity = poses.velocity[body] + spin.cross(arm) + 0.5 * period * gravity;
        add(body, {free.centre, poses.origin[body] + arm, velocity, poses.orientation[body], spin});
    }
    std::ranges::sort(ccd_bodies, {}, &CcdBody::body);
    cover_motions(ccd_bodies, period, s, boxes);
}

void find_times_of_impact(const ContactInputs& in, std::span<const CcdBody> ccd_bodies, std::vector<double>& pair_time_of_impact,
                          std::vector<double>& time_of_impact) {
    const BroadPhasePairs& pairs = in.pairs;
    time_of_impact.assign(ccd_bodies.empty() ? 0 : in.surfaces.bodies.mesh.size(), std::numeric_limits<double>::infinity());
    if (ccd_bodies.empty()) return;
    pair_time_of_impact.resize(pairs.a.size());
    parallel_for(static_cast<uint32_t>(pairs.a.size()), kFastPairsPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t pair = begin; pair < end; ++pair)
            pair_time_of_impact[pair] = time_of_impact_of(in, ccd_bodies, pairs.a[pair], pairs.b[pair]);
    });
    for (uint32_t pair = 0; pair < pairs.a.size(); ++pair) {
        if (!(pair_time_of_impact[pair] > 0)) continue;  // contact constraints handle it
        for (const uint32_t body : {pairs.a[pair], pairs.b[pair]})
            if (find_ccd_body(ccd_bodies, body)) time_of_impact[body] = std::min(time_of_impact[body], pair_time_of_impact[pair]);
    }
}

}  // namespace trocar
