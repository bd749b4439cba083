#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "engine/geometry/eight_points.hpp"
namespace trocar {

// Eight faces, a lane each, as the search for crossing ones sees them.
struct EightFaces {
    std::array<EightPoints, 3> corner;
    EightPoints normal;                                    // not unit: twice the area
    Vec8f error = {};                                      // rounding of a product with the normal, per unit of distance
    EightPoints low, high;                                 // boxes; no box of an unused lane meets another
    std::array<std::array<uint32_t, 8>, 3> vertex = {{}};  // of the corners
};

struct FaceBox {
    std::array<float, 4> low, high;  // three and a zero
};

struct CrossingFacesScratch {
    std::vector<EightFaces> leaf;             // faces 8 i to 8 i + 7
    std::vector<std::vector<FaceBox>> level;  // of one leaf each, then of pairs, up to a single one
    std::vector<std::array<uint32_t, 2>> pairs;
};

// A leaf of eight faces is tested exactly against as many others at most: time is bounded where a surface has collapsed
// onto a point. A smooth surface needs a few, a crumpled one some dozens.
inline constexpr uint32_t kMostExactTests = 1024;

// Number of pairs of faces of one surface that share a point interior to both (Meeting::kCrossing), by exact tests of the
// pairs that boxes and planes in floats with their error bounds do not part; degenerate faces are ignored. A lower bound beyond
// kMostExactTests. Takes some 0.1 us a face of a smooth surface, whose faces should be ordered for locality. position: m, one
// element a vertex. The same for any number of threads.
uint64_t count_crossing_faces(std::span<const Triangle> triangle, const Float4* position, CrossingFacesScratch& scratch);

// The faces of those pairs, ascending. Not in parallel.
void find_crossing_faces(std::span<const Triangle> triangle, const Float4* position, CrossingFacesScratch& scratch,
                         std::vector<uint32_t>& faces);

// Those pairs, each once, in the order of their search. Not in parallel.
void find_crossing_pairs(std::span<const Triangle> triangle, const Float4* position, CrossingFacesScratch& scratch,
                         std::vector<std::array<uint32_t, 2>>& pairs);

}  // namespace trocar
