#include "content/shapes/plain_shapes.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

#include "content/shapes/implicit_shapes.hpp"
#include "content/shapes/surface_texture.hpp"
namespace trocar {
namespace {

// The surface of a cuboid divided into cells, two triangles each.
Mesh make_cuboid(const Vec3d& size, const std::array<uint32_t, 3>& cells) {
    Mesh mesh;
    std::vector<uint64_t> key;  // ascending, one per vertex
    const auto key_of = [&](const std::array<uint32_t, 3>& at) {
        return (uint64_t(at[2]) * (cells[1] + 1) + at[1]) * (cells[0] + 1) + at[0];
    };
    for (uint32_t z = 0; z <= cells[2]; ++z) {
        for (uint32_t y = 0; y <= cells[1]; ++y) {
            const bool rim = z == 0 || z == cells[2] || y == 0 || y == cells[1];
            for (uint32_t x = 0; x <= cells[0]; x += rim ? 1 : cells[0]) {
                key.push_back(key_of({x, y, z}));
                mesh.position.push_back({size.x() * (double(x) / cells[0] - 0.5), size.y() * (double(y) / cells[1] - 0.5),
                                         size.z() * (double(z) / cells[2] - 0.5)});
            }
        }
    }
    for (int face = 0; face < 6; ++face) {
        const int axis = face / 2;
        const int u = (axis + 1) % 3;
        const int v = (axis + 2) % 3;
        const auto vertex = [&](uint32_t i, uint32_t j) {
            std::array<uint32_t, 3> at{};
            at[axis] = face % 2 == 1 ? cells[axis] : 0;
            at[u] = i;
            at[v] = j;
            return static_cast<uint32_t>(std::lower_bound(key.begin(), key.end(), key_of(at)) - key.begin());
        };
        for (uint32_t j = 0; j < cells[v]; ++j) {
            for (uint32_t i = 0; i < cells[u]; ++i) {
                std::array<uint32_t, 4> q{vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)};
                if (face % 2 == 0) std::swap(q[1], q[3]);
                // alternate diagonals, so that the surface has no preferred direction
                const uint32_t turn = (i + j) % 2;
                mesh.triangle.push_back({q[turn], q[turn + 1], q[turn + 2]});
                mesh.triangle.push_back({q[turn + 2], q[(turn + 3) % 4], q[turn]});
            }
        }
    }
    return mesh;
}

// Faces of the regular icosahedron with edge 2, corners in rising order of signs; found by the edge length.
std::vector<std::array<Vec3d, 3>> icosahedron_faces() {
    const double golden = (1 + std::sqrt(5.0)) / 2;
    std::vector<Vec3d> corner;
    for (int axis = 0; axis < 3; ++axis) {
        for (const double a : {-1.0, 1.0}) {
            for (const double b : {-golden, golden}) {
                Vec3d c = Vec3d::Zero();
                c[(axis + 1) % 3] = a;
                c[(axis + 2) % 3] = b;
                corner.push_back(c);
            }
        }
    }
    const auto joined = [](const Vec3d& a, const Vec3d& b) { return (a - b).norm() < 2.1; };
    std::vector<std::array<Vec3d, 3>> faces;
    for (size_t i = 0; i < 12; ++i) {
        for (size_t j = i + 1; j < 12; ++j) {
            for (size_t k = j + 1; k < 12; ++k) {
                const Vec3d &a = corner[i], &b = corner[j], &c = corner[k];
                if (joined(a, b) && joined(b, c) && joined(c, a)) faces.push_back({a, b, c});
            }
        }
    }
    return faces;
}

// One ring of a surface of revolution about z.
struct Ring {
    double radius = 0;   // m; 0 at a pole
    double height = 0;   // m
    double arc = 0;      // m along the outline
    uint32_t count = 1;  // vertices
    double phase = 0;    // offset of the first vertex, in steps of the ring
    uint32_t first = 0;  // index of the first vertex
};

// Outline of the probe from the tip to the end of the handle. `fine` is the edge length at the tip, m; the
// shaft and the handle have three times that.
std::vector<Ring> outline_probe(double fine) {
    constexpr double kTip = 0.007;
    constexpr double kShaft = 0.004;
    constexpr double kHandle = 0.0065;
    struct Piece {
        double from, to;  // height, or angle from the pole for the caps
        double length;    // m, approximate
        double size_from, size_to;
        double (*radius)(double);
        double (*height)(double);
    };
    const auto as_is = [](double z) { return z; };
    const double quarter = M_PI / 2;
    const Piece pieces[] = {
        {0, quarter, kTip * quarter, 1, 1, [](double a) { return kTip * std::sin(a); }, [](double a) { return -kTip * std::cos(a); }},
        {0, 0.016, 0.0165, 1, 1.8, [](double z) { return kShaft + (kTip - kShaft) * (0.5 + 0.5 * std::cos(M_PI * z / 0.016)); }, as_is},
        {0.016, 0.04, 0.024, 1.8, 3, [](double) { return kShaft; }, as_is},
        {0.04, 0.108, 0.068, 3, 3, [](double) { return kShaft; }, as_is},
        {0.108, 0.118, 0.0105, 3, 3,
         [](double z) { return kHandle + (kShaft - kHandle) * (0.5 + 0.5 * std::cos(M_PI * (z - 0.108) / 0.01)); }, as_is},
        {0.118, 0.1535, 0.0355, 3, 3, [](double) { return kHandle; }, as_is},
        {quarter, 0, kHandle * quarter, 3, 3, [](double a) { return kHandle * std::sin(a); },
         [](double a) { return 0.1535 + kHandle * std::cos(a); }},
    };
    std::vector<Ring> rings{{0, -kTip, 0, 1, 0, 0}};
    double arc = 0;
    for (const Piece& piece : pieces) {
        // rows of equilateral triangles; edge lengths vary linearly, so positions follow from their integral
        const double row = fine * std::sqrt(0.75) * (piece.size_from + piece.size_to) / 2;
        const uint32_t steps = std::max(2u, static_cast<uint32_t>(std::lround(piece.length / row)));
        for (uint32_t i = 1; i <= steps; ++i) {
            const double t = double(i) / steps;
            const double part = t * (piece.size_from + (piece.size_to - piece.size_from) * t / 2) / ((piece.size_from + piece.size_to) / 2);
            const double at = piece.from + (piece.to - piece.from) * part;
            const double size = fine * (piece.size_from + (piece.size_to - piece.size_from) * t);
            Ring ring{piece.radius(at), piece.height(at), arc + piece.length * part, 0, 0, 0};
            if (ring.radius < 1e-9) ring.radius = 0;
            ring.count = ring.radius == 0 ? 1 : std::max(6u, static_cast<uint32_t>(std::lround(2 * M_PI * ring.radius / size)));
            ring.phase = rings.size() % 2 == 0 ? 0.0 : 0.5;
            rings.push_back(ring);
        }
        arc += piece.length;
    }
    return rings;
}

constexpr double kCapsuleRadius = 0.25, kCapsuleHalf = 0.25;  // m; half the length of the cylinder

// Outline of a capsule from its lower pole to the upper one; `fine` is the edge length, m.
std::vector<Ring> outline_capsule(double fine) {
    const double row = fine * std::sqrt(0.75), cap = kCapsuleRadius * M_PI / 2;
    const auto cap_steps = std::max(2u, static_cast<uint32_t>(std::lround(cap / row)));
    const auto steps = std::max(1u, static_cast<uint32_t>(std::lround(2 * kCapsuleHalf / row)));
    std::vector<Ring> rings;
    const auto add = [&](double radius, double height, double arc) {
        const uint32_t count = radius < 1e-9 ? 1 : std::max(6u, static_cast<uint32_t>(std::lround(2 * M_PI * radius / fine)));
        rings.push_back({count == 1 ? 0 : radius, height, arc, count, rings.size() % 2 == 0 ? 0.0 : 0.5, 0});
    };
    const auto add_cap = [&](uint32_t k, double end, double arc) {  // k steps from its pole
        const double angle = M_PI / 2 * k / cap_steps;
        add(kCapsuleRadius * std::sin(angle), end * (kCapsuleHalf + kCapsuleRadius * std::cos(angle)), arc);
    };
    for (uint32_t k = 0; k <= cap_steps; ++k) add_cap(k, -1, cap * k / cap_steps);
    for (uint32_t k = 1; k <= steps; ++k) add(kCapsuleRadius, kCapsuleHalf * (2.0 * k / steps - 1), cap + 2 * kCapsuleHalf * k / steps);
    for (uint32_t k = cap_steps; k-- > 0;) add_cap(k, 1, 2 * cap + 2 * kCapsuleHalf - cap * k / cap_steps);
    return rings;
}

uint32_t count_triangles(const std::vector<Ring>& rings) {
    uint32_t count = 0;
    for (size_t i = 0; i + 1 < rings.size(); ++i) {
        count += (rings[i].count > 1 ? rings[i].count : 0) + (rings[i + 1].count > 1 ? rings[i + 1].count : 0);
    }
    return count;
}

// Joins two rings by a band of triangles; the texture continues past 1 at the seam.
void zip_rings(const Ring& low, const Ring& high, double tile, Mesh& mesh) {
    const auto turn = [](const Ring& ring, uint32_t i) { return (i + ring.phase) / ring.count; };
    const auto vertex = [](const Ring& ring, uint32_t i) { return ring.first + i % ring.count; };
    const auto uv = [&](const Ring& ring, uint32_t i, double pole_turn) {
        const double u = ring.count == 1 ? pole_turn : turn(ring, i);
        return Vec2{static_cast<float>(u), static_cast<float>(ring.arc / tile)};
    };
    const uint32_t last_low = low.count > 1 ? low.count : 0;
    const uint32_t last_high = high.count > 1 ? high.count : 0;
    for (uint32_t i = 0, j = 0; i < last_low || j < last_high;) {
        // advance on the side whose next edge has its midpoint first
        const bool step_low = j == last_high || (i < last_low && turn(low, i) + turn(low, i + 1) <= turn(high, j) + turn(high, j + 1));
        if (step_low) {
            const double middle = (turn(low, i) + turn(low, i + 1)) / 2;
            mesh.triangle.push_back({vertex(low, i), vertex(low, i + 1), vertex(high, j)});
            mesh.uv.push_back({uv(low, i, 0), uv(low, i + 1, 0), uv(high, j, middle)});
            ++i;
        } else {
            const double middle = (turn(high, j) + turn(high, j + 1)) / 2;
            mesh.triangle.push_back({vertex(low, i), vertex(high, j + 1), vertex(high, j)});
            mesh.uv.push_back({uv(low, i, middle), uv(high, j + 1, 0), uv(high, j, 0)});
            ++j;
        }
    }
}

// The surface of revolution about z with about so many triangles: `outline` takes an edge length of up to `coarsest` (m);
// `tile`: of the texture, m.
Mesh surface_of_outline(std::vector<Ring> (*outline)(double), double coarsest, double tile, uint32_t triangles) {
    double low = 1e-5;
    double high = coarsest;
    for (int i = 0; i < 60; ++i) {
        const double middle = (low + high) / 2;
        (count_triangles(outline(middle)) > triangles ? low : high) = middle;
    }
    std::vector<Ring> rings = outline(high);
    Mesh mesh;
    for (Ring& ring : rings) {
        ring.first = static_cast<uint32_t>(mesh.position.size());
        for (uint32_t i = 0; i < ring.count; ++i) {
            const double angle = 2 * M_PI * (i + ring.phase) / ring.count;
            mesh.position.push_back({ring.radius * std::cos(angle), ring.radius * std::sin(angle), ring.height});
        }
    }
    for (size_t i = 0; i + 1 < rings.size(); ++i) zip_rings(rings[i], rings[i + 1], tile, mesh);
    return mesh;
}

}  // namespace

