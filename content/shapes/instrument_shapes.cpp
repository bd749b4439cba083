#include "content/shapes/instrument_shapes.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "content/shapes/tube.hpp"
namespace trocar {
namespace {

// Everything below is in millimetres; in_metres converts at the end.
Mesh in_metres(Mesh mesh) {
    for (Vec3d& p : mesh.position) p *= 1e-3;
    return mesh;
}

constexpr uint16_t kSteel = 0, kInsulation = 1;

void append(const Mesh& part, uint16_t material, Mesh& mesh) {
    const uint32_t first = static_cast<uint32_t>(mesh.position.size());
    mesh.position.insert(mesh.position.end(), part.position.begin(), part.position.end());
    for (const Triangle& t : part.triangle) mesh.triangle.push_back({t[0] + first, t[1] + first, t[2] + first});
    mesh.uv.insert(mesh.uv.end(), part.uv.begin(), part.uv.end());
    mesh.triangle_material.insert(mesh.triangle_material.end(), part.triangle.size(), material);
}

Mesh rotated(Mesh mesh, double degrees, const Vec3d& axis) {
    const Eigen::Matrix3d turn = Eigen::AngleAxisd(degrees * M_PI / 180, axis).toRotationMatrix();
    for (Vec3d& p : mesh.position) p = turn * p;
    return mesh;
}

// Corner in the outline of a surface of revolution about z.
struct Turn {
    double radius, height;
};

// Surface of revolution with a piecewise straight outline that starts and ends on the axis.
Mesh revolve(const std::vector<Turn>& outline, uint32_t triangles) {
    Loft loft;
    loft.pieces = static_cast<uint32_t>(outline.size()) - 1;
    loft.samples = 16;
    loft.tile = 8;
    loft.fewest = 16;
    loft.point = [outline](double u, double v) {
        const size_t i = std::min(static_cast<size_t>(v), outline.size() - 2);
        const double t = v - double(i);
        const double radius = outline[i].radius + t * (outline[i + 1].radius - outline[i].radius);
        return Vec3d(radius * std::cos(2 * M_PI * u), radius * std::sin(2 * M_PI * u),
                     outline[i].height + t * (outline[i + 1].height - outline[i].height));
    };
    return loft_surface(loft, triangles);
}

constexpr double kShaft = 25;

Mesh make_shaft(double end, uint32_t triangles) {
    return revolve({{0, end - kShaft}, {2.5, end - kShaft}, {2.5, end - 0.6}, {1.9, end}, {0, end}}, triangles);
}

// A bar along z with cross-section `section(u, z)`, flat lower end, upper end rounded over `nose`.
struct Bar {
    std::function<Vec3d(double u, double z)> section;
    std::vector<double> knot;  // z of mandatory rings, ascending
    double nose = 1;
};

Loft bar_loft(Bar bar, std::vector<double> corner) {
    Loft loft;
    loft.pieces = static_cast<uint32_t>(bar.knot.size()) + 1;
    loft.corner = std::move(corner);
    loft.samples = 16;
    loft.tile = 8;
    loft.point = [bar = std::move(bar)](double u, double v) {
        const size_t last = bar.knot.size();
        const size_t piece = std::min(static_cast<size_t>(v), last);
        const double t = v - double(piece);
        const auto middle = [&](double z) {
            return Vec3d((bar.section(0, z) + bar.section(0.25, z) + bar.section(0.5, z) + bar.section(0.75, z)) / 4);
        };
        if (piece == 0) {
            const double z = bar.knot.front();
            return Vec3d(middle(z) + t * (bar.section(u, z) - middle(z)));
        }
        if (piece < last) return bar.section(u, bar.knot[piece - 1] + t * (bar.knot[piece] - bar.knot[piece - 1]));
        const double z = bar.knot.back();
        const Vec3d tip = middle(z) + Vec3d(0, 0, bar.nose);
        const Vec3d rim = bar.section(u, z);
        const double c = std::cos(M_PI / 2 * t), s = std::sin(M_PI / 2 * t);
        const Vec3d across = middle(z) + c * (rim - middle(z));
        return Vec3d(across.x(), across.y(), z + s * (tip.z() - z));
    };
    return loft;
}

Mesh jaw_in_mm(uint32_t triangles) {
    constexpr double kStart = 1, kFirst = 3, kPitch = 1.4, kDepth = 0.5, kNose = 1.6;
    const double last = kFirst + kPitch * kJawTeeth;
    Bar bar;
    bar.nose = kNose;
    bar.knot.push_back(kStart);
    for (uint32_t i = 0; i <= 2 * kJawTeeth; ++i) bar.knot.push_back(kFirst + kPitch / 2 * i);
    bar.section = [last](double u, double z) {
        const double fraction = (z - kStart) / (last - kStart);
        const double half = 2.2 - 0.5 * fraction, top = 2.4 - 1.1 * fraction;
        // crests at the ends and between the notches, valleys in the middle of each notch
        const double phase = std::clamp(z - kFirst, 0.0, kPitch * kJawTeeth) / kPitch;
        const double valley = 1 - std::abs(2 * (phase - std::floor(phase)) - 1);
        const double base = 0.12 + kDepth * valley;
        // face, wall, half a superellipse of power 3, wall
        constexpr double kWall = 0.8;
        const double t = 4 * u - std::floor(4 * u);
        if (u < 0.25) return Vec3d(half * (2 * t - 1), base, z);
        if (u < 0.5) return Vec3d(half, base + t * (kWall - base), z);
        if (u >= 0.75) return Vec3d(-half, kWall + t * (base - kWall), z);
        const auto round = [](double x) { return std::copysign(std::pow(std::abs(x), 2.0 / 3), x); };
        return Vec3d(half * round(std::cos(M_PI * t)), kWall + (top - kWall) * round(std::sin(M_PI * t)), z);
    };
    return loft_surface(bar_loft(std::move(bar), {0, 0.25, 0.5, 0.75}), triangles);
}

Mesh blade_in_mm(uint32_t triangles) {
    constexpr double kHeel = -3, kEnd = 16.5;
    Bar bar;
    bar.nose = 1.5;
    bar.knot = {kHeel, kEnd};
    bar.section = [](double u, double z) {
        const double fraction = (z - kHeel) / (kEnd - kHeel);
        const double wide = 3.4 - 2.3 * fraction * fraction, thick = 1.1 - 0.5 * fraction, bevel = 0.95 - 0.35 * fraction;
        constexpr double kEdge = 0.9;
        const Vec3d corner[5] = {{kEdge, 0, z}, {kEdge - bevel, thick, z}, {kEdge - wide, thick, z}, {kEdge - wide, 0, z}, {kEdge, 0, z}};
        const size_t side = std::min<size_t>(static_cast<size_t>(4 * u), 3);
        return Vec3d(corner[side] + (4 * u - double(side)) * (corner[side + 1] - corner[side]));
    };
    return loft_surface(bar_loft(std::move(bar), {0, 0.25, 0.5, 0.75}), triangles);
}

}  // namespace

Mesh make_grasper_jaw(uint32_t triangles) { return in_metres(jaw_in_mm(triangles)); }

Mesh make_grasper(uint32_t triangles) {
    const Mesh jaw = jaw_in_mm(triangles * 2 / 5);
    Mesh mesh;
    append(make_shaft(0.2, triangles - triangles * 2 / 5 * 2), kInsulation, mesh);
    append(rotated(jaw, -15, Vec3d::UnitX()), kSteel, mesh);
    append(rotated(rotated(jaw, -15, Vec3d::UnitX()), 180, Vec3d::UnitZ()), kSteel, mesh);
    return in_metres(std::move(mesh));
}

Mesh make_scissor_blade(uint32_t triangles) { return in_metres(blade_in_mm(triangles)); }

Mesh make_scissors(uint32_t triangles) {
    Mesh blade = blade_in_mm(triangles * 2 / 5);
    for (Vec3d& p : blade.position) p.y() += 0.03;  // small clearance between the two blades
    Mesh mesh;
    append(make_shaft(-3.7, triangles - triangles * 2 / 5 * 2), kInsulation, mesh);
    append(rotated(blade, -15, Vec3d::UnitY()), kSteel, mesh);
    append(rotated(rotated(blade, -15, Vec3d::UnitY()), 180, Vec3d::UnitZ()), kSteel, mesh);
    return in_metres(std::move(mesh));
}

Mesh make_needle(uint32_t triangles) {
    constexpr double kLength = 26, kThick = 0.33;
    const CentreLine line =
        measure_curve([](double t) { return Vec3d(kLength / M_PI * std::cos(M_PI * t), kLength / M_PI * std::sin(M_PI * t), 0); });
    const RadiusProfile profile = make_profile({{0, 0}, {kThick, kThick}, {17, kThick}, {line.length, 0}}, true);
    Loft loft = tube_loft(line, profile);
    loft.size = [profile](double v) {
        const double radius = profile.radius(profile.key.back().s * (1 - std::cos(M_PI / 2 * v)));
        return v < 0.5 ? 1.0 : std::max(0.3, radius / kThick);
    };
    loft.tile = 2;
    return in_metres(loft_surface(loft, triangles));
}

Mesh make_tacker(uint32_t triangles) {
    constexpr double kWire = 0.3, kCoil = 1.6, kTurns = 2.5, kPitch = 1.5;
    const CentreLine line = measure_curve([](double t) {
        const double angle = 2 * M_PI * kTurns * t;
        return Vec3d(kCoil * std::cos(angle), kCoil * std::sin(angle), kPitch * kTurns * (t - 0.4));
    });
    const RadiusProfile profile = make_profile({{0, 0}, {kWire, kWire}, {line.length - 3, kWire}, {line.length, 0}}, true);
    Loft tack = tube_loft(line, profile);
    tack.tile = 2;
    Mesh mesh;
    append(revolve({{0, -kShaft}, {2.5, -kShaft}, {2.5, 0}, {2.1, 0}, {2.1, -3}, {0, -3}}, triangles / 2), kInsulation, mesh);
    append(loft_surface(tack, triangles - triangles / 2), kSteel, mesh);
    return in_metres(std::move(mesh));
}

}  // namespace trocar
