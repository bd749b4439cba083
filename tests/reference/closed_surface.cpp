#include "tests/reference/closed_surface.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <set>
namespace trocar::reference {
namespace {

uint32_t find_root(std::vector<uint32_t>& parent, uint32_t row) {
    while (parent[row] != row) row = parent[row] = parent[parent[row]];
    return row;
}

double corner_angle(const Vec3d& at, const Vec3d& a, const Vec3d& b) {
    return std::atan2((a - at).cross(b - at).norm(), (a - at).dot(b - at)) * 180 / M_PI;
}

double volume_of(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) { return (b - a).cross(c - a).dot(d - a); }

bool segment_cuts(const Vec3d& p, const Vec3d& q, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    const double sp = volume_of(a, b, c, p);
    const double sq = volume_of(a, b, c, q);
    if ((sp > 0) == (sq > 0)) return false;
    const double s0 = volume_of(p, q, a, b);
    const double s1 = volume_of(p, q, b, c);
    const double s2 = volume_of(p, q, c, a);
    return (s0 > 0 && s1 > 0 && s2 > 0) || (s0 < 0 && s1 < 0 && s2 < 0);
}

bool triangles_cross(const Mesh& mesh, const Triangle& s, const Triangle& t) {
    const auto& p = mesh.position;
    const auto shares = [](const Triangle& of, uint32_t v) { return v == of[0] || v == of[1] || v == of[2]; };
    for (int k = 0; k < 3; ++k) {
        const uint32_t s0 = s[k], s1 = s[(k + 1) % 3];
        const uint32_t t0 = t[k], t1 = t[(k + 1) % 3];
        if (!shares(t, s0) && !shares(t, s1) && segment_cuts(p[s0], p[s1], p[t[0]], p[t[1]], p[t[2]])) return true;
        if (!shares(s, t0) && !shares(s, t1) && segment_cuts(p[t0], p[t1], p[s[0]], p[s[1]], p[s[2]])) return true;
    }
    return false;
}

}  // namespace

SurfaceFacts survey_surface(const Mesh& mesh) {
    SurfaceFacts facts;
    std::map<std::pair<uint32_t, uint32_t>, std::vector<uint32_t>> side;
    std::vector<std::vector<std::pair<uint32_t, uint32_t>>> link(mesh.position.size());
    Box box;
    for (const Vec3d& p : mesh.position) {
        box.min = box.min.cwiseMin(p);
        box.max = box.max.cwiseMax(p);
    }
    facts.extent = box.max - box.min;
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
        const Triangle& corner = mesh.triangle[t];
        for (int k = 0; k < 3; ++k) {
            side[{corner[k], corner[(k + 1) % 3]}].push_back(t);
            link[corner[k]].push_back({corner[(k + 1) % 3], corner[(k + 2) % 3]});
        }
        const Vec3d &a = mesh.position[corner[0]], &b = mesh.position[corner[1]], &c = mesh.position[corner[2]];
        facts.area += (b - a).cross(c - a).norm() / 2;
        const double six = a.dot(b.cross(c));
        facts.volume += six / 6;
        facts.centroid += six / 24 * (a + b + c);
    }
    facts.centroid /= facts.volume;

    std::vector<uint32_t> parent(mesh.triangle.size());
    std::iota(parent.begin(), parent.end(), 0u);
    facts.closed = !side.empty();
    for (const auto& [ends, triangles] : side) {
        const auto other = side.find({ends.second, ends.first});
        if (ends.first == ends.second || triangles.size() != 1 || other == side.end()) {
            facts.closed = false;
        } else {
            parent[find_root(parent, triangles[0])] = find_root(parent, other->second[0]);
        }
    }
    for (uint32_t t = 0; t < parent.size(); ++t) facts.components += find_root(parent, t) == t;

