#include "content/volume/isosurface_stuffing.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <bit>
#include <cmath>
#include <cstring>
#include <map>
#include <set>
#include <sstream>

#include "content/shapes/implicit_shapes.hpp"
#include "content/shapes/shape_library.hpp"
#include "content/volume/mesh_distance.hpp"
#include "content/write/save_tets.hpp"
#include "engine/base/error.hpp"
#include "tests/reference/closed_surface.hpp"
namespace trocar {
namespace {

template <typename Function>
DistanceField each_point(const Function& function) {
    return [function](std::span<const Vec3d> points, std::span<double> distance) {
        for (size_t i = 0; i < points.size(); ++i) distance[i] = function(points[i]);
    };
}
DistanceField sphere(const Vec3d& centre, double radius) {
    return each_point([=](const Vec3d& p) { return (p - centre).norm() - radius; });
}
DistanceField torus(double ring, double tube) {
    return each_point([=](const Vec3d& p) { return std::hypot(std::hypot(p.x(), p.y()) - ring, p.z()) - tube; });
}

// Properties of a tetrahedral mesh computed with maps; shares no code with the product.
struct Survey {
    double volume = 0, min_dihedral = 180, max_dihedral = 0;
    uint64_t inverted = 0, bad_faces = 0, open_edges = 0;
    Mesh boundary;  // with all vertices
};
Survey survey(const TetMesh& mesh) {
    Survey s;
    std::map<std::set<uint32_t>, std::vector<Triangle>> faces;
    for (const auto& t : mesh.tetrahedron) {
        std::array<Vec3d, 4> p;
        for (int k = 0; k < 4; ++k) p[k] = mesh.position[t[k]];
        Eigen::Matrix3d m;
        m << p[1] - p[0], p[2] - p[0], p[3] - p[0];
        s.volume += m.determinant() / 6;
        s.inverted += m.determinant() > 0 ? 0 : 1;
        // at edge a b: the angle between the components of c and d perpendicular to the edge
        for (int a = 0; a < 4; ++a) {
            for (int b = a + 1; b < 4; ++b) {
                const int c = a == 0 ? (b == 1 ? 2 : 1) : 0, d = 6 - a - b - c;
                const Vec3d e = (p[b] - p[a]).normalized();
                const Vec3d u = (p[c] - p[a]) - e * e.dot(p[c] - p[a]), v = (p[d] - p[a]) - e * e.dot(p[d] - p[a]);
                const double angle = std::acos(std::clamp(u.dot(v) / (u.norm() * v.norm()), -1.0, 1.0)) * 180 / M_PI;
                s.min_dihedral = std::min(s.min_dihedral, angle);
                s.max_dihedral = std::max(s.max_dihedral, angle);
            }
        }
        for (const Triangle& f : {Triangle{t[1], t[2], t[3]}, {t[0], t[3], t[2]}, {t[0], t[1], t[3]}, {t[0], t[2], t[1]}}) {
            faces[{f[0], f[1], f[2]}].push_back(f);
        }
    }
    std::map<std::pair<uint32_t, uint32_t>, int> edges;
    s.boundary.position = mesh.position;
    for (const auto& [key, uses] : faces) {
        if (uses.size() == 1) {
            s.boundary.triangle.push_back(uses[0]);
            for (int k = 0; k < 3; ++k) {
                ++edges[{uses[0][k], uses[0][(k + 1) % 3]}];
                --edges[{uses[0][(k + 1) % 3], uses[0][k]}];
            }
            continue;
        }
        if (uses.size() > 2) ++s.bad_faces;
        const Triangle &f = uses[0], &g = uses[1];
        const bool opposite = g == Triangle{f[0], f[2], f[1]} || g == Triangle{f[2], f[1], f[0]} || g == Triangle{f[1], f[0], f[2]};
        if (!opposite) ++s.bad_faces;
    }
    for (const auto& [edge, sum] : edges) s.open_edges += sum != 0;
    return s;
}

void expect_sound(const TetMesh& mesh, const char* what) {
    const Survey s = survey(mesh);
    EXPECT_EQ(s.inverted, 0u) << what;
    EXPECT_EQ(s.bad_faces, 0u) << what;
    EXPECT_EQ(s.open_edges, 0u) << what;
    EXPECT_GT(s.min_dihedral, kStuffingMinDihedral) << what;
    EXPECT_LT(s.max_dihedral, kStuffingMaxDihedral) << what;
    // the tetrahedra fill what the boundary encloses: no overlap and no gap inside
    EXPECT_NEAR(reference::survey_surface(s.boundary).volume / s.volume, 1, 1e-9) << what;
    const TetFacts facts = judge_tets(mesh);
    EXPECT_EQ(facts.inverted, s.inverted);
    EXPECT_EQ(facts.bad_faces, s.bad_faces);
    EXPECT_EQ(facts.open_edges, s.open_edges);
    EXPECT_EQ(facts.boundary_faces, s.boundary.triangle.size());
    EXPECT_NEAR(facts.min_dihedral, s.min_dihedral, 1e-6);
    EXPECT_NEAR(facts.max_dihedral, s.max_dihedral, 1e-6);
    EXPECT_NEAR(facts.volume / s.volume, 1, 1e-12);
}

TEST(IsosurfaceStuffing, SphereAndTorusConvergeToTheirVolume) {
    const double radius = 0.1;
    for (const bool ring : {false, true}) {
        const double exact = ring ? 2 * M_PI * M_PI * 0.1 * 0.04 * 0.04 : 4.0 / 3 * M_PI * radius * radius * radius;
        const DistanceField field = ring ? torus(0.1, 0.04) : sphere(Vec3d(0.011, -0.02, 0.003), radius);
        double before = 0;
        for (const double spacing : {0.048, 0.024, 0.012}) {
            const TetMesh mesh = stuff_isosurface({spacing, 1}, {Vec3d::Constant(-0.15), Vec3d::Constant(0.15)}, field);
            expect_sound(mesh, ring ? "torus" : "sphere");
            const Survey s = survey(mesh);
            const double error = 1 - s.volume / exact;
            EXPECT_GT(error, 0) << "chords lie inside";
            EXPECT_TRUE(before == 0 || before / error > 2.7) << "second order: " << before / error;
            before = error;
            if (spacing > 0.012) continue;
            EXPECT_LT(error, ring ? 8e-3 : 4e-3);
            Mesh used = s.boundary;  // drop inner vertices, which are not on the surface
            EXPECT_EQ(reference::survey_surface(used).components, 1u);
            std::vector<double> distance(mesh.position.size());
            field(mesh.position, distance);
            std::set<uint32_t> surface;
            for (const Triangle& t : used.triangle) surface.insert(t.begin(), t.end());
            for (const uint32_t v : surface) EXPECT_NEAR(distance[v], 0, 1e-4 * spacing);
        }
    }
}

// Random values at every point produce every sign pattern and arbitrary cut points: the angle bounds must
// still hold.
TEST(IsosurfaceStuffing, AnglesStayWithinTheBoundsForAnyField) {
    TetFacts worst;
    uint64_t faces = 0;
    for (uint64_t seed = 0; seed < 24; ++seed) {
        const DistanceField field = each_point([=](const Vec3d& p) {
            uint64_t key = seed;
            for (int k = 0; k < 3; ++k) key = mix_bits(key ^ std::bit_cast<uint64_t>(p[k]));
            const double chance = double(key >> 11) * 0x1p-53 - 0.3 - 0.02 * double(seed);
            return std::max(p.norm() - 1, seed % 2 == 0 ? chance : 0.3 * lattice_noise(p * double(1 + seed), seed));
        });
        const TetFacts facts = judge_tets(stuff_isosurface({0.1, 1e6}, {Vec3d::Constant(-1), Vec3d::Constant(1)}, field));
        worst.min_dihedral = std::min(worst.min_dihedral, facts.min_dihedral);
        worst.max_dihedral = std::max(worst.max_dihedral, facts.max_dihedral);
        EXPECT_EQ(facts.inverted + facts.bad_faces + facts.open_edges, 0u) << seed;
        faces += facts.boundary_faces;
    }
    EXPECT_GT(faces, 200000u);
    EXPECT_GT(worst.min_dihedral, kStuffingMinDihedral);
    EXPECT_LT(worst.max_dihedral, kStuffingMaxDihedral);
    // the worst angles come near the bounds; smooth fields alone would not test them
    EXPECT_LT(worst.min_dihedral, 13.5);
    EXPECT_GT(worst.max_dihedral, 158);
}

TEST(IsosurfaceStuffing, SamplesExactlyOnTheSurfaceAreItsVertices) {
    const TetMesh mesh = stuff_isosurface({0.5, 1}, {Vec3d::Constant(-1), Vec3d::Constant(1)}, each_point([](const Vec3d& p) {
                                              return p.cwiseAbs().maxCoeff() - 0.875;  // coincides with a plane of lattice points
                                          }));
    expect_sound(mesh, "cube");
    EXPECT_NEAR(judge_tets(mesh).volume / (1.75 * 1.75 * 1.75), 1, 0.07);
}

TEST(IsosurfaceStuffing, SkippingBlocksChangesNothing) {
    const ImplicitShape liver = liver_shape(3);
    const DistanceField field = each_point([&](const Vec3d& p) { return liver.distance(p); });
    const TetMesh skipping = stuff_isosurface({0.008, liver.steepness}, liver.box, field);
    const TetMesh all = stuff_isosurface({0.008, 1e9}, liver.box, field);
    EXPECT_EQ(skipping.position, all.position);
    EXPECT_EQ(skipping.tetrahedron, all.tetrahedron);
    expect_sound(skipping, "liver");
}

TEST(IsosurfaceStuffing, AClosedMeshIsFilledToItsVolume) {
    const Mesh liver = make_shape("liver", 2000);
    const auto surface = reference::survey_surface(liver);
    Box box;
    for (const Vec3d& p : liver.position) box.min = box.min.cwiseMin(p), box.max = box.max.cwiseMax(p);
    const TetMesh mesh = stuff_isosurface({0.008, 1}, box, mesh_distance(liver, Admission::kSolid));
    expect_sound(mesh, "liver mesh");
    EXPECT_NEAR(judge_tets(mesh).volume / surface.volume, 1, 0.015);
}

TEST(IsosurfaceStuffing, NothingInsideGivesNothingAndBadAskingIsRefused) {
    const Box box{Vec3d::Constant(-1), Vec3d::Constant(1)};
    EXPECT_TRUE(stuff_isosurface({0.2, 1}, box, sphere(Vec3d::Zero(), -0.1)).tetrahedron.empty());
    EXPECT_THROW(stuff_isosurface({1e-4, 1}, box, sphere(Vec3d::Zero(), 1)), InputError);
    EXPECT_THROW(stuff_isosurface({0.2, 1}, Box{}, sphere(Vec3d::Zero(), 1)), InputError);
    EXPECT_THROW(stuff_isosurface({0.2, 1}, box, sphere(Vec3d::Zero(), 3)), InputError) << "the solid leaves its box";
}

TEST(SaveTets, BothFilesReadBackToTheSameMesh) {
    const TetMesh mesh = stuff_isosurface({0.05, 1}, {Vec3d::Constant(-0.1), Vec3d::Constant(0.1)}, sphere(Vec3d::Zero(), 0.1));
    std::istringstream msh(encode_msh(mesh));
    std::string line;
    for (const char* expected : {"$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes"}) {
        std::getline(msh, line);
        EXPECT_EQ(line, expected);
    }
    size_t count = 0, index = 0;
    msh >> count;
    ASSERT_EQ(count, mesh.position.size());
    for (const Vec3d& p : mesh.position) {
        Vec3d q;
        msh >> index >> q.x() >> q.y() >> q.z();
        ASSERT_EQ(p, q);
    }
    msh >> line >> line >> count;
    ASSERT_EQ(count, mesh.tetrahedron.size());
    for (const auto& t : mesh.tetrahedron) {
        int kind = 0, tags = 0, a = 0, b = 0;
        std::array<uint32_t, 4> v;
        msh >> index >> kind >> tags >> a >> b >> v[0] >> v[1] >> v[2] >> v[3];
        ASSERT_TRUE(kind == 4 && tags == 2);
        for (uint32_t& i : v) --i;
        ASSERT_EQ(v, t);
    }
    const std::string vtu = encode_vtu(mesh);
    const std::string mark = "<AppendedData encoding=\"raw\">\n_";
    const size_t data = vtu.find(mark) + mark.size();
    const auto offset_of = [&](const char* name) {
        const size_t at = vtu.find("offset=\"", vtu.find(std::string("Name=\"") + name)) + 8;
        return data + size_t(std::atoll(vtu.c_str() + at));
    };
    const auto block = [&](const char* name) {
        uint64_t bytes = 0;
        std::memcpy(&bytes, vtu.data() + offset_of(name), 8);
        return std::pair(vtu.data() + offset_of(name) + 8, bytes);
    };
    const auto [points, point_bytes] = block("Points");
    ASSERT_EQ(point_bytes, 24 * mesh.position.size());
    EXPECT_EQ(std::memcmp(points, mesh.position.data(), point_bytes), 0);
    const auto [corners, corner_bytes] = block("connectivity");
    ASSERT_EQ(corner_bytes, 32 * mesh.tetrahedron.size());
    int64_t last = 0;
    std::memcpy(&last, corners + corner_bytes - 8, 8);
    EXPECT_EQ(uint32_t(last), mesh.tetrahedron.back()[3]);
    const auto [types, type_bytes] = block("types");
    ASSERT_EQ(type_bytes, mesh.tetrahedron.size());
    EXPECT_EQ(types[0], 10);
    EXPECT_EQ(vtu.compare(size_t(types - vtu.data()) + type_bytes, 18, "\n  </AppendedData>"), 0);
}

}  // namespace
}  // namespace trocar
