#include "content/mend/clean_mesh.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "content/mend/admission.hpp"
#include "content/mend/orientation.hpp"
#include "engine/geometry/winding_number.hpp"
#include "tests/reference/brute_force_distance.hpp"
#include "tests/reference/sample_meshes.hpp"

namespace trocar {
namespace {

using namespace reference;

Mesh cleaned(Mesh m, CleanReport* report = nullptr, const CleanParams& params = {}) {
    const CleanReport r = clean_mesh(m, params);
    if (report) *report = r;
    return m;
}

const char* admitted(const Mesh& m) { return admission_name(judge_mesh(m).admitted_as); }

TEST(CleanMesh, LeavesAGoodMeshAlone) {
    Mesh m = make_sphere({1, 2, 3}, 0.5, 3);
    const Mesh before = m;
    const CleanReport report = clean_mesh(m, {});
    EXPECT_EQ(m.position, before.position);
    EXPECT_EQ(m.triangle, before.triangle);
    EXPECT_EQ(describe_cleaning(report), "");
}

TEST(CleanMesh, G13_RepeatedIndexFacesAreDroppedAndCounted) {
    Mesh m = make_sphere({0, 0, 0}, 1, 1);
    m.triangle.insert(m.triangle.begin() + 3, {2, 2, 5});
    m.triangle.push_back({7, 1, 7});
    m.triangle.push_back({4, 4, 4});
    CleanReport report;
    m = cleaned(m, &report);
    EXPECT_EQ(report.repeated_index_faces, 3u);
    EXPECT_EQ(m.triangle, make_sphere({0, 0, 0}, 1, 1).triangle);
    EXPECT_EQ(describe_cleaning(report), "3 faces with a repeated corner dropped");
}

TEST(CleanMesh, G14_SoupIsWeldedAndCloses) {
    const Mesh sphere = make_sphere({5, -3, 2}, 2, 3);
    Mesh soup = make_soup(sphere);
    soup.position[0].x() += 0.0;
    EXPECT_STREQ(admitted(soup), "sheet");  // without welding, every face is a separate piece
    CleanReport report;
    const Mesh m = cleaned(soup, &report);
    EXPECT_EQ(m.position.size(), sphere.position.size());
    EXPECT_EQ(report.welded_vertices, 3 * sphere.triangle.size() - sphere.position.size());
    EXPECT_EQ(report.unused_vertices, 0u);  // merged vertices are not counted as unused
    EXPECT_STREQ(admitted(m), "solid");
    EXPECT_DOUBLE_EQ(judge_mesh(m).volume, judge_mesh(sphere).volume);
}

TEST(CleanMesh, MinusZeroWeldsToZero) {
    Mesh m = make_soup(make_box({0, 0, 0}, {1, 1, 1}));
    for (size_t v = 0; v < m.position.size(); v += 2) {
        for (double& x : m.position[v]) x = x == 0 ? -0.0 : x;
    }
    EXPECT_EQ(cleaned(m).position.size(), 8u);
}

TEST(CleanMesh, G15_WeldsWithinTheToleranceAndKeepsRealFeatures) {
    // a liver-sized ball with corners 1e-7 of the diagonal apart, and a step of one micrometre that must
    // survive
    Mesh m = make_soup(make_sphere({0, 0, 0}, 0.1, 3));
    const double diagonal = 0.2 * std::sqrt(3.0);
    std::mt19937_64 random(3);
    std::uniform_real_distribution<double> jitter(-0.5e-7 * diagonal, 0.5e-7 * diagonal);
    for (Vec3d& p : m.position) p += Vec3d(jitter(random), jitter(random), jitter(random)) / std::sqrt(3.0);
    append(m, make_tetrahedron({0.2, 0, 0}, 1e-6));
    const Mesh exact = cleaned(m);
    EXPECT_STREQ(admitted(exact), "sheet");
    CleanReport report;
    const Mesh welded = cleaned(m, &report, {2e-7});
    const MeshJudgement judged = judge_mesh(welded);
    EXPECT_EQ(judged.admitted_as, Admission::kSolid) << judged.reason;
    EXPECT_EQ(judged.components, 2u);
    EXPECT_EQ(welded.position.size(), make_sphere({0, 0, 0}, 1, 3).position.size() + 4);
    EXPECT_GT(report.weld_distance, 0.0);
    EXPECT_LE(report.weld_distance, 2e-7 * 0.38);
    EXPECT_NEAR((welded.position.end()[-1] - welded.position.end()[-4]).norm(), 1e-6, 1e-15);
}

// Compares with brute force over all pairs: each vertex is merged into the lowest earlier remaining vertex
// within the tolerance.
TEST(CleanMesh, WeldAgreesWithBruteForce) {
    std::mt19937_64 random(4);
    std::uniform_real_distribution<double> unit(-1, 1);
    for (const double tolerance : {0.0, 1e-14, 0.01, 0.1, 0.5, 10.0}) {
        Mesh m;
        for (int i = 0; i < 1500; ++i) {
            Vec3d p(unit(random), unit(random), unit(random));
            // lattice points, points on cell borders, and copies of earlier points
            if (i % 3 == 0) p = (p * 5).array().round() / 5;
            if (i % 7 == 6) p = m.position[random() % m.position.size()];
            m.position.push_back(p);
        }
        for (uint32_t i = 0; i < 500; ++i) m.triangle.push_back({3 * i, 3 * i + 1, 3 * i + 2});
        std::vector<uint32_t> to(m.position.size());
        uint32_t joined = 0;
        for (uint32_t v = 0; v < to.size(); ++v) {
            to[v] = v;
            for (uint32_t u = 0; u < v && to[v] == v; ++u) {
                if (to[u] == u && (m.position[u] - m.position[v]).norm() <= tolerance) to[v] = u;
            }
            joined += to[v] != v;
        }
        Mesh welded = m;
        EXPECT_EQ(weld_vertices(welded, tolerance), joined) << tolerance;
        for (uint32_t t = 0; t < 500; ++t) {
            for (int k = 0; k < 3; ++k) ASSERT_EQ(welded.triangle[t][k], to[m.triangle[t][k]]) << tolerance;
        }
    }
}

TEST(CleanMesh, G16_DoubledFacesOfTheSameWindingAreDropped) {
    const Mesh sphere = make_sphere({0, 0, 0}, 1, 2);
    Mesh one = sphere;
    const Triangle t = one.triangle[17];
    one.triangle.push_back({t[1], t[2], t[0]});  // same winding, different first corner
    EXPECT_STREQ(admitted(one), "sheet");
    CleanReport report;
    EXPECT_EQ(cleaned(one, &report).triangle, sphere.triangle);
    EXPECT_EQ(report.duplicate_faces, 1u);
    EXPECT_EQ(report.opposite_faces + report.opposite_kept, 0u);

    Mesh shell = sphere;
    shell.triangle.insert(shell.triangle.end(), sphere.triangle.begin(), sphere.triangle.end());
    EXPECT_NEAR(brute_force_winding(shell.position, shell.triangle, {0.1, 0, 0}), 2, 1e-9);
    EXPECT_STREQ(admitted(shell), "winding");  // a winding number of 2 is still inside
    EXPECT_EQ(cleaned(shell, &report).triangle, sphere.triangle);
    EXPECT_EQ(report.duplicate_faces, sphere.triangle.size());

    Mesh sheet = make_sheet(3);
    const Mesh single = sheet;
    sheet.triangle.insert(sheet.triangle.end(), single.triangle.begin(), single.triangle.end());
    EXPECT_EQ(cleaned(sheet).triangle, single.triangle);
}

// Two tetrahedra on the same side of a shared face: without one of the two copies both would be open.
TEST(CleanMesh, G16_ADoubledFaceThatHoldsTwoShellsTogetherStays) {
    Mesh m = make_tetrahedron();
    m.position.push_back({0.1, 0.1, 3});
    m.triangle.insert(m.triangle.end(), {{0, 2, 1}, {0, 1, 4}, {1, 2, 4}, {0, 4, 2}});
    CleanReport report;
    m = cleaned(m, &report);
    EXPECT_EQ(report.duplicate_faces, 0u);
    EXPECT_EQ(report.duplicates_kept, 1u);
    EXPECT_STREQ(admitted(m), "winding");
}

TEST(CleanMesh, G17_DoubledFacesOfOppositeWinding) {
    const Mesh sphere = make_sphere({0, 0, 0}, 1, 2);
    Mesh stray = sphere;
    const Triangle t = stray.triangle[17];
    stray.triangle.push_back({t[1], t[0], t[2]});
    CleanReport report;
    EXPECT_EQ(cleaned(stray, &report).triangle, sphere.triangle);
    EXPECT_EQ(report.opposite_faces, 1u);

    // a wall between two boxes, with one face from each: the pair is kept and reported, and the sign comes
    // from the winding number
    Mesh boxes = make_box({0, 0, 0}, {1, 1, 1});
    append(boxes, make_box({1, 0, 0}, {2, 1, 1}));
    // mirror the diagonals of the second box in y, so that the wall's triangles match
    for (size_t v = 8; v < 16; ++v) boxes.position[v].x() = 3 - boxes.position[v].x();
    for (size_t f = 12; f < 24; ++f) std::swap(boxes.triangle[f][1], boxes.triangle[f][2]);
    const Mesh walled = cleaned(boxes, &report);
    EXPECT_EQ(report.opposite_kept, 2u);
    EXPECT_EQ(walled.triangle.size(), 24u);
    EXPECT_STREQ(admitted(walled), "winding");
    EXPECT_NEAR(judge_mesh(walled).volume, 2, 1e-14);

    // front and back of the same faces enclose nothing
    Mesh pillow = make_sheet(2);
    Mesh back = pillow;
    turn_inside_out(back);
    append(pillow, back);
    pillow = cleaned(pillow, &report);
    EXPECT_EQ(report.opposite_kept, 8u);
    EXPECT_STREQ(admitted(pillow), "sheet");
}

TEST(CleanMesh, ZeroAreaFacesAreDroppedOnlyWhereTheSurfaceStays) {
    // a corner on an edge, with the gap filled by a zero-area face: dropping it would open the surface
    Mesh filled = make_tetrahedron();
    filled.position.push_back({0.5, 0, 0});
    filled.triangle = {{0, 2, 4}, {4, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}, {0, 4, 1}};
    CleanReport report;
    Mesh m = cleaned(filled, &report);
    EXPECT_EQ(report.zero_area_kept, 1u);
    EXPECT_EQ(report.zero_area_faces, 0u);
    const MeshJudgement judged = judge_mesh(m);
    EXPECT_EQ(judged.boundary_edges, 0u);
    EXPECT_EQ(judged.degenerate, 1u);
    EXPECT_EQ(judged.admitted_as, Admission::kWinding);  // the zero-area face has no pseudonormal at its edge
    EXPECT_NEAR(judged.volume, 1.0 / 6, 1e-15);

    // a zero-area flap on a closed surface
    Mesh flap = make_tetrahedron();
    flap.position.push_back({0.5, 0, 0});
    flap.triangle.push_back({0, 1, 4});
    m = cleaned(flap, &report);
    EXPECT_EQ(report.zero_area_faces, 1u);
    EXPECT_EQ(report.unused_vertices, 1u);
    EXPECT_STREQ(admitted(m), "solid");

    // and an isolated one
    Mesh alone = make_tetrahedron();
    alone.position.insert(alone.position.end(), {{5, 5, 5}, {6, 6, 6}, {8, 8, 8}});
    alone.triangle.push_back({4, 5, 6});
    EXPECT_EQ(cleaned(alone).triangle, make_tetrahedron().triangle);

    // slivers have an area, however small
    Mesh sliver = make_tetrahedron();
    for (Vec3d& p : sliver.position) p.y() *= 1e-13;
    EXPECT_EQ(cleaned(sliver).triangle.size(), 4u);
}

TEST(CleanMesh, G22_InsideOutIsTurned) {
    Mesh m = make_sphere({0, 0, 0}, 1, 2);
    turn_inside_out(m);
    EXPECT_LT(judge_mesh(m).volume, 0);
    EXPECT_EQ(judge_mesh(m).inside_out, 1u);
    EXPECT_STRNE(admitted(m), "solid");
    CleanReport report;
    m = cleaned(m, &report);
    EXPECT_EQ(report.pieces_turned, 1u);
    EXPECT_GT(judge_mesh(m).volume, 0);
    EXPECT_STREQ(admitted(m), "solid");
}

TEST(CleanMesh, G23_FlippedFacesAreTurnedBack) {
    const Mesh sphere = make_sphere({0, 0, 0}, 1, 3);
    std::mt19937_64 random(6);
    for (const int flips : {1, 7, 100, 300}) {
        Mesh m = sphere;
        m.uv.resize(m.triangle.size());
        for (uint32_t t = 0; t < m.triangle.size(); ++t) m.uv[t] = {Vec2{0, float(t)}, Vec2{1, 0}, Vec2{2, 0}};
        const auto uv = m.uv;
        std::vector<uint8_t> flipped(m.triangle.size(), 0);
        for (int i = 0; i < flips; ++i) flipped[random() % flipped.size()] ^= 1;
        uint32_t odd = 0;
        for (uint32_t t = 0; t < flipped.size(); ++t) {
            if (flipped[t]) turn_face(m, t);
            odd += flipped[t];
        }
        EXPECT_GT(judge_mesh(m).flipped_edges, 0u);
        CleanReport report;
        m = cleaned(m, &report);
        EXPECT_EQ(report.faces_turned, odd);
        EXPECT_EQ(m.triangle, sphere.triangle);
        for (uint32_t t = 0; t < m.triangle.size(); ++t) {
            for (int k = 0; k < 3; ++k) EXPECT_EQ(m.uv[t][k].u, uv[t][k].u);  // uv follows its corner
        }
    }
    // a non-orientable surface is unchanged, counted, and a sheet
    Mesh band = make_moebius(12);
    const auto before = band.triangle;
    CleanReport report;
    band = cleaned(band, &report);
    EXPECT_EQ(report.unorientable_patches, 1u);
    EXPECT_EQ(band.triangle, before);
    EXPECT_STREQ(admitted(band), "sheet");
}

TEST(CleanMesh, G24_HollowsStayHollow) {
    const Mesh outer = make_sphere({0, 0, 0}, 3, 3), inner = make_sphere({0.5, 0, 0}, 1, 2);
    const Mesh island = make_sphere({0.5, 0, 0}, 0.5, 1);
    const Vec3d in_wall(-2, 0, 0), in_hollow(1.2, 0, 0), in_island(0.5, 0, 0);
    // all combinations of orientations of the three pieces, with the expected winding numbers
    for (int turned = 0; turned < 8; ++turned) {
        Mesh m;
        for (int i = 0; i < 3; ++i) {
            Mesh part = i == 0 ? outer : i == 1 ? inner : island;
            if (turned >> i & 1) turn_inside_out(part);
            append(m, part);
        }
        shuffle(m, 40 + turned);
        const bool hollow = (turned & 1) != (turned >> 1 & 1);  // opposite to its surroundings
        const bool island_against = (turned >> 1 & 1) != (turned >> 2 & 1);
        CleanReport report;
        m = cleaned(m, &report);
        EXPECT_NEAR(brute_force_winding(m.position, m.triangle, in_wall), 1, 1e-9) << turned;
        EXPECT_NEAR(brute_force_winding(m.position, m.triangle, in_hollow), hollow ? 0 : 2, 1e-9) << turned;
        // inside a cavity there is nothing to subtract from: the island becomes solid whatever its
        // orientation in the file
        EXPECT_NEAR(brute_force_winding(m.position, m.triangle, in_island), hollow ? 1 : (island_against ? 1 : 3), 1e-9) << turned;
        const MeshJudgement judged = judge_mesh(m);
        EXPECT_EQ(judged.inside_out, 0u) << turned;
        // a pseudonormal would classify the wall around a doubly-inside piece as outside
        EXPECT_EQ(judged.admitted_as, hollow ? Admission::kSolid : Admission::kWinding) << turned << judged.reason;
        EXPECT_EQ(report.cavities, (hollow ? 1u : 0u) + (!hollow && island_against ? 1u : 0u)) << turned;
    }
}

TEST(CleanMesh, G25_SeveralClosedPiecesAreASolid) {
    Mesh m = make_sphere({0, 0, 0}, 1, 2);
    Mesh second = make_sphere({3, 0, 0}, 1, 2);
    turn_inside_out(second);
    append(m, second);
    append(m, make_box({-5, -1, -1}, {-3, 1, 1}));
    CleanReport report;
    m = cleaned(m, &report);
    EXPECT_EQ(report.pieces_turned, 1u);
    EXPECT_EQ(judge_mesh(m).components, 3u);
    EXPECT_STREQ(admitted(m), "solid");
}

TEST(CleanMesh, G31_NotFiniteOrOutOfRangeIsLeftAndRefused) {
    for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
        Mesh m = make_sphere({0, 0, 0}, 1, 1);
        m.position[5].y() = bad;
        const auto before = m.triangle;
        CleanReport report;
        m = cleaned(m, &report, {1e-3});
        EXPECT_TRUE(report.refused);
        EXPECT_EQ(m.triangle, before);
        EXPECT_EQ(judge_mesh(m).reason, "vertex 5: coordinate is not finite");
        EXPECT_STREQ(admitted(m), "refused");
    }
    Mesh m = make_tetrahedron();
    m.triangle[2][1] = 4;
    EXPECT_TRUE(clean_mesh(m, {}).refused);
    EXPECT_EQ(judge_mesh(m).reason, "face 2: names vertex 4 of 4");
}

TEST(CleanMesh, G34_CracksCloseWithinTheToleranceAndTJunctionsAreSeen) {
    Mesh cracked = make_soup(make_sphere({1, 1, 1}, 1, 2));
    for (size_t v = 0; v < cracked.position.size(); v += 3) {
        for (double& x : cracked.position[v]) x = std::nextafter(x, 9.0);
    }
    EXPECT_STREQ(admitted(cleaned(cracked)), "sheet");
    EXPECT_STREQ(admitted(cleaned(cracked, nullptr, {1e-12})), "solid");

    // a corner that only touches the middle of a long edge: three open edges, reported, not closed by welding
    Mesh junction = make_tetrahedron();
    junction.position.push_back({0.5, 0, 0});
    junction.triangle = {{0, 2, 4}, {4, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
    const MeshJudgement judged = judge_mesh(cleaned(junction, nullptr, {1e-6}));
    EXPECT_EQ(judged.boundary_edges, 3u);
    EXPECT_EQ(judged.admitted_as, Admission::kSheet);
}

TEST(CleanMesh, G36_FewFacesAndUnusedVertices) {
    Mesh none;
    none.position = {{0, 0, 0}, {1, 0, 0}};
    CleanReport report;
    EXPECT_TRUE(cleaned(none, &report).position.empty());
    EXPECT_EQ(report.unused_vertices, 2u);
    EXPECT_STREQ(admitted(none), "refused");
    EXPECT_EQ(judge_mesh(none).reason, "no face");
    Mesh flat;
    flat.position = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}};
    flat.triangle = {{0, 1, 2}};
    EXPECT_STREQ(admitted(flat), "refused");
    Mesh one = make_tetrahedron();
    one.triangle.resize(1);
    EXPECT_STREQ(admitted(cleaned(one, &report)), "sheet");
    EXPECT_EQ(report.unused_vertices, 1u);
    Mesh two = make_tetrahedron();
    two.triangle.resize(2);
    EXPECT_STREQ(admitted(cleaned(two)), "sheet");
    EXPECT_EQ(cleaned(two).position.size(), 4u);
}

// Exact ray crossings compared with solid angles, including points whose rays pass through corners and along
// edges.
TEST(CleanMesh, CountedWindingsAgreeWithSolidAngles) {
    Mesh m = make_sphere({0, 0, 0}, 2, 2), inner = make_box({-0.5, -0.5, -0.5}, {0.5, 0.5, 0.5});
    turn_inside_out(inner);
    append(m, inner);
    append(m, make_box({1, -0.5, -0.5}, {4, 0.5, 0.5}));
    std::vector<uint32_t> all(m.triangle.size());
    for (uint32_t t = 0; t < all.size(); ++t) all[t] = t;
    uint32_t seen[3] = {0, 0, 0}, on_surface = 0;
    for (int i = 0; i < 25 * 25 * 25; ++i) {
        const Vec3d p(-3 + i % 25 * 0.25, -3 + i / 25 % 25 * 0.25, -3 + i / 625 * 0.25);
        int windings = 0;
        if (!count_windings(m.position, m.triangle, all, p, windings)) {
            ++on_surface;
            continue;
        }
        ASSERT_NEAR(brute_force_winding(m.position, m.triangle, p), windings, 1e-6) << p.transpose();
        ++seen[windings];
    }
    for (const uint32_t n : seen) EXPECT_GT(n, 10u);
    EXPECT_GT(on_surface, 100u);
}

// All defects together: any mix of reversed faces, duplicates in either winding, repeated corners, flaps,
// unwelded corners and shuffles of a closed ball must be cleaned to that ball, and a second cleaning must
// change nothing.
TEST(CleanMesh, DamagedBallsAreRestored) {
    std::mt19937_64 random(8);
    const Mesh ball = make_sphere({0.3, -0.2, 7}, 1.3, 2);
    const double volume = judge_mesh(ball).volume;
    for (int trial = 0; trial < 300; ++trial) {
        Mesh m = ball;
        const auto some = [&] { return static_cast<uint32_t>(random() % ball.triangle.size()); };
        const uint32_t faces = static_cast<uint32_t>(m.triangle.size());
        for (uint32_t i = random() % 20; i > 0; --i) turn_face(m, some());
        std::vector<uint8_t> copied(faces, 0);
        for (uint32_t i = random() % 6; i > 0; --i) {
            const uint32_t t = some();
            if (copied[t]++) continue;
            m.triangle.push_back(m.triangle[t]);
            if (random() % 2) std::swap(m.triangle.back()[0], m.triangle.back()[2]);
        }
        for (uint32_t i = random() % 4; i > 0; --i) m.triangle.push_back({5, some() % 50, 5});
        if (random() % 2) m = make_soup(m);
        if (random() % 2) turn_inside_out(m);
        shuffle(m, random());
        CleanReport report;
        Mesh once = cleaned(m, &report);
        const MeshJudgement judged = judge_mesh(once);
        ASSERT_EQ(judged.admitted_as, Admission::kSolid) << trial << ": " << judged.reason;
        ASSERT_EQ(once.triangle.size(), ball.triangle.size()) << trial;
        ASSERT_NEAR(judged.volume, volume, 1e-12) << trial;
        const Mesh twice = cleaned(once, &report);
        ASSERT_EQ(twice.triangle, once.triangle);
        ASSERT_EQ(describe_cleaning(report), "");
    }
}

}  // namespace
}  // namespace trocar
