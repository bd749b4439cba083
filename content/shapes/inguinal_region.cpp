#include "content/shapes/inguinal_region.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "content/shapes/loft.hpp"
#include "content/shapes/tube.hpp"
namespace trocar {
namespace {

const InguinalRegion kRegion;

// A point between a circle about the ring and an ellipse about the middle of the region, in the plane of x and z.
Vec3d plan(double turn, double circle, double ellipse_x, double ellipse_z, double part) {
    return {(circle + part * (ellipse_x - circle)) * std::cos(turn) + part * kRegion.middle_x, 0,
            (circle + part * (ellipse_z - circle)) * std::sin(turn)};
}

// The inside of the wall, moved by `lift` (m) along y.
Vec3d at_wall(const Vec3d& plan, double lift) { return {plan.x(), kRegion.inside(plan.x(), plan.z()) + lift, plan.z()}; }

// Radius and depth of the sac at v: 0 to 1 its round end, to 2 its wall, to 3 the bend at its neck.
void pouch(double v, double& radius, double& depth) {
    const InguinalRegion& r = kRegion;
    const double straight = r.sac_depth - r.sac - r.flare;
    if (v <= 1) {
        radius = r.sac * std::sin(M_PI / 2 * v), depth = r.sac_depth - r.sac * (1 - std::cos(M_PI / 2 * v));
    } else if (v <= 2) {
        radius = r.sac, depth = r.flare + straight * (2 - v);
    } else {
        const double angle = M_PI / 2 * (v - 2);
        radius = r.sac + r.flare * (1 - std::cos(angle)), depth = r.flare * (1 - std::sin(angle));
    }
}

// A point by its position (x, z) and how far it is from the wall towards the belly, m.
struct WallPoint {
    double x = 0, z = 0, off = 0;
};
RegionTube along_wall(const std::vector<WallPoint>& points, double radius) {
    constexpr size_t kParts = 4;  // of each piece, so that the curve follows the bend of the wall
    std::vector<Vec3d> flat;
    for (const WallPoint& p : points) flat.push_back({p.x, p.off, p.z});
    const auto curve = curve_through(flat);
    RegionTube tube;
    tube.radius = radius;
    for (size_t i = 0; i <= kParts * (points.size() - 1); ++i) {
        const Vec3d p = curve(double(i) / double(kParts * (points.size() - 1)));
        tube.point.push_back(at_wall(p, -p.y()));
    }
    return tube;
}

Mesh make_tube(const RegionTube& tube, uint32_t triangles) {
    const CentreLine line = measure_curve(curve_through(tube.point));
    const double r = tube.radius;
    return loft_surface(tube_loft(line, make_profile({{0, 0}, {r, r}, {line.length - r, r}, {line.length, 0}})), triangles);
}

// One piece a tube, each with as many triangles and its own material.
Mesh make_tubes(const std::vector<RegionTube>& tubes, uint32_t triangles) {
    Mesh mesh;
    for (const RegionTube& tube : tubes) {
        const Mesh piece = make_tube(tube, triangles / static_cast<uint32_t>(tubes.size()));
        const uint32_t first = static_cast<uint32_t>(mesh.position.size());
        const uint16_t material = mesh.triangle_material.empty() ? 0 : static_cast<uint16_t>(mesh.triangle_material.back() + 1);
        mesh.position.insert(mesh.position.end(), piece.position.begin(), piece.position.end());
        for (const Triangle& t : piece.triangle) mesh.triangle.push_back({first + t[0], first + t[1], first + t[2]});
        mesh.uv.insert(mesh.uv.end(), piece.uv.begin(), piece.uv.end());
        mesh.triangle_material.resize(mesh.triangle.size(), material);
    }
    return mesh;
}

}  // namespace

Mesh make_inguinal_wall(uint32_t triangles) {
    const InguinalRegion& r = kRegion;
    Loft loft;
    loft.ring = true;
    loft.pieces = 4;
    loft.point = [&r](double u, double v) {
        // the hole outwards, outer surface, outer edge inwards, inner surface
        const double part = v < 4 ? v - std::floor(v) : 0, turn = 2 * M_PI * u, rise = M_PI * (part - 0.5);
        const int piece = v < 4 ? static_cast<int>(v) : 0;
        const double out = piece == 0 ? (1 + std::sin(rise)) / 2 : piece == 1 ? 1 : piece == 2 ? 1 - part : 0;
        const double across = piece == 0 ? 0 : piece == 1 ? part : piece == 2 ? 1 : 1 - part;
        const double hole = piece == 0 ? r.ring - r.rim * std::cos(rise) : r.ring;
        return at_wall(plan(turn, hole, r.wall_x, r.wall_z, across), r.thickness * out);
    };
    Mesh mesh = loft_surface(loft, triangles);
    for (const Triangle& t : mesh.triangle) {
        double out = 0;
        for (const uint32_t v : t) out += (mesh.position[v].y() - r.inside(mesh.position[v].x(), mesh.position[v].z())) / (3 * r.thickness);
        mesh.triangle_material.push_back(out > 0.999 ? 1 : out < 0.001 ? 2 : 0);
    }
    return mesh;
}

Mesh make_peritoneum(uint32_t triangles) {
    const InguinalRegion& r = kRegion;
    constexpr double kLid = 0.05;  // m, height of a cone over the rim that is made and taken away
    Loft loft;
    loft.pieces = 5;
    loft.point = [&r](double u, double v) {
        const double turn = 2 * M_PI * u;
        if (v <= 3) {
            double radius, depth;
            pouch(v, radius, depth);
            return at_wall({radius * std::cos(turn), 0, radius * std::sin(turn)}, depth - r.gap);
        }
        const Vec3d flat = plan(turn, r.sac + r.flare, r.peritoneum_x, r.peritoneum_z, std::min(v - 3, 1.0));
        if (v <= 4) return at_wall(flat, -r.gap);
        const Vec3d top(r.middle_x, -kLid, 0);
        return Vec3d(top + (5 - v) * (at_wall(flat, -r.gap) - top));
    };
    // areas, that of the flat part as if it were flat
    const double neck = r.sac + r.flare, flat = M_PI * (r.peritoneum_x * r.peritoneum_z - neck * neck), round = 2 * M_PI * r.sac * r.sac,
                 tube = 2 * M_PI * r.sac * (r.sac_depth - r.sac - r.flare),
                 bend = M_PI / 2 * r.flare * 2 * M_PI * (r.sac + r.flare * (1 - 2 / M_PI)),
                 lid = M_PI * (r.peritoneum_x + r.peritoneum_z) / 2 * std::hypot((r.peritoneum_x + r.peritoneum_z) / 2, kLid / 2);
    const double sheet = flat + round + tube + bend;
    const Mesh mesh = loft_surface(loft, static_cast<uint32_t>(std::lround(triangles * (1 + lid / sheet))));
    constexpr double kRounding = 1e-9;  // m
    const auto over_sheet = [&](const Vec3d& p) { return p.y() - r.inside(p.x(), p.z()) + r.gap; };
    const auto of_lid = [&](const Vec3d& p) { return over_sheet(p) < -kRounding; };
    const auto of_rim = [&](const Vec3d& p) {
        return std::hypot((p.x() - r.middle_x) / r.peritoneum_x, p.z() / r.peritoneum_z) > 1 - kRounding / r.peritoneum_x;
    };
    Mesh out;
    uint32_t used = 0;  // vertices run from the round end of the sac to the lid
    for (size_t t = 0; t < mesh.triangle.size(); ++t) {
        const auto [a, b, c] = mesh.triangle[t];
        if (of_lid(mesh.position[a]) || of_lid(mesh.position[b]) || of_lid(mesh.position[c])) continue;
        out.triangle.push_back({a, c, b});
        out.uv.push_back({mesh.uv[t][0], mesh.uv[t][2], mesh.uv[t][1]});
        const Vec3d corner[3] = {mesh.position[a], mesh.position[b], mesh.position[c]};
        const bool sac = std::ranges::any_of(corner, [&](const Vec3d& p) { return over_sheet(p) > kRounding; });
        out.triangle_material.push_back(std::ranges::any_of(corner, of_rim) ? 1 : sac ? 2 : 0);
        used = std::max({used, a + 1, b + 1, c + 1});
    }
    out.position.assign(mesh.position.begin(), mesh.position.begin() + used);
    return out;
}

std::vector<RegionTube> cord_tubes() {
    return {along_wall({{-0.0012, -0.0092, -0.012},
                        {-0.0015, -0.0092, -0.004},
                        {-0.003, -0.0125, 0.0003},
                        {-0.012, -0.024, 0.0006},
                        {-0.035, -0.042, 0.0006},
                        {-0.072, -0.060, 0.0004}},
                       0.0013),
            along_wall({{0.0022, -0.0092, -0.012},
                        {0.0025, -0.0092, -0.004},
                        {0.005, -0.0125, 0.0003},
                        {0.014, -0.026, 0.0003},
                        {0.028, -0.045, 0.0002},
                        {0.043, -0.064, -0.0001}},
                       0.0016)};
}

Mesh make_cord(uint32_t triangles) { return make_tubes(cord_tubes(), triangles); }

std::vector<RegionTube> epigastric_tubes() {
    return {along_wall(
        {{-0.007, -0.030, 0.0003}, {-0.015, -0.016, 0.0004}, {-0.0205, 0.004, 0.0004}, {-0.027, 0.032, 0.0003}, {-0.034, 0.064, -0.0001}},
        0.0016)};
}

Mesh make_epigastric_vessels(uint32_t triangles) { return make_tubes(epigastric_tubes(), triangles); }

std::vector<RegionTube> iliac_tubes() {
    return {
        along_wall({{0.010, -0.034, -0.0045}, {0.0125, -0.046, -0.0026}, {0.0155, -0.058, -0.0026}, {0.019, -0.070, -0.0032}}, 0.004),
        along_wall({{-0.001, -0.036, -0.0050}, {0.001, -0.047, -0.0031}, {0.0045, -0.059, -0.0031}, {0.0085, -0.071, -0.0038}}, 0.0045)};
}

Mesh make_iliac_vessels(uint32_t triangles) { return make_tubes(iliac_tubes(), triangles); }

std::vector<RegionTube> pubic_tubes() {
    return {
        along_wall({{-0.098, -0.024, -0.0075}, {-0.080, -0.038, -0.0066}, {-0.055, -0.048, -0.0066}, {-0.030, -0.056, -0.0080}}, 0.008)};
}

Mesh make_pubic_bone(uint32_t triangles) {
    Mesh mesh = make_tubes(pubic_tubes(), triangles);
    const Vec3d crest = Vec3d(0.25, -0.85, 0.46).normalized();
    for (size_t t = 0; t < mesh.triangle.size(); ++t) {
        const auto& [a, b, c] = mesh.triangle[t];
        const Vec3d normal = (mesh.position[b] - mesh.position[a]).cross(mesh.position[c] - mesh.position[a]).normalized();
        mesh.triangle_material[t] = normal.dot(crest) > 0.85 ? 1 : 0;
    }
    return mesh;
}

}  // namespace trocar
