#include "systems/constrain/edge_constraints.hpp"

#include <algorithm>
#include <cmath>

#include "engine/base/subspan.hpp"
#include "engine/contact/convex_pairs.hpp"
#include "engine/mesh/contact_kernels.hpp"
namespace trocar {
namespace {

constexpr double kSharp = 0.94;     // cosine of the dihedral angle of a sharp edge
constexpr double kParallel = 0.02;  // sine between edges that are left to vertex contacts
constexpr double kInCone = 0.02;    // sine tolerance of a normal cone
constexpr double kDeepest = 0.05;   // overlap in mean edges above which the edges have passed each other
constexpr double kMostTurn = 0.5;   // rad, in a period
constexpr double kRounding = 1.0 + 1e-9;

bool load_edge(const Surfaces& s, uint32_t body, uint32_t edge, SharpEdge& e) {
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
    const auto [v, w] = mesh.edge[edge];
    const auto sides = mesh.edge_triangle[edge];
    if (sides[1] == kNone) return false;
    const Vec3d start = mesh.position[v], direction = (mesh.position[w] - start).normalized();
    Vec3d across[2], normal[2];
    for (int k = 0; k < 2; ++k) {
        const Triangle& t = mesh.triangle[sides[k]];
        const uint32_t far_corner = t[0] != v && t[0] != w ? t[0] : t[1] != v && t[1] != w ? t[1] : t[2];
        const Vec3d to = mesh.position[far_corner] - start;
        across[k] = (to - direction.dot(to) * direction).normalized();
        normal[k] = (mesh.position[t[1]] - mesh.position[t[0]]).cross(mesh.position[t[2]] - mesh.position[t[0]]).normalized();
    }
    // the face bends away from the other's plane, so the edge is convex
    if (!(normal[0].dot(normal[1]) < kSharp && normal[0].dot(across[1]) < 0)) return false;
    e.vertex = mesh.edge[edge];
    e.a = vertex_position(s, body, v);
    e.b = vertex_position(s, body, w);
    for (int k = 0; k < 2; ++k) e.into[k] = direction_to_world(s, body, across[k]);
    e.triangle = sides[0];
    return true;
}

// Sharp edges of the triangles near the other body.
void collect_edges(const Surfaces& s, uint32_t body, std::span<const std::array<uint32_t, 2>> near, std::vector<uint32_t>& edges,
                   std::vector<SharpEdge>& sharp) {
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
    edges.clear();
    for (const auto& [triangle, nearest] : near) {
        for (const uint32_t edge : mesh.triangle_edge[triangle]) {
            if (mesh.edge_triangle[edge][0] == triangle || mesh.edge_triangle[edge][1] == triangle) edges.push_back(edge);
        }
    }
    std::sort(edges.begin(), edges.end());
    edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
    sharp.clear();
    SharpEdge e;
    for (const uint32_t edge : edges)
        if (load_edge(s, body, edge, e)) sharp.push_back(e);
}

// Closest points of two edges: parameters along them, direction from b to a, and distance.
struct Passing {
    double along_a, along_b, distance;
    Vec3d normal;
};
bool find_passing(const SharpEdge& a, const SharpEdge& b, double margin, double deepest, double turn, Passing& p) {
    const Vec3d u = a.b - a.a, v = b.b - b.a, across = u.cross(v), apart = a.a - b.a;
    const double size2 = across.squaredNorm();
    if (!(size2 > kParallel * kParallel * u.squaredNorm() * v.squaredNorm())) return false;
    // most edge pairs are far apart or miss each other's ends: the cheapest rejection first
    const double apart_across = across.dot(apart), farthest = kRounding * std::max(margin, deepest);
    if (apart_across * apart_across > farthest * farthest * size2) return false;
    p.along_a = -apart.cross(v).dot(across) / size2;
    p.along_b = -apart.cross(u).dot(across) / size2;
    if (!(p.along_a >= 0 && p.along_a <= 1 && p.along_b >= 0 && p.along_b <= 1)) return false;
    p.normal = across / std::sqrt(size2);
    const auto out_of_cones = [&](const Vec3d& n) {
        return std::max({b.into[0].dot(n), b.into[1].dot(n), -a.into[0].dot(n), -a.into[1].dot(n)});
    };
    if (out_of_cones(-p.normal) < out_of_cones(p.normal)) p.normal = -p.normal;
    const double out = out_of_cones(p.normal);
    if (!(out < kInCone + turn)) return false;
    // when the bodies have turned into contact, the normal is that of the face
    for (const Vec3d& into : {b.into[0], b.into[1], Vec3d(-a.into[0]), Vec3d(-a.into[1])})
        if (out >= kInCone && into.dot(p.normal) == out) p.normal = (p.normal - out * into).normalized();
    p.distance = p.normal.dot(out < kInCone ? apart : Vec3d(apart + p.along_a * u - p.along_b * v));
    return p.distance < margin && p.distance > -deepest;
}

// Appends the constraint of a's edge against b's, on a triangle adjacent to it, without a contact.
void append_edge_constraint(const Surfaces& s, const uint32_t (&body)[2], const SharpEdge& a, const SharpEdge& b, const Passing& p,
                            ContactConstraints& constraints) {
    const Triangle& corner = mesh_view(s.meshes, s.bodies.mesh[body[1]]).triangle[b.triangle];
    const float along_b = static_cast<float>(p.along_b);
    std::array<float, 3> weight{};
    for (int k = 0; k < 3; ++k) {
        if (corner[k] == b.vertex[0]) weight[k] = 1.0f - along_b;
        if (corner[k] == b.vertex[1]) weight[k] = along_b;
    }
    constraints.contact.push_back(kNone);
    constraints.body.push_back(body[0]);
    constraints.other.push_back(body[1]);
    constraints.vertex.push_back(a.vertex);
    constraints.along.push_back(static_cast<float>(p.along_a));
    constraints.third.push_back(kNone);
    constraints.across.push_back(0);
    constraints.triangle.push_back(corner);
    constraints.weight.push_back(weight);
    constraints.normal.push_back(rotate_back(s.poses.orientation[body[1]], p.normal));
    constraints.distance.push_back(p.distance);
    constraints.friction.push_back(static_cast<float>(std::max(s.bodies.tissue[body[0]].friction, s.bodies.tissue[body[1]].friction)));
    constraints.impulse.push_back(Vec3d::Zero());
}

}  // namespace

void add_edge_constraints(const ContactInputs& in, const CandidateTriangles& candidates, const Penetrations& penetrations,
                          EdgeConstraintsScratch& scratch, ContactConstraints& constraints) {
    const Surfaces& surfaces = in.surfaces;
    const Bodies& bodies = surfaces.bodies;
    if (bodies.rigid_mass.empty()) return;
    for (uint32_t pair = 0, overlap = 0; pair < in.pairs.a.size(); ++pair) {
        while (overlap < penetrations.pair.size() && penetrations.pair[overlap] < pair) ++overlap;
        if (overlap < penetrations.pair.size() && penetrations.pair[overlap] == pair && penetrations.saturated[overlap]) continue;
        const uint32_t body[2] = {in.pairs.a[pair], in.pairs.b[pair]};
        if (bodies.motion[body[0]] != Motion::kFree && bodies.motion[body[1]] != Motion::kFree) continue;
        if (is_deformable(bodies, body[0]) || is_deformable(bodies, body[1]) || touch_as_hulls(in, pair)) continue;
        for (int side = 0; side < 2; ++side) {
            const auto near = subspan(candidates.near, candidates.side[2 * pair + side]);
            collect_edges(surfaces, body[side], near, scratch.edge, scratch.sharp[side]);
        }
        const double margin = margin_between(in.boxes, body[0], body[1]);
        const auto mean_edge = [&](uint32_t b) { return surfaces.meshes.info[bodies.mesh[b]].mean_edge; };
        const double deepest = kDeepest * std::min(mean_edge(body[0]), mean_edge(body[1]));
        const Poses& poses = surfaces.poses;
        const auto radius = [&](uint32_t b) { return surfaces.meshes.info[bodies.mesh[b]].radius; };
        const double speed = (poses.velocity[body[0]] - poses.velocity[body[1]]).norm() / std::min(radius(body[0]), radius(body[1]));
        const double spin = poses.angular_velocity[body[0]].norm() + poses.angular_velocity[body[1]].norm();
        const double turn = std::min(kMostTurn, in.period * (speed + spin));
        Passing passing;
        for (const SharpEdge& a : scratch.sharp[0]) {
            for (const SharpEdge& b : scratch.sharp[1]) {
                if (!find_passing(a, b, margin, deepest, turn, passing)) continue;
                append_edge_constraint(surfaces, body, a, b, passing, constraints);
            }
        }
    }
}

}  // namespace trocar
