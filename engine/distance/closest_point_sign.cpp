#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <numbers>

#include "engine/distance/closest_point_impl.hpp"
#include "engine/geometry/edge_table.hpp"
namespace trocar {

// Whether every edge is used equally often in both directions: then rays count the winding number exactly.
bool ClosestPointTree::Impl::is_closed() const {
    if (admission != Admission::kWinding) return admission == Admission::kSolid;
    const EdgeTable table = make_edge_table(mesh.triangle, static_cast<uint32_t>(mesh.position.size()));
    for (uint32_t e = 0; e < table.edge.size(); ++e) {
        int balance = 0;
        for (const uint32_t h : table.users(e)) balance += half_edge_start(mesh.triangle, h) == table.edge[e][0] ? 1 : -1;
        if (balance != 0) return false;
    }
    return true;
}

void ClosestPointTree::Impl::update_clusters() {
    if (admission != Admission::kWinding || closed) return;
    clusters.box.resize(boxes.size());
    for (uint32_t m = 0; m < boxes.size(); ++m) {
        std::array<std::array<Vec3d, 3>, 16> corner;
        const uint32_t count = triangles_of(m);
        for (uint32_t j = 0; j < count; ++j)
            for (int k = 0; k < 3; ++k) corner[j][k] = position(lanes[16 * m + j].vertex[k]);
        clusters.box[m] = winding_cluster(std::span(corner).first(count));
    }
    join_winding_tree(tree, clusters);
}

bool ClosestPointTree::Impl::winds_around(const Vec3d& p) const {
    int windings;
    if (closed) return count_windings_ahead(p, windings) && windings > 0;  // on the surface: not inside
    constexpr double kRounding = 1e-6;                                     // of either sum, far above measured rounding
    const auto near = [&](uint32_t m) {
        double half_angles = 0;
        for (uint32_t j = 0; j < triangles_of(m); ++j) {
            const Triangle& v = lanes[16 * m + j].vertex;
            half_angles += half_solid_angle(position(v[0]), position(v[1]), position(v[2]), p);
        }
        return half_angles / (2 * std::numbers::pi);
    };
    if (!clusters.node.empty()) {
        for (const double tolerance : {1e-2, 1e-4}) {
            const FarField sum = sum_winding(tree, clusters, p, tolerance, near);
            if (std::abs(sum.value - 0.5) > sum.error + kRounding) return sum.value > 0.5;
        }
    }
    return winding(p) > 0.5;
}

// Exact winding number about p of a closed, possibly self-intersecting surface, from the faces that the ray
// towards +x may cross. False if p lies on one of them.
bool ClosestPointTree::Impl::count_windings_ahead(const Vec3d& p, int& windings) const {
    windings = 0;
    // rounding is monotonic: faces ahead of p stay ahead in the local frame; boxes are rounded outward
    const Vec3d q = (p - centre) * scale;
    uint32_t stack[kBoxStack];
    uint32_t height = 0;
    if (!tree.node.empty()) stack[height++] = 0;
    while (height > 0) {
        const BoxNode& n = tree.node[stack[--height]];
        for (uint32_t i = 0; i < n.count; ++i) {
            if (!(n.high[0][i] >= q.x() && n.low[1][i] <= q.y() && n.high[1][i] >= q.y() && n.low[2][i] <= q.z() && n.high[2][i] >= q.z()))
                continue;
            if (n.child[i] < kBoxLeaf) {
                stack[height++] = n.child[i];
                continue;
            }
            const uint32_t m = n.child[i] & ~kBoxLeaf;
            for (uint32_t j = 0; j < triangles_of(m); ++j) {
                const Triangle& v = lanes[16 * m + j].vertex;
                if (!count_winding(position(v[0]), position(v[1]), position(v[2]), p, windings)) return false;
            }
        }
    }
    return true;
}

// No point outside the box is inside the surface.
bool ClosestPointTree::Impl::outside_box(const Vec3d& p) const {
    const Vec3d q = (p - centre) * scale;
    bool outside = false;
    for (int k = 0; k < 3; ++k) outside |= q[k] < box.min[k] || q[k] > box.max[k];
    return outside;
}

// Pseudonormal of the winning feature and the sum of its weights. False if undefined: a face has no area, or
// the contributions cancel.
bool ClosestPointTree::Impl::pseudonormal(const Winner& winner, Vec3d& normal, double& weight) const {
    const Feature feature = winner.closest.feature;
    bool defined = true;
    const auto add = [&](const Vec3d& n, double w) {
        const double length = n.norm();
        defined &= length > 0;
        if (!(length > 0)) return;
        normal += (w / length) * n;
        weight += w;
    };
    normal.setZero();
    weight = 0;
    if (feature >= Feature::kEdge0) {
        add(normal_of(lanes[winner.lane].vertex), 1);
        if (feature == Feature::kFace) return defined;
        const int k = static_cast<int>(feature) - static_cast<int>(Feature::kEdge0);
        const uint32_t other = mesh.neighbour[winner.triangle][k];
        if (other != kNone) add(normal_of(mesh.triangle[other]), 1);
    } else {
        for_each_in_fan(winner, [&](const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& n) {
            add(n, std::atan2(n.norm(), (b - a).dot(c - a)));
        });
    }
    return defined && normal.squaredNorm() > 1e-28 * weight * weight;
}

// Side of p if all faces around the winning vertex agree, else 0: avoids computing angles for most vertices.
double ClosestPointTree::Impl::side_of_fan(const Winner& winner, double rounding) const {
    bool outside = true, inside = true;
    for_each_in_fan(winner, [&](const Vec3d&, const Vec3d&, const Vec3d&, const Vec3d& n) {
        const double height = -winner.closest.offset.dot(n), limit = rounding * n.norm();
        outside &= height > limit;
        inside &= height < -limit;
    });
    return outside ? 1 : inside ? -1 : 0;
}

SurfacePoint ClosestPointTree::Impl::answer(const Vec3d& p, double radius, const Winner& winner) const {
    SurfacePoint out;
    if (winner.triangle == kNone) return out;
    const TrianglePoint& closest = winner.closest;
    const double d = std::sqrt(closest.squared_distance);
    if (!(d <= radius)) return out;
    out.point = p + closest.offset;
    out.triangle = winner.triangle;
    out.feature = closest.feature;
    const bool is_signed = has_inside(admission);

    Vec3d direction = Vec3d::Zero();
    const double side = side_of(p, winner, d, direction);
    out.distance = is_signed ? side * d : d;
    out.normal = is_signed ? Vec3d(side * direction) : direction;
    return out;
}

// Side of the surface that p is on: +1 outside, -1 inside. `direction` becomes the unit direction from the
// surface to p; on it, side * pseudonormal. For sheets (no inside) the side matters only on the surface.
double ClosestPointTree::Impl::side_of(const Vec3d& p, const Winner& winner, double d, Vec3d& direction) const {
    const TrianglePoint& closest = winner.closest;
    const auto by_winding = [&] { return winds_around(p) ? -1.0 : 1.0; };
    const bool boxed_out = outside_box(p);
    // Rounding may hide the side from points nearer than this, and where two faces of a sharp edge are equally near.
    const bool at_border = closest.feature == Feature::kFace && closest.border < 1e-4;
    const bool doubtful = closed && !boxed_out && (at_border || d * scale < 0x1p-30);
    if (closest.feature == Feature::kFace) {
        const double side = closest.height < 0 ? -1.0 : 1.0;
        // the offset is exactly a multiple of the normal, however short
        direction = d > 0 ? Vec3d(-closest.offset / d) : normal_of(lanes[winner.lane].vertex).normalized();
        if (boxed_out) return 1;
        return doubtful || (admission == Admission::kWinding && d > 0) ? by_winding() : side;
    }
    // below its rounding the offset has no meaningful direction
    double reach2 = 0;
    for (const uint32_t v : lanes[winner.lane].vertex) reach2 = std::max(reach2, (position(v) - p).squaredNorm());
    const double rounding = 0x1p-49 * std::sqrt(reach2);
    const bool on_surface = d <= rounding;
    if (!on_surface) {
        direction = -closest.offset / d;
        if (boxed_out || admission == Admission::kSheet || admission == Admission::kRefused) return 1;
        if (doubtful || admission == Admission::kWinding) return by_winding();
        if (closest.feature < Feature::kEdge0)
            if (const double side = side_of_fan(winner, rounding); side != 0) return side;
    }
    Vec3d sum;
    double weight;
    const bool defined = pseudonormal(winner, sum, weight);
    const double dot = -closest.offset.dot(sum);
    const double side = doubtful ? by_winding() : dot < 0 ? -1.0 : 1.0;
    if (on_surface) {
        direction = side * (sum.squaredNorm() > 0 ? sum.normalized() : Vec3d::UnitX().eval());
        return side;
    }
    return defined && std::abs(dot) > rounding * weight ? side : by_winding();
}

// Within a distance's rounding of the surface both signs may be right.
bool ClosestPointTree::Impl::disagrees(const Vec3d& p, const SurfacePoint& found) const {
    const double rounding = 0x1p-49 * (p - centre).norm() + 0x1p-48 / scale;
    if (found.triangle == kNone || !(std::abs(found.distance) > rounding)) return false;
    return winds_around(p) != (found.distance < 0);
}

}  // namespace trocar
