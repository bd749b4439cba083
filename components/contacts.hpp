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
// Response to a pair whose overlap is so deep that the shortest separation directions disagree
// (Penetrations::saturated).
enum class DeepResponse : uint8_t { kNone, kLastFree };

// Which code traverses Embree's trees for closest points: Embree's or our own. Results are bit-identical.
enum class TreeSearch : uint8_t { kOwn, kEmbree };

// Settings of a scene under [contact].
struct ContactParams {
    double tolerance = 1e-4;               // m, accuracy of the deepest point along an edge; deeper remaining overlap gets more sweeps
    double cell_edges = 2.5;               // cell size of the occupancy grid in mean edges of the surviving triangles
    double push_speed = 0.1;               // m/s, highest speed of position correction
    uint32_t iterations = 2;               // velocity iterations over the contact constraints of an island per substep
    uint32_t constraint_capacity = 65536;  // contact constraints kept per body; beyond it the shallowest are dropped and
                                           // counted, and bodies resting on them sink
    bool cross_check = false;              // compare every solid's sign with the winding number; Report::disagreements
    ResponseShare share = ResponseShare::kMass;
    ResponseDirection direction = ResponseDirection::kLocal;
    DeepResponse deep = DeepResponse::kNone;
    TreeSearch search = TreeSearch::kOwn;
    bool faces = false;     // search faces for points deeper than their corners and edges, to tolerance; these become contacts
    bool contours = false;  // intersection stage: where surfaces cross
    bool regions = false;   // overlap regions of every pair; needs the contours and finds them
    bool hulls = false;     // free convex bodies touch as convex hulls where they hardly move past each other: touch_as_hulls
    TROCAR_FIELDS(tolerance, "m", push_speed, "m/s", cell_edges, iterations, constraint_capacity, share, direction, deep, search, faces,
                  contours, regions, hulls, cross_check);
};

// Broad-phase pairs: bodies whose enlarged boxes overlap, a < b, ascending. Static-static pairs are excluded.
struct BroadPhasePairs {
    std::vector<uint32_t> a, b;  // body indices
    TROCAR_FIELDS(a, b);
};

// Box in eight floats, so that one vector comparison tests two boxes for overlap.
struct alignas(32) PackedBox {
    std::array<float, 4> min{};      // x, y, z, 0; m
    std::array<float, 4> neg_max{};  // -x, -y, -z, 0; m
};

// Triangles that can matter in this contact pass: their box, enlarged by their body's speculative margin and
// half the thickness of a sheet, meets the overlap of two enlarged body boxes. Non-finite triangles are
// excluded.
struct ScreenedTriangles {
    Vec3d origin = Vec3d::Zero();    // m, world: boxes are relative to it
    std::vector<Range> body;         // per body: range of triangle; empty for a body in no pair
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
    std::vector<uint32_t> object_first;     // cell -> range of object; cell_key.size() + 1
    std::vector<uint32_t> object;           // object layer: body
    std::vector<uint32_t> primitive_first;  // index of object -> range of primitive; object.size() + 1
    std::vector<uint32_t> primitive;        // primitive layer: local triangle, ascending
    std::vector<uint32_t> primitive_row;    // the same triangles as indices into ScreenedTriangles
    std::vector<uint32_t> oversize;         // indices into ScreenedTriangles of those that span too many cells, ascending; tested by box
    TROCAR_FIELDS(cell_size, "m", origin, "m", cell_key, object_first, object, primitive_first, primitive, primitive_row, oversize);
};

// Result of the shared cells per broad-phase pair: the triangles near the other body (their enlarged boxes
// meet) and the pairs of triangles that may cross (their own boxes meet). Two sides per broad-phase pair: 2p
// = triangles of a, 2p + 1 of b.
struct CandidateTriangles {
    std::vector<Range> pair;                        // per broad-phase pair: range of triangle
    std::vector<std::array<uint32_t, 2>> triangle;  // may cross: local triangle of a, of b; ascending, each once
    std::vector<uint8_t> beside;                    // per element of triangle: 1 if they certainly do not cross; empty: not tested
    std::vector<Range> side;                        // range of near
    std::vector<std::array<uint32_t, 2>> near;      // local triangle, ascending, each once; one triangle of the other body that it is near
    std::vector<uint8_t> near_corners;              // per element of near: bit k for corner k, 0 if that corner certainly stays away
    TROCAR_FIELDS(pair, triangle, beside, side, near, near_corners);
};

