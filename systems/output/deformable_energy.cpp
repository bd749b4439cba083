#include "systems/output/deformable_energy.hpp"

#include <algorithm>

#include "engine/jobs/parallel.hpp"
#include "engine/mesh/surfaces.hpp"
#include "engine/motion/node_drive.hpp"
#include "engine/thread/rod.hpp"
#include "engine/tissue/link_energy.hpp"
namespace trocar {

void measure_energy(const EnergyInputs& inputs, EnergyStart& start, EnergyScratch& scratch, Energy& energy,
                    const SleepingBodies& sleeping_bodies) {
    const Bodies& bodies = inputs.bodies;
    const OtherForces& other = inputs.other;
    energy.kinetic = energy.elastic = energy.pressure = energy.bending = energy.links = energy.gravity = 0;
    if (scratch.of_body.size() != bodies.motion.size()) {
        scratch.of_body.assign(bodies.motion.size(), {});
        std::fill(sleeping_bodies.seen.begin(), sleeping_bodies.seen.end(), 0);
    }
    const uint32_t count = static_cast<uint32_t>(bodies.motion.size());
    const uint32_t grain = std::max(1u, chunk_count(count, static_cast<uint32_t>(scratch.part.size())));
    parallel_for(count, grain, [&](uint32_t begin, uint32_t end) {
        for (uint32_t body = begin; body < end; ++body) {
            if (!is_deformable(bodies, body) || was_seen(sleeping_bodies, body)) continue;
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
            energy.elastic += drive_energy(other.nodes->drive[i], state.coordinate - back * state.rate);
        }
    }
    if (other.links) {
        for (const LinkGroup& g : other.links->group) {
            for (uint32_t link = g.links.first; link < g.links.end(); ++link) {
                const double stretch = other.links->whole[link] ? other.links->stretch[link] : 0;
                energy.links += 0.5 * g.stiffness * stretch * stretch;
                // of the step, as in add_body_energy
                if (!other.actions || !other.links->whole[link]) continue;
                const double step = inputs.particles.last_dt[g.body];
                energy.links -= 0.125 * step * step * g.stiffness * squared_stretch_rate(inputs, g, link);
            }
        }
    }
    for (uint32_t t = 0; other.threads && t < other.threads->thread.size(); ++t) {
        const Thread& thread = other.threads->thread[t];
        const RodEnergy rod = energy_of_rod(thread, rod_of(thread, t, *other.thread_state), other.thread_state->hold, inputs.gravity);
        energy.kinetic += rod.kinetic, energy.elastic += rod.stretch, energy.bending += rod.bending, energy.gravity += rod.gravity;
    }
    if (other.threads)
        for (const ThreadHold& hold : other.thread_state->hold) energy.links += hold.stored;
    if (other.threads)
        for (const ThreadTouch& touch : other.thread_state->touch) energy.links += touch.stored;
    if (other.action_state)
        for (const ToolGrasp& grasp : other.action_state->grasp) energy.links += grasp.stored;
    const double sum = energy.kinetic + energy.elastic + energy.pressure + energy.bending + energy.links + energy.gravity -
                       energy.work_hand - energy.work_contact - energy.work_damping - energy.work_push - energy.work_numeric -
                       energy.work_links - energy.work_cuts;
    if (!start.known) start = {true, sum};
    energy.balance = sum - start.sum;
}

}  // namespace trocar
