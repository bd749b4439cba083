#pragma once
#include "components/mesh.hpp"
namespace trocar {

// Shapes of exact size, in metres, about the z axis, with texture coordinates and no material; see shape_library.hpp.

// Torus of 24 mm bore and 8 mm thickness, centred: about the internal inguinal ring with a hernia of medium width (1.5 to 3 cm,
// European Hernia Society's classification of groin hernias, Miserez et al. 2007). Closed.
Mesh make_ring(uint32_t triangles);

// Cannula of a 10 mm trocar: hollow cylinder, bore 10 mm, wall 1 mm, 60 mm long, centred; over the last 12 mm towards +z it opens
// smoothly to 20 mm, as the funnel of an introducer does. Closed, one handle.
Mesh make_cannula(uint32_t triangles);

// Peritoneal sac of a hernia: pouch of 40 mm width and 50 mm depth, its round end -z, its neck in z = 0 bent outwards with a
// radius of 6 mm. Open there: a sheet, facing outwards.
Mesh make_sac(uint32_t triangles);

}  // namespace trocar
