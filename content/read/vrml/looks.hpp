#pragma once
#include "content/read/vrml/surfaces.hpp"
namespace trocar::vrml {

// How the faces of one surface choose their materials.
struct FaceLook {
    bool per_face = false;
    std::span<const double> index;  // entry per face; empty = the face's index
    uint32_t entries = 1;
    NodeId colour;       // VRML97 Color node, or none
    uint16_t whole = 0;  // material of all faces, unless per_face
};

// Materials of a surface: colours per face (VRML97), materials per face (VRML 1.0), otherwise one material.
// Per-corner values are skipped with a warning.
FaceLook face_look(SurfaceBuilder& b, const Instance& instance);

// Index in Mesh::material of face `face`, counted from 0 in its surface.
uint16_t material_of_face(SurfaceBuilder& b, const State& state, const FaceLook& look, uint64_t face);

// Index of the material for a face: entry `entry` of the material node, or the given colour.
uint16_t material_row(SurfaceBuilder& b, const State& state, uint32_t entry, NodeId colour_node);

}  // namespace trocar::vrml
