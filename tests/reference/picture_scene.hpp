#pragma once
#include "components/picture.hpp"
#include "engine/mesh/mesh_topology.hpp"
#include "engine/mesh/surfaces.hpp"
#include "systems/output/picture_snapshot.hpp"
#include "systems/output/surface_normals.hpp"
namespace trocar::reference {

// A minimal world for pictures.
struct PictureScene {
    Meshes meshes;
    Bodies bodies;
    Poses poses;
    Particles particles;
    Contacts contacts;
    Penetrations penetrations;
    Haptics haptics;
    SurfaceNormals normals;
    SurfaceNormalsScratch scratch;

    Surfaces surfaces() const { return {meshes, bodies, poses, particles}; }

    uint32_t add_mesh(const Mesh& mesh, Admission admission = Admission::kSheet) { return add_prototype(meshes, mesh, admission); }
    uint32_t add_body(uint32_t mesh, Motion motion, const Vec3d& origin = Vec3d::Zero(), const Quat& turn = {}) {
        Range rows;
        if (motion == Motion::kDeformable) {
            const MeshView view = mesh_view(meshes, mesh);
            rows = {static_cast<uint32_t>(particles.offset.size()), static_cast<uint32_t>((view.position.size() + 15) / 16 * 16)};
            particles.offset.resize(rows.end());
            for (size_t v = 0; v < view.position.size(); ++v) {
                const Vec3 p = view.position[v].cast<float>();
                particles.offset[rows.first + v] = {p.x(), p.y(), p.z(), 1};
            }
        }
        bodies.mesh.push_back(mesh);
        bodies.motion.push_back(motion);
        bodies.particles.push_back(rows);
        poses.origin.push_back(origin);
        poses.orientation.push_back(turn);
        poses.velocity.push_back(Vec3d::Zero());
        poses.angular_velocity.push_back(Vec3d::Zero());
        return static_cast<uint32_t>(bodies.mesh.size()) - 1;
    }
    void add_contact(uint32_t body, std::array<uint32_t, 2> vertex, double distance) {
        contacts.pair.push_back(0);
        contacts.body.push_back(body);
        contacts.other.push_back(0);
        contacts.vertex.push_back(vertex);
        contacts.along.push_back(vertex[0] == vertex[1] ? 0.0f : 0.5f);
        contacts.third.push_back(kNone);
        contacts.across.push_back(0);
        contacts.point.push_back(vertex_position(surfaces(), body, vertex[0]));
        contacts.closest.push_back(contacts.point.back() - Vec3d(0, 0, distance));
        contacts.normal.push_back(Vec3d::UnitZ());
        contacts.distance.push_back(distance);
        contacts.triangle.push_back(0);
    }
    void write(PictureSnapshot& out, double time = 0) {
        compute_surface_normals(surfaces(), scratch, normals);
        write_picture_snapshot({0, time, surfaces(), normals, contacts, penetrations, haptics}, out);
    }
    PictureSnapshot snapshot() {
        PictureSnapshot out;
        write(out);
        return out;
    }
};

// Square in the plane z = 0, centred, side 2 * half, normal +z, uv (0, 0) at its lower left corner.
inline Mesh make_square(double half, const std::array<float, 3>& colour) {
    Mesh m;
    m.position = {{-half, -half, 0}, {half, -half, 0}, {half, half, 0}, {-half, half, 0}};
    m.triangle = {{0, 1, 2}, {0, 2, 3}};
    m.uv = {{{{0, 0}, {1, 0}, {1, 1}}}, {{{0, 0}, {1, 1}, {0, 1}}}};
    Material material;
    material.diffuse = colour;
    m.material = {material};
    return m;
}

}  // namespace trocar::reference
