#include "content/build_links.hpp"

#include <algorithm>
#include <cmath>

#include "engine/error.hpp"
#include "engine/links.hpp"
#include "engine/surfaces.hpp"
namespace trocar {
namespace {

[[noreturn]] void refuse(const SceneFile& scene, uint32_t line, const std::string& reason) {
    throw InputError(scene.path.string() + ":" + std::to_string(line) + ":1: " + reason);
}

uint32_t find_body(const SceneFile& scene, const LinkSpec& spec, const World& world, const std::string& name) {
    const auto found = std::find(world.bodies.name.begin(), world.bodies.name.end(), name);
    if (found == world.bodies.name.end()) refuse(scene, spec.line, "link \"" + spec.name + "\": no body is named \"" + name + "\"");
    return static_cast<uint32_t>(found - world.bodies.name.begin());
}

// Row of a material of a prototype by its name.
uint32_t find_material(const World& world, uint32_t prototype, const std::string& name) {
    const Range rows = world.meshes.materials[prototype];
    for (uint32_t m = 0; m < rows.count; ++m) {
        if (world.meshes.material[rows.first + m].name == name) return m;
    }
    return kNone;
}

void take_group(const SceneFile& scene, const LinkSpec& spec, const World& world, LinkGroup& g) {
    const BodySpec& body = scene.bodies[g.body];
    const auto found = std::find_if(body.groups.begin(), body.groups.end(), [&](const GroupSpec& s) { return s.name == spec.group; });
    if (found == body.groups.end()) refuse(scene, spec.line, "link \"" + spec.name + "\": body \"" + spec.body + "\" has no group \"" + spec.group + "\"");
    g.region = found->region;
    g.frame = RegionFrame::kRest;
    if (found->material.empty()) return;
    g.material = find_material(world, world.bodies.mesh[g.body], found->material);
    if (g.material == kNone) refuse(scene, found->line, "group \"" + found->name + "\": the mesh has no material \"" + found->material + "\"");
}

LinkGroup make_group(const SceneFile& scene, const LinkSpec& spec, const World& world) {
    LinkGroup g;
    g.name = spec.name;
    g.body = find_body(scene, spec, world, spec.body);
    g.holder = find_body(scene, spec, world, spec.holder);
    if (!is_deformable(world.bodies, g.body)) refuse(scene, spec.line, "link \"" + spec.name + "\": body \"" + spec.body + "\" must be deformable");
    if (g.body == g.holder) refuse(scene, spec.line, "link \"" + spec.name + "\": a body cannot be linked to itself");
    g.region = spec.region;
    g.frame = spec.frame;
    if (!spec.frame_given && is_deformable(world.bodies, g.holder)) g.frame = RegionFrame::kWorld;
    if (!spec.group.empty()) take_group(scene, spec, world, g);
    if (g.frame == RegionFrame::kHolder && is_deformable(world.bodies, g.holder))
        refuse(scene, spec.line, "link \"" + spec.name + "\": only a rigid body has a frame to lie in; take frame = \"rest\" or \"world\"");
    g.within = spec.within;
    g.most = spec.most;
    g.stiffness = spec.stiffness > 0 ? spec.stiffness : 4 * static_cast<double>(world.bodies.spring_stiffness[g.body]);
    g.rest = spec.rest;
    g.break_strain = spec.break_strain;
    g.gauge = world.meshes.info[world.bodies.mesh[g.body]].mean_edge;
    g.begin = spec.from, g.end = spec.until;
    if (!spec.grip) return g;
    const auto& tools = world.haptics.tool;
    const auto tool = std::find_if(tools.begin(), tools.end(), [&](const HandTool& t) { return t.body == g.holder; });
    if (tool == tools.end()) refuse(scene, spec.line, "link \"" + spec.name + "\": grip = true, but no [[tool]] holds \"" + spec.holder + "\"");
    g.tool = static_cast<uint32_t>(tool - tools.begin());
    return g;
}

}  // namespace

void add_scene_links(const SceneFile& scene, World& world) {
    size_t rows = scene.staples;
    for (const LinkSpec& spec : scene.links) {
        const LinkGroup group = make_group(scene, spec, world);
        rows += std::min(group.most, count_nodes(world.meshes, world.solids, world.bodies.mesh[group.body]));
        add_link_group(world.links, group);
    }
    if (rows > 0) reserve_links(world.links, rows, scene.staples);
}

uint32_t let_tear(World& world, uint32_t body, double break_strain) {
    const uint32_t prototype = world.bodies.mesh[body];
    TearBody tear;
    tear.body = body;
    tear.break_strain = break_strain;
    world.tears.body.push_back(tear);
    const Range slices = world.springs.info[prototype].slices;
    const size_t end = size_t{world.springs.slice_column[slices.end() + prototype]} * kSliceWidth;
    if (world.torn.spring.size() < end) world.torn.spring.resize(end, 0);
    return static_cast<uint32_t>(world.tears.body.size() - 1);
}

}  // namespace trocar
