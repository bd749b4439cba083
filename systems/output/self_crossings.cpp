#include "systems/output/self_crossings.hpp"

#include <algorithm>
#include <numeric>
namespace trocar {

uint64_t count_self_crossings(const Surfaces& surfaces, uint32_t body, CrossingFacesScratch& scratch) {
    const Bodies& bodies = surfaces.bodies;
    if (bodies.mesh[body] == kNone || !is_deformable(bodies, body)) return 0;
    return count_crossing_faces(mesh_view(surfaces.meshes, bodies.mesh[body]).triangle,
                                surfaces.particles.offset.data() + bodies.particles[body].first, scratch);
}

void count_self_crossings(uint64_t picture, const Surfaces& surfaces, const Sleep& sleep, CrossingFacesScratch& scratch,
                          SelfCrossingCounts& counts, Report& report) {
    const std::vector<uint32_t>& mesh = surfaces.bodies.mesh;
    counts.pairs.assign(mesh.size(), 0);
    for (uint32_t body = 0; body < mesh.size(); ++body) {
        if (mesh[body] == kNone || is_asleep(sleep, body)) continue;
        const bool sheet = surfaces.meshes.info[mesh[body]].admission == Admission::kSheet;
        if (!sheet && (picture + body) % kFramesBetweenLooks != 0) continue;
        counts.pairs[body] = count_self_crossings(surfaces, body, scratch);
    }
    report.self_crossings = std::max(report.self_crossings, std::accumulate(counts.pairs.begin(), counts.pairs.end(), uint64_t{0}));
}

}  // namespace trocar
