#pragma once
#include <vector>

#include "components/report.hpp"
#include "engine/contact_inputs.hpp"
#include "engine/exit_grid.hpp"
namespace trocar {

struct ContactRowsScratch {
    std::vector<uint32_t> count;      // contacts per body
    std::vector<uint32_t> crowded;    // contacts of one body beyond capacity, deepest first
    std::vector<uint8_t> dropped;     // per contact
    std::vector<uint8_t> nose_first;  // per contact
    std::vector<uint32_t> overlap;    // per candidate pair: row of Penetrations or kNone
    // of the side at hand of a deep pair
    uint32_t exit_pair = kNone, exit_body = kNone;
    std::vector<Vec3d> exit_point;  // m, world: vertices of the other body
    ExitGrid exits;
};

// One constraint per contact, in the order of contacts: a plane through `closest` on the other body's triangle.
// Between two rigid bodies the plane is that of the face which carries the point, and a point beside every face has none.
// Weights sum to exactly 1. friction = the larger of the two coefficients. A body with more than params.row_capacity
// contacts loses its shallowest, counted. impulse is set to zero.
// direction = thesis: a point inside an overlapping pair gets the pair's direction and its depth projected on it (thesis
// 4.2). deep = last_free: a point inside a saturated pair gets the plane where the line along the pair's way out leaves the
// other body, with the length of that line; outside ones that face against the way have no row. faces: points of a closed
// body whose way to a sheet leads through the body have none. Between a tool in the hand or a free body and what deforms, points that
// would leave the other nose first (nose_first.hpp) have none either, as long as the pair has another row of a point inside.
// (Coarse balls that hit each other need all their rows.)
void make_contact_rows(const ContactInputs& in, const Contacts& contacts, const Penetrations& penetrations, ContactRowsScratch& scratch,
                       Report& report, ContactRows& rows);

}  // namespace trocar
