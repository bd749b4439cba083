#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/math.hpp"
#include "engine/distance/box_tree.hpp"
namespace trocar {

// Far-field expansion of a group of triangles: the moments of their area vectors about a centre up to order
// two (Barill, Dickson, Schmidt, Levin & Jacobson, Fast winding numbers for soups and clouds, ACM TOG 37(4),
// 2018). Only the symmetric parts matter, because all derivatives of a potential commute.
struct WindingCluster {
    Vec3d centre = Vec3d::Zero();     // m, centroid of the area
    Vec3d normal = Vec3d::Zero();     // sum of area vectors, m^2
    std::array<double, 6> first{};    // of normal x offset: xx yy zz xy xz yz, m^3
    std::array<double, 10> second{};  // of normal x offset x offset: xxx yyy zzz xxy xxz yyx yyz zzx zzy xyz, m^4
    double area = 0;                  // m^2
    double third = 0;                 // m^5, upper bound on the integral of |offset|^3
    double radius = 0;                // m, upper bound on |offset|
};

// A winding number and a bound on its deviation from the direct sum, rounding aside.
struct FarField {
    double value = 0;
    double error = 0;
};

WindingCluster winding_cluster(std::span<const std::array<Vec3d, 3>> triangles);
WindingCluster join_clusters(std::span<const WindingCluster> parts);

// The cluster's winding number about p; error is infinite if p is within its radius.
FarField far_field(const WindingCluster& cluster, const Vec3d& p);

// Clusters of the boxes and nodes of a tree; the caller fills those of the boxes.
struct WindingTree {
    std::vector<WindingCluster> box, node;
};
void join_winding_tree(const BoxTree& tree, WindingTree& winding);

// Winding number about p from clusters with an error of at most `tolerance` each; where there is none, from
// near(box index), which sums a box's triangles directly.
template <typename Near>  // Near: double(uint32_t)
FarField sum_winding(const BoxTree& tree, const WindingTree& winding, const Vec3d& p, double tolerance, const Near& near) {
    FarField sum;
    uint32_t stack[kBoxStack];
    uint32_t height = 0;
    if (!tree.node.empty()) stack[height++] = 0;
    while (height > 0) {
        const BoxNode& n = tree.node[stack[--height]];
        for (uint32_t i = 0; i < n.count; ++i) {
            const uint32_t child = n.child[i];
            const bool leaf = child >= kBoxLeaf;
            const FarField far = far_field(leaf ? winding.box[child & ~kBoxLeaf] : winding.node[child], p);
            if (far.error <= tolerance) {
                sum.value += far.value;
                sum.error += far.error;
            } else if (leaf) {
                sum.value += near(child & ~kBoxLeaf);
            } else {
                stack[height++] = child;
            }
        }
    }
    return sum;
}

}  // namespace trocar
