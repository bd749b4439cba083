#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <random>
#include <string>

#include "bench/contact/contact_parts.hpp"
#include "bench/peers/broad_phases.hpp"
#ifdef TROCAR_WITH_BULLET
#include "bench/peers/bullet_pairs.hpp"
#endif
#include "tests/systems/detect/contact_scene.hpp"
namespace trocar::bench {
namespace {

using namespace trocar::test;

// Rotated copies of one noisy ball of radius 1 on a lattice; they share one prototype and need no trees.
class Balls {
 public:
    Balls(uint32_t count, uint32_t n, double spacing, double jitter) : scene({}), random_(7) {
        mesh_ = make_sphere(n, [](const Vec3d& p) { return Vec3d((1 + 0.05 * std::sin(6 * p.x() + 1) * std::cos(4 * p.y())) * p); });
        order_for_locality(mesh_);
        const uint32_t row = add_prototype(scene.meshes, mesh_, Admission::kSolid);
        const uint32_t side = uint32_t(std::ceil(std::cbrt(double(count))));
        for (uint32_t i = 0; i < count; ++i) {
            Vec3d at(i % side * spacing, i / side % side * spacing, double(i / side / side) * spacing);
            if (count == 2) at = Vec3d(i * spacing, 0.1 * i, 0);
            add(row, at + jitter * anywhere(), turn({0, 0, 1}, 20 * jitter * anywhere().x()));
        }
    }
    // Moves every body by up to `most`, m, and sets that speed.
    void move(double most) {
        for (uint32_t body = 0; body < scene.bodies.mesh.size(); ++body) {
            const Vec3d displacement = most * anywhere();
            scene.poses.origin[body] += displacement;
            const Range rows = scene.bodies.particles[body];
            std::fill_n(scene.particles.velocity_x.begin() + rows.first, rows.count, float(displacement.x() / scene.period));
            std::fill_n(scene.particles.velocity_y.begin() + rows.first, rows.count, float(displacement.y() / scene.period));
            std::fill_n(scene.particles.velocity_z.begin() + rows.first, rows.count, float(displacement.z() / scene.period));
        }
    }
    void find() {
        const Surfaces s = scene.surfaces();
        double at[5] = {thread_seconds()};
        compute_body_boxes({scene.period, s}, scene.boxes);
        at[1] = thread_seconds();
        find_broad_phase_pairs(scene.bodies, scene.boxes, {}, scene.frame.scratch.pairs, scene.pairs);
        at[2] = thread_seconds();
        rasterise(scene.inputs(), 0, scene.frame.scratch.rasterise, scene.report, scene.screened, scene.occupancy);
        at[3] = thread_seconds();
        find_candidate_triangles(scene.inputs(), {}, scene.screened, scene.occupancy, scene.frame.scratch.cells, scene.candidates);
        at[4] = thread_seconds();
        for (int i = 0; i < 4; ++i) stage_ms[i].push_back(1e3 * (at[i + 1] - at[i]));
    }
    // Medians of the stage times since the last call.
    std::string stages() {
        std::string text = "boxes, pairs, rasterise, cells:";
        for (std::vector<double>& ms : stage_ms) {
            char part[32];
            std::nth_element(ms.begin(), ms.begin() + ptrdiff_t(ms.size() / 2), ms.end());
            std::snprintf(part, sizeof part, " %.3f", ms[ms.size() / 2]);
            text += part;
            ms.clear();
        }
        return text + " ms";
    }

    ContactScene scene;
    std::array<std::vector<double>, 4> stage_ms;

