#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "app/run_program.hpp"
#include "content/read/load_mesh.hpp"
#include "content/scene/build_scene.hpp"
#include "content/shapes/shape_library.hpp"
#include "content/write/save_mesh.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/mesh/mass_properties.hpp"
#include "frame/scenes_under_test.hpp"
#include "frame/written_scene.hpp"
#include "reference/brute_force_distance.hpp"
#include "systems/app/capture/capture_replay.hpp"
#include "systems/app/interface/handles.hpp"
#include "systems/app/interface/trocar/trocar.h"

// The C interface: what it gives is what the C++ parts below it hold, bit for bit, and nothing it is given ends the program.
namespace trocar {
namespace {
namespace fs = std::filesystem;

// A soft ball on a table under a probe that a hand moves; a lid that falls; a second ball stapled to the first.
constexpr const char* kScene = R"(
staples = 2
[[body]]
name = "table"
shape = "table"
triangles = 200
[[body]]
name = "ball"
shape = "sphere"
triangles = 400
size = 0.1
motion = "deformable"
anchor = "shape"
position = [0.0, 0.0, 0.06]
tissue = {youngs_modulus = 2e4}
[[body]]
name = "stone"
shape = "sphere"
triangles = 200
size = 0.04
motion = "free"
position = [0.15, 0.0, 0.05]
[[body]]
name = "probe"
shape = "sphere"
triangles = 100
size = 0.014
motion = "hand"
position = [0.0, 0.0, 0.13]
[[tool]]
body = "probe"
tip_radius = 0.007
path = [{time = 0.0, position = [0.0, 0.0, 0.13]}, {time = 0.5, position = [0.0, 0.0, 0.10]}]
)";

struct Close {
    void operator()(trocar_world* world) const { trocar_close(world); }
    void operator()(trocar_batch* batch) const { trocar_batch_close(batch); }
    void operator()(trocar_collider* collider) const { trocar_collider_close(collider); }
};
template <typename T>
using Owned = std::unique_ptr<T, Close>;

trocar_scene text_scene(const char* text) {
    TROCAR_NEW(trocar_scene, scene);
    scene.text = text;
    return scene;
}

Owned<trocar_world> open_world(const trocar_scene& scene) {
    trocar_world* world = nullptr;
    EXPECT_EQ(trocar_open(&scene, &world), TROCAR_OK) << trocar_last_error();
    return Owned<trocar_world>(world);
}
Owned<trocar_world> open_text(const char* text = kScene) { return open_world(text_scene(text)); }

uint64_t hash_of(const trocar_world* world) {
    uint64_t hash = 0;
    EXPECT_EQ(trocar_hash(world, &hash), TROCAR_OK);
    return hash;
}
uint32_t body_named(const trocar_world* world, const char* name) {
    uint32_t body = TROCAR_NONE;
    EXPECT_EQ(trocar_find(world, TROCAR_BODY, name, &body), TROCAR_OK) << trocar_last_error();
    return body;
}
std::vector<char> saved(const trocar_world* world) {
    size_t length = 0;
    EXPECT_EQ(trocar_save(world, nullptr, 0, &length), TROCAR_TOO_SMALL);
    std::vector<char> bytes(length);
    EXPECT_EQ(trocar_save(world, bytes.data(), bytes.size(), &length), TROCAR_OK) << trocar_last_error();
    return bytes;
}
template <typename T>
T number(trocar_world* world, const char* name) {
    TROCAR_NEW(trocar_view, view);
    EXPECT_EQ(trocar_array(world, name, &view), TROCAR_OK) << trocar_last_error();
    T value{};
    std::memcpy(&value, view.data, sizeof value);
    return value;
}
std::vector<Vec3d> vertices_of(const trocar_world* world, uint32_t body) {
    size_t count = 0;
    trocar_vertices(world, body, nullptr, 0, &count);
    std::vector<Vec3d> all(count);
    EXPECT_EQ(trocar_vertices(world, body, all[0].data(), count, &count), TROCAR_OK);
    return all;
}
void set_target(trocar_world* world, const Vec3d& position, double seconds) {
    TROCAR_NEW(trocar_target, target);
    put(position, target.position);
    target.seconds = seconds, target.grip = -1;
    ASSERT_EQ(trocar_set_target(world, 0, &target), TROCAR_OK) << trocar_last_error();
}

TEST(Interface, AWorldHasTheHashesOfAFrame) {
    const Owned<trocar_world> world = open_text();
    const WrittenScene written("interface", kScene);
    int differ = 0;
    run(written.build().world, 30, [&](Frame& frame, int) {
        EXPECT_EQ(trocar_step(world.get(), 1), TROCAR_OK) << trocar_last_error();
        differ += hash_of(world.get()) != state_hash(frame.world());
    });
    EXPECT_EQ(differ, 0);
    EXPECT_EQ(trocar_time(world.get()), 0.5);
    EXPECT_EQ(trocar_step_until(world.get(), 0.6), TROCAR_OK);
    EXPECT_EQ(trocar_time(world.get()), 0.6);
}

TEST(Interface, ArraysHaveTheBytesOfACapture) {
    const Owned<trocar_world> world = open_text();
    ASSERT_EQ(trocar_step(world.get(), 12), TROCAR_OK);
    const World& w = world->frame.world();
    std::map<std::string, CaptureArray> stored;
    CaptureRecord record;
    for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r) save_resource(w, static_cast<Resource>(r), record);
    for (CaptureArray& a : record.arrays) stored[a.name] = std::move(a);
    const uint32_t count = trocar_array_count(world.get());
    EXPECT_GT(count, 250u);
    for (uint32_t i = 0; i < count; ++i) {
        const char* name = trocar_array_name(world.get(), i);
        TROCAR_NEW(trocar_view, view);
        ASSERT_EQ(trocar_array(world.get(), name, &view), TROCAR_OK) << trocar_last_error();
        ASSERT_TRUE(stored.contains(name)) << name;
        const CaptureArray& a = stored[name];
        const size_t bytes = view.rows * view.columns * element_size(static_cast<ArrayType>(view.type));
        ASSERT_EQ(bytes, a.bytes.size()) << name;
        EXPECT_TRUE(bytes == 0 || std::memcmp(view.data, a.bytes.data(), bytes) == 0) << name;
    }
    // every array that captures store with a type of its own is there
    for (const auto& [name, a] : stored) EXPECT_TRUE(a.type == ArrayType::kU8 || name == "clock.substep" || find_array(w, name)) << name;
    TROCAR_NEW(trocar_view, offset);
    ASSERT_EQ(trocar_array(world.get(), "particles.offset", &offset), TROCAR_OK);
    EXPECT_EQ(offset.columns, 4u);
    EXPECT_STREQ(offset.unit, "m");
    EXPECT_EQ(offset.type, static_cast<uint32_t>(TROCAR_F32));
    EXPECT_EQ(offset.writable, 1u);
    TROCAR_NEW(trocar_view, mesh);
    ASSERT_EQ(trocar_array(world.get(), "bodies.mesh", &mesh), TROCAR_OK);
    EXPECT_STREQ(mesh.unit, "index of meshes");
    EXPECT_EQ(mesh.writable, 0u);
    EXPECT_GT(number<uint64_t>(world.get(), "report.contact_passes"), 10u);
}

