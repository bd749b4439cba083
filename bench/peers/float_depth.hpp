#pragma once
#include "bench/peers/signed_distance.hpp"
namespace trocar::bench {

// Signed closest-point queries in plain float without exact finishing: a tree of float boxes in world
// coordinates, textbook float triangles and pseudonormals. The method "vertex, float" of the plots.
class FloatDepth {
 public:
    explicit FloatDepth(const Soup& soup);
    void refit(const Soup& soup);
    // Largest depth of a vertex of either body inside the other; only vertices inside the other's box.
    float depth(const Soup& soup);

 private:
    struct Node {
        FloatBox box;
        uint32_t child = 0, first = 0, count = 0;  // child 0: leaf with a range of order_
    };
    Closest<float> nearest(const Soup& soup, uint32_t body, const Vec<float>& p);

    Incidence incidence_;
    std::vector<Node> node_;
    std::vector<uint32_t> root_, order_;
};

}  // namespace trocar::bench
