#include "systems/output/self_crossings.hpp"

#include <algorithm>
#include <numeric>
namespace trocar {
namespace {

// Part of the leaves [first, first + count) of a turn that a body with leaves [at, at + leaves) has, in its own numbers.
Range part_of_body(uint64_t first, uint64_t count, uint64_t at, uint64_t leaves) {
    const uint64_t begin = std::max(first, at), end = std::min(first + count, at + leaves);
    return begin < end ? Range{static_cast<uint32_t>(begin - at), static_cast<uint32_t>(end - begin)} : Range{};
}

}  // namespace

void count_self_crossings(uint64_t picture, const Surfaces& surfaces, const Sleep& sleep, CrossingFacesScratch& scratch,
                          SelfCrossingCounts& counts, Report& report) {
    const Bodies& bodies = surfaces.bodies;
    const auto bodies_count = static_cast<uint32_t>(bodies.mesh.size());
    counts.pairs.assign(bodies_count, 0);
    const auto leaves_of = [&](uint32_t body) -> uint64_t {
        if (bodies.mesh[body] == kNone || !is_deformable(bodies, body) || is_asleep(sleep, body)) return 0;
        return face_leaves(surfaces.meshes.info[bodies.mesh[body]].triangles.count);
    };
    uint64_t all = 0, at = 0;
    for (uint32_t body = 0; body < bodies_count; ++body) all += leaves_of(body);
    if (all == 0) return;
    const uint64_t turn = std::min(all, std::max<uint64_t>(kLeavesOfAFrame, (all + kFramesOfARound - 1) / kFramesOfARound));
    const uint64_t first = picture * turn % all;
    for (uint32_t body = 0; body < bodies_count; ++body) {
        const uint64_t leaves = leaves_of(body);
        for (const uint64_t start : {at, at + all}) {  // a turn may go on from the first body
            const Range part = part_of_body(first, turn, start, leaves);
            if (part.count == 0) continue;
            counts.pairs[body] += count_crossing_faces(mesh_view(surfaces.meshes, bodies.mesh[body]).triangle,
                                                       surfaces.particles.offset.data() + bodies.particles[body].first, part, scratch);
        }
        at += leaves;
    }
    report.self_crossings = std::max(report.self_crossings, std::accumulate(counts.pairs.begin(), counts.pairs.end(), uint64_t{0}));
}

}  // namespace trocar
