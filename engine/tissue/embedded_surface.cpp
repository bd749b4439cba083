#include "engine/tissue/embedded_surface.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>

#include "engine/base/error.hpp"
#include "engine/distance/box_tree.hpp"
#include "engine/geometry/vec4.hpp"
#include "engine/jobs/parallel.hpp"
namespace trocar {
namespace {

using Tetrahedron = std::array<uint32_t, 4>;
constexpr uint32_t kVerticesPerChunk = 2048;
constexpr double kSliver = 1e-3;  // height of a triangle / its longest side; a round number

std::array<double, 4> weights_in(std::span<const Vec3d> node, const Tetrahedron& t, const Vec3d& p) {
    const Vec3d &o = node[t[0]], a = node[t[1]] - o, b = node[t[2]] - o, c = node[t[3]] - o, q = p - o;
    const double six = a.cross(b).dot(c);
    std::array<double, 4> w;
    w[1] = q.dot(b.cross(c)) / six;
    w[2] = q.dot(c.cross(a)) / six;
    w[3] = q.dot(a.cross(b)) / six;
    w[0] = 1 - w[1] - w[2] - w[3];
    return w;
}

// Upper bound on the distance of p from a tetrahedron: to the point with weights clamped at 0, sum 1.
double distance_outside(std::span<const Vec3d> node, const Tetrahedron& t, std::array<double, 4> w, const Vec3d& p) {
    double sum = 0;
    for (double& x : w) sum += x = std::max(x, 0.0);
    Vec3d q = Vec3d::Zero();
    for (int k = 0; k < 4; ++k) q += w[k] / sum * node[t[k]];
    return (q - p).norm();
}

FloatBox box_of(std::span<const Vec3d> node, const Tetrahedron& t) {
    FloatBox box;
    clear(box);
    for (const uint32_t corner : t) {
        FloatBox at{};
        for (int k = 0; k < 3; ++k) {
            at.min[k] = std::nextafter(static_cast<float>(node[corner][k]), -INFINITY);
            at.max[k] = std::nextafter(static_cast<float>(node[corner][k]), INFINITY);
        }
        grow(box, at);
    }
    return box;
}

// Squared distance of p to a triangle (Ericson, "Real-time collision detection", 2005, 5.1.5).
double distance_to_triangle(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    const Vec3d ab = b - a, ac = c - a, normal = ab.cross(ac);
    const double area2 = normal.squaredNorm();
    const double v = normal.dot((p - a).cross(ac)), w = normal.dot(ab.cross(p - a));
    if (area2 > 0 && v >= 0 && w >= 0 && v + w <= area2) return std::pow(normal.dot(p - a), 2) / area2;
    const auto to_edge = [&](const Vec3d& from, const Vec3d& segment) {
        const double length2 = segment.squaredNorm(), along = length2 > 0 ? std::clamp(segment.dot(p - from) / length2, 0.0, 1.0) : 0.0;
        return (from + along * segment - p).squaredNorm();
    };
    return std::min({to_edge(a, ab), to_edge(a, ac), to_edge(b, c - b)});
}

uint32_t farthest_from_plane(std::span<const Vec3d> node, const Triangle& t) {
    const Vec3d normal = (node[t[1]] - node[t[0]]).cross(node[t[2]] - node[t[0]]);
    uint32_t best = t[0];
    double most = 0;
    for (uint32_t i = 0; i < node.size(); ++i) {
        const double height = std::abs(normal.dot(node[i] - node[t[0]]));
        if (height > most) most = height, best = i;
    }
    return best;
}

// Weights of a point on a triangle and its apex. If all nodes are coplanar the point must be in their plane.
void add_binding(const Vec3d& p, std::span<const Vec3d> node, const Triangle& t, uint32_t apex, SurfaceEmbedding& skin) {
    const Vec3d &a = node[t[0]], ab = node[t[1]] - a, ac = node[t[2]] - a, normal = ab.cross(ac), far = node[apex] - a;
    const double height = normal.dot(p - a), most = normal.dot(far), edge = std::sqrt(std::max(ab.squaredNorm(), ac.squaredNorm()));
    const bool flat = std::abs(most) <= 1e-9 * normal.norm() * edge;
    const double share = flat ? 0 : height / most;
    if (std::abs(share) > 0.5 || (flat && std::abs(height) > 1e-6 * normal.norm() * edge))
        throw InputError("the surface that is simulated is too coarse for the skin that rides on it; take finer cells");
    const Vec3d in_plane = p - a - share * far;
    const double area2 = normal.squaredNorm(), v = normal.dot(in_plane.cross(ac)) / area2, w = normal.dot(ab.cross(in_plane)) / area2;
    skin.node.push_back({t[0], t[1], t[2], flat ? t[0] : apex});
    skin.weight.push_back({1 - v - w - share, v, w, share});
}

}  // namespace

SurfaceEmbedding bind_skin(std::span<const Vec3d> point, std::span<const Vec3d> node, std::span<const Tetrahedron> tetrahedra) {
    std::vector<FloatBox> boxes;
    double longest2 = 0;
    for (const Tetrahedron& t : tetrahedra) {
        boxes.push_back(box_of(node, t));
        for (int i = 0; i < 4; ++i) {
            for (int j = 0; j < i; ++j) longest2 = std::max(longest2, (node[t[i]] - node[t[j]]).squaredNorm());
        }
    }
    BoxTree tree;
    build_box_tree(boxes, tree);
    SurfaceEmbedding skin;
    skin.node.resize(point.size());
    skin.weight.resize(point.size());
    for (size_t v = 0; v < point.size(); ++v) {
        const float q[3] = {static_cast<float>(point[v].x()), static_cast<float>(point[v].y()), static_cast<float>(point[v].z())};
        uint32_t best = kNone;
        double most = -INFINITY;
        const auto search = [&](double limit) {
            visit_near_boxes(tree, q, static_cast<float>(limit), [&](uint32_t t) {
                const auto w = weights_in(node, tetrahedra[t], point[v]);
                const double least = *std::min_element(w.begin(), w.end());
                if (least > most || (least == most && t < best)) most = least, best = t, skin.weight[v] = w;
                return static_cast<float>(limit);
            });
        };
        search(1e-12 * longest2);
        if (most < 0) search(0.25 * longest2);
        if (best == kNone) search(4 * longest2);
        const double out = best == kNone ? INFINITY : most < 0 ? distance_outside(node, tetrahedra[best], skin.weight[v], point[v]) : 0;
        if (!(out * out <= longest2)) {
            char text[200];
            std::snprintf(text, sizeof text,
                          "vertex %zu of the skin lies more than an edge of the tetrahedra (%.3g m) outside them: a part thinner than the "
                          "lattice; take finer cells",
                          v, std::sqrt(longest2));
            throw InputError(text);
        }
        skin.outside = std::max(skin.outside, out);
        skin.node[v] = tetrahedra[best];
    }
    return skin;
}

SurfaceEmbedding bind_to_surface(std::span<const Vec3d> point, std::span<const Vec3d> node, std::span<const Triangle> surface) {
    // what is bound to a sliver would move with a multiple of its corners' differences; the triangles beside it are as near
    std::vector<Triangle> triangle;
    std::ranges::copy_if(surface, std::back_inserter(triangle), [&](const Triangle& t) {
        const Vec3d ab = node[t[1]] - node[t[0]], ac = node[t[2]] - node[t[0]];
        return ab.cross(ac).norm() > kSliver * std::max({ab.squaredNorm(), ac.squaredNorm(), (ac - ab).squaredNorm()});
    });
    if (triangle.empty()) throw InputError("the surface that is simulated has no area for a skin to ride on");
    std::vector<FloatBox> boxes;
    double longest2 = 0;
    for (const Triangle& t : triangle) {
        boxes.push_back(box_of(node, {t[0], t[1], t[2], t[2]}));
        for (int k = 0; k < 3; ++k) longest2 = std::max(longest2, (node[t[k]] - node[t[(k + 1) % 3]]).squaredNorm());
    }
    BoxTree tree;
    build_box_tree(boxes, tree);
    std::vector<uint32_t> apex(triangle.size(), kNone);
    SurfaceEmbedding skin;
    for (size_t v = 0; v < point.size(); ++v) {
        const float q[3] = {static_cast<float>(point[v].x()), static_cast<float>(point[v].y()), static_cast<float>(point[v].z())};
        uint32_t best = kNone;
        double least = INFINITY;
        visit_near_boxes(tree, q, std::numeric_limits<float>::max(), [&](uint32_t t) {
            const double d2 = distance_to_triangle(point[v], node[triangle[t][0]], node[triangle[t][1]], node[triangle[t][2]]);
            if (d2 < least || (d2 == least && t < best)) least = d2, best = t;
            return std::nextafter(static_cast<float>(std::min(least * (1 + 1e-6), 1e30)), INFINITY);
        });
        if (apex[best] == kNone) apex[best] = farthest_from_plane(node, triangle[best]);
        skin.outside = std::max(skin.outside, std::sqrt(least));
        add_binding(point[v], node, triangle[best], apex[best], skin);
    }
    return skin;
}

void drape_skin(const Solids& solids, const Bodies& bodies, uint32_t body, Particles& particles) {
    const uint32_t prototype = bodies.mesh[body], before = embedded_count(solids, prototype);
    if (before == 0) return;
    const Range skin = solids.info[prototype].skin;
    const uint32_t first = bodies.particles[body].first, nodes = first + before;
    Float4* const offset = particles.offset.data();
    float *const velocity_x = particles.velocity_x.data(), *const velocity_y = particles.velocity_y.data(),
                 *const velocity_z = particles.velocity_z.data();
    parallel_for(skin.count, kVerticesPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t v = begin; v < end; ++v) {
            const auto& node = solids.embedding_node[skin.first + v];
            const auto& weight = solids.embedding_weight[skin.first + v];
            Vec4d position = {}, velocity = {};
            for (int k = 0; k < 4; ++k) {
                const uint32_t p = nodes + node[k];
                position += weight[k] * float_vec4(_mm_load_ps(&offset[p].x));
                velocity += weight[k] * make_vec4(velocity_x[p], velocity_y[p], velocity_z[p]);
            }
            offset[first + v] = {static_cast<float>(position[0]), static_cast<float>(position[1]), static_cast<float>(position[2]), 0.0f};
            velocity_x[first + v] = static_cast<float>(velocity[0]);
            velocity_y[first + v] = static_cast<float>(velocity[1]);
            velocity_z[first + v] = static_cast<float>(velocity[2]);
        }
    });
}

}  // namespace trocar
