#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "bench/contact/contact_parts.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "tests/systems/detect/contact_scene.hpp"

namespace trocar::bench {
namespace {

using namespace trocar::test;

Mesh ellipsoid(uint32_t n, const Vec3d& half, double bumps) {
    Mesh mesh = make_sphere(n, [&](const Vec3d& p) {
        const double r = 1 + bumps * std::sin(5 * p.x()) * std::cos(4 * p.y());
        return Vec3d(half.cwiseProduct(p) * r);
    });
    order_for_locality(mesh);
    return mesh;
}

// Runs all detection stages that the scene needs for `passes` passes while body 1 moves a little, and prints the
// median of each.
void measure(const char* name, ContactScene& scene, uint32_t passes) {
    scene.frame.limits = {};
    std::vector<FrameStage> stages;
    for (const FrameStage& s : frame_stages())
        if (s.part == FramePart::kDetection && s.wanted(scene)) stages.push_back(s);
    std::vector<std::vector<double>> cost(stages.size() + 1);
    const Vec3d start = scene.poses.origin[1];
    for (uint32_t pass = 0; pass < passes + 5; ++pass) {
        scene.poses.origin[1] = start + Vec3d(0.3e-3 * std::sin(0.1 * pass), 0.3e-3 * std::cos(0.07 * pass), 0);
        double total = 0;
        for (size_t i = 0; i < stages.size(); ++i) {
            const double begin = thread_seconds();
            scene.run_stage(stages[i]);
            const double seconds = thread_seconds() - begin;
            total += seconds;
            if (pass >= 5) cost[i].push_back(seconds);
        }
        if (pass >= 5) cost.back().push_back(total);
    }
    const auto at = [](std::vector<double>& v, double part) {
        std::sort(v.begin(), v.end());
        return v[size_t(part * double(v.size() - 1))] * 1e6;
    };
    uint32_t inside = 0, edges = 0;
    double depth = 0;
    for (uint32_t i = 0; i < scene.penetrations.pair.size(); ++i) {
        inside += scene.penetrations.vertices_a_in_b[i] + scene.penetrations.vertices_b_in_a[i];
        edges += scene.penetrations.edge_contacts[i];
        depth = std::max(depth, scene.penetrations.depth[i]);
    }
    std::printf(
        "%s: bodies %zu, pairs %zu, screened %zu, shared cells %zu, triangle pairs %zu, queried vertices %zu, "
        "contacts %zu, inside %u, edge rows %u, depth %.2f mm\n",
        name, scene.bodies.mesh.size(), scene.pairs.a.size(), scene.screened.triangle.size(), scene.occupancy.cell_key.size(),
        scene.candidates.triangle.size(), scene.near.vertex.size(), scene.contacts.pair.size(), inside, edges, depth * 1e3);
    for (size_t i = 0; i < stages.size(); ++i) {
        std::printf("  %-16s p50 %8.1f us   p99 %8.1f us\n", stages[i].stage.name.data(), at(cost[i], 0.5), at(cost[i], 0.99));
    }
    std::printf("  %-16s p50 %8.1f us   p99 %8.1f us\n", "all", at(cost.back(), 0.5), at(cost.back(), 0.99));
}

}  // namespace

void measure_stages(int argc, char** argv) {
    const uint32_t passes = argc > 1 ? uint32_t(std::max(1, std::atoi(argv[1]))) : 200;
    const std::string only = argc > 2 ? argv[2] : "";
    const auto wanted = [&](const char* name) { return only.empty() || only == name; };
    if (wanted("goal")) {
        ContactScene scene(
            {{ellipsoid(29, {0.10, 0.075, 0.045}, 0.03), Motion::kDeformable, Vec3d::Zero(), {}},
             {ellipsoid(29, {0.03, 0.055, 0.028}, 0.03), Motion::kDeformable, Vec3d(0.01, 0.005, 0.0688), turn(Vec3d(0, 0, 1), 0.4)}});
        if (argc > 3) scene.settings.contact.cell_edges = std::atof(argv[3]);
        measure("goal: 5 mm deep, 200 inside", scene, passes);
    }
    if (wanted("kidney")) {
        ContactScene scene(
            {{ellipsoid(29, {0.10, 0.075, 0.045}, 0.03), Motion::kDeformable, Vec3d::Zero(), {}},
             {ellipsoid(29, {0.03, 0.055, 0.028}, 0.03), Motion::kDeformable, Vec3d(0.01, 0.005, 0.0655), turn(Vec3d(0, 0, 1), 0.4)}});
        if (argc > 3) scene.settings.contact.cell_edges = std::atof(argv[3]);
        measure("kidney on liver", scene, passes);
    }
    if (wanted("probe")) {
        ContactScene scene({{ellipsoid(29, {0.10, 0.075, 0.045}, 0.03), Motion::kDeformable, Vec3d::Zero(), {}},
                            {ellipsoid(12, {0.004, 0.004, 0.06}, 0), Motion::kHand, Vec3d(0.01, 0.005, 0.095), turn({1, 0, 0}, 0.3)}});
        measure("probe on liver", scene, passes);
    }
    if (wanted("deep")) {
        ContactScene scene({{ellipsoid(29, {0.10, 0.075, 0.045}, 0.03), Motion::kDeformable, Vec3d::Zero(), {}},
                            {ellipsoid(29, {0.06, 0.055, 0.035}, 0.03), Motion::kDeformable, Vec3d(0.01, 0, 0.03), {}}});
        measure("deep overlap", scene, passes / 2);
    }
    if (wanted("pile")) {
        std::vector<BodyInput> pile;
        for (uint32_t i = 0; i < 1000; ++i) {
            pile.push_back({ellipsoid(9, Vec3d(0.01, 0.01, 0.01), 0.05),
                            Motion::kDeformable,
                            Vec3d(0.0195 * (i % 10), 0.0195 * (i / 10 % 10), 0.0195 * (i / 100)),
                            {}});
        }
        ContactScene scene(pile);
        measure("pile of 1000", scene, 10);
    }
}

}  // namespace trocar::bench
