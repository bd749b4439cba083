#include "systems/constrain/contact_memory.hpp"

#include <algorithm>
#include <cmath>

#include "engine/base/check.hpp"
#include "engine/contact/insert_contacts.hpp"
#include "engine/contact/write_contact.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/mesh/contact_kernels.hpp"
namespace trocar {
namespace {

// Contacts of one edge closer together than this fraction of it are the same contact.
constexpr float kSamePoint = 0.1f;
// Deeper contacts (m) get no warm start: between rigid jaws, opposing impulses would grow from pass to pass.
constexpr double kRestingDepth = 5e-5;
constexpr uint32_t kConstraintsPerChunk = 1024, kEdgesPerChunk = 128;

// One more plane for a point that has a contact: the point is remembered by that.
bool is_dent_plane(const ContactConstraints& c, uint32_t index) {
    return c.contact[index] == kNone && c.vertex[index][0] == c.vertex[index][1];
}

PointKey key_of(uint32_t body, uint32_t other, const std::array<uint32_t, 2>& vertex, uint32_t third) {
    const uint64_t first = std::min(body, other), second = std::max(body, other);
    const uint64_t side = body > other, face = third != kNone, edge = vertex[0] != vertex[1];
    return {first << 32 | second, side << 63 | face << 62 | edge << 61 | uint64_t{vertex[0]} << 30 | vertex[1]};
}
PointKey key_of(const ContactMemory& m, uint32_t index) { return key_of(m.body[index], m.other[index], m.vertex[index], kNone); }
PointKey key_of(const Contacts& c, uint32_t contact) {
    return key_of(c.body[contact], c.other[contact], c.vertex[contact], c.third[contact]);
}
PointKey key_of(const ContactConstraints& r, uint32_t index) {
    return key_of(r.body[index], r.other[index], r.vertex[index], r.third[index]);
}

// First of `count` indices, whose keys key(i) ascend, with a key not less than `wanted`.
template <typename Key, typename KeyOf>
uint32_t lower_bound_index(uint32_t count, const Key& wanted, const KeyOf& key) {
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

// Finds the insertion point of a remembered edge contact; pair is kNone if there is none or contacts already
// has it.
struct EdgeCursor {
    const Surfaces& surfaces;
    const BroadPhasePairs& pairs;
    const ContactMemory& memory;
    const Contacts& contacts;
    uint32_t contact = 0, pair = 0;  // lower bounds for the current edge

    uint32_t contacts_in_all() const { return uint32_t(contacts.body.size()); }
    std::array<uint32_t, 2> pair_at(uint32_t index) const { return {pairs.a[index], pairs.b[index]}; }
    std::array<uint32_t, 2> pair_of(uint32_t m) const {
        return {std::min(memory.body[m], memory.other[m]), std::max(memory.body[m], memory.other[m])};
    }
    // Positions at any remembered contact; nncg_step advances to a later one.
    void go_to(uint32_t m) {
        contact = lower_bound_index(contacts_in_all(), key_of(memory, m), [&](uint32_t index) { return key_of(contacts, index); });
        pair = lower_bound_index(uint32_t(pairs.a.size()), pair_of(m), [&](uint32_t index) { return pair_at(index); });
    }
    LostEdge nncg_step(uint32_t m) {
        const uint32_t body = memory.body[m], other = memory.other[m];
        if (memory.vertex[m][0] == memory.vertex[m][1] || !has_inside(surfaces, other)) return {};
        if (!is_deformable(surfaces.bodies, body) && !is_deformable(surfaces.bodies, other)) return {};
        const PointKey wanted = key_of(memory, m);
        while (contact < contacts_in_all() && key_of(contacts, contact) < wanted) ++contact;
        uint32_t end = contact;
        while (end < contacts_in_all() && key_of(contacts, end) == wanted) ++end;
        // an edge may rest at two points, of which the edge pass finds the deeper: the points would sink by
        // turns
        if (end > contact && std::abs(contacts.along[contact] - memory.along[m]) < kSamePoint) return {};
        const auto both = pair_of(m);
        while (pair < pairs.a.size() && pair_at(pair) < both) ++pair;
        return pair < pairs.a.size() && pair_at(pair) == both ? LostEdge{pair, end} : LostEdge{};
    }
};

// Remembered edge contacts of broad-phase pairs that contacts lacks.
void find_lost_edges(const Surfaces& s, const BroadPhasePairs& pairs, const ContactMemory& memory, const ContactMemoryOrder& order,
                     const Contacts& contacts, ContactMemoryScratch& scratch) {
    const uint32_t count = uint32_t(order.order.size());
    scratch.lost.resize(count);
    parallel_for(count, kConstraintsPerChunk, [&](uint32_t begin, uint32_t end) {
        EdgeCursor cursor{s, pairs, memory, contacts};
        cursor.go_to(order.order[begin]);
        for (uint32_t i = begin; i < end; ++i) scratch.lost[i] = cursor.nncg_step(order.order[i]);
    });
    for (uint32_t i = 0; i < count; ++i)
        if (scratch.lost[i].pair != kNone) scratch.kept.push_back({scratch.lost[i], order.order[i], Vec3d::Zero(), {}});
}

void write_kept(const Surfaces& s, const ContactMemory& memory, const KeptEdge& e, Contacts& to, uint32_t index) {
    const uint32_t m = e.memory;
    write_contact(s, {e.lost.pair, memory.body[m], memory.other[m], memory.vertex[m], memory.along[m]}, e.point, e.answer, to, index);
}

// Queries the edges at the front of a list that have the same other body in one batch. Returns their number.
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
        const double along = memory.along[m], margin = reach_of(s.bodies, in.boxes, body) + reach_of(s.bodies, in.boxes, other);
        const Vec3d at =
            (1 - along) * vertex_position(s, body, memory.vertex[m][0]) + along * vertex_position(s, body, memory.vertex[m][1]);
        point[count] = edges[count].point = world_to_frame(s, other, at);
        radius[count] = at.allFinite() ? std::min(margin, in.params.tolerance) : -1;  // no answer
    }
    QueryCounters counters;
    in.trees[s.bodies.tree[other]]->query(std::span(point).first(count), std::span(radius).first(count), {}, std::span(answer).first(count),
                                          counters);
    for (uint32_t i = 0; i < count; ++i) edges[i].answer = answer[i];
    return count;
}

// Calls at(constraint, memory index) for every constraint whose point is remembered.
template <typename At>
void for_each_remembered(const ContactMemory& memory, const ContactMemoryOrder& order, const ContactConstraints& constraints,
                         const At& at) {
    if (memory.body.empty()) return;
    TROCAR_ASSERT(order.order.size() == memory.body.size());
    const uint32_t remembered = uint32_t(order.order.size());
    const auto key_at = [&](uint32_t i) { return order.key[order.order[i]]; };
    parallel_for(uint32_t(constraints.body.size()), kConstraintsPerChunk, [&](uint32_t begin, uint32_t end) {
        uint32_t next = 0;
        PointKey before{};
        for (uint32_t constraint = begin; constraint < end; ++constraint) {
            const PointKey wanted = key_of(constraints, constraint);
            if (constraint == begin || wanted < before) next = lower_bound_index(remembered, wanted, key_at);
            before = wanted;
            while (next < remembered && key_at(next) < wanted) ++next;
            for (uint32_t i = next; i < remembered && key_at(i) == wanted; ++i) {
                const uint32_t m = order.order[i];
                if (std::abs(memory.along[m] - constraints.along[constraint]) < kSamePoint) at(constraint, m);
            }
        }
    });
}

}  // namespace

