#pragma once
#include <array>
#include <limits>
#include <vector>

#include "components/links.hpp"
#include "components/math.hpp"
#include "components/mesh.hpp"
namespace trocar {

// A body that may lose springs or triangles; its prototype is its own.
struct TearBody {
    uint32_t body = kNone;
    double break_strain = std::numeric_limits<double>::infinity();  // springs longer than 1 + this times their rest break
    Range order;                                                    // rows of Tears::order, one per triangle at load
    Admission whole = Admission::kSolid;                            // of the surface at load
};

// Triangles of a body whose middle lies in a region are taken away, with the springs that lose their last triangle.
struct Cut {
    uint32_t tear = 0;          // row of Tears::body
    double time = 0;            // s
    Region region;              // body frame, rest shape
    uint32_t material = kNone;  // and which are of this material
};

// Constant after load but for `order`, which follows Torn::triangle.
struct Tears {
    std::vector<TearBody> body;   // ascending by body
    std::vector<Cut> cut;
    std::vector<uint32_t> order;  // number at load of the triangles of a prototype as they lie now, removed ones last
};

// What has torn so far.
struct Torn {
    std::vector<uint8_t> spring;                    // as TornSprings: 1 = the half-edge is broken
    std::vector<std::array<uint32_t, 2>> triangle;  // row of Tears::body, number at load
    std::vector<uint8_t> cut;                       // one per Tears::cut: 1 = done
};

// Springs as they are with what has torn: as Springs::neighbour and rest_length, up to the last prototype that may tear. A
// broken half-edge names its own vertex and has no length, like padding.
struct TornSprings {
    std::vector<uint32_t> neighbour;
    std::vector<float> rest_length;
};

}  // namespace trocar
