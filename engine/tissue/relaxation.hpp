#pragma once
#include <vector>

#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/relaxation.hpp"
#include "components/solids.hpp"
#include "components/springs.hpp"
#include "engine/kernels/spring_kernels.hpp"
namespace trocar {

// Maxwell elements (springs of share * k in series with dashpots) next to the edge springs of a solid, k each. With
// the stretch linear in time between two evaluations of the forces, h apart, their tensions follow exactly:
//   Q' = exp(-h / tau) Q + share k (1 - exp(-h / tau)) tau / h * change of the stretch
// (Taylor, Pister, Goudreau, "Thermomechanical analysis of viscoelastic solids", IJNME 2(1), 1970). Edge springs being isotropic in
// the body-centred lattice, the shear modulus relaxes as mu (1 + sum of share exp(-t / tau)), Lame's other constant by as
// much, bulk and long-term law by nothing. What they lose is booked as work of damping.
//
// The shares are those of the long-term modulus; ones of the instantaneous modulus, g, are g / (1 - sum of g) here.

// Call for every solid, after add_solid_body: fills what its law (Bodies::law, Bodies::prony) needs beyond springs, nothing for springs.
void give_law(const Meshes& meshes, const Springs& springs, const Bodies& bodies, uint32_t body, Solids& solids, Relaxation& relaxation);

// The Maxwell elements of a body for the kernels, from their state at the last evaluation to `seconds` later; no effect where
// nothing relaxes.
void bind_relaxation(Relaxation* relaxation, const Bodies& bodies, uint32_t body, double seconds, SpringStep& step);
// Only the time in between, for steps already bound.
void set_relaxing_time(const Prony& prony, double seconds, SpringStep& step);

// Energy of the Maxwell elements (J) at step.offset - step.back * velocity, with what they lost since the last evaluation.
double relaxing_energy(const SpringStep& step, uint32_t slices, std::vector<double>& chunk_sums);

// Forgets what a body that was put back has been through: nothing is left to relax, from its present shape (step.offset) on.
void forget_relaxation(const SpringStep& step, uint32_t slices);

}  // namespace trocar
