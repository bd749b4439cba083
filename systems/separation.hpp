#pragma once
#include <functional>
#include <span>
#include <vector>

#include "components/math.hpp"
namespace trocar {

// A point of one body inside the other: b leaves by `depth` along `way`.
struct WayOut {
    Vec3d way = Vec3d::Zero();  // unit
    double depth = 0;           // m, > 0
};

// What is found with b moved: free = proven by exact tests that the bodies have no common point.
struct SeparationAnswer {
    bool free = false;
    double depth = 0;          // m, the thesis depth
    std::vector<WayOut> ways;  // of the contacts inside, any order
};

struct SeparationParams {
    uint32_t most_probes = 400;
    double accuracy = 0.005;  // of the length, how far the search along a line goes
};

// The shortest translation of b that separates it from a (PD) lies between lower and upper.
struct Separation {
    double lower = 0;                   // m, proven: the largest of the shortest distances
    double upper = 0;                   // m, length of `translation`
    Vec3d translation = Vec3d::Zero();  // m, of b; proven free
    uint32_t probes = 0;
};

// Searches for the shortest translation that separates two bodies. `a` and `b` are points whose hulls hold the bodies;
// `ask` looks at b moved by a translation. From many starts: along fixed directions and those of the contacts, by steps
// of the depth found (nothing shorter can be free); and by the least translation that satisfies all planes of the
// contacts met so far, as PolyDepth projects onto contact space (Je et al., ACM TOG 31(1), 2012). The best is turned and
// shortened until nothing near it is shorter. A local optimum is possible; the answer is an upper bound always.
Separation find_separation(const SeparationParams& params, std::span<const Vec3d> a, std::span<const Vec3d> b,
                           const std::function<SeparationAnswer(const Vec3d&)>& ask);

}  // namespace trocar