 private:
    Vec3d anywhere() {
        std::uniform_real_distribution<double> u(-1, 1);
        const double x = u(random_), y = u(random_), z = u(random_);
        return {x, y, z};
    }
    void add(uint32_t row, const Vec3d& origin, const Quat& turned) {
        const uint32_t count = (uint32_t(mesh_.position.size()) + 15) / 16 * 16;
        scene.bodies.mesh.push_back(row);
        scene.bodies.motion.push_back(Motion::kDeformable);
        scene.bodies.thickness.push_back(0);
        scene.bodies.particles.push_back({uint32_t(scene.particles.offset.size()), count});
        scene.poses.origin.push_back(origin);
        scene.poses.orientation.push_back({});
        scene.poses.velocity.push_back(Vec3d::Zero());
        scene.poses.angular_velocity.push_back(Vec3d::Zero());
        for (uint32_t i = 0; i < count; ++i) {
            const Vec3d p = i < mesh_.position.size() ? rotate(turned, mesh_.position[i]) : Vec3d(Vec3d::Zero());
            scene.particles.offset.push_back({float(p.x()), float(p.y()), float(p.z()), 1});
        }
        for (auto* v : {&scene.particles.velocity_x, &scene.particles.velocity_y, &scene.particles.velocity_z}) {
            v->resize(scene.particles.offset.size());
        }
    }
    Mesh mesh_;
    std::mt19937_64 random_;
};

// The engine's crossing pairs as indices into the soup.
TrianglePairs pairs_of(const ContactScene& scene, const Soup& soup) {
    TrianglePairs pairs;
    for (uint32_t pair = 0; pair < scene.pairs.a.size(); ++pair) {
        const uint32_t a = soup.triangles[scene.pairs.a[pair]].first, b = soup.triangles[scene.pairs.b[pair]].first;
        const Range rows = scene.candidates.pair[pair];
        for (uint32_t i = rows.first; i < rows.end(); ++i) {
            pairs.push_back({a + scene.candidates.triangle[i][0], b + scene.candidates.triangle[i][1]});
        }
    }
    return pairs;
}

// Pairs of `truth` missing from `found`.
double missing(TrianglePairs truth, TrianglePairs found) {
    std::sort(truth.begin(), truth.end());
    std::sort(found.begin(), found.end());
    TrianglePairs lost;
    std::set_difference(truth.begin(), truth.end(), found.begin(), found.end(), std::back_inserter(lost));
    return double(lost.size());
}

struct Scene {
    const char* name;
    uint32_t bodies, n;
    double spacing, jitter;
    double at_least, aim;  // ratio to the rasterise-all; 0 = no goal
    int rounds;
};
constexpr Scene kScenes[] = {{"two touching organs of 49,152 triangles", 2, 64, 1.9, 0, 3, 3.5, 15},
                             {"the same, deep", 2, 64, 1.5, 0, 0, 0, 11},
                             {"1,000 bodies of 972, sparse", 1000, 9, 3.0, 0.6, 15, 20, 7},
                             {"1,000 bodies of 972, packed", 1000, 9, 1.95, 0.02, 0, 0, 3},
                             {"10,000 bodies of 192, sparse", 10000, 4, 3.0, 0.6, 10, 14, 5},
                             {"10,000 bodies of 192, packed", 10000, 4, 1.95, 0.05, 0, 0, 3}};

void compare_scene(const Scene& about, Report& report) {
    Balls balls(about.bodies, about.n, about.spacing, about.jitter);
    const Soup soup = make_soup(balls.scene.surfaces());
    RasteriseAll all;
    SweptTrees trees(soup);
    TrianglePairs of_all, of_trees, of_brute;
    // each at its best cell size: 2 to 6 edges for the rasterise-all, the default for ours
    double best_edges = 0, best = INFINITY;
    for (const double edges : {2.0, 3.0, 4.0, 6.0}) {
        const double seconds = interleaved_medians(report.quick() ? 1 : 2, {[&] { all.find(soup, edges * soup.mean_edge, of_all); }})[0];
        if (seconds < best) best = seconds, best_edges = edges;
    }
    const bool brute = !report.quick() && about.bodies * about.n < 30000;
    const std::vector<double> cost = interleaved_medians(
        report.quick() ? 3 : about.rounds,
        {[&] { balls.find(); }, [&] { all.find(soup, best_edges * soup.mean_edge, of_all); }, [&] { trees.find(soup, of_trees); }});
    const TrianglePairs ours = pairs_of(balls.scene, soup);
    double brute_seconds = kNoValue;
    if (brute) brute_seconds = interleaved_medians(1, {[&] { find_by_brute_force(soup, of_brute); }})[0];
    const TrianglePairs& truth = brute ? of_brute : of_trees;

    report.heading(about.name + std::string(": ") + std::to_string(soup.triangle.size()) + " triangles, " +
                   std::to_string(balls.scene.pairs.a.size()) + " pairs of boxes, " + std::to_string(balls.scene.screened.triangle.size()) +
                   " triangles screened, " + std::to_string(truth.size()) + " pairs of triangles" + (brute ? "" : " (by the trees)"));
    char edges[64];
    std::snprintf(edges, sizeof edges, "rasterise-all at %g edges", best_edges);
    Row row{.name = std::string(about.name) + ": OHC",
            .ours = 1e3 * cost[0],
            .unit = "ms",
            .peer = edges,
            .peer_value = 1e3 * cost[1],
            .error = missing(truth, ours),
            .peer_error = missing(truth, of_all),
            .error_unit = "missed",
            .note = balls.stages()};
    if (about.at_least > 0) row.goal = Goal::kRatio, row.at_least = about.at_least, row.aim = about.aim;
    report.add(row);
    report.add({.name = std::string(about.name) + ": OHC",
                .ours = 1e3 * cost[0],
                .unit = "ms",
                .peer = "sweep-and-prune + trees",
                .peer_value = 1e3 * cost[2],
                .error = missing(truth, ours),
                .peer_error = missing(truth, of_trees),
                .error_unit = "missed"});
    if (brute) {
        report.add({.name = std::string(about.name) + ": OHC",
                    .ours = 1e3 * cost[0],
                    .unit = "ms",
                    .peer = "brute force",
                    .peer_value = 1e3 * brute_seconds,
                    .error = missing(truth, ours),
                    .peer_error = 0,
                    .error_unit = "missed"});
    }
}

void measure_moving_bodies(Report& report) {
    Balls balls(10000, 4, 3.0, 0.6);
    std::vector<double> ms;
    for (int round = 0; round < (report.quick() ? 7 : 25); ++round) {
        balls.move(0.02);
        const double begin = thread_seconds();
        balls.find();
        if (round >= 2) ms.push_back(1e3 * (thread_seconds() - begin));
    }
    std::sort(ms.begin(), ms.end());
    report.add({.name = "whole broad phase, 10,000 moving bodies of 192, sparse",
                .ours = ms[ms.size() / 2],
                .unit = "ms",
                .goal = Goal::kLimit,
                .at_least = 8,
                .aim = 6,
                .note = balls.stages()});
}

// Both get the same boxes, of edge 2.1, each of which moves by up to `stride` along each axis every round.
void compare_boxes(uint32_t count, double spacing, double jitter, double stride, bool judged, Report& report) {
    std::mt19937_64 random(7);
    std::uniform_real_distribution<double> position(-jitter, jitter), step(-1, 1);
    const uint32_t side = uint32_t(std::ceil(std::cbrt(double(count))));
    Bodies bodies;
    BodyBoxes boxes;
    for (uint32_t i = 0; i < count; ++i) {
        bodies.motion.push_back(Motion::kDeformable);
        const double x = position(random), y = position(random), z = position(random);
        const Vec3d at = spacing * Vec3d(i % side, i / side % side, i / side / side) + Vec3d(x, y, z);
        boxes.box.push_back({at - Vec3d::Constant(1.05), at + Vec3d::Constant(1.05)});
    }
    BroadPhaseScratch scratch;
    BroadPhasePairs pairs;
    std::vector<double> ours, theirs;
#ifdef TROCAR_WITH_BULLET
    BulletPairs bullet(boxes.box);
#endif
    size_t held = 0;
    for (int round = 0; round < 41; ++round) {
        for (Box& box : boxes.box) {
            const double x = stride * step(random), y = stride * step(random), z = stride * step(random);
            box.min += Vec3d(x, y, z);
            box.max += Vec3d(x, y, z);
        }
        const double begin = thread_seconds();
        find_broad_phase_pairs(bodies, boxes, {}, scratch, pairs);
        const double middle = thread_seconds();
#ifdef TROCAR_WITH_BULLET
        held = bullet.update(boxes.box);
#endif
        const double end = thread_seconds();
        if (round > 0) ours.push_back(1e3 * (middle - begin)), theirs.push_back(1e3 * (end - middle));
    }
    std::sort(ours.begin(), ours.end());
    std::sort(theirs.begin(), theirs.end());
    const double mean = std::accumulate(ours.begin(), ours.end(), 0.0) / double(ours.size());
    Row row{.name = "box pairs, " + std::to_string(count) + (stride > 0 ? " moving, " : " at rest, ") + std::to_string(pairs.a.size()) +
                    " pairs",
            .ours = mean,
            .unit = "ms"};
#ifdef TROCAR_WITH_BULLET
    row.peer = "Bullet dbvt";
    row.peer_value = std::accumulate(theirs.begin(), theirs.end(), 0.0) / double(theirs.size());
    row.peer_error = double(held) - double(pairs.a.size());
    row.error = 0;
    row.error_unit = "pairs too many";
    if (judged) row.goal = Goal::kPeerShare, row.at_least = 1.5, row.aim = 1;
    char best[80];
    std::snprintf(best, sizeof best, "best of %zu: ours %.3f, Bullet %.3f ms", ours.size(), ours[0], theirs[0]);
    row.note = best;
#else
    row.note = "Bullet (libbullet-dev) is not installed: no peer";
    static_cast<void>(held), static_cast<void>(judged);
#endif
    report.add(row);
}

}  // namespace

void compare_broad_phases(Report& report) {
    for (const Scene& scene : kScenes) compare_scene(scene, report);
    report.heading("Moving bodies");
    measure_moving_bodies(report);
    for (const double stride : {0.0, 0.02, 0.1, 0.4}) {
        compare_boxes(1000, 3.0, 0.6, stride, false, report);
        compare_boxes(10000, 3.0, 0.6, stride, true, report);
        compare_boxes(10000, 1.95, 0.05, stride, false, report);
    }
}

}  // namespace trocar::bench
