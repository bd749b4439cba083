#include "content/read/vrml/made_surfaces.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
namespace trocar::vrml {
namespace {

// A number as an integer in [0, limit]; `limit` for larger, negative ("all the rest") or non-integer values.
uint64_t whole(double number, uint64_t limit) {
    return number >= 0 && number < static_cast<double>(limit) ? static_cast<uint64_t>(number) : limit;
}

void add_face(FaceList& faces, std::initializer_list<double> corner) {
    faces.index.insert(faces.index.end(), corner);
    faces.index.push_back(-1);
}

// Corner k of a set: its entry in the index, or the k-th point from the first.
struct Corners {
    std::span<const double> index;
    bool indexed = false;
    uint64_t first = 0, count = 0;
    double at(uint64_t k) const { return indexed ? index[k] : static_cast<double>(first + k); }
};

Corners corners_of(const Scene& scene, NodeId id, uint64_t points) {
    const Role role = role_of(scene, id);
    const bool indexed =
        role == Role::kIndexedTriangles || role == Role::kIndexedFans || role == Role::kIndexedStrips || role == Role::kIndexedQuads;
    Corners corners;
    corners.indexed = indexed;
    if (indexed) {
        corners.index = numbers_at(scene, id, find_value(scene, id, "index") ? "index" : "coordIndex");
        corners.count = corners.index.size();
    } else {
        corners.first = std::min(whole(number_of(scene, id, "startIndex", 0), points), points);
        corners.count = points - corners.first;
    }
    return corners;
}

void add_run(FaceList& faces, Role role, const Corners& c, uint64_t first, uint64_t count) {
    if (role == Role::kPolygons) {
        for (uint64_t k = 0; k < count; ++k) faces.index.push_back(c.at(first + k));
        faces.index.push_back(-1);
        return;
    }
    const bool fan = role == Role::kFans || role == Role::kIndexedFans;
    for (uint64_t k = 2; k < count; ++k) {
        const uint64_t odd = fan ? 0 : k % 2;
        const double a = c.at(fan ? first : first + k - 2 + odd), b = c.at(first + k - 1 - odd), d = c.at(first + k);
        // strips repeat corners to continue at another position
        if (fan || (a != b && b != d && d != a)) add_face(faces, {a, b, d});
    }
}

// Fans, strips and polygons with the corner counts of a field, or separated by -1 in the index.
void make_runs(const Scene& scene, NodeId id, const Corners& c, FaceList& faces) {
    const Role role = role_of(scene, id);
    uint64_t first = 0;
    if (c.indexed) {
        for (uint64_t k = 0; k <= c.count; ++k) {
            if (k < c.count && c.at(k) != -1) continue;
            add_run(faces, role, c, first, k - first);
            first = k + 1;
        }
        return;
    }
    const char* const field = role == Role::kFans ? "fanCount" : find_value(scene, id, "stripCount") ? "stripCount" : "numVertices";
    for (const double count : numbers_at(scene, id, field)) {
        const uint64_t run = whole(count, c.count - first);
        add_run(faces, role, c, first, run);
        first += run;
        if (first == c.count) break;
    }
}

void make_quad_mesh(const Scene& scene, NodeId id, const Corners& c, FaceList& faces) {
    const uint64_t row = whole(number_of(scene, id, "verticesPerRow", 1), c.count);
    const uint64_t column = whole(number_of(scene, id, "verticesPerColumn", 1), c.count);
    if (row < 2 || column < 2 || column > c.count / row) return;
    for (uint64_t y = 0; y + 1 < column; ++y) {
        for (uint64_t x = 0; x + 1 < row; ++x) {
            const uint64_t k = y * row + x;
            add_face(faces, {c.at(k), c.at(k + row), c.at(k + row + 1), c.at(k + 1)});
        }
    }
}

// Width and depth of an ElevationGrid in points; zero unless every point has a height.
std::array<uint64_t, 2> grid_size(const Scene& scene, NodeId id) {
    const uint64_t heights = numbers_at(scene, id, "height").size();
    const double x = number_of(scene, id, "xDimension", 0), z = number_of(scene, id, "zDimension", 0);
    if (!(x >= 2 && z >= 2 && x * z <= static_cast<double>(heights))) return {0, 0};
    return {static_cast<uint64_t>(x), static_cast<uint64_t>(z)};
}

// --- extrusion

using Frame = std::array<Vec3d, 3>;  // x, y, z axis of a cross-section plane

// Unit vector; zero for a zero vector.
Vec3d unit(const Vec3d& v) {
    const double length = v.norm();
    return length > 0 && std::isfinite(length) ? Vec3d(v / length) : Vec3d(Vec3d::Zero());
}

Vec3d turn(const Vec3d& v, const Vec3d& axis, double angle) { return Eigen::AngleAxisd(angle, unit(axis)) * v; }

struct Outline {
    std::vector<Vec3d> spine;
    std::vector<std::array<double, 2>> section;  // x, z
    bool closed_spine = false, closed_section = false;
};

Outline outline_of(const Scene& scene, NodeId id) {
    static constexpr double kSquare[] = {1, 1, 1, -1, -1, -1, -1, 1, 1, 1}, kUp[] = {0, 0, 0, 0, 1, 0};
    const Value given_section = find_value(scene, id, "crossSection"), given_spine = find_value(scene, id, "spine");
    const std::span<const double> section = given_section ? numbers_of(given_section) : kSquare;
    const std::span<const double> spine = given_spine ? numbers_of(given_spine) : kUp;
    Outline o;
    for (size_t k = 0; k + 2 < spine.size(); k += 3) o.spine.push_back({spine[k], spine[k + 1], spine[k + 2]});
    for (size_t k = 0; k + 1 < section.size(); k += 2) o.section.push_back({section[k], section[k + 1]});
    o.closed_spine = o.spine.size() > 2 && o.spine.front() == o.spine.back();
    o.closed_section = o.section.size() > 2 && o.section.front() == o.section.back();
    return o;
}

// The plane of each cross-section (VRML97 6.18.3): y along the spine, z normal to the plane of its bend.
std::vector<Frame> frames_of(const Outline& o) {
    const std::vector<Vec3d>& p = o.spine;
    const size_t n = p.size();
    std::vector<Frame> frame(n, Frame{Vec3d::Zero(), Vec3d::Zero(), Vec3d::Zero()});
    Vec3d first_z = Vec3d::Zero();
    for (size_t k = 0; k < n; ++k) {
        const bool end = k == 0 || k + 1 == n;
        const Vec3d before = k > 0 ? p[k - 1] : o.closed_spine ? p[n - 2] : p[0];
        const Vec3d after = k + 1 < n ? p[k + 1] : o.closed_spine ? p[1] : p[n - 1];
        frame[k][1] = unit(after - before);
        if (!end || o.closed_spine) frame[k][2] = unit((after - p[k]).cross(before - p[k]));
        if (frame[k][1].isZero() && k > 0) frame[k][1] = frame[k - 1][1];
        if (first_z.isZero()) first_z = frame[k][2];
    }
    for (size_t k = n; k-- > 0;) {
        if (frame[k][1].isZero()) frame[k][1] = k + 1 < n ? frame[k + 1][1] : Vec3d(0, 1, 0);
    }
    if (first_z.isZero()) {
        // straight spine: rotate the axes by the smallest rotation that brings y to the spine
        const Vec3d y = frame[0][1], axis = Vec3d(0, 1, 0).cross(y);
        const double angle = std::atan2(axis.norm(), y[1]);
        first_z = axis.norm() > 0 ? turn(Vec3d(0, 0, 1), axis, angle) : Vec3d(0, 0, y[1] < 0 ? -1 : 1);
    }
    Vec3d z = first_z;
    for (Frame& f : frame) {
        if (f[2].isZero()) f[2] = z;
        if (f[2].dot(z) < 0) f[2] = -f[2];
        z = f[2];
        f[0] = unit(f[1].cross(f[2]));
    }
    return frame;
}

void add_extrusion_points(const Scene& scene, NodeId id, const Outline& o, FaceList& faces) {
    const std::span<const double> scale = numbers_at(scene, id, "scale");
    const std::span<const double> orientation = numbers_at(scene, id, "orientation");
    const std::vector<Frame> frame = frames_of(o);
    for (size_t k = 0; k < o.spine.size(); ++k) {
        // with fewer entries than spine points the last one is used for the rest
        const size_t s = scale.size() < 2 ? 0 : 2 * std::min(k, scale.size() / 2 - 1);
        const size_t r = orientation.size() < 4 ? 0 : 4 * std::min(k, orientation.size() / 4 - 1);
        for (const auto& [x, z] : o.section) {
            Vec3d q(x, 0, z);
            if (scale.size() >= 2) q = {x * scale[s], 0, z * scale[s + 1]};
            if (orientation.size() >= 4 && orientation[r + 3] != 0) {
                q = turn(q, {orientation[r], orientation[r + 1], orientation[r + 2]}, orientation[r + 3]);
            }
            const Vec3d p = o.spine[k] + q[0] * frame[k][0] + q[1] * frame[k][1] + q[2] * frame[k][2];
            faces.point.insert(faces.point.end(), {p[0], p[1], p[2]});
        }
    }
}

// Fraction of the length at each point of a line, 0 to 1.
template <typename Point, typename Distance>
std::vector<double> shares(const std::vector<Point>& p, Distance distance) {
    std::vector<double> share(p.size(), 0);
    for (size_t k = 1; k < p.size(); ++k) share[k] = share[k - 1] + distance(p[k - 1], p[k]);
    const double all = share.back();
    for (double& s : share) s = all > 0 ? s / all : 0;
    return share;
}

// Sides: u along the cross-section, v along the spine. Caps: the cross-section, larger side from 0 to 1.
void add_extrusion_uv(const Outline& o, FaceList& faces) {
    const std::vector<double> v = shares(o.spine, [](const Vec3d& a, const Vec3d& b) { return (b - a).norm(); });
    const std::vector<double> u = shares(o.section, [](const auto& a, const auto& b) { return std::hypot(b[0] - a[0], b[1] - a[1]); });
    std::array<double, 2> low = o.section[0], high = o.section[0];
    for (const auto& q : o.section) {
        low = {std::min(low[0], q[0]), std::min(low[1], q[1])};
        high = {std::max(high[0], q[0]), std::max(high[1], q[1])};
    }
    const double size = std::max(high[0] - low[0], high[1] - low[1]);
    for (const double down : v) {
        for (const double along : u) faces.uv.insert(faces.uv.end(), {along, down});
    }
    for (const auto& q : o.section) {
        faces.uv.push_back(size > 0 ? (q[0] - low[0]) / size : 0);
        faces.uv.push_back(size > 0 ? (q[1] - low[1]) / size : 0);
    }
}

void add_cap(const Outline& o, bool begin, FaceList& faces) {
    const size_t n = o.section.size(), corners = o.closed_section ? n - 1 : n;
    if (corners < 3) return;
    const size_t first = begin ? 0 : (o.spine.size() - 1) * n;
    for (size_t k = 0; k < corners; ++k) {
        const size_t c = begin ? corners - 1 - k : k;
        faces.index.push_back(static_cast<double>(first + c));
        faces.uv_index.push_back(static_cast<double>(o.spine.size() * n + c));
    }
    faces.index.push_back(-1);
    faces.uv_index.push_back(-1);
}

}  // namespace

uint64_t count_made_triangles(const Scene& scene, NodeId id, uint64_t points) {
    switch (role_of(scene, id)) {
        case Role::kIndexedTriangles:
        case Role::kIndexedFans:
        case Role::kIndexedStrips:
        case Role::kIndexedQuads:
            return numbers_at(scene, id, find_value(scene, id, "index") ? "index" : "coordIndex").size();
        case Role::kElevationGrid: {
            const auto [x, z] = grid_size(scene, id);
            return 2 * x * z;
        }
        case Role::kExtrusion: {
            const Outline o = outline_of(scene, id);
            return 2 * o.spine.size() * o.section.size() + 2 * o.section.size();
        }
        default:
            return 2 * points;
    }
}

void make_set(const Scene& scene, NodeId id, uint64_t points, FaceList& faces) {
    faces = {};
    const Corners c = corners_of(scene, id, points);
    switch (role_of(scene, id)) {
        case Role::kTriangles:
        case Role::kIndexedTriangles:
            for (uint64_t k = 0; k + 2 < c.count; k += 3) add_face(faces, {c.at(k), c.at(k + 1), c.at(k + 2)});
            return;
        case Role::kQuads:
        case Role::kIndexedQuads:
            for (uint64_t k = 0; k + 3 < c.count; k += 4) {
                add_face(faces, {c.at(k), c.at(k + 1), c.at(k + 2), c.at(k + 3)});
            }
            return;
        case Role::kQuadMesh:
            return make_quad_mesh(scene, id, c, faces);
        default:
            return make_runs(scene, id, c, faces);
    }
}

void make_elevation_grid(const Scene& scene, NodeId id, FaceList& faces) {
    faces = {};
    const auto [width, depth] = grid_size(scene, id);
    if (width == 0) return;
    const std::span<const double> height = numbers_at(scene, id, "height");
    const double dx = number_of(scene, id, "xSpacing", 1), dz = number_of(scene, id, "zSpacing", 1);
    for (uint64_t z = 0; z < depth; ++z) {
        for (uint64_t x = 0; x < width; ++x) {
            const double i = static_cast<double>(x), j = static_cast<double>(z);
            faces.point.insert(faces.point.end(), {i * dx, height[z * width + x], j * dz});
            faces.uv.push_back(i / static_cast<double>(width - 1));
            faces.uv.push_back(j / static_cast<double>(depth - 1));
            if (x + 1 == width || z + 1 == depth) continue;
            const double k = static_cast<double>(z * width + x), below = k + static_cast<double>(width);
            add_face(faces, {k, below, below + 1, k + 1});
        }
    }
}

void make_extrusion(const Scene& scene, NodeId id, FaceList& faces) {
    faces = {};
    const Outline o = outline_of(scene, id);
    const size_t n = o.section.size(), rows = o.spine.size();
    if (n < 2 || rows < 2) return;
    add_extrusion_points(scene, id, o, faces);
    add_extrusion_uv(o, faces);
    for (size_t k = 0; k + 1 < rows; ++k) {
        for (size_t j = 0; j + 1 < n; ++j) {
            const double a = static_cast<double>(k * n + j), up = static_cast<double>(n);
            add_face(faces, {a, a + 1, a + up + 1, a + up});
        }
    }
    faces.uv_index = faces.index;
    if (o.closed_spine) return;
    if (flag_of(find_value(scene, id, "beginCap"), true)) add_cap(o, true, faces);
    if (flag_of(find_value(scene, id, "endCap"), true)) add_cap(o, false, faces);
}

}  // namespace trocar::vrml
