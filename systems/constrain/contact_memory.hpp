#pragma once
#include <cstdint>
#include <vector>

#include "engine/contact/contact_inputs.hpp"
namespace trocar {

// Where a remembered edge contact would be inserted: its broad-phase pair, and the contact that it precedes.
struct LostEdge {
    uint32_t pair = kNone, before = kNone;
};

// A point of an edge that had a contact constraint in the previous pass.
struct KeptEdge {
    LostEdge lost;
    uint32_t memory = kNone;      // index
    Vec3d point = Vec3d::Zero();  // m, frame of the other body
    SurfacePoint answer;          // the same
};

struct ContactMemoryScratch {
    std::vector<uint32_t> run, merged;  // merge sort: starts of the ascending runs; second buffer
    std::vector<LostEdge> lost;         // per entry of order
    std::vector<KeptEdge> kept;
    std::vector<uint32_t> before;  // per entry of kept: the contact that it precedes
};

// Sorts the remembered constraints by point.
void order_memory(const ContactMemory& memory, ContactMemoryScratch& scratch, ContactMemoryOrder& order);

// Adds to contacts the edge points that had a constraint in the previous pass, while within params.tolerance
// of the surface. The edge pass finds edges only while they cross, so a separated edge would lose its
// support, sink for a pass and be found again: tissue on tissue would tremble at mm/s. Pairs with a
// deformable body; keeps the order of contacts.
void keep_edges(const ContactInputs& in, const ContactMemory& memory, const ContactMemoryOrder& order, ContactMemoryScratch& scratch,
                Contacts& contacts);

// Marks the constraints of vertices of deformable bodies that carried a load on a static one in the previous
// pass, within half a mean edge: they act at any speed, as the load's reaction accelerates them (0.2 N on
// 0.26 g: 14 mm in 8 ms). On other bodies light vertices under a tool would have an unbounded margin.
void mark_loaded(const Surfaces& surfaces, const ContactMemory& memory, const ContactMemoryOrder& order,
                 const ContactConstraints& constraints, std::vector<uint8_t>& loaded);

// Warm start: gives every constraint the impulse of the same point's constraint at the end of the previous
// pass, or zero. The same point: same vertices of the same body against the same other body and, on an edge,
// less than a tenth of it apart. Constraints that start deeper than the resting depth get none.
void recall_contacts(const ContactMemory& memory, const ContactMemoryOrder& order, ContactConstraints& constraints);

// Keeps the constraints with an impulse in the pass, and those of edges, in order; not points inside faces.
void remember_contacts(const ContactConstraints& constraints, ContactMemory& memory);

}  // namespace trocar