TEST(Interface, FixedArraysStayWhereTheyAre) {
    const Owned<trocar_world> world = open_text();
    const auto fixed = [&] {
        std::map<std::string, std::pair<void*, uint64_t>> all;
        for (uint32_t i = 0; i < trocar_array_count(world.get()); ++i) {
            TROCAR_NEW(trocar_view, view);
            trocar_array(world.get(), trocar_array_name(world.get(), i), &view);
            if (view.fixed) all[trocar_array_name(world.get(), i)] = {view.data, view.rows};
        }
        return all;
    };
    const auto before = fixed();
    EXPECT_TRUE(before.contains("particles.offset") && before.contains("poses.origin") && before.contains("meshes.triangle"));
    EXPECT_FALSE(before.contains("contacts.distance"));
    const std::vector<char> state = saved(world.get());
    set_target(world.get(), {0, 0, 0.12}, 0.1);
    ASSERT_EQ(trocar_step(world.get(), 40), TROCAR_OK);
    ASSERT_EQ(trocar_restore(world.get(), state.data(), state.size()), TROCAR_OK) << trocar_last_error();
    ASSERT_EQ(trocar_step(world.get(), 3), TROCAR_OK);
    for (const auto& [name, there] : fixed()) EXPECT_EQ(before.at(name), there) << name;
}

// Scenes with cuts, links, pools and switched nodes besides: every kind of state.
TEST(Interface, ARestoredStateGoesOnAsBefore) {
    for (const char* file : {"kidney_on_liver", "jaw_grasp", "needle_wall", "stress_come_and_go", "dial_and_button"}) {
        TROCAR_NEW(trocar_scene, scene);
        scene.file = file;
        std::vector<std::string> words;
        for (const BodySpec& body : read_scene_file(source_folder() / "content/scenes" / (std::string(file) + ".toml")).bodies)
            if (body.motion == Motion::kDeformable && body.file.empty() && body.scatter.count <= 1)
                words.push_back(body.name + ".triangles=400");
        if (std::string(file) == "stress_come_and_go") words = {};
        std::vector<const char*> set;
        for (const std::string& word : words) set.push_back(word.c_str());
        scene.set = set.data(), scene.set_count = static_cast<uint32_t>(set.size());
        const std::string path = (source_folder() / "content/scenes" / (std::string(file) + ".toml")).string();
        scene.file = path.c_str();
        const Owned<trocar_world> world = open_world(scene);
        ASSERT_TRUE(world);
        const uint64_t start = hash_of(world.get());
        ASSERT_EQ(trocar_step(world.get(), 20), TROCAR_OK);
        const std::vector<char> state = saved(world.get());
        ASSERT_EQ(trocar_step(world.get(), 15), TROCAR_OK);
        const uint64_t hash = hash_of(world.get());
        ASSERT_EQ(trocar_step(world.get(), 5), TROCAR_OK);
        ASSERT_EQ(trocar_restore(world.get(), state.data(), state.size()), TROCAR_OK) << trocar_last_error();
        EXPECT_EQ(saved(world.get()), state) << file;
        ASSERT_EQ(trocar_step(world.get(), 15), TROCAR_OK);
        EXPECT_EQ(hash_of(world.get()), hash) << file;
        ASSERT_EQ(trocar_reset(world.get()), TROCAR_OK);
        EXPECT_EQ(hash_of(world.get()), start) << file;
        ASSERT_EQ(trocar_step(world.get(), 35), TROCAR_OK);
        EXPECT_EQ(hash_of(world.get()), hash) << file;
    }
}

