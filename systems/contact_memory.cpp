#include "systems/contact_memory.hpp"

#include <algorithm>
#include <cmath>

#include "engine/check.hpp"
#include "engine/geometry/contact_kernels.hpp"
#include "engine/open_rows.hpp"
#include "engine/parallel.hpp"
#include "engine/write_contact.hpp"
namespace trocar {
namespace {

// Points of an edge nearer to each other than this part of it are the same.
constexpr float kSamePoint = 0.1f;
// What is found deeper than this (m) does not rest: between jaws that do not give way, impulses against each other would
// grow from pass to pass.
constexpr double kRestingDepth = 5e-5;
constexpr uint32_t kRowsPerChunk = 1024, kEdgesPerChunk = 128;

PointKey key_of(uint32_t body, uint32_t other, const std::array<uint32_t, 2>& vertex, uint32_t third) {
    const uint64_t first = std::min(body, other), second = std::max(body, other);
    const uint64_t side = body > other, face = third != kNone, edge = vertex[0] != vertex[1];
    return {first << 32 | second, side << 63 | face << 62 | edge << 61 | uint64_t{vertex[0]} << 30 | vertex[1]};
}
PointKey key_of(const ContactMemory& m, uint32_t row) { return key_of(m.body[row], m.other[row], m.vertex[row], kNone); }
PointKey key_of(const Contacts& c, uint32_t row) { return key_of(c.body[row], c.other[row], c.vertex[row], c.third[row]); }
PointKey key_of(const ContactRows& r, uint32_t row) { return key_of(r.body[row], r.other[row], r.vertex[row], r.third[row]); }

// First of `count` rows, whose keys key(row) ascend, that does not come before `wanted`.
template <typename Key, typename KeyOf>
uint32_t lower_row(uint32_t count, const Key& wanted, const KeyOf& key) {
    uint32_t first = 0;
    while (count > 0) {
        const uint32_t half = count / 2;
        if (key(first + half) < wanted) {
            first += half + 1;
            count -= half + 1;
        } else {
            count = half;
        }
    }
    return first;
}

// Where a remembered edge belongs; pair is kNone if it is none of a candidate pair, or contacts have it.
struct EdgePlace {
    const Surfaces& surfaces;
    const CandidatePairs& pairs;
    const ContactMemory& memory;
    const Contacts& contacts;
    uint32_t contact = 0, pair = 0;  // first that do not come before the edge at hand

