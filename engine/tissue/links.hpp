#pragma once
#include <memory>
#include <span>
#include <vector>

#include "components/links.hpp"
#include "components/report.hpp"
#include "components/solids.hpp"
#include "engine/distance/closest_point.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {

// Springs between bodies. A link pulls node and point (or node and node) together with stiffness * (distance
// - rest) along the line between them, with equal and opposite forces: linear and angular momentum are
// conserved. It is stepped explicitly with the bodies.

// What links are made from.
struct LinkWorld {
    Surfaces surfaces;
    const Solids& solids;
    std::span<const std::unique_ptr<ClosestPointTree>> trees;  // indexed by Bodies::tree; only rigid holders' are queried
};

// Number of nodes of a deformable body that can be held: vertices, then inner nodes of a solid.
uint32_t count_nodes(const Meshes& meshes, const Solids& solids, uint32_t prototype);
// Whether a vertex is a corner of a triangle of that material of its mesh.
bool is_of_material(const Meshes& meshes, uint32_t prototype, uint32_t node, uint32_t material);
// Rest position of a node, m, body frame.
Vec3d rest_of_node(const Meshes& meshes, const Solids& solids, uint32_t prototype, uint32_t node);

// One chosen node, and the point that it is attached to.
struct LinkHold {
    uint32_t node = kNone, far_node = kNone;
    Vec3d point = Vec3d::Zero();   // m, frame of a rigid holder
    double rest = 0, stretch = 0;  // m
    double order = 0;              // m^2, squared distance from the centre of the region
};
// Reused memory.
struct LinkScratch {
    std::vector<LinkHold> found;
    std::vector<double> sums;
};

// Adds a waiting group, in a free slot or at the end. Its name is valid until free_link_group.
Entity add_link_group(Links& links, LinkGroup group);
// Index of a group; kNone if the name is stale.
uint32_t find_link_group(const Links& links, Entity name);

// Makes the links of a waiting group at the present positions; fixed nodes are excluded. If the group has its
// own rest length, the initial energy of the links goes to energy.work_links. Returns the number of links;
// with none the group keeps waiting.
uint32_t make_links(const LinkWorld& world, uint32_t group, LinkScratch& scratch, Links& links, Energy& energy);
// Removes a group's links; their energy leaves the accounting. The group waits again, or is finished.
void release_links(uint32_t group, bool again, Links& links, Energy& energy);
// Releases a group and frees its slot: its name is stale from then on. False if it was stale already.
bool free_link_group(Links& links, Entity name, Energy& energy);
// Removes broken links.
void drop_broken_links(Links& links);

// Reserves capacity for `range` links and `groups` more groups, so that making them allocates nothing. A frame
// handles links only if there was a group, or capacity for one, when the frame was made.
void reserve_links(Links& links, size_t range, uint32_t groups = 0);

// A staple: one stiff link between the nodes of two bodies, `a` deformable, that are nearest to `position` (m,
// world); of a rigid `b`, `position` itself. `rest` and `break_strain` as in LinkGroup. The name refers to no
// group if no node of a is within `reach` (m).
struct Staple {
    uint32_t a = kNone, b = kNone;
    Vec3d position = Vec3d::Zero();
    double reach = 0.01;   // m
    double stiffness = 0;  // N/m
    double rest = -1;      // m
    double break_strain = std::numeric_limits<double>::infinity();
};
LinkGroup group_of(const Staple& staple);
Entity add_staple(const LinkWorld& world, const Staple& staple, Links& links, Energy& energy);

// Recomputes links.stable_dt: call it after links were made or removed. A body whose own limit corresponds to
// omega^2 (see its stable_dt) has with links at most omega^2 + max over its nodes of (sum of k (1 + s)) / m.
// s = 0 towards a partner that forces do not move, else it splits the bound between both sides: |x - y|^2 <=
// (1 + s) |x|^2 + (1 + 1/s) |y|^2 for any s > 0. Holders that forces move get their sum of k (1 + 1/s) (1/m +
// r^2 / I). s makes both terms equal for one link between equal masses, and distributes the light nodes of
// many links over a heavy holder.
void update_link_limits(const Bodies& bodies, const Solids& solids, const Particles& particles, LinkScratch& scratch, Links& links);

// Pairs of bodies joined by links, except to static holders: input of islands and sleep.
void joined_by_links(const Bodies& bodies, const Links& links, std::vector<std::array<uint32_t, 2>>& joined);

}  // namespace trocar
