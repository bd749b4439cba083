#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <random>

#include "content/scene/build_scene.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/mesh/surfaces.hpp"
#include "systems/detect/broad/rounds.hpp"
#include "systems/frame/frame.hpp"

// What slides without friction over a smooth surface feels nothing of its triangles. Oracle: x = v t + a t^2 / 2.
namespace {
using namespace trocar;

enum class Cut { kRegular, kRandom, kNeedles, kFans };

// Closed body in an OBJ file: a surface of 600 x 200 mm, cut into triangles in some way, sides and a bottom. Its volume's centroid
// becomes the body's origin, so `middle` says where that is in the file.
struct Plate {
    std::filesystem::path path;
    Vec3d middle = Vec3d::Zero();

    Plate(Cut cut, int along, int across, uint32_t seed, const std::function<double(double)>& height) {
        std::mt19937 random(seed);
        const auto uniform = [&](double low, double high) { return std::uniform_real_distribution(low, high)(random); };
        std::vector<Vec3d> p;
        std::vector<Triangle> t;
        const auto at = [&](int i, int k) { return uint32_t(i * (across + 1) + k); };
        for (int i = 0; i <= along; ++i)
            for (int k = 0; k <= across; ++k) {
                const bool inner = i > 0 && i < along && k > 0 && k < across;
                const double off = cut == Cut::kRandom && inner ? 0.38 : 0;
                const double x = i + (cut == Cut::kNeedles && inner ? uniform(-0.48, 0.48) : uniform(-off, off)),
                             y = k + uniform(-off, off);
                p.emplace_back(-0.1 + 0.6 * x / along, 0.2 * y / across - 0.1, 0);
            }
        const auto area = [&](const Triangle& q) { return (p[q[1]] - p[q[0]]).cross(p[q[2]] - p[q[0]]).z(); };
        for (int i = 0; i < along; ++i)
            for (int k = 0; k < across; ++k) {
                const uint32_t a = at(i, k), b = at(i + 1, k), c = at(i + 1, k + 1), d = at(i, k + 1);
                if (cut == Cut::kFans) {
                    const uint32_t middle_of = uint32_t(p.size());
                    p.emplace_back(-0.1 + 0.6 * (i + uniform(0.2, 0.8)) / along, 0.2 * (k + uniform(0.2, 0.8)) / across - 0.1, 0);
                    for (const auto& [v, w] : {std::pair(a, b), {b, c}, {c, d}, {d, a}}) t.push_back({v, w, middle_of});
                    continue;
                }
                std::array<Triangle, 2> one{Triangle{a, b, c}, {a, c, d}}, other{Triangle{a, b, d}, {b, c, d}};
                if (cut != Cut::kRegular && uniform(0, 1) < 0.5) std::swap(one, other);
                if (std::min(area(one[0]), area(one[1])) <= 0) std::swap(one, other);
                t.insert(t.end(), one.begin(), one.end());
            }
        for (Vec3d& q : p) q.z() = height(q.y());
        close(at, along, across, p, t);
        path = std::filesystem::temp_directory_path() / ("trocar_plate_" + std::to_string(getpid()) + ".obj");
        std::ofstream file(path);
        file.precision(9);
        for (const Vec3d& q : p) file << "v " << q.x() << ' ' << q.y() << ' ' << q.z() << '\n';
        for (const Triangle& q : t) file << "f " << q[0] + 1 << ' ' << q[1] + 1 << ' ' << q[2] + 1 << '\n';
    }
    ~Plate() { std::filesystem::remove(path); }

