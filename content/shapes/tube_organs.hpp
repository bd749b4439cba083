#pragma once
#include "content/shapes/tube.hpp"
namespace trocar {

// Tubular organs, in metres; axes as for the liver: patient's right -x, head +y, belly +z. Closed, textured
// by u around and v along, no material. Sizes after Gray's Anatomy.

// Gallbladder: 0.1 m along its centre line from the fundus (-y, +z) over the pear-shaped body, the pouch
// before the neck and the bent neck to the stump of the cystic duct; at most 34 mm wide, about 40 ml
// (anatomical range 7 to 10 cm, 3 to 5 cm, 30 to 50 ml). The seed changes its small irregularities.
RadiusProfile gallbladder_profile();
CentreLine gallbladder_line();
Mesh make_gallbladder(uint32_t triangles, uint64_t seed);

// A loop of small bowel: a meandering tube 28 mm wide and 0.42 m long, with shallow ring contractions every
// 12 to 40 mm and blind ends. The seed changes their positions.
RadiusProfile bowel_profile();
CentreLine bowel_line();
Mesh make_bowel(uint32_t triangles, uint64_t seed);

}  // namespace trocar
