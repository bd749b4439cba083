#pragma once
#include <array>
#include <vector>

#include "components/math.hpp"
namespace trocar {

// Spring adjacency of every prototype in SELL-16 slices (Monakov, Lokhmotov, Avetisyan, HiPEAC 2010): 16 consecutive
// vertices make a slice; a column holds one half-edge of each of the 16. A spring appears in the columns of both its
// ends, so a vertex sums over its own half-edges and nothing is written twice. Constant after load.
inline constexpr uint32_t kSliceWidth = 16;

struct SpringInfo {
    Range slices;          // rows of slice_column, one per 16 vertices
    double mean_rest = 0;  // m
};

struct Springs {
    std::vector<SpringInfo> info;             // one per prototype
    std::vector<uint32_t> slice_column;       // first column of a slice; slices.count + 1 rows per prototype, at slices.first + prototype row
    std::vector<uint32_t> neighbour;          // 16 per column: local vertex at the far end; padding names the vertex itself
    std::vector<float> rest_length;           // 16 per column: m; padding 0
    std::vector<float> area_share;            // one per vertex of the prototype (padded to 16): third of the incident area, m^2; padding 0
    std::vector<Range> vertices;              // one per prototype: rows of area_share
    // The same springs, each once, in colours: no two of a colour share an end. Only of prototypes of bodies stepped by
    // xpbd, else empty ranges; no rows at all where nobody is. 16 springs a batch; padding names rows beyond the
    // prototype's padded vertices: 2 lane and 2 lane + 1 from there.
    std::vector<Range> colours;               // one per prototype: rows of colour
    std::vector<Range> colour;                // batches
    std::vector<std::array<uint32_t, 2 * kSliceWidth>> batch;    // 16 first ends, then 16 second ends
    std::vector<std::array<float, kSliceWidth>> batch_rest;      // m
};

}  // namespace trocar
