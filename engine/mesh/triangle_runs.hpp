#pragma once
#include <algorithm>
#include <array>
#include <cstring>
#include <span>
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

constexpr uint32_t kRun = 64;  // triangles per run, and vertices per block

// Coarse map from triangles to vertices of a prototype: for every run of triangles the blocks of vertices
// that it uses. Topology is constant, so the map is a cache, rebuilt only for another mesh.
struct TriangleRuns {
    const Triangle* of = nullptr;
    size_t triangles = 0;
    std::vector<uint32_t> first;  // of a run: first index into block, with one more at the end
    std::vector<uint32_t> block;
};

inline void keep_runs(std::span<const Triangle> triangle, TriangleRuns& runs) {
    if (runs.of == triangle.data() && runs.triangles == triangle.size()) return;
    runs.of = triangle.data();
    runs.triangles = triangle.size();
    runs.first.clear();
    runs.block.clear();
    for (size_t begin = 0; begin < triangle.size(); begin += kRun) {
        const auto first = ptrdiff_t(runs.block.size());
        runs.first.push_back(uint32_t(first));
        for (const Triangle& t : triangle.subspan(begin, std::min<size_t>(kRun, triangle.size() - begin))) {
            for (const uint32_t v : t) runs.block.push_back(v / kRun);
        }
        std::sort(runs.block.begin() + first, runs.block.end());
        runs.block.erase(std::unique(runs.block.begin() + first, runs.block.end()), runs.block.end());
    }
    runs.first.push_back(uint32_t(runs.block.size()));
}

// An outcode has one bit for every side of a box that a vertex is beyond. Finds the bits common to all
// vertices of a block.
inline void find_block_codes(const std::vector<uint8_t>& outcode, std::vector<uint8_t>& block_code) {
    block_code.resize((outcode.size() + kRun - 1) / kRun);
    for (size_t block = 0; block < block_code.size(); ++block) {
        const size_t first = block * kRun, count = std::min<size_t>(kRun, outcode.size() - first);
        std::array<uint64_t, kRun / 8> codes;
        codes.fill(UINT64_MAX);
        std::memcpy(codes.data(), &outcode[first], count);
        uint64_t all = UINT64_MAX;
        for (const uint64_t eight : codes) all &= eight;
        for (const int shift : {32, 16, 8}) all &= all >> shift;
        block_code[block] = uint8_t(all);
    }
}

// Writes the triangles whose corners have no outcode bit in common, ascending, and returns their number;
// `found` has room for all. Runs whose vertices all share a bit are skipped; the rest is branchless, because
// branches would be mispredicted along the rim.
inline uint32_t find_sideless_triangles(std::span<const Triangle> triangle, const TriangleRuns& runs, const std::vector<uint8_t>& outcode,
                                        const std::vector<uint8_t>& block_code, uint32_t* found) {
    const Triangle* const corners = triangle.data();
    const uint8_t* const code = outcode.data();
    uint32_t count = 0;
    for (uint32_t run = 0; run + 1 < runs.first.size(); ++run) {
        uint32_t all = 0xff;
        for (uint32_t i = runs.first[run]; i < runs.first[run + 1]; ++i) all &= block_code[runs.block[i]];
        if (all != 0) continue;
        const uint32_t end = std::min(kRun * run + kRun, uint32_t(triangle.size()));
        for (uint32_t t = kRun * run; t < end; ++t) {
            const Triangle& corner = corners[t];
            const uint8_t c0 = code[corner[0]], c1 = code[corner[1]], c2 = code[corner[2]];
            found[count] = t;
            count += (c0 & c1 & c2) == 0;
        }
    }
    return count;
}

}  // namespace trocar
