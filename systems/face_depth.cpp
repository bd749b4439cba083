#include "systems/face_depth.hpp"

#include <algorithm>
#include <cmath>

#include "engine/geometry/contact_kernels.hpp"
#include "engine/parallel.hpp"
namespace trocar {
namespace {

constexpr uint32_t kMostChunks = 64;
constexpr uint32_t kMostQueries = 100'000;  // of one pair
using Chunk = FaceDepthScratch::Chunk;

struct Side {
    uint32_t body, other;
    Range screened, near;
    MeshView mesh, other_mesh;
    const ClosestPointTree* tree;
};

struct Best {
    double depth;
    uint32_t queries = 0;
};

// Parts that may hold something deeper than what is known, from the depths of their corners.
void collect_parts(const Surfaces& s, const ScreenedTriangles& screened, const NearVertices& near, const Side& side,
                   double enough, Chunk& c) {
    c.part.clear();
    c.depth.assign(side.mesh.position.size(), std::nan(""));
    for (uint32_t i = side.near.first; i < side.near.end(); ++i) c.depth[near.vertex[i]] = -near.distance[i];
    const BodyPoints points(s, side.body, s.poses.origin[side.other]);
    const bool turned = !is_deformable(s.bodies, side.other);
    for (uint32_t row = side.screened.first; row < side.screened.end(); ++row) {
        const Triangle& t = side.mesh.triangle[screened.triangle[row]];
        FacePart part{{}, std::numeric_limits<double>::infinity()};
        for (int k = 0; k < 3; ++k) {
            part.corner[k] = points.point(t[k]);
            if (turned) part.corner[k] = rotate_back(s.poses.orientation[side.other], part.corner[k]);
        }
        bool known = false;
        for (int k = 0; k < 3; ++k) {
            const double depth = c.depth[t[k]];
            if (std::isnan(depth)) continue;
            known = true;
            const Vec3d &p = part.corner[k], &q = part.corner[(k + 1) % 3], &r = part.corner[(k + 2) % 3];
            part.bound = std::min(part.bound, depth + std::max((q - p).norm(), (r - p).norm()));
        }
        if (known && part.bound > enough) c.part.push_back(part);
    }
}

// Deepest that a part can be, from its middle; the middle may be the new best.
double look(const Side& side, const FacePart& part, Best& best) {
    const Vec3d middle = (part.corner[0] + part.corner[1] + part.corner[2]) / 3;
    const SurfacePoint answer = side.tree->query(middle);
    ++best.queries;
    best.depth = std::max(best.depth, -answer.distance);
    const Triangle& t = side.other_mesh.triangle[answer.triangle];
    const Vec4d a = to_vec4(side.tree->vertex(t[0])), b = to_vec4(side.tree->vertex(t[1])),
                c = to_vec4(side.tree->vertex(t[2]));
    double reach = 0, farthest = 0;
    for (const Vec3d& p : part.corner) {
        reach = std::max(reach, (p - middle).norm());
        farthest = std::max(farthest, distance_to_triangle(to_vec4(p), a, b, c));
    }
    return std::min({part.bound, reach - answer.distance, farthest});
}

// Halves a part across its longest edge.
void split(const FacePart& part, double bound, std::vector<FacePart>& out) {
    int longest = 0;
    const auto length = [&](int k) { return (part.corner[(k + 1) % 3] - part.corner[k]).squaredNorm(); };
    for (int k = 1; k < 3; ++k) longest = length(k) > length(longest) ? k : longest;
    const Vec3d &p = part.corner[longest], &q = part.corner[(longest + 1) % 3], &r = part.corner[(longest + 2) % 3];
    const Vec3d middle = 0.5 * (p + q);
    out.push_back({{p, middle, r}, bound});
    out.push_back({{middle, q, r}, bound});
}

void search_side(double tolerance, const Side& side, Best& best, double& left, Chunk& c) {
    while (!c.part.empty()) {
        const FacePart part = c.part.back();
        c.part.pop_back();
        if (part.bound <= best.depth + tolerance) continue;
        if (best.queries >= kMostQueries) {
            left = std::max(left, part.bound);
            continue;
        }
        const double bound = look(side, part, best);
        if (bound > best.depth + tolerance) split(part, bound, c.part);
    }
}

Side make_side(const Surfaces& s, const CandidatePairs& pairs, const ScreenedTriangles& screened,
               const NearVertices& near, std::span<const std::unique_ptr<ClosestPointTree>> trees, uint32_t row) {
    const uint32_t a = pairs.a[row / 2], b = pairs.b[row / 2];
    const uint32_t body = row % 2 ? b : a, other = row % 2 ? a : b;
    const Admission admission = s.meshes.info[s.bodies.mesh[other]].admission;
    const bool closed = admission == Admission::kSolid || admission == Admission::kWinding;
    return {body,
            other,
            screened.body[body],
            near.side[row],
            mesh_view(s.meshes, s.bodies.mesh[body]),
            mesh_view(s.meshes, s.bodies.mesh[other]),
            closed ? trees[s.bodies.tree[other]].get() : nullptr};
}

}  // namespace

void find_face_depths(const ContactParams& params, const Surfaces& surfaces, const CandidatePairs& pairs,
                      const ScreenedTriangles& screened, const NearVertices& near,
                      std::span<const std::unique_ptr<ClosestPointTree>> trees, FaceDepthScratch& scratch,
                      Penetrations& penetrations) {
    const uint32_t count = uint32_t(penetrations.pair.size()), grain = std::max(1u, chunk_count(count, kMostChunks));
    if (scratch.chunk.size() < chunk_count(count, grain)) scratch.chunk.resize(chunk_count(count, grain));
    scratch.queries.assign(count, 0);
    parallel_for(count, grain, [&](uint32_t begin, uint32_t end) {
        Chunk& chunk = scratch.chunk[begin / grain];
        for (uint32_t i = begin; i < end; ++i) {
            Best best{penetrations.depth[i]};
            double left = 0;
            for (const uint32_t row : {2 * penetrations.pair[i], 2 * penetrations.pair[i] + 1}) {
                const Side side = make_side(surfaces, pairs, screened, near, trees, row);
                if (side.tree == nullptr) continue;
                collect_parts(surfaces, screened, near, side, best.depth + params.tolerance, chunk);
                search_side(params.tolerance, side, best, left, chunk);
            }
            penetrations.surface_depth[i] = std::max(best.depth, left);
            scratch.queries[i] = best.queries;
        }
    });
}

}  // namespace trocar
