#pragma once
#include <cmath>
#include <memory>
#include <numbers>
#include <random>
#include <utility>

#include "engine/distance/closest_point.hpp"
#include "engine/mesh/mesh_topology.hpp"
#include "engine/mesh/surfaces.hpp"
#include "engine/tissue/bending_forces.hpp"
#include "engine/tissue/deformable_setup.hpp"
#include "engine/tissue/pressure_force.hpp"
#include "engine/tissue/relaxation.hpp"
#include "engine/tissue/solid_setup.hpp"
#include "engine/tissue/tet_forces.hpp"
#include "engine/world/add_body.hpp"
#include "systems/advance/advance.hpp"
#include "systems/output/deformable_energy.hpp"
#include "tests/reference/leapfrog_double.hpp"
namespace trocar {

// A minimal world for tests, stepped by advance_island alone; contact constraints come from closest-point
// queries for every vertex of either body.
struct AdvanceScene : World {
    std::vector<HandTool> tools;
    std::vector<DeviceState> devices;
    uint32_t device_stride = 2;  // for calls of 1 ms: states at their start and end
    std::vector<ToolState> tool_states;
    AdvanceParams params;
    AdvanceScratch scratch;
    EnergyScratch energy_scratch;
    AdvanceResult result;
    double margin = 2e-3;  // m
    bool vertex_constraints_only_of_first = false;

    Surfaces surfaces() const { return surfaces_of(*this); }
    AdvanceInputs inputs() const { return {meshes, springs, bodies, anchors, paths, tools, devices, device_stride, {&solids}}; }

    uint32_t add_mesh(const Mesh& mesh, Admission admission = Admission::kSolid) {
        const uint32_t prototype = add_prototype(meshes, mesh, admission);
        add_springs(springs, meshes, prototype);
        return prototype;
    }
    uint32_t add_body(uint32_t mesh, Motion motion, const Vec3d& origin = Vec3d::Zero(), const Tissue& tissue = {},
                      AnchorFrame frame = AnchorFrame::kWorld, const Quat& orientation = {}) {
        const uint32_t body = trocar::add_body(*this, "body " + std::to_string(bodies.mesh.size()), mesh, motion, tissue, frame);
        bodies.tree[body] = body;
        poses.origin[body] = origin;
        poses.orientation[body] = orientation;
        if (motion == Motion::kDeformable && tissue.pressure_modulus > 0) add_fans(springs, mesh_view(meshes, mesh), mesh);
        if (motion == Motion::kDeformable && tissue.bending > 0) add_hinges(springs, mesh_view(meshes, mesh), mesh);
        if (motion == Motion::kDeformable && is_solid(solids, mesh)) {
            add_solid_body(meshes, springs, solids, poses, body, bodies, particles, anchors);
            give_law(meshes, springs, bodies, body, solids, relaxation);
        } else if (motion == Motion::kDeformable) {
            add_deformable(meshes, springs, poses, body, bodies, particles, anchors);
        }
        return body;
    }
    void add_path(uint32_t body, const std::vector<Keyframe>& keys) {
        paths.body.push_back(body);
        paths.keys.push_back({static_cast<uint32_t>(paths.key.size()), static_cast<uint32_t>(keys.size())});
        paths.key.insert(paths.key.end(), keys.begin(), keys.end());
    }
    Range range(uint32_t body) const { return bodies.particles[body]; }
    Vec3d offset(uint32_t body, uint32_t v) const {
        const Float4& o = particles.offset[range(body).first + v];
        return {o.x, o.y, o.z};
    }
    Vec3d velocity(uint32_t body, uint32_t v) const {
        const uint32_t p = range(body).first + v;
        return {particles.velocity_x[p], particles.velocity_y[p], particles.velocity_z[p]};
    }
    void set_velocity(uint32_t body, uint32_t v, const Vec3d& value) {
        const uint32_t p = range(body).first + v;
        particles.velocity_x[p] = static_cast<float>(value.x());
        particles.velocity_y[p] = static_cast<float>(value.y());
        particles.velocity_z[p] = static_cast<float>(value.z());
    }