Mesh make_box(uint32_t triangles) {
    const uint32_t n = std::max(1u, static_cast<uint32_t>(std::lround(std::sqrt(triangles / 12.0))));
    Mesh mesh = make_cuboid(Vec3d::Ones(), {n, n, n});
    project_uv(0.25, mesh);
    return mesh;
}

Mesh make_sheet(uint32_t triangles) {
    const uint32_t n = std::max(1u, static_cast<uint32_t>(std::lround(std::sqrt(triangles / 2.0))));
    Mesh mesh;
    for (uint32_t j = 0; j <= n; ++j)
        for (uint32_t i = 0; i <= n; ++i) mesh.position.push_back({double(i) / n - 0.5, double(j) / n - 0.5, 0});
    for (uint32_t j = 0; j < n; ++j) {
        for (uint32_t i = 0; i < n; ++i) {
            const uint32_t a = j * (n + 1) + i, c = a + n + 2;
            // alternate diagonals, so that the sheet has no preferred direction
            if ((i + j) % 2 == 0) {
                mesh.triangle.push_back({a, a + 1, c});
                mesh.triangle.push_back({a, c, c - 1});
            } else {
                mesh.triangle.push_back({a, a + 1, c - 1});
                mesh.triangle.push_back({a + 1, c, c - 1});
            }
        }
    }
    project_uv(0.25, mesh);
    return mesh;
}

