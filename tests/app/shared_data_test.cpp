#include "tests/reference/shared_data.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <random>

#include "tests/app/run_program.hpp"
#include "tests/reference/brute_force_distance.hpp"

// The built program on files of real organs and instruments, if their folder exists, compared with brute
// force over triangles read by a simple reader of the tests' own.
namespace {
using namespace trocar;
namespace fs = std::filesystem;

double unsigned_distance(const Mesh& m, const Vec3d& p) { return brute_force_distance(m.position, m.triangle, p).distance; }
// Generalised winding number of the file's triangles (Jacobson 2013).
double winding(const Mesh& m, const Vec3d& p) {
    double sum = 0;
    for (const Triangle& t : m.triangle) {
        const Vec3d a = m.position[t[0]] - p, b = m.position[t[1]] - p, c = m.position[t[2]] - p;
        const double la = a.norm(), lb = b.norm(), lc = c.norm();
        sum += std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
    }
    return sum / (2 * M_PI);
}
double signed_distance(const Mesh& m, const Vec3d& p) {
    return std::abs(winding(m, p)) > 0.5 ? -unsigned_distance(m, p) : unsigned_distance(m, p);
}

Mesh unique_vertices(const Mesh& m) {
    Mesh out;
    std::map<std::array<double, 3>, uint32_t> row;
    for (const Triangle& t : m.triangle) {
        Triangle to{};
        for (int k = 0; k < 3; ++k) {
            const Vec3d& p = m.position[t[k]];
            const auto [at, added] = row.insert({{p.x(), p.y(), p.z()}, uint32_t(out.position.size())});
            if (added) out.position.push_back(p);
            to[k] = at->second;
        }
        out.triangle.push_back(to);
    }
    return out;
}

struct Box3 {
    Vec3d low = Vec3d::Constant(1e300), high = Vec3d::Constant(-1e300);
    explicit Box3(const Mesh& m) {
        for (const Vec3d& p : m.position) low = low.cwiseMin(p), high = high.cwiseMax(p);
    }
    double diagonal() const { return (high - low).norm(); }
};

class LongSharedFiles : public testing::Test {
 protected:
    void SetUp() override {
        if (shared_data_folder().empty()) GTEST_SKIP() << "no folder of real meshes";
        folder_ = fs::path(testing::TempDir()) / (std::string("trocar_") + testing::UnitTest::GetInstance()->current_test_info()->name());
        fs::create_directories(folder_);
    }
    void TearDown() override { fs::remove_all(folder_); }
    fs::path folder_;
};

TEST_F(LongSharedFiles, QueryEqualsBruteForce) {
    uint32_t files = 0, inside = 0, open = 0;
    for (const char* name : {"organs/Kidney_left.stl", "organs/Liver.stl", "organs/Stomach.stl", "organs/gallbladder_collision.stl",
                             "organs/gallbladder_visual.stl", "organs-lgpl/liver.obj", "organs/small_intestine_20k.vtk",
                             "instruments/instrument_shaft.stl", "instruments/scissors_jaw_left.stl", "instruments/forceps_jaw_right.stl",
                             "instruments/maryland_dissector_jaw_left.stl", "instruments/dissection_electrode.stl"}) {
        const std::string path = reference::shared_data(name);
        const Mesh mesh = reference::read_plain_mesh(path);
        if (mesh.triangle.empty()) continue;
        const Box3 box(mesh);
        std::mt19937 random(7);
        std::uniform_real_distribution<double> unit(0, 1);
        std::normal_distribution<double> normal(0, 0.02 * box.diagonal());
        std::vector<Vec3d> points;
        std::string csv = "x,y,z\n";
        for (int i = 0; i < 120; ++i) {
            Vec3d p = box.low + (box.high - box.low).cwiseProduct(Vec3d(unit(random), unit(random), unit(random)));
            if (i % 3) p = mesh.position[random() % mesh.position.size()] + Vec3d(normal(random), normal(random), normal(random));
            points.push_back(p);
            char line[96];
            std::snprintf(line, sizeof line, "%.17g,%.17g,%.17g\n", p.x(), p.y(), p.z());
            csv += line;
        }
        std::ofstream(folder_ / "points.csv") << csv;
        const Outcome outcome = run_program("query " + path + " " + (folder_ / "points.csv").string(), folder_, folder_);
        ASSERT_EQ(outcome.code, 0) << name << ": " << outcome.err;
        const double least = std::abs(winding(mesh, box.high + (box.high - box.low)));
        std::istringstream lines(outcome.out);
        std::string line;
        std::getline(lines, line);
        ++files;
        for (const Vec3d& p : points) {
            ASSERT_TRUE(std::getline(lines, line)) << name;
            double d, x, y, z;
            ASSERT_EQ(std::sscanf(line.c_str(), "%lf,%lf,%lf,%lf", &d, &x, &y, &z), 4) << line;
            const double want = unsigned_distance(mesh, p), w = std::abs(winding(mesh, p));
            EXPECT_NEAR(std::abs(d), want, 1e-6 * box.diagonal()) << name;
            EXPECT_NEAR((p - Vec3d(x, y, z)).norm(), want, 1e-6 * box.diagonal()) << name;
            // an open surface has no integer winding number, and no inside to compare
            if (std::abs(w - std::round(w)) > 1e-6 || least > 1e-6) {
                ++open;
                continue;
            }
            EXPECT_EQ(d<0, w> 0.5) << name;
            inside += d < 0;
        }
    }
    if (files == 0) GTEST_SKIP() << "none of the files is there";
    EXPECT_GT(inside, 100u);
    std::printf("[          ] %u files, %u points inside, %u beside surfaces that are not closed\n", files, inside, open);
}

// Numbers of vertices inside, depth and witness for pairs of files, and every field of the answer.
TEST_F(LongSharedFiles, CollideEqualsBruteForce) {
    const std::vector<std::array<const char*, 2>> pairs{{"organs/Kidney_left.stl", "organs/gallbladder_collision.stl"},
                                                        {"organs/Stomach.stl", "organs/gallbladder_collision.stl"},
                                                        {"organs/gallbladder_collision.stl", "instruments/scissors_jaw_left.stl"},
                                                        {"organs/Kidney_left.stl", "instruments/instrument_shaft.stl"},
                                                        {"organs/Kidney_left.stl", "instruments/forceps_jaw_right.stl"}};
    uint32_t compared = 0;
    for (const auto& [name_a, name_b] : pairs) {
        const std::string path_a = reference::shared_data(name_a), path_b = reference::shared_data(name_b);
        const Mesh a = unique_vertices(reference::read_plain_mesh(path_a)), b = unique_vertices(reference::read_plain_mesh(path_b));
        if (a.triangle.empty() || b.triangle.empty()) continue;
        const std::string what = std::string(name_a) + " and " + name_b;
        Vec3d middle = Vec3d::Zero();
        for (const Vec3d& p : a.position) middle += p / double(a.position.size());
        for (const double share : {0.2, 0.6}) {
            const Vec3d touched = a.position[size_t(share * double(a.position.size()))];
            const Vec3d move = touched - b.position[b.position.size() / 2] + 0.02 * Box3(a).diagonal() * (middle - touched).normalized();
            Mesh moved = b;
            for (Vec3d& p : moved.position) p += move;
            char text[128];
            std::snprintf(text, sizeof text, " --move-b \"%.17g %.17g %.17g\"", move.x(), move.y(), move.z());
            const std::string command =
                "collide " + path_a + " " + path_b + text + " --json --cross-check" + (share < 0.5 && compared < 2 ? " --separate" : "");
            const Outcome outcome = run_program(command, folder_, folder_);
            ASSERT_EQ(outcome.code, 0) << what << ": " << outcome.err;
            const nlohmann::json j = nlohmann::json::parse(outcome.out);
            for (const char* key :
                 {"overlap", "depth", "surface_depth", "direction", "witness", "vertices_a_in_b", "vertices_b_in_a", "edge_contacts",
                  "face_contacts", "cells", "contained", "saturated", "regions", "disagreements", "time_ms"})
                ASSERT_TRUE(j.contains(key)) << key;
            const double size = Box3(a).diagonal();
            double deepest = 0;
            const auto count = [&](const Mesh& own, const Mesh& other) {
                const Box3 box(other);
                uint32_t inside = 0;
                for (const Vec3d& p : own.position) {
                    if ((p.array() < box.low.array()).any() || (p.array() > box.high.array()).any()) continue;
                    const double d = signed_distance(other, p);
                    inside += d < 0;
                    deepest = std::max(deepest, -d);
                }
                return inside;
            };
            const uint32_t a_in_b = count(a, moved), b_in_a = count(moved, a);
            EXPECT_EQ(j["vertices_a_in_b"], a_in_b) << what;
            EXPECT_EQ(j["vertices_b_in_a"], b_in_a) << what;
            EXPECT_GE(j["depth"].get<double>(), deepest - 1e-6 * size) << what;
            EXPECT_EQ(j["disagreements"], 0) << what;
            if (!j["overlap"].get<bool>()) {
                EXPECT_EQ(a_in_b + b_in_a, 0u) << what;
                continue;
            }
            ++compared;
            // the witness has that depth in one of the two and lies on the other
            const auto& w = j["witness"]["point"];
            const Vec3d p(w[0].get<double>(), w[1].get<double>(), w[2].get<double>());
            const double in_a = signed_distance(a, p), in_b = signed_distance(moved, p);
            EXPECT_NEAR(std::min(in_a, in_b), -j["depth"].get<double>(), 1e-6 * size) << what;
            EXPECT_NEAR(std::abs(std::max(in_a, in_b)), 0, 1e-6 * size) << what;
            uint32_t in_regions = 0;
            for (const auto& region : j["regions"]) {
                for (const char* key : {"vertices_a", "vertices_b", "contour", "area", "volume", "depth", "direction", "witness"})
                    ASSERT_TRUE(region.contains(key)) << key;
                EXPECT_GT(region["volume"], 0) << what;
                in_regions += region["vertices_a"].get<uint32_t>() + region["vertices_b"].get<uint32_t>();
            }
            EXPECT_EQ(in_regions, a_in_b + b_in_a) << what;
            if (!j.contains("separation")) continue;
            const auto& s = j["separation"];
            EXPECT_LE(s["lower"].get<double>(), s["upper"].get<double>()) << what;
            EXPECT_EQ(s["lower"], j["depth"]) << what;
            const Vec3d out(s["translation"][0].get<double>(), s["translation"][1].get<double>(), s["translation"][2].get<double>());
            EXPECT_NEAR(out.norm(), s["upper"], 1e-9 * size) << what;
            // after this translation no vertex of one is inside the other
            Mesh free = moved;
            for (Vec3d& v : free.position) v += out;
            deepest = 0;
            EXPECT_EQ(count(a, free) + count(free, a), 0u) << what;
        }
    }
    if (compared == 0) GTEST_SKIP() << "none of the files is there";
    EXPECT_GE(compared, 5u);
}

}  // namespace
