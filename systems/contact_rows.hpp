#pragma once
#include <vector>

#include "components/bodies.hpp"
#include "components/contacts.hpp"
#include "components/report.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

struct ContactRowsScratch {
    std::vector<uint32_t> count;    // contacts per body
    std::vector<uint32_t> crowded;  // contacts of one body beyond capacity, deepest first
    std::vector<uint8_t> dropped;   // per contact
    std::vector<uint32_t> overlap;  // per candidate pair: row of Penetrations or kNone
};

// One constraint per contact, in the order of contacts: a plane through `closest` on the other body's triangle.
// Between two rigid bodies the plane is that of the face which carries the point, and a point beside every face has none.
// Weights sum to exactly 1. friction = the larger of the two coefficients. direction = thesis: a point inside an
// overlapping pair gets the pair's direction and its depth projected on it (thesis 4.2). deep = last_free: inside points
// of a saturated pair get the way out that it last agreed on, with their shortest distance. A body with more than
// params.row_capacity contacts loses its shallowest, counted. faces: points of a closed body whose way to a sheet leads
// through the body get no row. impulse is set to zero.
void make_contact_rows(const ContactParams& params, const Surfaces& surfaces, const CandidatePairs& pairs,
                       const Contacts& contacts, const Penetrations& penetrations, ContactRowsScratch& scratch,
                       Report& report, ContactRows& rows);

}  // namespace trocar
