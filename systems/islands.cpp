#include "systems/islands.hpp"

#include "engine/disjoint_sets.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

void find_islands(const Bodies& bodies, const ContactRows& rows, IslandsScratch& scratch, Islands& islands,
                  std::span<const std::array<uint32_t, 2>> joined) {
    const uint32_t count = uint32_t(bodies.motion.size());
    scratch.parent.resize(count);
    for (uint32_t body = 0; body < count; ++body) scratch.parent[body] = body;
    const auto join = [&](uint32_t body, uint32_t other) {
        if (joins_islands(bodies.motion[body]) && joins_islands(bodies.motion[other])) join_sets(scratch.parent, body, other);
    };
    for (uint32_t row = 0; row < rows.body.size(); ++row) join(rows.body[row], rows.other[row]);
    for (const auto& [body, other] : joined) join(body, other);

    // number the islands by their smallest body, which is the root, and count
    islands.bodies.clear();
    islands.rows.clear();
    scratch.island.assign(count, kNone);
    for (uint32_t body = 0; body < count; ++body) {
        if (!joins_islands(bodies.motion[body])) continue;
        const uint32_t root = find_set(scratch.parent, body);
        if (root == body) {
            scratch.island[body] = uint32_t(islands.bodies.size());
            islands.bodies.push_back({});
            islands.rows.push_back({});
        }
        scratch.island[body] = scratch.island[root];
        ++islands.bodies[scratch.island[body]].count;
    }
    const auto island_of = [&](uint32_t row) {
        const uint32_t own = scratch.island[rows.body[row]];
        return own != kNone ? own : scratch.island[rows.other[row]];
    };
    uint32_t kept = 0;
    for (uint32_t row = 0; row < rows.body.size(); ++row) {
        if (const uint32_t island = island_of(row); island != kNone) {
            ++islands.rows[island].count;
            ++kept;
        }
    }

    // place bodies and rows in ascending order
    const auto place = [&](std::vector<Range>& ranges) {
        uint32_t first = 0;
        scratch.next.clear();
        for (Range& range : ranges) {
            range.first = first;
            scratch.next.push_back(first);
            first += range.count;
        }
        return first;
    };
    islands.body.resize(place(islands.bodies));
    for (uint32_t body = 0; body < count; ++body) {
        if (scratch.island[body] != kNone) islands.body[scratch.next[scratch.island[body]]++] = body;
    }
    islands.row.resize(kept);
    place(islands.rows);
    for (uint32_t row = 0; row < rows.body.size(); ++row) {
        if (const uint32_t island = island_of(row); island != kNone) islands.row[scratch.next[island]++] = row;
    }
}

}  // namespace trocar
