#pragma once
#include <array>
#include <vector>

#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// Spring adjacency of every prototype in SELL-16 slices (Monakov, Lokhmotov, Avetisyan, HiPEAC 2010): 16
// consecutive vertices make a slice; a column holds one half-edge of each of the 16. A spring appears in the
// columns of both its ends, so a vertex sums over its own half-edges and each result is written once.
// Constant after load.
inline constexpr uint32_t kSliceWidth = 16;

struct SpringInfo {
    Range slices;              // range of slice_column, one per 16 vertices
    double mean_rest = 0;      // m
    double mean_geometry = 0;  // m, solids: mean over the edges of stiffness / modulus
    uint32_t varied = 0;       // 1: stiffness differs between springs, see factor
    uint32_t skin = 0;         // particles of a body before its nodes: vertices of an embedded surface, see Solids; padded to 16
    uint32_t packed = kNone;   // index of its first column in Springs::packed, kNone = has none
    float rest_unit = 0;       // m, of the rest lengths in packed
    TROCAR_FIELDS(slices, mean_rest, "m", mean_geometry, "m", varied, skin, packed, rest_unit, "m");
};

// Triangles around the vertices of prototypes with a body that keeps its volume, in slices like those of
// Springs: a column holds the next and the last corner of one triangle around each of 16 vertices. Padding
// holds the lane's own vertex.
struct Fans {
    std::vector<uint32_t> first;   // one per prototype: its first element of column, kNone = has none; may be shorter
    std::vector<double> volume;    // one per element of first: m^3, of the rest shape, negative if inside out
    std::vector<uint32_t> column;  // first column of a slice; slices + 1 elements per prototype that has fans
    std::vector<uint32_t> corner;  // 32 per column: 16 next corners, counter-clockwise from outside, then 16 last ones
    TROCAR_FIELDS(first, volume, "m^3", column, corner);
};

// Edges between two triangles, in groups of eight, for prototypes with a body that has bending stiffness; and
// for every vertex the indices of the forces of its edges, in slices like those of Springs.
struct Hinges {
    std::vector<Range> groups;     // one per prototype; may be shorter
    std::vector<uint32_t> vertex;  // 32 per group: 8 starts of edges, 8 ends, 8 left corners, 8 right corners; padding 0
    std::vector<float> sine;       // 8 per group, of the angle at rest
    std::vector<float> cosine;
    std::vector<float> weight;     // 8 per group: length^2 / (area + area) at rest, reduced for slivers; padding 0
    std::vector<float> cap;        // 16 per group, 1/m: upper limit on 1 / height of the left and the right corner
    std::vector<uint32_t> first;   // one per prototype: its first element of column, kNone = has none
    std::vector<uint32_t> column;  // first column of a slice; slices + 1 elements per prototype that has hinges
    std::vector<uint32_t> slot;    // 16 per column: 32 * group + 8 * corner + index in the group, groups counted from
                                   // the prototype's first; padding is the index past the last
    TROCAR_FIELDS(groups, vertex, sine, cosine, weight, cap, "1/m", first, column, slot);
};

struct Springs {
    std::vector<SpringInfo> info;        // one per prototype
    std::vector<uint32_t> slice_column;  // first column of a slice; slices.count + 1 elements per prototype, at
                                         // slices.first + prototype index
    std::vector<uint32_t> neighbour;     // 16 per column: local vertex at the far end; padding holds the vertex itself
    std::vector<float> rest_length;      // 16 per column: m; padding 0
    std::vector<float> factor;           // as rest_length, up to the last prototype with varied stiffness: stiffness
                                         // / spring_stiffness of the body
    // For prototypes whose columns exceed one core's cache: a column in one cache line, with bitwise the same
    // springs. 16 far ends as neighbour + 32768 - the slice's first vertex, then 16 rest lengths / rest_unit.
    std::vector<std::array<uint16_t, 2 * kSliceWidth>> packed;
    std::vector<float> area_share;  // one per vertex of the prototype (padded to 16): third of the incident area, m^2; padding 0
    std::vector<Range> vertices;    // one per prototype: range of area_share
    Fans fans;
    Hinges hinges;
    TROCAR_FIELDS(info, slice_column, neighbour, rest_length, "m", factor, packed, area_share, "m^2", vertices, fans, hinges);
};

}  // namespace trocar
