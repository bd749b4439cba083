#include "content/scene/make_prototype.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <string>

#include "engine/base/check.hpp"
#include "engine/geometry/edge_table.hpp"
#include "engine/mesh/mesh_topology.hpp"
namespace trocar {
namespace {

Vec3d box_centre(const Mesh& mesh) {
    if (mesh.position.empty()) return Vec3d::Zero();
    Box box;
    for (const Vec3d& p : mesh.position) grow(box, p);
    return 0.5 * (box.min + box.max);
}

bool is_closed(const Mesh& mesh) {
    const EdgeTable table = make_edge_table(mesh.triangle, static_cast<uint32_t>(mesh.position.size()));
    for (uint32_t e = 0; e < table.edge.size(); ++e) {
        if (table.users(e).size() % 2 != 0) return false;
    }
    return true;
}

// First material that is missing or whose image size is inconsistent; empty if there is none.
std::string find_bad_material(const Mesh& mesh) {
    std::string reason;
    const size_t materials = std::max<size_t>(1, mesh.material.size());
    for (size_t t = 0; reason.empty() && t < mesh.triangle_material.size(); ++t) {
        if (mesh.triangle_material[t] >= materials)
            reason = "face " + std::to_string(t) + ": names material " + std::to_string(mesh.triangle_material[t]) + " of " +
                     std::to_string(materials);
    }
    for (size_t m = 0; reason.empty() && m < mesh.material.size(); ++m) {
        const Image& image = mesh.material[m].image;
        if (image.rgba.size() != size_t{4} * image.width * image.height)
            reason = "material " + std::to_string(m) + ": image of " + std::to_string(image.rgba.size()) + " bytes is not " +
                     std::to_string(image.width) + " x " + std::to_string(image.height) + " pixels";
    }
    return reason;
}

}  // namespace

Vec3d find_centroid(const Mesh& mesh) {
    // about the centre of the box, to avoid cancellation
    const Vec3d middle = box_centre(mesh);
    double volume = 0, area = 0, size = 0;
    Vec3d volume_moment = Vec3d::Zero(), area_moment = Vec3d::Zero();
    for (const Triangle& t : mesh.triangle) {
        const Vec3d a = mesh.position[t[0]] - middle, b = mesh.position[t[1]] - middle, c = mesh.position[t[2]] - middle;
        const double cone = a.dot(b.cross(c)) / 6;
        const double face = 0.5 * (b - a).cross(c - a).norm();
        volume += cone;
        volume_moment += cone / 4 * (a + b + c);
        area += face;
        area_moment += face / 3 * (a + b + c);
        size = std::max({size, a.norm(), b.norm(), c.norm()});
    }
    if (is_closed(mesh) && std::abs(volume) > 1e-12 * area * size) return middle + volume_moment / volume;
    return area > 0 ? Vec3d(middle + area_moment / area) : middle;
}

Prototype make_prototype(Meshes& meshes, Mesh mesh, const PrototypeOptions& options) {
    TROCAR_ASSERT(std::isfinite(options.scale) && options.scale > 0);
    Prototype out;
    out.judgement.reason = find_bad_material(mesh);
    if (!out.judgement.reason.empty()) return out;
    out.cleaning = clean_mesh(mesh, options.clean);
    if (!out.cleaning.refused) {
        for (Vec3d& p : mesh.position) p *= options.scale;
        if (options.recentre == Recentre::kBoxCentre) out.shift = box_centre(mesh);
        if (options.recentre == Recentre::kVolumeCentroid) out.shift = find_centroid(mesh);
        for (Vec3d& p : mesh.position) p -= out.shift;
        order_for_locality(mesh);
    }
    out.judgement = judge_mesh(mesh, options.test_self_crossing);
    if (out.judgement.admitted_as != Admission::kRefused) {
        out.row = add_prototype(meshes, mesh, out.judgement.admitted_as);
    }
    return out;
}

}  // namespace trocar
