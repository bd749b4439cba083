#include "systems/detect/narrow/penetration.hpp"

#include <algorithm>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "engine/contact/convex_pairs.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/mesh/inverted_contact.hpp"
namespace trocar {
namespace {

void add_overlap(uint32_t pair, uint32_t contact, Penetrations& out) {
    out.pair.push_back(pair);
    out.depth.push_back(-1);
    out.direction.push_back(Vec3d::Zero());
    out.witness.push_back(contact);
    out.vertices_a_in_b.push_back(0);
    out.vertices_b_in_a.push_back(0);
    out.edge_contacts.push_back(0);
    out.face_contacts.push_back(0);
}

// Separation direction of b according to one contact.
Vec3d separation_direction(const BroadPhasePairs& pairs, const Contacts& contacts, uint32_t index) {
    const bool of_a = contacts.body[index] == pairs.a[contacts.pair[index]];
    return of_a ? Vec3d(-contacts.normal[index]) : contacts.normal[index];
}

// Directions more than 120 degrees apart lead to different sides; those of a corner's faces do not.
constexpr double kConflictCosine = -0.5;

// Whether the witness of an overlap is about equally far from an opposite part of the surface it is inside.
bool near_medial_axis(const ContactInputs& in, const Contacts& contacts, uint32_t witness) {
    const Surfaces& s = in.surfaces;
    const uint32_t other = contacts.other[witness];
    const ClosestPointTree* tree = in.trees[s.bodies.tree[other]].get();
    const double depth = -contacts.distance[witness], step = 0.1 * depth;
    if (tree == nullptr || !(depth > 0)) return false;
    const Vec3d deeper = contacts.point[witness] - step * contacts.normal[witness];
    const SurfacePoint there = tree->query(world_to_frame(s, other, deeper));
    return std::abs(there.distance) - depth < 0.85 * step &&
           direction_to_world(s, other, there.normal).dot(contacts.normal[witness]) < kConflictCosine;
}

}  // namespace

Vec3d shortest_separation(const Surfaces& s, uint32_t a, uint32_t b, std::span<const Vec3d> tried, double* travel) {
    std::vector<Vec3d> point[2];
    Vec3d middle[2] = {Vec3d::Zero(), Vec3d::Zero()};
    for (int side = 0; side < 2; ++side) {
        const uint32_t body = side ? b : a, count = s.meshes.info[s.bodies.mesh[body]].vertices.count;
        for (uint32_t v = 0; v < count; ++v) {
            point[side].push_back(vertex_position(s, body, v));
            middle[side] += point[side].back() / double(count);
        }
    }
    Vec3d best = Vec3d::Zero();
    double soonest = std::numeric_limits<double>::infinity();
    const auto try_direction = [&](const Vec3d& direction) {
        double top = -std::numeric_limits<double>::infinity(), bottom = -top;
        for (const Vec3d& p : point[0]) top = std::max(top, direction.dot(p));
        for (const Vec3d& p : point[1]) bottom = std::min(bottom, direction.dot(p));
        if (top - bottom < soonest) soonest = top - bottom, best = direction;
    };
    for (const Vec3d& direction : tried) try_direction(direction);
    const Vec3d apart = middle[1] - middle[0];
    if (apart.norm() > 0) try_direction(apart.normalized());
    for (int i = 0; i < 27; ++i) {
        if (i != 13) try_direction(Vec3d(i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1).normalized());
    }
    if (travel) *travel = soonest;
    return best;
}

void measure_penetrations(const BroadPhasePairs& pairs, const Contacts& contacts, Report& report, Penetrations& out) {
    out.pair.clear();
    out.depth.clear();
    out.direction.clear();
    out.witness.clear();
    out.vertices_a_in_b.clear();
    out.vertices_b_in_a.clear();
    out.edge_contacts.clear();
    out.face_contacts.clear();
    out.saturated.clear();
    out.surface_depth.clear();
    for (uint32_t i = 0; i < contacts.pair.size(); ++i) {
        if (!(contacts.distance[i] <= 0)) continue;
        const uint32_t pair = contacts.pair[i];
        if (out.pair.empty() || out.pair.back() != pair) add_overlap(pair, i, out);
        const bool of_a = contacts.body[i] == pairs.a[pair];
        if (-contacts.distance[i] > out.depth.back()) {
            out.depth.back() = 0.0 - contacts.distance[i];
            out.direction.back() = separation_direction(pairs, contacts, i);
            out.witness.back() = i;
        }
        if (contacts.third[i] != kNone) {
            ++out.face_contacts.back();
        } else if (contacts.vertex[i][0] != contacts.vertex[i][1]) {
            ++out.edge_contacts.back();
        } else if (contacts.distance[i] < 0) {
            ++(of_a ? out.vertices_a_in_b : out.vertices_b_in_a).back();
        }
    }
    out.saturated.assign(out.pair.size(), 0);
    out.separation_direction.assign(out.pair.size(), Vec3d::Zero());
    out.surface_depth = out.depth;
    for (uint32_t i = 0; i < out.pair.size() && !contacts.most.empty(); ++i) {
        out.surface_depth[i] = std::max(out.depth[i], contacts.most[out.pair[i]]);
    }
    ++report.contact_passes;
    report.contact_events += !out.pair.empty();
}

void mark_saturated(const ContactInputs& in, const Contacts& contacts, Penetrations& penetrations) {
    Penetrations& p = penetrations;
    parallel_for(uint32_t(p.pair.size()), 16, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) {
            p.saturated[i] = leaves_inverted(in.surfaces, contacts, p.witness[i]) || near_medial_axis(in, contacts, p.witness[i]);
            auto index = std::lower_bound(contacts.pair.begin(), contacts.pair.end(), p.pair[i]) - contacts.pair.begin();
            for (; size_t(index) < contacts.pair.size() && contacts.pair[index] == p.pair[i] && !p.saturated[i]; ++index) {
                if (contacts.distance[index] > -0.9 * p.depth[i])
                    continue;  // if a contact touches without overlap, all contacts of depth 0 count
                p.saturated[i] = separation_direction(in.pairs, contacts, uint32_t(index)).dot(p.direction[i]) < kConflictCosine;
            }
        }
    });
}

