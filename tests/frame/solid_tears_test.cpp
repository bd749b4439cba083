// Solids that lose tetrahedra while they run: by cuts, by index, by strain.
#include "engine/tissue/solid_tears.hpp"

#include <gtest/gtest.h>

#include <cstdio>
#include <cstring>
#include <fstream>
#include <random>

#include "content/scene/build_links.hpp"
#include "content/volume/isosurface_stuffing.hpp"
#include "engine/base/error.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/mesh/mesh_view.hpp"
#include "engine/tissue/embedded_surface.hpp"
#include "engine/tissue/links.hpp"
#include "engine/tissue/solid_limit.hpp"
#include "engine/tissue/tet_forces.hpp"
#include "systems/frame/frame.hpp"
#include "systems/output/deformable_energy.hpp"
#include "systems/prepare/tear_bodies.hpp"
#include "tests/frame/scenes_under_test.hpp"
#include "tests/frame/written_scene.hpp"
#include "tests/reference/solid_cases.hpp"
namespace {
using namespace trocar;
namespace fs = std::filesystem;

BuiltScene build(const std::string& text, const std::vector<Override>& overrides = {}) {
    return WrittenScene("solid_tears", text).build(overrides);
}

constexpr const char* kBalls = R"(
gravity = [0.0, 0.0, -1.0]
[[body]]
name = "a"
shape = "sphere"
size = 0.1
triangles = 600
motion = "deformable"
model = "solid"
cells = 7
fixed_below = -0.03
[body.tissue]
youngs_modulus = 4e3
density = 1060.0
damping = 5.0
[[body]]
name = "b"
shape = "sphere"
size = 0.1
triangles = 600
motion = "deformable"
model = "solid"
cells = 6
fixed_below = -0.03
position = [0.3, 0.0, 0.0]
[body.tissue]
youngs_modulus = 4e3
[[body]]
name = "rod"
shape = "sphere"
size = 0.03
triangles = 200
motion = "kinematic"
[[body.path]]
time = 0.0
position = [0.01, 0.0, 0.08]
[[body.path]]
time = 1.0
position = [0.01, 0.0, 0.03]
[[body]]
name = "press"
shape = "sphere"
size = 0.03
triangles = 200
motion = "kinematic"
[[body.path]]
time = 0.0
position = [0.3, 0.0, 0.08]
[[body.path]]
time = 1.0
position = [0.3, 0.0, 0.055]
)";
constexpr const char* kNotch = "[[cut]]\nbody = \"a\"\nsphere = [0.0, 0.0, 0.05, 0.03]\ntime = 0.2\n";
constexpr const char* kNever = "[[cut]]\nbody = \"a\"\nsphere = [9.0, 9.0, 9.0, 0.01]\ntime = 0.0\n";

Triangle turned(const Triangle& t) {
    const size_t low = static_cast<size_t>(std::min_element(t.begin(), t.end()) - t.begin());
    return {t[low], t[(low + 1) % 3], t[(low + 2) % 3]};
}

// The remaining tetrahedra of a body, computed from `torn` alone.
TetMesh what_is_left(const World& w, uint32_t body) {
    const uint32_t prototype = w.bodies.mesh[body];
    const SolidInfo& info = w.solids.info[prototype];
    TetMesh mesh;
    for (uint32_t v = 0; v < info.nodes.count; ++v) mesh.position.push_back(rest_of_node(w.meshes, w.solids, prototype, v));
    for (uint32_t t = info.tetrahedra.first; t < info.tetrahedra.first + info.count; ++t) {
        if (w.torn.tetrahedron[t]) continue;
        mesh.tetrahedron.push_back({w.solids.corner[0][t], w.solids.corner[1][t], w.solids.corner[2][t], w.solids.corner[3][t]});
    }
    return mesh;
}

