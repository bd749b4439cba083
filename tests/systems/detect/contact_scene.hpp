#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <random>
#include <vector>

#include "engine/contact/contact_inputs.hpp"
#include "engine/contact/displacement_bound.hpp"
#include "engine/mesh/contact_kernels.hpp"
#include "engine/mesh/mesh_topology.hpp"
#include "engine/world/add_body.hpp"
#include "systems/detect/broad/body_boxes.hpp"
#include "systems/detect/narrow/penetration.hpp"
#include "systems/frame/state.hpp"
namespace trocar::test {

// Unit cube sphere of 12 n^2 triangles, each point then moved by `shape`.
inline Mesh make_sphere(uint32_t n, const std::function<Vec3d(const Vec3d&)>& shape) {
    Mesh mesh;
    std::map<std::array<int64_t, 3>, uint32_t> known;
    const auto vertex = [&](int face, uint32_t i, uint32_t j) {
        const double u = std::tan((2.0 * i / n - 1) * M_PI / 4), v = std::tan((2.0 * j / n - 1) * M_PI / 4);
        Vec3d p;
        p[face / 2] = face % 2 ? 1 : -1;
        p[(face / 2 + 1) % 3] = face % 2 ? u : -u;
        p[(face / 2 + 2) % 3] = v;
        p.normalize();
        const std::array key{std::llround(p.x() * 1e9), std::llround(p.y() * 1e9), std::llround(p.z() * 1e9)};
        const auto [at, fresh] = known.try_emplace({key[0], key[1], key[2]}, uint32_t(mesh.position.size()));
        if (fresh) mesh.position.push_back(shape(p));
        return at->second;
    };
    for (int face = 0; face < 6; ++face) {
        for (uint32_t j = 0; j < n; ++j) {
            for (uint32_t i = 0; i < n; ++i) {
                const uint32_t a = vertex(face, i, j), b = vertex(face, i + 1, j), c = vertex(face, i + 1, j + 1),
                               d = vertex(face, i, j + 1);
                mesh.triangle.push_back({a, b, c});
                mesh.triangle.push_back({a, c, d});
            }
        }
    }
    return mesh;
}

// Sphere with bumps, so that no two runs of triangles are alike.
inline Mesh make_noisy_sphere(uint32_t n, double radius, double bumps, double phase) {
    return make_sphere(n, [=](const Vec3d& p) {
        const double r =
            1 + bumps * std::sin(7 * p.x() + phase) * std::cos(6 * p.y() - phase) + 0.3 * bumps * std::sin(23 * p.z() + 5 * p.x() + phase);
        return Vec3d(radius * r * p);
    });
}

// Box with cells[k] quads along axis k on its faces.
inline Mesh make_box(const Vec3d& size, const std::array<uint32_t, 3>& cells = {1, 1, 1}) {
    Mesh mesh;
    std::map<std::array<uint32_t, 3>, uint32_t> known;
    const auto vertex = [&](const std::array<uint32_t, 3>& at) {
        const auto [found, fresh] = known.try_emplace(at, uint32_t(mesh.position.size()));
        if (fresh) {
            mesh.position.push_back(Vec3d((double(at[0]) / cells[0] - 0.5) * size.x(), (double(at[1]) / cells[1] - 0.5) * size.y(),
                                          (double(at[2]) / cells[2] - 0.5) * size.z()));
        }
        return found->second;
    };
    for (uint32_t axis = 0; axis < 3; ++axis) {
        const uint32_t u = (axis + 1) % 3, v = (axis + 2) % 3;
        for (uint32_t side = 0; side < 2; ++side) {
            for (uint32_t i = 0; i < cells[u]; ++i) {
                for (uint32_t j = 0; j < cells[v]; ++j) {
                    const auto corner = [&](uint32_t di, uint32_t dj) {
                        std::array<uint32_t, 3> at{};
                        at[axis] = side * cells[axis];
                        at[u] = i + di;
                        at[v] = j + dj;
                        return vertex(at);
                    };
                    const uint32_t a = corner(0, 0), b = corner(1, 0), c = corner(1, 1), d = corner(0, 1);
                    if (side == 1) {
                        mesh.triangle.push_back({a, b, c});
                        mesh.triangle.push_back({a, c, d});
                    } else {
                        mesh.triangle.push_back({a, c, b});
                        mesh.triangle.push_back({a, d, c});
                    }
                }
            }
        }
    }
    return mesh;
}

inline Mesh make_tetrahedron(const std::array<Vec3d, 4>& p) {
    Mesh mesh;
    mesh.position.assign(p.begin(), p.end());
    const bool positive = (p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0]) > 0;
    mesh.triangle = positive ? std::vector<Triangle>{{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}}
                             : std::vector<Triangle>{{0, 1, 2}, {0, 3, 1}, {1, 3, 2}, {2, 3, 0}};
    return mesh;
}

// Torus around z.
inline Mesh make_torus(double ring, double tube, uint32_t around, uint32_t across) {
    Mesh mesh;
    for (uint32_t i = 0; i < around; ++i) {
        for (uint32_t j = 0; j < across; ++j) {
            const double u = 2 * M_PI * i / around, v = 2 * M_PI * j / across, r = ring + tube * std::cos(v);
            mesh.position.push_back(Vec3d(r * std::cos(u), r * std::sin(u), tube * std::sin(v)));
        }
    }
    const auto at = [&](uint32_t i, uint32_t j) { return (i % around) * across + j % across; };
    for (uint32_t i = 0; i < around; ++i) {
        for (uint32_t j = 0; j < across; ++j) {
            mesh.triangle.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
            mesh.triangle.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
        }
    }
    return mesh;
}

