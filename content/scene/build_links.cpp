#include "content/scene/build_links.hpp"

#include <algorithm>

#include "content/scene/find_body.hpp"
#include "content/scene/tissue_regions.hpp"
#include "engine/mesh/region.hpp"
#include "engine/mesh/surfaces.hpp"
#include "engine/tissue/bending_forces.hpp"
#include "engine/tissue/embedded_surface.hpp"
#include "engine/tissue/links.hpp"
#include "engine/tissue/pressure_force.hpp"
#include "engine/tissue/solid_limit.hpp"
#include "engine/tissue/solid_tears.hpp"
#include "engine/tissue/tet_forces.hpp"
namespace trocar {
namespace {

// Index of a prototype's material, by name.
uint32_t find_material(const World& world, uint32_t prototype, const std::string& name) {
    const Range range = world.meshes.materials[prototype];
    for (uint32_t m = 0; m < range.count; ++m) {
        if (world.meshes.material[range.first + m].name == name) return m;
    }
    return kNone;
}

// What a region of a scene file selects: the nodes of a group of the body, or else those in `region`.
void take_group(const SceneFile& scene, uint32_t line, const std::string& group, const World& world, LinkGroup& g) {
    const BodySpec& body = scene.bodies[g.body];
    const auto found = std::find_if(body.groups.begin(), body.groups.end(), [&](const GroupSpec& s) { return s.name == group; });
    if (found == body.groups.end()) refuse(scene, line, "body \"" + body.name + "\" has no group \"" + group + "\"");
    g.region = found->region;
    g.frame = RegionFrame::kRest;
    if (found->material.empty()) return;
    g.material = find_material(world, world.bodies.mesh[g.body], found->material);
    if (g.material == kNone)
        refuse(scene, found->line, "group \"" + found->name + "\": the mesh has no material \"" + found->material + "\"");
}

LinkGroup make_group(const SceneFile& scene, const LinkSpec& spec, const World& world) {
    LinkGroup g = spec.link;
    const std::string name = "link \"" + g.name + "\": ";
    g.body = find_body(scene, spec.line, world, spec.body, name);
    g.holder = find_body(scene, spec.line, world, spec.holder, name);
    if (!is_deformable(world.bodies, g.body)) refuse(scene, spec.line, name + "body \"" + spec.body + "\" must be deformable");
    if (g.body == g.holder) refuse(scene, spec.line, name + "a body cannot be linked to itself");
    if (scene.bodies[g.body].scatter.rate > 0 || scene.bodies[g.holder].scatter.rate > 0)
        refuse(scene, spec.line, name + "bodies that come and go cannot be linked");
    if (!spec.frame_given && is_deformable(world.bodies, g.holder)) g.frame = RegionFrame::kWorld;
    if (!spec.group.empty()) take_group(scene, spec.line, spec.group, world, g);
    if (g.frame == RegionFrame::kHolder && is_deformable(world.bodies, g.holder))
        refuse(scene, spec.line, name + "only a rigid body has a frame to lie in; take frame = \"rest\" or \"world\"");
    if (!(g.stiffness > 0)) g.stiffness = 4 * static_cast<double>(world.bodies.spring_stiffness[g.body]);
    g.gauge = world.meshes.info[world.bodies.mesh[g.body]].mean_edge;
    if (!spec.grip) return g;
    g.tool = find_index(world.haptics.tool, [&](const HandTool& t) {
        const auto jaws = std::span(world.haptics.jaw).subspan(t.jaws.first, t.jaws.count);
        return t.body == g.holder || std::any_of(jaws.begin(), jaws.end(), [&](const ToolJaw& j) { return j.body == g.holder; });
    });
    if (g.tool == kNone) refuse(scene, spec.line, name + "grip = true, but no [[tool]] holds \"" + spec.holder + "\"");
    return g;
}

}  // namespace

void add_scene_links(const SceneFile& scene, World& world) {
    size_t range = scene.staples;
    for (const LinkSpec& spec : scene.links) {
        const LinkGroup group = make_group(scene, spec, world);
        range += std::min(group.most, count_nodes(world.meshes, world.solids, world.bodies.mesh[group.body]));
        add_link_group(world.links, group);
    }
    if (range > 0) reserve_links(world.links, range, scene.staples);
}

void add_tissue_regions(const SceneFile& scene, const BodySpec& spec, World& world, uint32_t body) {
    const uint32_t prototype = world.bodies.mesh[body], count = count_nodes(world.meshes, world.solids, prototype);
    NodeTissue nodes{std::vector<double>(count, 1.0), std::vector<double>(count, 1.0), std::vector<uint8_t>(count, 0)};
    for (const TissueRegionSpec& region : spec.regions) {
        LinkGroup where;  // used only to select particles
        where.body = body;
        where.region = region.region;
        PaintedField field;
        if (!region.group.empty()) take_group(scene, region.line, region.group, world, where);
        if (!region.field.empty()) {
            const std::filesystem::path given(region.field);
            std::error_code error;
            const bool found = given.is_absolute() || std::filesystem::exists(given, error);
            field = read_painted_field(found ? given : scene.path.parent_path() / given, region.property);
            for (const double value : field.value) {
                if (!(value > 0)) refuse(scene, region.line, "region of \"" + spec.name + "\": a painted stiffness must be positive");
            }
        }
        uint32_t held = 0;
        const bool is_vertex = embedded_count(world.solids, prototype) == 0;
        for (uint32_t v = 0; v < count; ++v) {
            const Vec3d rest = rest_of_node(world.meshes, world.solids, prototype, v);
            if (!contains(where.region, rest) ||
                (where.material != kNone && !(is_vertex && is_of_material(world.meshes, prototype, v, where.material))))
                continue;
            nodes.stiffness[v] = field.position.empty() ? region.stiffness : value_at(field, rest);
            nodes.density[v] = region.density;
            nodes.fixed[v] = region.fixed;
            ++held;
        }
        if (held == 0) refuse(scene, region.line, "region of \"" + spec.name + "\": holds no node of the body");
    }
    vary_tissue(nodes, world.meshes, body, world.springs, world.solids, world.bodies, world.particles, world.anchors);
}

void add_scene_cuts(const SceneFile& scene, World& world) {
    for (const CutSpec& spec : scene.cuts) {
        const std::string name = "cut of \"" + spec.body + "\": ";
        LinkGroup group;  // used only to select particles
        group.body = find_body(scene, spec.line, world, spec.body, name);
        group.region = spec.region;
        if (scene.bodies[group.body].scatter.rate > 0) refuse(scene, spec.line, name + "bodies that come and go cannot be cut");
        if (!spec.group.empty()) take_group(scene, spec.line, spec.group, world, group);
        if (!is_deformable(world.bodies, group.body)) refuse(scene, spec.line, name + "only deformable bodies can be cut");
        if (is_solid(world.solids, world.bodies.mesh[group.body]) && group.material != kNone)
            refuse(scene, spec.line, name + "a solid is cut by a region, not by a material");
        if (has_pressure(world.bodies, group.body) || has_bending(world.bodies, group.body))
            refuse(scene, spec.line, name + "a body that is cut cannot keep its volume or bend: set pressure_modulus and bending to 0");
        world.tears.cut.push_back({find_of_body(world.tears.body, group.body), spec.time, group.region, group.material});
    }
    world.torn.cut.assign(world.tears.cut.size(), 0);
}

uint32_t let_tear(World& world, uint32_t body, double break_strain) {
    const uint32_t prototype = world.bodies.mesh[body];
    TearBody tear;
    tear.body = body;
    tear.break_strain = break_strain;
    const MeshInfo& info = world.meshes.info[prototype];
    tear.whole = info.admission;
    if (is_solid(world.solids, prototype)) {
        add_tear_faces(world.meshes, world.solids, prototype, world.tears, tear);
        const uint32_t end = world.solids.info[prototype].tetrahedra.end();
        if (world.torn.tetrahedron.size() < end) world.torn.tetrahedron.resize(end, 0);
        update_tearing_solid_dt(world.meshes, world.springs, world.solids, body, world.particles, world.anchors, world.bodies);
    } else {
        tear.outer = info.triangles.count;
        tear.order = {static_cast<uint32_t>(world.tears.order.size()), info.triangles.count};
        for (uint32_t t = 0; t < info.triangles.count; ++t) world.tears.order.push_back(t);
    }
    world.tears.body.push_back(tear);
    const Range slices = world.springs.info[prototype].slices;
    const size_t end = size_t{world.springs.slice_column[slices.end() + prototype]} * kSliceWidth;
    if (world.torn.spring.size() < end) world.torn.spring.resize(end, 0);
    return static_cast<uint32_t>(world.tears.body.size() - 1);
}

}  // namespace trocar
