#pragma once
#include "content/vrml/surfaces.hpp"
namespace trocar::vrml {

// How the faces of one surface choose their material.
struct FaceLook {
    bool per_face = false;
    std::span<const double> index;  // entry of each face; empty = the face's number
    uint32_t entries = 1;
    NodeId colour;       // VRML97 Color node, or none
    uint16_t whole = 0;  // material of all faces, unless per_face
};

// The looks of a surface: colours of faces (VRML97), materials of faces (VRML 1.0), else one material. What belongs to
// single corners is passed over with a warning.
FaceLook face_look(SurfaceBuilder& b, const Instance& instance);

// Row in Mesh::material of face `face`, counted from 0 in its surface.
uint16_t material_of_face(SurfaceBuilder& b, const State& state, const FaceLook& look, uint64_t face);

// Row of the material a face gets: entry `entry` of the material node, or the colour given.
uint16_t material_row(SurfaceBuilder& b, const State& state, uint32_t entry, NodeId colour_node);

}  // namespace trocar::vrml
