#include <cstdio>
#include <trocar/content/scene/make_prototype.hpp>
#include <trocar/content/shapes/shape_library.hpp>
#include <trocar/engine/distance/closest_point.hpp>
#include <trocar/engine/jobs/thread_pool.hpp>
#include <trocar/systems/haptics/live_haptics.hpp>

// An external program that uses the installed library: is a point inside a generated liver?
int main() {
    trocar::set_float_mode();
    trocar::Meshes meshes;
    const auto liver = trocar::make_prototype(meshes, trocar::make_shape("liver", 1000), {});
    const trocar::ClosestPointTree tree(trocar::mesh_view(meshes, liver.row));
    const trocar::SurfacePoint inside = tree.query(trocar::Vec3d::Zero());
    const trocar::SurfacePoint outside = tree.query(trocar::Vec3d(1, 0, 0));
    std::printf("distance of the centre %.4f m, of a point outside %.4f m\n", inside.distance, outside.distance);
    const trocar::LiveHaptics nobody(trocar::haptic_params(60), {});  // the live loop's half is linked too
    return inside.distance < 0 && outside.distance > 0.5 ? 0 : 1;
}
