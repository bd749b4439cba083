#pragma once
#include <functional>
#include <span>
#include <vector>

#include "components/math.hpp"
namespace trocar {

// Contact of a point of one body inside the other: b leaves by `depth` in `direction`.
struct SeparatingTranslation {
    Vec3d direction = Vec3d::Zero();  // unit
    double depth = 0;                 // m, > 0
};

// Result with b translated: free = exact tests prove that the bodies have no common point.
struct SeparationAnswer {
    bool free = false;
    double depth = 0;                               // m, the thesis depth
    std::vector<SeparatingTranslation> directions;  // of the inside contacts, any order
};

struct SeparationParams {
    uint32_t most_probes = 400;
    double accuracy = 0.005;  // relative precision of the search along a line
};

// The length of the shortest separating translation of b (penetration depth PD) lies between lower and upper.
struct Separation {
    double lower = 0;                   // m, proven: the largest of the shortest distances
    double upper = 0;                   // m, length of `translation`
    Vec3d translation = Vec3d::Zero();  // m, of b; proven free
    uint32_t probes = 0;
};

// Searches for the shortest translation of b that separates two bodies. `a` and `b` are points whose hulls
// contain the bodies; `ask` tests b at a translation. Starts along fixed and contact directions, in steps of
// the depth found (nothing shorter can be free), and at the shortest translation that satisfies all contact
// planes met, as PolyDepth projects onto contact space (Je et al., ACM TOG 31(1), 2012). The best is then
// rotated and shortened. The optimum may be local; the answer is always an upper bound.
Separation find_separation(const SeparationParams& params, std::span<const Vec3d> a, std::span<const Vec3d> b,
                           const std::function<SeparationAnswer(const Vec3d&)>& ask);

}  // namespace trocar
