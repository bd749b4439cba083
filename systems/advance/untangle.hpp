#pragma once
#include <array>
#include <vector>

#include "components/contacts.hpp"
#include "components/report.hpp"
#include "components/self_contact.hpp"
#include "engine/mesh/crossing_faces.hpp"
#include "engine/mesh/side_by_side.hpp"
#include "engine/mesh/surfaces.hpp"
#include "engine/tissue/body_energy.hpp"
namespace trocar {

// An edge of one face that goes through another, and the displacement by which it shortens their contour.
struct EdgeThroughFace {
    std::array<uint32_t, 5> vertex = {};  // ends of the edge, corners of the face; of the surfaces side by side
    std::array<double, 5> weight = {};    // of the crossing point: + on the edge, - on the face
    Vec3d shift = Vec3d::Zero();          // m, of the edge relative to the face
};

struct UntangleScratch {
    CrossedSurfaces before;
    CrossingFacesScratch crossing;
    SideBySide surface;
    std::vector<std::array<uint32_t, 2>> pairs;
    std::vector<EdgeThroughFace> edges;
    std::vector<uint32_t> count;  // per vertex, of edges that move it
    std::vector<Vec3d> shift;     // m, per vertex
    std::vector<Float4> offset;   // m, of both before, where they are moved
    BodyEnergyScratch energy;
};

// Surfaces of a pass that touch themselves or each other.
struct TangledSurfaces {
    const Surfaces& surfaces;
    const BroadPhasePairs& pairs;
    const Sleep& sleep;
    const EnergyInputs& inputs;
    bool account_energy;
    const SelfContactStart& start;
    const CrossedSurfaces& before;  // those of the pass before
};

// Draws surfaces apart that cross. Adds to `crossed`, which has the bodies that cross themselves, the pairs of sheets with
// self-contact that cross each other, those that sleep so too; then moves every edge that goes through a face, relative to that face, so
// that the contour of the crossing becomes shorter (intersection contour minimization: Volino and Magnenat-Thalmann, 2006): for each face
// beside the edge with unit vectors E along the edge, N normal to the face that is crossed and R along the contour away from the edge, by a
// part of
//     R - (E.R) / (E.N) N,
// the gradient of the contour's length. A vertex moves by a twentieth of a mean edge in a pass at most, both sides by their inverse masses,
// so that the centre of mass stays; velocities are kept. A half, a quarter and so on of that is tried, and at last surfaces stay where they
// are, while moving them would bring their energy (of motion, springs, pressure, bending and links) above what it is and above that of
// springs all longer by 1/400 of an edge: untangling never adds more, and what is crossed at rest stays so, counted.
// The energy that enters by stretching is booked as work_push, and edges that move are counted in Report::untangled_edges. What touches on
// both sides of a contour is left out of self-contact in the next pass. A contour that ends on rims at both ends, or is as long whatever
// moves, may stay; it is counted as crossing.
void untangle(const TangledSurfaces& tangled, UntangleScratch& scratch, Particles& particles, Energy& energy, Report& report,
              CrossedSurfaces& crossed);

}  // namespace trocar
