#pragma once
#include "components/mesh.hpp"
namespace trocar {

// Instruments with 5 mm shafts, in metres, with the dimensions given in catalogues. The pivot is the origin,
// the tips point along +z. Closed pieces, textured, no material; shapes with several pieces have
// triangle_material 0 for steel and 1 for the insulated shaft. A pair has three separate pieces: shaft and
// two jaws.

// One jaw of a grasper: 19 mm long, 4.4 mm wide, back rounded, its face (-y) with
// `kJawTeeth` notches across, 1.4 mm apart and 0.5 mm deep.
inline constexpr uint32_t kJawTeeth = 11;
Mesh make_grasper_jaw(uint32_t triangles);
// Both jaws, open by 30 degrees about x, with 25 mm of shaft behind them.
Mesh make_grasper(uint32_t triangles);

// One blade of scissors: 21 mm long, flat on its cutting side (y = 0), bevelled to an edge of 45 to 55
// degrees along x = 0.9 mm, tapering from 3.4 x 1.1 mm to the tip.
Mesh make_scissor_blade(uint32_t triangles);
// Both blades, open by 30 degrees about y, with 25 mm of shaft behind them.
Mesh make_scissors(uint32_t triangles);

// Suture needle: half circle of 26 mm about the origin, plane z = 0, round, 0.66 mm thick, taper point at -x.
Mesh make_needle(uint32_t triangles);

// Tacker: 25 mm of tube, 5 mm outside, 4.2 mm bore, its rim at z = 0, and a spiral tack of 0.6 mm wire, 3.8
// mm wide, 2.5 turns, half out of the tube. Two pieces that do not touch.
Mesh make_tacker(uint32_t triangles);

}  // namespace trocar
