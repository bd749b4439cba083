#pragma once
#include <bit>
#include <memory>
#include <span>
#include <vector>

#include "engine/distance/box_tree.hpp"
#include "engine/distance/closest_point.hpp"
#include "engine/distance/closest_point_kernels.hpp"
#include "engine/distance/embree_device.hpp"
#include "engine/distance/winding_tree.hpp"
#include "engine/geometry/point_triangle.hpp"
#include "engine/geometry/winding_number.hpp"
// Private to the closest_point*.cpp files: building and refitting, searching, signs.
namespace trocar {
namespace meshlet_search {

constexpr float kUnit = 0x1p-24f;
constexpr uint32_t kSlots = 64;  // an icosphere's centre ties 80 faces and overflows; a vertex of valence 20 does not
constexpr uint32_t kBatch = 32;

struct alignas(64) CacheLine {
    unsigned char bytes[64];
};
constexpr uint32_t kNarrowLines = 4, kWideLines = sizeof(Meshlet) / sizeof(CacheLine);

// Corners of one lane of a meshlet, for the double evaluation.
struct Lane {
    Triangle vertex;
    uint32_t triangle;
};

// Grouping of the triangles, made from the mesh at rest; the trees of all its copies share it.
struct MeshletCut {
    std::vector<uint32_t> first_line;    // per meshlet, in the pool
    std::vector<uint32_t> vertex;        // of the meshlets, 16 or 32 each
    std::vector<uint32_t> first_vertex;  // per meshlet
    std::vector<Lane> lanes;             // 16 per meshlet
    std::vector<uint32_t> lane_of_triangle;
};

// State of one query during the traversal.
struct Search {
    const MeshletKernels* kernels;
    Vec3d point;             // m
    alignas(16) float q[4];  // local frame; the fourth is 0
    float query_error;       // 2^-24 |q|, rounded up
    float upper;             // local frame; the nearest triangle is no farther
    uint32_t first;          // meshlet visited before the traversal
    uint32_t nearest;        // meshlet that set upper last
    uint32_t count;
    bool overflow;
    uint32_t lane[kSlots];
    float lower[kSlots];
};

// Best answer so far of a search in double.
struct Winner {
    TrianglePoint closest;
    uint32_t lane = kNone;
    uint32_t triangle = kNone;
};

// The preceding query: distance is 1-Lipschitz, so its answer bounds the next one.
struct Previous {
    Vec3d point;
    float upper;  // local frame
    uint32_t meshlet = kNone;
};

struct ExactSearch {
    Search* search;
    Winner winner;
};

// Kernels of the instruction set in use.
const MeshletKernels& chosen_kernels();

}  // namespace meshlet_search

using namespace meshlet_search;

struct ClosestPointTree::Impl {
    MeshView mesh;
    Admission admission = Admission::kRefused;
    bool deformable = false;
    std::vector<Float4> offset;  // present positions of a deformable mesh
    Vec3d centre = Vec3d::Zero();
    double scale = 1;
    std::vector<CacheLine> pool;  // meshlets
    std::shared_ptr<const MeshletCut> cut;
    std::span<const uint32_t> first_line, vertex, first_vertex, lane_of_triangle;  // of the cut
    std::span<const Lane> lanes;
    std::vector<FloatBox> boxes;  // one per meshlet, local frame, rounded outward
    FloatBox box;                 // of all
    BoxTree tree;                 // over boxes
    bool cross_checked = false;
    bool closed = false;   // rays count the winding number
    WindingTree clusters;  // of open surfaces with an inside
    TreeSearch walk = TreeSearch::kOwn;
    RTCScene scene = nullptr;  // only where Embree walks
    RTCGeometry geometry = nullptr;

    // Argument of the traversal's callback.
    struct Traversal {
        const Impl* tree;
        Search* search;
        ExactSearch* exact;
    };

    ~Impl() { release_scene(); }

