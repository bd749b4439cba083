#include "systems/detect/broad/rasterise.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <map>
#include <set>
#include <utility>

#include "tests/systems/detect/contact_scene.hpp"
namespace trocar::test {
namespace {

using Cells = std::map<uint64_t, std::map<uint32_t, std::set<uint32_t>>>;  // cell -> body -> triangles

// The layers by definition: every cell of every screened box, then only cells of two bodies or more. Uses the
// screened boxes; whether cells are inside a body's regions needs no tolerance: extra solo cells vanish.
Cells layers_of(const ContactScene& scene) {
    Cells all;
    const double size = double(1.0f / float(scene.occupancy.cell_size));
    for (uint32_t body = 0; body < scene.screened.body.size(); ++body) {
        const Range rows = scene.screened.body[body];
        for (uint32_t row = rows.first; row < rows.end(); ++row) {
            const PackedBox& box = scene.screened.box[row];
            uint64_t low[3], high[3], cells = 1;
            for (int k = 0; k < 3; ++k) {
                low[k] = uint64_t(std::floor(std::max(0.0f, box.min[k] * float(size))));
                high[k] = uint64_t(std::floor(std::max(0.0f, -box.neg_max[k] * float(size))));
                cells *= high[k] - low[k] + 1;
            }
            if (cells > 64) continue;
            for (uint64_t x = low[0]; x <= high[0]; ++x) {
                for (uint64_t y = low[1]; y <= high[1]; ++y) {
                    for (uint64_t z = low[2]; z <= high[2]; ++z) {
                        all[x << 42 | y << 21 | z][body].insert(scene.screened.triangle[row]);
                    }
                }
            }
        }
    }
    std::erase_if(all, [](const auto& cell) { return cell.second.size() < 2; });
    return all;
}

Cells layers_found(const Occupancy& o) {
    Cells found;
    for (uint32_t cell = 0; cell < o.cell_key.size(); ++cell) {
        for (uint32_t i = o.object_first[cell]; i < o.object_first[cell + 1]; ++i) {
            for (uint32_t p = o.primitive_first[i]; p < o.primitive_first[i + 1]; ++p) {
                EXPECT_TRUE(found[o.cell_key[cell]][o.object[i]].insert(o.primitive[p]).second);
            }
        }
    }
    return found;
}

void expect_ordered(const Occupancy& o) {
    ASSERT_EQ(o.object_first.size(), o.cell_key.size() + 1);
    ASSERT_EQ(o.primitive_first.size(), o.object.size() + 1);
    EXPECT_TRUE(std::is_sorted(o.cell_key.begin(), o.cell_key.end()));
    for (uint32_t cell = 0; cell < o.cell_key.size(); ++cell) {
        EXPECT_GE(o.object_first[cell + 1] - o.object_first[cell], 2u) << "solo cell kept";
        for (uint32_t i = o.object_first[cell] + 1; i < o.object_first[cell + 1]; ++i) {
            EXPECT_LT(o.object[i - 1], o.object[i]);
        }
    }
    for (uint32_t i = 0; i < o.object.size(); ++i) {
        EXPECT_TRUE(std::is_sorted(o.primitive.begin() + o.primitive_first[i], o.primitive.begin() + o.primitive_first[i + 1]));
    }
}

bool same(const Occupancy& a, const Occupancy& b) {
    return a.cell_key == b.cell_key && a.object_first == b.object_first && a.object == b.object && a.primitive_first == b.primitive_first &&
           a.primitive == b.primitive && a.oversize == b.oversize && a.cell_size == b.cell_size;
}

ContactScene three_balls(double far = 0) {
    const Vec3d at(far, -far, 2 * far);
    return ContactScene({{make_noisy_sphere(12, 1, 0.1, 0), Motion::kDeformable, at + Vec3d(-0.9, -0.2, 0.1), {}},
                         {make_noisy_sphere(12, 1, 0.1, 1), Motion::kHand, at + Vec3d(0.9, 0, 0), turn({1, 1, 0}, 1)},
                         {make_noisy_sphere(12, 1, 0.1, 2), Motion::kDeformable, at + Vec3d(0, 0.8, -0.3), {}}});
}

// Every filled cell contains only triangles that the definition puts there, and every cell where triangles of
// two bodies can meet is filled. Breaks on a wrong floor, a lost reference, an unsorted layer or a solo cell.
TEST(Rasterise, LayersHoldTheSharedCells) {
    for (const double edges : {0.7, 2.5, 9.0}) {
        ContactScene scene = three_balls();
        scene.settings.contact.cell_edges = edges;
        scene.find_triangles();
        const Cells want = layers_of(scene), found = layers_found(scene.occupancy);
        expect_ordered(scene.occupancy);
        ASSERT_GT(found.size(), edges > 5 ? 2u : 20u);
        for (const auto& [cell, bodies] : found) {
            for (const auto& [body, triangles] : bodies) {
                const auto& all = want.at(cell).at(body);
                EXPECT_TRUE(std::includes(all.begin(), all.end(), triangles.begin(), triangles.end()));
            }
        }
    }
}

// Unit cells, boxes with faces exactly on cell faces. A lower face belongs to its cell, an upper face to the
// next one as well.
TEST(Rasterise, H02_H03_CellsAreHalfOpen) {
    const auto cells = [](double min, double max) {
        PackedBox box;
        box.min = {float(min), 0, 0, 0};
        box.neg_max = {float(-max), 0, 0, 0};
        const CellRange range = cells_of(load_box(box), 1.0f);
        return std::array<uint32_t, 2>{range.first[0], range.last[0]};
    };
    const double below = std::nextafter(2.0f, 0.0f), above = std::nextafter(2.0f, 3.0f);
    EXPECT_EQ(cells(1, 2), (std::array<uint32_t, 2>{1, 2}));
    EXPECT_EQ(cells(1, below), (std::array<uint32_t, 2>{1, 1}));
    EXPECT_EQ(cells(2, above), (std::array<uint32_t, 2>{2, 2}));
    EXPECT_EQ(cells(below, 2), (std::array<uint32_t, 2>{1, 2}));
    EXPECT_EQ(cells(-1, 0), (std::array<uint32_t, 2>{0, 0}));
}

// The grid follows the bodies: negative coordinates, symmetry about zero or 10 km away change nothing.
TEST(Rasterise, H01_PlaceOfTheSceneDoesNotMatter) {
    ContactScene here = three_balls(), there = three_balls(-1e4);
    here.find_triangles();
    there.find_triangles();
    EXPECT_NEAR(double(here.occupancy.cell_key.size()), double(there.occupancy.cell_key.size()), 3);
    EXPECT_NEAR(double(here.candidates.triangle.size()), double(there.candidates.triangle.size()), 3);
}

// Used memory, grown or shrunken, gives the layers of fresh one.
TEST(Rasterise, H13_H17_NoStaleCells) {
    for (const uint32_t most_words : {0u, 1u << 20}) {
        ContactScene scene = three_balls();
        scene.frame.scratch.rasterise.most_words = most_words;
        for (int pass = 0; pass < 6; ++pass) {
            scene.poses.origin[1] = Vec3d(0.9 - 0.3 * pass, 0.2 * pass, pass % 2 ? 7.0 : 0.0);
            scene.settings.contact.cell_edges = pass % 3 == 0 ? 0.5 : 4;
            scene.find_triangles();
            const Occupancy warm = scene.occupancy;
            RasteriseScratch used = std::exchange(scene.frame.scratch.rasterise, {});
            scene.frame.scratch.rasterise.most_words = most_words;
            scene.find_triangles();
            EXPECT_TRUE(same(warm, scene.occupancy)) << pass;
            EXPECT_EQ(scene.frame.scratch.rasterise.keyed.empty(), most_words > 0);
            std::swap(scene.frame.scratch.rasterise, used);
        }
    }
}

// Bits and sorted references give the same layers, oversize triangles among them.
TEST(Rasterise, BothWaysToCountGiveTheSameLayers) {
    for (const double edges : {0.25, 0.7, 2.5, 9.0}) {
        ContactScene scene = three_balls();
        scene.settings.contact.cell_edges = edges;
        scene.find_triangles();
        const Occupancy by_bits = scene.occupancy;
        EXPECT_EQ(by_bits.oversize.empty(), edges > 0.5);
        ASSERT_GT(by_bits.cell_key.size(), 2u);
        scene.frame.scratch.rasterise.most_words = 0;
        scene.find_triangles();
        EXPECT_TRUE(same(by_bits, scene.occupancy)) << edges << ", sorted";
        EXPECT_FALSE(scene.frame.scratch.rasterise.keyed.empty());
    }
}

// Scratch that has screened another scene's meshes gives the results of a fresh one.
TEST(Rasterise, RunsAreMadeAnewForAnotherMesh) {
    ContactScene balls = three_balls(), boxes({{make_box({1, 1, 1}, {9, 9, 9}), Motion::kDeformable, Vec3d::Zero(), {}},
                                               {make_sheet(1, 12), Motion::kDeformable, Vec3d(0.1, 0.2, 0.5), {}}});
    boxes.find_triangles();
    const Occupancy fresh = boxes.occupancy;
    ASSERT_GT(fresh.cell_key.size(), 2u);
    balls.find_triangles();
    std::swap(balls.frame.scratch.rasterise, boxes.frame.scratch.rasterise);
    boxes.find_triangles();
    EXPECT_TRUE(same(fresh, boxes.occupancy));
}

TEST(Rasterise, H20_WarmPassesReuseMemory) {
    ContactScene scene = three_balls();
    scene.run();
    scene.run();
    const void* before[] = {scene.occupancy.cell_key.data(),
                            scene.occupancy.primitive.data(),
                            scene.screened.box.data(),
                            scene.frame.scratch.rasterise.cells.data(),
                            scene.frame.scratch.rasterise.reference.data(),
                            scene.candidates.triangle.data(),
                            scene.frame.scratch.cells.by_index.data()};
    scene.run();
    const void* after[] = {scene.occupancy.cell_key.data(),
                           scene.occupancy.primitive.data(),
                           scene.screened.box.data(),
                           scene.frame.scratch.rasterise.cells.data(),
                           scene.frame.scratch.rasterise.reference.data(),
                           scene.candidates.triangle.data(),
                           scene.frame.scratch.cells.by_index.data()};
    for (size_t i = 0; i < std::size(before); ++i) EXPECT_EQ(before[i], after[i]) << i;
}

// One triangle of a million cells is listed and counted, and uses no memory.
TEST(Rasterise, H04_HugeTrianglesGoToTheOversizeList) {
    ContactScene scene({{make_box({100, 100, 1}), Motion::kStatic, Vec3d(0, 0, -0.5), {}},
                        {make_noisy_sphere(30, 0.3, 0, 0), Motion::kDeformable, Vec3d(0.1, 0.2, 0.2), {}}});
    scene.settings.contact.cell_edges = 0.5;
    scene.find_triangles();
    EXPECT_GT(scene.report.oversize_triangles, 0u);
    EXPECT_EQ(scene.report.oversize_triangles, scene.occupancy.oversize.size());
    EXPECT_LT(scene.occupancy.primitive.size(), 200000u);
    EXPECT_FALSE(scene.candidates.triangle.empty());
}

// Two contacts 20,000 km apart: the cell grows until 21 bits per axis suffice, and both are found.
TEST(Rasterise, H08_CellsGrowBeforeTheKeyOverflows) {
    const Mesh ball = make_noisy_sphere(6, 0.1, 0, 0);
    ContactScene scene({{ball, Motion::kDeformable, Vec3d(0, 0, 0), {}},
                        {ball, Motion::kDeformable, Vec3d(0.15, 0, 0), {}},
                        {ball, Motion::kDeformable, Vec3d(2e7, 0, 0), {}},
                        {ball, Motion::kDeformable, Vec3d(2e7 + 0.15, 0, 0), {}}});
    scene.find_triangles();
    EXPECT_GE(scene.occupancy.cell_size * double(1 << 21), 2e7);
    ASSERT_EQ(scene.candidates.pair.size(), 2u);
    EXPECT_GT(scene.candidates.pair[0].count, 0u);
    EXPECT_GT(scene.candidates.pair[1].count, 0u);
}

// A triangle with a non-finite corner is left out, the others stay.
TEST(Rasterise, H09_NonFiniteTrianglesAreLeftOut) {
    ContactScene scene({{make_noisy_sphere(6, 0.1, 0, 0), Motion::kDeformable, Vec3d::Zero(), {}},
                        {make_noisy_sphere(6, 0.1, 0, 0), Motion::kDeformable, Vec3d(0.1, 0, 0), {}}});
    scene.find_triangles();
    const uint32_t lost = scene.meshes.triangle[scene.screened.triangle[3]][1], before = scene.screened.body[0].count;
    scene.particles.offset[lost].y = std::numeric_limits<float>::quiet_NaN();
    scene.find_triangles();
    EXPECT_LT(scene.screened.body[0].count, before);
    EXPECT_GE(scene.screened.body[0].count, before - 6);
    for (uint32_t row = 0; row < scene.screened.body[0].count; ++row) {
        for (const uint32_t v : mesh_view(scene.meshes, 0).triangle[scene.screened.triangle[row]]) EXPECT_NE(v, lost);
    }
}

// An invalid cell size is the caller's error.
TEST(RasteriseDeathTest, H10_CellSizeMustBePositive) {
    for (const double edges : {0.0, -1.0, std::numeric_limits<double>::infinity(), std::nan("")}) {
        ContactScene scene = three_balls();
        scene.settings.contact.cell_edges = edges;
        EXPECT_DEATH(scene.find_triangles(), "cell_edges");
    }
}

}  // namespace
}  // namespace trocar::test
