#include <gtest/gtest.h>

#include <cstring>
#include <map>
#include <set>

#include "engine/files/capture_file.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "systems/frame/frame.hpp"
#include "systems/prepare/sleep.hpp"
#include "tests/frame/scenes_under_test.hpp"

// The stress scenes of content/scenes with few bodies, and bodies spawned from an object pool.
namespace {
using namespace trocar;

BuiltScene stress_scene(const std::string& name, const std::vector<Override>& overrides) {
    return build_scene(read_scene_file(source_folder() / "content/scenes" / ("stress_" + name + ".toml"), overrides), Looks::kPlain);
}

struct Small {
    const char* name;
    std::vector<Override> overrides;
    uint32_t passes;
    double residual = 0.01;        // relative to the smallest body: overlap that a pass may leave
    double usual_residual = 0.01;  // limit for nine of ten passes
};
void PrintTo(const Small& s, std::ostream* out) { *out << s.name; }

class SmallStressScenes : public testing::TestWithParam<Small> {};

// Size of the smallest movable body.
double smallest_body(const World& w) {
    double size = std::numeric_limits<double>::infinity();
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b)
        if (joins_islands(w.bodies.motion[b])) size = std::min<double>(size, 2 * w.meshes.info[w.bodies.mesh[b]].radius);
    return size;
}

// Breaks when every copy partitions its surface anew, which dominates the time to build ten thousand bodies.
TEST(StressScenes, CopiesShareTheirGroupsOfTriangles) {
    const World w = std::move(stress_scene("mixed", {{"count", "20"}, {"rigid", "4"}}).world);
    std::map<uint32_t, const ClosestPointTree*> first;
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) {
        const ClosestPointTree* tree = w.trees[w.bodies.tree[b]].get();
        EXPECT_TRUE(tree->cut_like(*first.try_emplace(w.bodies.mesh[b], tree).first->second)) << w.bodies.name[b];
    }
    EXPECT_EQ(first.size(), 4u);
}

// A few bodies at rest use the same speculative margin as moving ones when a frame is made; for a lattice of
// many that would need several times the memory of any pass.
TEST(StressScenes, ManyAtRestDoNotLookFarAhead) {
    const auto speculative_edges = [](const char* count) {
        const Frame frame(std::move(stress_scene("packed", {{"count", count}, {"resolution", "200"}}).world), {});
        return frame.world().boxes.margin[0] / frame.world().meshes.info[0].mean_edge;
    };
    EXPECT_GT(speculative_edges("27"), 1.0);
    EXPECT_LT(speculative_edges("125"), 0.5);
}

// Breaks when a scene does not load, when the number of threads changes its result, or when bodies are lost,
// blow up or sink into another.
TEST_P(SmallStressScenes, RunTheSameOnAnyThreads) {
    uint64_t hash[2] = {0, 0};
    for (const uint32_t threads : {1u, 4u}) {
        ThreadPool pool(threads);
        pool.run([&] {
            Frame frame(std::move(stress_scene(GetParam().name, GetParam().overrides).world), {});
            const World& w = frame.world();
            std::vector<double> left;
            for (uint32_t pass = 0; pass < GetParam().passes; ++pass) frame.step(), left.push_back(w.report.deepest_residual);
            std::ranges::sort(left);
            EXPECT_LE(left.back(), GetParam().residual * smallest_body(w));
            EXPECT_LE(left[left.size() * 9 / 10], GetParam().usual_residual * smallest_body(w));
            hash[threads > 1] = state_hash(w);
            EXPECT_EQ(w.report.nonfinite_particles, 0u);
            EXPECT_EQ(w.report.runaway_bodies, 0u);
        });
    }
    EXPECT_EQ(hash[0], hash[1]);
}

