#include <algorithm>
#include <cmath>

#include "bench/contact/closed_form_pairs.hpp"
#include "bench/contact/contact_parts.hpp"
#include "bench/contact/surface_depth.hpp"
#include "bench/peers/float_depth.hpp"
#include "content/mend/admission.hpp"
#include "content/shapes/shape_library.hpp"
#include "engine/base/error.hpp"
namespace trocar::bench {
namespace {

using namespace trocar::test;

double deepest_contact(const ContactScene& scene) { return scene.penetrations.depth.empty() ? 0 : scene.penetrations.depth[0]; }

double vertex_depth(ContactScene& scene) {
    scene.find_triangles();
    find_overlap(scene.inputs(), scene.screened, scene.candidates, scene.frame.scratch.overlap, scene.report, scene.near, scene.contacts);
    measure_penetrations(scene.pairs, scene.contacts, scene.report, scene.penetrations);
    return deepest_contact(scene);
}

double edge_depth(ContactScene& scene) {
    vertex_depth(scene);
    find_edge_contacts(scene.inputs(), scene.candidates, scene.near, scene.frame.scratch.edges, scene.report, scene.contacts);
    measure_penetrations(scene.pairs, scene.contacts, scene.report, scene.penetrations);
    return deepest_contact(scene);
}

// Recomputes every sign by the winding number, as contact.cross_check does; if any differ, the depth over
// points that both count as inside.
double cross_checked_depth(ContactScene& scene) {
    for (auto& tree : scene.trees) tree->cross_check(true);
    const uint64_t before = scene.report.disagreements;
    double depth = edge_depth(scene);
    if (scene.report.disagreements > before) {
        depth = 0;
        for (size_t i = 0; i < scene.contacts.pair.size(); ++i) {
            const uint32_t other = scene.contacts.other[i];
            const Vec3d p = world_to_frame(scene.surfaces(), other, scene.contacts.point[i]);
            if (scene.contacts.distance[i] < 0 && scene.trees[other]->winds_around(p)) depth = std::max(depth, -scene.contacts.distance[i]);
        }
    }
    for (auto& tree : scene.trees) tree->cross_check(false);
    return depth;
}

struct Method {
    std::string name;
    std::function<double()> run;
};

// Depth of the meshes: known if a corner against a plane decides it, else by subdivision.
struct Truth {
    double mesh = 0, slack = 0, smooth = kNoValue;
};

void measure_pair(const std::string& name, const std::string& plot, ContactScene& scene, const Truth& truth, Report& report) {
    Soup soup = make_soup(scene.surfaces());
    FloatDepth plain(soup);
    std::vector<Method> methods{{"vertices, float", [&] { return plain.refit(soup), double(plain.depth(soup)); }},
                                {"vertices, certified", [&] { return vertex_depth(scene); }},
                                {"+ edge pass", [&] { return edge_depth(scene); }},
                                {"+ winding cross-check", [&] { return cross_checked_depth(scene); }}};
    for (const double mm : {4.0, 2.0, 1.0}) {
        char label[40];
        std::snprintf(label, sizeof label, "samples to %g mm", mm);
        methods.push_back({label, [&scene, mm] {
                               compute_body_boxes({scene.period, scene.surfaces()}, scene.boxes);
                               return sampled_depth(scene, 1e-3 * mm);
                           }});
    }
    std::vector<double> depth(methods.size());
    std::vector<std::function<void()>> jobs;
    for (size_t i = 0; i < methods.size(); ++i) jobs.push_back([&, i] { depth[i] = methods[i].run(); });
    const std::vector<double> seconds = interleaved_medians(report.quick() ? 1 : 3, jobs);
    for (size_t i = 0; i < methods.size(); ++i) {
        report.add({.name = name + ", " + methods[i].name,
                    .ours = 1e3 * seconds[i],
                    .unit = "ms",
                    .error = 1e3 * std::abs(depth[i] - truth.mesh),
                    .smooth_error = 1e3 * std::abs(depth[i] - truth.smooth),
                    .error_unit = "mm",
                    .plot = plot,
                    .series = methods[i].name});
    }
}

struct OrganPair {
    const char *under, *on;
    double turned, sunk;  // rad, m
};
constexpr OrganPair kOrganPairs[] = {{"liver", "kidney", 0, 0.004},        {"liver", "kidney", 0, 0.02},
                                     {"liver", "kidney", 0.9, 0.008},      {"stomach", "gallbladder", 0.4, 0.006},
                                     {"liver", "bowel", 0.3, 0.005},       {"liver", "probe", 0, 0.005},
                                     {"kidney", "gallbladder", 1.3, 0.012}};

}  // namespace

void plot_speed_and_error(Report& report) {
    report.heading("Speed against error: depth of closed-form pairs, mesh (error) and smooth shape (smooth)");
    for (uint32_t level = 0; level < (report.quick() ? 2u : 4u); ++level) {
        for (const ClosedFormPair& pair : closed_form_pairs(level)) {
            ContactScene scene(pair.bodies);
            scene.settings.contact.tolerance = 1e-6;
            Truth truth{0, 0, pair.depth};
            size_t triangles = 0;
            for (const BodyInput& body : pair.bodies) {
                triangles += body.mesh.triangle.size();
                const MeshJudgement judgement = judge_mesh(body.mesh, true);
                if (judgement.admitted_as != Admission::kSolid) throw InputError(pair.name + ": " + judgement.reason);
            }
            if (pair.name.ends_with("half-space")) {
                for (uint32_t v = 0; v < mesh_view(scene.meshes, 1).position.size(); ++v) {
                    truth.mesh = std::max(truth.mesh, -vertex_position(scene.surfaces(), 1, v).z());
                }
            } else if (pair.name.starts_with("two boxes") || pair.name.starts_with("box on")) {
                truth.mesh = pair.depth;  // flat faces: the mesh is the shape
            } else {
                const DeepestPoint deepest = surface_depth(scene, 1e-7, 150'000);
                truth = {deepest.depth, deepest.slack, pair.depth};
            }
            char name[120];
            std::snprintf(name, sizeof name, "%s, level %u (%zu triangles)", pair.name.c_str(), level, triangles);
            measure_pair(name, "closed-form pairs, level " + std::to_string(level), scene, truth, report);
        }
    }
    for (const OrganPair& pair : kOrganPairs) {
        const uint32_t triangles = report.quick() ? 4000 : 20000;
        Mesh under = make_shape(pair.under, triangles), on = make_shape(pair.on, triangles / 2);
        order_for_locality(under);
        order_for_locality(on);
        ContactScene scene(
            {{under, Motion::kDeformable, Vec3d::Zero(), {}}, {on, Motion::kDeformable, Vec3d::Zero(), turn({1, 2, 0}, pair.turned)}});
        // places the lowest vertex of one straight below the highest of the other
        Vec3d top(0, 0, -INFINITY), tip(0, 0, INFINITY);
        for (uint32_t v = 0; v < under.position.size(); ++v) {
            const Vec3d p = vertex_position(scene.surfaces(), 0, v);
            if (p.z() > top.z()) top = p;
        }
        for (uint32_t v = 0; v < on.position.size(); ++v) {
            const Vec3d p = vertex_position(scene.surfaces(), 1, v);
            if (p.z() < tip.z()) tip = p;
        }
        scene.poses.origin[1] += top - tip - pair.sunk * Vec3d::UnitZ() + Vec3d(0.0007, 0.0004, 0);
        scene.settings.contact.tolerance = 1e-6;
        const DeepestPoint deepest = surface_depth(scene, 1e-7, 150'000);
        char name[120];
        std::snprintf(name, sizeof name, "%s %.0f mm into %s (%.2f mm deep)", pair.on, 1e3 * pair.sunk, pair.under, 1e3 * deepest.depth);
        measure_pair(name, "organs", scene, {deepest.depth, deepest.slack, kNoValue}, report);
    }
}

}  // namespace trocar::bench
