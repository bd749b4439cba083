#pragma once
#include "components/mesh.hpp"
namespace trocar {

// Side of every generated picture, pixels.
inline constexpr uint32_t kTextureSize = 512;

// Opaque sRGB pictures that repeat without a seam in both directions; the same bytes for the same seed.
// Liver capsule over 0.08 m: dark red-brown with lobules of about 2 mm, mottling and thin vessels.
Image paint_liver(uint64_t seed);
// Kidney capsule over 0.06 m: redder and smoother, with fine veins.
Image paint_kidney(uint64_t seed);
// Steel brushed along u.
Image paint_steel(uint64_t seed);
// Green surgical drape over 0.05 m, woven.
Image paint_drape(uint64_t seed);

// Texture coordinates along the axis that the surface around each triangle faces most; no stretch beyond about 2 where
// it bends gently. `tile` is the size of one repeat, m; coordinates run beyond 0..1 and the picture repeats.
void project_uv(double tile, Mesh& mesh);

}  // namespace trocar