    std::vector<uint32_t> moving() const {
        std::vector<uint32_t> list;
        for (uint32_t b = 0; b < bodies.motion.size(); ++b) {
            if (joins_islands(bodies.motion[b])) list.push_back(b);
        }
        return list;
    }

    void add_constraint(uint32_t body, uint32_t vertex, uint32_t other, const Triangle& triangle, const Vec3d& weight,
                        const Vec3d& normal_world, double distance, double friction) {
        contact_constraints.contact.push_back(static_cast<uint32_t>(contact_constraints.body.size()));
        contact_constraints.body.push_back(body);
        contact_constraints.other.push_back(other);
        contact_constraints.vertex.push_back({vertex, vertex});
        contact_constraints.along.push_back(0);
        contact_constraints.third.push_back(kNone);
        contact_constraints.across.push_back(0);
        contact_constraints.triangle.push_back(triangle);
        contact_constraints.weight.push_back(
            {static_cast<float>(weight[0]), static_cast<float>(weight[1]),
             static_cast<float>(1 - static_cast<double>(static_cast<float>(weight[0])) - static_cast<float>(weight[1]))});
        contact_constraints.normal.push_back(is_deformable(bodies, other) ? normal_world
                                                                          : rotate_back(poses.orientation[other], normal_world));
        contact_constraints.distance.push_back(distance);
        contact_constraints.friction.push_back(static_cast<float>(friction));
        contact_constraints.impulse.push_back(Vec3d::Zero());
    }

    void clear_constraints() { contact_constraints = {}; }

    // Constraints for every vertex of `body` nearer than the margin to `other` (or inside it).
    void add_rows(uint32_t body, uint32_t other, double friction) {
        const MeshView view = mesh_view(meshes, bodies.mesh[other]);
        std::unique_ptr<ClosestPointTree> tree =
            is_deformable(bodies, other)
                ? std::make_unique<ClosestPointTree>(
                      view, std::span<const Float4>(particles.offset).subspan(range(other).first, range(other).count))
                : std::make_unique<ClosestPointTree>(view);
        const uint32_t vertices = meshes.info[bodies.mesh[body]].vertices.count;
        const Surfaces s = surfaces();
        for (uint32_t v = 0; v < vertices; ++v) {
            const Vec3d p = world_to_frame(s, other, vertex_position(s, body, v));
            const SurfacePoint hit = tree->query(p);
            if (hit.triangle == kNone || hit.distance > margin) continue;
            const Triangle t = view.triangle[hit.triangle];
            const Vec3d a = vertex_in_frame(s, other, t[0]), b = vertex_in_frame(s, other, t[1]), c = vertex_in_frame(s, other, t[2]);
            const Vec3d u = b - a, w = c - a, q = hit.point - a, n = u.cross(w);
            const double y = q.cross(w).dot(n) / n.squaredNorm(), z = u.cross(q).dot(n) / n.squaredNorm();
            add_constraint(body, v, other, t, {1 - y - z, y, z}, direction_to_world(s, other, hit.normal), hit.distance, friction);
        }
    }
    // Both directions between two bodies.
    void find_constraints(uint32_t a, uint32_t b, double friction) {
        add_rows(a, b, friction);
        add_rows(b, a, friction);
    }