 private:
    template <typename At>
    void close(const At& at, int along, int across, std::vector<Vec3d>& p, std::vector<Triangle>& t) {
        std::vector<uint32_t> rim;
        for (int i = 0; i < along; ++i) rim.push_back(at(i, 0));
        for (int k = 0; k < across; ++k) rim.push_back(at(along, k));
        for (int i = along; i > 0; --i) rim.push_back(at(i, across));
        for (int k = across; k > 0; --k) rim.push_back(at(0, k));
        const uint32_t below = uint32_t(p.size()), count = uint32_t(rim.size());
        for (const uint32_t v : rim) p.emplace_back(p[v].x(), p[v].y(), -0.06);
        p.emplace_back(0.2, 0, -0.06);
        for (uint32_t k = 0; k < count; ++k) {
            const uint32_t u = rim[k], v = rim[(k + 1) % count], low_u = below + k, low_v = below + (k + 1) % count;
            t.insert(t.end(), {{u, low_u, low_v}, {u, low_v, v}, {low_u, below + count, low_v}});
        }
        double volume = 0;
        for (const Triangle& q : t) {
            const double six = p[q[0]].dot(p[q[1]].cross(p[q[2]]));
            volume += six;
            middle += six * (p[q[0]] + p[q[1]] + p[q[2]]) / 4;
        }
        middle /= volume;
    }
};

struct Slide {
    BodySpec body;
    double rate = 60, speed = 0, pull = 0, seconds = 0.4;
};

// Where the mean vertex of the sliding body ends, from the start of its origin.
Vec3d slide(const Plate& plate, const Slide& s) {
    SceneFile scene;
    scene.contact_rate = uint32_t(s.rate);
    scene.settings.gravity = {s.pull, 0, -9.81};
    BodySpec ground;
    ground.name = "ground";
    ground.file = plate.path.string();
    ground.position = plate.middle;
    ground.tissue.friction = 0;
    scene.bodies = {ground, s.body};
    scene.bodies[1].velocity = {s.speed, 0, 0};
    Vec3d mean = Vec3d::Zero();
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(build_scene(scene, Looks::kPlain).world), {});
        for (int pass = 0; pass < std::lround(s.seconds * s.rate); ++pass) frame.step();
        const uint32_t count = frame.world().meshes.info[frame.world().bodies.mesh[1]].vertices.count;
        for (uint32_t v = 0; v < count; ++v) mean += vertex_position(surfaces_of(frame.world()), 1, v) / count;
    });
    return mean - s.body.position;
}

BodySpec slider(const std::string& shape, uint32_t triangles, Motion motion, double size = 0.04) {
    BodySpec b;
    b.name = "slider";
    b.shape = shape;
    b.triangles = triangles;
    b.motion = motion;
    b.size = size;
    b.position = {0, 0, 0.5 * size + (motion == Motion::kFree ? 0 : 1e-4)};
    b.tissue.friction = 0;
    b.tissue.density = 1000;
    b.tissue.damping = motion == Motion::kFree ? 0 : 20;
    if (motion == Motion::kDeformable) b.anchor_frame = AnchorFrame::kShape, b.tissue.youngs_modulus = 50e3, b.tissue.depth = 0.02;
    return b;
}

constexpr Cut kCuts[] = {Cut::kRegular, Cut::kRandom, Cut::kNeedles, Cut::kFans};
double flat(double) { return 0; }

// Breaks when a vertex or edge in the flat of the plate acts as one (half of the speed is lost, 64 mm of drift), or when a
// constraint ends at its triangle although the plane goes on (the body sinks by half a millimetre).
TEST(Sliding, FreeBodiesOnFlatPlates) {
    for (const Cut cut : kCuts)
        for (const auto& [along, across] : {std::pair(60, 20), {150, 50}}) {
            if (along == 150 && cut != Cut::kRandom) continue;
            const Plate plate(cut, along, across, 7 + along, flat);
            for (const char* shape : {"sphere", "box"})
                for (const double rate : {60.0, 240.0}) {
                    const Vec3d end = slide(plate, {slider(shape, shape[0] == 's' ? 500 : 12, Motion::kFree), rate, 1});
                    EXPECT_NEAR(end.x(), 0.4, 0.4e-3) << shape << ' ' << int(cut) << ' ' << along << ' ' << rate;
                    EXPECT_NEAR(end.y(), 0, 0.4e-3) << shape << ' ' << int(cut) << ' ' << along << ' ' << rate;
                    EXPECT_NEAR(end.z(), 0, 1e-5) << shape << ' ' << int(cut) << ' ' << along << ' ' << rate;
                }
        }
}

TEST(Sliding, SoftBodiesOnFlatPlates) {
    for (const Cut cut : kCuts) {
        const Plate plate(cut, 60, 20, 3, flat);
        for (const char* shape : {"sphere", "box"})
            for (const double rate : {60.0, 240.0}) {
                const Vec3d end = slide(plate, {slider(shape, shape[0] == 's' ? 500 : 200, Motion::kDeformable), rate, 0, 1, 0.8});
                EXPECT_NEAR(end.x(), 0.32, 0.32e-3) << shape << ' ' << int(cut) << ' ' << rate;
                EXPECT_NEAR(end.y(), 0, 0.32e-3) << shape << ' ' << int(cut) << ' ' << rate;
            }
    }
}

