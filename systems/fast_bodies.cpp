#include "systems/fast_bodies.hpp"

#include <algorithm>
#include <limits>

namespace trocar {
namespace {

const FastBody* find_fast(std::span<const FastBody> fast, uint32_t body) {
    const auto at = std::find_if(fast.begin(), fast.end(), [&](const FastBody& f) { return f.body == body; });
    return at != fast.end() ? &*at : nullptr;
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

}  // namespace

void cover_fast_ways(std::span<const FastBody> fast, double seconds, const Surfaces& surfaces, BodyBoxes& boxes) {
    for (const FastBody& f : fast) {
        const double arm = surfaces.meshes.info[surfaces.bodies.mesh[f.body]].radius + f.sweep.pivot.norm();
        const Vec3d reach = Vec3d::Constant(arm + boxes.margin[f.body]);
        const Vec3d end = f.sweep.place + seconds * f.sweep.velocity;
        Box& box = boxes.box[f.body];
        box.min = box.min.cwiseMin(f.sweep.place.cwiseMin(end) - reach);
        box.max = box.max.cwiseMax(f.sweep.place.cwiseMax(end) + reach);
    }
}

void find_stops(double tolerance, std::span<const FastBody> fast, double seconds, const Surfaces& surfaces,
                const CandidatePairs& pairs, std::span<const std::unique_ptr<ClosestPointTree>> trees,
                std::vector<double>& stop) {
    const Bodies& bodies = surfaces.bodies;
    stop.assign(fast.empty() ? 0 : bodies.mesh.size(), std::numeric_limits<double>::infinity());
    if (fast.empty()) return;
    for (uint32_t pair = 0; pair < pairs.a.size(); ++pair) {
        uint32_t mover = pairs.a[pair], other = pairs.b[pair];
        const FastBody* own = find_fast(fast, mover);
        if (own == nullptr) {
            std::swap(mover, other);
            own = find_fast(fast, mover);
        }
        if (own == nullptr) continue;
        // tissue gives way to a hand: held at its surface, the tool would stay far behind the hand, and the hand feel nothing
        if (bodies.motion[mover] == Motion::kHand && is_deformable(bodies, other)) continue;
        const FastBody* second = find_fast(fast, other);
        Vec3d velocity = Vec3d::Zero();
        if (second != nullptr) {
            velocity = second->sweep.velocity;
        } else if (!is_deformable(bodies, other)) {
            velocity = surfaces.poses.velocity[other];
        }
        const double touch = first_touch(mesh_view(surfaces.meshes, bodies.mesh[mover]), *trees[bodies.tree[mover]],
                                         mesh_view(surfaces.meshes, bodies.mesh[other]), *trees[bodies.tree[other]],
                                         seen_from(surfaces, other, own->sweep, velocity), seconds,
                                         tolerance + 0.5 * bodies.thickness[other]);
        if (!(touch > 0)) continue;  // contact rows have it
        stop[mover] = std::min(stop[mover], touch);
        if (second != nullptr) stop[other] = std::min(stop[other], touch);
    }
}

}  // namespace trocar
