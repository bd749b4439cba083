#pragma once
#include <vector>

#include "engine/mesh/mass_properties.hpp"
#include "engine/motion/free_rotation.hpp"
#include "engine/tissue/tet_forces.hpp"
namespace trocar {

// Linear momentum (kg m/s) and angular momentum about the world origin (kg m^2/s) of one deformable or free body, at the time of
// its velocities.
struct Momentum {
    Vec3d linear = Vec3d::Zero();
    Vec3d angular = Vec3d::Zero();
};
inline Momentum measure_momentum(const Bodies& bodies, const Poses& poses, const Particles& particles, uint32_t body) {
    const Range rows = bodies.particles[body];
    const double back = 0.5 * particles.last_dt[body];
    Momentum sum;
    if (const RigidMass* free = find_rigid_mass(bodies, body)) {
        const Vec3d arm = rotate(poses.orientation[body], free->centre);
        const Vec3d velocity = poses.velocity[body] + poses.angular_velocity[body].cross(arm);
        const Vec3d position = poses.origin[body] + arm - back * velocity;
        sum.linear = free->mass * velocity;
        sum.angular = position.cross(sum.linear) +
                      momentum_of(free->moments, multiply(poses.orientation[body], free->axes), poses.angular_velocity[body]);
    }
    for (uint32_t p = rows.first; p < rows.end(); ++p) {
        const Float4& o = particles.offset[p];
        if (!(o.w > 0)) continue;
        const Vec3d velocity(particles.velocity_x[p], particles.velocity_y[p], particles.velocity_z[p]);
        const Vec3d position = poses.origin[body] + Vec3d(o.x, o.y, o.z) - back * velocity;
        sum.linear += velocity / o.w;
        sum.angular += position.cross(velocity) / o.w;
    }
    return sum;
}

// Signed volume / rest volume of every tetrahedron of a body as it stands.
inline std::vector<double> volume_ratios(const Solids& solids, const Bodies& bodies, const Particles& particles, uint32_t body) {
    const SolidInfo& info = solids.info[bodies.mesh[body]];
    const TetStep step = bind_tets(solids, bodies, particles, body);
    const auto position = [&](uint32_t node) {
        return Vec3d(step.offset[4ul * node], step.offset[4ul * node + 1], step.offset[4ul * node + 2]);
    };
    std::vector<double> ratio(info.count);
    for (uint32_t t = 0; t < ratio.size(); ++t) {
        const Vec3d a = position(step.corner0[t]), b = position(step.corner1[t]), c = position(step.corner2[t]),
                    d = position(step.corner3[t]);
        ratio[t] = (b - a).dot((c - a).cross(d - a)) / step.rest[t];
    }
    return ratio;
}

}  // namespace trocar