INSTANTIATE_TEST_SUITE_P(Few, SmallStressScenes,
                         testing::Values(Small{"rain", {{"count", "12"}, {"resolution", "80"}}, 40},
                                         Small{"packed", {{"count", "8"}, {"resolution", "200"}}, 6},
                                         Small{"sparse", {{"count", "30"}, {"resolution", "80"}}, 20},
                                         Small{"large", {{"count", "2"}, {"resolution", "600"}}, 60},
                                         Small{"mixed", {{"count", "8"}, {"rigid", "6"}, {"resolution", "80"}}, 160, 0.01, 0.001},
                                         // boxes of 48 triangles collide edge to edge, faster than push_speed
                                         // separates them: 0.1 to 2.4 % in twelve seeds
                                         Small{"settle", {{"count", "9"}, {"columns", "2"}, {"resolution", "48"}}, 40, 0.025},
                                         Small{"full_contact", {{"resolution", "600"}}, 3, 0.12, 0.12},
                                         Small{"pile", {{"count", "12"}, {"columns", "2"}, {"shape", "hull"}, {"resolution", "20"}}, 60},
                                         Small{"come_and_go", {{"count", "12"}, {"life", "0.3"}, {"resolution", "80"}}, 60}),
                         [](const auto& info) { return info.param.name; });

// Three layers of nine balls fall 0.3 m on each other: the lower ones bounce while the upper ones are still
// falling. Detecting contacts at 60 Hz leaves 4.9 % here.
TEST(StressScenes, RainThatHitsLeavesNoOverlap) {
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(stress_scene("rain", {{"count", "27"}, {"drop.scatter.columns", "[3, 3]"}}).world), {});
        const World& w = frame.world();
        double left = 0;
        for (uint32_t pass = 0; pass < 160; ++pass) frame.step(), left = std::max(left, w.report.deepest_residual);
        std::printf("27 balls: %.2f %% of their size left at most, balance %.2g J of %.3g J that gravity gave\n",
                    100 * left / smallest_body(w), w.energy.balance, -w.energy.gravity);
        EXPECT_LE(left, 0.01 * smallest_body(w));
    });
}

// Boxes hit balls and leave with a wrinkle of them around a corner. Breaks when contacts from closest points
// hold that wrinkle: a box then pulls the ball over itself to seven times its length, and springs stretch by
// 2.5 times their length.
TEST(StressScenes, LongBoxesLetGoOfTheBallsTheyHit) {
    ThreadPool pool(2);
    pool.run([&] {
        Frame frame(std::move(stress_scene("mixed", {{"seed", "2"},
                                                     {"soft.scatter.spacing", "[0.165, 0.165, 0.36]"},
                                                     {"box.scatter.spacing", "[0.24, 0.24, 0.36]"},
                                                     {"box.position", "[0.0, 0.0, 0.30]"}})
                                  .world),
                    {});
        const World& w = frame.world();
        for (uint32_t pass = 0; pass < 240; ++pass) frame.step();
        double most = 0;
        for (uint32_t body = 0; body < w.bodies.mesh.size(); ++body) {
            if (w.bodies.motion[body] != Motion::kDeformable) continue;
            const MeshView mesh = mesh_view(w.meshes, w.bodies.mesh[body]);
            for (const auto& [a, b] : mesh.edge) {
                const auto position = [&](uint32_t v) {
                    const Float4& o = w.particles.offset[w.bodies.particles[body].first + v];
                    return Vec3d(o.x, o.y, o.z);
                };
                most = std::max(most, (position(a) - position(b)).norm() / (mesh.position[a] - mesh.position[b]).norm() - 1);
            }
        }
        std::printf("largest stretch of an edge: %.2f\n", most);
        EXPECT_LT(most, 1);
    });
}

// A body falling beside others that are stopped within the pass already has contact constraints. Breaks
// without them: the stack's upper balls sink in by 0.7 %.
TEST(StressScenes, StackThatLandsLeavesNoOverlap) {
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(build_scene(read_scene_file(source_folder() / "content/scenes/soft_stack.toml", {}), Looks::kPlain).world),
                    {});
        const World& w = frame.world();
        double left = 0;
        for (uint32_t pass = 0; pass < 60; ++pass) frame.step(), left = std::max(left, w.report.deepest_residual);
        std::printf("stack: %.3f %% of a ball left at most\n", 100 * left / smallest_body(w));
        EXPECT_LE(left, 0.001 * smallest_body(w));
    });
}

