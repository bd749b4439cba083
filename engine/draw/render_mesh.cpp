#include "engine/draw/render_mesh.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>

namespace trocar {
namespace {

constexpr double kCreaseCosine = 0.766;  // 40 degrees
constexpr double kInsideTile = 0.08;     // m, of the texture on exposed faces

std::vector<Vec3d> face_normals(const MeshView& mesh) {
    std::vector<Vec3d> face(mesh.triangle.size());
    for (size_t t = 0; t < face.size(); ++t) {
        const Vec3d& a = mesh.position[mesh.triangle[t][0]];
        face[t] = (mesh.position[mesh.triangle[t][1]] - a).cross(mesh.position[mesh.triangle[t][2]] - a);
    }
    return face;
}

Vec3 corner_normal(const MeshView& mesh, const std::vector<Vec3d>& face, uint32_t triangle, uint32_t vertex) {
    const Vec3d& own = face[triangle];
    Vec3d sum = Vec3d::Zero();
    for (uint32_t i = mesh.incident_first[vertex]; i < mesh.incident_first[vertex + 1]; ++i) {
        const Vec3d& other = face[mesh.incident[i]];
        if (own.dot(other) >= kCreaseCosine * own.norm() * other.norm()) sum += other;
    }
    const double length = sum.norm();
    return length > 0 && std::isfinite(length) ? Vec3((sum / length).cast<float>()) : Vec3(Vec3::Zero());
}

bool same_bits(float a, float b) { return std::bit_cast<uint32_t>(a) == std::bit_cast<uint32_t>(b); }

bool same_vertex(const RenderMesh& out, uint32_t index, const Vec2& uv, const Vec3& normal, bool creases) {
    if (!same_bits(out.uv[index].u, uv.u) || !same_bits(out.uv[index].v, uv.v)) return false;
    if (!creases) return true;
    const Vec3& n = out.normal[index];
    return same_bits(n.x(), normal.x()) && same_bits(n.y(), normal.y()) && same_bits(n.z(), normal.z());
}

// triangles in order of material, stable
std::vector<uint32_t> order_by_material(const MeshView& mesh) {
    std::vector<uint32_t> order(mesh.triangle.size());
    for (uint32_t t = 0; t < order.size(); ++t) order[t] = t;
    std::stable_sort(order.begin(), order.end(),
                     [&](uint32_t a, uint32_t b) { return mesh.triangle_material[a] < mesh.triangle_material[b]; });
    return order;
}

}  // namespace

RenderMesh split_vertices(const MeshView& mesh, bool creases) {
    RenderMesh out;
    const std::vector<Vec3d> face = creases ? face_normals(mesh) : std::vector<Vec3d>();
    std::vector<uint32_t> newest(mesh.position.size(), kNone);  // vertex -> last element made of it
    std::vector<uint32_t> older;                                // element -> the one made before it
    for (const uint32_t t : order_by_material(mesh)) {
        if (out.groups.empty() || out.groups.back().material != mesh.triangle_material[t])
            out.groups.push_back({mesh.triangle_material[t], static_cast<uint32_t>(out.index.size()), 0});
        for (uint32_t k = 0; k < 3; ++k) {
            const uint32_t vertex = mesh.triangle[t][k];
            const Vec2 uv{mesh.uv[t][k].u, 1.0f - mesh.uv[t][k].v};
            const Vec3 normal = creases ? corner_normal(mesh, face, t, vertex) : Vec3(Vec3::Zero());
            uint32_t index = newest[vertex];
            while (index != kNone && !same_vertex(out, index, uv, normal, creases)) index = older[index];
            if (index == kNone) {
                index = static_cast<uint32_t>(out.source.size());
                out.source.push_back(vertex);
                out.uv.push_back(uv);
                if (creases) out.normal.push_back(normal);
                older.push_back(newest[vertex]);
                newest[vertex] = index;
            }
            out.index.push_back(index);
        }
        out.groups.back().count += 3;
    }
    if (!creases) out.inside = newest;
    if (!creases && std::find(newest.begin(), newest.end(), kNone) != newest.end()) {
        for (uint32_t v = 0; v < mesh.position.size(); ++v) {
            out.inside[v] = static_cast<uint32_t>(out.source.size());
            out.source.push_back(v);
            out.uv.push_back(
                {static_cast<float>(mesh.position[v].x() / kInsideTile), static_cast<float>(mesh.position[v].y() / kInsideTile)});
        }
    }
    for (const auto& edge : mesh.edge)
        if (newest[edge[0]] != kNone && newest[edge[1]] != kNone) out.line.insert(out.line.end(), {newest[edge[0]], newest[edge[1]]});
    return out;
}

}  // namespace trocar
