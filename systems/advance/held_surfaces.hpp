#pragma once
#include <vector>

#include "components/report.hpp"
#include "components/self_contact.hpp"
#include "engine/mesh/crossing_faces.hpp"
#include "engine/mesh/surfaces.hpp"
#include "engine/tissue/body_energy.hpp"
namespace trocar {

struct HeldSurfacesScratch {
    CrossingFacesScratch crossing;
    std::vector<uint32_t> faces;   // that cross
    std::vector<Float4> reached;   // m, of the body's particles at the end of the pass
    std::vector<uint8_t> held;     // per vertex
    std::vector<uint32_t> vertex;  // those held, in the order found
    BodyEnergyScratch energy;
};

// Notes where the awake bodies that have self-contact are. Embedded surfaces are left out: their vertices follow others.
void note_start(const Surfaces& surfaces, const Springs& springs, const Sleep& sleep, SelfContactStart& start);

// What a pass may change to hold surfaces back.
struct HeldSurfacesState {
    Particles& particles;
    Energy& energy;
    Report& report;
};

// Holds back what would cross itself. Promise: a surface that crossed itself nowhere at the start of a pass (count_crossing_faces, exact)
// does not at its end. Proof: the positions that are left at the end have been counted, and crossed nowhere, or are those of the start.
//
// The vertices of crossing faces and of those around them go back to where they were, all displaced by their mean displacement, so
// that they go along with what carries them; where that still crosses, more are added, ring by ring, and in the end all vertices
// of the body, without displacement; these also if holding a part would add energy by stretching what is around it. They get their mean
// velocity, which keeps momentum, or none if one is fixed; the energy that is lost is booked as work_numeric. A surface that crossed itself at the start is left to its contacts.
void hold_surfaces(const SelfContactStart& start, const Meshes& meshes, const EnergyInputs& inputs, bool account_energy,
                   HeldSurfacesScratch& scratch, HeldSurfacesState state);

}  // namespace trocar
