#include "content/build_scene.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "content/load_mesh.hpp"
#include "content/make_prototype.hpp"
#include "content/shape_library.hpp"
#include "engine/deformable_setup.hpp"
#include "engine/device.hpp"
#include "engine/error.hpp"
#include "engine/mesh_topology.hpp"
namespace trocar {
namespace fs = std::filesystem;
namespace {

std::string at(const SceneFile& scene, uint32_t line) {
    return scene.path.string() + ":" + std::to_string(line) + ":1: ";
}

fs::path find_file(const SceneFile& scene, const std::string& name) {
    const fs::path given(name);
    std::error_code error;
    if (given.is_absolute() || fs::exists(given, error)) return given;
    return scene.path.parent_path() / given;
}

Mesh load_body_mesh(const SceneFile& scene, const BodySpec& body, std::vector<std::string>& warnings) {
    if (!body.file.empty()) {
        LoadedMesh loaded = load_mesh(find_file(scene, body.file));
        warnings.insert(warnings.end(), loaded.warnings.begin(), loaded.warnings.end());
        return std::move(loaded.mesh);
    }
    const std::vector<std::string> names = shape_names();
    if (std::find(names.begin(), names.end(), body.shape) == names.end()) {
        std::string list;
        for (const std::string& n : names) list += (list.empty() ? "" : ", ") + n;
        throw InputError(at(scene, body.line) + "no shape \"" + body.shape + "\"; there are " + list);
    }
    return make_shape(body.shape, body.triangles, body.seed);
}

// Factor from file units to metres.
double mesh_scale(const BodySpec& body, const Mesh& mesh) {
    Box box;
    for (const Vec3d& p : mesh.position) box.min = box.min.cwiseMin(p), box.max = box.max.cwiseMax(p);
    const Vec3d extent = box.max - box.min;
    if (body.size > 0) return body.size / std::max(extent.maxCoeff(), 1e-300);
    if (body.scale > 0) return body.scale;
    return extent.norm() > 3 ? 1e-3 : 1.0;  // an organ of three metres is one in millimetres
}

Box world_box(const World& world, uint32_t body) {
    const MeshInfo& info = world.meshes.info[world.bodies.mesh[body]];
    Box box;
    for (uint32_t v = 0; v < info.vertices.count; ++v) {
        const Vec3d p = world.poses.origin[body] +
                        rotate(world.poses.orientation[body], world.meshes.position[info.vertices.first + v]);
        box.min = box.min.cwiseMin(p), box.max = box.max.cwiseMax(p);
    }
    return box;
}

void place_above(const SceneFile& scene, const BodySpec& spec, World& world, uint32_t body) {
    const auto& names = world.bodies.name;
    const auto found = std::find(names.begin(), names.begin() + body, spec.above);
    if (found == names.begin() + body)
        throw InputError(at(scene, spec.line) + "above = \"" + spec.above + "\" names no body before \"" + spec.name +
                         "\"");
    const Box below = world_box(world, static_cast<uint32_t>(found - names.begin())), own = world_box(world, body);
    Vec3d shift = 0.5 * (below.min + below.max - own.min - own.max);
    shift.z() = below.max.z() + spec.gap - own.min.z();
    world.poses.origin[body] += shift + Vec3d(spec.position.x(), spec.position.y(), 0);
}

std::string body_note(const World& world, uint32_t body, const Prototype& made) {
    constexpr const char* kMotions[] = {"static", "kinematic", "hand", "deformable"};
    const MeshInfo& info = world.meshes.info[world.bodies.mesh[body]];
    char text[256];
    std::snprintf(text, sizeof text, "%s: %u vertices, %u triangles, %s, %.1f ml", world.bodies.name[body].c_str(),
                  info.vertices.count, info.triangles.count, kMotions[static_cast<size_t>(world.bodies.motion[body])],
                  info.volume * 1e6);
    std::string note = text;
    if (is_deformable(world.bodies, body)) {
        std::snprintf(text, sizeof text, ", E %.3g Pa, explicit step at most %.3g ms",
                      world.bodies.tissue[body].youngs_modulus, world.bodies.stable_dt[body] * 1e3);
        note += text;
    }
    const std::string changes = describe_cleaning(made.cleaning);
    if (!changes.empty()) note += "; " + changes;
    return note;
}

void fix_vertices_below(World& world, uint32_t body, double z) {
    const MeshInfo& info = world.meshes.info[world.bodies.mesh[body]];
    const Range particles = world.bodies.particles[body];
    for (uint32_t v = 0; v < info.vertices.count; ++v)
        if (world.meshes.position[info.vertices.first + v].z() < z) world.particles.offset[particles.first + v].w = 0;
}

void add_path(Paths& paths, uint32_t body, const std::vector<KeyframeSpec>& keys) {
    paths.body.push_back(body);
    paths.keys.push_back({static_cast<uint32_t>(paths.key.size()), static_cast<uint32_t>(keys.size())});
    for (const KeyframeSpec& k : keys) paths.key.push_back({k.time, k.position, k.orientation, k.jump});
}

Camera make_camera(const CameraSpec& spec) {
    Camera camera;
    camera.kind = spec.kind == "laparoscope" ? CameraKind::kLaparoscope : CameraKind::kOrbit;
    camera.target = spec.target;
    camera.position = spec.position;
    camera.azimuth = spec.azimuth * std::numbers::pi / 180;
    camera.elevation = spec.elevation * std::numbers::pi / 180;
    camera.field_of_view = spec.fov * std::numbers::pi / 180;
    camera.distance = spec.distance;
    return camera;
}

}  // namespace

}  // namespace trocar
