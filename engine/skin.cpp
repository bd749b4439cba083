#include "engine/skin.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "engine/box_tree.hpp"
#include "engine/error.hpp"
#include "engine/parallel.hpp"
namespace trocar {
namespace {

using Tetrahedron = std::array<uint32_t, 4>;
constexpr uint32_t kVerticesPerChunk = 2048;

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

// Bound of the distance of p to a tetrahedron: to its nearest point with weights cut at 0 and scaled to sum 1.
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

}  // namespace

SkinBinding bind_skin(std::span<const Vec3d> point, std::span<const Vec3d> node, std::span<const Tetrahedron> tetrahedra) {
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
    SkinBinding skin;
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
                          "vertex %zu of the skin lies more than an edge of the tetrahedra (%.3g m) outside them: a part thinner than the lattice; take finer cells",
                          v, std::sqrt(longest2));
            throw InputError(text);
        }
        skin.outside = std::max(skin.outside, out);
        skin.node[v] = tetrahedra[best];
    }
    return skin;
}

void drape_skin(const Solids& solids, const Bodies& bodies, uint32_t body, Particles& particles) {
    const uint32_t prototype = bodies.mesh[body], before = skin_rows(solids, prototype);
    if (before == 0) return;
    const Range skin = solids.info[prototype].skin;
    const uint32_t first = bodies.particles[body].first, nodes = first + before;
    parallel_for(skin.count, kVerticesPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t v = begin; v < end; ++v) {
            const auto& node = solids.skin_node[skin.first + v];
            const auto& weight = solids.skin_weight[skin.first + v];
            Vec3d place = Vec3d::Zero(), velocity = Vec3d::Zero();
            for (int k = 0; k < 4; ++k) {
                const uint32_t p = nodes + node[k];
                const Float4& o = particles.offset[p];
                place += weight[k] * Vec3d(o.x, o.y, o.z);
                velocity += weight[k] * Vec3d(particles.velocity_x[p], particles.velocity_y[p], particles.velocity_z[p]);
            }
            const Vec3 at = place.cast<float>(), speed = velocity.cast<float>();
            particles.offset[first + v] = {at.x(), at.y(), at.z(), 0.0f};
            particles.velocity_x[first + v] = speed.x();
            particles.velocity_y[first + v] = speed.y();
            particles.velocity_z[first + v] = speed.z();
        }
    });
}

}  // namespace trocar