// Two organs that start 26 mm deep in each other are separated along their original direction, at the speed
// set in the scene.
TEST(StressScenes, FullContactIsPushedApart) {
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(stress_scene("full_contact", {{"resolution", "1000"}}).world), {});
        const World& w = frame.world();
        const auto height = [&] {  // m, mean of the upper one's particles
            const Range r = w.bodies.particles[1];
            double sum = 0;
            for (uint32_t p = r.first; p < r.end(); ++p) sum += static_cast<double>(w.particles.offset[p].z);
            return sum / r.count;
        };
        const double start = height();
        std::vector<double> left;
        for (int pass = 0; pass < 12; ++pass) frame.step(), left.push_back(w.report.deepest_residual);
        EXPECT_GT(left[0], 15e-3);
        EXPECT_NEAR(left[3], left[0] - 3 * w.settings.contact.push_speed / 60, 1e-4);
        EXPECT_LT(left[11], 0.01 * smallest_body(w));
        EXPECT_GT(height(), start) << "parted upwards";
    });
}

// One use of a pool slot.
struct Stay {
    uint64_t from = 0, to = 0;  // ms
    friend bool operator==(const Stay&, const Stay&) = default;
};
using Book = std::map<uint32_t, std::vector<Stay>>;  // by slot

// An independent implementation of the rules in spawning.hpp: body k is due at k / rate, takes the lowest
// slot that was free before this pass, and stays for `life`.
Book expected_stays(uint32_t slots, double rate, double life, const std::vector<uint64_t>& ticks) {
    Book book;
    std::set<uint32_t> free;
    for (uint32_t s = 0; s < slots; ++s) free.insert(s);
    uint64_t came = 0;
    for (const uint64_t now : ticks) {
        std::vector<uint32_t> out;
        for (auto& [slot, stays] : book)
            if (stays.back().to == 0 && static_cast<double>(now - stays.back().from) >= life * 1e3)
                stays.back().to = now, out.push_back(slot);
        while (static_cast<double>(came) / rate <= static_cast<double>(now) * 1e-3 + 1e-12 && !free.empty()) {
            book[*free.begin()].push_back({now, 0});
            free.erase(free.begin());
            ++came;
        }
        free.insert(out.begin(), out.end());
    }
    return book;
}

std::vector<Override> pool_of(const char* count, const char* rate, const char* life) {
    return {{"count", count}, {"rate", rate}, {"life", life}, {"resolution", "80"}};
}

TEST(ComeAndGo, FollowsItsBookAndRecyclesSlotsWithNewNames) {
    ThreadPool pool(2);
    pool.run([&] {
        Frame frame(std::move(stress_scene("come_and_go", pool_of("6", "25", "0.3")).world), {});
        const World& w = frame.world();
        const std::vector<Range> rows = w.bodies.particles;
        const Range slots = w.pools.slots[0];
        EXPECT_EQ(slots.count, 6u);
        Book book;
        std::vector<uint64_t> ticks;
        std::map<uint32_t, Entity> name;
        std::vector<Entity> gone;
        for (int pass = 0; pass < 90; ++pass) {
            const uint64_t now = w.clock.tick;
            ticks.push_back(now);
            frame.step();
            for (uint32_t s = slots.first; s < slots.end(); ++s) {
                std::vector<Stay>& stays = book[s - slots.first];
                const bool here = !is_away(w.spawning, s), was = !stays.empty() && stays.back().to == 0;
                if (here && !was) {
                    stays.push_back({now, 0}), name[s] = entity_of(w.spawning, s);
                    for (const Entity& e : gone) EXPECT_FALSE(e == name[s]) << "a name was given twice";
                }
                if (!here && was) {
                    stays.back().to = now;
                    gone.push_back(name[s]);
                }
                EXPECT_EQ(name.contains(s) && is_there(w.bodies, w.spawning, name[s]), here);
                const bool drawn = frame.times().picture ? w.picture.body[s].mesh != kNone : here;
                EXPECT_EQ(drawn, here);
                if (here) continue;
                EXPECT_TRUE(is_asleep(w.sleep, s));
                EXPECT_FALSE((w.boxes.box[s].min.array() <= w.boxes.box[s].max.array()).all());
            }
            uint64_t there = 0;
            for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) {
                const bool moves = is_deformable(w.bodies, b) || w.bodies.motion[b] == Motion::kFree;
                there += moves && !is_away(w.spawning, b);
            }
            EXPECT_EQ(w.report.awake_bodies + w.report.asleep_bodies, there) << "an empty slot is nobody who sleeps";
            for (size_t i = 0; i < w.pairs.a.size(); ++i)
                EXPECT_FALSE(is_away(w.spawning, w.pairs.a[i]) || is_away(w.spawning, w.pairs.b[i]));
        }
        Book expected = expected_stays(6, 25, 0.3, ticks);
        for (auto& [slot, stays] : book)
            if (stays.empty()) expected[slot];
        EXPECT_EQ(book, expected);
        EXPECT_GT(gone.size(), 12u) << "no slot was used three times: nothing was tested";
        for (const Entity& e : gone) EXPECT_FALSE(is_there(w.bodies, w.spawning, e));
        for (size_t b = 0; b < rows.size(); ++b) EXPECT_EQ(rows[b].first, w.bodies.particles[b].first) << "renumbered";
        EXPECT_EQ(w.spawning.came[0], [&] {
            uint64_t all = 0;
            for (const auto& [slot, stays] : expected) all += stays.size();
            return all;
        }());
    });
}

