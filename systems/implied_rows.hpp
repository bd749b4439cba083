#pragma once
#include <vector>

#include "components/contacts.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

// A row seen along the normal that it shares with others of its pair.
struct SharedPlaneRow {
    uint32_t row;
    double x, y;   // m, across the normal
    double above;  // m, its distance; less that of the supporting plane there
};

struct ImpliedRowsScratch {
    struct Chunk {
        std::vector<SharedPlaneRow> rows;   // of one normal
        std::vector<uint32_t> left;         // rows of the pair at hand without a normal yet
        std::vector<uint32_t> patch, hull;  // of rows
    };
    std::vector<Chunk> chunk;
    std::vector<uint32_t> row;     // of rigid pairs, by pair
    std::vector<Range> pair;       // rows of `row`
    std::vector<uint8_t> dropped;  // per row of ContactRows
};

// Drops rows between two rigid bodies that others of the pair imply. Along one normal the gap of a point is affine in its
// place across it, and stays so while the bodies move: a row whose place is a weighted mean of others' and whose distance is
// at least theirs holds when they hold, and what force and friction it could carry they carry. Of a face on a face the
// corners of their common part remain, of a rod on a face the ends (convex hull of the support: Mirtich 1998, "Rigid body
// contact: collision detection to force computation", section 3.2). Normals are one within 1e-3 rad; a distance may be wrong
// by 1e-5, a place by 1e-4 of the largest extent of the rows of a normal. Of coinciding ones the first stays. Only the
// first eight normals of a pair are looked at. Order is kept.
void drop_implied_rows(const Surfaces& surfaces, ImpliedRowsScratch& scratch, ContactRows& rows);

}  // namespace trocar
