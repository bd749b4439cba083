#include "engine/distance/first_touch.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/geometry/quaternion.hpp"
namespace trocar {
namespace {

struct SweepSearch {
    const RigidSweep& sweep;
    const ClosestPointTree& tree;
    double tolerance;  // m
    double best;       // s, later times are not needed

    Quat orientation_at(double t) const { return multiply(from_rotation_vector(t * sweep.spin), sweep.orientation); }
    Vec3d to_other(const Vec3d& p, double t) const {
        return sweep.position + t * sweep.velocity + rotate(orientation_at(t), p - sweep.pivot);
    }
    Vec3d to_mover(const Vec3d& p, double t) const {
        return sweep.pivot + rotate_back(orientation_at(t), p - sweep.position - t * sweep.velocity);
    }
    // Advances a sphere until it may touch or the time is too late. `point` gives its centre at a time.
    template <typename Point>
    bool advance(const Point& point, double radius, double speed, double& t) const {
        while (true) {
            const double reach = (best - t) * speed + radius + tolerance;
            const SurfacePoint near = tree.query(point(t), reach);
            if (near.triangle == kNone) return false;
            const double gap = std::abs(near.distance) - radius;
            if (gap <= tolerance) return true;
            if (!(speed > 0)) return false;
            t += gap / speed;
            if (!(t < best)) return false;
        }
    }
};

// Part of an edge of the mover, in its own frame, that is free until `time`.
struct Piece {
    Vec3d a, b;
    double time;
};

void sweep_edge(SweepSearch& s, const Vec3d& a, const Vec3d& b) {
    std::array<Piece, 64> stack;  // halving leaves one piece per level
    uint32_t count = 0;
    stack[count++] = {a, b, 0};
    while (count > 0) {
        Piece piece = stack[--count];
        if (!(piece.time < s.best)) continue;
        const Vec3d middle = 0.5 * (piece.a + piece.b);
        const double radius = 0.5 * (piece.b - piece.a).norm();
        const double arm = (middle - s.sweep.pivot).norm() + radius;
        const double speed = s.sweep.velocity.norm() + s.sweep.spin.norm() * arm;
        if (!s.advance([&](double t) { return s.to_other(middle, t); }, radius, speed, piece.time)) continue;
        if (radius <= s.tolerance || count + 2 > stack.size()) {
            s.best = piece.time;
            continue;
        }
        stack[count++] = {middle, piece.b, piece.time};
        stack[count++] = {piece.a, middle, piece.time};
    }
}

// Box of all positions of the mover, in the other's frame.
Box swept_box(const SweepSearch& s, const MeshView& mover, double seconds) {
    double arm = 0;
    for (const Vec3d& p : mover.position) arm = std::max(arm, (p - s.sweep.pivot).norm());
    const Vec3d end = s.sweep.position + seconds * s.sweep.velocity, reach = Vec3d::Constant(arm + s.tolerance);
    return {s.sweep.position.cwiseMin(end) - reach, s.sweep.position.cwiseMax(end) + reach};
}

}  // namespace

double first_touch(const MeshView& mover, const ClosestPointTree& mover_tree, const MeshView& other, const ClosestPointTree& other_tree,
                   const RigidSweep& sweep, double seconds, double tolerance) {
    const double beyond = std::nextafter(seconds, std::numeric_limits<double>::infinity());
    SweepSearch s{sweep, other_tree, tolerance, beyond};
    for (const auto& [v, w] : mover.edge) sweep_edge(s, mover.position[v], mover.position[w]);

    const Box box = swept_box(s, mover, seconds);
    SweepSearch back{sweep, mover_tree, tolerance, s.best};
    for (uint32_t v = 0; v < other.position.size(); ++v) {
        const Vec3d p = other_tree.vertex(v);
        if ((p.array() < box.min.array()).any() || (p.array() > box.max.array()).any()) continue;
        const double farthest = (p - sweep.position).norm() + seconds * sweep.velocity.norm();
        const double speed = sweep.velocity.norm() + sweep.spin.norm() * farthest;
        double t = 0;
        if (back.advance([&](double at) { return back.to_mover(p, at); }, 0, speed, t)) back.best = t;
    }
    return back.best < beyond ? back.best : std::numeric_limits<double>::infinity();
}

}  // namespace trocar
