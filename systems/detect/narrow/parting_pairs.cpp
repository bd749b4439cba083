#include "systems/detect/narrow/parting_pairs.hpp"

#include <algorithm>
#include <utility>

#include "engine/mesh/surfaces.hpp"
#include "systems/detect/narrow/penetration.hpp"
namespace trocar {
namespace {

constexpr double kStartsInsideDeep = 0.125;  // of the smaller body: what a run warns of as a mistake
constexpr double kStartsInside = 0.001;      // of the smaller body: below this two touch
constexpr double kMostAround = 2;            // times the depth: what parts bodies that do not reach around each other
constexpr double kMostTravel = 4;            // of what parts a pair that starts inside each other: others may be in the way
constexpr size_t kNormalsTried = 16;
constexpr double kUsedUp = 1e-8;  // m, of travel: pairs with less are left as they are, and may fall asleep

bool may_part(const Bodies& bodies, uint32_t a, uint32_t b) {
    return (is_deformable(bodies, a) || is_deformable(bodies, b)) && bodies.motion[a] != Motion::kHand && bodies.motion[b] != Motion::kHand;
}

// Whether a body may be moved as a whole, as far as its surface says that: nothing holds it in the world.
bool may_move(const Surfaces& s, uint32_t body) {
    if (s.bodies.motion[body] == Motion::kFree) return true;
    if (!is_deformable(s.bodies, body) || s.bodies.anchor_frame[body] != AnchorFrame::kShape) return false;
    constexpr uint32_t kLanes = 16;  // particles come in multiples of it; the last ones may be padding, without mass too
    const Range particles = s.bodies.particles[body];
    const uint32_t vertices = s.meshes.info[s.bodies.mesh[body]].vertices.count, skin = (vertices + kLanes - 1) / kLanes * kLanes;
    const auto any_fixed = [&](uint32_t begin, uint32_t end) {
        return std::any_of(s.particles.offset.begin() + begin, s.particles.offset.begin() + end, [](const Float4& p) { return p.w == 0; });
    };
    const uint32_t first = particles.first;
    // the skin of a solid has no mass
    if (particles.count > skin && s.particles.offset[first].w == 0)
        return !any_fixed(first + skin, std::max(particles.end() - kLanes, first + skin));
    return !any_fixed(first, first + vertices);
}

// m, how deep the middle of a body's vertices is inside another; negative if it is not. Where bodies nearly coincide no vertex is deep.
double middle_depth(const ContactInputs& in, uint32_t body, uint32_t other) {
    const Surfaces& s = in.surfaces;
    const uint32_t count = s.meshes.info[s.bodies.mesh[body]].vertices.count;
    if (s.meshes.info[s.bodies.mesh[other]].admission == Admission::kSheet || count == 0) return -1;
    Vec3d middle = Vec3d::Zero();
    for (uint32_t v = 0; v < count; ++v) middle += vertex_position(s, body, v) / count;
    return -in.trees[s.bodies.tree[other]]->query(world_to_frame(s, other, middle)).distance;
}

// Shortest translation of b out of the slab around a, m.
Vec3d separating_translation(const ContactInputs& in, const Contacts& contacts, uint32_t pair, std::vector<Vec3d>& normals) {
    const uint32_t a = in.pairs.a[pair], b = in.pairs.b[pair];
    normals.clear();
    const auto first = std::ranges::lower_bound(contacts.pair, pair) - contacts.pair.begin();
    for (auto i = uint32_t(first); i < contacts.pair.size() && contacts.pair[i] == pair && normals.size() < kNormalsTried; ++i)
        if (contacts.distance[i] < 0) normals.push_back(contacts.body[i] == a ? Vec3d(-contacts.normal[i]) : contacts.normal[i]);
    double travel = 0;
    const Vec3d direction = shortest_separation(in.surfaces, a, b, normals, &travel);
    return std::max(travel, 0.0) * direction;
}

}  // namespace

void find_parting_pairs(const ContactInputs& in, const Contacts& contacts, uint64_t tick, const SpawnState& spawning,
                        PartingPairsScratch& scratch, PairMemory& memory, Penetrations& penetrations, std::span<uint32_t> still) {
    const auto enters = [&](uint32_t body) { return body < spawning.since.size() && !spawning.away[body] && spawning.since[body] == tick; };
    const bool any_enters = tick == 0 || std::ranges::find(spawning.since, tick) != spawning.since.end();
    if (in.params.deep != DeepResponse::kNone || (memory.a.empty() && !any_enters)) return;
    const Surfaces& s = in.surfaces;
    PairMemory& before = scratch.before;
    std::swap(before, memory);
    memory.a.clear(), memory.b.clear(), memory.direction.clear();
    size_t next = 0;  // of before
    for (uint32_t i = 0; i < penetrations.pair.size(); ++i) {
        const uint32_t pair = penetrations.pair[i], a = in.pairs.a[pair], b = in.pairs.b[pair];
        if (!may_part(s.bodies, a, b)) continue;
        while (next < before.a.size() && std::pair(before.a[next], before.b[next]) < std::pair(a, b)) ++next;
        const bool known = next < before.a.size() && before.a[next] == a && before.b[next] == b;
        const auto size = [&](uint32_t body) { return 2 * s.meshes.info[s.bodies.mesh[body]].radius; };
        const double smaller = std::min(size(a), size(b));
        const auto starting_travel = [&]() -> Vec3d {
            if (tick != 0 && !enters(a) && !enters(b)) return Vec3d::Zero();
            const double depth = std::max(penetrations.depth[i], std::min(middle_depth(in, a, b), middle_depth(in, b, a)));
            const bool deep = depth > kStartsInsideDeep * smaller;
            if (!deep && (!(depth > kStartsInside * smaller) || (!may_move(s, a) && !may_move(s, b)))) return Vec3d::Zero();
            const Vec3d travel = separating_translation(in, contacts, pair, scratch.normals);
            return deep || travel.norm() <= kMostAround * depth ? Vec3d(kMostTravel * travel) : Vec3d(Vec3d::Zero());
        };
        if (known && !(penetrations.depth[i] > in.params.tolerance)) continue;
        const Vec3d travel = known ? before.direction[next] : starting_travel();
        if (!(travel.norm() > 0)) continue;
        memory.a.push_back(a), memory.b.push_back(b), memory.direction.push_back(travel);
        penetrations.saturated[i] = 1;
        penetrations.separation_direction[i] = travel.normalized();
        for (const uint32_t body : {a, b})
            if (travel.norm() > kUsedUp && !still.empty() && in.params.push_speed > 0 && joins_islands(s.bodies.motion[body]))
                still[body] = 0;
    }
}

}  // namespace trocar