    void build(const MeshView& view, const Impl* like);
    void choose_frame();
    void make_meshlets();
    void take_cut(std::shared_ptr<const MeshletCut> made);
    void update_meshlets();
    void fill_from_doubles(Meshlet& meshlet, const uint32_t* vertices) const;
    void measure(uint32_t m, const MeshletKernels& kernels);
    void make_scene();
    void release_scene();
    void update_scene(bool rebuild);

    Meshlet& meshlet(uint32_t m) { return *reinterpret_cast<Meshlet*>(&pool[first_line[m]]); }
    uint32_t triangles_of(uint32_t m) const {
        const uint32_t used = meshlet(m).float_lanes | meshlet(m).exact_lanes;
        return static_cast<uint32_t>(std::popcount(used));
    }
    const Meshlet& meshlet(uint32_t m) const { return *reinterpret_cast<const Meshlet*>(&pool[first_line[m]]); }
    Vec3d position(uint32_t v) const {
        if (!deformable) return mesh.position[v];
        return {offset[v].x, offset[v].y, offset[v].z};
    }
    TrianglePoint evaluate(const Vec3d& p, uint32_t lane) const {
        const auto& v = lanes[lane].vertex;
        return closest_point_on_triangle(p, position(v[0]), position(v[1]), position(v[2]));
    }
    Vec3d normal_of(const Triangle& t) const { return triangle_normal(position(t[0]), position(t[1]), position(t[2])); }
    bool is_closed() const;
    void update_clusters();
    bool winds_around(const Vec3d& p) const;
    bool count_windings_ahead(const Vec3d& p, int& windings) const;
    double winding(const Vec3d& p) const {
        return deformable ? trocar::winding_number(std::span<const Float4>(offset), mesh.triangle, p)
                          : trocar::winding_number(mesh.position, mesh.triangle, p);
    }

    void visit(Search& search, uint32_t m) const;
    void visit_exactly(ExactSearch& exact, uint32_t m) const;
    void keep_lane(Search& search, uint32_t lane, float lower) const;
    void start(Search& search, const MeshletKernels& kernels, const Vec3d& p, const Vec3d& q, double radius) const;
    float bound_by_box(const Vec3d& q) const;
    void select(Search& search) const;
    void select_with_embree(Search& search) const;
    Winner search_exactly(Search& search) const;
    void search_exactly_with_embree(ExactSearch& exact) const;
    Winner scan(const Vec3d& p) const;
    void prefetch_lane(uint32_t lane) const;
    void prefetch_meshlet(uint32_t m) const;
    void prefetch_small() const;
    SurfacePoint answer(const Vec3d& p, double radius, const Winner& winner) const;
    template <typename Visit>  // Visit: void(corner a, b, c, normal), a the winning vertex
    void for_each_in_fan(const Winner& winner, const Visit& visit) const {
        const uint32_t v = lanes[winner.lane].vertex[static_cast<int>(winner.closest.feature)];
        for (uint32_t i = mesh.incident_first[v]; i < mesh.incident_first[v + 1]; ++i) {
            const Triangle& t = mesh.triangle[mesh.incident[i]];
            const int k = t[0] == v ? 0 : t[1] == v ? 1 : 2;
            const Vec3d a = position(v), b = position(t[(k + 1) % 3]), c = position(t[(k + 2) % 3]);
            visit(a, b, c, triangle_normal(a, b, c));
        }
    }
    double side_of_fan(const Winner& winner, double rounding) const;
    bool pseudonormal(const Winner& winner, Vec3d& normal, double& weight) const;
    double side_of(const Vec3d& p, const Winner& winner, double d, Vec3d& direction) const;
    bool outside_box(const Vec3d& p) const;
    bool disagrees(const Vec3d& p, const SurfacePoint& found) const;
    void query_batch(std::span<const Vec3d> points, std::span<const double> radius, std::span<const uint32_t> hint,
                     std::span<SurfacePoint> out, Previous& previous, QueryCounters& counters) const;
};

}  // namespace trocar