// Compares surface, volume, masses, springs and admission of a body without embedded surface with those of
// its remaining tetrahedra.
void expect_as_left(const World& w, uint32_t body, const std::string& when) {
    const TetMesh left = what_is_left(w, body);
    const MeshView view = mesh_view(w.meshes, w.bodies.mesh[body]);
    std::vector<Triangle> wanted, found;
    for (const Triangle& t : boundary_of(left)) wanted.push_back(turned(t));
    for (const Triangle& t : view.triangle) found.push_back(turned(t));
    std::sort(wanted.begin(), wanted.end()), std::sort(found.begin(), found.end());
    EXPECT_EQ(found, wanted) << when;
    const TetFacts facts = judge_tets(left);
    EXPECT_NEAR(view.info->volume, facts.volume, 1e-9 * facts.volume) << when;
    std::vector<double> mass(left.position.size());
    std::map<std::array<uint32_t, 2>, int> edges;
    for (const auto& t : left.tetrahedron) {
        const auto& p = left.position;
        const double quarter = w.bodies.tissue[body].density * six_volumes(p[t[0]], p[t[1]], p[t[2]], p[t[3]]) / 24;
        for (const uint32_t v : t) mass[v] += quarter;
        for (int i = 0; i < 4; ++i)
            for (int j = 0; j < i; ++j) ++edges[{std::min(t[i], t[j]), std::max(t[i], t[j])}];
    }
    const Range rows = w.bodies.particles[body];
    for (uint32_t v = 0; v < mass.size(); ++v) {
        const Float4& o = w.particles.offset[rows.first + v];
        // a node without mass is fixed, like nodes that are held
        const double has = o.w > 0 ? 1 / double{o.w} : 0;
        EXPECT_TRUE(has == 0 ? mass[v] == 0 || w.meshes.position[v].z() < -0.019 : std::abs(has - mass[v]) <= 3e-6 * mass[v])
            << when << " node " << v << ' ' << has << ' ' << mass[v];
    }
    const SpringInfo& info = w.springs.info[w.bodies.mesh[body]];
    const uint32_t* column = w.springs.slice_column.data() + info.slices.first + w.bodies.mesh[body];
    size_t springs = 0;
    for (size_t h = size_t{column[0]} * kSliceWidth; h < size_t{column[info.slices.count]} * kSliceWidth; ++h)
        springs += w.torn_springs.rest_length[h] > 0;
    EXPECT_EQ(springs, 2 * edges.size()) << when;
    std::map<std::array<uint32_t, 2>, int> sides;
    for (const Triangle& t : wanted)
        for (int k = 0; k < 3; ++k) ++sides[{std::min(t[k], t[(k + 1) % 3]), std::max(t[k], t[(k + 1) % 3])}];
    const bool crossed = std::any_of(sides.begin(), sides.end(), [](const auto& e) { return e.second != 2; });
    EXPECT_TRUE(!crossed || view.info->admission == Admission::kWinding) << when;
    EXPECT_EQ(find_fault(w), "") << when;
}

std::string bytes_of(const World& w, uint32_t body) {
    const Range p = w.bodies.particles[body];
    std::string out(reinterpret_cast<const char*>(&w.particles.offset[p.first]), p.count * sizeof(Float4));
    for (const auto* field : {&w.particles.velocity_x, &w.particles.velocity_y, &w.particles.velocity_z})
        out.append(reinterpret_cast<const char*>(&(*field)[p.first]), p.count * sizeof(float));
    const Range triangles = w.meshes.info[w.bodies.mesh[body]].triangles;
    out.append(reinterpret_cast<const char*>(&w.meshes.triangle[triangles.first]), triangles.count * sizeof(Triangle));
    return out;
}

uint32_t stage_row(const Frame& frame, const char* name) {
    for (uint32_t s = 0; s < frame.stages().size(); ++s)
        if (frame.stages()[s].name == name) return s;
    return kNone;
}

