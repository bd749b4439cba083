#pragma once
#include <array>
#include <functional>
#include <vector>

#include "engine/distance/closest_point.hpp"
#include "engine/mesh/surfaces.hpp"
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
    uint32_t most_probes = 800;
    uint32_t most_cells = 300000;  // of translations
    double line = 0.005;           // relative precision of the search along a line
    double accuracy = 0.001;       // of convex bodies: relative width of the bracket
    double bracket = 0.04;         // of others: the same, where the limits suffice
};

// A closed body at its home place.
struct SeparatedBody {
    std::vector<Vec3d> point;                           // vertices, m
    std::vector<Vec3d> sample;                          // points on its surface, m
    double concavity = 0;                               // m, it holds a shape whose supports lie at most so far below theirs
    std::function<SurfacePoint(const Vec3d&)> nearest;  // signed closest point
};
SeparatedBody separated_body(const Surfaces& surfaces, const ClosestPointTree& tree, uint32_t body);

// The length of the shortest separating translation of b (penetration depth PD) lies between lower and upper.
struct Separation {
    double lower = 0;                   // m, proven
    double upper = 0;                   // m, length of `translation`
    Vec3d translation = Vec3d::Zero();  // m, of b; proven free
    uint32_t probes = 0;
};

// Finds the shortest translation of b that separates two bodies; `ask` tests b at one. Hulls first: their translation
// is the bodies' own as far as both are convex. Others are searched for a shorter one, along fixed and contact
// directions, in steps of the depth found (nothing shorter can be free), and at the shortest translation that satisfies
// all contact planes met, as PolyDepth projects onto contact space (Je et al., ACM TOG 31(1), 2012); the best is then
// rotated and shortened. Branch and bound over translations proves the lower bound: a point or ball inside one body
// that reaches into the other keeps every translation shorter than its overlap from being free.
Separation find_separation(const SeparationParams& params, const std::array<SeparatedBody, 2>& bodies,
                           const std::function<SeparationAnswer(const Vec3d&)>& ask);

}  // namespace trocar