// Open square sheet in the plane z = 0.
inline Mesh make_sheet(double size, uint32_t n) {
    Mesh mesh;
    for (uint32_t j = 0; j <= n; ++j) {
        for (uint32_t i = 0; i <= n; ++i) {
            mesh.position.push_back(Vec3d((double(i) / n - 0.5) * size, (double(j) / n - 0.5) * size, 0));
        }
    }
    for (uint32_t j = 0; j < n; ++j) {
        for (uint32_t i = 0; i < n; ++i) {
            const uint32_t a = j * (n + 1) + i, b = a + 1, c = b + n + 1, d = a + n + 1;
            mesh.triangle.push_back({a, b, c});
            mesh.triangle.push_back({a, c, d});
        }
    }
    return mesh;
}

// Arrays of one prototype, in the order of the table of contents of Meshes.
struct BodyInput {
    Mesh mesh;
    Motion motion = Motion::kDeformable;
    Vec3d origin = Vec3d::Zero();
    Quat orientation;
    Admission admission = Admission::kSolid;
    double thickness = 0;
};

// A world of a few bodies at rest without gravity, with the frame's own detection stages. Stages that cull
// constraints, or depend on the preceding pass, are left out, so that the contacts can be compared with brute force;
// they have their own tests.
struct ContactScene : World {
    static constexpr StageId kLeftOut[] = {StageId::kCandidatePairs, StageId::kSeparatingAxisCulling, StageId::kKeptEdges,
                                           StageId::kDeepOverlap,    StageId::kCulledConstraints,     StageId::kRedundantConstraints,
                                           StageId::kEdgeConstraints};
    FrameState frame;       // its world is this one while stages run
    double period = 0.017;  // s

    explicit ContactScene(const std::vector<BodyInput>& inputs) {
        settings.gravity.setZero();
        settings.sleep_speed = 0;
        frame.limits = {.face_queries = 100'000, .direct_tests = 0};
        for (const BodyInput& input : inputs) add(input);
        for (uint32_t body = 0; body < inputs.size(); ++body) {
            const MeshView mesh = mesh_view(meshes, bodies.mesh[body]);
            const Range rows_of_body = bodies.particles[body];
            trees.push_back(is_deformable(bodies, body)
                                ? std::make_unique<ClosestPointTree>(
                                      mesh, std::span<const Float4>(particles.offset).subspan(rows_of_body.first, rows_of_body.count))
                                : std::make_unique<ClosestPointTree>(mesh));
        }
    }

    void add(const BodyInput& input) {
        const uint32_t body = add_body(*this, "body", add_prototype(meshes, input.mesh, input.admission), input.motion);
        bodies.tree[body] = body;
        bodies.thickness[body] = input.thickness;
        poses.origin[body] = input.origin;
        poses.orientation[body] = input.orientation;
        Range range{uint32_t(particles.offset.size()), 0};
        if (input.motion == Motion::kDeformable) {
            range.count = (uint32_t(input.mesh.position.size()) + 15) / 16 * 16;
            for (uint32_t i = 0; i < range.count; ++i) {
                const Vec3d p = i < input.mesh.position.size() ? input.mesh.position[i] : Vec3d(Vec3d::Zero());
                particles.offset.push_back({float(p.x()), float(p.y()), float(p.z()), 1});
            }
            particles.velocity_x.resize(particles.offset.size());
            particles.velocity_y.resize(particles.offset.size());
            particles.velocity_z.resize(particles.offset.size());
        }
        bodies.particles[body] = range;
    }

    Surfaces surfaces() const { return surfaces_of(*this); }
    ContactInputs inputs() const {
        return {settings.contact, period, fall_in_period(settings.gravity, period), surfaces(), boxes, pairs, trees};
    }

    // One stage of the frame table, if this world wants it.
    void run_stage(const FrameStage& stage) {
        clock.period = uint32_t(std::lround(1e3 * period));
        std::swap(frame.world, static_cast<World&>(*this));
        if (stage.wanted(frame.world)) stage.stage.run(frame);
        std::swap(frame.world, static_cast<World&>(*this));
    }
    // The detection stages up to one, except those left out.
    void run_until(StageId last) {
        for (const FrameStage& stage : frame_stages()) {
            const bool left_out = std::ranges::find(kLeftOut, stage.id) != std::end(kLeftOut);
            if (stage.part == FramePart::kDetection && stage.id <= last && !left_out) run_stage(stage);
            if (stage.id == StageId::kCandidatePairs) pairs = box_pairs;
        }
    }
    void find_triangles() { run_until(StageId::kCandidateCells); }
    void run() { run_until(StageId::kIslands); }
    void run_with_regions() {
        settings.contact.regions = true;
        run();
    }
    void clear_caches() { frame.scratch = {}; }
};

inline Quat turn(const Vec3d& axis, double angle) { return from_rotation_vector(axis.normalized() * angle); }

}  // namespace trocar::test
