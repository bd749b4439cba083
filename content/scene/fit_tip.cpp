#include "content/scene/fit_tip.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdio>
#include <limits>

#include "engine/mesh/mesh_view.hpp"
namespace trocar {
namespace {

constexpr double kFits = 0.02;      // of the radius
constexpr double kFaceted = 1.05;   // vertices at most this much farther than faces belong to a ball
constexpr double kDefault = 0.006;  // m

// Centre of the ball inside to which the distance from the surface grows, away from the nearest surface, from a point on it.
Vec3d ball_from(const ClosestPointTree& tree, const Vec3d& point, const Vec3d& normal, double size) {
    Vec3d centre = point - 1e-3 * size * normal;
    SurfacePoint nearest = tree.query(centre);
    for (double share = 0.5; share > 1e-3 && nearest.distance < 0;) {
        const Vec3d next = centre + share * (centre - nearest.point);
        const SurfacePoint there = tree.query(next);
        if (there.distance < (1 + 1e-4) * nearest.distance)
            centre = next, nearest = there;
        else
            share *= 0.5;
    }
    return centre;
}

}  // namespace

std::string fit_tip(const World& world, bool tip_given, HandTool& tool) {
    const MeshView mesh = mesh_view(world.meshes, world.bodies.mesh[tool.body]);
    if (!has_inside(mesh.info->admission)) {
        if (tool.tip_radius == 0) tool.tip_radius = kDefault;
        return {};
    }
    const ClosestPointTree tree(mesh);
    const std::string name = "tool \"" + world.bodies.name[tool.body] + "\": ";
    char text[200];
    std::string moved;
    SurfacePoint nearest = tree.query(tool.tip);
    if (nearest.distance >= 0 && !tip_given) {
        tool.tip = ball_from(tree, nearest.point, nearest.normal, mesh.info->radius);
        nearest = tree.query(tool.tip);
        std::snprintf(text, sizeof text, "the origin is outside its mesh: tip = [%.6g, %.6g, %.6g] is taken", tool.tip.x(), tool.tip.y(),
                      tool.tip.z());
        moved = name + text;
    }
    const double inner = -nearest.distance;
    if (!(inner > 0)) {
        if (tool.tip_radius == 0) tool.tip_radius = kDefault;
        std::snprintf(text, sizeof text, "its tip is %.3g mm outside its mesh: what it feels is not what presses", -1e3 * inner);
        return name + text;
    }
    double outer = std::numeric_limits<double>::infinity();
    for (const Vec3d& vertex : mesh.position) outer = std::min(outer, (vertex - tool.tip).norm());
    const double largest = outer <= kFaceted * inner ? outer : inner;
    if (tool.tip_radius == 0) {
        tool.tip_radius = largest;
    } else if (tool.tip_radius < (1 - kFits) * inner || tool.tip_radius > (1 + kFits) * largest) {
        std::snprintf(text, sizeof text,
                      "tip_radius is %.4g mm, but a ball of %.4g mm around its tip fits its mesh: it feels another force than presses",
                      1e3 * tool.tip_radius, 1e3 * largest);
        return name + text;
    }
    return moved;
}

}  // namespace trocar