TEST(Interface, RefusesStatesThatAreDamagedOrOfAnotherScene) {
    const Owned<trocar_world> world = open_text();
    const uint64_t hash = hash_of(world.get());
    std::vector<char> state = saved(world.get());
    state[state.size() / 2] ^= 1;
    EXPECT_EQ(trocar_restore(world.get(), state.data(), state.size()), TROCAR_BAD_INPUT);
    EXPECT_STREQ(trocar_last_error(), "the saved state is damaged");
    state[state.size() / 2] ^= 1;
    EXPECT_EQ(trocar_restore(world.get(), state.data(), state.size() - 1), TROCAR_BAD_INPUT);
    EXPECT_EQ(trocar_restore(world.get(), state.data(), 5), TROCAR_BAD_INPUT);
    const char* const set[] = {"ball.tissue.youngs_modulus=3e4"};
    trocar_scene other = text_scene(kScene);
    other.set = set, other.set_count = 1;
    const Owned<trocar_world> stiffer = open_world(other);
    EXPECT_EQ(trocar_restore(stiffer.get(), state.data(), state.size()), TROCAR_BAD_INPUT);
    EXPECT_STREQ(trocar_last_error(), "the saved state is of another scene, or of other overrides");
    EXPECT_EQ(hash_of(world.get()), hash);
}

TEST(Interface, ErrorsSayWhere) {
    setenv("TROCAR_SCENES", (source_folder() / "content/scenes").c_str(), 1);
    trocar_world* world = nullptr;
    trocar_scene scene = text_scene("[[body]]\nname = \"a\"\nshape = 5\n");
    scene.file = "mine.toml";
    EXPECT_EQ(trocar_open(&scene, &world), TROCAR_BAD_INPUT);
    EXPECT_EQ(world, nullptr);
    EXPECT_TRUE(std::string(trocar_last_error()).starts_with("mine.toml:3:9: ")) << trocar_last_error();
    scene = text_scene(nullptr);
    EXPECT_EQ(trocar_open(&scene, &world), TROCAR_BAD_CALL);
    EXPECT_EQ(trocar_open(nullptr, &world), TROCAR_BAD_CALL);
    scene.size = 0;
    EXPECT_EQ(trocar_open(&scene, &world), TROCAR_BAD_CALL);
    scene = text_scene(nullptr);
    scene.file = "palpat";
    EXPECT_EQ(trocar_open(&scene, &world), TROCAR_BAD_INPUT);
    EXPECT_NE(std::string(trocar_last_error()).find("did you mean \"palpate\"?"), std::string::npos) << trocar_last_error();
    const char* const set[] = {"no equal sign"};
    scene = text_scene(kScene);
    scene.set = set, scene.set_count = 1;
    EXPECT_EQ(trocar_open(&scene, &world), TROCAR_BAD_INPUT);
    const Owned<trocar_world> fine = open_text();
    uint32_t index = 0;
    EXPECT_EQ(trocar_find(fine.get(), TROCAR_BODY, "bal", &index), TROCAR_BAD_CALL);
    EXPECT_STREQ(trocar_last_error(), "no body is named \"bal\"; there are table, ball, stone, probe");
    TROCAR_NEW(trocar_view, view);
    EXPECT_EQ(trocar_array(fine.get(), "particles.offsets", &view), TROCAR_BAD_CALL);
    TROCAR_NEW(trocar_tool, tool);
    EXPECT_EQ(trocar_get_tool(fine.get(), 1, &tool), TROCAR_BAD_CALL);
    EXPECT_STREQ(trocar_last_error(), "tool 1 of 1");
    EXPECT_EQ(trocar_step(nullptr, 1), TROCAR_BAD_CALL);
    EXPECT_EQ(trocar_step_until(fine.get(), NAN), TROCAR_BAD_INPUT);
    const double point[3] = {0, NAN, 0};
    trocar_nearest nearest;
    EXPECT_EQ(trocar_distance(fine.get(), 0, point, 1, &nearest), TROCAR_BAD_INPUT);
    EXPECT_EQ(trocar_step(fine.get(), 0), TROCAR_OK);
    EXPECT_STREQ(trocar_last_error(), "");
}