// Signed distances computed by the overlap stage: for every vertex of a triangle near the other surface,
// except those that CandidateTriangles exclude, and for every vertex of a piece inside it. Two sides per
// broad-phase pair: 2p = vertices of a against b, 2p + 1 the reverse.
struct NearVertices {
    std::vector<Range> side;         // range of vertex
    std::vector<uint32_t> vertex;    // local vertex, ascending within a side
    std::vector<double> distance;    // m, signed, to the other surface (sheets: less half the thickness)
    std::vector<uint32_t> triangle;  // local triangle of the other body that is nearest
    TROCAR_FIELDS(side, vertex, distance, "m", triangle);
};

// Points of one body's surface near or inside another body. Ascending (pair, side, vertex before edge before face,
// index).
struct Contacts {
    std::vector<uint32_t> pair;                   // index into BroadPhasePairs
    std::vector<uint32_t> body;                   // body that owns the point
    std::vector<uint32_t> other;                  // body whose surface it is near
    std::vector<std::array<uint32_t, 2>> vertex;  // local vertices of body; equal for a vertex point
    std::vector<float> along;                     // point = (1 - along - across) * vertex[0] + along * vertex[1]
    std::vector<uint32_t> third;                  // of a point inside a face: its third corner; else kNone
    std::vector<float> across;                    // and + across * third; else 0
    std::vector<Vec3d> point;                     // world, m
    std::vector<Vec3d> closest;                   // nearest surface point of other, world, m
    std::vector<Vec3d> normal;                    // unit, outward from other
    std::vector<double> distance;                 // m, signed, < 0 inside
    std::vector<uint32_t> triangle;               // local triangle of other that holds `closest`
    std::vector<double> most;                     // m, per broad-phase pair, with ContactParams::faces: bound on the
                                                  // depth if the search of faces had to stop; else 0
    TROCAR_FIELDS(pair, body, other, vertex, along, third, across, point, "m", closest, "m", normal, distance, "m", triangle, most, "m");
};

// Curves of segments where the surfaces of broad-phase pairs cross. b counts as moved against a by an
// infinitesimal (e, e^2, e^3), which decides coplanar, touching and doubled cases, so on closed surfaces
// every curve is closed. A touch may give a curve of zero length or none.
struct Contours {
    std::vector<Range> pair;                        // per broad-phase pair: range of curve
    std::vector<Range> curve;                       // range of segment, in order along the curve
    std::vector<uint8_t> closed;                    // per curve; open only at the rim of a sheet
    std::vector<std::array<uint32_t, 2>> triangle;  // per segment: local triangle of a, of b
    std::vector<std::array<uint32_t, 2>> end;       // per segment: indices of point; on a, the part inside b is to the left
    std::vector<Vec3d> point;                       // world, m: an edge of one body on a triangle of the other
    std::vector<uint32_t> edge;                     // per point: local edge
    std::vector<uint8_t> edge_of_b;                 // per point: 1 if the edge is b's; the triangle is the other body's
    std::vector<uint32_t> pierced;                  // per point: local triangle that the edge crosses
    std::vector<double> along;                      // per point: fraction of the edge from its lower vertex
    std::vector<uint8_t> outward;                   // per point: the directed edge leaves the other body here
    TROCAR_FIELDS(pair, curve, closed, triangle, end, point, "m", edge, edge_of_b, pierced, along, outward);
};

// Connected parts of the overlap of two closed bodies. Ascending by pair, then by first inside vertex.
struct OverlapRegions {
    std::vector<uint32_t> pair;        // index into BroadPhasePairs
    std::vector<uint32_t> vertices_a;  // of a inside b
    std::vector<uint32_t> vertices_b;
    std::vector<uint32_t> curves;   // of Contours
    std::vector<double> contour;    // m, total length of the curves
    std::vector<double> area;       // m^2, of both surfaces inside the other: the boundary of the region
    std::vector<double> volume;     // m^3
    std::vector<double> depth;      // m, largest of the shortest distances
    std::vector<Vec3d> direction;   // unit, direction in which b leaves a; zero without a witness
    std::vector<uint32_t> witness;  // index into Contacts, kNone if no vertex or edge point is inside
    TROCAR_FIELDS(pair, vertices_a, vertices_b, curves, contour, "m", area, "m^2", volume, "m^3", depth, "m", direction, witness);
};

