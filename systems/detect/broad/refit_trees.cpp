#include "systems/detect/broad/refit_trees.hpp"

#include "engine/jobs/parallel.hpp"
namespace trocar {

void refit_trees(const Bodies& bodies, const Particles& particles, const BroadPhasePairs& pairs, RefitTreesScratch& scratch,
                 std::span<const std::unique_ptr<ClosestPointTree>> trees) {
    scratch.paired.assign(bodies.motion.size(), 0);
    for (const uint32_t body : pairs.a) scratch.paired[body] = 1;
    for (const uint32_t body : pairs.b) scratch.paired[body] = 1;
    scratch.body.clear();
    for (uint32_t body = 0; body < scratch.paired.size(); ++body) {
        if (scratch.paired[body] && bodies.motion[body] == Motion::kDeformable) scratch.body.push_back(body);
    }
    // refitting a small tree takes 2 us, less than handing it to another thread
    const uint32_t count = uint32_t(scratch.body.size()), grain = count < 128 ? 1 : 32;
    parallel_for(count, grain, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) {
            const uint32_t body = scratch.body[i];
            const Range range = bodies.particles[body];
            trees[bodies.tree[body]]->refit(std::span(particles.offset).subspan(range.first, range.count));
        }
    });
}

}  // namespace trocar
