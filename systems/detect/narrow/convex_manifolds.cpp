#include "systems/detect/narrow/convex_manifolds.hpp"

#include <algorithm>
#include <tuple>

#include "engine/contact/convex_pairs.hpp"
#include "engine/contact/insert_contacts.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/mesh/contact_kernels.hpp"
namespace trocar {
namespace {

constexpr uint32_t kHullPairsPerChunk = 16;
// Of the smaller radius: by how much less than pairs of edges, or the other body's faces, a face may separate to be taken, and no more
// than half of contact.tolerance. A box that rocks by 30 mrad on a face keeps that face.
constexpr double kPreferFaces = 5e-4;

using Found = ConvexManifoldsScratch::Found;

void find_hull_pair(const ContactInputs& in, uint32_t pair, ConvexManifoldsScratch::Chunk& chunk) {
    const Surfaces& s = in.surfaces;
    const uint32_t a = in.pairs.a[pair], b = in.pairs.b[pair];
    const ConvexHull &hull_a = *in.hulls->of(s.bodies, a), &hull_b = *in.hulls->of(s.bodies, b);
    const Quat &turn_a = s.poses.orientation[a], &turn_b = s.poses.orientation[b];
    const Vec3d shift = rotate_back(turn_a, s.poses.origin[b] - s.poses.origin[a]);
    if (!shift.allFinite()) return;
    const double preferred = std::min(kPreferFaces * std::min(hull_a.radius, hull_b.radius), 0.5 * in.params.tolerance);
    HullManifold manifold;
    find_hull_contacts(hull_a, hull_b, multiply(conjugate(turn_a), turn_b), shift, margin_between(in.boxes, a, b), preferred, chunk.hulls,
                       manifold);
    const size_t first = chunk.found.size();
    for (uint32_t i = 0; i < manifold.count; ++i) {
        const HullContact& c = manifold.contact[i];
        const ConvexHull &own = c.of_b ? hull_b : hull_a, &other = c.of_b ? hull_a : hull_b;
        chunk.found.push_back({pair,
                               c.of_b,
                               {own.vertex[c.ends[0]], own.vertex[c.ends[1]]},
                               static_cast<float>(c.along),
                               s.poses.origin[a] + rotate(turn_a, c.point),
                               rotate(turn_a, c.normal),
                               c.distance,
                               other.face[c.face].triangle});
    }
    const auto order = [](const Found& f) { return std::tuple(f.of_b, f.vertex[0] != f.vertex[1], f.vertex, f.along); };
    std::sort(chunk.found.begin() + std::ptrdiff_t(first), chunk.found.end(),
              [&](const Found& x, const Found& y) { return order(x) < order(y); });
}

void write_found(const BroadPhasePairs& pairs, const Found& f, Contacts& to, uint32_t slot) {
    const uint32_t a = pairs.a[f.pair], b = pairs.b[f.pair];
    to.pair[slot] = f.pair;
    to.body[slot] = f.of_b ? b : a;
    to.other[slot] = f.of_b ? a : b;
    to.vertex[slot] = f.vertex;
    to.along[slot] = f.along;
    to.third[slot] = kNone;
    to.across[slot] = 0;
    to.point[slot] = f.point;
    to.closest[slot] = f.point - f.distance * f.normal;
    to.normal[slot] = f.normal;
    to.distance[slot] = f.distance;
    to.triangle[slot] = f.triangle;
}

}  // namespace

void find_convex_manifolds(const ContactInputs& in, ConvexManifoldsScratch& scratch, Contacts& contacts) {
    if (in.hulls == nullptr || in.hulls->hull.empty()) return;
    const uint32_t count = uint32_t(in.pairs.a.size()), chunks = chunk_count(count, kHullPairsPerChunk);
    if (scratch.chunk.size() < chunks) scratch.chunk.resize(chunks);
    parallel_for(count, kHullPairsPerChunk, [&](uint32_t begin, uint32_t end) {
        ConvexManifoldsScratch::Chunk& chunk = scratch.chunk[begin / kHullPairsPerChunk];
        chunk.found.clear();
        chunk.found.reserve(kHullPairsPerChunk * HullManifold{}.contact.size());
        for (uint32_t pair = begin; pair < end; ++pair)
            if (touch_as_hulls(in, pair)) find_hull_pair(in, pair, chunk);
    });
    scratch.before.clear();
    uint32_t before = 0;
    for (uint32_t i = 0; i < chunks; ++i)
        for (const Found& f : scratch.chunk[i].found) {
            while (before < contacts.pair.size() && contacts.pair[before] < f.pair) ++before;
            scratch.before.push_back(before);
        }
    open_rows(scratch.before, contacts);
    uint32_t next = 0;
    for (uint32_t i = 0; i < chunks; ++i)
        for (const Found& f : scratch.chunk[i].found) write_found(in.pairs, f, contacts, scratch.before[next] + next), ++next;
}

}  // namespace trocar
