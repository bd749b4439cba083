#include "bench/contact/surface_depth.hpp"

#include <algorithm>
#include <cmath>
#include <queue>
namespace trocar::bench {
namespace {

using test::ContactScene;

struct Piece {
    double most;  // upper bound of the depth in it
    std::array<Vec3d, 3> corner;
    uint32_t other;
    bool operator<(const Piece& p) const { return most < p.most; }
};

double depth_at(const ContactScene& scene, uint32_t other, const Vec3d& p) {
    return -scene.trees[other]->query(world_to_frame(scene.surfaces(), other, p)).distance;
}

Box box_of_body(const ContactScene& scene, uint32_t body) {
    Box box;
    for (uint32_t v = 0; v < mesh_view(scene.meshes, scene.bodies.mesh[body]).position.size(); ++v) {
        const Vec3d p = vertex_position(scene.surfaces(), body, v);
        box.min = box.min.cwiseMin(p);
        box.max = box.max.cwiseMax(p);
    }
    return box;
}

// Calls take(corners, other) for every triangle that overlaps the other body's box.
template <typename Take>
void for_near_triangles(const ContactScene& scene, const Take& take) {
    for (uint32_t body = 0; body < 2; ++body) {
        const Box across = box_of_body(scene, 1 - body);
        std::vector<Vec3d> position;
        const MeshView mesh = mesh_view(scene.meshes, scene.bodies.mesh[body]);
        for (uint32_t v = 0; v < mesh.position.size(); ++v) position.push_back(vertex_position(scene.surfaces(), body, v));
        for (const Triangle& t : mesh.triangle) {
            const std::array<Vec3d, 3> corner{position[t[0]], position[t[1]], position[t[2]]};
            const Box box{corner[0].cwiseMin(corner[1]).cwiseMin(corner[2]), corner[0].cwiseMax(corner[1]).cwiseMax(corner[2])};
            if (boxes_meet(box, across)) take(corner, 1 - body);
        }
    }
}

}  // namespace

DeepestPoint surface_depth(const ContactScene& scene, double tolerance, size_t most) {
    std::priority_queue<Piece> queue;
    DeepestPoint found;
    size_t looked = 0;
    const auto add = [&](const std::array<Vec3d, 3>& c, uint32_t other) {
        const Vec3d middle = (c[0] + c[1] + c[2]) / 3;
        const double depth = depth_at(scene, other, middle);
        const double radius = std::max({(c[0] - middle).norm(), (c[1] - middle).norm(), (c[2] - middle).norm()});
        found.depth = std::max(found.depth, depth);
        ++looked;
        if (depth + radius > found.depth + tolerance) queue.push({depth + radius, c, other});
    };
    for_near_triangles(scene, add);
    while (!queue.empty()) {
        const Piece piece = queue.top();
        queue.pop();
        found.slack = std::max(0.0, piece.most - found.depth);
        if (found.slack <= tolerance || looked > most) return found;
        const auto& c = piece.corner;
        for (const Vec3d& p : c) found.depth = std::max(found.depth, depth_at(scene, piece.other, p));
        const Vec3d ab = 0.5 * (c[0] + c[1]), bc = 0.5 * (c[1] + c[2]), ca = 0.5 * (c[2] + c[0]);
        add({c[0], ab, ca}, piece.other);
        add({ab, c[1], bc}, piece.other);
        add({ca, bc, c[2]}, piece.other);
        add({ab, bc, ca}, piece.other);
    }
    found.slack = tolerance;
    return found;
}

double sampled_depth(const ContactScene& scene, double tolerance) {
    std::array<std::vector<Vec3d>, 2> points;  // by queried body, in its frame
    for_near_triangles(scene, [&](const std::array<Vec3d, 3>& c, uint32_t other) {
        const double longest = std::max({(c[1] - c[0]).norm(), (c[2] - c[1]).norm(), (c[0] - c[2]).norm()});
        const int parts = std::max(1, int(std::ceil(longest / (std::sqrt(3.0) * tolerance))));
        for (int i = 0; i <= parts; ++i)
            for (int j = 0; i + j <= parts; ++j) {
                const Vec3d p = c[0] + (double(i) / parts) * (c[1] - c[0]) + (double(j) / parts) * (c[2] - c[0]);
                points[other].push_back(world_to_frame(scene.surfaces(), other, p));
            }
    });
    double depth = 0;
    for (uint32_t other = 0; other < 2; ++other) {
        std::vector<SurfacePoint> out(points[other].size());
        const std::vector<double> radius(out.size(), std::numeric_limits<double>::infinity());
        QueryCounters counters;
        scene.trees[other]->query(points[other], radius, {}, out, counters);
        for (const SurfacePoint& s : out) depth = std::max(depth, -s.distance);
    }
    return depth;
}

}  // namespace trocar::bench