// A program with an older header has shorter structs, one with a newer header longer ones.
TEST(Interface, StructsMayBeShorterOrLonger) {
    const Owned<trocar_world> world = open_text();
    struct Longer {
        trocar_body now;
        uint64_t later;
    } longer{};
    longer.now.size = sizeof longer, longer.later = 77;
    EXPECT_EQ(trocar_get_body(world.get(), 1, &longer.now), TROCAR_OK);
    EXPECT_EQ(longer.now.size, sizeof longer);
    EXPECT_EQ(longer.later, 77u);
    EXPECT_GT(longer.now.mass, 0.1);
    TROCAR_NEW(trocar_body, shorter);
    shorter.size = offsetof(trocar_body, particles), shorter.particles = 99;
    EXPECT_EQ(trocar_get_body(world.get(), 1, &shorter), TROCAR_OK);
    EXPECT_EQ(shorter.first_particle, longer.now.first_particle);
    EXPECT_EQ(shorter.particles, 99u);
}

TEST(Interface, ToolsGoWhereTheyAreTold) {
    const Owned<trocar_world> world = open_text();
    set_target(world.get(), {0.05, 0, 0.15}, 0.25);
    ASSERT_EQ(trocar_step_until(world.get(), 0.125), TROCAR_OK);
    TROCAR_NEW(trocar_tool, tool);
    ASSERT_EQ(trocar_get_tool(world.get(), 0, &tool), TROCAR_OK);
    // the state is of the last tick of the pass, a millisecond before its end
    const double share = (trocar_time(world.get()) - 1e-3) / 0.25;
    EXPECT_NEAR(tool.device[0], 0.05 * share, 1e-12);
    EXPECT_NEAR(tool.device[2], 0.13 + 0.02 * share, 1e-12);
    ASSERT_EQ(trocar_step_until(world.get(), 0.5), TROCAR_OK);
    ASSERT_EQ(trocar_get_tool(world.get(), 0, &tool), TROCAR_OK);
    EXPECT_EQ(tool.device[0], 0.05);
    EXPECT_EQ(tool.device[2], 0.15);
    // press on the ball: the hand feels it
    set_target(world.get(), {0, 0, 0.1}, 0.2);
    ASSERT_EQ(trocar_step_until(world.get(), 1), TROCAR_OK);
    ASSERT_EQ(trocar_get_tool(world.get(), 0, &tool), TROCAR_OK);
    EXPECT_GT(tool.force[2], 0.05);
    EXPECT_EQ(tool.touched, body_named(world.get(), "ball"));
    TROCAR_NEW(trocar_target, target);
    target.position[0] = 1;
    EXPECT_EQ(trocar_set_target(world.get(), 0, &target), TROCAR_BAD_INPUT);
    EXPECT_NE(std::string(trocar_last_error()).find("faster than a hand moves"), std::string::npos);
}

// A tool that is told to be where its script leads, millisecond by millisecond at the same places, changes nothing.
TEST(Interface, ATargetIsTheSameAsAScriptOfIt) {
    const std::string held = std::string(kScene).replace(std::string(kScene).find("path = "), std::string::npos,
                                                         "path = [{time = 0.0, position = [0.0, 0.0, 0.103]}]\n");
    const Owned<trocar_world> scripted = open_text(held.c_str()), told = open_text(held.c_str());
    set_target(told.get(), {0, 0, 0.103}, 0);
    ASSERT_EQ(trocar_step(scripted.get(), 20), TROCAR_OK);
    ASSERT_EQ(trocar_step(told.get(), 20), TROCAR_OK);
    EXPECT_EQ(hash_of(told.get()), hash_of(scripted.get()));
    ASSERT_EQ(trocar_release_tool(told.get(), 0), TROCAR_OK);
    ASSERT_EQ(trocar_step(scripted.get(), 10), TROCAR_OK);
    ASSERT_EQ(trocar_step(told.get(), 10), TROCAR_OK);
    EXPECT_EQ(hash_of(told.get()), hash_of(scripted.get()));
}

TEST(Interface, ARecordingIsACaptureThatReplays) {
    const fs::path file = fs::temp_directory_path() / ("trocar_interface_" + std::to_string(getpid()) + ".cap");
    const Owned<trocar_world> world = open_text();
    ASSERT_EQ(trocar_step(world.get(), 3), TROCAR_OK);
    ASSERT_EQ(trocar_record(world.get(), file.c_str()), TROCAR_OK) << trocar_last_error();
    ASSERT_EQ(trocar_step(world.get(), 5), TROCAR_OK);
    set_target(world.get(), {0, 0, 0.108}, 0.1);  // out of its script in the middle
    ASSERT_EQ(trocar_step(world.get(), 9), TROCAR_OK);
    ASSERT_EQ(trocar_record(world.get(), nullptr), TROCAR_OK) << trocar_last_error();
    const Capture capture = open_capture(file);
    EXPECT_EQ(capture.passes(), 14u);
    const ReplayVerdict verdict = replay_capture(capture, {});
    EXPECT_EQ(verdict.difference, "");
    EXPECT_EQ(verdict.compared, 14u);
    fs::remove(file);
    EXPECT_EQ(trocar_record(world.get(), "/nowhere/at/all.cap"), TROCAR_BAD_INPUT);
}