// A notch is cut where a rod presses, without rebuilding the world: surface, masses, springs and volume are
// those of the remaining tetrahedra, contact continues in the notch, and the other body does not change by a
// bit; the same for any number of threads.
TEST(SolidTears, ANotchIsWhatIsLeft) {
    std::string other, torn[2];
    {
        ThreadPool one(1);
        one.run([&] {
            Frame frame(std::move(build(std::string(kBalls) + kNever).world), {});
            for (int i = 0; i < 60; ++i) frame.step();
            other = bytes_of(frame.world(), 1);
            expect_as_left(frame.world(), 0, "untouched");
            EXPECT_EQ(frame.world().meshes.info[0].admission, Admission::kSolid);
        });
    }
    for (const uint32_t threads : {1u, 3u}) {
        ThreadPool pool(threads);
        pool.run([&] {
            Frame frame(std::move(build(std::string(kBalls) + kNotch).world), {});
            const World& w = frame.world();
            const double volume = w.meshes.info[0].volume;
            for (int i = 0; i < 60; ++i) {
                frame.step();
                if (threads == 1 && (i < 2 || i == 12 || i == 59)) expect_as_left(w, 0, "pass " + std::to_string(i));
            }
            const double gone = (volume - w.meshes.info[0].volume) / volume;
            EXPECT_GT(gone, 0.03);
            EXPECT_LT(gone, 0.12);  // 5 % for the lens of two spheres, plus the raggedness of the cells
            EXPECT_EQ(w.report.nonfinite_particles + w.report.runaway_bodies, 0u);
            EXPECT_GT(w.report.removed_tetrahedra, 30u);
            EXPECT_GT(w.report.broken_springs, 30u);
            EXPECT_GT(w.report.contact_events, 3u);
            EXPECT_EQ(bytes_of(w, 1), other);
            EXPECT_GT(w.picture.exposed.size(), 10u);
            EXPECT_EQ(w.picture.exposed.size() + w.tears.body[0].outer - w.picture.removed.size(), w.meshes.info[0].triangles.count);
            torn[threads == 3] = bytes_of(w, 0);
        });
    }
    EXPECT_EQ(torn[0], torn[1]);
}
// Solids created before one that may tear keep their volume forces. Breaks when their empty ranges of
// torn_springs are used.
TEST(SolidTears, ACutOfTheSecondLeavesTheFirstAsItIs) {
    const std::string cut = "[[cut]]\nbody = \"b\"\nsphere = [0.0, 0.0, 0.05, 0.03]\ntime = 0.2\n";
    {
        ThreadPool pool(1);
        pool.run([&] {
            Frame whole(std::move(build(kBalls).world), {}), torn(std::move(build(std::string(kBalls) + cut).world), {});
            for (int i = 0; i < 40; ++i) whole.step(), torn.step();
            EXPECT_GT(torn.world().report.removed_tetrahedra, 10u);
            EXPECT_EQ(bytes_of(whole.world(), 0), bytes_of(torn.world(), 0));
            BodyEnergyScratch scratch;
            const auto elastic = [&](World& w) {
                Energy e;
                const OtherForces other{.solids = &w.solids, .tears = &w.tears, .torn = &w.torn, .torn_springs = &w.torn_springs};
                add_body_energy({w.springs, w.bodies, w.poses, w.particles, w.anchors, w.settings.gravity, other}, 0, scratch, e);
                return e.elastic;
            };
            EXPECT_GT(elastic(whole.world()), 0);
            EXPECT_EQ(elastic(whole.world()), elastic(torn.world()));
        });
    }
}

// Links to nodes that lose their last tetrahedron are removed, and their energy leaves the accounting.
TEST(SolidTears, LinksOfLostNodesBreak) {
    const std::string link = "[[link]]\nbody = \"a\"\nto = \"rod\"\nsphere = [0.0, 0.0, 0.05, 0.012]\nframe = \"rest\"\nstiffness = 5.0\n";
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(build(std::string(kBalls) + kNotch + link).world), {});
        const World& w = frame.world();
        size_t made = 0;
        for (int i = 0; i < 30; ++i) {
            frame.step();
            if (w.clock.tick < 180) made = w.links.node.size();
            EXPECT_TRUE(i != 8 || w.energy.links > 0);
        }
        EXPECT_GT(made, 1u);
        EXPECT_EQ(w.report.broken_links, made);
        EXPECT_EQ(w.energy.links, 0);
        EXPECT_LT(w.energy.work_links, 0);
        EXPECT_LT(std::abs(w.energy.balance), 1e-2 * w.energy.work_hand);
        EXPECT_EQ(find_fault(w), "");
    });
}