Mesh make_table(uint32_t triangles) {
    const Vec3d size(0.6, 0.6, 0.02);
    std::array<uint32_t, 3> cells{1, 1, 1};
    const auto count = [](uint32_t n, uint32_t thick) { return 4 * n * n + 8 * n * thick; };
    for (uint32_t n = 1, nearest = kNone; n <= 1 + triangles / 4; ++n) {
        const uint32_t thick = std::max(1u, static_cast<uint32_t>(std::lround(n * size.z() / size.x())));
        const uint32_t have = count(n, thick);
        const uint32_t miss = have > triangles ? have - triangles : triangles - have;
        if (miss < nearest) nearest = miss, cells = {n, n, thick};
        if (have > triangles) break;
    }
    Mesh mesh = make_cuboid(size, cells);
    project_uv(0.05, mesh);
    return mesh;
}

Mesh make_sphere(uint32_t triangles) {
    const uint32_t n = std::max(1u, static_cast<uint32_t>(std::lround(std::sqrt(triangles / 20.0))));
    Mesh mesh;
    // faces share lattice points on common edges: identified by n * position, rounded to 1e-3 of a cell
    std::map<std::array<int64_t, 3>, uint32_t> known;
    for (const auto& [a, b, c] : icosahedron_faces()) {
        const bool outward = (b - a).cross(c - a).dot(a) > 0;
        const auto vertex = [&, &a = a, &b = b, &c = c](uint32_t i, uint32_t j) {
            const Vec3d position = double(n - i - j) * a + double(i) * b + double(j) * c;
            const std::array<int64_t, 3> key{std::llround(position.x() * 1e3), std::llround(position.y() * 1e3),
                                             std::llround(position.z() * 1e3)};
            const auto [found, fresh] = known.try_emplace(key, static_cast<uint32_t>(mesh.position.size()));
            if (fresh) mesh.position.push_back(0.5 * position.normalized());
            return found->second;
        };
        const auto add = [&](uint32_t p, uint32_t q, uint32_t r) {
            if (!outward) std::swap(q, r);
            mesh.triangle.push_back({p, q, r});
        };
        for (uint32_t j = 0; j < n; ++j) {
            for (uint32_t i = 0; i + j < n; ++i) {
                add(vertex(i, j), vertex(i + 1, j), vertex(i, j + 1));
                if (i + j + 1 < n) add(vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1));
            }
        }
    }
    project_uv(0.25, mesh);
    return mesh;
}

