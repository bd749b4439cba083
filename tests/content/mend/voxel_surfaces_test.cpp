#include <array>
#include <map>
#include <random>
#include <set>

#include "content/mend/repair_mesh.hpp"
#include "content/mend/split_fans.hpp"
#include "tests/content/mend/mesh_sums.hpp"
namespace trocar {
namespace {

using Voxel = std::array<int, 3>;
using Voxels = std::set<Voxel>;

// The outside of some unit cubes as triangles, one vertex for each corner of the lattice: where cubes meet only along an edge
// it has four faces.
Mesh surface_of(const Voxels& voxels) {
    Mesh mesh;
    std::map<Voxel, uint32_t> vertex;
    for (const Voxel& voxel : voxels) {
        for (size_t axis = 0; axis < 3; ++axis) {
            for (const int side : {0, 1}) {
                Voxel beyond = voxel;
                beyond[axis] += 2 * side - 1;
                if (voxels.contains(beyond)) continue;
                std::array<uint32_t, 4> corner{};
                for (size_t k = 0; k < 4; ++k) {
                    Voxel p = voxel;
                    p[axis] += side;
                    p[(axis + 1) % 3] += k == 1 || k == 2;
                    p[(axis + 2) % 3] += k >= 2;
                    const auto [found, fresh] = vertex.try_emplace(p, static_cast<uint32_t>(mesh.position.size()));
                    if (fresh) mesh.position.emplace_back(p[0], p[1], p[2]);
                    corner[side ? k : 3 - k] = found->second;
                }
                mesh.triangle.push_back({corner[0], corner[1], corner[2]});
                mesh.triangle.push_back({corner[0], corner[2], corner[3]});
            }
        }
    }
    return mesh;
}

// What can be reached from a voxel by steps across faces within the others.
Voxels reach(const Voxels& within, const Voxel& from) {
    Voxels seen{from};
    std::vector<Voxel> open{from};
    while (!open.empty()) {
        const Voxel at = open.back();
        open.pop_back();
        for (size_t step = 0; step < 6; ++step) {
            Voxel next = at;
            next[step % 3] += step < 3 ? 1 : -1;
            if (within.contains(next) && seen.insert(next).second) open.push_back(next);
        }
    }
    return seen;
}

// A random body in one piece without cavities, of about half the voxels of a box: many edges with four faces.
Voxels random_body(uint32_t seed, int size) {
    std::mt19937 random(seed);
    Voxels all, chosen;
    for (int i = 0; i < (size + 2) * (size + 2) * (size + 2); ++i) {
        const Voxel voxel{i % (size + 2), i / (size + 2) % (size + 2), i / (size + 2) / (size + 2)};
        all.insert(voxel);
        const bool inner = std::all_of(voxel.begin(), voxel.end(), [&](int c) { return c > 0 && c <= size; });
        if (inner && random() % 16 < 9) chosen.insert(voxel);
    }
    Voxels largest;
    for (const Voxel& voxel : chosen) {
        if (largest.contains(voxel)) continue;
        const Voxels piece = reach(chosen, voxel);
        if (piece.size() > largest.size()) largest = piece;
    }
    Voxels outside;
    std::set_difference(all.begin(), all.end(), largest.begin(), largest.end(), std::inserter(outside, outside.end()));
    Voxels body;
    const Voxels around = reach(outside, {0, 0, 0});
    std::set_difference(all.begin(), all.end(), around.begin(), around.end(), std::inserter(body, body.end()));
    return body;
}

// Two cubes that meet along an edge between two plates: all faces at each end of the edge are one fan.
TEST(VoxelSurfaces, an_edge_joined_around_both_ends_is_halved) {
    Voxels voxels{{0, 0, 1}, {1, 1, 1}};
    for (const int z : {0, 2}) {
        for (int k = 0; k < 4; ++k) voxels.insert({k % 2, k / 2, z});
    }
    Mesh mesh = surface_of(voxels);
    const SplitReport report = split_fans(mesh, 0.02);
    EXPECT_EQ(report.halved, 1u);
    EXPECT_EQ(report.edges, 2u);
    EXPECT_EQ(report.vertices, 1u);
    const MeshJudgement judgement = judge_mesh(mesh);
    EXPECT_EQ(judgement.admitted_as, Admission::kSolid) << judgement.reason;
    EXPECT_NEAR(judgement.volume, 10, 0.05);
}

// Faces that stand twice or three times at the same corners, in either order, cannot be parted: it ends all the same.
TEST(VoxelSurfaces, doubled_faces_end_the_halving) {
    for (uint32_t seed = 1; seed <= 24; ++seed) {
        std::mt19937 random(seed);
        Mesh mesh = surface_of(random_body(seed, 3));
        for (size_t k = 0, faces = mesh.triangle.size(); k < 12; ++k) {
            Triangle t = mesh.triangle[random() % faces];
            if (random() % 2) std::swap(t[0], t[1]);
            for (uint32_t copies = 1 + random() % 2; copies > 0; --copies) mesh.triangle.push_back(t);
        }
        const double area = sum_mesh(mesh).area;
        split_fans(mesh, 0);
        EXPECT_NEAR(sum_mesh(mesh).area, area, 1e-9) << seed;
    }
}

// The oracle is the number of cubes; the copies of a vertex move by a fiftieth of an edge.
TEST(VoxelSurfaces, every_body_of_voxels_becomes_one_solid) {
    uint32_t halved = 0;
    for (uint32_t seed = 1; seed <= 60; ++seed) {
        const Voxels voxels = random_body(seed, 3 + static_cast<int>(seed % 5));
        Mesh mesh = surface_of(voxels), split = mesh;
        halved += split_fans(split, 0.02).halved;
        const RepairReport report = repair_mesh(mesh, {});
        std::string said;
        for (const std::string& line : report.done) said += line + "; ";
        EXPECT_TRUE(report.solid) << seed << ": " << report.reason;
        EXPECT_NEAR(report.after.volume, double(voxels.size()), 0.02 * double(voxels.size())) << seed << ": " << said;
        EXPECT_EQ(sum_mesh(mesh).unpaired, 0u) << seed;
    }
    EXPECT_GT(halved, 20u);
}

// Looks and texture coordinates follow the halves of a face.
TEST(VoxelSurfaces, halves_keep_their_looks) {
    Mesh mesh = surface_of(random_body(3, 6));
    for (const Triangle& t : mesh.triangle) {
        std::array<Vec2, 3> uv;
        for (size_t k = 0; k < 3; ++k) uv[k] = {static_cast<float>(mesh.position[t[k]].x()), static_cast<float>(mesh.position[t[k]].y())};
        mesh.uv.push_back(uv);
        mesh.triangle_material.push_back(static_cast<uint16_t>(mesh.position[t[0]].z() > 3));
    }
    const double area = sum_mesh(mesh).area;
    EXPECT_GT(split_fans(mesh, 0).halved, 0u);
    EXPECT_NEAR(sum_mesh(mesh).area, area, 1e-9);
    ASSERT_EQ(mesh.uv.size(), mesh.triangle.size());
    ASSERT_EQ(mesh.triangle_material.size(), mesh.triangle.size());
    for (size_t t = 0; t < mesh.triangle.size(); ++t) {
        for (size_t k = 0; k < 3; ++k) {
            EXPECT_EQ(mesh.uv[t][k].u, static_cast<float>(mesh.position[mesh.triangle[t][k]].x()));
            EXPECT_EQ(mesh.uv[t][k].v, static_cast<float>(mesh.position[mesh.triangle[t][k]].y()));
        }
    }
}

}  // namespace
}  // namespace trocar