// The stage alone: remaining nodes keep position and velocity bit for bit, and the energy accounting has the
// removed energy.
TEST(SolidTears, WhatStaysKeepsItsMomentumAndTheBooksTheRest) {
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(build(std::string(kBalls) + kNotch).world), {});
        World& w = frame.world();
        for (int i = 0; i < 12; ++i) frame.step();
        const uint32_t row = stage_row(frame, "tears");
        ASSERT_NE(row, kNone);
        frame.step_until(row);
        const Range rows = w.bodies.particles[0];
        for (uint32_t p = rows.first; p < rows.end(); ++p) {
            if (w.particles.offset[p].w > 0) w.particles.velocity_x[p] += 0.1f;
        }
        const Particles before = w.particles;
        BodyEnergyScratch scratch;
        const auto total = [&] {
            Energy e;
            const OtherForces other{.solids = &w.solids, .tears = &w.tears, .torn = &w.torn, .torn_springs = &w.torn_springs};
            add_body_energy({w.springs, w.bodies, w.poses, w.particles, w.anchors, w.settings.gravity, other}, 0, scratch, e);
            return e.kinetic + e.elastic + e.gravity;
        };
        const double had = total(), booked = w.energy.work_links;
        frame.run_stage(row);
        ASSERT_GT(w.report.removed_tetrahedra, 30u);
        uint32_t lighter = 0, fixed = 0;
        for (uint32_t p = rows.first; p < rows.end(); ++p) {
            const Float4 &o = w.particles.offset[p], &b = before.offset[p];
            if (o.w == 0 && b.w > 0) {
                ++fixed;
                EXPECT_EQ(w.particles.velocity_x[p], 0);
                continue;
            }
            EXPECT_EQ(std::memcmp(&o, &b, 3 * sizeof(float)), 0);
            EXPECT_EQ(w.particles.velocity_x[p], before.velocity_x[p]);
            EXPECT_EQ(w.particles.velocity_z[p], before.velocity_z[p]);
            lighter += o.w > b.w;
        }
        EXPECT_GT(lighter, 10u);
        EXPECT_GT(fixed, 0u);
        const double left = total() - had, says = w.energy.work_links - booked;
        EXPECT_LT(says, -1e-5);
        EXPECT_NEAR(left, says, 1e-5 * std::abs(says) + 1e-7 * had);
    });
}

// A cavity cut inside without contact: two surface pieces; a point in the cavity is outside, a point in the
// wall inside.
TEST(SolidTears, ACavityInsideFacesInwards) {
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(build(std::string(kBalls) + "[[cut]]\nbody = \"a\"\nsphere = [0.0, 0.0, 0.0, 0.024]\ntime = 0.1\n",
                                    {{"a.cells", "9"}})
                                  .world),
                    {});
        const World& w = frame.world();
        for (int i = 0; i < 12; ++i) frame.step();
        expect_as_left(w, 0, "cavity");
        const MeshInfo& info = w.meshes.info[0];
        EXPECT_EQ(info.components, 2u);
        const ClosestPointTree& tree = *w.trees[w.bodies.tree[0]];
        EXPECT_GT(tree.query(Vec3d(0, 0, 0)).distance, 0.01);
        EXPECT_LT(tree.query(Vec3d(0, 0.036, 0)).distance, -0.004);
        EXPECT_LT(tree.query(Vec3d(-0.036, 0, 0)).distance, -0.004);
        EXPECT_EQ(tree.winds_around(Vec3d(0, 0, 0)), false);
        EXPECT_EQ(tree.winds_around(Vec3d(0, 0.036, 0)), true);
    });
}

