#pragma once
#include <memory>
#include <span>
#include <vector>

#include "components/links.hpp"
#include "components/report.hpp"
#include "components/solids.hpp"
#include "engine/closest_point.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

// Springs between bodies. A link pulls node and point (or node and node) together with stiffness * (distance - rest) along
// the line between them, on both alike: linear and angular momentum stay. It is stepped explicitly with the bodies.

// What links are made from.
struct LinkWorld {
    Surfaces surfaces;
    const Solids& solids;
    std::span<const std::unique_ptr<ClosestPointTree>> trees;  // Bodies::tree names the row; only rigid holders' are asked
};

// Nodes of a deformable body that can be held: vertices, then inner nodes of a solid.
uint32_t count_nodes(const Meshes& meshes, const Solids& solids, uint32_t prototype);
// Whether a vertex is a corner of a triangle of that material of its mesh.
bool is_of_material(const Meshes& meshes, uint32_t prototype, uint32_t node, uint32_t material);
// Place of a node at rest, m, body frame.
Vec3d rest_of_node(const Meshes& meshes, const Solids& solids, uint32_t prototype, uint32_t node);

// One chosen node, and where it is to be held.
struct LinkHold {
    uint32_t node = kNone, far_node = kNone;
    Vec3d point = Vec3d::Zero();   // m, frame of a rigid holder
    double rest = 0, stretch = 0;  // m
    double order = 0;              // m^2, squared distance to the middle of the region
};
// Reused memory.
struct LinkScratch {
    std::vector<LinkHold> found;
    std::vector<double> sums;
};

// Adds a group that waits, in a row that is free or behind the last. Its name stays valid until free_link_group.
Entity add_link_group(Links& links, LinkGroup group);
// Row of a group; kNone when the name is stale.
uint32_t find_link_group(const Links& links, Entity name);

// Makes the links of a waiting group between what lies where now; fixed nodes are left out. Where they have a rest length of
// their own, what they hold from the start goes to energy.work_links. Returns how many; with none the group keeps waiting.
uint32_t make_links(const LinkWorld& world, uint32_t group, LinkScratch& scratch, Links& links, Energy& energy);
// Takes a group's links away; what they hold leaves the energy. The group waits again, or is done.
void release_links(uint32_t group, bool again, Links& links, Energy& energy);
// Releases a group and gives its row free: from now on its name is stale. False when it was stale already.
bool free_link_group(Links& links, Entity name, Energy& energy);
// Takes away the links that have broken.
void drop_broken_links(Links& links);

// Gives the arrays room for `rows` links and `groups` more groups, so that making them allocates nothing. A frame looks after
// links only where there was a group, or room for one, when it was made.
void reserve_links(Links& links, size_t rows, uint32_t groups = 0);

// A staple: one stiff link between the nodes of two bodies, `a` deformable, that lie nearest to `place` (m, world); of a
// rigid `b`, the place itself. `rest` and `break_strain` as in LinkGroup. The name is of no group when no node of a lies
// within `reach` (m).
struct Staple {
    uint32_t a = kNone, b = kNone;
    Vec3d place = Vec3d::Zero();
    double reach = 0.01;   // m
    double stiffness = 0;  // N/m
    double rest = -1;      // m
    double break_strain = std::numeric_limits<double>::infinity();
};
LinkGroup group_of(const Staple& staple);
Entity add_staple(const LinkWorld& world, const Staple& staple, Links& links, Energy& energy);

// Works out links.stable_dt again: call it after links were made or went. A body with omega^2 of its own (what its stable_dt
// stands for) has at most omega^2 + max over its nodes of (sum of k (1 + s)) / m with links; s = 0 towards what forces do not
// move, else the share of the far side: |x - y|^2 <= (1 + s) |x|^2 + (1 + 1/s) |y|^2 for any s > 0. Holders that forces
// move get their sum of k (1 + 1/s) (1/m + r^2 / I). s makes both alike for one link between equal masses, and spreads the
// light nodes of many links over a heavy holder.
void update_link_limits(const Bodies& bodies, const Solids& solids, const Particles& particles, LinkScratch& scratch, Links& links);

// Pairs of bodies joined by links, but for static holders: what islands and sleep go by.
void joined_by_links(const Bodies& bodies, const Links& links, std::vector<std::array<uint32_t, 2>>& joined);

}  // namespace trocar
