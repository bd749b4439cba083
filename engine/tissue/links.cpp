#include "engine/tissue/links.hpp"

#include <algorithm>
#include <cmath>

#include "engine/base/check.hpp"
#include "engine/mesh/mass_properties.hpp"
#include "engine/mesh/region.hpp"
#include "engine/tissue/deformable_setup.hpp"
#include "engine/tissue/embedded_surface.hpp"
#include "engine/tissue/tet_forces.hpp"
namespace trocar {
namespace {

void renumber(Links& links) {
    uint32_t first = 0;
    for (LinkGroup& g : links.group) g.links.first = first, first += g.links.count;
}

// Rejects groups that would be read beyond arrays, or hold nothing.
void check_group(const LinkWorld& w, const LinkGroup& g) {
    const Bodies& bodies = w.surfaces.bodies;
    TROCAR_ASSERT(g.body < bodies.mesh.size() && (g.holder < bodies.mesh.size() || g.holder == kNone) && g.body != g.holder);
    TROCAR_ASSERT(is_deformable(bodies, g.body));
    TROCAR_ASSERT(g.stiffness > 0 && std::isfinite(g.stiffness));
    TROCAR_ASSERT(g.holder == kNone || is_deformable(bodies, g.holder) || !std::isfinite(g.within) ||
                  bodies.tree[g.holder] < w.trees.size());
}

// Keeps the links for which keep(group, index) holds, in their order.
template <typename Keep>
void keep_links(Links& links, const Keep& keep) {
    uint32_t to = 0;
    for (uint32_t g = 0; g < links.group.size(); ++g) {
        const Range range = links.group[g].links;
        uint32_t kept = 0;
        for (uint32_t index = range.first; index < range.end(); ++index) {
            if (!keep(g, index)) continue;
            links.node[to] = links.node[index], links.far_node[to] = links.far_node[index], links.point[to] = links.point[index];
            links.rest[to] = links.rest[index], links.stretch[to] = links.stretch[index], links.whole[to] = links.whole[index];
            ++to, ++kept;
        }
        links.group[g].links.count = kept;
    }
    links.node.resize(to), links.far_node.resize(to), links.point.resize(to);
    links.rest.resize(to), links.stretch.resize(to), links.whole.resize(to);
    renumber(links);
}

void insert_link(Links& links, uint32_t at, const LinkHold& held) {
    const auto put = [at](auto& range, auto value) { range.insert(range.begin() + at, value); };
    put(links.node, held.node), put(links.far_node, held.far_node), put(links.point, held.point);
    put(links.rest, static_cast<float>(held.rest)), put(links.stretch, held.stretch), put(links.whole, uint8_t{1});
}

double energy_of(const Links& links, const LinkGroup& g) {
    double sum = 0;
    for (uint32_t index = g.links.first; index < g.links.end(); ++index) {
        if (links.whole[index]) sum += 0.5 * g.stiffness * links.stretch[index] * links.stretch[index];
    }
    return sum;
}

// Index into Particles of a body's first node: after its embedded surface.
uint32_t first_node(const Bodies& bodies, const Solids& solids, uint32_t body) {
    return bodies.particles[body].first + embedded_count(solids, bodies.mesh[body]);
}

// Node of a deformable body nearest to a point, m, world; ties go to the lower index.
uint32_t nearest_node(const LinkWorld& w, uint32_t body, const Vec3d& position, double& squared) {
    const Surfaces& s = w.surfaces;
    const Vec3d local = position - s.poses.origin[body];
    uint32_t best = kNone;
    squared = std::numeric_limits<double>::infinity();
    for (uint32_t v = 0; v < count_nodes(s.meshes, w.solids, s.bodies.mesh[body]); ++v) {
        const Float4& o = s.particles.offset[first_node(s.bodies, w.solids, body) + v];
        const double d = (Vec3d(o.x, o.y, o.z) - local).squaredNorm();
        if (d < squared) squared = d, best = v;
    }
    return best;
}

// Position of a node at `position` (m, world), or at rest, in the frame of the group's region.
Vec3d in_region_frame(const LinkWorld& w, const LinkGroup& g, uint32_t node, const Vec3d& position) {
    const Surfaces& s = w.surfaces;
    if (g.frame == RegionFrame::kRest) return rest_of_node(s.meshes, w.solids, s.bodies.mesh[g.body], node);
    return g.frame == RegionFrame::kHolder && g.holder != kNone ? world_to_frame(s, g.holder, position) : position;
}

// Finds the attachment of a node there; false if nothing is within reach.
bool find_hold(const LinkWorld& w, const LinkGroup& g, const Vec3d& position, LinkHold& held) {
    const Surfaces& s = w.surfaces;
    if (g.holder == kNone) {  // where it is
        held.point = position;
        return true;
    }
    if (!is_deformable(s.bodies, g.holder)) {
        held.point = world_to_frame(s, g.holder, position);
        if (!std::isfinite(g.within)) return true;
        const SurfacePoint hit = w.trees[s.bodies.tree[g.holder]]->query(held.point, g.within + 1e-3);
        return hit.triangle != kNone && hit.distance <= g.within;
    }
    double squared = 0;
    held.far_node = nearest_node(w, g.holder, position, squared);
    if (held.far_node == kNone || squared > g.within * g.within) return false;
    const double distance = std::sqrt(squared);
    held.rest = g.rest >= 0 ? g.rest : distance;
    held.stretch = distance - static_cast<double>(static_cast<float>(held.rest));
    return true;
}

// Upper bound on the inverse effective mass of a rigid holder where a link pulls it, 1/kg. The point may be
// far outside of the holder: links without rest length hold nodes where they were.
double inverse_mass_of_holder(const Bodies& bodies, uint32_t holder, const Vec3d& point) {
    if (bodies.motion[holder] == Motion::kHand) return bodies.inv_mass[holder];
    const RigidMass* free = bodies.motion[holder] == Motion::kFree ? find_rigid_mass(bodies, holder) : nullptr;
    return free ? 1 / free->mass + (point - free->centre).squaredNorm() / free->moments.minCoeff() : 0;
}

// omega^2 (1/s^2) of an explicit limit: the inverse of (sqrt(c^2 + 4 omega^2) - c) / omega^2.
double omega_squared_of(double limit, double damping) {
    return std::isfinite(limit) ? std::max(0.0, (4 / limit - 2 * damping) / limit) : 0.0;
}

}  // namespace

uint32_t count_nodes(const Meshes& meshes, const Solids& solids, uint32_t prototype) {
    return has_own_nodes(solids, prototype) ? solids.info[prototype].nodes.count : meshes.info[prototype].vertices.count;
}

bool is_of_material(const Meshes& meshes, uint32_t prototype, uint32_t node, uint32_t material) {
    const MeshInfo& info = meshes.info[prototype];
    if (node >= info.vertices.count) return false;
    const uint32_t* incident = meshes.incident_first.data() + info.vertices.first + prototype + node;
    for (uint32_t i = incident[0]; i < incident[1]; ++i) {
        if (meshes.triangle_material[info.triangles.first + meshes.incident[info.incident.first + i]] == material) return true;
    }
    return false;
}

Vec3d rest_of_node(const Meshes& meshes, const Solids& solids, uint32_t prototype, uint32_t node) {
    const Range surface{meshes.info[prototype].vertices.first, has_own_nodes(solids, prototype)
                                                                   ? surface_nodes(meshes, solids.info[prototype], prototype)
                                                                   : meshes.info[prototype].vertices.count};
    return node < surface.count ? meshes.position[surface.first + node]
                                : solids.position[solids.info[prototype].inner.first + node - surface.count];
}

Entity add_link_group(Links& links, LinkGroup group) {
    uint32_t index = 0;
    while (index < links.group.size() && links.group[index].body != kNone) ++index;
    if (index == links.group.size()) links.group.emplace_back().entity = {index, 0};
    group.entity = links.group[index].entity;
    group.links = links.group[index].links;
    links.group[index] = std::move(group);
    renumber(links);
    return links.group[index].entity;
}

uint32_t find_link_group(const Links& links, Entity name) {
    const bool known = name.index < links.group.size() && links.group[name.index].body != kNone && links.group[name.index].entity == name;
    return known ? name.index : kNone;
}

uint32_t make_links(const LinkWorld& w, uint32_t group, LinkScratch& scratch, Links& links, Energy& energy) {
    const Surfaces& s = w.surfaces;
    LinkGroup& g = links.group[group];
    check_group(w, g);
    const Vec3d middle = middle_of(g.region);
    std::vector<LinkHold>& found = scratch.found;
    found.clear();
    const uint32_t first = first_node(s.bodies, w.solids, g.body), count = count_nodes(s.meshes, w.solids, s.bodies.mesh[g.body]);
    for (uint32_t v = 0; v < count; ++v) {
        const Float4& o = s.particles.offset[first + v];
        if (!(o.w > 0)) continue;
        const Vec3d position = s.poses.origin[g.body] + Vec3d(o.x, o.y, o.z), local = in_region_frame(w, g, v, position);
        if (!contains(g.region, local)) continue;
        const uint32_t prototype = s.bodies.mesh[g.body];
        const bool is_vertex = embedded_count(w.solids, prototype) == 0;
        if (g.material != kNone && !(is_vertex && is_of_material(s.meshes, prototype, v, g.material))) continue;
        LinkHold held{.node = v, .order = (local - middle).squaredNorm()};
        if (g.most != kNone || find_hold(w, g, position, held)) found.push_back(held);
    }
    if (g.most < found.size()) {
        const auto nearer = [](const LinkHold& a, const LinkHold& b) { return a.order != b.order ? a.order < b.order : a.node < b.node; };
        std::sort(found.begin(), found.end(), nearer);
        found.resize(g.most);
    }
    if (g.most != kNone) {
        std::erase_if(found, [&](LinkHold& held) {
            const Float4& o = s.particles.offset[first + held.node];
            return !find_hold(w, g, s.poses.origin[g.body] + Vec3d(o.x, o.y, o.z), held);
        });
    }
    if (found.empty()) return 0;
    for (size_t i = 0; i < found.size(); ++i) insert_link(links, g.links.end() + static_cast<uint32_t>(i), found[i]);
    g.links.count += static_cast<uint32_t>(found.size());
    g.made += found.size();
    g.phase = LinkPhase::kHolding;
    renumber(links);
    energy.work_links += energy_of(links, g);
    return static_cast<uint32_t>(found.size());
}

void release_links(uint32_t group, bool again, Links& links, Energy& energy) {
    LinkGroup& released = links.group[group];
    energy.work_links -= energy_of(links, released);
    released.phase = again ? LinkPhase::kWaiting : LinkPhase::kDone;
    keep_links(links, [&](uint32_t g, uint32_t) { return g != group; });
}

bool free_link_group(Links& links, Entity name, Energy& energy) {
    const uint32_t index = find_link_group(links, name);
    if (index == kNone) return false;
    release_links(index, false, links, energy);
    LinkGroup empty;
    empty.entity = {index, name.generation + 1};
    links.group[index] = empty;
    renumber(links);
    return true;
}

void drop_broken_links(Links& links) {
    if (std::find(links.whole.begin(), links.whole.end(), 0) == links.whole.end()) return;
    keep_links(links, [&](uint32_t, uint32_t index) { return links.whole[index] != 0; });
}

void reserve_links(Links& links, size_t range, uint32_t groups) {
    for (uint32_t i = 0; i < groups; ++i) {
        const uint32_t index = static_cast<uint32_t>(links.group.size());
        links.group.emplace_back().entity = {index, 0};
    }
    renumber(links);
    links.node.reserve(range), links.far_node.reserve(range), links.point.reserve(range);
    links.rest.reserve(range), links.stretch.reserve(range), links.whole.reserve(range);
}

LinkGroup group_of(const Staple& staple) {
    LinkGroup g;
    g.body = staple.a, g.holder = staple.b;
    g.region = {RegionKind::kSphere, staple.position, staple.position, staple.reach};
    g.frame = RegionFrame::kWorld;
    g.most = 1;
    g.stiffness = staple.stiffness, g.rest = staple.rest, g.break_strain = staple.break_strain;
    return g;
}

Entity add_staple(const LinkWorld& world, const Staple& staple, Links& links, Energy& energy) {
    LinkGroup group = group_of(staple);
    check_group(world, group);
    group.gauge = world.surfaces.meshes.info[world.surfaces.bodies.mesh[staple.a]].mean_edge;
    const Entity name = add_link_group(links, group);
    LinkScratch scratch;
    if (make_links(world, name.index, scratch, links, energy) == 0) {
        free_link_group(links, name, energy);
        return {};
    }
    update_link_limits(world.surfaces.bodies, world.solids, world.surfaces.particles, scratch, links);
    return name;
}

void update_link_limits(const Bodies& bodies, const Solids& solids, const Particles& particles, LinkScratch& link_scratch, Links& links) {
    std::vector<double>& scratch = link_scratch.sums;
    links.stable_dt.assign(bodies.mesh.size(), std::numeric_limits<double>::infinity());
    scratch.assign(particles.offset.size() + bodies.mesh.size(), 0.0);
    double* on_holder = scratch.data() + particles.offset.size();  // 1/s^2
    for (const LinkGroup& g : links.group) {
        if (g.body == kNone || g.links.count == 0) continue;
        const bool nodes = g.holder != kNone && is_deformable(bodies, g.holder);
        const double k = g.stiffness;
        for (uint32_t index = g.links.first; index < g.links.end(); ++index) {
            if (!links.whole[index]) continue;
            const uint32_t near = first_node(bodies, solids, g.body) + links.node[index];
            const double w = particles.offset[near].w;
            if (nodes) {
                const uint32_t far = first_node(bodies, solids, g.holder) + links.far_node[index];
                const double far_w = particles.offset[far].w, share = w > 0 ? far_w / w : 1;
                scratch[near] += k * (1 + share);
                if (far_w > 0) scratch[far] += k * (1 + 1 / share);
            } else {
                const double of_holder = g.holder == kNone ? 0 : inverse_mass_of_holder(bodies, g.holder, links.point[index]);
                const double share = of_holder > 0 ? g.links.count * of_holder / w : 0;
                scratch[near] += k * (1 + share);
                if (share > 0) on_holder[g.holder] += k * (1 + 1 / share) * of_holder;
            }
        }
    }
    for (uint32_t body = 0; body < bodies.mesh.size(); ++body) {
        const Range range = bodies.particles[body];
        double most = on_holder[body];
        for (uint32_t p = range.first; p < range.end(); ++p) most = std::max(most, scratch[p] * static_cast<double>(particles.offset[p].w));
        if (most == 0) continue;
        const double damping = bodies.tissue[body].damping;
        const double omega2 = omega_squared_of(bodies.stable_dt[body] / kStableShare, damping) + most;
        links.stable_dt[body] = kStableShare * (std::sqrt(damping * damping + 4 * omega2) - damping) / omega2;
    }
}

void joined_by_links(const Bodies& bodies, const Links& links, std::vector<std::array<uint32_t, 2>>& joined) {
    joined.clear();
    for (const LinkGroup& g : links.group) {
        if (g.body == kNone || g.holder == kNone || g.links.count == 0) continue;
        if (bodies.motion[g.holder] != Motion::kStatic) joined.push_back({g.body, g.holder});
    }
}

}  // namespace trocar
