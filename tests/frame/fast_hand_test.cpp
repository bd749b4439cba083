#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <fstream>
#include <iomanip>
#include <random>
#include <sstream>

#include "engine/mesh/surfaces.hpp"
#include "engine/world/world.hpp"
#include "frame/written_scene.hpp"

// Hands at 0.5 to 5 m/s through sheets and thin shells that are held at two borders.
namespace trocar {
namespace {

constexpr double kHalf = 0.03;  // m, of the tissue

struct Stroke {
    bool sheet = true;
    int dof = 3, rate = 60;
    double thick = 1e-3, radius = 2e-3, speed = 2, modulus = 5e4;  // m, m, m/s, Pa
    Vec3d from = Vec3d::Zero(), to = Vec3d::Zero();                // m
};

Stroke any_stroke(std::mt19937& random, int i) {
    const auto between = [&](double low, double high) { return low + (high - low) * (random() / 4294967296.0); };
    const auto spread = [&](double low, double high) { return std::exp(between(std::log(low), std::log(high))); };
    Stroke s;
    s.sheet = i % 2 == 0, s.dof = i / 2 % 2 == 0 ? 3 : 6;
    s.rate = std::array{60, 120, 240}[random() % 3];
    s.thick = spread(2e-4, 5e-3), s.radius = spread(5e-4, 1e-2), s.speed = between(0.5, 5), s.modulus = spread(5e3, 3e5);
    const double high = s.radius + s.thick + between(5e-3, 2e-2);
    s.from = {between(-0.01, 0.01), between(-0.01, 0.01), high};
    s.to = {s.from.x() + between(-0.01, 0.01), s.from.y() + between(-0.01, 0.01), -high};
    return s;
}

// A square plate of n x n cells: a sheet in z = 0, or a closed shell around it.
void write_plate(const std::filesystem::path& path, int n, double thick, bool sheet) {
    std::ofstream file(path);
    const auto vertex = [&](int i, int j, int side) { return (sheet ? 0 : side) * (n + 1) * (n + 1) + i * (n + 1) + j + 1; };
    const auto quad = [&](int a, int b, int c, int d) {
        file << "f " << a << " " << b << " " << c << "\nf " << a << " " << c << " " << d << "\n";
    };
    for (int side = 0; side < (sheet ? 1 : 2); ++side)
        for (int i = 0; i <= n; ++i)
            for (int j = 0; j <= n; ++j)
                file << "v " << kHalf * (2.0 * i / n - 1) << " " << kHalf * (2.0 * j / n - 1) << " " << (sheet ? 0 : (side - 0.5) * thick)
                     << "\n";
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
            quad(vertex(i, j, 1), vertex(i + 1, j, 1), vertex(i + 1, j + 1, 1), vertex(i, j + 1, 1));
            if (!sheet) quad(vertex(i, j, 0), vertex(i, j + 1, 0), vertex(i + 1, j + 1, 0), vertex(i + 1, j, 0));
        }
    for (int i = 0; !sheet && i < n; ++i) {
        quad(vertex(i, 0, 0), vertex(i + 1, 0, 0), vertex(i + 1, 0, 1), vertex(i, 0, 1));
        quad(vertex(i, n, 0), vertex(i, n, 1), vertex(i + 1, n, 1), vertex(i + 1, n, 0));
        quad(vertex(0, i, 0), vertex(0, i, 1), vertex(0, i + 1, 1), vertex(0, i + 1, 0));
        quad(vertex(n, i, 0), vertex(n, i + 1, 0), vertex(n, i + 1, 1), vertex(n, i, 1));
    }
}

std::string scene_of(const Stroke& s, const std::string& mesh) {
    std::ostringstream text;
    const auto at = [](const Vec3d& p) {
        std::ostringstream list;
        list << std::fixed << std::setprecision(9);
        list << "[" << p.x() << ", " << p.y() << ", " << p.z() << "]";
        return list.str();
    };
    text << std::fixed << std::setprecision(9) << "gravity = [0, 0, 0]\n[contact]\nrate = " << s.rate
         << "\n[[body]]\nname = \"tissue\"\nfile = \"" << mesh << "\"\nmotion = \"deformable\"\nanchor = \"world\"\n"
         << (s.sheet ? "thickness = " + std::to_string(s.thick) + "\n" : "")
         << "[[body.region]]\nbox = [-1, -1, -1, -0.027, 1, 1]\nfixed = true\n[[body.region]]\nbox = [0.027, -1, -1, 1, 1, 1]\nfixed = "
            "true\n"
         << "[body.tissue]\nyoungs_modulus = " << s.modulus
         << "\ndamping = 10\n[[body]]\nname = \"tool\"\nshape = \"sphere\"\nsize = " << 2 * s.radius
         << "\ntriangles = 320\nmotion = \"hand\"\nposition = " << at(s.from) << "\n[[tool]]\nbody = \"tool\"\ndof = " << s.dof
         << "\nmax_force = 10\npath = [{time = 0, position = " << at(s.from) << "}, {time = " << (s.to - s.from).norm() / s.speed
         << ", position = " << at(s.to) << "}]\n";
    return text.str();
}

// Faces of the tissue straight above a point: none while the point is on the side from which it came.
int faces_above(const World& w, const Vec3d& p) {
    const Surfaces s = surfaces_of(w);
    int above = 0;
    for (const Triangle& t : mesh_view(w.meshes, w.bodies.mesh[0]).triangle) {
        const Vec3d a = vertex_position(s, 0, t[0]) - p, b = vertex_position(s, 0, t[1]) - p, c = vertex_position(s, 0, t[2]) - p;
        const double bc = b.x() * c.y() - b.y() * c.x(), ca = c.x() * a.y() - c.y() * a.x(), ab = a.x() * b.y() - a.y() * b.x();
        const double sum = bc + ca + ab;
        if (sum == 0 || bc / sum < 0 || ca / sum < 0 || ab / sum < 0) continue;
        above += (bc * a.z() + ca * b.z() + ab * c.z()) / sum > 0;
    }
    return above;
}

// None of them ends beyond the tissue unless that is counted, by the tool and the body. Half of these are held, with a force.
TEST(FastHand, IsHeldOrCounted) {
    std::mt19937 random(7);
    int held = 0;
    const auto mesh = std::filesystem::temp_directory_path() / ("trocar_plate_of_fast_hand_" + std::to_string(getpid()) + ".obj");
    constexpr int kStrokes = 12;
    for (int i = 0; i < kStrokes; ++i) {
        const Stroke stroke = any_stroke(random, i);
        write_plate(mesh, 10, stroke.thick, stroke.sheet);
        const WrittenScene scene("fast_hand" + std::to_string(i), scene_of(stroke, mesh.string()));
        const int passes = static_cast<int>(((stroke.to - stroke.from).norm() / stroke.speed + 0.05) * stroke.rate) + 1;
        bool beyond = false;
        double force = 0;
        uint64_t counted = 0;
        run(scene.build().world, passes, [&](const Frame& frame, int pass) {
            const World& w = frame.world();
            if (pass + 1 < passes) return;
            beyond = faces_above(w, w.poses.origin[1]) > 0;
            force = w.haptics.state[0].output.force.norm();
            counted = w.report.passed_surfaces;
            EXPECT_EQ(w.passed_surfaces.times[0], counted);
            EXPECT_EQ(w.passed_surfaces.body[0], counted > 0 ? 0 : kNone);
        });
        const bool is_held = !beyond && force > 0;
        held += is_held;
        EXPECT_TRUE(is_held || counted > 0) << i << ": " << stroke.speed << " m/s, " << 1e3 * stroke.radius << " mm, " << stroke.rate
                                            << " Hz, " << 1e3 * stroke.thick << " mm, " << stroke.dof << " degrees of freedom, " << force
                                            << " N";
    }
    std::filesystem::remove(mesh);
    EXPECT_GE(held, kStrokes / 2);
}

}  // namespace
}  // namespace trocar