    // One call over all moving bodies and all contact constraints.
    void advance(uint32_t ticks, uint32_t substeps) {
        params.ticks = ticks;
        params.substeps = substeps;
        std::vector<uint32_t> all_constraints(contact_constraints.body.size());
        for (uint32_t i = 0; i < all_constraints.size(); ++i) all_constraints[i] = i;
        tool_states.resize(tools.size());
        result = {};
        AdvanceInputs in = inputs();
        if (!relaxation.body.empty()) in.other.relaxation = &relaxation;
        advance_island(params, in, moving(), all_constraints, scratch, {particles, poses, contact_constraints, tool_states}, result);
        params.tick += ticks;
        add_advance_result(result, energy, report);
    }
    EnergyInputs energy_inputs() const { return {springs, bodies, poses, particles, anchors, params.gravity, {&solids}}; }
    void open_energy_account() {
        energy = {};
        energy_start = {};
        measure();
    }
    void measure() {
        EnergyInputs in = energy_inputs();
        if (!relaxation.body.empty()) in.other.relaxation = &relaxation;
        measure_energy(in, energy_start, energy_scratch, energy);
    }
};

// Closed triangle meshes for tests, metres.
inline Mesh subdivided_sphere(double radius, int levels, double noise = 0, uint32_t seed = 1) {
    Mesh mesh;
    const double t = 0.5 * (1 + std::sqrt(5.0));
    for (const auto& p : {Vec3d(-1, t, 0), Vec3d(1, t, 0), Vec3d(-1, -t, 0), Vec3d(1, -t, 0), Vec3d(0, -1, t), Vec3d(0, 1, t),
                          Vec3d(0, -1, -t), Vec3d(0, 1, -t), Vec3d(t, 0, -1), Vec3d(t, 0, 1), Vec3d(-t, 0, -1), Vec3d(-t, 0, 1)}) {
        mesh.position.push_back(p.normalized());
    }
    mesh.triangle = {{0, 11, 5}, {0, 5, 1}, {0, 1, 7}, {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                     {3, 9, 4},  {3, 4, 2}, {3, 2, 6}, {3, 6, 8},  {3, 8, 9},   {4, 9, 5}, {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
    for (int level = 0; level < levels; ++level) {
        std::vector<std::pair<std::pair<uint32_t, uint32_t>, uint32_t>> middles;
        std::vector<Triangle> finer;
        std::vector<std::vector<std::pair<uint32_t, uint32_t>>> known(mesh.position.size());
        const auto middle = [&](uint32_t a, uint32_t b) {
            if (a > b) std::swap(a, b);
            for (const auto& [far_end, m] : known[a]) {
                if (far_end == b) return m;
            }
            const uint32_t m = static_cast<uint32_t>(mesh.position.size());
            mesh.position.push_back((mesh.position[a] + mesh.position[b]).normalized());
            known[a].push_back({b, m});
            return m;
        };
        for (const Triangle& f : mesh.triangle) {
            const uint32_t a = middle(f[0], f[1]), b = middle(f[1], f[2]), c = middle(f[2], f[0]);
            finer.insert(finer.end(), {{f[0], a, c}, {f[1], b, a}, {f[2], c, b}, {a, b, c}});
        }
        mesh.triangle = std::move(finer);
    }
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> shake(-noise, noise);
    for (Vec3d& p : mesh.position) p *= radius * (1 + shake(random));
    return mesh;
}

inline Mesh flat_square(double half, double z = 0) {
    Mesh mesh;
    mesh.position = {{-half, -half, z}, {half, -half, z}, {half, half, z}, {-half, half, z}};
    mesh.triangle = {{0, 1, 2}, {0, 2, 3}};
    return mesh;
}

// Double-precision copy of one deformable body in its present state.
inline reference::DoubleBody double_copy(const AdvanceScene& s, uint32_t body) {
    reference::DoubleBody b;
    const MeshView view = mesh_view(s.meshes, s.bodies.mesh[body]);
    for (uint32_t v = 0; v < view.position.size(); ++v) {
        const uint32_t p = s.range(body).first + v;
        b.position.push_back(s.offset(body, v));
        b.velocity.push_back(s.velocity(body, v));
        b.inv_mass.push_back(s.particles.offset[p].w);
        b.goal.push_back({s.anchors.rest_x[p], s.anchors.rest_y[p], s.anchors.rest_z[p]});
        b.anchor.push_back(s.anchors.stiffness[p]);
    }
    for (const auto& [i, j] : view.edge) {
        b.spring.push_back({i, j});
        b.rest_length.push_back((view.position[i] - view.position[j]).norm());
    }
    b.stiffness = s.bodies.spring_stiffness[body];
    b.shape = s.bodies.anchor_frame[body] == AnchorFrame::kShape;
    b.damping = s.bodies.tissue[body].damping;
    b.gravity = s.params.gravity;
    b.last_dt = s.particles.last_dt[body];
    return b;
}

}  // namespace trocar
