#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <string>

#include "bench/contact/contact_parts.hpp"
#include "bench/peers/overlap_peers.hpp"
#include "content/shapes/shape_library.hpp"
#include "engine/geometry/triangle_triangle.hpp"
#include "tests/systems/detect/contact_scene.hpp"
namespace trocar::bench {
namespace {

using namespace trocar::test;

struct Tally {
    size_t poses = 0, meeting = 0;
    size_t pairs_missed = 0;     // triangle pairs that cross exactly but are not among the candidates
    size_t contacts_missed = 0;  // poses with crossing surfaces but no reported overlap
    size_t inside_missed = 0;    // poses with one body wholly inside the other but no reported overlap
};

std::vector<Corners> corners_of(const ContactScene& scene, uint32_t body) {
    std::vector<Corners> corners;
    for (const Triangle& t : mesh_view(scene.meshes, scene.bodies.mesh[body]).triangle) {
        corners.push_back({vertex_position(scene.surfaces(), body, t[0]), vertex_position(scene.surfaces(), body, t[1]),
                           vertex_position(scene.surfaces(), body, t[2])});
    }
    return corners;
}
Box box_of(const Corners& c) { return {c[0].cwiseMin(c[1]).cwiseMin(c[2]), c[0].cwiseMax(c[1]).cwiseMax(c[2])}; }

// Every triangle of one body against every triangle of the other, by exact predicates.
std::vector<std::array<uint32_t, 2>> crossing_triangles(const std::vector<Corners>& a, const std::vector<Corners>& b) {
    std::vector<Box> box;
    Box all;
    for (const Corners& c : b) {
        box.push_back(box_of(c));
        all = {all.min.cwiseMin(box.back().min), all.max.cwiseMax(box.back().max)};
    }
    std::vector<std::array<uint32_t, 2>> crossing;
    for (uint32_t i = 0; i < a.size(); ++i) {
        const Box own = box_of(a[i]);
        if (!boxes_meet(own, all)) continue;
        for (uint32_t j = 0; j < b.size(); ++j) {
            if (boxes_meet(own, box[j]) && meet_triangles(a[i], b[j]) == Meeting::kCrossing) crossing.push_back({i, j});
        }
    }
    return crossing;
}

void judge_pose(ContactScene& scene, Tally& tally) {
    scene.run();
    ++tally.poses;
    const std::vector<Corners> a = corners_of(scene, 0), b = corners_of(scene, 1);
    const auto crossing = crossing_triangles(a, b);
    std::vector<std::array<uint32_t, 2>> found;
    if (!scene.pairs.a.empty()) {
        const Range rows = scene.candidates.pair[0];
        found.assign(scene.candidates.triangle.begin() + rows.first, scene.candidates.triangle.begin() + rows.end());
    }
    for (const auto& pair : crossing) tally.pairs_missed += !std::binary_search(found.begin(), found.end(), pair);
    const bool overlap = !scene.penetrations.pair.empty();
    if (!crossing.empty()) {
        ++tally.meeting;
        tally.contacts_missed += !overlap;
        return;
    }
    // no crossing: inside or apart; one vertex decides
    for (uint32_t body = 0; body < 2; ++body) {
        const Vec3d p = world_to_frame(scene.surfaces(), 1 - body, body == 0 ? a[0][0] : b[0][0]);
        if (scene.trees[1 - body]->winding_number(p) < 0.5) continue;
        ++tally.meeting;
        tally.inside_missed += !overlap;
        return;
    }
}

class Poses {
 public:
    explicit Poses(uint64_t seed) : random_(seed) {}
    double in(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }
    Vec3d direction() {
        for (;;) {
            const double x = in(-1, 1), y = in(-1, 1), z = in(-1, 1);
            const Vec3d v(x, y, z);
            if (v.norm() > 0.1 && v.norm() < 1) return v.normalized();
        }
    }
    Quat any_turn() {
        const Vec3d axis = direction();
        return turn(axis, in(0, 2 * M_PI));
    }
    Mesh tetrahedron(double size) {
        std::array<Vec3d, 4> p;
        do {
            for (Vec3d& v : p) {
                const double x = in(-size, size), y = in(-size, size), z = in(-size, size);
                v = {x, y, z};
            }
        } while (std::abs((p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0])) < 1e-3 * size * size * size);
        return make_tetrahedron(p);
    }