// Under an embedded surface: what remains of it is bound to intact tetrahedra, faces of the nodes close the
// wound, the inside is decided by winding number, and a rod reaches the bottom of the wound.
TEST(SolidTears, UnderASkin) {
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(build(std::string(kBalls) + kNotch, {{"a.skin", "true"}, {"a.triangles", "1500"}, {"a.cells", "8"}}).world),
                    {});
        const World& w = frame.world();
        const SolidInfo& info = w.solids.info[0];
        const uint32_t skin = info.skin.count - info.nodes.count;
        EXPECT_EQ(w.meshes.info[0].admission, Admission::kSolid);
        EXPECT_EQ(w.meshes.info[0].components, 1u);
        double reached = 0;
        for (int i = 0; i < 60; ++i) {
            frame.step();
            for (const double depth : w.penetrations.depth) reached = std::max(reached, depth);
        }
        EXPECT_EQ(find_fault(w), "");
        EXPECT_EQ(w.meshes.info[0].admission, Admission::kWinding);
        EXPECT_EQ(w.report.opened_bodies, 1u);
        EXPECT_EQ(w.report.nonfinite_particles + w.report.runaway_bodies, 0u);
        // faces of the nodes: boundary of the remaining tetrahedra, minus the boundary of the whole
        const TetMesh left = what_is_left(w, 0);
        World whole_world;
        whole_world.torn.tetrahedron.assign(w.torn.tetrahedron.size(), 0);
        whole_world.bodies = w.bodies, whole_world.solids = w.solids, whole_world.meshes = w.meshes;
        std::vector<Triangle> outer;
        for (const Triangle& t : boundary_of(what_is_left(whole_world, 0))) outer.push_back(turned(t));
        std::sort(outer.begin(), outer.end());
        std::vector<Triangle> wanted, found;
        for (const Triangle& t : boundary_of(left)) {
            if (!std::binary_search(outer.begin(), outer.end(), turned(t))) wanted.push_back(turned(t));
        }
        std::map<std::array<uint32_t, 4>, int> whole;
        for (const auto& t : left.tetrahedron) whole[t] = 1;
        uint32_t of_skin = 0;
        const MeshView view = mesh_view(w.meshes, 0);
        for (const Triangle& t : view.triangle) {
            if (t[0] >= skin) {
                found.push_back(turned({t[0] - skin, t[1] - skin, t[2] - skin}));
                continue;
            }
            ++of_skin;
            for (const uint32_t v : t) EXPECT_EQ(whole.count(w.solids.embedding_node[info.skin.first + v]), 1u);
        }
        std::sort(wanted.begin(), wanted.end()), std::sort(found.begin(), found.end());
        EXPECT_EQ(found, wanted);
        EXPECT_GT(found.size(), 20u);
        EXPECT_EQ(of_skin, w.tears.body[0].outer - w.picture.removed.size());
        const ClosestPointTree& tree = *w.trees[w.bodies.tree[0]];
        EXPECT_GT(tree.query(Vec3d(0, 0, 0.045)).distance, 0.002) << "in the wound";
        EXPECT_LT(tree.query(Vec3d(0, 0, -0.01)).distance, -0.01) << "in the body";
        EXPECT_GT(reached, 0) << "the rod came to the bottom of the wound";
    });
}

// Random tetrahedra are removed by index while it runs, until the last one: results always equal those of the
// remaining ones, without a fault.
TEST(SolidTears, ByNumberUntilTheLast) {
    BuiltScene scene = build(std::string(kBalls) + kNever, {{"a.cells", "4"}, {"a.anchor", "shape"}, {"a.fixed_below", "-1"}});
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(scene.world), {});
        World& w = frame.world();
        const uint32_t all = w.solids.info[0].count;
        std::vector<uint32_t> order(all);
        for (uint32_t t = 0; t < all; ++t) order[t] = t;
        std::shuffle(order.begin(), order.end(), std::mt19937(3));
        for (uint32_t first = 0; first < all; first += 1 + all / 12) {
            std::vector<uint32_t> some(order.begin() + first, order.begin() + std::min(all, first + 1 + all / 12));
            some.push_back(some[0]), some.push_back(all + 5);
            const TearPass pass{0, w.settings.gravity, w.springs, w.solids, w.bodies, w.poses, w.anchors};
            remove_tetrahedra(pass, w.particles, w.tears, 0, some, {w.torn, w.torn_springs, w.energy, w.report});
            for (int i = 0; i < 3; ++i) frame.step();
            expect_as_left(w, 0, "from " + std::to_string(first));
            EXPECT_EQ(w.report.nonfinite_particles + w.report.runaway_bodies, 0u) << first;
        }
        EXPECT_EQ(w.report.removed_tetrahedra, all - 1);
        EXPECT_EQ(w.meshes.info[0].triangles.count, 4u);
    });
}

