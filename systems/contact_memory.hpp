#pragma once
#include <cstdint>
#include <vector>

#include "engine/contact_inputs.hpp"
namespace trocar {

// Where a remembered edge that contacts do not have would be: its candidate pair, and the contact that it comes before.
struct LostEdge {
    uint32_t pair = kNone, before = kNone;  // rows
};

// A point of an edge that had a row in the pass before.
struct KeptEdge {
    LostEdge place;
    uint32_t memory = kNone;      // row
    Vec3d point = Vec3d::Zero();  // m, frame of the other body
    SurfacePoint answer;          // likewise
};

struct ContactMemoryScratch {
    std::vector<uint32_t> run, merged;  // of the sort: first rows of ascending runs; its other buffer
    std::vector<LostEdge> lost;         // per row of order
    std::vector<KeptEdge> kept;
    std::vector<uint32_t> before;  // as kept: the contact that it comes before
};

// Sorts what is remembered by point.
void order_memory(const ContactMemory& memory, ContactMemoryScratch& scratch, ContactMemoryOrder& order);

// Adds to contacts the points of edges that had a row in the pass before, as long as they are within params.tolerance of
// the surface: the edge pass finds edges only while they cross, so that one held up by another would be let go when it
// has been pushed out, sink for a pass, and be found again: tissue on tissue trembles at mm/s. Pairs with a deformable
// body; keeps the order of contacts.
void keep_edges(const ContactInputs& in, const ContactMemory& memory, const ContactMemoryOrder& order, ContactMemoryScratch& scratch,
                Contacts& contacts);

// Marks the rows of vertices of deformable bodies that bore a load on a static one in the pass before,
// within half a mean edge: they act whatever their speed, for what they bore throws them back (0.2 N on 0.26 g: 14 mm in 8
// ms). Not those on other bodies: under a tool the lightest vertices of a fine mesh would reach anywhere.
void mark_loaded(const Surfaces& surfaces, const ContactMemory& memory, const ContactMemoryOrder& order, const ContactRows& rows,
                 std::vector<uint8_t>& loaded);

// Gives every row what the row of the same point carried at the end of the pass before, zero where there was none. The
// same point: same vertices of the same body against the same other and, of an edge, less than a tenth of it apart. Rows that
// start deeper than what rests get none.
void recall_contacts(const ContactMemory& memory, const ContactMemoryOrder& order, ContactRows& rows);

// Keeps the rows that carried something in the pass, and those of edges, in their order; points inside faces
// are found anew.
void remember_contacts(const ContactRows& rows, ContactMemory& memory);

}  // namespace trocar
