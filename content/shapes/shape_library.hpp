#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "components/mesh.hpp"
#include "content/shapes/implicit_shapes.hpp"
#include "content/shapes/looks.hpp"
namespace trocar {

// Generated shapes, in metres, textured. Organs have the axes of a supine patient: right -x, head +y, belly
// +z. Closed, manifold, outward, without self-intersection; genus 0 except hernia_wall, inguinal_wall (1) and surgical_mesh
// (an open sheet).
//   liver, kidney, gallbladder, stomach, bowel   see implicit_shapes.hpp and tube_organs.hpp
//   hernia_wall, surgical_mesh                   see wall_and_mesh.hpp
//   grasper (3 pieces), grasper_jaw, scissors (3 pieces), scissor_blade, needle, tacker (2 pieces)
//                                                see
//                                                instrument_shapes.hpp
//   inguinal_wall, peritoneum (an open sheet), cord (2 pieces), epigastric_vessels, iliac_vessels (2 pieces), pubic_bone
//                                                see inguinal_region.hpp; fine_mesh (an open sheet) see wall_and_mesh.hpp
//   probe   palpation probe of steel, 0.167 m; centre of its 7 mm tip sphere at the origin, shaft along +z
//   sphere  diameter 1 m, centred      box  1 x 1 x 1 m, centred
//   dish    open spherical cap, 0.2 m across, 0.03 m deep, lowest point at the origin
//   table   slab 0.6 x 0.6 x 0.02 m, centred, thin along z; "plane" is another name for it
std::vector<std::string> shape_names();

// One line about a shape: description, size, frame. Empty for an unknown name.
std::string_view describe_shape(std::string_view name);

// Makes a shape of about `triangles` triangles (within 10 % from 1000 on). The seed changes irregularities
// and texture of organs; other shapes ignore it and have no texture. Deterministic to the byte. Throws
// InputError for an unknown name or a number of triangles out of range.
Mesh make_shape(std::string_view name, uint32_t triangles, uint64_t seed = 1, Looks looks = Looks::kPainted);

// Triangulates any connected implicit shape with about `triangles` even triangles (at least 100), every
// vertex on its surface, in the shape's frame; no texture. Contour, Taubin smoothing, even remeshing,
// projection.
Mesh mesh_implicit(const ImplicitShape& shape, uint32_t triangles);

}  // namespace trocar
