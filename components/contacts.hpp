#pragma once
#include <array>
#include <compare>
#include <cstdint>
#include <vector>

#include "components/fields.hpp"
#include "components/math.hpp"
#include "components/mesh.hpp"
namespace trocar {

enum class ResponseShare : uint8_t { kMass, kStiffness, kHalf };
enum class ResponseDirection : uint8_t { kLocal, kThesis };
// What pushes a pair whose overlap is so deep that shortest ways out no longer agree (Penetrations::saturated).
enum class DeepResponse : uint8_t { kNone, kLastFree };

// Who walks the trees of Embree for closest points: Embree itself or a walk of our own. Answers are the same to the bit.
enum class TreeSearch : uint8_t { kOwn, kEmbree };

// What a scene may set under [contact].
struct ContactParams {
    double tolerance = 1e-4;        // m, deepest point along an edge is found to this; what is left deeper is swept more often
    double cell_edges = 2.5;        // cell size of the occupancy grid in mean edges of the surviving triangles
    double push_speed = 0.1;        // m/s, fastest removal of remaining overlap
    uint32_t iterations = 2;        // velocity passes over the rows of an island per substep
    uint32_t row_capacity = 65536;  // rows kept per body; beyond it the shallowest go, counted, and what lies on them sinks
    bool cross_check = false;       // compare every solid's sign with the winding number; Report::disagreements
    ResponseShare share = ResponseShare::kMass;
    ResponseDirection direction = ResponseDirection::kLocal;
    DeepResponse deep = DeepResponse::kNone;
    TreeSearch search = TreeSearch::kOwn;
    bool faces = false;     // search faces for points deeper than their corners and edges, to tolerance: contacts too
    bool contours = false;  // intersection stage: where surfaces cross
    bool regions = false;   // overlap regions of every pair; needs the contours and finds them
    TROCAR_FIELDS(tolerance, "m", push_speed, "m/s", cell_edges, iterations, row_capacity, share, direction, deep, search, faces, contours, regions,
                  cross_check);
};

// Pairs of bodies whose enlarged boxes overlap, a < b, ascending. Static-static pairs are left out.
struct CandidatePairs {
    std::vector<uint32_t> a, b;  // body rows
    TROCAR_FIELDS(a, b);
};

// Box in eight floats, so that one comparison of a vector register tells whether two boxes meet.
struct alignas(32) PackedBox {
    std::array<float, 4> min{};      // x, y, z, 0; m
    std::array<float, 4> neg_max{};  // -x, -y, -z, 0; m
};

// Triangles that can matter this pass: their box, enlarged by the reach of their body (margin, and half the thickness
// of a sheet), meets the overlap of two enlarged body boxes. Non-finite triangles are left out.
struct ScreenedTriangles {
    Vec3d origin = Vec3d::Zero();    // m, world: boxes are relative to it
    std::vector<Range> body;         // per body: rows of triangle; empty for a body in no pair
    std::vector<uint32_t> triangle;  // local, ascending within a body
    std::vector<PackedBox> box;      // enlarged, rounded outward
    std::vector<PackedBox> tight;    // of the triangle alone, rounded outward
    TROCAR_FIELDS(origin, "m", body, triangle, box, "m", tight, "m");
};

// The occupancy grid (thesis: OHC) as three flat layers. Only cells shared by two or more bodies are filled.
struct Occupancy {
    double cell_size = 0;                   // m
    Vec3d origin = Vec3d::Zero();           // corner of cell (0, 0, 0), m, world
    std::vector<uint64_t> cell_key;         // cell layer: packed 21-bit x, y, z, ascending
    std::vector<uint32_t> object_first;     // cell -> rows of object; cell_key.size() + 1
    std::vector<uint32_t> object;           // object layer: body
    std::vector<uint32_t> primitive_first;  // object row -> rows of primitive; object.size() + 1
    std::vector<uint32_t> primitive;        // primitive layer: local triangle, ascending
    std::vector<uint32_t> primitive_row;    // the same triangles as rows of ScreenedTriangles
    std::vector<uint32_t> oversize;         // rows of ScreenedTriangles that span too many cells, ascending; tested by box
    TROCAR_FIELDS(cell_size, "m", origin, "m", cell_key, object_first, object, primitive_first, primitive, primitive_row, oversize);
};

// What the shared cells say about each candidate pair: which triangles are near the other body, that is, whose enlarged
// boxes meet; and which pairs of triangles may cross, that is, whose own boxes meet. Two sides per candidate pair: 2p =
// triangles of a, 2p + 1 of b.
struct CandidateTriangles {
    std::vector<Range> pair;                        // per candidate pair: rows of triangle
    std::vector<std::array<uint32_t, 2>> triangle;  // may cross: local triangle of a, of b; ascending, each once
    std::vector<uint8_t> beside;                    // per row of triangle: 1 if they surely do not cross; empty: not looked at
    std::vector<Range> side;                        // rows of near
    std::vector<std::array<uint32_t, 2>> near;      // local triangle, ascending, each once; one of the other it is near
    std::vector<uint8_t> near_corners;              // per row of near: bit k of corner k, 0 where that one surely stays away
    TROCAR_FIELDS(pair, triangle, beside, side, near, near_corners);
};

// Signed distances that the overlap phase has worked out: every vertex of a triangle near the other surface but those
// that candidates leave out, and every vertex of a piece that lies inside it. Two sides per candidate pair: 2p = vertices
// of a against b, 2p + 1 the reverse.
struct NearVertices {
    std::vector<Range> side;         // rows of vertex
    std::vector<uint32_t> vertex;    // local vertex, ascending within a side
    std::vector<double> distance;    // m, signed, to the other surface (sheets: less half the thickness)
    std::vector<uint32_t> triangle;  // local triangle of the other body that is nearest
    TROCAR_FIELDS(side, vertex, distance, "m", triangle);
};

// Points of one body's surface near or inside another body. Ascending (pair, side, vertex before edge before face,
// index).
struct Contacts {
    std::vector<uint32_t> pair;                   // row of CandidatePairs
    std::vector<uint32_t> body;                   // whose point it is
    std::vector<uint32_t> other;                  // whose surface it is near
    std::vector<std::array<uint32_t, 2>> vertex;  // local vertices of body; equal for a vertex point
    std::vector<float> along;                     // point = (1 - along - across) * vertex[0] + along * vertex[1]
    std::vector<uint32_t> third;                  // of a point inside a face: its third corner; else kNone
    std::vector<float> across;                    // and + across * third; else 0
    std::vector<Vec3d> point;                     // world, m
    std::vector<Vec3d> closest;                   // nearest surface point of other, world, m
    std::vector<Vec3d> normal;                    // unit, outward from other
    std::vector<double> distance;                 // m, signed, < 0 inside
    std::vector<uint32_t> triangle;               // local triangle of other that holds `closest`
    std::vector<double> most;                     // m, per candidate pair, with ContactParams::faces: if the search of
                                                  // faces had to stop, nothing is deeper than this; else 0
    TROCAR_FIELDS(pair, body, other, vertex, along, third, across, point, "m", closest, "m", normal, distance, "m", triangle, most, "m");
};

// Where the surfaces of candidate pairs cross, as curves of segments. b counts as moved against a by an infinitesimal
// (e, e^2, e^3): coplanar, touching and doubled places are decided as that move decides them, so on closed surfaces every
// curve is closed. A touch may leave a curve of no length or none.
struct Contours {
    std::vector<Range> pair;                        // per candidate pair: rows of curve
    std::vector<Range> curve;                       // rows of segment, in order along the curve
    std::vector<uint8_t> closed;                    // per curve; open only at the rim of a sheet
    std::vector<std::array<uint32_t, 2>> triangle;  // per segment: local triangle of a, of b
    std::vector<std::array<uint32_t, 2>> end;       // per segment: rows of point; what is inside b lies left of it on a
    std::vector<Vec3d> point;                       // world, m: an edge of one body on a triangle of the other
    std::vector<uint32_t> edge;                     // per point: local edge
    std::vector<uint8_t> edge_of_b;                 // per point: whose edge; the triangle is the other body's
    std::vector<uint32_t> pierced;                  // per point: local triangle that the edge passes
    std::vector<double> along;                      // per point: part of the way from the edge's lower vertex
    std::vector<uint8_t> outward;                   // per point: the edge, so directed, leaves the other body there
    TROCAR_FIELDS(pair, curve, closed, triangle, end, point, "m", edge, edge_of_b, pierced, along, outward);
};

// Connected parts of the overlap of two closed bodies. Ascending by pair, then by first inside vertex.
struct OverlapRegions {
    std::vector<uint32_t> pair;        // row of CandidatePairs
    std::vector<uint32_t> vertices_a;  // of a inside b
    std::vector<uint32_t> vertices_b;
    std::vector<uint32_t> curves;   // of Contours
    std::vector<double> contour;    // m, length of those
    std::vector<double> area;       // m^2, of both surfaces inside the other: what bounds the region
    std::vector<double> volume;     // m^3
    std::vector<double> depth;      // m, largest of the shortest distances
    std::vector<Vec3d> direction;   // unit, the way b must go to leave a; zero without a witness
    std::vector<uint32_t> witness;  // row of Contacts, kNone if no vertex or edge point is inside
    TROCAR_FIELDS(pair, vertices_a, vertices_b, curves, contour, "m", area, "m^2", volume, "m^3", depth, "m", direction, witness);
};

// Ways out that pairs of bodies last agreed on, for DeepResponse::kLastFree. Ascending by (a, b).
struct PairMemory {
    std::vector<uint32_t> a, b;    // bodies
    std::vector<Vec3d> direction;  // unit, the way b left a
    TROCAR_FIELDS(a, b, direction);
};

// Contact rows of the pass before that carried something, and those of edges, in their order: what rows of the same
// points start from.
struct ContactMemory {
    std::vector<uint32_t> body, other;
    std::vector<std::array<uint32_t, 2>> vertex;  // local vertices of body
    std::vector<float> along;                     // as in ContactRows
    std::vector<Vec3d> force;                     // N, on body, world axes, in the last substep
    TROCAR_FIELDS(body, "row of bodies", other, "row of bodies", vertex, along, force, "N");
};

// Which point of a body against which other, in the order of Contacts: pair, side, vertices before edges before faces.
struct PointKey {
    uint64_t pair = 0, point = 0;
    auto operator<=>(const PointKey&) const = default;
    TROCAR_FIELDS(pair, point);
};

// ContactMemory sorted by point.
struct ContactMemoryOrder {
    std::vector<uint32_t> order;  // rows of ContactMemory, ascending by point
    std::vector<PointKey> key;    // per row of ContactMemory
    TROCAR_FIELDS(order, key);
};

// Depth of every candidate pair that overlaps. `depth` is the thesis depth: the largest of the shortest distances.
struct Penetrations {
    std::vector<uint32_t> pair;     // row of CandidatePairs
    std::vector<double> depth;      // m
    std::vector<Vec3d> direction;   // unit, the way b must go to leave a
    std::vector<uint32_t> witness;  // row of Contacts
    std::vector<uint32_t> vertices_a_in_b;
    std::vector<uint32_t> vertices_b_in_a;
    std::vector<uint32_t> edge_contacts;
    std::vector<uint32_t> face_contacts;
    std::vector<uint8_t> saturated;     // so deep that other ways out are about as short; see mark_saturated
    std::vector<Vec3d> way_out;         // unit, what a saturated pair last agreed on; zero if not saturated or unknown
    std::vector<double> surface_depth;  // m, with ContactParams::faces: no point of either surface is deeper by more
                                        // than the tolerance; else equal to depth
    TROCAR_FIELDS(pair, depth, "m", direction, witness, vertices_a_in_b, vertices_b_in_a, edge_contacts, face_contacts, saturated, way_out,
                  surface_depth, "m");
};

// One-sided constraints for the substeps of this period: a point of `body` stays outside a plane that rides on a
// triangle of `other`. Same order as Contacts.
struct ContactRows {
    std::vector<uint32_t> contact;  // row of Contacts
    std::vector<uint32_t> body, other;
    std::vector<std::array<uint32_t, 2>> vertex;  // local vertices of body
    std::vector<float> along;
    std::vector<uint32_t> third;  // as in Contacts
    std::vector<float> across;
    std::vector<Triangle> triangle;            // local vertices of the triangle of other
    std::vector<std::array<float, 3>> weight;  // barycentric coordinates of the plane point, sum 1
    std::vector<Vec3d> normal;                 // unit, outward from other; in the body frame if other is rigid
    std::vector<double> distance;              // m, at the start of the period; infinite once the row has ended
    std::vector<float> friction;
    std::vector<Vec3d> impulse;  // N s, on body, summed over the period (written by response)
    std::vector<Vec3d> carried;  // N, on body, world axes, in the last substep before; empty = nothing
    TROCAR_FIELDS(contact, body, other, vertex, along, third, across, triangle, weight, normal, distance, "m", friction, impulse, "N s",
                  carried, "N");
};

// Bodies joined by contact rows. Islands ascend by their smallest body; bodies and rows inside ascend.
struct Islands {
    std::vector<Range> bodies;  // per island: rows of body
    std::vector<uint32_t> body;
    std::vector<Range> rows;    // per island: rows of row
    std::vector<uint32_t> row;  // rows of ContactRows
    TROCAR_FIELDS(bodies, body, rows, row);
};

}  // namespace trocar
