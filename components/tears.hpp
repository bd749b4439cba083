#pragma once
#include <array>
#include <limits>
#include <vector>

#include "components/fields.hpp"
#include "components/links.hpp"
#include "components/math.hpp"
#include "components/mesh.hpp"
namespace trocar {

// A body that may lose springs, triangles or tetrahedra; its prototype is not shared. A shell loses triangles
// and springs. A solid loses tetrahedra: the faces behind them become surface, in elements reserved at load.
struct TearBody {
    uint32_t body = kNone;
    double break_strain = std::numeric_limits<double>::infinity();  // springs longer than (1 + this) times their rest length break
    Range order;                                                    // range of Tears::order, one per triangle; of a solid one per face
    uint32_t outer = 0;                                             // triangles at load
    Range faces;                                                    // range of Tears::face, as order; empty for a shell
    Admission whole = Admission::kSolid;                            // of the surface at load
    TROCAR_FIELDS(body, "index of bodies", break_strain, order, "range of tear triangles", outer, faces, "range of tear faces", whole);
};

// Possible surface triangle of a solid, by number. First the triangles at load: each exists as long as its
// tetrahedra do (with an embedded surface, those that its corners are embedded in). Then the faces between
// two tetrahedra, outward from the first: each is surface while exactly one of the two exists.
struct TearFace {
    Triangle corner;                        // vertices
    std::array<uint32_t, 3> tetrahedron{};  // of the prototype; a face between two tetrahedra: both and kNone
    TROCAR_FIELDS(corner, tetrahedron);
};

// Removes the triangles of a shell or tetrahedra of a solid whose centroids are in a region, and the springs
// that lose their last element.
struct Cut {
    uint32_t tear = 0;          // index into Tears::body
    double time = 0;            // s
    Region region;              // body frame, rest shape
    uint32_t material = kNone;  // only elements of this material
    TROCAR_FIELDS(tear, "index of tears", time, "s", region, material);
};

// Constant after load except `order`, which follows Torn::triangle.
struct Tears {
    std::vector<TearBody> body;  // ascending by body
    std::vector<Cut> cut;
    std::vector<uint32_t> order;  // numbers of the triangles of a prototype in their present order, absent ones last
    std::vector<TearFace> face;
    TROCAR_FIELDS(body, cut, order, face);
};

// Everything torn so far.
struct Torn {
    std::vector<uint8_t> spring;                    // as TornSprings: 1 = the half-edge is broken
    std::vector<std::array<uint32_t, 2>> triangle;  // index into Tears::body, number at load
    std::vector<uint8_t> cut;                       // one per Tears::cut: 1 = done
    std::vector<uint8_t> tetrahedron;               // as Solids::rest, up to the last solid that may tear: 1 = no
                                                    // elastic force, 2 = removed
    TROCAR_FIELDS(spring, triangle, cut, tetrahedron);
};

// Springs after tearing: as Springs::neighbour and rest_length, up to the last prototype that may tear. A
// broken half-edge refers to its own vertex and has zero length, like padding.
struct TornSprings {
    std::vector<uint32_t> neighbour;
    std::vector<float> rest_length;
    std::vector<float> factor;  // as Springs::factor, where a solid may tear: without the contribution of removed tetrahedra
    std::vector<float> rest;    // as Solids::rest and per_rest, up to the last solid that may tear; 0 for a removed one, like padding
    std::vector<float> per_rest;
    TROCAR_FIELDS(neighbour, rest_length, "m", factor, rest, "m^3", per_rest, "1/m^3");
};

}  // namespace trocar
