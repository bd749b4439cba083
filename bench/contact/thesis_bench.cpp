#include <algorithm>
#include <cmath>
#include <set>

#include "bench/contact/contact_parts.hpp"
#include "bench/contact/surface_depth.hpp"
#include "bench/peers/thesis2008.hpp"
namespace trocar::bench {
namespace {

using namespace trocar::test;

Mesh ellipsoid(uint32_t n, const Vec3d& half) {
    Mesh mesh = make_sphere(
        n, [&](const Vec3d& p) { return Vec3d(half.cwiseProduct(p) * (1 + 0.03 * std::sin(5 * p.x()) * std::cos(4 * p.y()))); });
    order_for_locality(mesh);
    return mesh;
}

struct InsideVertices {
    std::set<std::array<uint32_t, 2>> vertex;  // body, local vertex
    double depth = 0;                          // m, largest shortest distance of these
};

// By winding number and closest point of every vertex in the other's box.
InsideVertices inside_vertices(const ContactScene& scene) {
    InsideVertices inside;
    const Surfaces s = scene.surfaces();
    for (uint32_t body = 0; body < 2; ++body) {
        const uint32_t other = 1 - body;
        for (uint32_t v = 0; v < mesh_view(s.meshes, s.bodies.mesh[body]).position.size(); ++v) {
            const Vec3d p = vertex_position(s, body, v);
            if (!contains(scene.boxes.box[other], p)) continue;
            const Vec3d q = world_to_frame(s, other, p);
            if (scene.trees[other]->winding_number(q) < 0.5) continue;
            inside.vertex.insert({body, v});
            inside.depth = std::max(inside.depth, std::abs(scene.trees[other]->query(q).distance));
        }
    }
    return inside;
}

struct Misses {
    double missed = 0, wrong = 0;
};
Misses compare(const std::set<std::array<uint32_t, 2>>& truth, const std::set<std::array<uint32_t, 2>>& found) {
    Misses m;
    for (const auto& v : truth) m.missed += !found.contains(v);
    for (const auto& v : found) m.wrong += !truth.contains(v);
    return m;
}

void compare_scene(const char* name, const std::vector<BodyInput>& bodies, Report& report) {
    ContactScene scene(bodies);
    scene.run();
    const Soup soup = make_soup(scene.surfaces());
    Thesis2008 thesis(soup);
    std::vector<ThesisPair> pairs;
    const InsideVertices truth = inside_vertices(scene);
    const DeepestPoint surface = surface_depth(scene, 1e-6, 400'000);
    for (const double edges : {1.0, 2.5}) {
        const std::vector<double> cost =
            interleaved_medians(report.quick() ? 3 : 9, {[&] { scene.run(); }, [&] { thesis.run(soup, edges * soup.mean_edge, pairs); }});
        std::set<std::array<uint32_t, 2>> ours, theirs;
        for (uint32_t i = 0; i < scene.contacts.pair.size(); ++i) {
            const auto& v = scene.contacts.vertex[i];
            if (v[0] == v[1] && scene.contacts.distance[i] < 0) ours.insert({scene.contacts.body[i], v[0]});
        }
        for (const ThesisPair& pair : pairs)
            for (const ThesisVertex& v : pair.inside) theirs.insert({v.body, v.vertex - soup.vertices[v.body].first});
        const Misses of_ours = compare(truth.vertex, ours), of_theirs = compare(truth.vertex, theirs);
        const double depth = scene.penetrations.depth.empty() ? 0 : scene.penetrations.depth[0];
        const double thesis_depth = pairs.empty() ? 0 : pairs[0].depth;
        char note[200];
        std::snprintf(note, sizeof note, "%zu vertices inside; thesis missed %.0f, took %.0f outside; ours %.0f and %.0f",
                      truth.vertex.size(), of_theirs.missed, of_theirs.wrong, of_ours.missed, of_ours.wrong);
        char peer[64];
        std::snprintf(peer, sizeof peer, "thesis2008, cell %g edges", edges);
        report.add({.name = std::string(name) + ": whole contact pass",
                    .ours = 1e3 * cost[0],
                    .unit = "ms",
                    .peer = peer,
                    .peer_value = 1e3 * cost[1],
                    .error = 1e3 * std::abs(depth - surface.depth),
                    .peer_error = 1e3 * std::abs(thesis_depth - surface.depth),
                    .error_unit = "mm of depth",
                    .note = note});
    }
    char text[160];
    std::snprintf(text, sizeof text, "  (%s: depth of the surfaces %.4f mm, not more than %.4f mm above; of the vertices %.4f mm)", name,
                  1e3 * surface.depth, 1e3 * surface.slack, 1e3 * truth.depth);
    report.heading(text);
}

}  // namespace

void compare_with_thesis(Report& report) {
    report.heading("The thesis' algorithm (2008) written from its text, beside ours");
    const Mesh liver = ellipsoid(29, {0.10, 0.075, 0.045}), kidney = ellipsoid(29, {0.03, 0.055, 0.028}),
               probe = make_sphere(12, [](const Vec3d&p) { return Vec3d(Vec3d(0.004, 0.004, 0.06).cwiseProduct(p)); });
    const BodyInput under{liver, Motion::kDeformable, Vec3d::Zero(), {}};
    compare_scene("kidney 5 mm into liver", {under, {kidney, Motion::kDeformable, Vec3d(0.01, 0.005, 0.0688), turn(Vec3d(0, 0, 1), 0.4)}},
                  report);
    compare_scene("kidney deep in liver", {under, {kidney, Motion::kDeformable, Vec3d(0.01, 0.005, 0.04), {}}}, report);
    compare_scene("probe on liver", {under, {probe, Motion::kHand, Vec3d(0.01, 0.005, 0.095), turn({1, 0, 0}, 0.3)}}, report);
    compare_scene("crossed bars, edges only",
                  {{make_box({0.1, 0.01, 0.01}, {20, 2, 2}), Motion::kDeformable, Vec3d::Zero(), {}},
                   {make_box({0.01, 0.1, 0.01}, {2, 20, 2}), Motion::kDeformable, Vec3d(0.0013, 0.0017, 0.006), turn({1, 0, 0}, 0.7854)}},
                  report);
}

}  // namespace trocar::bench
