#pragma once
#include <vector>

#include "components/contacts.hpp"
#include "components/report.hpp"
#include "components/self_contact.hpp"
#include "components/springs.hpp"
#include "engine/mesh/crossing_faces.hpp"
#include "engine/mesh/near_features.hpp"
#include "engine/mesh/side_by_side.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {

// What a look found near in one body, or between two, and where they then were.
struct SelfContactLook {
    uint32_t body = kNone, other = kNone;
    double reach = 0;  // m
    std::vector<Float4> position, other_position;
    NearFeatures near;
};

// A near pair as measured in this pass.
struct SelfContactPair {
    std::array<uint32_t, 2> feature = {};
    bool edges = false, kept = false, acts = false, positive = false, turned = false;
    std::array<uint32_t, 2> vertex = {};  // of the point, equal for a vertex
    float along = 0;
    Triangle triangle = {};  // its normal is on the side of `normal`
    std::array<float, 3> weight = {};
    Vec3d normal = Vec3d::Zero();
    double distance = 0, gap = 0;  // m
    Vec3d force = Vec3d::Zero();   // N
};

struct SelfContactScratch {
    std::vector<std::array<uint32_t, 2>> pair;  // bodies that may touch: the vertices and edges of the first
    std::vector<SelfContactLook> look;          // as pair
    std::vector<FeatureTrees> trees;            // per body
    std::vector<Float4> moved;                  // m, of another sheet, from the origin of the first
    std::vector<std::vector<SelfContactPair>> measured;  // near ones, per chunk of what a look found
    SelfContacts before;
    SideBySide surface;
    CrossingFacesScratch crossing;
    std::vector<std::array<uint32_t, 2>> crossing_pairs;
    std::vector<uint8_t> beside, ring;  // per vertex of `surface`: beside the contour of a crossing
};

// A contact pass, its bodies and which of them may touch or are at rest.
struct SelfContactPass {
    double period, fall;  // s; m, displacement that gravity adds in it
    const Surfaces& surfaces;
    const BroadPhasePairs& pairs;  // of two sheets
    const Springs& springs;
    const Sleep& sleep;
    const CrossedSurfaces& crossed;
    bool first;  // no other stage makes constraints
};

// Contacts of every awake body that has self-contact (Bodies::self_contact) with itself, and of two sheets that have it, as
// constraints behind all others: a vertex stays on its side of a triangle, an edge on its side of one that it crosses, at the
// distance of the body or, of two sheets, of both half thicknesses; parts that are nearer at rest keep that distance. Parts
// that share a vertex are left out, and so are a triangle whose neighbour is nearer and what is beside each other in a surface. Sides of two
// sheets are those of the pass in which a pair came near; a surface that hold_surfaces keeps from crossing itself is on the right side
// of itself wherever it is.
//
// A look (find_near_features) finds all pairs within a reach and is used again until some vertex has moved by half of what was added to
// the reach, relative to the body's mean motion: that changes time, never results. A pair is near if its distance is below
//     gap + 0.05 mean edge + fall + 3 T * fastest vertex (relative to the mean), the last at most 0.75 mean edge
// and is a constraint if below the same with twice its own relative velocity. A body that is faster is counted
// (Report::unswept_bodies). Where surfaces cross (pass.crossed) nobody knows the side: no pair acts both of whose features are at
// faces of the contour or at those around them, and untangle draws the surfaces apart. Pairs found on the wrong side are (Report::turned_sides), and no pair is dropped for want of room.
void find_self_contacts(const SelfContactPass& pass, SelfContactScratch& scratch, Report& report, SelfContacts& contacts,
                        ContactConstraints& constraints);

// Writes the forces of the last substep to the pairs of a pass.
void remember_self_contacts(const ContactConstraints& constraints, SelfContacts& contacts);

}  // namespace trocar
