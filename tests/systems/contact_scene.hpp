#pragma once
#include <array>
#include <functional>
#include <map>
#include <memory>
#include <random>
#include <vector>

#include "engine/contact_inputs.hpp"
#include "engine/geometry/contact_kernels.hpp"
#include "engine/mesh_topology.hpp"
#include "systems/body_boxes.hpp"
#include "systems/candidate_cells.hpp"
#include "systems/candidate_pairs.hpp"
#include "systems/contact_rows.hpp"
#include "systems/contours.hpp"
#include "systems/edge_pass.hpp"
#include "systems/face_depth.hpp"
#include "systems/islands.hpp"
#include "systems/overlap.hpp"
#include "systems/penetration.hpp"
#include "systems/rasterise.hpp"
#include "systems/refit_trees.hpp"
#include "systems/regions.hpp"
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

// Sphere with bumps, so that no two runs of triangles look alike.
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

// Rows of one prototype, in the order of the table of contents of Meshes.
struct BodyInput {
    Mesh mesh;
    Motion motion = Motion::kDeformable;
    Vec3d origin = Vec3d::Zero();
    Quat orientation;
    Admission admission = Admission::kSolid;
    double thickness = 0;
};

// Bodies, their trees and every array of the contact stages: what frame.cpp would hand from system to system.
struct ContactScene {
    Meshes meshes;
    Bodies bodies;
    Poses poses;
    Particles particles;
    std::vector<std::unique_ptr<ClosestPointTree>> trees;
    ContactParams params;
    double period = 1.0 / 60, fall = 0;
    std::vector<std::array<uint32_t, 2>> excluded;

    BodyBoxes boxes;
    CandidatePairs pairs;
    ScreenedTriangles screened;
    Occupancy occupancy;
    CandidateTriangles candidates;
    NearVertices near;
    Contacts contacts;
    Penetrations penetrations;
    Contours contours;
    OverlapRegions regions;
    ContactRows rows;
    Islands islands;
    Report report;

    CandidatePairsScratch pairs_scratch;
    RefitTreesScratch refit_scratch;
    RasteriseScratch rasterise_scratch;
    CandidateCellsScratch cells_scratch;
    OverlapScratch overlap_scratch;
    EdgePassScratch edge_scratch;
    FaceDepthScratch face_scratch;
    ContoursScratch contours_scratch;
    RegionsScratch regions_scratch;
    ContactRowsScratch rows_scratch;
    IslandsScratch islands_scratch;

    explicit ContactScene(const std::vector<BodyInput>& inputs) {
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
        const uint32_t body = uint32_t(bodies.mesh.size());
        bodies.mesh.push_back(add_prototype(meshes, input.mesh, input.admission));
        bodies.entity.push_back({body, 0});
        bodies.name.emplace_back("body");
        bodies.motion.push_back(input.motion);
        bodies.tree.push_back(body);
        bodies.anchor_frame.push_back(AnchorFrame::kWorld);
        bodies.tissue.push_back({});
        bodies.spring_stiffness.push_back(0);
        bodies.inv_mass.push_back(0);
        bodies.stable_dt.push_back(1);
        bodies.thickness.push_back(input.thickness);
        poses.origin.push_back(input.origin);
        poses.orientation.push_back(input.orientation);
        poses.velocity.push_back(Vec3d::Zero());
        poses.angular_velocity.push_back(Vec3d::Zero());
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
        bodies.particles.push_back(range);
    }

    Surfaces surfaces() const { return {meshes, bodies, poses, particles}; }
    ContactInputs inputs() const { return {params, period, fall, surfaces(), boxes, pairs, trees}; }

    void find_triangles() {
        compute_body_boxes(period, surfaces(), boxes);
        find_candidate_pairs(bodies, boxes, excluded, pairs_scratch, pairs);
        refit_trees(bodies, particles, pairs, refit_scratch, trees);
        rasterise(inputs(), 0, rasterise_scratch, report, screened, occupancy);
        find_candidate_triangles(inputs(), {}, screened, occupancy, cells_scratch, candidates);
    }
    void run() {
        find_triangles();
        find_overlap(inputs(), screened, candidates, overlap_scratch, report, near, contacts);
        find_edge_contacts(inputs(), candidates, near, edge_scratch, report, contacts);
        if (params.faces) find_face_contacts(inputs(), 100'000, screened, candidates, near, face_scratch, contacts);
        measure_penetrations(pairs, contacts, penetrations);
        make_contact_rows(inputs(), contacts, penetrations, rows_scratch, report, rows);
        find_islands(bodies, rows, islands_scratch, islands);
    }
    void run_with_regions() {
        run();
        find_contours(inputs(), candidates, contours_scratch, contours);
        trocar::find_regions(inputs(), screened, near, contacts, contours, regions_scratch, regions);
    }
    void clear_caches() {
        pairs_scratch = {};
        rasterise_scratch = {};
        cells_scratch = {};
        overlap_scratch = {};
        edge_scratch = {};
    }
};

inline Quat turn(const Vec3d& axis, double angle) { return from_rotation_vector(axis.normalized() * angle); }

}  // namespace trocar::test