// A ball in a trough of twice and a half its radius: what is left are the facets themselves.
TEST(Sliding, AlongATrough) {
    const auto height = [](double y) { return 0.1 - std::sqrt(0.01 - std::min(y * y, 0.0036)); };
    for (const auto& [along, across] : {std::pair(60, 30), {150, 60}}) {
        const Plate plate(Cut::kRandom, along, across, 5, height);
        for (const double rate : {120.0, 240.0}) {
            const Vec3d end = slide(plate, {slider("sphere", 2000, Motion::kFree, 0.08), rate, 1});
            EXPECT_NEAR(end.x(), 0.4, 4e-3) << along << ' ' << rate;
            EXPECT_NEAR(end.y(), 0, 4e-3) << along << ' ' << rate;
        }
    }
}

// Largest overlap that any round of any pass finds, m.
double deepest_overlap(const SceneFile& scene, double seconds) {
    double deepest = 0;
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(build_scene(scene, Looks::kPlain).world), {});
        for (int pass = 0; pass < std::lround(seconds * scene.contact_rate); ++pass) {
            frame.step();
            deepest = std::max(deepest, frame.times().deepest);
        }
    });
    return deepest;
}

BodySpec still_body(const std::string& shape, double size, uint32_t triangles, double height) {
    BodySpec b;
    b.name = shape + "_at_rest", b.shape = shape, b.size = size, b.triangles = triangles, b.position = {0, 0, height};
    return b;
}

BodySpec thrown_box(double size, std::mt19937& random) {
    const auto uniform = [&](double low, double high) { return std::uniform_real_distribution(low, high)(random); };
    BodySpec box;
    box.shape = "box", box.size = size, box.triangles = 12, box.motion = Motion::kFree;
    box.orientation = from_rotation_vector(Vec3d(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)));
    box.tissue.damping = 0;
    return box;
}

// Boxes dropped onto the rim of a block, some of them spinning, topple and slam down on its edges with others than those they rest
// on. Breaks when contacts are found only once in a pass (half a millimetre, a third of the runs).
TEST(Slamming, BoxesOnEdges) {
    std::mt19937 random(11);
    const auto uniform = [&](double low, double high) { return std::uniform_real_distribution(low, high)(random); };
    for (int run = 0; run < 40; ++run) {
        SceneFile scene;
        scene.contact_rate = std::array{60, 120, 30}[run % 3];
        BodySpec box = thrown_box(uniform(0.02, 0.08), random);
        box.name = "box";
        box.position = {uniform(-0.06, 0.06), uniform(-0.06, 0.06), uniform(0.17, 0.22)};
        if (run >= 24) box.spin = {uniform(-6, 6), uniform(-6, 6), uniform(-6, 6)};
        scene.bodies = {still_body("table", 0.5, 400, -0.01), still_body("box", 0.1, 12, 0.05), box};
        EXPECT_LT(deepest_overlap(scene, 1), 1e-4) << run;
    }
}

// A heap of boxes that falls on a table and on each other, at 60 Hz. Breaks in the same way: 7 to 13 % of a box.
TEST(Slamming, HeapsOfBoxes) {
    for (const unsigned seed : {1u, 2u, 3u}) {
        std::mt19937 random(seed);
        SceneFile scene;
        scene.bodies = {still_body("table", 2, 400, -0.04)};
        for (int i = 0; i < 24; ++i) {
            BodySpec box = thrown_box(0.05, random);
            box.name = "box" + std::to_string(i);
            box.position = Vec3d(i % 2, i / 2 % 2, i / 4) * 0.0875 + Vec3d(-0.04, -0.04, 0.15);
            scene.bodies.push_back(box);
        }
        EXPECT_LT(deepest_overlap(scene, 0.6), 5e-4) << seed;
        scene.settings.contact.hulls = true;
        EXPECT_LT(deepest_overlap(scene, 0.6), 1e-3) << seed << ", as convex hulls";
    }
}