    facts.one_fan = true;
    for (const auto& edges : link) {
        facts.unused_vertices += edges.empty();
        if (edges.empty()) continue;
        std::map<uint32_t, uint32_t> next(edges.begin(), edges.end());
        uint32_t steps = 0;
        uint32_t at = edges[0].first;
        do {
            const auto found = next.find(at);
            if (found == next.end()) break;
            at = found->second;
            ++steps;
        } while (at != edges[0].first && steps <= edges.size());
        if (steps != edges.size() || at != edges[0].first) facts.one_fan = false;
    }
    facts.euler = int(mesh.position.size() - facts.unused_vertices) - int(side.size() / 2) + int(mesh.triangle.size());
    return facts;
}

ShapeFacts survey_shape(const Mesh& mesh) {
    ShapeFacts facts;
    std::vector<double> angle;
    std::vector<double> edge;
    std::vector<double> area(mesh.position.size(), 0.0);
    for (const Triangle& t : mesh.triangle) {
        const Vec3d &a = mesh.position[t[0]], &b = mesh.position[t[1]], &c = mesh.position[t[2]];
        angle.push_back(std::min({corner_angle(a, b, c), corner_angle(b, c, a), corner_angle(c, a, b)}));
        for (const double length : {(b - a).norm(), (c - b).norm(), (a - c).norm()}) edge.push_back(length);
        for (const uint32_t v : t) area[v] += (b - a).cross(c - a).norm() / 6;
    }
    std::sort(angle.begin(), angle.end());
    facts.min_angle = angle.front();
    facts.angle_p1 = angle[angle.size() / 100];
    facts.angle_p50 = angle[angle.size() / 2];
    facts.min_edge = *std::min_element(edge.begin(), edge.end());
    facts.max_edge = *std::max_element(edge.begin(), edge.end());
    facts.mean_edge = std::accumulate(edge.begin(), edge.end(), 0.0) / double(edge.size());
    facts.min_area = *std::min_element(area.begin(), area.end());
    facts.mean_area = std::accumulate(area.begin(), area.end(), 0.0) / double(area.size());
    return facts;
}

uint32_t count_crossings(const Mesh& mesh) {
    const uint32_t count = static_cast<uint32_t>(mesh.triangle.size());
    std::vector<Box> box(count);
    for (uint32_t t = 0; t < count; ++t) {
        for (const uint32_t v : mesh.triangle[t]) {
            box[t].min = box[t].min.cwiseMin(mesh.position[v]);
            box[t].max = box[t].max.cwiseMax(mesh.position[v]);
        }
    }
    std::vector<uint32_t> order(count);
    std::iota(order.begin(), order.end(), 0u);
    std::sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) { return box[a].min.x() < box[b].min.x(); });
    uint32_t crossings = 0;
    for (uint32_t i = 0; i < count; ++i) {
        const Box& a = box[order[i]];
        for (uint32_t j = i + 1; j < count && box[order[j]].min.x() <= a.max.x(); ++j) {
            const Box& b = box[order[j]];
            if ((a.min.array() > b.max.array()).any() || (b.min.array() > a.max.array()).any()) continue;
            crossings += triangles_cross(mesh, mesh.triangle[order[i]], mesh.triangle[order[j]]);
        }
    }
    return crossings;
}

uint64_t hash_mesh(const Mesh& mesh) {
    uint64_t hash = 14695981039346656037u;
    const auto add = [&hash](const void* data, size_t bytes) {
        for (size_t i = 0; i < bytes; ++i) {
            hash = (hash ^ static_cast<const unsigned char*>(data)[i]) * 1099511628211u;
        }
    };
    const auto add_rows = [&add](const auto& rows) { add(rows.data(), rows.size() * sizeof(rows[0])); };
    add_rows(mesh.name);
    add_rows(mesh.position);
    add_rows(mesh.triangle);
    add_rows(mesh.uv);
    add_rows(mesh.triangle_material);
    for (const Material& material : mesh.material) {
        add_rows(material.name);
        add_rows(material.diffuse);
        add_rows(material.specular);
        add(&material.shininess, sizeof(float));
        add(&material.transparency, sizeof(float));
        add_rows(material.texture);
        add_rows(material.image.rgba);
    }
    return hash;
}

}  // namespace trocar::reference
