#pragma once
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <string>

#include "content/read/load_mesh.hpp"
#include "engine/base/error.hpp"
#include "reference/paths.hpp"
namespace trocar {

// Elementary properties of a surface, computed in the simplest way.
struct MeshSums {
    Vec3d min = Vec3d::Constant(1e300), max = Vec3d::Constant(-1e300);
    double volume = 0, area = 0;
    size_t unpaired = 0;  // directed edges without their opposite: 0 for a closed, oriented surface
};

inline MeshSums sum_mesh(const Mesh& mesh) {
    MeshSums sums;
    std::map<std::pair<uint32_t, uint32_t>, int> edges;
    for (const Vec3d& p : mesh.position) {
        sums.min = sums.min.cwiseMin(p);
        sums.max = sums.max.cwiseMax(p);
    }
    for (const Triangle& t : mesh.triangle) {
        // relative to a corner of the box, so that thin shells far from the origin do not lose their volume
        // to rounding
        const Vec3d a = mesh.position[t[0]] - sums.min, b = mesh.position[t[1]] - sums.min, c = mesh.position[t[2]] - sums.min;
        const Vec3d u = b - a, v = c - a;
        const Vec3d n(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]);
        sums.area += n.norm() / 2;
        sums.volume += a.dot(n) / 6;
        for (size_t k = 0; k < 3; ++k) {
            ++edges[{t[k], t[(k + 1) % 3]}];
            --edges[{t[(k + 1) % 3], t[k]}];
        }
    }
    for (const auto& [edge, count] : edges) sums.unpaired += count > 0 ? static_cast<size_t>(count) : 0;
    return sums;
}

inline LoadedMesh load_text(const std::string& text) { return load_mesh(text, "a.wrl"); }

// The InputError message of load_mesh for this file, or for bytes with this name; "no error" if there is
// none.
template <typename... Source>
std::string load_error(const Source&... source) {
    try {
        load_mesh(source...);
    } catch (const InputError& error) {
        return error.what();
    }
    return "no error";
}
inline std::string error_of_text(const std::string& text) { return load_error(text, "a.wrl"); }

// Expects the corner tetrahedron of the unit cube, in a file of any name.
inline void expect_tetra(const std::string& bytes, const std::string& format) {
    const LoadedMesh loaded = load_mesh(bytes, "a.dat");
    EXPECT_EQ(loaded.format, format);
    EXPECT_EQ(loaded.mesh.position.size(), 4u);
    const MeshSums sums = sum_mesh(loaded.mesh);
    EXPECT_DOUBLE_EQ(sums.volume, 1.0 / 6);
    EXPECT_EQ(sums.unpaired, 0u);
}

inline bool warns(const LoadedMesh& loaded, const std::string& part) {
    for (const std::string& warning : loaded.warnings) {
        if (warning.find(part) != std::string::npos) return true;
    }
    return false;
}

// A temporary folder for each test, removed afterwards.
struct FolderTest : testing::Test {
    std::filesystem::path folder;
    void SetUp() override {
        const auto* info = testing::UnitTest::GetInstance()->current_test_info();
        folder = std::filesystem::temp_directory_path() /
                 ("trocar_" + std::to_string(::getpid()) + "_" + info->test_suite_name() + "_" + info->name());
        std::filesystem::create_directories(folder);
    }
    void TearDown() override { std::filesystem::remove_all(folder); }
    std::filesystem::path put(const std::string& name, const std::string& bytes) const {
        std::filesystem::create_directories((folder / name).parent_path());
        std::ofstream(folder / name, std::ios::binary) << bytes;
        return folder / name;
    }
};

}  // namespace trocar
