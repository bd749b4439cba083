#pragma once
#include <vector>

#include "components/haptics.hpp"
#include "components/report.hpp"
#include "engine/contact/contact_inputs.hpp"
#include "engine/geometry/exit_grid.hpp"
namespace trocar {

struct ContactConstraintsScratch {
    std::vector<uint32_t> count;    // contacts per body
    std::vector<uint32_t> crowded;  // contacts of one body beyond capacity, deepest first
    std::vector<uint8_t> dropped;   // per contact
    std::vector<uint8_t> inverted;  // per contact
    std::vector<uint8_t> slopes;    // per contact: belongs to another point
    std::vector<uint32_t> overlap;  // per broad-phase pair: index into Penetrations or kNone
    // of the current side of a deep pair
    uint32_t exit_pair = kNone, exit_body = kNone;
    std::vector<Vec3d> exit_point;  // m, world: vertices of the other body
    ExitGrid exits;
};

// One contact constraint per contact, in the same order: a plane through `closest` on the other body's triangle.
// Between rigid bodies it is the plane of the supporting face; a point beside every face has none. Weights sum to
// exactly 1. friction = the larger coefficient. A body over params.constraint_capacity loses its shallowest contacts,
// counted. Sets impulse to zero. direction = thesis: an inside point gets the pair's direction and its depth projected
// on it (thesis 4.2), which may leave points on the flanks inside (contact.left_m). An inside point of a saturated pair
// with a separation direction gets the plane where the line along it leaves the other body, with that line's length;
// outside points with opposite normals, between rigid bodies all with others, have none. faces: points of a closed body
// that the body itself separates from a sheet have none. Between a tool or free body and a deformable one, inverted
// contacts (inverted_contact.hpp) have none while another inside point of the pair has one. (Coarse colliding balls
// need all their contacts.) Contacts of a tool that leaves a body (ToolState::exit) have none. A point of a static
// body, or of a rigid body against another, has none if its surface goes on towards the plane, flat or less bent than
// the plane is tilted: no point within a smooth surface acts as a corner. Two sheets with self-contact have none: see
// self_contacts.hpp.
void make_contact_constraints(const ContactInputs& in, const Contacts& contacts, const Penetrations& penetrations,
                              ContactConstraintsScratch& scratch, Report& report, ContactConstraints& constraints,
                              const Haptics& haptics = {});

}  // namespace trocar
