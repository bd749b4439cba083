#include "systems/deformable_energy.hpp"

#include <algorithm>
#include <array>

#include "engine/bending_forces.hpp"
#include "engine/free_rotation.hpp"
#include "engine/mass_properties.hpp"
#include "engine/node_drive.hpp"
#include "engine/parallel.hpp"
#include "engine/pressure_force.hpp"
#include "engine/shape_fit.hpp"
#include "engine/spring_step.hpp"
#include "engine/surfaces.hpp"
#include "engine/tet_forces.hpp"
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

void add_other_energies(const Springs& springs, const Bodies& bodies, const Particles& particles, uint32_t body, float back,
                        BodyEnergyScratch& scratch, Energy& energy) {
    if (!has_pressure(bodies, body) && !has_bending(bodies, body)) return;
    const uint32_t skin = springs.info[bodies.mesh[body]].skin;
    const Range rows{bodies.particles[body].first + skin, bodies.particles[body].count - skin};
    look_back(particles, rows, back, scratch.offset);
    if (has_bending(bodies, body)) {
        energy.bending +=
            find_bending_energy(springs, bodies.mesh[body], bending_rigidity(bodies.tissue[body]), scratch.offset.data(), scratch.sums);
    }
    if (!has_pressure(bodies, body)) return;
    scratch.gradient.resize(size_t{3} * rows.count);
    float* g = scratch.gradient.data();
    const double volume =
        find_volume_gradient(springs, bodies.mesh[body], scratch.offset.data(), scratch.sums, g, g + rows.count, g + 2 * rows.count);
    energy.pressure += find_pressure_energy(springs, bodies, body, volume);
}

// Of a free body at the time of its velocities.
void add_free_energy(const RigidMass& free, const Poses& poses, const Particles& particles, const Vec3d& gravity, Energy& energy) {
    const uint64_t body = free.body;
    const Vec3d arm = rotate(poses.orientation[body], free.centre);
    const Vec3d velocity = poses.velocity[body] + poses.angular_velocity[body].cross(arm);
    const Vec3d place = poses.origin[body] + arm - 0.5 * particles.last_dt[body] * velocity;
    const Vec3d turning = momentum_of(free.moments, multiply(poses.orientation[body], free.axes), poses.angular_velocity[body]);
    energy.kinetic += 0.5 * free.mass * velocity.squaredNorm() + 0.5 * turning.dot(poses.angular_velocity[body]);
    energy.gravity -= free.mass * gravity.dot(place);
}

}  // namespace

void add_body_energy(const EnergyInputs& inputs, uint32_t body, BodyEnergyScratch& scratch, Energy& energy) {
    const auto& [springs, bodies, poses, particles, anchors, gravity, other] = inputs;
    if (const RigidMass* free = find_rigid_mass(bodies, body)) return add_free_energy(*free, poses, particles, gravity, energy);
    if (!is_deformable(bodies, body)) return;
    const uint32_t slices = springs.info[bodies.mesh[body]].slices.count;
    SpringStep step = bind_body(springs, bodies, anchors, particles, body, other.torn_springs);
    step.back = static_cast<float>(0.5 * particles.last_dt[body]);
    if (bodies.anchor_frame[body] == AnchorFrame::kShape) {
        Quat orientation = poses.orientation[body];
        fit_goals(sum_shape(step, slices, scratch.sums), orientation, step);
    }
    const std::array<double, kEnergySums> t = sum_energy(step, slices, scratch.sums);
    energy.kinetic += 0.5 * t[kSumMvv];
    // every spring was met from both its ends
    energy.elastic += 0.25 * step.stiffness * t[kSumStretch] + 0.5 * t[kSumAnchor];
    add_other_energies(springs, bodies, particles, body, step.back, scratch, energy);
    if (has_tets(other.solids, bodies, body)) {
        energy.elastic +=
            tet_energy(*other.solids, bodies, particles, body, 0.5 * particles.last_dt[body], scratch.tets, other.torn_springs);
    }
    energy.gravity -= gravity.dot(t[kSumMass] * poses.origin[body] + Vec3d(t[kSumMPlace], t[kSumMPlace + 1], t[kSumMPlace + 2]));
}

void measure_energy(const EnergyInputs& inputs, double start, EnergyScratch& scratch, Energy& energy, const Sleepers& sleepers) {
    const Bodies& bodies = inputs.bodies;
    const OtherForces& other = inputs.other;
    energy.kinetic = energy.elastic = energy.pressure = energy.bending = energy.links = energy.gravity = 0;
    if (scratch.of_body.size() != bodies.motion.size()) {
        scratch.of_body.assign(bodies.motion.size(), {});
        std::fill(sleepers.seen.begin(), sleepers.seen.end(), 0);
    }
    const uint32_t count = static_cast<uint32_t>(bodies.motion.size());
    const uint32_t grain = std::max(1u, chunk_count(count, static_cast<uint32_t>(scratch.part.size())));
    parallel_for(count, grain, [&](uint32_t begin, uint32_t end) {
        for (uint32_t body = begin; body < end; ++body) {
            if (!is_deformable(bodies, body) || was_seen(sleepers, body)) continue;
            scratch.of_body[body] = {};
            add_body_energy(inputs, body, scratch.part[begin / grain], scratch.of_body[body]);
        }
    });
    for (uint32_t body = 0; body < count; ++body) {
        if (!is_deformable(bodies, body)) continue;
        const Energy& own = scratch.of_body[body];
        energy.kinetic += own.kinetic, energy.elastic += own.elastic, energy.pressure += own.pressure;
        energy.bending += own.bending, energy.gravity += own.gravity;
    }
    for (const RigidMass& free : bodies.rigid_mass) add_free_energy(free, inputs.poses, inputs.particles, inputs.gravity, energy);
    if (other.nodes) {
        for (size_t i = 0; i < other.nodes->drive.size(); ++i) {
            const DriveState& state = other.node_state->drive[i];
            const double back = 0.5 * inputs.particles.last_dt[other.nodes->drive[i].body];
            energy.elastic += drive_energy(other.nodes->drive[i], state.place - back * state.rate);
        }
    }
    if (other.links) {
        for (const LinkGroup& g : other.links->group) {
            for (uint32_t row = g.rows.first; row < g.rows.end(); ++row) {
                const double stretch = other.links->whole[row] ? other.links->stretch[row] : 0;
                energy.links += 0.5 * g.stiffness * stretch * stretch;
            }
        }
    }
    energy.balance = energy.kinetic + energy.elastic + energy.pressure + energy.bending + energy.links + energy.gravity - energy.work_hand -
                     energy.work_contact - energy.work_damping - energy.work_push - energy.work_numeric - energy.work_links - start;
}

}  // namespace trocar
