#include "engine/tissue/body_energy.hpp"

#include <array>

#include "engine/mesh/mass_properties.hpp"
#include "engine/mesh/surfaces.hpp"
#include "engine/motion/free_rotation.hpp"
#include "engine/tissue/bending_forces.hpp"
#include "engine/tissue/pressure_force.hpp"
#include "engine/tissue/relaxation.hpp"
#include "engine/tissue/shape_fit.hpp"
#include "engine/tissue/spring_step.hpp"
namespace trocar {
namespace {

// Where the particles of a body were half a substep back.
void look_back(const Particles& particles, Range rows, float back, std::vector<Float4>& offset) {
    offset.resize(rows.count);
    for (uint32_t i = 0; i < rows.count; ++i) {
        const uint32_t p = rows.first + i;
        const Float4& o = particles.offset[p];
        offset[i] = {o.x - back * particles.velocity_x[p], o.y - back * particles.velocity_y[p], o.z - back * particles.velocity_z[p], o.w};
    }
}

void add_other_energies(const Springs& springs, const Bodies& bodies, const Particles& particles, uint32_t body, float back, double share,
                        BodyEnergyScratch& scratch, Energy& energy) {
    if (!has_pressure(bodies, body) && !has_bending(bodies, body)) return;
    const uint32_t skin = springs.info[bodies.mesh[body]].skin;
    const Range rows{bodies.particles[body].first + skin, bodies.particles[body].count - skin};
    look_back(particles, rows, back, scratch.offset);
    if (has_bending(bodies, body)) {
        energy.bending += share * find_bending_energy(springs, bodies.mesh[body], bending_rigidity(bodies.tissue[body]),
                                                      scratch.offset.data(), scratch.sums);
    }
    if (!has_pressure(bodies, body)) return;
    scratch.gradient.resize(size_t{3} * rows.count);
    float* g = scratch.gradient.data();
    const double volume =
        find_volume_gradient(springs, bodies.mesh[body], scratch.offset.data(), scratch.sums, g, g + rows.count, g + 2 * rows.count);
    energy.pressure += share * find_pressure_energy(springs, bodies, body, volume);
}

// Adds `share` of the potential energies of springs, anchors, bending, pressure and tetrahedra where the body was `back`
// (s) ago. Returns the sums over its particles at that time.
std::array<double, kEnergySums> add_potentials(const EnergyInputs& in, uint32_t body, double back, double share, SpringStep& step,
                                               BodyEnergyScratch& scratch, Energy& energy) {
    step.back = static_cast<float>(back);
    const std::array<double, kEnergySums> t = sum_energy(step, in.springs.info[in.bodies.mesh[body]].slices.count, scratch.sums);
    // every spring was met from both its ends
    energy.elastic += share * (0.25 * step.stiffness * t[kSumStretch] + 0.5 * t[kSumAnchor]);
    if (in.other.relaxation) {
        bind_relaxation(in.other.relaxation, in.bodies, body, in.particles.last_dt[body] - back, step);
        if (step.branches > 0)
            energy.elastic += share * relaxing_energy(step, in.springs.info[in.bodies.mesh[body]].slices.count, scratch.sums);
    }
    add_other_energies(in.springs, in.bodies, in.particles, body, step.back, share, scratch, energy);
    if (has_tets(in.other.solids, in.bodies, body))
        energy.elastic += share * tet_energy(*in.other.solids, in.bodies, in.particles, body, back, scratch.tets, in.other.torn_springs);
    return t;
}

}  // namespace

// At the time of its velocities.
void add_free_energy(const RigidMass& free, const Poses& poses, const Particles& particles, const Vec3d& gravity, Energy& energy) {
    const uint64_t body = free.body;
    const Vec3d arm = rotate(poses.orientation[body], free.centre);
    const Vec3d velocity = poses.velocity[body] + poses.angular_velocity[body].cross(arm);
    const Vec3d position = poses.origin[body] + arm - 0.5 * particles.last_dt[body] * velocity;
    const Vec3d turning = momentum_of(free.moments, multiply(poses.orientation[body], free.axes), poses.angular_velocity[body]);
    energy.kinetic += 0.5 * free.mass * velocity.squaredNorm() + 0.5 * turning.dot(poses.angular_velocity[body]);
    energy.gravity -= free.mass * gravity.dot(position);
}

void add_body_energy(const EnergyInputs& inputs, uint32_t body, BodyEnergyScratch& scratch, Energy& energy) {
    const auto& [springs, bodies, poses, particles, anchors, gravity, other] = inputs;
    if (const RigidMass* free = find_rigid_mass(bodies, body)) return add_free_energy(*free, poses, particles, gravity, energy);
    if (!is_deformable(bodies, body)) return;
    const uint32_t slices = springs.info[bodies.mesh[body]].slices.count;
    SpringStep step = bind_body(springs, bodies, anchors, particles, body, other.torn_springs);
    const double half = 0.5 * particles.last_dt[body];
    step.back = static_cast<float>(half);
    if (bodies.anchor_frame[body] == AnchorFrame::kShape) {
        Quat orientation = poses.orientation[body];
        fit_goals(sum_shape(step, slices, scratch.sums), orientation, step);
    }
    const std::array<double, kEnergySums> t = add_potentials(inputs, body, half, 1, step, scratch, energy);
    energy.kinetic += 0.5 * t[kSumMvv];
    energy.gravity -= gravity.dot(t[kSumMass] * poses.origin[body] + Vec3d(t[kSumMPosition], t[kSumMPosition + 1], t[kSumMPosition + 2]));
    if (!other.actions || half == 0) return;
    // 2 V(middle) - (V(start) + V(end)) / 2: see the header
    add_potentials(inputs, body, half, 1, step, scratch, energy);
    add_potentials(inputs, body, 0, -0.5, step, scratch, energy);
    add_potentials(inputs, body, 2 * half, -0.5, step, scratch, energy);
}

}  // namespace trocar
