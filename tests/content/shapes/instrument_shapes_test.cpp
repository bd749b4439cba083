#include "content/shapes/instrument_shapes.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "content/mend/admission.hpp"
#include "tests/reference/closed_surface.hpp"
namespace trocar {
namespace {

// Integral by Simpson's rule over n (even) steps.
template <typename F>
double integrate(const F& f, double a, double b, int n = 400) {
    double sum = f(a) + f(b);
    for (int i = 1; i < n; ++i) sum += (i % 2 == 1 ? 4 : 2) * f(a + (b - a) * i / n);
    return sum * (b - a) / n / 3;
}

double in_mm3(const Mesh& mesh) { return reference::survey_surface(mesh).volume * 1e9; }

// Volume of a bar's end rounded over `nose`: sections shrink by c while z grows as sqrt(1 - c^2), so it is
// 2/3 of a prism.
double nose_volume(double section, double nose) { return 2.0 / 3 * section * nose; }

TEST(InstrumentShapes, JawHasTheVolumeOfItsSections) {
    const double last = 3 + 1.4 * kJawTeeth;
    const auto section = [&](double z) {
        const double fraction = (z - 1) / (last - 1), half = 2.2 - 0.5 * fraction, top = 2.4 - 1.1 * fraction;
        const double phase = std::clamp(z - 3, 0.0, last - 3) / 1.4;
        const double base = 0.12 + 0.5 * (1 - std::abs(2 * (phase - std::floor(phase)) - 1));
        // area of |x/a|^3 + |y/b|^3 <= 1 above y = 0
        const double arch = 2 * half * (top - 0.8) * std::pow(std::tgamma(4.0 / 3), 2) / std::tgamma(5.0 / 3);
        return 2 * half * (0.8 - base) + arch;
    };
    double volume = integrate(section, 1, 3) + nose_volume(section(last), 1.6);
    for (uint32_t i = 0; i < 2 * kJawTeeth; ++i) volume += integrate(section, 3 + 0.7 * i, 3.7 + 0.7 * i, 20);
    EXPECT_NEAR(in_mm3(make_grasper_jaw(100000)) / volume, 1, 2e-3);
    EXPECT_NEAR(in_mm3(make_grasper_jaw(10000)) / volume, 1, 6e-3);
}

TEST(InstrumentShapes, JawHasItsTeethAtEverySize) {
    for (const uint32_t triangles : {600u, 1000u, 10000u}) {
        // bottoms of notches are at y = 0.62 and crests at 0.12, in the middle of the face's width
        std::set<long> notch, crest;
        for (const Vec3d& p : make_grasper_jaw(triangles).position) {
            const double z = p.z() * 1e3, y = p.y() * 1e3;
            if (z < 2.9 || z > 3.1 + 1.4 * kJawTeeth) continue;
            if (std::abs(y - 0.62) < 1e-9) notch.insert(std::lround(z * 1e4));
            if (std::abs(y - 0.12) < 1e-9) crest.insert(std::lround(z * 1e4));
        }
        EXPECT_EQ(notch.size(), kJawTeeth) << triangles;
        EXPECT_EQ(crest.size(), kJawTeeth + 1) << triangles;
    }
}

TEST(InstrumentShapes, BladeHasTheVolumeOfItsSectionsAndASharpEdge) {
    const auto section = [](double z) {
        const double fraction = (z + 3) / 19.5, wide = 3.4 - 2.3 * fraction * fraction, thick = 1.1 - 0.5 * fraction;
        return thick * (wide - (0.95 - 0.35 * fraction) / 2);
    };
    const double volume = integrate(section, -3, 16.5) + nose_volume(section(16.5), 1.5);
    EXPECT_NEAR(in_mm3(make_scissor_blade(100000)) / volume, 1, 1e-3);
    for (const uint32_t triangles : {1000u, 10000u}) {
        const Mesh mesh = make_scissor_blade(triangles);
        EXPECT_NEAR(in_mm3(mesh) / volume, 1, 0.01) << triangles;
        // angle between the faces on both sides of the edges on the line x = 0.9 mm, y = 0
        const auto on_edge = [&](uint32_t v) {
            const Vec3d& p = mesh.position[v];
            return std::abs(p.x() - 0.9e-3) < 1e-12 && std::abs(p.y()) < 1e-12;
        };
        std::map<std::pair<uint32_t, uint32_t>, Vec3d> normal;
        for (const Triangle& t : mesh.triangle) {
            const Vec3d &a = mesh.position[t[0]], &b = mesh.position[t[1]], &c = mesh.position[t[2]];
            for (int k = 0; k < 3; ++k) normal[{t[k], t[(k + 1) % 3]}] = (b - a).cross(c - a).normalized();
        }
        double length = 0;
        for (const auto& [edge, n] : normal) {
            if (edge.first > edge.second || !on_edge(edge.first) || !on_edge(edge.second)) continue;
            const double angle = 180 - std::acos(n.dot(normal.at({edge.second, edge.first}))) * 180 / M_PI;
            EXPECT_GT(angle, 44);
            EXPECT_LT(angle, 56);
            length += (mesh.position[edge.first] - mesh.position[edge.second]).norm();
        }
        EXPECT_NEAR(length, 19.5e-3, 1e-9) << triangles;
    }
}

TEST(InstrumentShapes, NeedleIsAHalfCircleWithATaperedPoint) {
    const double r = 0.33, arc = 26 / M_PI;
    const Mesh mesh = make_needle(20000);
    double tip = 1e9;
    for (const Vec3d& metres : mesh.position) {
        const Vec3d p = metres * 1e3;
        const double from_circle = std::hypot(std::hypot(p.x(), p.y()) - arc, p.z());
        ASSERT_LT(from_circle, r + 1e-4);
        ASSERT_GT(p.y(), -r);
        tip = std::min(tip, (p - Vec3d(-arc, 0, 0)).norm());
    }
    EXPECT_LT(tip, 1e-4);
    // the blunt end is a hemisphere, the body a cylinder up to 17 mm, then the squared radius falls as 1 - 3
    // x^2 + 2 x^3
    const double volume = M_PI * r * r * (2.0 / 3 * r + (17 - r) + 9.0 / 2);
    EXPECT_NEAR(in_mm3(mesh) / volume, 1, 0.01);
    // within a millimetre of the point the needle is no thicker than the cone: r sqrt(3) / 9
    for (const Vec3d& metres : mesh.position) {
        const Vec3d p = metres * 1e3;
        const double fraction = std::atan2(p.y(), -p.x()) * arc;
        if (p.x() < 0 && fraction < 1) {
            EXPECT_LT(std::hypot(std::hypot(p.x(), p.y()) - arc, p.z()), r * std::sqrt(3.0) / 9 * (fraction + 0.02));
        }
    }
}

TEST(InstrumentShapes, TackerIsABoredTubeAndASpiral) {
    const double coil = std::hypot(2 * M_PI * 1.6 * 2.5, 1.5 * 2.5);
    const double tack = M_PI * 0.09 * (2.0 / 3 * 0.3 + (coil - 3.3) + 1.5);
    const double tube = M_PI * (2.5 * 2.5 * 25 - 2.1 * 2.1 * 3);
    const Mesh mesh = make_tacker(100000);
    EXPECT_NEAR(in_mm3(mesh) / (tack + tube), 1, 2e-3);
    double top = 0, wide = 0;
    for (const Vec3d& p : mesh.position) {
        top = std::max(top, p.z());
        if (p.z() > 1e-9) wide = std::max(wide, std::hypot(p.x(), p.y()));
    }
    EXPECT_NEAR(2 * wide, 3.8e-3, 1e-6);
    EXPECT_NEAR(top, 2.25e-3, 0.1e-3);
}

TEST(InstrumentShapes, PairsAreThreePiecesThatDoNotTouch) {
    for (const uint32_t triangles : {1000u, 10000u}) {
        for (const Mesh& mesh : {make_grasper(triangles), make_scissors(triangles)}) {
            const MeshJudgement judgement = judge_mesh(mesh);
            EXPECT_EQ(judgement.components, 3u) << triangles;
            EXPECT_EQ(judgement.self_crossing + judgement.self_touching, 0u) << triangles;
            EXPECT_EQ(judgement.admitted_as, Admission::kSolid) << judgement.reason;
            EXPECT_NEAR(double(mesh.triangle.size()), triangles, 0.05 * triangles);
        }
        // the second jaw is the first rotated by 180 degrees about z
        const Mesh mesh = make_grasper(triangles);
        Vec3d sum = Vec3d::Zero();
        for (size_t t = 0; t < mesh.triangle.size(); ++t) {
            if (mesh.triangle_material[t] != 0) continue;
            for (const uint32_t v : mesh.triangle[t]) sum += mesh.position[v];
        }
        EXPECT_NEAR(std::hypot(sum.x(), sum.y()), 0, 1e-9);
    }
}

}  // namespace
}  // namespace trocar
