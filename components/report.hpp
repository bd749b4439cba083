#pragma once
#include <cstdint>
#include <limits>
namespace trocar {

// Energy of all deformable and free rigid bodies and the work done on them since the start. J.
// Balance: kinetic + elastic + pressure + bending + links + gravity - all work_* = its value at the start.
struct Energy {
    double kinetic = 0;
    double elastic = 0;       // springs, anchors and volumes of tetrahedra
    double pressure = 0;      // of enclosed volumes
    double bending = 0;       // of surfaces
    double links = 0;         // of springs between bodies
    double gravity = 0;       // potential
    double work_hand = 0;     // of hands and scripts, through contact rows
    double work_contact = 0;  // of inelastic impact and friction, <= 0
    double work_damping = 0;  // <= 0
    double work_push = 0;     // of push-out moves
    double work_numeric = 0;  // what implicit steps lost by themselves, what bodies fell asleep or left with
    double work_links = 0;    // what links and springs held as they were made, less what they and removed tissue held as they went
    double balance = 0;       // the sum above - its value at the start
};

// What Energy::balance is measured from.
struct EnergyStart {
    bool known = false;
    double sum = 0;  // J, energies less works when the accounts were opened, and the energies of bodies added since
};

// Trouble is counted here: what happens in a pass neither throws nor prints.
struct Report {
    uint64_t contact_passes = 0;
    uint64_t contact_events = 0;         // passes with at least one overlapping pair
    uint64_t dropped_contacts = 0;       // beyond capacity, shallowest first
    uint64_t oversize_triangles = 0;     // spanned more than 64 cells
    uint64_t tie_overflows = 0;          // closest-point queries restarted in double
    uint64_t sign_disagreements = 0;     // of pseudonormal and winding number, which had the last word
    uint64_t disagreements = 0;          // of pseudonormal and winding number; only with contact.cross_check
    uint64_t ended_rows = 0;             // planes left behind by a sliding vertex
    uint64_t opposing_planes = 0;        // vertices pressed from both sides at the end of a pass
    uint64_t nonfinite_particles = 0;    // restored
    uint64_t runaway_bodies = 0;         // restored because their energy grew and nobody had put it in
    uint64_t awake_bodies = 0;           // deformable bodies that were moved in the last pass
    uint64_t asleep_bodies = 0;          // and that lay still
    uint64_t implicit_steps = 0;         // of bodies stepped by midpoint
    uint64_t implicit_iterations = 0;    // of conjugate gradients in all of them
    double worst_implicit_residual = 0;  // largest over the steps, as Stepping::tolerance
    uint64_t links = 0;                  // springs between bodies that hold now
    uint64_t broken_links = 0;
    uint64_t broken_springs = 0;  // and those that went with removed triangles
    uint64_t removed_triangles = 0;
    uint64_t removed_tetrahedra = 0;
    uint64_t opened_bodies = 0;     // closed surfaces that a cut has opened or left without a manifold: inside is what they wind around
    uint64_t dropped_pictures = 0;  // live mode
    uint64_t late_passes = 0;       // live mode
    double deepest_residual = 0;    // m, deepest overlap at the end of a period
    // least signed volume of a tetrahedron / its volume at rest, all substeps so far; infinity without solids
    double min_volume_ratio = std::numeric_limits<double>::infinity();
};

}  // namespace trocar
