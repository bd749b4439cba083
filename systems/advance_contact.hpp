#pragma once
#include "systems/advance_call.hpp"
#include "systems/advance_scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Gives a constraint the impulse that its bodies' velocities ask for now. Returns by how much its relative velocity changed, m/s; 0 if
// no free body has a side.
double solve_row(AdvanceIsland& island, PreparedConstraint& c);

// Prepares a detected constraint for the call; its nodes are numbered.
void prepare_constraint(const AdvanceCall& call, const ContactSolver& solver, uint32_t row, AdvanceIsland& island,
                        const AdvanceState& state, PreparedConstraint& c);
// Numbers the nodes and rigid sides of the island's constraints and prepares them, wide where that pays.
void plan_contacts(const AdvanceCall& call, std::span<const uint32_t> island_rows, ContactSorting& sorting, ContactSolver& solver,
                   AdvanceIsland& island, const AdvanceState& state);
// Empties the look-up tables that plan_contacts filled.
void forget_contacts(const AdvanceCall& call, const ContactSolver& solver, AdvanceIsland& island, ContactRows& rows, AdvanceResult& result);

// Velocities of all particles that are nodes before the kick of the first substep; those of later ones are known.
void note_velocities(const Particles& particles, ContactNodeSet& nodes);
// Writes back that a constraint has expired: its point has left its triangle behind, and it rests until contacts are searched again. The
// distance keeps its sign, so that a call cut into shorter ones still finds the same constraints inside.
inline void end_row(uint32_t row, ContactRows& rows, AdvanceResult& result) {
    double& distance = rows.distance[row];
    if (std::isinf(distance)) return;
    distance = std::copysign(std::numeric_limits<double>::infinity(), distance);
    std::atomic_ref(result.ended_rows).fetch_add(1, std::memory_order_relaxed);
}
// Finds the constraints that are crossed or would be in this substep and gives them impulses; after kick and drift. Projected Gauss-
// Seidel over the active constraints in their order, accumulated impulses clamped (Moreau 1988; Catto 2005): one sweep leaves less to
// position correction than sixteen Jacobi iterations with mass splitting (Tonge et al. 2012) did, and where many points of a fine tool
// press few tissue triangles Jacobi lost a factor of 20 in depth. Every impulse acts on both sides with their inverse masses. Coulomb
// friction is limited by the accumulated normal impulse. With free bodies: settle_rows.
void apply_impulses(const AdvanceCall& call, ContactComponents& components, ContactSolver& solver, AdvanceIsland& island,
                    const AdvanceState& state, AdvanceResult& result);
// Whether constraints start from their impulses of the substep before. Not where a substep has one sweep: that cannot take back an
// impulse that another constraint has made superfluous (pressing tools made tissue chatter).
inline bool may_start_warm(const AdvanceCall& call, const AdvanceIsland& island) {
    return call.params.contact.iterations > 1 || !island.free.empty();
}
// The impulse of a constraint in the last substep before the call, N s.
inline Vec4d start_impulse(const AdvanceCall& call, const ContactRows& rows, uint32_t row) {
    return rows.carried.empty() ? Vec4d{} : call.dt * to_vec4(rows.carried[row]);
}

}  // namespace trocar
#pragma GCC diagnostic pop