    uint32_t contacts_in_all() const { return uint32_t(contacts.body.size()); }
    std::array<uint32_t, 2> pair_at(uint32_t row) const { return {pairs.a[row], pairs.b[row]}; }
    std::array<uint32_t, 2> pair_of(uint32_t m) const {
        return {std::min(memory.body[m], memory.other[m]), std::max(memory.body[m], memory.other[m])};
    }
    // Goes to any remembered row; go_on goes to a later one.
    void go_to(uint32_t m) {
        contact = lower_row(contacts_in_all(), key_of(memory, m), [&](uint32_t row) { return key_of(contacts, row); });
        pair = lower_row(uint32_t(pairs.a.size()), pair_of(m), [&](uint32_t row) { return pair_at(row); });
    }
    LostEdge go_on(uint32_t m) {
        const uint32_t body = memory.body[m], other = memory.other[m];
        if (memory.vertex[m][0] == memory.vertex[m][1] || !has_inside(surfaces, other)) return {};
        if (!is_deformable(surfaces.bodies, body) && !is_deformable(surfaces.bodies, other)) return {};
        const PointKey wanted = key_of(memory, m);
        while (contact < contacts_in_all() && key_of(contacts, contact) < wanted) ++contact;
        uint32_t end = contact;
        while (end < contacts_in_all() && key_of(contacts, end) == wanted) ++end;
        // an edge may lie on two places, of which the edge pass finds the deeper: each would sink in turn
        if (end > contact && std::abs(contacts.along[contact] - memory.along[m]) < kSamePoint) return {};
        const auto both = pair_of(m);
        while (pair < pairs.a.size() && pair_at(pair) < both) ++pair;
        return pair < pairs.a.size() && pair_at(pair) == both ? LostEdge{pair, end} : LostEdge{};
    }
};

// Remembered edges of candidate pairs that contacts do not have.
void find_lost_edges(const Surfaces& s, const CandidatePairs& pairs, const ContactMemory& memory, const ContactMemoryOrder& order,
                     const Contacts& contacts, ContactMemoryScratch& scratch) {
    const uint32_t count = uint32_t(order.order.size());
    scratch.lost.resize(count);
    parallel_for(count, kRowsPerChunk, [&](uint32_t begin, uint32_t end) {
        EdgePlace place{s, pairs, memory, contacts};
        place.go_to(order.order[begin]);
        for (uint32_t i = begin; i < end; ++i) scratch.lost[i] = place.go_on(order.order[i]);
    });
    for (uint32_t i = 0; i < count; ++i)
        if (scratch.lost[i].pair != kNone) scratch.kept.push_back({scratch.lost[i], order.order[i], Vec3d::Zero(), {}});
}

void write_kept(const Surfaces& s, const ContactMemory& memory, const KeptEdge& e, Contacts& to, uint32_t row) {
    const uint32_t m = e.memory;
    write_contact(s, {e.place.pair, memory.body[m], memory.other[m], memory.vertex[m], memory.along[m]}, e.point, e.answer, to, row);
}

// Asks about the edges at the front of a list that lie on the same body, all at once. Returns how many they are.
uint32_t ask_about_edges(const ContactInputs& in, const ContactMemory& memory, std::span<KeptEdge> edges) {
    constexpr uint32_t kMost = 32;
    const Surfaces& s = in.surfaces;
    std::array<Vec3d, kMost> point;
    std::array<double, kMost> radius;
    std::array<SurfacePoint, kMost> answer;
    const uint32_t other = memory.other[edges[0].memory];
    uint32_t count = 0;
    for (; count < std::min<size_t>(edges.size(), kMost) && memory.other[edges[count].memory] == other; ++count) {
        const uint32_t m = edges[count].memory, body = memory.body[m];
        const double along = memory.along[m], reach = reach_of(s.bodies, in.boxes, body) + reach_of(s.bodies, in.boxes, other);
        const Vec3d at =
            (1 - along) * vertex_position(s, body, memory.vertex[m][0]) + along * vertex_position(s, body, memory.vertex[m][1]);
        point[count] = edges[count].point = world_to_frame(s, other, at);
        radius[count] = at.allFinite() ? std::min(reach, in.params.tolerance) : -1;  // no answer
    }
    QueryCounters counters;
    in.trees[s.bodies.tree[other]]->query(std::span(point).first(count), std::span(radius).first(count), {}, std::span(answer).first(count),
                                          counters);
    for (uint32_t i = 0; i < count; ++i) edges[i].answer = answer[i];
    return count;
}

// Calls at(row, row of memory) for every row whose point is remembered.
template <typename At>
void for_each_remembered(const ContactMemory& memory, const ContactMemoryOrder& order, const ContactRows& rows, const At& at) {
    if (memory.body.empty()) return;
    TROCAR_ASSERT(order.order.size() == memory.body.size());
    const uint32_t remembered = uint32_t(order.order.size());
    const auto key_at = [&](uint32_t i) { return order.key[order.order[i]]; };
    parallel_for(uint32_t(rows.body.size()), kRowsPerChunk, [&](uint32_t begin, uint32_t end) {
        uint32_t next = 0;
        PointKey before{};
        for (uint32_t row = begin; row < end; ++row) {
            const PointKey wanted = key_of(rows, row);
            if (row == begin || wanted < before) next = lower_row(remembered, wanted, key_at);
            before = wanted;
            while (next < remembered && key_at(next) < wanted) ++next;
            for (uint32_t i = next; i < remembered && key_at(i) == wanted; ++i) {
                const uint32_t m = order.order[i];
                if (std::abs(memory.along[m] - rows.along[row]) < kSamePoint) at(row, m);
            }
        }
    });
}

}  // namespace

// Rows have this order but for those of rigid bodies' edges, which come last, in an order of their own:
// ascending runs are merged.
void order_memory(const ContactMemory& memory, ContactMemoryScratch& scratch, ContactMemoryOrder& out) {
    const uint32_t count = uint32_t(memory.body.size());
    auto& [order, key] = out;
    order.resize(count);
    key.resize(count);
    parallel_for(count, kRowsPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t row = begin; row < end; ++row) {
            out.order[row] = row;
            out.key[row] = key_of(memory, row);
        }
    });
    scratch.run.assign(1, 0);
    for (uint32_t row = 1; row < count; ++row)
        if (key[row] < key[row - 1]) scratch.run.push_back(row);
    scratch.run.push_back(count);
    const auto comes_before = [&](uint32_t a, uint32_t b) { return out.key[a] < out.key[b]; };
    while (scratch.run.size() > 2) {
        scratch.merged.resize(count);
        uint32_t kept = 0;
        for (size_t r = 0; r + 1 < scratch.run.size(); r += 2) {
            const auto at = [&](size_t run) { return out.order.begin() + scratch.run[std::min(run, scratch.run.size() - 1)]; };
            std::merge(at(r), at(r + 1), at(r + 1), at(r + 2), scratch.merged.begin() + scratch.run[r], comes_before);
            scratch.run[kept++] = scratch.run[r];
        }
        scratch.run.resize(kept);
        scratch.run.push_back(count);
        order.swap(scratch.merged);
    }
}

