#include "engine/mesh/convex_hull.hpp"

#include <algorithm>
#include <limits>
#include <map>
#include <numeric>
#include <span>

#include "engine/base/disjoint_sets.hpp"
#include "engine/mesh/mesh_view.hpp"
namespace trocar {
namespace {

Vec3d twice_area(const MeshView& mesh, uint32_t triangle) {
    const auto [a, b, c] = mesh.triangle[triangle];
    return (mesh.position[b] - mesh.position[a]).cross(mesh.position[c] - mesh.position[a]);
}

// Whether the surface bends nowhere inward: a closed connected surface is then convex (van Heijenoort 1952). Joins triangles in one plane.
bool join_coplanar(const MeshView& mesh, double tolerance, std::vector<uint32_t>& face_of) {
    face_of.resize(mesh.triangle.size());
    std::iota(face_of.begin(), face_of.end(), 0u);
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
        const Vec3d normal = twice_area(mesh, t).normalized();
        for (const uint32_t neighbour : mesh.neighbour[t]) {
            if (neighbour == kNone) return false;
            double highest = 0, lowest = 0;
            for (const uint32_t v : mesh.triangle[neighbour]) {
                const double height = normal.dot(mesh.position[v] - mesh.position[mesh.triangle[t][0]]);
                highest = std::max(highest, height), lowest = std::min(lowest, height);
            }
            if (!(highest <= tolerance)) return false;
            if (lowest >= -tolerance && normal.dot(twice_area(mesh, neighbour)) > 0) join_sets(face_of, t, neighbour);
        }
    }
    for (uint32_t t = 0; t < face_of.size(); ++t) face_of[t] = find_set(face_of, t);
    return true;
}

// The faces' planes, and how many faces meet at each vertex. False if there are too many.
bool find_planes(const MeshView& mesh, std::vector<uint32_t>& face_of, std::vector<uint32_t>& faces_at, ConvexHull& hull) {
    std::vector<uint32_t> number(face_of.size(), kNone);
    for (uint32_t t = 0; t < face_of.size(); ++t) {
        uint32_t& n = number[face_of[t]];
        if (n == kNone) {
            n = uint32_t(hull.face.size());
            hull.face.push_back({});
            hull.face.back().triangle = t;
            if (n == kMostHullFaces) return false;
        }
        face_of[t] = n;
        hull.face[n].normal += twice_area(mesh, t);
    }
    for (HullFace& face : hull.face) {
        if (!(face.normal.norm() > 0)) return false;
        face.normal.normalize();
        face.offset = -std::numeric_limits<double>::infinity();
    }
    for (uint32_t t = 0; t < face_of.size(); ++t)
        for (const uint32_t v : mesh.triangle[t]) {
            HullFace& face = hull.face[face_of[t]];
            face.offset = std::max(face.offset, face.normal.dot(mesh.position[v]));
        }
    faces_at.assign(mesh.position.size(), 0);
    std::vector<uint32_t> here;
    for (uint32_t v = 0; v < mesh.position.size(); ++v) {
        here.clear();
        for (uint32_t k = mesh.incident_first[v]; k < mesh.incident_first[v + 1]; ++k) here.push_back(face_of[mesh.incident[k]]);
        std::ranges::sort(here);
        faces_at[v] = uint32_t(std::unique(here.begin(), here.end()) - here.begin());
    }
    return true;
}

// The outline of a face: a loop through the vertices where three faces or more meet. False if it is not one loop.
bool trace_outline(const MeshView& mesh, std::span<const uint32_t> face_of, std::span<const uint32_t> faces_at,
                   std::span<const uint32_t> triangles, std::vector<uint32_t>& index_of, ConvexHull& hull) {
    std::map<uint32_t, uint32_t> next;  // start to end of the directed edges around the face
    for (const uint32_t t : triangles)
        for (int k = 0; k < 3; ++k)
            if (face_of[mesh.neighbour[t][k]] != face_of[t] && !next.emplace(mesh.triangle[t][k], mesh.triangle[t][(k + 1) % 3]).second)
                return false;
    Range& corners = hull.face[face_of[triangles[0]]].corners;
    corners = {uint32_t(hull.corner.size()), 0};
    if (next.empty()) return false;
    uint32_t v = next.begin()->first;
    for (size_t k = 0; k < next.size(); ++k) {
        if (faces_at[v] >= 3) {
            if (index_of[v] == kNone) {
                index_of[v] = uint32_t(hull.point.size());
                hull.point.push_back(mesh.position[v]);
                hull.vertex.push_back(v);
            }
            hull.corner.push_back(index_of[v]);
            ++corners.count;
        }
        const auto at = next.find(v);
        if (at == next.end()) return false;
        v = at->second;
    }
    return v == next.begin()->first && corners.count >= 3;
}

// Edges between the corners, each of two faces, and the faces around points. False if an edge has another number of faces.
bool join_faces(ConvexHull& hull) {
    std::map<std::array<uint32_t, 2>, uint32_t> edges;
    std::vector<std::vector<uint32_t>> around(hull.point.size());
    for (uint32_t f = 0; f < hull.face.size(); ++f) {
        const Range corners = hull.face[f].corners;
        for (uint32_t k = 0; k < corners.count; ++k) {
            const uint32_t a = hull.corner[corners.first + k], b = hull.corner[corners.first + (k + 1) % corners.count];
            around[a].push_back(f);
            const auto [at, is_new] = edges.emplace(std::array{std::min(a, b), std::max(a, b)}, uint32_t(hull.edge.size()));
            if (is_new) {
                hull.edge.push_back({at->first, {f, kNone}, 1});
            } else {
                HullEdge& edge = hull.edge[at->second];
                if (edge.faces[1] != kNone) return false;
                edge.faces[1] = f;
                edge.cosine = hull.face[edge.faces[0]].normal.dot(hull.face[f].normal);
            }
        }
    }
    hull.around_first.assign(1, 0);
    for (const auto& faces : around) {
        hull.around.insert(hull.around.end(), faces.begin(), faces.end());
        hull.around_first.push_back(uint32_t(hull.around.size()));
    }
    return std::ranges::none_of(hull.edge, [](const HullEdge& edge) { return edge.faces[1] == kNone; });
}

// Whether every vertex of the mesh lies within the tolerance below every plane, and those of a face on its own.
bool fits(const MeshView& mesh, std::span<const uint32_t> face_of, double tolerance, const ConvexHull& hull) {
    for (uint32_t t = 0; t < face_of.size(); ++t) {
        const HullFace& face = hull.face[face_of[t]];
        for (const uint32_t v : mesh.triangle[t])
            if (!(face.normal.dot(mesh.position[v]) >= face.offset - tolerance)) return false;
    }
    return std::ranges::all_of(hull.face, [&](const HullFace& face) {
        return std::ranges::all_of(hull.point, [&](const Vec3d& p) { return face.normal.dot(p) <= face.offset + tolerance; });
    });
}

}  // namespace