// Last valid separation directions of pairs of bodies, for DeepResponse::kLastFree. Without it: the pairs that started inside each
// other and are being parted (find_parting_pairs). Ascending by (a, b).
struct PairMemory {
    std::vector<uint32_t> a, b;    // bodies
    std::vector<Vec3d> direction;  // unit, direction in which b left a; of pairs being parted as long as the travel that is left, m
    TROCAR_FIELDS(a, b, direction);
};

// Contact constraints of the preceding contact pass with a nonzero impulse, and those of edges, in order: the
// warm start of constraints of the same points.
struct ContactMemory {
    std::vector<uint32_t> body, other;
    std::vector<std::array<uint32_t, 2>> vertex;  // local vertices of body
    std::vector<float> along;                     // as in ContactConstraints
    std::vector<Vec3d> force;                     // N, on body, world axes, in the last substep
    TROCAR_FIELDS(body, "index of bodies", other, "index of bodies", vertex, along, force, "N");
};

// Identifies a point of a body against another body, in the order of Contacts: pair, side, vertices before
// edges before faces.
struct PointKey {
    uint64_t pair = 0, point = 0;
    auto operator<=>(const PointKey&) const = default;
    TROCAR_FIELDS(pair, point);
};

// ContactMemory sorted by point.
struct ContactMemoryOrder {
    std::vector<uint32_t> order;  // indices into ContactMemory, ascending by point
    std::vector<PointKey> key;    // per constraint of ContactMemory
    TROCAR_FIELDS(order, key);
};

// Depth of every overlapping broad-phase pair. `depth` is the thesis depth: the largest of the shortest
// distances.
struct Penetrations {
    std::vector<uint32_t> pair;     // index into BroadPhasePairs
    std::vector<double> depth;      // m
    std::vector<Vec3d> direction;   // unit, direction in which b leaves a
    std::vector<uint32_t> witness;  // index into Contacts
    std::vector<uint32_t> vertices_a_in_b;
    std::vector<uint32_t> vertices_b_in_a;
    std::vector<uint32_t> edge_contacts;
    std::vector<uint32_t> face_contacts;
    std::vector<uint8_t> saturated;           // so deep that other separation directions are about as short; see mark_saturated
    std::vector<Vec3d> separation_direction;  // unit, last valid separation direction of a saturated pair; zero if not saturated or unknown
    std::vector<double> surface_depth;        // m, with ContactParams::faces: no point of either surface is deeper by more
                                              // than the tolerance; else equal to depth
    TROCAR_FIELDS(pair, depth, "m", direction, witness, vertices_a_in_b, vertices_b_in_a, edge_contacts, face_contacts, saturated,
                  separation_direction, surface_depth, "m");
};

// Contact constraints of this period, one-sided: a point of `body` stays outside a plane attached to a
// triangle of `other`. Same order as Contacts.
struct ContactConstraints {
    std::vector<uint32_t> contact;  // index into Contacts
    std::vector<uint32_t> body, other;
    std::vector<std::array<uint32_t, 2>> vertex;  // local vertices of body
    std::vector<float> along;
    std::vector<uint32_t> third;  // as in Contacts
    std::vector<float> across;
    std::vector<Triangle> triangle;            // local vertices of the triangle of other
    std::vector<std::array<float, 3>> weight;  // barycentric coordinates of the plane point, sum 1
    std::vector<Vec3d> normal;                 // unit, outward from other; in the body frame if other is rigid
    std::vector<double> distance;              // m, at the start of the period; infinite once the constraint has expired
    std::vector<float> friction;
    std::vector<Vec3d> impulse;     // N s, on body, summed over the period (written by response)
    std::vector<Vec3d> warm_start;  // N, warm-start force on body, world axes, from the substep before the period; empty = zero
    std::vector<double> gap;        // m, that the point keeps from the plane, if above 0: of self-contacts; empty = none
    TROCAR_FIELDS(contact, body, other, vertex, along, third, across, triangle, weight, normal, distance, "m", friction, impulse, "N s",
                  warm_start, "N", gap, "m");
};

inline double gap_of(const ContactConstraints& constraints, uint32_t constraint) {
    return constraint < constraints.gap.size() ? constraints.gap[constraint] : 0;
}

// Bodies joined by contact constraints. Islands ascend by smallest body; bodies and constraints ascend.
struct Islands {
    std::vector<Range> bodies;  // per island: range of body
    std::vector<uint32_t> body;
    std::vector<Range> constraints;    // per island: range of `constraint`
    std::vector<uint32_t> constraint;  // indices into ContactConstraints
    TROCAR_FIELDS(bodies, body, constraints, constraint);
};

}  // namespace trocar