void remember_separation_directions(const ContactInputs& in, const Contacts& contacts, PairMemory& before, PairMemory& memory,
                                    Penetrations& penetrations) {
    const BroadPhasePairs& pairs = in.pairs;
    std::swap(before, memory);
    memory.a.clear();
    memory.b.clear();
    memory.direction.clear();
    uint32_t remembered = 0, overlap = 0, contact = 0;
    for (uint32_t pair = 0; pair < pairs.a.size(); ++pair) {
        uint32_t nearest = kNone;
        for (; contact < contacts.pair.size() && contacts.pair[contact] == pair; ++contact) {
            if (nearest == kNone || contacts.distance[contact] < contacts.distance[nearest]) nearest = contact;
        }
        if (nearest == kNone) continue;
        const uint32_t a = pairs.a[pair], b = pairs.b[pair];
        while (remembered < before.a.size() && (before.a[remembered] < a || (before.a[remembered] == a && before.b[remembered] < b)))
            ++remembered;
        const bool known = remembered < before.a.size() && before.a[remembered] == a && before.b[remembered] == b;
        Vec3d direction = separation_direction(pairs, contacts, nearest);
        if (overlap < penetrations.pair.size() && penetrations.pair[overlap] == pair) {
            const uint32_t i = overlap++;
            direction = penetrations.direction[i];
            // the direction cannot reverse without a separation in between: it now leads out at the far side
            if (known && before.direction[remembered].dot(direction) < 0) penetrations.saturated[i] = 1;
            if (penetrations.saturated[i]) {
                direction = known ? before.direction[remembered] : shortest_separation(in.surfaces, a, b);
                penetrations.separation_direction[i] = direction;
            }
        }
        memory.a.push_back(a);
        memory.b.push_back(b);
        memory.direction.push_back(direction);
    }
}

void part_rigid_pairs(const ContactInputs& in, const Contacts& contacts, Penetrations& penetrations, std::span<uint32_t> still) {
    constexpr double kDeep = 0.01;  // of the smaller body
    constexpr size_t kMostNormals = 16;
    const Surfaces& s = in.surfaces;
    parallel_for(uint32_t(penetrations.pair.size()), 16, [&](uint32_t begin, uint32_t end) {
        std::vector<Vec3d> normals;
        for (uint32_t i = begin; i < end; ++i) {
            const uint32_t pair = penetrations.pair[i], a = in.pairs.a[pair], b = in.pairs.b[pair];
            const auto radius = [&](uint32_t body) { return s.meshes.info[s.bodies.mesh[body]].radius; };
            const auto moves = [&](Motion motion) { return s.bodies.motion[a] == motion || s.bodies.motion[b] == motion; };
            if (!moves(Motion::kFree) || moves(Motion::kDeformable) || moves(Motion::kHand) || penetrations.saturated[i]) continue;
            if (touch_as_hulls(in, pair)) continue;  // their contacts lead out the shortest way
            if (!(penetrations.depth[i] > kDeep * 2 * std::min(radius(a), radius(b)))) continue;
            normals.clear();
            auto index = std::ranges::lower_bound(contacts.pair, pair) - contacts.pair.begin();
            for (; size_t(index) < contacts.pair.size() && contacts.pair[index] == pair && normals.size() < kMostNormals; ++index)
                if (contacts.distance[index] <= 0) normals.push_back(separation_direction(in.pairs, contacts, uint32_t(index)));
            penetrations.saturated[i] = 1;
            penetrations.separation_direction[i] = shortest_separation(s, a, b, normals);
        }
    });
    // position correction moves bodies without a velocity: they are not at rest
    for (uint32_t i = 0; i < penetrations.pair.size() && !still.empty(); ++i) {
        const uint32_t a = in.pairs.a[penetrations.pair[i]], b = in.pairs.b[penetrations.pair[i]];
        if (is_deformable(s.bodies, a) || is_deformable(s.bodies, b) || !(penetrations.depth[i] > in.params.tolerance)) continue;
        for (const uint32_t body : {a, b})
            if (s.bodies.motion[body] == Motion::kFree) still[body] = 0;
    }
}

void find_separation_directions(const ContactInputs& in, const Contacts& contacts, PairMemory& before, PairMemory& memory,
                                Penetrations& penetrations, std::span<uint32_t> still) {
    if (in.params.deep != DeepResponse::kNone) {
        mark_saturated(in, contacts, penetrations);
        remember_separation_directions(in, contacts, before, memory, penetrations);
    }
    part_rigid_pairs(in, contacts, penetrations, still);
}

}  // namespace trocar