bool make_convex_hull(const Meshes& meshes, uint32_t prototype, ConvexHull& hull) {
    const MeshView mesh = mesh_view(meshes, prototype);
    hull = {};
    hull.mesh = prototype;
    hull.radius = mesh.info->radius;
    if (mesh.info->admission != Admission::kSolid || mesh.info->components != 1 || mesh.triangle.size() < 4) return false;
    const double tolerance = kConvexTolerance * mesh.info->radius;
    std::vector<uint32_t> face_of, faces_at;
    if (!join_coplanar(mesh, tolerance, face_of) || !find_planes(mesh, face_of, faces_at, hull)) return false;
    std::vector<std::vector<uint32_t>> triangles(hull.face.size());
    for (uint32_t t = 0; t < face_of.size(); ++t) triangles[face_of[t]].push_back(t);
    std::vector<uint32_t> index_of(mesh.position.size(), kNone);
    for (const auto& of_face : triangles)
        if (!trace_outline(mesh, face_of, faces_at, of_face, index_of, hull)) return false;
    if (!join_faces(hull) || !fits(mesh, face_of, tolerance, hull)) return false;
    for (const Vec3d& p : hull.point) hull.centre += p / double(hull.point.size());
    return true;
}

ConvexHulls make_convex_hulls(const Meshes& meshes, const Bodies& bodies) {
    ConvexHulls hulls;
    if (bodies.rigid_mass.empty()) return hulls;
    std::vector<uint8_t> is_rigid(meshes.info.size(), 0);
    for (uint32_t body = 0; body < bodies.mesh.size(); ++body) is_rigid[bodies.mesh[body]] |= bodies.motion[body] != Motion::kDeformable;
    hulls.of_mesh.assign(meshes.info.size(), kNone);
    // of several points that hit at once, four would lose some percent of what bodies that bounce must keep
    for (uint32_t body = 0; body < bodies.mesh.size(); ++body)
        if (bodies.tissue[body].restitution > 0) is_rigid[bodies.mesh[body]] = 0;
    ConvexHull hull;
    for (uint32_t mesh = 0; mesh < meshes.info.size(); ++mesh) {
        if (!is_rigid[mesh] || !make_convex_hull(meshes, mesh, hull)) continue;
        hulls.of_mesh[mesh] = uint32_t(hulls.hull.size());
        hulls.hull.push_back(std::move(hull));
    }
    return hulls;
}

}  // namespace trocar
