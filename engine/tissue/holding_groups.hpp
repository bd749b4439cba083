#pragma once
#include <span>
#include <vector>

#include "components/links.hpp"
namespace trocar {

// Groups of links with at least one link, by the held body.
struct HoldingGroups {
    std::vector<uint32_t> first;  // first index into group, one per body and one more
    std::vector<uint32_t> group;  // indices into Links::group, those of a body ascending
    std::vector<uint32_t> next;   // while they are sorted
    TROCAR_FIELDS(first, group);
    TROCAR_OTHER_FIELDS(next);
    std::span<const uint32_t> of(uint32_t body) const { return std::span(group).subspan(first[body], first[body + 1] - first[body]); }
};

inline void find_holding_groups(const Links& links, uint32_t bodies, HoldingGroups& out) {
    const auto holds = [](const LinkGroup& g) { return g.body != kNone && g.links.count > 0; };
    out.first.assign(bodies + 1, 0);
    for (const LinkGroup& g : links.group)
        if (holds(g)) ++out.first[g.body + 1];
    for (uint32_t body = 0; body < bodies; ++body) out.first[body + 1] += out.first[body];
    out.group.resize(out.first[bodies]);
    // from the last group on: each is inserted before those already there
    std::vector<uint32_t>& next = out.next;
    next.assign(out.first.begin() + 1, out.first.end());
    for (uint32_t g = static_cast<uint32_t>(links.group.size()); g-- > 0;)
        if (holds(links.group[g])) out.group[--next[links.group[g].body]] = g;
}

}  // namespace trocar
