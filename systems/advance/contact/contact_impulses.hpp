#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Brings a constraint to its target velocity by an impulse. Returns the change of its relative velocity, m/s;
// 0 if no free body has a side.
double solve_constraint(AdvanceIsland& island, PreparedConstraint& c);

// Prepares a detected constraint for the call; its nodes have been numbered.
void prepare_constraint(const AdvanceCall& call, const ContactSolver& solver, uint32_t constraint, AdvanceIsland& island,
                        const AdvanceState& state, PreparedConstraint& c);
// Numbers the nodes and rigid sides of the island's constraints and prepares them, as wide ones where that
// pays.
void prepare_contacts(const AdvanceCall& call, std::span<const uint32_t> island_constraints, ContactSorting& sorting, ContactSolver& solver,
                      AdvanceIsland& island, const AdvanceState& state);
// Clears the look-up tables that prepare_contacts filled.
void release_contacts(const AdvanceCall& call, const ContactSolver& solver, AdvanceIsland& island, ContactConstraints& constraints,
                      AdvanceResult& result);

// Velocities of all particles that are nodes before the kick of the first substep; later ones are known.
void note_velocities(const Particles& particles, ContactNodeSet& nodes);
// Records that a constraint has expired: its point has slid off its triangle, and it stays inactive until the
// next contact pass. The distance keeps its sign, so that a call split into shorter ones finds the same
// constraints inside.
inline void expire_constraint(uint32_t constraint, ContactConstraints& constraints, AdvanceResult& result) {
    double& distance = constraints.distance[constraint];
    if (std::isinf(distance)) return;
    distance = std::copysign(std::numeric_limits<double>::infinity(), distance);
    std::atomic_ref(result.expired_constraints).fetch_add(1, std::memory_order_relaxed);
}
// Finds the constraints that are violated or would be in this substep and applies impulses; after kick and
// drift. Projected Gauss-Seidel over the active constraints in their order with accumulated, clamped impulses
// (Moreau 1988; Catto 2005): one sweep leaves less to position correction than sixteen Jacobi iterations with
// mass splitting (Tonge et al. 2012), and with many points of a fine tool on few tissue triangles Jacobi is
// 20 times worse in depth. Impulses act on both sides with their inverse masses. Coulomb friction is limited
// by the accumulated normal impulse. With free bodies: solve_to_convergence; with bodies stepped implicitly:
// solve_with_implicit.
void apply_impulses(const AdvanceCall& call, ContactComponents& components, TissueScratch& tissue, ContactSolver& solver,
                    AdvanceIsland& island, const AdvanceState& state, AdvanceResult& result);
// Whether constraints start from their impulses of the preceding substep. Not with one sweep per substep: it
// cannot take back an impulse that another constraint has made superfluous (pressing tools made tissue
// chatter).
inline bool may_start_warm(const AdvanceCall& call, const AdvanceIsland& island) {
    const auto is_touched_implicit = [](const AdvanceBody& b) { return b.touched && b.synchronous(); };
    return call.params.contact.iterations > 1 || !island.free.empty() || std::ranges::any_of(island.body, is_touched_implicit);
}
// m, not positive: how much of a constraint's overlap counts as none (AdvanceInputs::left).
inline double left_overlap(const AdvanceCall& call, const ContactConstraints& constraints, uint32_t constraint) {
    if (call.inputs.left.empty() || !call.inputs.left[constraint] || std::isinf(constraints.distance[constraint])) return 0;
    return std::min(0.0, constraints.distance[constraint]);
}
// The impulse of a constraint in the last substep before the call, N s.
inline Vec4d warm_start_impulse(const AdvanceCall& call, const ContactConstraints& constraints, uint32_t constraint) {
    return constraints.warm_start.empty() ? Vec4d{} : call.dt * to_vec4(constraints.warm_start[constraint]);
}

}  // namespace trocar
#pragma GCC diagnostic pop
