#pragma once
#include <vector>

#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// Maxwell elements next to the springs of a body that relaxes (Bodies::prony).
struct RelaxingBody {
    uint32_t body = kNone;
    uint32_t branches = 0;
    uint32_t first = 0;         // of its half-edges in stretch
    uint32_t first_branch = 0;  // of its elements in overstretch
    uint32_t count = 0;         // half-edges, with padding: 16 per column of its prototype
    TROCAR_FIELDS(body, "index of bodies", branches, first, first_branch, count);
};

// The state of all of them, one element per half-edge, in the order of Springs: each end of a spring has its own copy, of the
// same bits.
struct Relaxation {
    std::vector<RelaxingBody> body;  // ascending by body
    std::vector<float> stretch;      // m, length - rest length at the last evaluation of the forces
    std::vector<float> overstretch;  // m, tension of a branch / stiffness of the spring; branch by branch
    TROCAR_FIELDS(body, stretch, "m", overstretch, "m");
};

inline const RelaxingBody* find_relaxing(const Relaxation& relaxation, uint32_t body) {
    for (const RelaxingBody& b : relaxation.body)
        if (b.body == body) return &b;
    return nullptr;
}

}  // namespace trocar