TEST(Interface, DistancesAreThoseOfBruteForce) {
    const Owned<trocar_world> world = open_text();
    ASSERT_EQ(trocar_step(world.get(), 25), TROCAR_OK);
    for (const char* name : {"ball", "stone"}) {
        const uint32_t body = body_named(world.get(), name);
        const std::vector<Vec3d> position = vertices_of(world.get(), body);
        size_t count = 0;
        trocar_triangles(world.get(), body, nullptr, 0, &count);
        std::vector<Triangle> triangle(count);
        ASSERT_EQ(trocar_triangles(world.get(), body, triangle[0].data(), count, &count), TROCAR_OK);
        std::vector<double> points;
        TROCAR_NEW(trocar_body, info);
        trocar_get_body(world.get(), body, &info);
        for (int i = 0; i < 60; ++i)
            for (int k = 0; k < 3; ++k) points.push_back(info.origin[k] + 0.06 * (i % 7 / 6.0) * std::sin(1.7 * i + 2.1 * k));
        std::vector<trocar_nearest> nearest(points.size() / 3);
        ASSERT_EQ(trocar_distance(world.get(), body, points.data(), nearest.size(), nearest.data()), TROCAR_OK) << trocar_last_error();
        int inside = 0;
        for (size_t i = 0; i < nearest.size(); ++i) {
            const Vec3d p = vector_at(&points[3 * i]);
            const BruteForceAnswer truth = brute_force_distance(position, triangle, p);
            inside += truth.winding > 0.5;
            EXPECT_NEAR(nearest[i].distance, truth.winding > 0.5 ? -truth.distance : truth.distance, 1e-15);
            EXPECT_NEAR((vector_at(nearest[i].point) - p).norm(), truth.distance, 1e-15);
        }
        EXPECT_GT(inside, 3);
    }
}

TEST(Interface, APushGivesItsImpulse) {
    const Owned<trocar_world> world = open_text();
    const World& w = world->frame.world();
    const Vec3d j(0.01, -0.02, 0.03);
    for (const char* name : {"ball", "stone"}) {
        const uint32_t body = body_named(world.get(), name);
        TROCAR_NEW(trocar_body, info);
        trocar_get_body(world.get(), body, &info);
        const auto momentum = [&] {
            Vec3d sum = Vec3d::Zero();
            if (const RigidMass* free = find_rigid_mass(w.bodies, body)) {
                const Vec3d arm = rotate(w.poses.orientation[body], free->centre);
                return Vec3d(free->mass * (w.poses.velocity[body] + w.poses.angular_velocity[body].cross(arm)));
            }
            for (uint32_t p = info.first_particle; p < info.first_particle + info.particles; ++p)
                if (w.particles.offset[p].w > 0)
                    sum += Vec3d(w.particles.velocity_x[p], w.particles.velocity_y[p], w.particles.velocity_z[p]) / w.particles.offset[p].w;
            return sum;
        };
        const Vec3d before = momentum(), at = vector_at(info.origin) + Vec3d(0.01, 0.02, 0.005);
        const double work = w.energy.work_hand;
        ASSERT_EQ(trocar_push(world.get(), body, at.data(), j.data()), TROCAR_OK) << trocar_last_error();
        EXPECT_LT((momentum() - before - j).norm(), 1e-8) << name;
        // from rest, a free body takes J^2 / 2m + (r x J) I^-1 (r x J) / 2 of energy
        if (const RigidMass* free = find_rigid_mass(w.bodies, body)) {
            const Vec3d lever = at - vector_at(info.origin) - free->centre, torque = rotate_back(free->axes, lever.cross(j));
            EXPECT_NEAR(w.energy.work_hand - work,
                        0.5 * j.squaredNorm() / free->mass + 0.5 * torque.dot(torque.cwiseQuotient(free->moments)), 1e-12);
        }
    }
    const double origin[3] = {0, 0, 0};
    EXPECT_EQ(trocar_push(world.get(), body_named(world.get(), "table"), origin, j.data()), TROCAR_BAD_CALL);
    ASSERT_EQ(trocar_step(world.get(), 30), TROCAR_OK);
    EXPECT_LT(std::abs(w.energy.balance), 0.02 * w.energy.work_hand);
}

