#include "content/mend/admission.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "content/mend/clean_mesh.hpp"
#include "content/mend/self_crossing.hpp"
#include "tests/reference/brute_force_distance.hpp"
#include "tests/reference/sample_meshes.hpp"
#include "tests/reference/shared_data.hpp"

namespace trocar {
namespace {

using namespace reference;

struct Expected {
    const char* file;
    uint32_t vertices, triangles;
    bool closed, manifold, oriented;
    uint32_t components, degenerate, duplicate, boundary, non_manifold, flipped;
    double size[3];
    double volume;
    Admission admitted;
};

// The table that came with the data (written by an independent program), except `admitted`, which also
// depends on self-intersections; those were checked pair by pair (SelfCrossingsOfRealMeshes...).
constexpr Admission kSolid = Admission::kSolid, kWinding = Admission::kWinding, kSheet = Admission::kSheet;
// clang-format off
const Expected kTable[] = {
    {"organs/Abdominal_wall.stl", 15969, 31934, true, true, true, 1, 0, 0, 0, 0, 0, {277.9, 445.6, 154.8}, 1.551e6, kSolid},
    {"organs/Kidney_left.stl", 3287, 6570, true, true, true, 1, 0, 0, 0, 0, 0, {81.93, 112.9, 61.44}, 1.9165e5, kSolid},
    {"organs/Liver.stl", 15365, 30726, true, true, true, 1, 0, 0, 0, 0, 0, {181.5, 190.6, 173}, 1.8177e6, kSolid},
    {"organs/Stomach.stl", 4864, 9724, true, true, true, 1, 0, 0, 0, 0, 0, {132.9, 85.04, 116.7}, 2.8935e5, kSolid},
    {"organs/VHF_large-intestine_dirty.vtk", 10137, 20419, false, false, true, 1, 0, 0, 58, 195, 0, {243.3, 193.4, 294.9}, 6.2457e5, kSheet},
    {"organs/gallbladder_collision.stl", 252, 500, true, true, true, 1, 0, 0, 0, 0, 0, {90.18, 56.78, 51.03}, 35945, kSolid},
    {"organs/gallbladder_visual.stl", 7352, 14700, true, true, true, 1, 0, 0, 0, 0, 0, {90.05, 57.16, 50.68}, 36278, kSolid},
    // 26 pieces by shared corners; 18 corners connect pieces that no edge connects, so 33 by shared edges
    {"organs/liver_visual.stl", 14462, 28716, false, false, false, 33, 0, 0, 182, 0, 28, {162.7, 202.3, 197.8}, 1.7621e6, kSheet},
    {"organs/small_intestine_20k.vtk", 10002, 20000, true, true, true, 1, 0, 0, 0, 0, 0, {258.4, 151.8, 304}, 1.0623e6, kSolid},
    {"organs-lgpl/liver-smoothUV.obj", 2194, 4384, true, true, true, 1, 0, 0, 0, 0, 0, {6.386, 4.908, 4.412}, 39.267, kWinding},
    {"organs-lgpl/liver.obj", 139, 274, true, true, true, 1, 0, 0, 0, 0, 0, {6.483, 4.939, 4.421}, 36.569, kSolid},
    {"organs-lgpl/liver2.obj", 1170, 2336, true, true, true, 1, 0, 0, 0, 0, 0, {2.149, 1.175, 1.314}, 1.1471, kSolid},
    {"instruments/atraumatic_forceps_jaw_left.stl", 256, 496, false, true, true, 2, 13, 0, 10, 0, 0, {4.536, 4.716, 20.13}, 106.07, kSheet},
    {"instruments/dissection_electrode.stl", 836, 1664, true, true, true, 2, 0, 0, 0, 0, 0, {4.457, 4.438, 364.5}, 5269.8, kWinding},
    {"instruments/forceps_jaw_right.stl", 1367, 2734, true, false, true, 1, 8, 3, 0, 3, 0, {4.537, 4.716, 28.33}, 117.74, kWinding},
    {"instruments/gauze.obj", 761, 1518, true, true, true, 1, 0, 0, 0, 0, 0, {0.01521, 0.02552, 0.002454}, 6.841e-7, kSolid},
    {"instruments/instrument_shaft.stl", 522, 1040, true, true, true, 1, 0, 0, 0, 0, 0, {4.457, 4.302, 351.4}, 5160.8, kSolid},
    {"instruments/laparoscope_optics.stl", 717, 1388, false, true, true, 3, 0, 0, 36, 0, 0, {31.88, 56.74, 380.5}, 55355, kSheet},
    {"instruments/maryland_dissector_jaw_left.stl", 478, 952, true, true, true, 1, 0, 0, 0, 0, 0, {4.514, 8.533, 28.08}, 143.13, kSolid},
    {"instruments/maryland_dissector_jaw_right.stl", 496, 988, true, true, true, 1, 0, 0, 0, 0, 0, {4.519, 7.399, 28.6}, 155.78, kWinding},
    {"instruments/needle_40mm.obj", 289, 574, true, true, true, 1, 0, 0, 0, 0, 0, {0.0205, 0.0407, 0.001}, 4.4936e-8, kSolid},
    {"instruments/scissors_jaw_left.stl", 47, 90, true, true, true, 1, 0, 0, 0, 0, 0, {1.417, 4.716, 17.29}, 41.91, kSolid},
    {"instruments/scissors_jaw_right.stl", 46, 88, true, true, true, 1, 0, 0, 0, 0, 0, {1.946, 4.716, 17.27}, 46.721, kSolid},
    {"instruments/hernia_mesh_sheet_150x100.obj", 2501, 4800, false, true, true, 1, 0, 0, 200, 0, 0, {150, 100, 0}, 0, kSheet},
};
// clang-format on

TEST(Admission, RealMeshesAreWhatTheirTableSays) {
    if (read_plain_mesh(shared_data("organs/Liver.stl")).triangle.empty()) GTEST_SKIP() << "shared data is absent";
    for (const Expected& e : kTable) {
        Mesh m = read_plain_mesh(shared_data(e.file));
        ASSERT_FALSE(m.triangle.empty()) << e.file;
        const uint32_t joined = weld_vertices(m, 0);
        const MeshJudgement j = judge_mesh(m);
        EXPECT_EQ(j.vertices - joined, e.vertices + (j.unused_vertices - joined)) << e.file;
        EXPECT_EQ(j.triangles, e.triangles) << e.file;
        EXPECT_EQ(j.closed, e.closed) << e.file;
        EXPECT_EQ(j.manifold, e.manifold) << e.file;
        EXPECT_EQ(j.oriented, e.oriented) << e.file;
        EXPECT_EQ(j.components, e.components) << e.file;
        EXPECT_EQ(j.degenerate, e.degenerate) << e.file;
        EXPECT_EQ(j.duplicate, e.duplicate) << e.file;
        EXPECT_EQ(j.boundary_edges, e.boundary) << e.file;
        EXPECT_EQ(j.non_manifold_edges, e.non_manifold) << e.file;
        EXPECT_EQ(j.flipped_edges, e.flipped) << e.file;
        EXPECT_EQ(j.inside_out, 0u) << e.file;
        // the table has four to five digits
        for (int k = 0; k < 3; ++k) EXPECT_NEAR((j.bbox_max - j.bbox_min)[k], e.size[k], 6e-4 * e.size[k]) << e.file;
        EXPECT_NEAR(j.volume, e.volume, 6e-5 * e.volume) << e.file;
        EXPECT_EQ(j.admitted_as, e.admitted) << e.file << ": " << j.reason;
    }
}

// Cleaning must keep every mesh, and solid ones stay solid.
TEST(Admission, RealMeshesAfterCleaning) {
    if (read_plain_mesh(shared_data("organs/Liver.stl")).triangle.empty()) GTEST_SKIP() << "shared data is absent";
    for (const Expected& e : kTable) {
        if (e.triangles > 10000) continue;  // limits the time under the sanitizers
        Mesh m = read_plain_mesh(shared_data(e.file));
        const CleanReport report = clean_mesh(m, {});
        const MeshJudgement j = judge_mesh(m);
        EXPECT_EQ(j.vertices, e.vertices) << e.file;
        EXPECT_EQ(j.triangles, e.triangles) << e.file << ": " << describe_cleaning(report);
        EXPECT_EQ(j.admitted_as, e.admitted) << e.file << ": " << j.reason;
        EXPECT_NEAR(j.volume, e.volume, 6e-5 * e.volume) << e.file;
    }
}

// The few real meshes with self-intersections, compared with brute force in long double over every pair of
// faces without common corners.
TEST(Admission, SelfCrossingsOfRealMeshesAreSeenInLongDouble) {
    if (read_plain_mesh(shared_data("organs/Liver.stl")).triangle.empty()) GTEST_SKIP() << "shared data is absent";
    using Vec = Eigen::Matrix<long double, 3, 1>;
    for (const char* file : {"instruments/maryland_dissector_jaw_right.stl", "instruments/scissors_jaw_left.stl", "organs-lgpl/liver.obj",
                             "instruments/needle_40mm.obj"}) {
        Mesh m = read_plain_mesh(shared_data(file));
        clean_mesh(m, {});
        const auto at = [&](uint32_t v) { return Vec(m.position[v].cast<long double>()); };
        const auto side = [](const Vec& a, const Vec& b, const Vec& c, const Vec& d) { return (b - a).cross(c - a).dot(d - a); };
        // an edge that pierces a face away from any shared corner: every intersection has one
        uint32_t piercing = 0;
        for (const Triangle& t : m.triangle) {
            for (const Triangle& u : m.triangle) {
                for (int k = 0; k < 3; ++k) {
                    const uint32_t p = u[k], q = u[(k + 1) % 3];
                    if (std::count(t.begin(), t.end(), p) || std::count(t.begin(), t.end(), q)) continue;
                    const Vec a = at(t[0]), b = at(t[1]), c = at(t[2]);
                    if (side(a, b, c, at(p)) * side(a, b, c, at(q)) >= 0) continue;
                    const long double x = side(at(p), at(q), a, b), y = side(at(p), at(q), b, c), z = side(at(p), at(q), c, a);
                    piercing += (x > 0 && y > 0 && z > 0) || (x < 0 && y < 0 && z < 0);
                }
            }
        }
        EXPECT_EQ(count_self_crossings(m).crossing > 0, piercing > 0) << file;
    }
}

TEST(Admission, G18_NonManifoldEdges) {
    Mesh three = make_sheet(1);
    three.position.push_back({0, 0, 1});
    three.triangle.push_back({0, 3, 4});
    MeshJudgement j = judge_mesh(three);
    EXPECT_EQ(j.non_manifold_edges, 1u);
    EXPECT_FALSE(j.manifold);
    EXPECT_EQ(j.admitted_as, Admission::kSheet);
    // two tetrahedra back to back along an edge: closed in both directions
    Mesh four = make_tetrahedron();
    four.position.insert(four.position.end(), {{0, -1, 0}, {0, 0, -1}});
    four.triangle.insert(four.triangle.end(), {{0, 1, 4}, {0, 5, 1}, {1, 5, 4}, {0, 4, 5}});
    j = judge_mesh(four);
    EXPECT_EQ(j.inside_out, 1u);  // the second one, although both are one piece by edges
    CleanReport report = clean_mesh(four, {});
    EXPECT_EQ(report.pieces_turned, 1u);
    j = judge_mesh(four);
    EXPECT_EQ(j.components, 1u);
    EXPECT_EQ(j.non_manifold_edges, 1u);
    EXPECT_EQ(j.bow_tie_vertices, 0u);
    EXPECT_TRUE(j.closed);
    EXPECT_TRUE(j.oriented);
    EXPECT_EQ(j.admitted_as, Admission::kWinding) << j.reason;
    EXPECT_NE(j.reason.find("1 non-manifold edges"), std::string::npos);
    EXPECT_NEAR(j.volume, 2.0 / 6, 1e-15);
}

TEST(Admission, G19_BowTieVertex) {
    Mesh m = make_tetrahedron();
    m.position.insert(m.position.end(), {{-1, 0, 0}, {0, -1, 0}, {0, 0, -1}});
    m.triangle.insert(m.triangle.end(), {{0, 4, 5}, {0, 6, 4}, {4, 6, 5}, {0, 5, 6}});
    MeshJudgement j = judge_mesh(m);
    EXPECT_EQ(j.bow_tie_vertices, 1u);
    EXPECT_FALSE(j.manifold);
    EXPECT_EQ(j.self_crossing + j.self_touching, 0u);  // the shared corner itself does not count
    EXPECT_EQ(j.admitted_as, Admission::kWinding) << j.reason;
}

// The winding number at the centre of a ball without its cap is (1 + cos a) / 2.
TEST(Admission, G20_BallWithoutACapIsASheet) {
    for (const double angle : {0.3, 1.0, 2.0}) {
        Mesh m = make_sphere({0, 0, 0}, 1, 6);
        Mesh open = m;
        open.triangle.clear();
        for (const Triangle& t : m.triangle) {
            const Vec3d middle = m.position[t[0]] + m.position[t[1]] + m.position[t[2]];
            if (middle.normalized().z() < std::cos(angle)) open.triangle.push_back(t);
        }
        EXPECT_NEAR(brute_force_winding(open.position, open.triangle, Vec3d::Zero()), (1 + std::cos(angle)) / 2, 2e-3);
        const MeshJudgement j = judge_mesh(open);
        EXPECT_FALSE(j.closed);
        EXPECT_GT(j.boundary_edges, 0u);
        EXPECT_EQ(j.admitted_as, Admission::kSheet);
        EXPECT_EQ(j.reason, "open: " + std::to_string(j.boundary_edges) + " boundary edges");
    }
}

TEST(Admission, G21_SelfIntersectingMeshGetsTheWindingSign) {
    Mesh m = make_sphere({0, 0, 0}, 1, 3);
    append(m, make_sphere({1, 0.01, 0.02}, 1, 3));
    EXPECT_NEAR(brute_force_winding(m.position, m.triangle, {0.5, 0, 0}), 2, 1e-9);
    MeshJudgement j = judge_mesh(m);
    EXPECT_GT(j.self_crossing, 20u);
    EXPECT_EQ(j.admitted_as, Admission::kWinding);
    // not tested, not found: the reason says so
    j = judge_mesh(m, false);
    EXPECT_EQ(j.admitted_as, Admission::kSolid);
    EXPECT_NE(j.reason.find("not tested"), std::string::npos);
}

// Two boxes that touch in a point, along an edge or over a face: no common interior points, yet not embedded.
TEST(Admission, TouchingPiecesGetTheWindingSign) {
    const Mesh box = make_box({0, 0, 0}, {1, 1, 1});
    Mesh corner_on_face = box;
    append(corner_on_face, make_tetrahedron({1, 0.3, 0.4}, 0.5));  // its face x = 1 is on the box
    EXPECT_GT(judge_mesh(corner_on_face).self_crossing, 0u);
    EXPECT_EQ(judge_mesh(corner_on_face).admitted_as, Admission::kWinding);
    Mesh tip = make_tetrahedron({0, 0, 0}, 0.25);
    for (Vec3d& p : tip.position) p = Vec3d(1, 0.3, 0.4) + Vec3d(p.x() + p.y() + p.z(), p.y() - p.x(), p.z());
    Mesh touching = box;
    append(touching, tip);
    clean_mesh(touching, {});
    const MeshJudgement j = judge_mesh(touching);
    EXPECT_EQ(j.self_crossing, 0u);
    EXPECT_EQ(j.self_touching, 3u);  // the three faces at the tip
    EXPECT_EQ(j.admitted_as, Admission::kWinding) << j.reason;
}

// Volume, area and box where cancellation would matter: 1e4 diagonals from the origin.
TEST(Admission, MeasuresFarAway) {
    const Vec3d low(3e4, -3e4, 3e4);
    const MeshJudgement j = judge_mesh(make_box(low, low + Vec3d(1, 2, 3)));
    EXPECT_NEAR(j.volume, 6, 1e-12);
    EXPECT_NEAR(j.area, 22, 1e-11);
    EXPECT_EQ(j.bbox_min, low);
    // for an open surface: the cone to the origin, here over the plane z = 2
    Mesh sheet = make_sheet(4);
    for (Vec3d& p : sheet.position) p += Vec3d(1e4, 0, 2);
    EXPECT_NEAR(judge_mesh(sheet).volume, 2.0 / 3, 1e-9);
    EXPECT_DOUBLE_EQ(judge_mesh(sheet).area, 1.0);
}

// The result depends on the surface, not on the order of its vertices and faces.
TEST(Admission, OrderOfRowsDoesNotMatter) {
    Mesh m = make_sphere({0, 0, 0}, 1, 3);
    append(m, make_sphere({1.5, 0.1, 0}, 1, 2));
    append(m, make_box({0.2, 0.2, 0.2}, {0.3, 0.3, 0.3}));
    const MeshJudgement first = judge_mesh(m);
    for (uint64_t seed = 0; seed < 5; ++seed) {
        shuffle(m, seed);
        const MeshJudgement j = judge_mesh(m);
        EXPECT_EQ(j.reason, first.reason);
        EXPECT_EQ(j.self_crossing, first.self_crossing);
        EXPECT_EQ(j.doubly_inside, 1u);
        EXPECT_EQ(j.components, 3u);
    }
}

}  // namespace
}  // namespace trocar
