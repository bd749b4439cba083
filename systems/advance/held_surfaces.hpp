#pragma once
#include <vector>

#include "components/report.hpp"
#include "components/self_contact.hpp"
#include "engine/mesh/crossing_faces.hpp"
#include "engine/mesh/near_features.hpp"
#include "engine/mesh/surfaces.hpp"
#include "engine/tissue/body_energy.hpp"
#include "systems/advance/part_faces.hpp"
namespace trocar {

struct HeldSurfacesScratch {
    CrossingFacesScratch crossing;
    std::vector<uint32_t> faces;                              // that cross
    std::vector<std::array<uint32_t, 2>> pairs, start_pairs;  // of faces that cross; at the start of the pass, ascending
    std::vector<uint8_t> ring, beside;                        // per vertex, of those
    CrossedSurfaces before;
    bool tangled = false, strict = false;        // some crossed at the start; none may that did not
    std::vector<Float4> reached;                 // m, of the body's particles at the end of the pass
    std::array<std::vector<float>, 3> velocity;  // m/s, at the end of the pass
    std::vector<uint8_t> held;                   // per vertex
    std::vector<uint32_t> vertex;                // those held, in the order found
    FeatureTrees trees;                          // of the start of the pass
    NearFeatures near;
    std::vector<float> free_path;  // m, per particle: farther than this from the others it may meet another part
    std::vector<float> share;      // per particle, of its displacement that it keeps
    std::vector<PartedCorners> parted;
    std::vector<Vec3d> place, free_velocity;  // m, m/s, of vertices
    BodyEnergyScratch energy;
};

// Notes where the awake bodies that have self-contact are. Embedded surfaces are left out: their vertices follow others.
void note_start(const Surfaces& surfaces, const Springs& springs, const Sleep& sleep, SelfContactStart& start);

// What a pass may change to hold surfaces back.
struct HeldSurfacesState {
    Particles& particles;
    Energy& energy;
    Report& report;
    CrossedSurfaces& crossed;  // set to the bodies that are left crossing themselves, those that sleep so too
};

// Holds back what would cross itself. Promise: a surface that crossed itself nowhere at the start of a pass (count_crossing_faces, exact)
// does not at its end. Proof: the positions that are left at the end have been counted, and crossed nowhere, or are those of the start.
//
// Faces that cross are parted (part_faces.hpp) along the plane that lets them keep most of their displacement, and their approach ends as
// in an inelastic impact: that keeps linear momentum and takes energy of motion. Where it stretches the surface by more than that
// energy, what is around and then the whole body is braked, relative to its rigid motion, by as much as pays for it.
//
// Where that does not succeed, the vertices of crossing faces and of those around them keep as much of their displacement, relative to the
// rigid motion of all that are held, as leaves them within their free path: 0.49 of the distance, at the start of the pass, to the nearest
// part of the surface that shares no vertex with what they are a corner of. Where that still crosses, more are held, ring by ring, and in
// the end all vertices of the body. Then nothing can have met: two surfaces first meet where a vertex comes to a triangle or an edge to an
// edge without a common vertex, all points of one of the two have moved by less than 0.49 of their distance, and so have those of the
// other. What is held goes on from pass to pass, however near. (Bounds per vertex as in offset geometric contact: Chen, Hsu, Liu, Macklin,
// Yang and Yuksel, 2025.) Positions in floats, folded flat to their rounding, may miss that: then all goes back to where it started.
// Holding a part may add energy by stretching what is around it: then a quarter of the free paths is tried, then both without the turn,
// then the start of the pass; if all add energy, as where a body is pressed from outside, that which adds least is taken. Energy is that of
// the body and of its links, whose stretch follows. Velocities relative to the rigid motion of what is held keep the same share, and that
// motion is adapted, which keeps linear and angular momentum unless one is fixed; the energy that is lost is booked as work_numeric. Of a
// surface that crossed itself at the start, what crosses anew away from the contours is held, and if more crosses than at the start, all
// that crosses anew, unless that would add energy; the rest is left to untangle.
void hold_surfaces(const SelfContactStart& start, const Meshes& meshes, const EnergyInputs& inputs, const Sleep& sleep, bool account_energy,
                   HeldSurfacesScratch& scratch, HeldSurfacesState state);

}  // namespace trocar
