#pragma once
#include "bench/peers/soup.hpp"
namespace trocar::bench {

// Other methods of finding triangle pairs of different bodies whose boxes overlap; equal results.

// The thesis' construction and instruction (3.3.1, 3.3.2) without body boxes: every triangle of every body is
// rasterised, cells are counted by object, and only those of several objects are filled and compared. Hashing
// as in the engine: 64-bit keys, compared, slots of the first pass reused in the second.
class RasteriseAll {
 public:
    void find(const Soup& soup, double cell_size, TrianglePairs& pairs);

 private:
    struct Slot {
        uint64_t key;
        uint32_t body, shared;
    };
    std::vector<Slot> table_;
    std::vector<uint32_t> used_, slot_, row_, first_, list_;
    std::vector<uint64_t> key_;
    std::vector<FloatBox> box_;
};

// Sweep-and-prune over body boxes, then simultaneous descent of both trees of every pair of bodies. A tree is
// a linear bounding volume hierarchy over Morton order (Lauterbach et al. 2009), four triangles per leaf,
// built once and refitted while its body is in a pair.
class SweptTrees {
 public:
    explicit SweptTrees(const Soup& soup);
    void find(const Soup& soup, TrianglePairs& pairs);

 private:
    struct Node {
        FloatBox box;
        uint32_t child = 0;             // first of two; 0 = leaf
        uint32_t first = 0, count = 0;  // indices into order_
    };
    void build(const Soup& soup, uint32_t body);
    void refit(const Soup& soup, uint32_t body);
    void descend(uint32_t a, uint32_t b, TrianglePairs& pairs);

    std::vector<Node> node_;
    std::vector<Range> nodes_;     // per body, the root first
    std::vector<uint32_t> order_;  // triangles
    std::vector<FloatBox> triangle_box_, body_box_;
    std::vector<uint32_t> sweep_;
    std::vector<uint8_t> fresh_;
    std::vector<std::array<uint32_t, 2>> stack_, met_;
};

// Every body box against every other, then every triangle box against every other.
void find_by_brute_force(const Soup& soup, TrianglePairs& pairs);

}  // namespace trocar::bench
