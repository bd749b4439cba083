#pragma once
#include "components/mesh.hpp"
namespace trocar {

// Side of every generated picture, pixels.
inline constexpr uint32_t kTextureSize = 512;

// Opaque sRGB pictures, seamless in both directions, deterministic to the byte for a seed. Liver capsule over
// 0.08 m: dark red-brown with lobules of about 2 mm, mottling and thin vessels.
Image paint_liver(uint64_t seed);
// Kidney capsule over 0.06 m: redder and smoother, with fine veins.
Image paint_kidney(uint64_t seed);
// Gallbladder, u once around, v from the fundus to the duct: bile green through a thin wall, with vessels;
// uniform towards both ends, where the circumference shrinks to a point.
Image paint_gallbladder(uint64_t seed);
// Stomach over 0.09 m: pale pink, with branching vessels.
Image paint_stomach(uint64_t seed);
// Small bowel, u once around from the mesenteric border: pink, vessels run from u = 0 in both directions.
Image paint_bowel(uint64_t seed);
// Layers of the abdominal wall over 0.07 m: muscle, fibres along u; fascia, white fibres; thin pink
// peritoneum.
Image paint_muscle(uint64_t seed);
Image paint_fascia(uint64_t seed);
Image paint_peritoneum(uint64_t seed);
// Knitted polypropylene over 0.01 m: pale threads, one blue thread per repeat.
Image paint_polypropylene(uint64_t seed);
// Steel brushed along u.
Image paint_steel(uint64_t seed);
// Green surgical drape over 0.05 m, woven.
Image paint_drape(uint64_t seed);

// Texture coordinates projected along the axis nearest to the averaged normal; stretch stays below about 2 on
// gently bent surfaces. `tile` is the size of one repeat, m; coordinates exceed 0..1 and the picture repeats.
void project_uv(double tile, Mesh& mesh);

}  // namespace trocar