// The removed tetrahedra are part of the state: restored to before the cut, the body is whole and repeats bit
// for bit.
TEST(SolidTears, AStateSetBackIsWholeAgain) {
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(build(std::string(kBalls) + kNotch).world), {});
        World& w = frame.world();
        const Clock clock = w.clock;
        const Poses poses = w.poses;
        const Particles particles = w.particles;
        const Torn torn = w.torn;
        const Sleep sleep = w.sleep;
        for (int i = 0; i < 30; ++i) frame.step();
        const uint64_t first = state_hash(w);
        EXPECT_GT(w.report.removed_tetrahedra, 0u);
        w.clock = clock, w.poses = poses, w.particles = particles, w.torn = torn, w.sleep = sleep;
        w.contact_memory = {};
        frame.step();
        expect_as_left(w, 0, "set back");
        EXPECT_EQ(w.report.removed_tetrahedra, 0u);
        for (int i = 1; i < 30; ++i) frame.step();
        EXPECT_EQ(state_hash(w), first);
    });
}

// A bar hangs on a rod that moves up: its tetrahedra break exactly when an edge reaches its strain limit. The
// bar separates, and the energy accounting closes to 1 % of the work done.
TEST(SolidTears, ABarIsPulledApart) {
    const std::string scene = R"(
gravity = [0.0, 0.0, 0.0]
sleep_speed = 0.0
[[body]]
name = "bar"
shape = "box"
size = 0.06
triangles = 200
motion = "deformable"
model = "solid"
cells = 5
fixed_below = -0.02
break_strain = 0.25
[body.tissue]
youngs_modulus = 3e3
damping = 10.0
poisson = 0.4
[[body]]
name = "rod"
shape = "sphere"
size = 0.01
triangles = 100
motion = "kinematic"
position = [0.0, 0.0, 0.1]
[[body.path]]
time = 0.0
position = [0.0, 0.0, 0.1]
[[body.path]]
time = 1.0
position = [0.0, 0.0, 0.15]
[[link]]
body = "bar"
to = "rod"
box = [-0.1, -0.1, 0.019, 0.1, 0.1, 0.1]
frame = "rest"
)";
    uint64_t hash[2] = {0, 0};
    for (const uint32_t threads : {1u, 3u}) {
        ThreadPool pool(threads);
        pool.run([&] {
            Frame frame(std::move(build(scene).world), {});
            World& w = frame.world();
            double peak = 0, worst = 0, stored = 0;
            uint32_t looked = 0;
            const double allowed = 1.25;
            for (int pass = 0; pass < 75; ++pass) {
                frame.step();
                peak = std::max(peak, std::abs(w.energy.work_hand));
                stored = std::max(stored, w.energy.elastic);
                worst = std::max(worst, std::abs(w.energy.balance));
                // no spring is longer than its limit
                const SpringInfo& info = w.springs.info[0];
                const Range rows = w.bodies.particles[0];
                for (uint32_t slice = 0; slice < info.slices.count; ++slice) {
                    for (size_t h = size_t{w.springs.slice_column[slice]} * 16; h < size_t{w.springs.slice_column[slice + 1]} * 16; ++h) {
                        const Float4 &p = w.particles.offset[rows.first + slice * 16 + h % 16],
                                     &q = w.particles.offset[rows.first + w.torn_springs.neighbour[h]];
                        const double length = (Vec3d(p.x, p.y, p.z) - Vec3d(q.x, q.y, q.z)).norm();
                        ASSERT_LE(length, allowed * w.torn_springs.rest_length[h] * (1 + 1e-6) + 1e-12) << pass;
                    }
                }
                // elements that broke in this pass release mass and faces in the next one
                const bool settled =
                    std::find(w.torn.tetrahedron.begin(), w.torn.tetrahedron.end(), uint8_t{1}) == w.torn.tetrahedron.end();
                looked += threads == 1 && settled && w.report.removed_tetrahedra > 0;
                if (threads == 1 && settled && (looked == 1 || pass % 15 == 14)) expect_as_left(w, 0, "pass " + std::to_string(pass));
            }
            EXPECT_TRUE(threads > 1 || looked > 5);
            EXPECT_GT(w.report.removed_tetrahedra, 10u);
            EXPECT_LT(w.report.removed_tetrahedra, w.solids.info[0].count / 2);
            EXPECT_GE(w.meshes.info[0].components, 2u) << "parted";
            EXPECT_EQ(w.report.nonfinite_particles + w.report.runaway_bodies, 0u);
            EXPECT_GT(w.report.min_volume_ratio, 0.2) << "what is lost is not asked for its volume";
            std::printf("bar: %llu of %u tetrahedra lost, stored at most %.4g J, work %.4g J, books off by %.3f %%\n",
                        static_cast<unsigned long long>(w.report.removed_tetrahedra), w.solids.info[0].count, stored, peak,
                        100 * worst / peak);
            EXPECT_LT(worst, 1e-2 * peak);
            hash[threads == 3] = state_hash(w);
        });
    }
    EXPECT_EQ(hash[0], hash[1]);
}
// The step limit of a tearing solid holds for every subset of its tetrahedra: compares it with the limits of
// parts, each built anew. Stiff and soft, heavy and light tetrahedra are adjacent, so that losing a neighbour
// matters.
TEST(SolidTears, TheStableStepHoldsForEveryPart) {
    BuiltScene built = build(std::string(kBalls) + "[[body.region]]\nsphere = [0, 0, 0, 0.01]\n" + kNever, {{"a.cells", "4"}});
    World& w = built.world;
    const double bound = w.bodies.stable_dt[0];
    update_solid_dt(w.meshes, w.springs, w.solids, 0, w.particles, w.anchors, w.bodies);
    const double whole = w.bodies.stable_dt[0];
    EXPECT_LE(bound, whole);
    EXPECT_GT(bound, 0.4 * whole) << "and is of use";
    std::mt19937 random(7);
    const uint32_t all = w.solids.info[0].count;
    const World start = [&] {
        World s;
        s.torn = w.torn, s.particles = w.particles;
        return s;
    }();
    double least = 1e300;
    for (int part = 0; part < 40; ++part) {
        w.torn = start.torn, w.particles = start.particles, w.torn_springs = {};
        for (uint32_t t = 0; t < all; ++t) w.torn.tetrahedron[t] = random() % 40 < static_cast<uint32_t>(part) ? 1 : 0;
        w.torn.tetrahedron[0] = 0;
        copy_torn_springs(w.springs, w.solids, w.bodies, w.tears, w.torn, w.torn_springs);
        lose_mass(w.solids, w.bodies, w.poses, w.anchors, Vec3d::Zero(), 0, w.torn, w.particles);
        // the same body with the remaining springs and tetrahedra, to get the limit of a whole body
        Springs springs = w.springs;
        Solids solids = w.solids;
        for (size_t h = 0; h < w.torn_springs.neighbour.size(); ++h) {
            springs.neighbour[h] = w.torn_springs.neighbour[h];
            if (h < w.torn_springs.factor.size()) springs.factor[h] = w.torn_springs.factor[h];
        }
        const SolidInfo& info = solids.info[0];
        for (uint32_t t = 0; t < info.count; ++t) {
            if (!w.torn.tetrahedron[t]) continue;
            solids.factor.resize(std::max<size_t>(solids.factor.size(), info.tetrahedra.end()), 1.0f);
            solids.info[0].varied = 1;
            solids.factor[t] = 0;
        }
        update_solid_dt(w.meshes, springs, solids, 0, w.particles, w.anchors, w.bodies);
        least = std::min(least, w.bodies.stable_dt[0]);
        EXPECT_GE(w.bodies.stable_dt[0], bound * (1 - 1e-9)) << part;
    }
    std::printf("stable step: whole %.4g ms, least of 40 parts %.4g ms, bound %.4g ms\n", whole * 1e3, least * 1e3, bound * 1e3);
}

TEST(SolidTears, MistakesAreNamed) {
    const auto error = [](const std::string& table, const std::vector<Override>& overrides = {}) -> std::string {
        try {
            build(kBalls + table, overrides);
        } catch (const InputError& e) {
            return e.what();
        }
        return "";
    };
    EXPECT_NE(error("[[cut]]\nbody = \"rod\"\nsphere = [0, 0, 0, 1]\n").find("only deformable bodies can be cut"), std::string::npos);
    EXPECT_EQ(error(kNotch, {{"a.break_strain", "0.4"}}), "");
}

}  // namespace