TEST(Interface, StaplesHoldAndGo) {
    const std::string two = std::string(kScene) + R"(
[[body]]
name = "other"
shape = "sphere"
triangles = 400
size = 0.1
motion = "deformable"
anchor = "shape"
position = [0.0, 0.101, 0.06]
tissue = {youngs_modulus = 2e4}
)";
    const Owned<trocar_world> world = open_text(two.c_str());
    TROCAR_NEW(trocar_staple, staple);
    staple.a = body_named(world.get(), "ball"), staple.b = body_named(world.get(), "other");
    staple.position[1] = 0.05, staple.position[2] = 0.06, staple.stiffness = 200;
    uint32_t link = TROCAR_NONE, second = TROCAR_NONE;
    ASSERT_EQ(trocar_add_staple(world.get(), &staple, &link), TROCAR_OK) << trocar_last_error();
    const Vec3d away(0, 0.05, 0);
    const double at[3] = {0, 0.15, 0.06};
    ASSERT_EQ(trocar_push(world.get(), staple.b, at, away.data()), TROCAR_OK);
    ASSERT_EQ(trocar_step(world.get(), 10), TROCAR_OK);
    TROCAR_NEW(trocar_link, state);
    ASSERT_EQ(trocar_get_link(world.get(), link, &state), TROCAR_OK);
    EXPECT_EQ(state.holding, 1u);
    EXPECT_GT(state.largest_force, 0.01);
    staple.position[2] = 0.5;
    EXPECT_EQ(trocar_add_staple(world.get(), &staple, &second), TROCAR_BAD_INPUT);
    staple.stiffness = -1;
    EXPECT_EQ(trocar_add_staple(world.get(), &staple, &second), TROCAR_BAD_INPUT);
    ASSERT_EQ(trocar_remove_link(world.get(), link), TROCAR_OK) << trocar_last_error();
    EXPECT_EQ(trocar_remove_link(world.get(), link), TROCAR_BAD_CALL);
    ASSERT_EQ(trocar_step(world.get(), 2), TROCAR_OK);
    const std::string bare = two.substr(two.find("[[body]]"));
    const Owned<trocar_world> without = open_text(bare.c_str());
    staple.stiffness = 200, staple.position[2] = 0.06;
    EXPECT_EQ(trocar_add_staple(without.get(), &staple, &link), TROCAR_BAD_CALL);
}

TEST(Interface, PicturesShowTheBodies) {
    const Owned<trocar_world> world = open_text();
    TROCAR_NEW(trocar_picture, asked);
    asked.width = 160, asked.height = 120, asked.plain = 1;
    std::vector<uint8_t> rgb(3 * 160 * 120), again(rgb.size());
    size_t length = 0;
    EXPECT_EQ(trocar_draw(world.get(), &asked, nullptr, 0, &length), TROCAR_TOO_SMALL);
    EXPECT_EQ(length, rgb.size());
    ASSERT_EQ(trocar_draw(world.get(), &asked, rgb.data(), rgb.size(), &length), TROCAR_OK) << trocar_last_error();
    ASSERT_EQ(trocar_draw(world.get(), &asked, again.data(), again.size(), &length), TROCAR_OK);
    EXPECT_EQ(rgb, again);
    const auto [least, most] = std::minmax_element(rgb.begin(), rgb.end());
    EXPECT_GT(*most - *least, 60);
    asked.own_camera = 1, asked.azimuth = 2, asked.elevation = 0.2;
    ASSERT_EQ(trocar_draw(world.get(), &asked, again.data(), again.size(), &length), TROCAR_OK);
    EXPECT_NE(rgb, again);
    const uint64_t hash = hash_of(world.get());
    ASSERT_EQ(trocar_draw(world.get(), &asked, again.data(), again.size(), &length), TROCAR_OK);
    EXPECT_EQ(hash_of(world.get()), hash);
}

TEST(Interface, ABatchHasTheHashesOfSingleWorlds) {
    constexpr uint32_t kWorlds = 5;
    const trocar_scene scene = text_scene(kScene);
    trocar_batch* raw = nullptr;
    ASSERT_EQ(trocar_batch_open(&scene, kWorlds, 2, &raw), TROCAR_OK) << trocar_last_error();
    const Owned<trocar_batch> batch(raw);
    ASSERT_EQ(trocar_batch_count(batch.get()), kWorlds);
    std::vector<Owned<trocar_world>> single;
    const auto lend = [&](uint32_t i) {
        trocar_world* world = nullptr;
        EXPECT_EQ(trocar_batch_world(batch.get(), i, &world), TROCAR_OK) << trocar_last_error();
        return world;
    };
    for (uint32_t i = 0; i < kWorlds; ++i) {
        single.push_back(open_text());
        if (i == 0) continue;  // one follows its script
        const Vec3d to(0.002 * i, 0, 0.108 - 0.003 * i);
        set_target(single[i].get(), to, 0.2), set_target(lend(i), to, 0.2);
    }
    ASSERT_EQ(trocar_batch_keep(batch.get(), "contacts.distance"), TROCAR_OK);
    EXPECT_EQ(trocar_batch_keep(batch.get(), "contacts.nothing"), TROCAR_BAD_CALL);
    for (const uint32_t passes : {1u, 7u, 1u, 1u, 12u}) {
        ASSERT_EQ(trocar_batch_step(batch.get(), passes), TROCAR_OK) << trocar_last_error();
        for (uint32_t i = 0; i < kWorlds; ++i) {
            ASSERT_EQ(trocar_step(single[i].get(), passes), TROCAR_OK);
            TROCAR_NEW(trocar_view, kept);
            TROCAR_NEW(trocar_view, own);
            ASSERT_EQ(trocar_batch_array(batch.get(), i, "contacts.distance", &kept), TROCAR_OK) << trocar_last_error();
            ASSERT_EQ(trocar_array(single[i].get(), "contacts.distance", &own), TROCAR_OK);
            ASSERT_EQ(kept.rows, own.rows);
            EXPECT_TRUE(own.rows == 0 || std::memcmp(kept.data, own.data, own.rows * sizeof(double)) == 0);
            EXPECT_TRUE(passes == 1 || hash_of(lend(i)) == hash_of(single[i].get())) << i;
        }
    }
    for (uint32_t i = 0; i < kWorlds; ++i) EXPECT_EQ(hash_of(lend(i)), hash_of(single[i].get())) << i;
    std::set<uint64_t> different;
    for (const auto& world : single) different.insert(hash_of(world.get()));
    EXPECT_EQ(different.size(), kWorlds);
    EXPECT_EQ(trocar_step(lend(0), 1), TROCAR_BAD_CALL);
    ASSERT_EQ(trocar_reset(lend(2)), TROCAR_OK);
    EXPECT_EQ(trocar_time(lend(2)), 0);
    EXPECT_GT(trocar_time(lend(3)), 0.3);
    uint64_t each = 0, shared = 0;
    ASSERT_EQ(trocar_batch_memory(batch.get(), &each, &shared), TROCAR_OK);
    EXPECT_LT(static_cast<double>(each), 1.2 * static_cast<double>(saved(lend(2)).size()));
}

