#pragma once
#include <span>
#include <vector>

#include "components/links.hpp"
namespace trocar {

// Groups of links that hold something, by the body that is held.
struct HoldingGroups {
    std::vector<uint32_t> first;  // row of group, one per body and one more
    std::vector<uint32_t> group;  // rows of Links::group, those of a body ascending
    std::vector<uint32_t> next;   // while they are sorted
    TROCAR_FIELDS(first, group);
    TROCAR_OTHER_FIELDS(next);
    std::span<const uint32_t> of(uint32_t body) const { return std::span(group).subspan(first[body], first[body + 1] - first[body]); }
};

inline void find_holding_groups(const Links& links, uint32_t bodies, HoldingGroups& out) {
    const auto holds = [](const LinkGroup& g) { return g.body != kNone && g.rows.count > 0; };
    out.first.assign(bodies + 1, 0);
    for (const LinkGroup& g : links.group)
        if (holds(g)) ++out.first[g.body + 1];
    for (uint32_t body = 0; body < bodies; ++body) out.first[body + 1] += out.first[body];
    out.group.resize(out.first[bodies]);
    // from the last: each goes before those that are there already
    std::vector<uint32_t>& next = out.next;
    next.assign(out.first.begin() + 1, out.first.end());
    for (uint32_t g = static_cast<uint32_t>(links.group.size()); g-- > 0;)
        if (holds(links.group[g])) out.group[--next[links.group[g].body]] = g;
}

}  // namespace trocar