// Contact constraints are already in this order, except edges of rigid bodies, which come last in their own
// order: ascending runs are merged.
void order_memory(const ContactMemory& memory, ContactMemoryScratch& scratch, ContactMemoryOrder& out) {
    const uint32_t count = uint32_t(memory.body.size());
    auto& [order, key] = out;
    order.resize(count);
    key.resize(count);
    parallel_for(count, kConstraintsPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t index = begin; index < end; ++index) {
            out.order[index] = index;
            out.key[index] = key_of(memory, index);
        }
    });
    scratch.run.assign(1, 0);
    for (uint32_t index = 1; index < count; ++index)
        if (key[index] < key[index - 1]) scratch.run.push_back(index);
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
    for (const KeptEdge& e : scratch.kept) scratch.before.push_back(e.lost.before);
    open_rows(scratch.before, contacts);
    parallel_for(uint32_t(scratch.kept.size()), kConstraintsPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) write_kept(in.surfaces, memory, scratch.kept[i], contacts, scratch.before[i] + i);
    });
}

void mark_loaded(const Surfaces& s, const ContactMemory& memory, const ContactMemoryOrder& order, const ContactConstraints& constraints,
                 std::vector<uint8_t>& loaded) {
    loaded.assign(constraints.body.size(), 0);
    for_each_remembered(memory, order, constraints, [&](uint32_t constraint, uint32_t) {
        const uint32_t body = constraints.body[constraint];
        const bool vertex =
            constraints.vertex[constraint][0] == constraints.vertex[constraint][1] && constraints.third[constraint] == kNone;
        if (!vertex || !is_deformable(s.bodies, body) || s.bodies.motion[constraints.other[constraint]] != Motion::kStatic) return;
        loaded[constraint] = constraints.distance[constraint] < 0.5 * s.meshes.info[s.bodies.mesh[body]].mean_edge;
    });
}

void recall_contacts(const ContactMemory& memory, const ContactMemoryOrder& order, ContactConstraints& constraints) {
    constraints.warm_start.assign(constraints.body.size(), Vec3d::Zero());
    for_each_remembered(memory, order, constraints, [&](uint32_t constraint, uint32_t m) {
        if (is_dent_plane(constraints, constraint)) return;
        if (!(constraints.distance[constraint] < -kRestingDepth)) constraints.warm_start[constraint] = memory.force[m];
    });
}

void remember_contacts(const ContactConstraints& constraints, ContactMemory& memory) {
    memory.body.clear();
    memory.other.clear();
    memory.vertex.clear();
    memory.along.clear();
    memory.force.clear();
    for (uint32_t constraint = 0; constraint < constraints.warm_start.size(); ++constraint) {
        const bool edge = constraints.vertex[constraint][0] != constraints.vertex[constraint][1];
        const bool ahead = constraints.contact[constraint] == kNone && constraints.distance[constraint] > 0;  // speculative edge contacts
        if (is_dent_plane(constraints, constraint) || gap_of(constraints, constraint) > 0) continue;
        if ((constraints.impulse[constraint] == Vec3d::Zero() && (!edge || ahead)) || constraints.third[constraint] != kNone) continue;
        memory.body.push_back(constraints.body[constraint]);
        memory.other.push_back(constraints.other[constraint]);
        memory.vertex.push_back(constraints.vertex[constraint]);
        memory.along.push_back(constraints.along[constraint]);
        memory.force.push_back(constraints.warm_start[constraint]);
    }
}

}  // namespace trocar
