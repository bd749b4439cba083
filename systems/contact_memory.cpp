#include "systems/contact_memory.hpp"

#include <algorithm>
#include <cmath>
#include <compare>
#include <numeric>

#include "engine/geometry/contact_kernels.hpp"
#include "engine/parallel.hpp"
namespace trocar {
namespace {

// Points of an edge nearer to each other than this part of it are the same.
constexpr float kSamePoint = 0.1f;
// What is found deeper than this (m) does not rest: between jaws that do not give way, impulses against each other would
// grow from pass to pass.
constexpr double kRestingDepth = 5e-5;

// Whose point it is, in the order of Contacts: pair, side, vertices before edges before faces.
struct PointKey {
    uint64_t pair, point;
    auto operator<=>(const PointKey&) const = default;
};
PointKey key_of(uint32_t body, uint32_t other, const std::array<uint32_t, 2>& vertex, uint32_t third) {
    const uint64_t first = std::min(body, other), second = std::max(body, other);
    const uint64_t side = body > other, face = third != kNone, edge = vertex[0] != vertex[1];
    return {first << 32 | second, side << 63 | face << 62 | edge << 61 | uint64_t{vertex[0]} << 30 | vertex[1]};
}
PointKey key_of(const ContactMemory& m, uint32_t row) { return key_of(m.body[row], m.other[row], m.vertex[row], kNone); }
PointKey key_of(const Contacts& c, uint32_t row) { return key_of(c.body[row], c.other[row], c.vertex[row], c.third[row]); }
PointKey key_of(const ContactRows& r, uint32_t row) { return key_of(r.body[row], r.other[row], r.vertex[row], r.third[row]); }

void order_memory(const ContactMemory& memory, std::vector<uint32_t>& order) {
    order.resize(memory.body.size());
    std::iota(order.begin(), order.end(), 0u);
    const auto earlier = [&](uint32_t a, uint32_t b) {
        const auto less = key_of(memory, a) <=> key_of(memory, b);
        return less == 0 ? a < b : less < 0;
    };
    // rows have this order but for those of crossing edges of rigid bodies, which come last
    if (!std::is_sorted(order.begin(), order.end(), earlier)) std::sort(order.begin(), order.end(), earlier);
}

bool is_closed(const Surfaces& s, uint32_t body) {
    const Admission admission = s.meshes.info[s.bodies.mesh[body]].admission;
    return admission == Admission::kSolid || admission == Admission::kWinding;
}

// Remembered edges of candidate pairs that contacts do not have.
void find_lost_edges(const Surfaces& s, const CandidatePairs& pairs, const ContactMemory& memory,
                     const Contacts& contacts, ContactMemoryScratch& scratch) {
    uint32_t contact = 0, pair = 0;
    for (const uint32_t m : scratch.order) {
        const uint32_t body = memory.body[m], other = memory.other[m];
        if (memory.vertex[m][0] == memory.vertex[m][1] || !is_closed(s, other)) continue;
        if (!is_deformable(s.bodies, body) && !is_deformable(s.bodies, other)) continue;
        const PointKey wanted = key_of(memory, m);
        while (contact < contacts.body.size() && key_of(contacts, contact) < wanted) ++contact;
        // an edge may lie on two places, of which the edge pass finds the deeper: each would sink in turn
        const bool found = contact < contacts.body.size() && key_of(contacts, contact) == wanted &&
                           std::abs(contacts.along[contact] - memory.along[m]) < kSamePoint;
        if (found) continue;
        const std::array<uint32_t, 2> both{std::min(body, other), std::max(body, other)};
        const auto here = [&] { return std::array<uint32_t, 2>{pairs.a[pair], pairs.b[pair]}; };
        while (pair < pairs.a.size() && here() < both) ++pair;
        if (pair == pairs.a.size() || here() != both) continue;
        const auto [v, w] = memory.vertex[m];
        const double along = memory.along[m];
        const Vec3d point = (1 - along) * vertex_position(s, body, v) + along * vertex_position(s, body, w);
        if (point.allFinite()) scratch.kept.push_back({pair, m, world_to_frame(s, other, point), {}});
    }
}

void write_row(const Surfaces& s, const ContactMemory& memory, const KeptEdge& e, Contacts& to, uint32_t row) {
    const uint32_t other = memory.other[e.memory];
    to.pair[row] = e.pair;
    to.body[row] = memory.body[e.memory];
    to.other[row] = other;
    to.vertex[row] = memory.vertex[e.memory];
    to.along[row] = memory.along[e.memory];
    to.third[row] = kNone;
    to.across[row] = 0;
    to.point[row] = frame_to_world(s, other, e.point);
    to.closest[row] = frame_to_world(s, other, e.answer.point);
    to.normal[row] = direction_to_world(s, other, e.answer.normal);
    to.distance[row] = e.answer.distance;
    to.triangle[row] = e.answer.triangle;
}

}  // namespace

void keep_edges(const ContactParams& params, const Surfaces& surfaces, const BodyBoxes& boxes, const CandidatePairs& pairs,
                std::span<const std::unique_ptr<ClosestPointTree>> trees, const ContactMemory& memory,
                ContactMemoryScratch& scratch, Contacts& contacts) {
    scratch.kept.clear();
    order_memory(memory, scratch.order);
    find_lost_edges(surfaces, pairs, memory, contacts, scratch);
    parallel_for(uint32_t(scratch.kept.size()), 32, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) {
            KeptEdge& e = scratch.kept[i];
            const uint32_t body = memory.body[e.memory], other = memory.other[e.memory];
            const double reach = reach_of(surfaces.bodies, boxes, body) + reach_of(surfaces.bodies, boxes, other);
            e.answer = trees[surfaces.bodies.tree[other]]->query(e.point, std::min(reach, params.tolerance));
        }
    });
    std::erase_if(scratch.kept, [](const KeptEdge& e) { return e.answer.triangle == kNone; });

    if (scratch.kept.empty()) return;
    uint32_t from = uint32_t(contacts.pair.size()), to = from + uint32_t(scratch.kept.size());
    resize_contacts(contacts, to);
    for (auto e = scratch.kept.rbegin(); e != scratch.kept.rend(); ++e) {
        const PointKey key = key_of(memory, e->memory);
        while (from > 0 && key < key_of(contacts, from - 1)) copy_contact(contacts, --from, contacts, --to);
        write_row(surfaces, memory, *e, contacts, --to);
    }
}

