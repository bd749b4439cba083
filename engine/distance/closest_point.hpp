#pragma once
#include <memory>
#include <span>

#include "components/contacts.hpp"
#include "components/report.hpp"
#include "engine/geometry/point_triangle.hpp"
#include "engine/mesh/mesh_view.hpp"
namespace trocar {

struct BoxTree;

// Nearest surface point. triangle == kNone if no surface lies within the query radius.
struct SurfacePoint {
    Vec3d point = Vec3d::Zero();   // m, frame of the tree
    Vec3d normal = Vec3d::Zero();  // unit, outward: sign * (query - point) / distance, or the pseudonormal when on the surface
    double distance = 0;           // m, signed: < 0 inside; >= 0 for sheets
    uint32_t triangle = kNone;     // local triangle
    Feature feature = Feature::kFace;
};

// Counters of some queries; add_to_report adds them to a Report.
struct QueryCounters {
    uint64_t queries = 0;
    uint64_t tie_overflows = 0;
    uint64_t disagreements = 0;  // of pseudonormal and winding number, cross-checked trees only
    uint64_t settled = 0;        // answers changed by decide_side, counted by its callers
    QueryCounters& operator+=(const QueryCounters& other);
};
void add_to_report(const QueryCounters& counters, Report& report);

// Signed closest-point queries on one triangle mesh, exact to double rounding: Embree's tree over groups of 16 triangles finds
// candidates in float in a recentred frame, every triangle within a proven error bound of the best is evaluated again
// in double, and the least (squared distance, triangle id) wins. Sign: angle-weighted pseudonormal of the winning
// feature (Baerentzen & Aanaes, TVCG 11(3), 2005) for solids, generalised winding number (Jacobson et al. 2013) for
// kWinding meshes and wherever rounding could hide the side, none for sheets. Answers do not depend on hints, on earlier
// refits, or on the instruction set.
class ClosestPointTree {
 public:
    // Rigid or imported surface: doubles in the body frame. The view must outlive the tree. `like`: a tree of
    // the same arrays whose triangle groups are reused; cutting them takes four fifths of the time.
    explicit ClosestPointTree(const MeshView& mesh, const ClosestPointTree* like = nullptr, TreeSearch search = TreeSearch::kOwn);
    // Deformable surface: float offsets, one per vertex (the span may be longer).
    ClosestPointTree(const MeshView& mesh, std::span<const Float4> offset, const ClosestPointTree* like = nullptr,
                     TreeSearch search = TreeSearch::kOwn);
    ~ClosestPointTree();
    ClosestPointTree(const ClosestPointTree&) = delete;
    ClosestPointTree& operator=(const ClosestPointTree&) = delete;

    // Whether the tree refers to these arrays: adding a prototype may move them and invalidate the tree.
    bool looks_at(const MeshView& mesh) const;

    // Sets new vertex positions; rebuilds if the summed area of the nodes has grown by 30 % (Goldsmith &
    // Salmon's measure of query cost). Different trees may be refitted concurrently.
    void refit(std::span<const Float4> offset);
    // Rebuilds from the present positions (same answers, faster queries after large deformation).
    void rebuild();
    // Number of builds by Embree, and which code traverses the tree.
    uint64_t builds() const;
    TreeSearch search() const;
    // Whether both trees share their groups of triangles.
    bool cut_like(const ClosestPointTree& other) const;

    // Answers point i into out[i]. radius[i] (m, may be infinite) bounds the search: a surface at exactly
    // that distance may or may not be found, anything nearer is. hint[i] = a triangle likely to be near, or
    // kNone; an empty span means no hints. Thread-safe against other queries.
    void query(std::span<const Vec3d> points, std::span<const double> radius, std::span<const uint32_t> hint, std::span<SurfacePoint> out,
               QueryCounters& counters) const;
    SurfacePoint query(const Vec3d& point, double radius = std::numeric_limits<double>::infinity()) const;

    // Checks the sign of every answer of a solid against the winding number and counts disagreements.
    void cross_check(bool on);

    // Generalised winding number of the present surface, direct sum in double: 1 inside a closed outward one.
    double winding_number(const Vec3d& point) const;
    // winding_number(point) > 0.5. Closed surfaces count ray crossings, exactly; a point on one is not inside. In
    // open ones clusters replace far triangles where a proven bound shows no change of the result (winding_tree.hpp).
    bool winds_around(const Vec3d& point) const;
    // Sets an answer's side by the winding number at `point`: pseudonormals fail where a deformed surface has
    // folded over itself. True if the side changed.
    bool decide_side(const Vec3d& point, SurfacePoint& answer) const;

    // Position of a vertex as the queries use it.
    Vec3d vertex(uint32_t v) const;

    // Embree's hierarchy over the groups of triangles, for other traversals; the number of groups; and for every
    // triangle 16 * group + lane.
    const BoxTree& hierarchy() const;
    uint32_t groups() const;
    std::span<const uint32_t> lane_of_triangle() const;

 private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

// Version of Embree, which builds the trees: e.g. "3.13.5".
const char* closest_point_library();
// Starts Embree: on the main thread, before trees are made in parallel. Throws std::bad_alloc without memory for it.
void start_embree();

}  // namespace trocar