// Two shapes at a pose, as `trocar collide` has them from files.
struct TwoMeshes {
    std::array<Mesh, 2> mesh;
    std::array<trocar_mesh, 2> given{};
    explicit TwoMeshes(const Vec3d& move) : mesh(shapes()) {
        for (Vec3d& p : mesh[1].position) p += move;
        for (size_t i = 0; i < 2; ++i) {
            given[i] = {sizeof(trocar_mesh),
                        static_cast<uint32_t>(mesh[i].position.size()),
                        static_cast<uint32_t>(mesh[i].triangle.size()),
                        0,
                        mesh[i].position[0].data(),
                        mesh[i].triangle[0].data()};
        }
    }
    static const std::array<Mesh, 2>& shapes() {  // they take seconds to make
        static const std::array<Mesh, 2> made{make_shape("liver", 600, 1, Looks::kPlain), make_shape("kidney", 500, 1, Looks::kPlain)};
        return made;
    }
    Owned<trocar_collider> open() const {
        trocar_collider* collider = nullptr;
        EXPECT_EQ(trocar_collider_open(given.data(), 2, nullptr, &collider), TROCAR_OK) << trocar_last_error();
        return Owned<trocar_collider>(collider);
    }
};

trocar_pair only_pair(const Owned<trocar_collider>& collider) {
    EXPECT_EQ(trocar_collider_find(collider.get()), TROCAR_OK) << trocar_last_error();
    trocar_pair pair{};
    size_t count = 0;
    EXPECT_EQ(trocar_collider_pairs(collider.get(), &pair, 1, &count), TROCAR_OK) << trocar_last_error();
    return pair;
}

TEST(Collider, HasTheBitsOfCollide) {
    const fs::path folder = fs::temp_directory_path() / ("trocar_collider_" + std::to_string(getpid()));
    fs::create_directories(folder);
    for (const Vec3d& move : {Vec3d(0.02, 0.01, 0.03), Vec3d(0.01, 0, 0), Vec3d(0.11, 0.05, 0)}) {
        const TwoMeshes two(move);
        save_mesh(two.mesh[0], folder / "a.obj"), save_mesh(two.mesh[1], folder / "b.obj");
        const Outcome said = run_program("collide a.obj b.obj --json", folder, folder);
        ASSERT_EQ(said.code, 0) << said.err;
        const auto truth = nlohmann::json::parse(said.out);
        const Owned<trocar_collider> collider = two.open();
        const trocar_pair pair = only_pair(collider);
        EXPECT_EQ(pair.overlap == 1, truth["overlap"].get<bool>());
        EXPECT_EQ(pair.depth, truth["depth"].get<double>());
        EXPECT_EQ(pair.surface_depth, truth["surface_depth"].get<double>());
        EXPECT_EQ(pair.a_in_b, truth["vertices_a_in_b"].get<uint32_t>());
        EXPECT_EQ(pair.b_in_a, truth["vertices_b_in_a"].get<uint32_t>());
        for (int k = 0; pair.overlap && k < 3; ++k) EXPECT_EQ(pair.direction[k], truth["direction"][k].get<double>());
        size_t count = 0;
        trocar_collider_regions(collider.get(), nullptr, 0, &count);
        std::vector<trocar_region> regions(count);
        trocar_collider_regions(collider.get(), regions.data(), count, &count);
        ASSERT_EQ(regions.size(), truth["regions"].size());
        std::ranges::stable_sort(regions, std::greater{}, &trocar_region::depth);
        for (size_t r = 0; r < regions.size(); ++r) {
            EXPECT_EQ(regions[r].depth, truth["regions"][r]["depth"].get<double>());
            EXPECT_EQ(regions[r].a_in_b, truth["regions"][r]["vertices_a"].get<uint32_t>());
            EXPECT_NEAR(regions[r].volume, truth["regions"][r]["volume"].get<double>(), 1e-18);
        }
        trocar_collider_contacts(collider.get(), nullptr, 0, &count);
        std::vector<trocar_contact> contacts(count);
        trocar_collider_contacts(collider.get(), contacts.data(), count, &count);
        double deepest = 0;
        for (const trocar_contact& c : contacts) deepest = std::max(deepest, -c.distance);
        EXPECT_TRUE(!pair.overlap || deepest == pair.depth);
    }
    fs::remove_all(folder);
}

