#pragma once
#include <immintrin.h>

#include <array>
#include <vector>

#include "components/mesh.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar::bench {

// All bodies of a scene as one list of triangles in world floats: input of the reference methods.
struct Soup {
    std::vector<Float4> position;            // m
    std::vector<Triangle> triangle;          // indices into position
    std::vector<uint32_t> body;              // per triangle
    std::vector<Range> vertices, triangles;  // per body
    double mean_edge = 0;                    // m
};

struct FloatBox {
    __m128 low = _mm_set1_ps(3e38f), high = _mm_set1_ps(-3e38f);
    void take(const FloatBox& other) {
        low = _mm_min_ps(low, other.low);
        high = _mm_max_ps(high, other.high);
    }
};
inline bool meet(const FloatBox& a, const FloatBox& b) {
    return (_mm_movemask_ps(_mm_or_ps(_mm_cmpgt_ps(a.low, b.high), _mm_cmpgt_ps(b.low, a.high))) & 7) == 0;
}
inline FloatBox box_of(const Soup& soup, uint32_t triangle) {
    const Triangle& t = soup.triangle[triangle];
    const __m128 a = _mm_load_ps(&soup.position[t[0]].x), b = _mm_load_ps(&soup.position[t[1]].x), c = _mm_load_ps(&soup.position[t[2]].x);
    return {_mm_min_ps(_mm_min_ps(a, b), c), _mm_max_ps(_mm_max_ps(a, b), c)};
}

// Updates the present positions; the topology once.
Soup make_soup(const Surfaces& surfaces);
void move_soup(const Surfaces& surfaces, Soup& soup);

// Indices of two triangles of different bodies with overlapping boxes, a's body before b's.
using TrianglePairs = std::vector<std::array<uint32_t, 2>>;

}  // namespace trocar::bench
