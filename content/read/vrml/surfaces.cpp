#include "content/read/vrml/surfaces.hpp"

#include <algorithm>
#include <cmath>

#include "content/read/vrml/looks.hpp"
#include "content/read/vrml/primitives.hpp"
#include "engine/base/error.hpp"
namespace trocar::vrml {
namespace {

// Appends a vertex transformed by the surface's placement.
uint32_t add_vertex(SurfaceBuilder& b, const Instance& instance, const Vec3d& local) {
    const Vec3d p = instance.state.placement.linear * local + instance.state.placement.shift;
    if (!p.allFinite()) {
        throw InputError(position_of(b.scene, instance.geometry) + ": a point that its transforms make too large" +
                         describe_path({type_of(b.scene, instance.geometry)}));
    }
    b.mesh.position.push_back(p);
    return static_cast<uint32_t>(b.mesh.position.size() - 1);
}

// --- texture coordinates

// Source of the texture coordinates of one surface's corners.
struct TextureMap {
    bool active = false;
    std::span<const double> points;  // u, v; empty = from the bounding box of the surface
    std::span<const double> index;   // like coordIndex; empty = equal to coordIndex
    std::array<double, 6> transform{1, 0, 0, 0, 1, 0};
    // without points: u along the longest side of the box, v along the second (VRML97, section 6.23)
    int axis_u = 0, axis_v = 1;
    Vec3d origin = Vec3d::Zero();
    double length = 1;
};

// -C S R C T of the VRML97 standard, section 6.49.
std::array<double, 6> texture_transform(const Scene& scene, NodeId id) {
    std::array<double, 6> m{1, 0, 0, 0, 1, 0};
    if (id.node == kNone || role_of(scene, id) != Role::kTextureTransform) return m;
    const auto pair_of = [&](std::string_view name, double otherwise) {
        const std::span<const double> n = numbers_of(find_value(scene, id, name));
        return n.size() < 2 ? std::array{otherwise, otherwise} : std::array{n[0], n[1]};
    };
    const auto t = pair_of("translation", 0), c = pair_of("center", 0);
    const auto s = pair_of(find_value(scene, id, "scale") ? "scale" : "scaleFactor", 1);
    const std::span<const double> turn = numbers_of(find_value(scene, id, "rotation"));
    const double angle = turn.empty() ? 0 : turn[0];
    const double cosine = std::cos(angle), sine = std::sin(angle);
    const double x = t[0] + c[0], y = t[1] + c[1];
    m = {s[0] * cosine, -s[0] * sine,  s[0] * (cosine * x - sine * y) - c[0],
         s[1] * sine,   s[1] * cosine, s[1] * (sine * x + cosine * y) - c[1]};
    return m;
}

TextureMap texture_map(SurfaceBuilder& b, const Instance& instance, std::span<const double> points) {
    TextureMap map;
    const State& state = instance.state;
    const bool textured = state.texture.node != kNone && role_of(b.scene, state.texture) == Role::kTexture;
    map.points = numbers_at(b.scene, state.texture_coordinate, "point");
    map.active = map.points.size() >= 2;
    if (!map.active && !b.made.uv.empty()) {
        map.points = b.made.uv;
        map.index = b.made.uv_index;
        map.active = textured;
    } else if (map.active) {
        map.index = numbers_at(b.scene, instance.geometry, "textureCoordIndex");
        if (map.index.empty()) map.index = numbers_at(b.scene, instance.geometry, "texCoordIndex");
    } else if (textured) {
        map.points = {};
        map.active = true;
        Box box;
        for (size_t k = 0; k + 3 <= points.size(); k += 3) grow(box, Vec3d(points[k], points[k + 1], points[k + 2]));
        const Vec3d size = box.max - box.min;
        // the standard prefers x over y over z on ties
        for (int k = 1; k < 3; ++k) map.axis_u = size[k] > size[map.axis_u] ? k : map.axis_u;
        map.axis_v = map.axis_u == 0 ? 1 : 0;
        for (int k = 0; k < 3; ++k) {
            if (k != map.axis_u && size[k] > size[map.axis_v]) map.axis_v = k;
        }
        map.origin = box.min;
        map.length = size[map.axis_u] > 0 ? size[map.axis_u] : 1;
    }
    map.transform = texture_transform(b.scene, state.texture_transform);
    return map;
}

Vec2 texture_coordinate(SurfaceBuilder& b, const TextureMap& map, const Vec3d& corner, uint32_t point, uint32_t corner_index) {
    std::array<double, 2> t{0, 0};
    if (map.points.empty()) {
        t = {(corner[map.axis_u] - map.origin[map.axis_u]) / map.length, (corner[map.axis_v] - map.origin[map.axis_v]) / map.length};
    } else {
        double row = point;
        if (!map.index.empty()) row = corner_index < map.index.size() ? map.index[corner_index] : -1;
        if (row >= 0 && 2 * row + 2 <= static_cast<double>(map.points.size())) {
            t = {map.points[2 * static_cast<size_t>(row)], map.points[2 * static_cast<size_t>(row) + 1]};
        } else {
            ++b.corners_without_uv;
        }
    }
    const auto& m = map.transform;
    const Vec2 uv{static_cast<float>(m[0] * t[0] + m[1] * t[1] + m[2]), static_cast<float>(m[3] * t[0] + m[4] * t[1] + m[5])};
    if (std::isfinite(uv.u) && std::isfinite(uv.v)) return uv;
    ++b.corners_without_uv;
    return {};
}

// --- faces

// Data shared by the faces of one face set.
struct FaceSet {
    const Instance& instance;
    std::span<const double> points;
    std::span<const double> index;
    Value written;  // the field that contains the index, if any
    TextureMap map;
    std::vector<bool>& used;
    bool flip = false;
};

uint32_t vertex_of(SurfaceBuilder& b, const FaceSet& set, uint32_t point) {
    if (b.stamp[point] != b.surface) {
        b.stamp[point] = b.surface;
        set.used[point] = true;
        const double* p = set.points.data() + size_t{3} * point;
        b.vertex_of_point[point] = add_vertex(b, set.instance, {p[0], p[1], p[2]});
    }
    return b.vertex_of_point[point];
}

// Appends the face with the corners in builder.corner_point, unless it must be dropped.
void add_face(SurfaceBuilder& b, const FaceSet& set, const FaceLook& look, uint64_t face) {
    const size_t n = b.corner_point.size();
    if (n < 3) {
        ++b.faces_short;
        return;
    }
    b.corner.resize(n);
    for (size_t k = 0; k < n; ++k) {
        const double* p = set.points.data() + size_t{3} * b.corner_point[k];
        b.corner[k] = {p[0], p[1], p[2]};
    }
    b.cut.clear();
    if (!triangulate_polygon(b.corner, b.polygon, b.cut)) ++b.faces_fanned;
    const uint16_t material = material_of_face(b, set.instance.state, look, face);
    for (Triangle t : b.cut) {
        if (set.flip) std::swap(t[1], t[2]);
        Triangle vertices;
        std::array<Vec2, 3> uv;
        for (size_t k = 0; k < 3; ++k) {
            vertices[k] = vertex_of(b, set, b.corner_point[t[k]]);
            if (set.map.active) {
                uv[k] = texture_coordinate(b, set.map, b.corner[t[k]], b.corner_point[t[k]], b.corner_index_of[t[k]]);
            }
        }
        b.mesh.triangle.push_back(vertices);
        b.mesh.triangle_material.push_back(material);
        if (set.map.active) b.mesh.uv.push_back(uv);
    }
}

// The points and index of a surface, converted into b.made if the node is not an indexed face set.
FaceSet find_faces(SurfaceBuilder& b, const Instance& instance) {
    const Role role = role_of(b.scene, instance.geometry);
    b.made = {};
    if (role == Role::kElevationGrid || role == Role::kExtrusion) {
        role == Role::kExtrusion ? make_extrusion(b.scene, instance.geometry, b.made)
                                 : make_elevation_grid(b.scene, instance.geometry, b.made);
        b.made_used.assign(b.made.point.size() / 3, false);
        return {instance, b.made.point, b.made.index, {}, {}, b.made_used, false};
    }
    CoordinateUse& use = b.coordinate_use[instance.state.coordinate];
    const std::span<const double> points = numbers_at(b.scene, instance.state.coordinate, "point");
    use.used.resize(points.size() / 3, false);
    std::array<double, 12> place;
    Eigen::Map<Eigen::Matrix<double, 3, 4>>(place.data()) << instance.state.placement.linear, instance.state.placement.shift;
    use.placements.insert(place);
    if (role == Role::kFaceSet) {
        const Value index = find_value(b.scene, instance.geometry, "coordIndex");
        return {instance, points, numbers_of(index), index, {}, use.used, false};
    }
    make_set(b.scene, instance.geometry, points.size() / 3, b.made);
    return {instance, points, b.made.index, {}, {}, use.used, false};
}

void build_face_set(SurfaceBuilder& b, const Instance& instance) {
    FaceSet set = find_faces(b, instance);
    const size_t point_count = set.points.size() / 3;
    set.map = texture_map(b, instance, set.points);
    const bool clockwise = instance.state.clockwise || !flag_of(find_value(b.scene, instance.geometry, "ccw"), true);
    // a mirroring transform reverses orientation; flip the faces so that they stay outward
    set.flip = clockwise != (instance.state.placement.linear.determinant() < 0);
    const FaceLook look = face_look(b, instance);
    ++b.surface;
    if (b.stamp.size() < point_count) {
        b.stamp.resize(point_count, 0);
        b.vertex_of_point.resize(point_count);
    }
    if (set.map.active) b.mesh.uv.resize(b.mesh.triangle.size());
    // a large surface reserves exactly its size, many small ones grow by doubling
    std::vector<Vec3d>& position = b.mesh.position;
    const size_t room = position.size() + std::min(point_count, set.index.size());
    if (room > position.capacity()) position.reserve(std::max(room, 2 * position.size()));

    const std::span<const double> index = set.index;
    uint64_t face = 0;
    bool outside = false;
    b.corner_point.clear();
    b.corner_index_of.clear();
    for (size_t k = 0; k <= index.size(); ++k) {
        if (k % (1u << 20) == (1u << 20) - 1) b.report();
        if (k < index.size() && index[k] != -1) {
            // invalid indices (-5, 1.5, NaN) count as outside too
            const bool inside = index[k] >= 0 && index[k] < static_cast<double>(point_count) && index[k] == std::floor(index[k]);
            if (!inside && b.first_outside.empty()) {
                b.first_outside =
                    set.written ? location_of_number(set.written, static_cast<uint32_t>(k)) : position_of(b.scene, instance.geometry);
            }
            outside = outside || !inside;
            b.corner_point.push_back(inside ? static_cast<uint32_t>(index[k]) : 0);
            b.corner_index_of.push_back(static_cast<uint32_t>(k));
            continue;
        }
        if (outside) {
            ++b.faces_outside;
        } else if (!b.corner_point.empty()) {
            add_face(b, set, look, face);
        }
        face += !b.corner_point.empty();
        outside = false;
        b.corner_point.clear();
        b.corner_index_of.clear();
    }
}

void build_primitive(SurfaceBuilder& b, const Instance& instance) {
    b.corner.clear();
    b.cut.clear();
    make_primitive(b.scene, instance.geometry, b.corner, b.cut);
    const auto first = static_cast<uint32_t>(b.mesh.position.size());
    for (const Vec3d& p : b.corner) add_vertex(b, instance, p);
    const bool flip = instance.state.placement.linear.determinant() < 0;
    const uint16_t material = material_row(b, instance.state, 0, {});
    for (Triangle t : b.cut) {
        if (flip) std::swap(t[1], t[2]);
        b.mesh.triangle.push_back({first + t[0], first + t[1], first + t[2]});
        b.mesh.triangle_material.push_back(material);
    }
}

}  // namespace

void check_points(const Scene& scene, NodeId coordinate, uint32_t width) {
    const Value value = find_value(scene, coordinate, "point");
    const std::span<const double> numbers = numbers_of(value);
    for (size_t k = 0; k < numbers.size(); ++k) {
        if (!std::isfinite(numbers[k])) {
            throw InputError(location_of_number(value, static_cast<uint32_t>(k)) + ": a point that is not finite");
        }
    }
    if (numbers.size() % width != 0) {
        throw InputError(describe_location(*value.document, value.field->offset) + ": " + std::to_string(numbers.size()) +
                         " numbers do not make points of " + std::to_string(width));
    }
}

uint64_t count_triangles(const Scene& scene, const Instance& instance) {
    const Role role = role_of(scene, instance.geometry);
    if (is_primitive(role)) return count_primitive_triangles(role);
    if (role != Role::kFaceSet) {
        const size_t numbers = numbers_at(scene, instance.state.coordinate, "point").size();
        return count_made_triangles(scene, instance.geometry, numbers / 3);
    }
    uint64_t triangles = 0, corners = 0;
    for (const double index : numbers_at(scene, instance.geometry, "coordIndex")) {
        corners = index == -1 ? 0 : corners + 1;
        triangles += corners > 2;
    }
    return triangles;
}

void build_surface(SurfaceBuilder& builder, const Instance& instance) {
    if (is_primitive(role_of(builder.scene, instance.geometry))) {
        build_primitive(builder, instance);
    } else {
        build_face_set(builder, instance);
    }
    if (!builder.mesh.uv.empty()) builder.mesh.uv.resize(builder.mesh.triangle.size());
}

uint64_t count_unused_points(const SurfaceBuilder& builder) {
    uint64_t total = 0;
    for (const auto& [coordinate, use] : builder.coordinate_use) {
        if (std::find(use.used.begin(), use.used.end(), false) == use.used.end()) continue;
        const std::span<const double> numbers = numbers_at(builder.scene, coordinate, "point");
        // sorts identical positions together, those with a used point first
        std::vector<std::tuple<double, double, double, bool>> corner_indices;
        for (size_t k = 0; k < use.used.size(); ++k) {
            corner_indices.emplace_back(numbers[3 * k], numbers[3 * k + 1], numbers[3 * k + 2], !use.used[k]);
        }
        std::sort(corner_indices.begin(), corner_indices.end());
        uint64_t unused = 0;
        for (size_t k = 0; k < corner_indices.size(); ++k) {
            const auto& [x, y, z, is_unused] = corner_indices[k];
            const bool first =
                k == 0 || std::tie(x, y, z) != std::tie(std::get<0>(corner_indices[k - 1]), std::get<1>(corner_indices[k - 1]),
                                                        std::get<2>(corner_indices[k - 1]));
            unused += first && is_unused;
        }
        total += unused * use.placements.size();
    }
    return total;
}

}  // namespace trocar::vrml