// An untouched body falls exactly the same while others are spawned and removed, and the energy accounting
// stays closed. Breaks when a slot's contents leak into another, or energy is removed without being
// accounted.
TEST(ComeAndGo, LeavesOthersAloneAndTheBooksClosed) {
    std::vector<Float4> position[2];
    for (const int others : {0, 1}) {
        ThreadPool pool(1);
        pool.run([&] {
            std::vector<Override> overrides = pool_of("9", others ? "40" : "0.001", "0.25");
            Frame frame(std::move(stress_scene("come_and_go", overrides).world), {});
            const World& w = frame.world();
            const uint32_t first = w.pools.slots[0].first;
            double worst = 0, most = 0;
            for (int pass = 0; pass < 60; ++pass) {
                frame.step();
                worst = std::max(worst, std::abs(w.energy.balance)), most = std::max(most, w.energy.kinetic);
                if (pass == 12) {
                    const Range r = w.bodies.particles[first];
                    position[others].assign(w.particles.offset.begin() + r.first, w.particles.offset.begin() + r.end());
                }
            }
            EXPECT_GT(most, 1e-3);
            EXPECT_LT(worst, 0.02 * most);
        });
    }
    ASSERT_EQ(position[0].size(), position[1].size());
    EXPECT_EQ(0, std::memcmp(position[0].data(), position[1].data(), position[0].size() * sizeof(Float4)));
}

// A state saved while slots are in use has the same continuation. Breaks when pool data is not part of a
// capture.
TEST(ComeAndGo, GoesOnFromASavedState) {
    ThreadPool pool(1);
    pool.run([&] {
        const auto overrides = pool_of("6", "25", "0.3");
        Frame run(std::move(stress_scene("come_and_go", overrides).world), {});
        for (int pass = 0; pass < 50; ++pass) run.step();
        CaptureRecord record;
        for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r)
            if (resource_kind(static_cast<Resource>(r)) == ResourceKind::kState)
                save_resource(run.world(), static_cast<Resource>(r), record);
        Frame again(std::move(stress_scene("come_and_go", overrides).world), {});
        for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r)
            if (resource_kind(static_cast<Resource>(r)) == ResourceKind::kState)
                load_resource(record, static_cast<Resource>(r), again.world());
        EXPECT_EQ(find_fault(again.world()), "");
        for (int pass = 0; pass < 30; ++pass) run.step(), again.step();
        EXPECT_EQ(state_hash(run.world()), state_hash(again.world()));
        again.world().spawning.away.pop_back();
        EXPECT_NE(find_fault(again.world()), "");
    });
}

}  // namespace