 private:
    std::mt19937_64 random_;
};

void add(const char* name, const Tally& tally, Report& report) {
    char note[200];
    std::snprintf(note, sizeof note, "%zu poses, %zu in contact; triangle pairs missed %zu, crossings missed %zu, insides missed %zu",
                  tally.poses, tally.meeting, tally.pairs_missed, tally.contacts_missed, tally.inside_missed);
    report.add({.name = std::string("missed against exact tests: ") + name,
                .ours = double(tally.pairs_missed + tally.contacts_missed + tally.inside_missed),
                .unit = "missed",
                .goal = Goal::kLimit,
                .at_least = 0,
                .aim = 0,
                .note = note});
}

Mesh shape_of(const char* name, uint32_t triangles) {
    Mesh mesh = make_shape(name, triangles);
    order_for_locality(mesh);
    return mesh;
}

// Overlap tests of organs by FCL and CGAL, against our whole contact pass, which also computes the depth. All
// trees are built before; ours are refitted in the pass.
void compare_overlap_tests(Report& report) {
    report.heading("Do two meshes meet? Ours tells how deep as well");
    const uint32_t triangles = report.quick() ? 5000 : 20000;
    const Mesh liver = shape_of("liver", triangles), kidney = shape_of("kidney", triangles / 2);
    struct Placement {
        const char* name;
        double sunk;  // m
        bool meet;
    };
    for (const Placement& placement : {Placement{"2 mm apart", -0.002, false}, {"4 mm deep", 0.004, true}, {"20 mm deep", 0.02, true}}) {
        ContactScene scene({{liver, Motion::kDeformable, Vec3d::Zero(), {}}, {kidney, Motion::kDeformable, Vec3d::Zero(), {}}});
        const Box under = scene.meshes.info[0].box, on = scene.meshes.info[1].box;
        scene.poses.origin[1] = 0.5 * (under.min + under.max) - 0.5 * (on.min + on.max);
        scene.poses.origin[1].z() = under.max.z() - on.min.z() - placement.sunk;
        std::array<std::vector<Vec3d>, 2> position;
        std::array<std::span<const Triangle>, 2> faces;
        for (uint32_t body = 0; body < 2; ++body) {
            const MeshView mesh = mesh_view(scene.meshes, body);
            for (uint32_t v = 0; v < mesh.position.size(); ++v) position[body].push_back(vertex_position(scene.surfaces(), body, v));
            faces[body] = mesh.triangle;
        }
        const std::vector<OverlapPeer> peers = make_overlap_peers(position[0], faces[0], position[1], faces[1]);
        std::vector<std::function<void()>> jobs{[&] { scene.run(); }};
        std::vector<char> answer(peers.size());
        for (size_t i = 0; i < peers.size(); ++i) jobs.push_back([&, i] { answer[i] = peers[i].meet(); });
        const std::vector<double> cost = interleaved_medians(report.quick() ? 3 : 9, jobs);
        const bool ours = !scene.penetrations.pair.empty();
        const std::string name = "kidney " + std::string(placement.name) + " on liver, contact pass";
        for (size_t i = 0; i < peers.size(); ++i) {
            report.add({.name = name,
                        .ours = 1e3 * cost[0],
                        .unit = "ms",
                        .peer = peers[i].name,
                        .peer_value = 1e3 * cost[i + 1],
                        .error = double(ours != placement.meet),
                        .peer_error = double(bool(answer[i]) != placement.meet),
                        .error_unit = "wrong",
                        .note = "the peer answers yes or no"});
        }
        if (peers.empty()) {
            report.add({.name = name,
                        .ours = 1e3 * cost[0],
                        .unit = "ms",
                        .error = double(ours != placement.meet),
                        .error_unit = "wrong",
                        .note = "neither FCL (libfcl-dev) nor CGAL (libcgal-dev) is installed: no peer"});
        }
    }
}

}  // namespace

void count_missed_pairs(Report& report) {
    report.heading("Pairs and contacts missed, random poses against exact triangle tests (seed 11)");
    Poses poses(11);
    Tally tetrahedra;
    for (size_t i = 0; i < (report.quick() ? 2000u : 18000u); ++i) {
        const double size = std::exp(poses.in(std::log(0.003), std::log(0.3)));
        ContactScene scene({{poses.tetrahedron(0.03), i % 2 ? Motion::kDeformable : Motion::kStatic, Vec3d::Zero(), {}},
                            {poses.tetrahedron(size), Motion::kHand, 0.03 * poses.direction(), poses.any_turn()}});
        judge_pose(scene, tetrahedra);
    }
    add("two tetrahedra", tetrahedra, report);

    const Mesh organs[] = {shape_of("liver", 1500), shape_of("kidney", 800), shape_of("stomach", 1200), shape_of("bowel", 2500)};
    const Mesh others[] = {shape_of("kidney", 600), shape_of("gallbladder", 600), shape_of("probe", 800), shape_of("needle", 600)};
    Tally moved;
    for (const Mesh& organ : organs) {
        for (const Mesh& other : others) {
            ContactScene scene({{organ, Motion::kDeformable, Vec3d::Zero(), {}}, {other, Motion::kHand, Vec3d::Zero(), {}}});
            const MeshView of_organ = mesh_view(scene.meshes, 0), of_other = mesh_view(scene.meshes, 1);
            for (int i = 0; i < (report.quick() ? 4 : 130); ++i) {
                // places a vertex of one within 5 mm of a vertex of the other
                scene.poses.orientation[1] = poses.any_turn();
                const Vec3d at = of_organ.position[size_t(poses.in(0, double(of_organ.position.size()) - 1))];
                const Vec3d tip = of_other.position[size_t(poses.in(0, double(of_other.position.size()) - 1))];
                scene.poses.origin[1] = at + 0.005 * poses.direction() - rotate(scene.poses.orientation[1], tip);
                judge_pose(scene, moved);
            }
        }
    }
    add("organs and tools", moved, report);
    compare_overlap_tests(report);
}

}  // namespace trocar::bench
