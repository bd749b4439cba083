#pragma once
#include <array>
#include <limits>
#include <vector>

#include "components/fields.hpp"
#include "components/links.hpp"
#include "components/math.hpp"
#include "components/mesh.hpp"
namespace trocar {

// A body that may lose springs, triangles or tetrahedra; its prototype is its own. A shell loses triangles and springs. A
// solid loses tetrahedra: the faces behind them become surface, in rows that are kept for them from load on.
struct TearBody {
    uint32_t body = kNone;
    double break_strain = std::numeric_limits<double>::infinity();  // springs longer than 1 + this times their rest break
    Range order;                                                    // rows of Tears::order, one per triangle, of a solid one per face
    uint32_t outer = 0;                                             // triangles at load
    Range faces;                                                    // rows of Tears::face, as order; empty for a shell
    Admission whole = Admission::kSolid;                            // of the surface at load
    TROCAR_FIELDS(body, "row of bodies", break_strain, order, "rows of tear triangles", outer, faces, "rows of tear faces", whole);
};

// What may be surface of a solid, by its number: first the triangles at load, each there as long as its tetrahedra are (of
// a skin those that its corners ride on); then the faces between two tetrahedra, out of the first, each there while one of
// the two is alone.
struct TearFace {
    Triangle corner;                        // vertices
    std::array<uint32_t, 3> tetrahedron{};  // of the prototype; of a face between two: two of them and kNone
    TROCAR_FIELDS(corner, tetrahedron);
};

// Triangles of a shell, tetrahedra of a solid, whose middle lies in a region are taken away, with the springs that lose
// their last one.
struct Cut {
    uint32_t tear = 0;          // row of Tears::body
    double time = 0;            // s
    Region region;              // body frame, rest shape
    uint32_t material = kNone;  // and which are of this material
    TROCAR_FIELDS(tear, "row of tears", time, "s", region, material);
};

// Constant after load but for `order`, which follows Torn::triangle.
struct Tears {
    std::vector<TearBody> body;  // ascending by body
    std::vector<Cut> cut;
    std::vector<uint32_t> order;  // number of the triangles of a prototype as they lie now, those that are not there last
    std::vector<TearFace> face;
    TROCAR_FIELDS(body, cut, order, face);
};

// What has torn so far.
struct Torn {
    std::vector<uint8_t> spring;                    // as TornSprings: 1 = the half-edge is broken
    std::vector<std::array<uint32_t, 2>> triangle;  // row of Tears::body, number at load
    std::vector<uint8_t> cut;                       // one per Tears::cut: 1 = done
    std::vector<uint8_t> tetrahedron;               // as Solids::rest, up to the last solid that may tear: 1 = pulls no more, 2 = gone
    TROCAR_FIELDS(spring, triangle, cut, tetrahedron);
};

// Springs as they are with what has torn: as Springs::neighbour and rest_length, up to the last prototype that may tear. A
// broken half-edge names its own vertex and has no length, like padding.
struct TornSprings {
    std::vector<uint32_t> neighbour;
    std::vector<float> rest_length;
    std::vector<float> factor;  // as Springs::factor, where a solid may tear: less what the lost tetrahedra gave
    std::vector<float> rest;    // as Solids::rest and per_rest, up to the last solid that may tear; 0 of a lost one, like padding
    std::vector<float> per_rest;
    TROCAR_FIELDS(neighbour, rest_length, "m", factor, rest, "m^3", per_rest, "1/m^3");
};

}  // namespace trocar