// A mesh moved vertex by vertex is found as if it had been given there.
TEST(Collider, ADeformedMeshIsThatOfItsPlaces) {
    const TwoMeshes start(Vec3d(0.3, 0, 0));
    const Owned<trocar_collider> collider = start.open();
    EXPECT_EQ(only_pair(collider).overlap, 0u);
    for (int step = 0; step < 4; ++step) {
        TwoMeshes there(Vec3d(0.05 - 0.01 * step, 0, 0.03));
        for (Vec3d& p : there.mesh[1].position) p.z() *= 1 + 0.1 * step + 0.5 * p.x();
        for (Vec3d& p : there.mesh[0].position) p.x() += 0.02 * step * p.y();
        for (uint32_t i = 0; i < 2; ++i)
            ASSERT_EQ(trocar_collider_move(collider.get(), i, there.mesh[i].position[0].data()), TROCAR_OK) << trocar_last_error();
        const Owned<trocar_collider> fresh = there.open();
        const trocar_pair moved = only_pair(collider), given = only_pair(fresh);
        EXPECT_EQ(given.overlap, 1u);
        EXPECT_EQ(std::memcmp(&moved, &given, sizeof moved), 0) << step;
    }
}

TEST(Collider, FindsAllPairsOfMany) {
    const Mesh ball = make_shape("sphere", 200);
    std::array<std::vector<Vec3d>, 4> places;
    std::array<trocar_mesh, 4> given{};
    const double size = 2 * ball.position[0].norm();
    for (size_t i = 0; i < 4; ++i) {
        places[i] = ball.position;
        for (Vec3d& p : places[i]) p.x() += 0.9 * size * static_cast<double>(i);
        given[i] = {sizeof(trocar_mesh),
                    static_cast<uint32_t>(ball.position.size()),
                    static_cast<uint32_t>(ball.triangle.size()),
                    0,
                    places[i][0].data(),
                    ball.triangle[0].data()};
    }
    trocar_collider* raw = nullptr;
    ASSERT_EQ(trocar_collider_open(given.data(), 4, nullptr, &raw), TROCAR_OK) << trocar_last_error();
    const Owned<trocar_collider> collider(raw);
    ASSERT_EQ(trocar_collider_find(raw), TROCAR_OK);
    std::array<trocar_pair, 6> pair{};
    size_t count = 0;
    ASSERT_EQ(trocar_collider_pairs(raw, pair.data(), pair.size(), &count), TROCAR_OK);
    size_t overlapping = 0;
    for (size_t i = 0; i < count; ++i) {
        EXPECT_EQ(pair[i].overlap, pair[i].b == pair[i].a + 1 ? 1u : 0u);
        overlapping += pair[i].overlap;
    }
    EXPECT_EQ(overlapping, 3u);
}

TEST(Collider, RefusesWhatIsNoMesh) {
    TwoMeshes two(Vec3d::Zero());
    trocar_collider* collider = nullptr;
    two.mesh[1].triangle[17][2] = 1u << 20;
    EXPECT_EQ(trocar_collider_open(two.given.data(), 2, nullptr, &collider), TROCAR_BAD_INPUT);
    EXPECT_TRUE(std::string(trocar_last_error()).starts_with("mesh 1, triangle 17: vertex 1048576 of ")) << trocar_last_error();
    two.mesh[1].triangle[17][2] = two.mesh[1].triangle[17][0];
    EXPECT_EQ(trocar_collider_open(two.given.data(), 2, nullptr, &collider), TROCAR_BAD_INPUT);
    EXPECT_EQ(trocar_collider_open(two.given.data(), 1, nullptr, &collider), TROCAR_BAD_CALL);
    two.given[1].xyz = nullptr;
    EXPECT_EQ(trocar_collider_open(two.given.data(), 2, nullptr, &collider), TROCAR_BAD_CALL);
    EXPECT_EQ(collider, nullptr);
    const TwoMeshes fine(Vec3d::Zero());
    const Owned<trocar_collider> open = fine.open();
    std::vector<Vec3d> bad = fine.mesh[0].position;
    bad[3].y() = INFINITY;
    EXPECT_EQ(trocar_collider_move(open.get(), 0, bad[0].data()), TROCAR_BAD_INPUT);
    EXPECT_STREQ(trocar_last_error(), "mesh 0, vertex 3: not finite, or beyond 1e30");
    EXPECT_EQ(trocar_collider_move(open.get(), 2, bad[0].data()), TROCAR_BAD_CALL);
    trocar_admission admission = TROCAR_SHEET;
    EXPECT_EQ(trocar_collider_admission(open.get(), 0, &admission), TROCAR_OK);
    EXPECT_EQ(admission, TROCAR_SOLID);
}

}  // namespace
}  // namespace trocar