// Bodies that start nine tenths inside each other leave along one direction at push_speed: 90 mm in 0.9 s, without energy. Breaks when
// their shallow contacts push at several sides at once (they are drawn together), or when they fall asleep on their way.
TEST(StartsInside, NineTenths) {
    for (const auto& [shape, triangles] : {std::pair("sphere", 500), {"box", 12}, {"liver", 1000}, {"kidney", 400}})
        for (const double angle : {0.0, 0.5}) {
            SceneFile scene;
            scene.settings.gravity.setZero();
            for (const double x : {0.0, 0.01}) {
                BodySpec body = still_body(shape, 0.1, uint32_t(triangles), 0.3 * x);
                body.name += x > 0 ? "b" : "a";
                body.motion = Motion::kFree;
                body.position.x() = x;
                if (x > 0) body.orientation = from_rotation_vector(Vec3d(0, angle, angle));
                scene.bodies.push_back(body);
            }
            double apart[2];
            for (const int sleeps : {0, 1}) {
                scene.settings.sleep_speed = sleeps * 1e-4;
                ThreadPool pool(1);
                pool.run([&] {
                    Frame frame(std::move(build_scene(scene, Looks::kPlain).world), {});
                    for (int pass = 0; pass < 90; ++pass) frame.step();
                    EXPECT_LT(frame.times().deepest, 2e-4) << shape << ' ' << angle;
                    EXPECT_LT(frame.world().energy.kinetic, 1e-6) << shape << ' ' << angle;
                    apart[sleeps] = (frame.world().poses.origin[1] - frame.world().poses.origin[0]).norm();
                });
            }
            EXPECT_GT(apart[0], 0.03) << shape << ' ' << angle;
            EXPECT_NEAR(apart[1], apart[0], 2e-4) << shape << ' ' << angle;
        }
}

// Boxes that overlap by a sixth on all sides: parted by the shortest way within what push_speed needs.
TEST(StartsInside, GridOfBoxes) {
    SceneFile scene;
    scene.settings.gravity.setZero();
    for (int i = 0; i < 8; ++i) {
        BodySpec box = still_body("box", 0.05, 12, 0);
        box.name = "box" + std::to_string(i);
        box.motion = Motion::kFree;
        box.position = Vec3d(i % 2, i / 2 % 2, i / 4) * 0.042;
        scene.bodies.push_back(box);
    }
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(build_scene(scene, Looks::kPlain).world), {});
        for (int pass = 0; pass < 30; ++pass) frame.step();
        EXPECT_LT(frame.times().deepest, 1e-4);
        EXPECT_EQ(frame.world().report.deferred_pairs, 0u);
    });
}

// However many boxes are in one place, a round looks at 24 neighbours of each at most; each pair's turn comes.
TEST(StartsInside, WorkIsBounded) {
    SceneFile scene;
    constexpr uint32_t kBoxes = 100;
    for (uint32_t i = 0; i < kBoxes; ++i) {
        BodySpec box = still_body("box", 0.05, 12, i * 0.2);
        box.name = "box" + std::to_string(i);
        box.motion = Motion::kFree;
        scene.bodies.push_back(box);
    }
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(build_scene(scene, Looks::kPlain).world), {});
        BroadPhasePairs all;
        for (uint32_t a = 0; a < kBoxes; ++a)
            for (uint32_t b = a + 1; b < kBoxes; ++b) all.a.push_back(a), all.b.push_back(b);
        std::vector<int> seen(kBoxes * kBoxes);
        for (uint64_t tick = 0; tick < 400; tick += 16) {
            BroadPhasePairs pairs = all;
            const uint64_t deferred = defer_pairs(surfaces_of(frame.world()), tick, pairs);
            EXPECT_EQ(deferred + pairs.a.size(), all.a.size());
            EXPECT_LT(pairs.a.size(), 1.1 * 24 * kBoxes);
            for (size_t i = 0; i < pairs.a.size(); ++i) ++seen[pairs.a[i] * kBoxes + pairs.b[i]];
        }
        for (size_t i = 0; i < all.a.size(); ++i) EXPECT_GT(seen[all.a[i] * kBoxes + all.b[i]], 0) << i;
        BroadPhasePairs few = all;
        few.a.resize(1000), few.b.resize(1000);
        EXPECT_EQ(defer_pairs(surfaces_of(frame.world()), 0, few), 0u);
    });
}

}  // namespace
