#pragma once
#include <memory>
#include <span>

#include "components/contacts.hpp"
#include "components/report.hpp"
#include "engine/geometry/point_triangle.hpp"
#include "engine/mesh_view.hpp"
namespace trocar {

struct BoxTree;

// Nearest surface point. triangle == kNone when nothing lies within the radius asked for.
struct SurfacePoint {
    Vec3d point = Vec3d::Zero();   // m, frame of the tree
    Vec3d normal = Vec3d::Zero();  // unit, outward: sign * (query - point) / distance, or the pseudonormal when on the surface
    double distance = 0;           // m, signed: < 0 inside. Unsigned (>= 0) for sheets
    uint32_t triangle = kNone;     // local triangle
    Feature feature = Feature::kFace;
};

// Counters of some queries; add_to_report adds them to a Report.
struct QueryCounters {
    uint64_t queries = 0;
    uint64_t tie_overflows = 0;
    uint64_t disagreements = 0;  // of pseudonormal and winding number, cross-checked trees only
    uint64_t settled = 0;        // answers that settle_side changed, for its callers to count
    QueryCounters& operator+=(const QueryCounters& other);
};
void add_to_report(const QueryCounters& counters, Report& report);

// Signed closest-point queries on one triangle mesh, exact to double rounding: Embree's tree over groups of 16 triangles finds
// candidates in float in a recentred frame, every triangle within a proven error bound of the best is evaluated again
// in double, and the least (squared distance, triangle id) wins. Sign: angle-weighted pseudonormal of the winning
// feature (Baerentzen & Aanaes, TVCG 11(3), 2005) for solids, generalised winding number (Jacobson et al. 2013) for
// kWinding meshes, none for sheets. Answers do not depend on hints, on earlier refits, or on the instruction set.
class ClosestPointTree {
 public:
    // Rigid or imported surface: doubles in the body frame. The view must outlive the tree. `like`: another tree of the same
    // rows, whose groups of triangles this one shares; cutting them anew would take four fifths of the time.
    explicit ClosestPointTree(const MeshView& mesh, const ClosestPointTree* like = nullptr, TreeSearch search = TreeSearch::kOwn);
    // Deformable surface: float offsets, one per vertex (more rows may follow).
    ClosestPointTree(const MeshView& mesh, std::span<const Float4> offset, const ClosestPointTree* like = nullptr,
                     TreeSearch search = TreeSearch::kOwn);
    ~ClosestPointTree();
    ClosestPointTree(const ClosestPointTree&) = delete;
    ClosestPointTree& operator=(const ClosestPointTree&) = delete;

    // Whether the tree looks at these very rows: adding a prototype may move them away, then nothing may be asked of it.
    bool looks_at(const MeshView& mesh) const;

    // Takes new vertex positions; builds afresh where the summed area of the nodes has grown by 30 % (Goldsmith &
    // Salmon's measure of a query's work). Different trees may be refitted at the same time.
    void refit(std::span<const Float4> offset);
    // Builds afresh from the present positions (same answers, faster queries after large deformation).
    void rebuild();
    // How often Embree has built the tree, and who walks it.
    uint64_t builds() const;
    TreeSearch search() const;
    // Whether both share their groups of triangles.
    bool cut_like(const ClosestPointTree& other) const;

    // Answers point i into out[i]. radius[i] (m, may be infinite) bounds the search: a surface at exactly that
    // distance may or may not be found, anything nearer is. hint[i] = a triangle likely to be near, or kNone; an empty
    // span means no hints. Thread-safe against other queries.
    void query(std::span<const Vec3d> points, std::span<const double> radius, std::span<const uint32_t> hint, std::span<SurfacePoint> out,
               QueryCounters& counters) const;
    SurfacePoint query(const Vec3d& point, double radius = std::numeric_limits<double>::infinity()) const;

    // Compares the sign of every answer of a solid with the winding number and counts where they differ.
    void cross_check(bool on);

    // Generalised winding number of the present surface, double, direct sum: 1 inside a closed outward surface.
    double winding_number(const Vec3d& point) const;
    // winding_number(point) > 0.5. Far triangles are summed in groups where a proven bound says that this cannot differ
    // (winding_tree.hpp) in trees of kWinding meshes and cross-checked ones; those of other solids count crossings of a ray.
    bool winds_around(const Vec3d& point) const;
    // Puts an answer to `point` on the side that the winding number tells: where a deformed surface has folded over itself its
    // pseudonormals do not know. True when it was on the other one.
    bool settle_side(const Vec3d& point, SurfacePoint& answer) const;

    // Position of a vertex as the answers see it.
    Vec3d vertex(uint32_t v) const;

    // Embree's hierarchy over the groups of triangles, for walks of other kinds: how many groups there are, and for every
    // triangle 16 * its group + its number there.
    const BoxTree& hierarchy() const;
    uint32_t groups() const;
    std::span<const uint32_t> lane_of_triangle() const;

 private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

// Version of Embree, which builds the trees: e.g. "3.13.5".
const char* closest_point_library();

}  // namespace trocar