void keep_edges(const ContactInputs& in, const ContactMemory& memory, const ContactMemoryOrder& order, ContactMemoryScratch& scratch,
                Contacts& contacts) {
    scratch.kept.clear();
    find_lost_edges(in.surfaces, in.pairs, memory, order, contacts, scratch);
    parallel_for(uint32_t(scratch.kept.size()), kEdgesPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end;) i += ask_about_edges(in, memory, std::span(scratch.kept).subspan(i, end - i));
    });
    std::erase_if(scratch.kept, [](const KeptEdge& e) { return e.answer.triangle == kNone; });

    scratch.before.clear();
    for (const KeptEdge& e : scratch.kept) scratch.before.push_back(e.place.before);
    open_rows(scratch.before, contacts);
    parallel_for(uint32_t(scratch.kept.size()), kRowsPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) write_kept(in.surfaces, memory, scratch.kept[i], contacts, scratch.before[i] + i);
    });
}

void mark_loaded(const Surfaces& s, const ContactMemory& memory, const ContactMemoryOrder& order, const ContactRows& rows,
                 std::vector<uint8_t>& loaded) {
    loaded.assign(rows.body.size(), 0);
    for_each_remembered(memory, order, rows, [&](uint32_t row, uint32_t) {
        const uint32_t body = rows.body[row];
        const bool vertex = rows.vertex[row][0] == rows.vertex[row][1] && rows.third[row] == kNone;
        if (!vertex || !is_deformable(s.bodies, body) || s.bodies.motion[rows.other[row]] != Motion::kStatic) return;
        loaded[row] = rows.distance[row] < 0.5 * s.meshes.info[s.bodies.mesh[body]].mean_edge;
    });
}

void recall_contacts(const ContactMemory& memory, const ContactMemoryOrder& order, ContactRows& rows) {
    rows.carried.assign(rows.body.size(), Vec3d::Zero());
    for_each_remembered(memory, order, rows, [&](uint32_t row, uint32_t m) {
        if (!(rows.distance[row] < -kRestingDepth)) rows.carried[row] = memory.force[m];
    });
}

void remember_contacts(const ContactRows& rows, ContactMemory& memory) {
    memory.body.clear();
    memory.other.clear();
    memory.vertex.clear();
    memory.along.clear();
    memory.force.clear();
    for (uint32_t row = 0; row < rows.carried.size(); ++row) {
        const bool edge = rows.vertex[row][0] != rows.vertex[row][1];
        const bool ahead = rows.contact[row] == kNone && rows.distance[row] > 0;  // of edges that have not met
        if ((rows.impulse[row] == Vec3d::Zero() && (!edge || ahead)) || rows.third[row] != kNone) continue;
        memory.body.push_back(rows.body[row]);
        memory.other.push_back(rows.other[row]);
        memory.vertex.push_back(rows.vertex[row]);
        memory.along.push_back(rows.along[row]);
        memory.force.push_back(rows.carried[row]);
    }
}

}  // namespace trocar
