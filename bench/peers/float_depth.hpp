#pragma once
#include "bench/peers/signed_distance.hpp"
namespace trocar::bench {

// Signed closest-point queries in plain float, as a mesh library without exact finishing does them: a tree of float boxes
// in world coordinates, textbook float triangles, float pseudonormals. The method "vertex, float" of the plots.
class FloatDepth {
 public:
    explicit FloatDepth(const Soup& soup);
    void refit(const Soup& soup);
    // Largest distance of a vertex of one body inside the other, both ways; only vertices inside the other's box.
    float depth(const Soup& soup);

 private:
    struct Node {
        FloatBox box;
        uint32_t child = 0, first = 0, count = 0;  // child of 0: leaf over rows of order_
    };
    Closest<float> nearest(const Soup& soup, uint32_t body, const Vec<float>& p);

    Incidence incidence_;
    std::vector<Node> node_;
    std::vector<uint32_t> root_, order_;
};

}  // namespace trocar::bench
