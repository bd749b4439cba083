#include "content/mend/repair_mesh.hpp"

#include "content/mend/clean_mesh.hpp"
#include "content/mend/slivers.hpp"
#include "content/mend/split_fans.hpp"
#include "content/mend/unit_guess.hpp"
#include "reference/sample_meshes.hpp"
#include "tests/content/mend/mesh_sums.hpp"
namespace trocar {
namespace {

using namespace reference;

std::string all_lines(const RepairReport& report) {
    std::string text;
    for (const std::string& line : report.done) text += line + "\n";
    return text + report.reason;
}

// --- parts

TEST(FillHoles, an_open_box_gets_its_lid_back) {
    Mesh box = make_box(Vec3d(0, 0, 0), Vec3d(1, 2, 3));
    box.triangle.resize(10);  // without the face x = 1
    const HoleReport report = fill_holes(box, {.edges = 4, .diagonal = 1});
    EXPECT_EQ(report.filled, 1u);
    EXPECT_EQ(report.faces_added, 2u);
    const MeshSums sums = sum_mesh(box);
    EXPECT_EQ(sums.unpaired, 0u);
    EXPECT_DOUBLE_EQ(sums.volume, 6);
    EXPECT_DOUBLE_EQ(sums.area, 22);
}

// A flat rim that is not convex: the smallest area is that of its polygon, reached only by faces inside it.
TEST(FillHoles, a_notched_rim_is_spanned_inside_itself) {
    Mesh prism;  // an L-shape of area 3, extruded by 1, without its top
    const std::vector<std::array<double, 2>> corner = {{0, 0}, {2, 0}, {2, 1}, {1, 1}, {1, 2}, {0, 2}};
    for (const double z : {0.0, 1.0}) {
        for (const auto& [x, y] : corner) prism.position.push_back(Vec3d(x, y, z));
    }
    for (uint32_t i = 0; i < 6; ++i) {
        const uint32_t k = (i + 1) % 6;
        prism.triangle.push_back({i, k, k + 6});
        prism.triangle.push_back({i, k + 6, i + 6});
    }
    for (const Triangle& t : {Triangle{0, 3, 1}, {1, 3, 2}, {0, 5, 3}, {3, 5, 4}}) prism.triangle.push_back(t);
    const HoleReport report = fill_holes(prism, {.edges = 6, .diagonal = 1});
    EXPECT_EQ(report.faces_added, 4u);
    const MeshSums sums = sum_mesh(prism);
    EXPECT_EQ(sums.unpaired, 0u);
    EXPECT_NEAR(sums.volume, 3, 1e-14);
    EXPECT_NEAR(sums.area, 2 * 3 + 8, 1e-14);
}

TEST(FillHoles, beyond_the_limits_it_leaves_and_says_so) {
    Mesh sheet = make_sheet(10);
    const HoleReport by_edges = fill_holes(sheet, {.edges = 39, .diagonal = 1});
    EXPECT_EQ(by_edges.left, 1u);
    EXPECT_EQ(by_edges.largest_edges, 40u);
    EXPECT_DOUBLE_EQ(by_edges.largest_diagonal, std::sqrt(2.0));
    EXPECT_EQ(fill_holes(sheet, {.edges = 40, .diagonal = 0.99}).left, 1u);
    EXPECT_EQ(sheet.triangle.size(), 200u);
    Mesh empty;
    EXPECT_EQ(fill_holes(empty, {}).left, 0u);
}

// Two boxes that share an edge, and two that share a corner: they are separated into the original boxes.
TEST(SplitFans, solids_that_touch_come_apart) {
    for (const double z : {0.0, 1.0}) {
        Mesh pair = make_box(Vec3d(0, 0, 0), Vec3d(1, 1, 1));
        append(pair, make_box(Vec3d(1, 1, z), Vec3d(2, 2, z + 1)));
        weld_vertices(pair, 0);
        const SplitReport report = split_fans(pair, 0.02);
        EXPECT_EQ(report.edges, z == 0 ? 1u : 0u);
        EXPECT_EQ(report.vertices, z == 0 ? 2u : 1u);
        const MeshJudgement judged = judge_mesh(pair);
        EXPECT_EQ(judged.admitted_as, Admission::kSolid) << judged.reason;
        EXPECT_EQ(judged.components, 2u);
        EXPECT_NEAR(judged.volume, 2, 0.1);
        EXPECT_LT(judged.volume, 2);
    }
    Mesh sphere = make_sphere(Vec3d::Zero(), 1, 2);
    const Mesh before = sphere;
    EXPECT_EQ(split_fans(sphere, 0.02).vertices, 0u);
    EXPECT_EQ(sphere.position, before.position);
    EXPECT_EQ(sphere.triangle, before.triangle);
}

TEST(SplitFans, after_it_no_edge_has_three_faces) {
    Mesh fin = make_box(Vec3d(0, 0, 0), Vec3d(1, 1, 1));
    fin.position.push_back(Vec3d(2, 2, 0.5));
    fin.triangle.push_back({3, 7, 8});  // a fin on the edge x = y = 1
    EXPECT_EQ(split_fans(fin, 0.02).edges, 1u);
    const MeshJudgement judged = judge_mesh(fin, false);
    EXPECT_EQ(judged.non_manifold_edges, 0u);
    EXPECT_EQ(judged.bow_tie_vertices, 0u);
    EXPECT_EQ(judged.components, 2u);
    EXPECT_EQ(judged.boundary_edges, 3u);  // of the fin only
}

// A box with a vertex in the middle of an edge of one side, connected by a zero-area face.
TEST(Slivers, a_cap_is_turned_and_the_volume_stays) {
    Mesh box = make_box(Vec3d(0, 0, 0), Vec3d(1, 1, 1));
    box.position.push_back(Vec3d(0.5, 0, 0));
    // the edge 0-1 of face {0, 1, 4} gets the vertex 8; the other face keeps the whole edge
    box.triangle[4] = {0, 8, 4};
    box.triangle.push_back({8, 1, 4});
    box.triangle.push_back({0, 1, 8});
    ASSERT_EQ(judge_mesh(box).zero_area, 1u);
    ASSERT_TRUE(judge_mesh(box).closed);
    const SliverReport report = remove_slivers(box, 1e-4);
    EXPECT_EQ(report.flipped, 1u);
    EXPECT_EQ(report.left, 0u);
    const MeshJudgement judged = judge_mesh(box);
    EXPECT_EQ(judged.admitted_as, Admission::kSolid) << judged.reason;
    EXPECT_DOUBLE_EQ(judged.volume, 1);
}

TEST(Slivers, a_needle_loses_its_short_edge) {
    Mesh sphere = make_sphere(Vec3d::Zero(), 1, 3);
    // two neighbouring vertices moved almost together
    const Triangle t = sphere.triangle[100];
    sphere.position[t[0]] = sphere.position[t[1]] + 1e-6 * (sphere.position[t[0]] - sphere.position[t[1]]);
    const SliverReport report = remove_slivers(sphere, 1e-4);
    EXPECT_EQ(report.collapsed, 1u);
    EXPECT_EQ(sphere.triangle.size(), 510u);
    const MeshJudgement judged = judge_mesh(sphere);
    EXPECT_EQ(judged.degenerate, 0u);
    EXPECT_TRUE(judged.closed && judged.manifold && judged.oriented);
}

// --- the complete repair

TEST(RepairMesh, a_sound_mesh_is_left_as_it_is) {
    Mesh sphere = make_sphere(Vec3d(1, 2, 3), 1, 3);
    const Mesh before = sphere;
    const RepairReport report = repair_mesh(sphere, {});
    EXPECT_TRUE(report.solid);
    EXPECT_TRUE(report.done.empty()) << all_lines(report);
    EXPECT_EQ(sphere.position, before.position);
    EXPECT_EQ(sphere.triangle, before.triangle);
}

// All defects on one sphere: it must be repaired to its original volume.
TEST(RepairMesh, a_dirty_sphere_is_a_sphere_again) {
    for (const uint64_t seed : {1, 2, 3, 4, 5}) {
        SCOPED_TRACE(seed);
        std::mt19937_64 random(seed);
        const Mesh clean = make_sphere(Vec3d(5, 0, 0), 1, 4);
        const double volume = sum_mesh(clean).volume;
        Mesh dirty = clean;
        for (int k = 0; k < 20; ++k) {
            Triangle& t = dirty.triangle[random() % 2048];
            std::swap(t[0], t[1]);
        }
        for (int k = 0; k < 10; ++k) dirty.triangle.push_back(dirty.triangle[random() % 2048]);      // duplicates
        for (int k = 0; k < 3; ++k) dirty.triangle.erase(dirty.triangle.begin() + random() % 2000);  // holes
        append(dirty, make_tetrahedron(Vec3d(9, 9, 9), 0.1));                                        // debris
        dirty = make_soup(dirty);
        std::uniform_real_distribution<double> noise(-1e-7, 1e-7);
        for (Vec3d& p : dirty.position) p += Vec3d(noise(random), noise(random), noise(random));
        shuffle(dirty, seed);
        const RepairReport report = repair_mesh(dirty, {});
        EXPECT_TRUE(report.solid) << all_lines(report);
        EXPECT_NEAR(report.after.volume, volume, 0.002 * volume);
        EXPECT_NEAR(sum_mesh(dirty).volume, report.after.volume, 1e-9);
        EXPECT_NE(all_lines(report).find("smaller piece dropped (4 faces"), std::string::npos) << all_lines(report);
        EXPECT_NE(all_lines(report).find("faces turned to agree"), std::string::npos);
        EXPECT_NE(all_lines(report).find("filled with"), std::string::npos);
    }
}

// Half of a model is not debris.
TEST(RepairMesh, a_piece_as_large_as_the_largest_is_not_thrown_away) {
    Mesh both = make_sphere(Vec3d::Zero(), 1, 3);
    append(both, make_sphere(Vec3d(1, 0.01, 0.02), 1, 3));
    const RepairReport report = repair_mesh(both, {});
    EXPECT_FALSE(report.solid) << all_lines(report);
    EXPECT_NE(report.reason.find("the pieces beside the largest have 50 % of the area"), std::string::npos) << report.reason;
}

TEST(RepairMesh, a_spike_through_the_other_side_is_cut_off) {
    Mesh sphere = make_sphere(Vec3d::Zero(), 1, 4);
    const double volume = sum_mesh(sphere).volume;
    sphere.position[0] = Vec3d(-1.5, 0.01, 0.02);
    ASSERT_GT(judge_mesh(sphere).self_crossing, 0u);
    const RepairReport report = repair_mesh(sphere, {});
    EXPECT_TRUE(report.solid) << all_lines(report);
    EXPECT_NEAR(report.after.volume, volume, 0.02 * volume) << all_lines(report);
}

TEST(RepairMesh, what_cannot_be_closed_is_refused_with_the_reason) {
    Mesh sheet = make_sheet(10);
    const RepairReport open = repair_mesh(sheet, {});
    EXPECT_FALSE(open.solid);
    EXPECT_EQ(open.reason, "open: 40 boundary edges; 1 hole beyond the limits for filling, the largest of 40 edges and 1.414 across");
    Mesh band = make_moebius(12);
    EXPECT_FALSE(repair_mesh(band, {}).solid);
    Mesh bad = make_tetrahedron();
    bad.position[1].x() = std::nan("");
    const RepairReport refused = repair_mesh(bad, {});
    EXPECT_FALSE(refused.solid);
    EXPECT_EQ(refused.reason, "vertex 1: coordinate is not finite");
    Mesh empty;
    EXPECT_EQ(repair_mesh(empty, {}).reason, "no face");
}

TEST(RepairMesh, texture_coordinates_and_materials_keep_their_rows) {
    Mesh box = make_box(Vec3d(0, 0, 0), Vec3d(1, 1, 1));
    box.material.resize(2);
    for (const Triangle& t : box.triangle) {
        std::array<Vec2, 3> row;
        for (size_t k = 0; k < 3; ++k) {
            const Vec3d& p = box.position[t[k]];
            row[k] = {static_cast<float>(p.x()), static_cast<float>(p.y() + p.z())};
        }
        box.uv.push_back(row);
        box.triangle_material.push_back(1);
    }
    box.triangle.resize(10);
    box.uv.resize(10);
    box.triangle_material.resize(10);
    const RepairReport report = repair_mesh(box, {.holes = {.edges = 256, .diagonal = 1}});
    ASSERT_TRUE(report.solid) << all_lines(report);
    ASSERT_EQ(box.uv.size(), 12u);
    EXPECT_EQ(box.triangle_material, std::vector<uint16_t>(12, 1));
    for (size_t t = 0; t < 12; ++t) {
        for (size_t k = 0; k < 3; ++k) {
            const Vec3d& p = box.position[box.triangle[t][k]];
            EXPECT_EQ(box.uv[t][k].u, static_cast<float>(p.x()));
            EXPECT_EQ(box.uv[t][k].v, static_cast<float>(p.y() + p.z()));
        }
    }
}

TEST(UnitGuess, organs_and_instruments_are_between_12_mm_and_3_m) {
    EXPECT_STREQ(guess_unit(0.3).unit, "m");
    EXPECT_STREQ(guess_unit(3).unit, "m");
    EXPECT_STREQ(guess_unit(9).unit, "cm");
    EXPECT_STREQ(guess_unit(18).unit, "mm");
    EXPECT_STREQ(guess_unit(540).unit, "mm");
    EXPECT_STREQ(guess_unit(2e5).unit, "um");
    EXPECT_EQ(guess_unit(540).metres, 1e-3);
    EXPECT_NE(guess_unit(540).rule.find("diagonal 540"), std::string::npos);
}

// --- real surfaces. `volume` is the expected volume of the repaired surface: that of the table where the
// repair removes only defects, else 0.

struct Dirty {
    const char* file;
    double volume;
};

constexpr Dirty kDirty[] = {
    {"organs/liver_visual.stl", 1.7621e6},
    {"organs-lgpl/liver-smoothUV.obj", 39.267},
    {"instruments/forceps_jaw_right.stl", 117.74},
    {"instruments/maryland_dissector_jaw_right.stl", 155.78},
    {"instruments/dissection_electrode.stl", 5160.8},    // its shaft, as in instrument_shaft.stl
    {"instruments/atraumatic_forceps_jaw_left.stl", 0},  // two parts: the larger is kept
    {"instruments/laparoscope_optics.stl", 0},           // three parts
};

TEST(RepairMesh, real_dirty_surfaces_become_solids_of_their_volume) {
    const std::filesystem::path data = shared_data_folder();
    if (data.empty()) GTEST_SKIP() << "the folder of real surfaces is absent";
    for (const Dirty& d : kDirty) {
        SCOPED_TRACE(d.file);
        Mesh mesh = load_mesh(data / d.file).mesh;
        const RepairReport report = repair_mesh(mesh, {});
        EXPECT_TRUE(report.solid) << all_lines(report);
        const MeshJudgement judged = judge_mesh(mesh);
        EXPECT_EQ(judged.admitted_as, Admission::kSolid) << judged.reason;
        EXPECT_EQ(judged.components, 1u);
        const double volume = sum_mesh(mesh).volume;
        EXPECT_GT(volume, 0);
        if (d.volume > 0) {
            EXPECT_NEAR(volume, d.volume, 0.002 * d.volume);
        }
    }
    Mesh sheet = load_mesh(data / "instruments/hernia_mesh_sheet_150x100.obj").mesh;
    const RepairReport report = repair_mesh(sheet, {});
    EXPECT_FALSE(report.solid);
    EXPECT_NE(report.reason.find("200 boundary edges"), std::string::npos);
    // folds that intersect 2817 times: nothing usable of the colon would remain
    Mesh colon = load_mesh(data / "organs/VHF_large-intestine_dirty.vtk").mesh;
    const RepairReport refused = repair_mesh(colon, {});
    EXPECT_FALSE(refused.solid);
    EXPECT_NE(refused.reason.find("cutting out the faces that cross takes"), std::string::npos) << refused.reason;
}

}  // namespace
}  // namespace trocar
