#include "systems/constrain/islands.hpp"

#include "engine/base/disjoint_sets.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {

void find_islands(const Bodies& bodies, const ContactConstraints& constraints, IslandsScratch& scratch, Islands& islands,
                  std::span<const std::array<uint32_t, 2>> joined) {
    const uint32_t count = uint32_t(bodies.motion.size());
    scratch.parent.resize(count);
    for (uint32_t body = 0; body < count; ++body) scratch.parent[body] = body;
    const auto join = [&](uint32_t body, uint32_t other) {
        if (joins_islands(bodies.motion[body]) && joins_islands(bodies.motion[other])) join_sets(scratch.parent, body, other);
    };
    for (uint32_t constraint = 0; constraint < constraints.body.size(); ++constraint)
        join(constraints.body[constraint], constraints.other[constraint]);
    for (const auto& [body, other] : joined) join(body, other);

    // number the islands by their smallest body, which is the root, and count
    islands.bodies.clear();
    islands.constraints.clear();
    scratch.island.assign(count, kNone);
    for (uint32_t body = 0; body < count; ++body) {
        if (!joins_islands(bodies.motion[body])) continue;
        const uint32_t root = find_set(scratch.parent, body);
        if (root == body) {
            scratch.island[body] = uint32_t(islands.bodies.size());
            islands.bodies.push_back({});
            islands.constraints.push_back({});
        }
        scratch.island[body] = scratch.island[root];
        ++islands.bodies[scratch.island[body]].count;
    }
    const auto island_of = [&](uint32_t constraint) {
        const uint32_t own = scratch.island[constraints.body[constraint]];
        return own != kNone ? own : scratch.island[constraints.other[constraint]];
    };
    uint32_t kept = 0;
    for (uint32_t constraint = 0; constraint < constraints.body.size(); ++constraint) {
        if (const uint32_t island = island_of(constraint); island != kNone) {
            ++islands.constraints[island].count;
            ++kept;
        }
    }

    const auto allocate = [&](std::vector<Range>& ranges) {
        uint32_t first = 0;
        scratch.next.clear();
        for (Range& range : ranges) {
            range.first = first;
            scratch.next.push_back(first);
            first += range.count;
        }
        return first;
    };
    islands.body.resize(allocate(islands.bodies));
    for (uint32_t body = 0; body < count; ++body) {
        if (scratch.island[body] != kNone) islands.body[scratch.next[scratch.island[body]]++] = body;
    }
    islands.constraint.resize(kept);
    allocate(islands.constraints);
    for (uint32_t constraint = 0; constraint < constraints.body.size(); ++constraint) {
        if (const uint32_t island = island_of(constraint); island != kNone) islands.constraint[scratch.next[island]++] = constraint;
    }
}

}  // namespace trocar
