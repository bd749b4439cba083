#include "systems/penetration.hpp"

#include <algorithm>
#include <utility>

#include "engine/parallel.hpp"
namespace trocar {
namespace {

void add_row(uint32_t pair, uint32_t contact, Penetrations& out) {
    out.pair.push_back(pair);
    out.depth.push_back(-1);
    out.direction.push_back(Vec3d::Zero());
    out.witness.push_back(contact);
    out.vertices_a_in_b.push_back(0);
    out.vertices_b_in_a.push_back(0);
    out.edge_contacts.push_back(0);
}

// The way b would go by one contact.
Vec3d way_out(const CandidatePairs& pairs, const Contacts& contacts, uint32_t row) {
    const bool of_a = contacts.body[row] == pairs.a[contacts.pair[row]];
    return of_a ? Vec3d(-contacts.normal[row]) : contacts.normal[row];
}

// Whether the witness of an overlap is about as far from another part of the surface that it is inside.
bool near_medial_axis(const Surfaces& s, const Contacts& contacts, uint32_t witness,
                      std::span<const std::unique_ptr<ClosestPointTree>> trees) {
    const uint32_t other = contacts.other[witness];
    const ClosestPointTree* tree = trees[s.bodies.tree[other]].get();
    const double depth = -contacts.distance[witness], step = 0.1 * depth;
    if (tree == nullptr || !(depth > 0)) return false;
    const Vec3d deeper = contacts.point[witness] - step * contacts.normal[witness];
    const double gain = std::abs(tree->query(world_to_frame(s, other, deeper)).distance) - depth;
    return gain < 0.85 * step;
}

}  // namespace

void measure_penetrations(const CandidatePairs& pairs, const Contacts& contacts, Penetrations& out) {
    out.pair.clear();
    out.depth.clear();
    out.direction.clear();
    out.witness.clear();
    out.vertices_a_in_b.clear();
    out.vertices_b_in_a.clear();
    out.edge_contacts.clear();
    out.saturated.clear();
    out.surface_depth.clear();
    for (uint32_t i = 0; i < contacts.pair.size(); ++i) {
        if (!(contacts.distance[i] <= 0)) continue;
        const uint32_t pair = contacts.pair[i];
        if (out.pair.empty() || out.pair.back() != pair) add_row(pair, i, out);
        const bool of_a = contacts.body[i] == pairs.a[pair];
        if (-contacts.distance[i] > out.depth.back()) {
            out.depth.back() = 0.0 - contacts.distance[i];
            out.direction.back() = way_out(pairs, contacts, i);
            out.witness.back() = i;
        }
        if (contacts.vertex[i][0] != contacts.vertex[i][1]) {
            ++out.edge_contacts.back();
        } else if (contacts.distance[i] < 0) {
            ++(of_a ? out.vertices_a_in_b : out.vertices_b_in_a).back();
        }
    }
    out.saturated.assign(out.pair.size(), 0);
    out.way_out.assign(out.pair.size(), Vec3d::Zero());
    out.surface_depth = out.depth;
}

void mark_saturated(const Surfaces& surfaces, const CandidatePairs& pairs, const Contacts& contacts,
                    std::span<const std::unique_ptr<ClosestPointTree>> trees, Penetrations& penetrations) {
    Penetrations& p = penetrations;
    parallel_for(uint32_t(p.pair.size()), 16, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) {
            p.saturated[i] = near_medial_axis(surfaces, contacts, p.witness[i], trees);
            auto row = std::lower_bound(contacts.pair.begin(), contacts.pair.end(), p.pair[i]) - contacts.pair.begin();
            for (; size_t(row) < contacts.pair.size() && contacts.pair[row] == p.pair[i] && !p.saturated[i]; ++row) {
                if (contacts.distance[row] > -0.9 * p.depth[i] || !(p.depth[i] > 0)) continue;
                p.saturated[i] = way_out(pairs, contacts, uint32_t(row)).dot(p.direction[i]) < -0.5;
            }
        }
    });
}

void remember_ways_out(const CandidatePairs& pairs, PairMemory& before, PairMemory& memory,
                       Penetrations& penetrations) {
    std::swap(before, memory);
    memory.a.clear();
    memory.b.clear();
    memory.direction.clear();
    uint32_t row = 0;
    for (uint32_t i = 0; i < penetrations.pair.size(); ++i) {
        const uint32_t a = pairs.a[penetrations.pair[i]], b = pairs.b[penetrations.pair[i]];
        while (row < before.a.size() && (before.a[row] < a || (before.a[row] == a && before.b[row] < b))) ++row;
        const bool known = row < before.a.size() && before.a[row] == a && before.b[row] == b;
        if (penetrations.saturated[i] && !known) continue;
        if (penetrations.saturated[i]) penetrations.way_out[i] = before.direction[row];
        memory.a.push_back(a);
        memory.b.push_back(b);
        memory.direction.push_back(penetrations.saturated[i] ? before.direction[row] : penetrations.direction[i]);
    }
}

}  // namespace trocar