void recall_contacts(const ContactMemory& memory, ContactMemoryScratch& scratch, ContactRows& rows) {
    rows.carried.assign(rows.body.size(), Vec3d::Zero());
    order_memory(memory, scratch.order);
    auto next = scratch.order.begin();
    PointKey before{};
    for (uint32_t row = 0; row < rows.body.size() && !memory.body.empty(); ++row) {
        const PointKey wanted = key_of(rows, row);
        if (wanted < before) next = scratch.order.begin();
        before = wanted;
        while (next != scratch.order.end() && key_of(memory, *next) < wanted) ++next;
        if (rows.distance[row] < -kRestingDepth) continue;
        for (auto m = next; m != scratch.order.end() && key_of(memory, *m) == wanted; ++m) {
            if (std::abs(memory.along[*m] - rows.along[row]) < kSamePoint) rows.carried[row] = memory.force[*m];
        }
    }
}

void remember_contacts(const ContactRows& rows, ContactMemory& memory) {
    memory.body.clear();
    memory.other.clear();
    memory.vertex.clear();
    memory.along.clear();
    memory.force.clear();
    for (uint32_t row = 0; row < rows.carried.size(); ++row) {
        const bool edge = rows.vertex[row][0] != rows.vertex[row][1];
        if ((rows.impulse[row] == Vec3d::Zero() && !edge) || rows.third[row] != kNone) continue;
        memory.body.push_back(rows.body[row]);
        memory.other.push_back(rows.other[row]);
        memory.vertex.push_back(rows.vertex[row]);
        memory.along.push_back(rows.along[row]);
        memory.force.push_back(rows.carried[row]);
    }
}

}  // namespace trocar