Mesh make_probe(uint32_t triangles) { return surface_of_outline(outline_probe, 0.02, 0.03, triangles); }

Mesh make_capsule(uint32_t triangles) { return surface_of_outline(outline_capsule, 0.5, 0.25, triangles); }

Mesh make_hull(uint32_t triangles, uint64_t seed) {
    Mesh mesh = make_sphere(triangles);
    uint32_t drawn = 0;
    const auto between = [&](double low, double high) {
        return low + (high - low) * static_cast<double>(mix_bits(mix_bits(seed) + drawn++) >> 11) * 0x1p-53;
    };
    // a projective map, whose plane at infinity stays away, takes planes to planes and what is convex to what is convex
    const Vec3d size(1, between(0.65, 1), between(0.55, 0.8)), lean(between(-0.5, 0.5), between(-0.5, 0.5), between(-0.5, 0.5));
    Vec3d least = Vec3d::Constant(1), most = -least;
    for (Vec3d& p : mesh.position) {
        p = p.cwiseProduct(size) / (1 + lean.dot(p));
        least = least.cwiseMin(p), most = most.cwiseMax(p);
    }
    const double scale = 1 / (most - least).maxCoeff();
    for (Vec3d& p : mesh.position) p = scale * (p - 0.5 * (least + most));
    mesh.uv.clear();
    project_uv(0.25, mesh);
    return mesh;
}

}  // namespace trocar
