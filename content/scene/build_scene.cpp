#include "content/scene/build_scene.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <tuple>

#include "content/mend/admission.hpp"
#include "content/mend/clean_mesh.hpp"
#include "content/mend/unit_guess.hpp"
#include "content/read/load_mesh.hpp"
#include "content/scene/build_actions.hpp"
#include "content/scene/build_fluids.hpp"
#include "content/scene/build_links.hpp"
#include "content/scene/build_nodes.hpp"
#include "content/scene/build_threads.hpp"
#include "content/scene/find_body.hpp"
#include "content/scene/fit_tip.hpp"
#include "content/scene/make_prototype.hpp"
#include "content/scene/make_solid.hpp"
#include "content/scene/plausibility.hpp"
#include "content/shapes/shape_library.hpp"
#include "engine/base/check.hpp"
#include "engine/base/error.hpp"
#include "engine/base/format.hpp"
#include "engine/devices/device.hpp"
#include "engine/geometry/point_triangle.hpp"
#include "engine/haptics/point_shell.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/mesh/mass_properties.hpp"
#include "engine/mesh/mesh_topology.hpp"
#include "engine/tissue/bending_forces.hpp"
#include "engine/tissue/cut_setup.hpp"
#include "engine/tissue/deformable_setup.hpp"
#include "engine/tissue/embedded_surface.hpp"
#include "engine/tissue/links.hpp"
#include "engine/tissue/pressure_force.hpp"
#include "engine/tissue/relaxation.hpp"
#include "engine/tissue/solid_limit.hpp"
#include "engine/tissue/solid_setup.hpp"
#include "engine/tissue/tet_forces.hpp"
namespace trocar {
namespace fs = std::filesystem;
namespace {

[[noreturn]] void refuse_body(const SceneFile& scene, const BodySpec& spec, const std::string& reason) {
    refuse(scene, spec.line, "body \"" + spec.name + "\": " + reason);
}

fs::path find_file(const SceneFile& scene, const std::string& name) {
    const fs::path given(name);
    std::error_code error;
    if (given.is_absolute() || fs::exists(given, error)) return given;
    return scene.path.parent_path() / given;
}

Mesh load_body_mesh(const SceneFile& scene, const BodySpec& body, Looks looks, std::vector<std::string>& warnings) {
    if (!body.file.empty()) {
        LoadedMesh loaded;
        try {
            loaded = load_mesh(find_file(scene, body.file));
        } catch (const InputError& error) {
            refuse(scene, body.line, error.what());
        }
        warnings.insert(warnings.end(), loaded.warnings.begin(), loaded.warnings.end());
        return std::move(loaded.mesh);
    }
    const std::vector<std::string> names = shape_names();
    if (std::find(names.begin(), names.end(), body.shape) == names.end()) {
        std::string list;
        for (const std::string& n : names) list += (list.empty() ? "" : ", ") + n;
        refuse(scene, body.line, "no shape \"" + body.shape + "\"; there are " + list);
    }
    return make_shape(body.shape, body.triangles, body.seed, looks);
}

// Factor from file units to metres.
double mesh_scale(const BodySpec& body, const Mesh& mesh) {
    Box box;
    for (const Vec3d& p : mesh.position) grow(box, p);
    const Vec3d extent = box.max - box.min;
    if (body.size > 0) return body.size / std::max(extent.maxCoeff(), 1e-300);
    if (body.scale > 0) return body.scale;
    return guess_unit(extent.norm()).metres;
}

Box world_box(const World& world, uint32_t body) {
    const MeshInfo& info = world.meshes.info[world.bodies.mesh[body]];
    Box box;
    for (uint32_t v = info.vertices.first; v < info.vertices.end(); ++v)
        grow(box, world.poses.origin[body] + rotate(world.poses.orientation[body], world.meshes.position[v]));
    return box;
}

void place_above(const SceneFile& scene, const BodySpec& spec, World& world, uint32_t body) {
    const uint32_t lower = find_body(world, spec.above);
    if (lower >= body) refuse(scene, spec.line, "above = \"" + spec.above + "\" names no body before \"" + spec.name + "\"");
    const Box below = world_box(world, lower), own = world_box(world, body);
    Vec3d shift = 0.5 * (below.min + below.max - own.min - own.max);
    shift.z() = below.max.z() + spec.gap - own.min.z();
    world.poses.origin[body] += shift + Vec3d(spec.position.x(), spec.position.y(), 0);
}

// Stable step (s) that the surface mesh, embedded in a coarser shell, would have if it were simulated itself.
double step_of_skin(const World& world, uint32_t body) {
    Springs springs;
    Bodies bodies = world.bodies;
    Particles particles;
    Anchors anchors;
    add_springs(springs, world.meshes, bodies.mesh[body]);
    const MeshView skin = mesh_view(world.meshes, bodies.mesh[body]);
    if (has_pressure(bodies, body)) add_fans(springs, skin, bodies.mesh[body]);
    if (has_bending(bodies, body)) add_hinges(springs, skin, bodies.mesh[body]);
    add_deformable(world.meshes, springs, world.poses, body, bodies, particles, anchors);
    return bodies.stable_dt[body];
}

std::string body_note(const World& world, uint32_t body, const Prototype& made) {
    constexpr const char* kMotions[] = {"static", "kinematic", "hand", "deformable", "free"};
    const MeshInfo& info = world.meshes.info[world.bodies.mesh[body]];
    const uint32_t prototype = world.bodies.mesh[body];
    std::string note = format("%s: %u vertices, %u triangles, %s, %.1f ml", world.bodies.name[body].c_str(), info.vertices.count,
                              info.triangles.count, kMotions[static_cast<size_t>(world.bodies.motion[body])], info.volume * 1e6);
    if (is_solid(world.solids, prototype)) {
        const SolidInfo& solid = world.solids.info[prototype];
        note += made.lattice_nodes > 0 ? format(", solid of %u tetrahedra, %u nodes, may be cut", solid.count, made.lattice_nodes)
                                       : format(", solid of %u tetrahedra, %u nodes%s", solid.count, solid.nodes.count,
                                                solid.skin.count > 0 ? " under this skin" : "");
    } else if (has_own_nodes(world.solids, prototype)) {
        note += format(", under this skin a shell of %u nodes, whose step is %.3g times that of the skin itself",
                       world.solids.info[prototype].nodes.count, world.bodies.stable_dt[body] / step_of_skin(world, body));
    }
    if (is_deformable(world.bodies, body)) {
        constexpr const char* kIntegrators[] = {"leapfrog", "backward Euler"};
        if (law_of(world.bodies, body) == TissueLaw::kNeoHookean) note += ", neo-Hookean";
        if (const Prony prony = prony_of(world.bodies, body); prony.branches() > 0)
            note += format(", relaxes from %.3g times its stiffness in %.3g s and more", 1 + prony.sum(),
                           *std::min_element(prony.time.begin(), prony.time.begin() + prony.branches()));
        note += format(", E %.3g Pa, explicit step at most %.3g ms, stepped by %s", world.bodies.tissue[body].youngs_modulus,
                       world.bodies.stable_dt[body] * 1e3, kIntegrators[static_cast<size_t>(stepping_of(world.bodies, body).integrator)]);
    }
    if (const RigidMass* free = find_rigid_mass(world.bodies, body)) note += format(", %.4g kg", free->mass);
    const std::string changes = describe_cleaning(made.cleaning);
    if (!changes.empty()) note += "; " + changes;
    return note;
}

void fix_vertices_below(World& world, uint32_t body, double z) {
    const MeshInfo& info = world.meshes.info[world.bodies.mesh[body]];
    const Range particles = world.bodies.particles[body];
    const bool solid = has_own_nodes(world.solids, world.bodies.mesh[body]);
    const uint32_t skin = embedded_count(world.solids, world.bodies.mesh[body]), surface = skin > 0 ? 0 : info.vertices.count;
    for (uint32_t v = 0; v < surface; ++v)
        if (world.meshes.position[info.vertices.first + v].z() < z) world.particles.offset[particles.first + v].w = 0;
    if (!solid) return;
    const Range inner = world.solids.info[world.bodies.mesh[body]].inner;
    for (uint32_t i = 0; i < inner.count; ++i)
        if (world.solids.position[inner.first + i].z() < z) world.particles.offset[particles.first + skin + surface + i].w = 0;
}

void add_path(Paths& paths, uint32_t body, const std::vector<Keyframe>& keys) {
    paths.body.push_back(body);
    paths.keys.push_back({static_cast<uint32_t>(paths.key.size()), static_cast<uint32_t>(keys.size())});
    paths.key.insert(paths.key.end(), keys.begin(), keys.end());
}

double area_of(const MeshView& mesh) {
    double area = 0;
    for (const Triangle& t : mesh.triangle)
        area += 0.5 * triangle_normal(mesh.position[t[0]], mesh.position[t[1]], mesh.position[t[2]]).norm();
    return area;
}

// Distributes the points of the point shell over the instrument and its jaws, in proportion to their areas.
void spread_points(const ToolSpec& spec, const World& world, HandTool& tool) {
    const auto mesh_of = [&](uint32_t body) { return mesh_view(world.meshes, world.bodies.mesh[body]); };
    const auto jaws = std::span(world.haptics.jaw).subspan(tool.jaws.first, tool.jaws.count);
    double area = area_of(mesh_of(tool.body));
    for (const ToolJaw& jaw : jaws) area += area_of(mesh_of(jaw.body));
    const auto share = [&](uint32_t body) { return std::max(10u, static_cast<uint32_t>(spec.points * area_of(mesh_of(body)) / area)); };
    tool.point_shell = make_point_shell(mesh_of(tool.body), tool.tip, jaws.empty() ? spec.points : share(tool.body));
    tool.shell_radius = shell_radius(tool.point_shell);
    tool.shell_jaw.assign(jaws.begin(), jaws.end());
    for (uint32_t j = 0; j < jaws.size(); ++j) {
        std::vector<ShellPoint> points = make_point_shell(mesh_of(jaws[j].body), Vec3d::Zero(), share(jaws[j].body));
        // bound for every jaw angle
        tool.shell_radius = std::max(tool.shell_radius, (jaws[j].pivot - tool.tip).norm() + shell_radius(points));
        for (ShellPoint& p : points) p.jaw = j;
        tool.point_shell.insert(tool.point_shell.end(), points.begin(), points.end());
    }
}

// Gives a tool 6-DOF haptics with a point shell on the whole body. Rotation follows the hand as quickly as
// translation; both are critically damped.
void give_shell(const SceneFile& scene, const ToolSpec& spec, const World& world, HandTool& tool) {
    const auto fail = [&](const std::string& why) { refuse(scene, spec.line, "tool \"" + spec.body + "\" with dof = 6: " + why); };
    const double mass = world.bodies.inv_mass[tool.body] > 0 ? 1 / world.bodies.inv_mass[tool.body] : 0;
    if (!(mass > 0)) fail("its body needs a mass");
    const double stiffness = tool.coupling_stiffness, damping = spec.tool.coupling_damping;
    if (!(stiffness > 0)) fail("it needs a stiffness");
    spread_points(spec, world, tool);
    if (tool.point_shell.empty()) fail("its body has no surface");
    tool.inertia = mass * tool.turn_stiffness / stiffness;
    tool.coupling_damping = damping >= 0 ? damping : 2 * std::sqrt(stiffness * mass);
    tool.turn_damping = spec.tool.turn_damping >= 0 ? spec.tool.turn_damping : 2 * std::sqrt(tool.turn_stiffness * tool.inertia);
    tool.surface_stiffness = spec.tool.surface_stiffness > 0 ? spec.tool.surface_stiffness : 100 * stiffness;
}

// Stiffest coupling (N/m at the tip) that a device takes without oscillating at 1 kHz, from its damping b and delay:
// b / (T/2 + delay) (Colgate & Schenkel, Proc. American Control Conf. 1994); and, from Coulomb friction f and encoder
// step: 2 f / step (Abbott & Okamura, IEEE Trans. Robotics 21(5), 2005; Diolaiti et al., ibid. 22(2), 2006). An
// encoder without friction costs half of the first: measured, see the test of that name.
double stiffest_coupling(const HandModel& hand, double scale) {
    double limit = std::numeric_limits<double>::infinity();
    if (hand.mass > 0 && hand.damping > 0) limit = hand.damping / (0.5e-3 + 1e-3 * hand.delay);
    if (hand.mass > 0 && hand.encoder > 0) limit = hand.friction > 0 ? std::min(limit, 2 * hand.friction / hand.encoder) : 0.5 * limit;
    return limit / (scale * scale);
}

void limit_stiffness(const ToolSpec& spec, HandTool& tool, std::vector<std::string>& warnings) {
    const double limit = stiffest_coupling(tool.hand, tool.workspace.scale);
    if (!(tool.coupling_stiffness > limit)) return;
    warnings.push_back("tool \"" + spec.body +
                       format("\": stiffness %g N/m is more than its device takes quietly at 1 kHz: %g N/m is used (see tool.hand)",
                              tool.coupling_stiffness, limit));
    tool.coupling_stiffness = limit;
}

// Adds the jaws, which collide neither with their instrument nor with each other.
void add_jaws(const SceneFile& scene, const ToolSpec& spec, World& world, HandTool& tool) {
    tool.jaws = {static_cast<uint32_t>(world.haptics.jaw.size()), static_cast<uint32_t>(spec.jaws.size())};
    for (const JawSpec& s : spec.jaws) {
        const uint32_t body = find_body(scene, s.line, world, s.body);
        if (world.bodies.motion[body] != Motion::kHand || body == tool.body || find_of_body(world.haptics.jaw, body) != kNone)
            refuse(scene, s.line, "body \"" + s.body + "\" of a jaw must have motion = \"hand\" and be nothing else");
        world.haptics.jaw.push_back(s.jaw);
        world.haptics.jaw.back().body = body;
    }
}

// Excludes collisions among the bodies of one instrument: ascending pairs.
void keep_jaws_apart(World& world) {
    auto& apart = world.nodes.apart;
    for (const HandTool& tool : world.haptics.tool) {
        std::vector<uint32_t> parts{tool.body};
        for (uint32_t j = tool.jaws.first; j < tool.jaws.end(); ++j) parts.push_back(world.haptics.jaw[j].body);
        for (size_t a = 0; a < parts.size(); ++a)
            for (size_t b = 0; b < a; ++b) apart.push_back({std::min(parts[a], parts[b]), std::max(parts[a], parts[b])});
    }
    std::sort(apart.begin(), apart.end());
    apart.erase(std::unique(apart.begin(), apart.end()), apart.end());
}

void add_tool(const SceneFile& scene, const ToolSpec& spec, World& world, std::vector<std::string>& warnings) {
    HandTool tool = spec.tool;
    tool.body = find_body(scene, spec.line, world, spec.body);
    if (world.bodies.motion[tool.body] != Motion::kHand)
        refuse(scene, spec.line, "body \"" + spec.body + "\" of a tool must have motion = \"hand\"");
    if (spec.dof == 6 && tool.tip_radius == 0) tool.tip_radius = 0.006;  // of the marker in pictures
    limit_stiffness(spec, tool, warnings);
    add_jaws(scene, spec, world, tool);
    const auto fit = [&](bool tip_given, HandTool& of) {
        if (std::string warning = fit_tip(world, tip_given, of); !warning.empty()) warnings.push_back(std::move(warning));
    };
    if (spec.dof == 6)
        give_shell(scene, spec, world, tool);
    else
        fit(spec.tip_given, tool);
    tool.effects = {static_cast<uint32_t>(world.haptics.effect.size()), static_cast<uint32_t>(spec.effects.size())};
    world.haptics.effect.insert(world.haptics.effect.end(), spec.effects.begin(), spec.effects.end());
    if (world.haptics.tool.size() == kMaxTools) refuse(scene, spec.line, "more than " + std::to_string(kMaxTools) + " tools");
    if (!spec.trace.empty()) {
        tool.trace = static_cast<uint32_t>(world.haptics.trace.size());
        world.haptics.trace.push_back(read_device_trace(find_file(scene, spec.trace)));
    } else {
        tool.path = static_cast<uint32_t>(world.paths.body.size());
        add_path(world.paths, kNone, spec.path);
    }
    world.haptics.tool.push_back(tool);
    world.haptics.state.emplace_back();
    const uint32_t row = static_cast<uint32_t>(world.haptics.tool.size() - 1);
    add_tool_exchanges(scene, spec, world, row);
    for (uint32_t t = row + 1; t < world.haptics.tool.size(); ++t) {
        if (spec.dof != 6) {
            fit(true, world.haptics.tool[t]);
            continue;
        }
        ToolSpec other = spec;  // the point shell covers this instrument's own body
        other.body = world.bodies.name[world.haptics.tool[t].body];
        give_shell(scene, other, world, world.haptics.tool[t]);
    }
}

}  // namespace

void make_deformable(World& world, uint32_t body, double fixed_below) {
    TROCAR_ASSERT(body < world.bodies.mesh.size() && is_deformable(world.bodies, body));
    const uint32_t prototype = world.bodies.mesh[body];
    if (world.springs.info.size() <= prototype || world.springs.info[prototype].slices.count == 0)
        add_springs(world.springs, world.meshes, prototype);
    // the springs of a shell under an embedded surface were created with its particles
    const bool rides = has_own_nodes(world.solids, prototype);
    if (has_pressure(world.bodies, body) && !rides) add_fans(world.springs, mesh_view(world.meshes, prototype), prototype);
    if (has_bending(world.bodies, body) && !rides) add_hinges(world.springs, mesh_view(world.meshes, prototype), prototype);
    if (is_solid(world.solids, prototype))
        add_solid_body(world.meshes, world.springs, world.solids, world.poses, body, world.bodies, world.particles, world.anchors);
    else if (has_own_nodes(world.solids, prototype))
        add_caged_shell_body(world.meshes, world.springs, world.solids, world.poses, body, world.bodies, world.particles, world.anchors);
    else
        add_deformable(world.meshes, world.springs, world.poses, body, world.bodies, world.particles, world.anchors);
    fix_vertices_below(world, body, fixed_below);
    if (is_solid(world.solids, prototype)) give_law(world.meshes, world.springs, world.bodies, body, world.solids, world.relaxation);
    if (is_solid(world.solids, prototype))
        update_solid_dt(world.meshes, world.springs, world.solids, body, world.particles, world.anchors, world.bodies);
    else
        update_stable_dt(world.springs, body, world.particles, world.anchors, world.bodies);
}

namespace {

// One closest-point tree: the body it is made for, and an earlier tree of the same prototype, or kNone.
struct TreePlan {
    uint32_t body, like;
};

// Plans one tree per deformable body and one per prototype for all rigid copies; stores them in bodies.tree.
std::vector<TreePlan> plan_trees(Bodies& bodies) {
    std::vector<TreePlan> plan;
    std::map<uint32_t, uint32_t> rigid, first;  // prototype -> tree
    for (uint32_t body = 0; body < bodies.mesh.size(); ++body) {
        const uint32_t row = static_cast<uint32_t>(plan.size()), prototype = bodies.mesh[body];
        bodies.tree[body] = is_deformable(bodies, body) ? row : rigid.try_emplace(prototype, row).first->second;
        if (bodies.tree[body] != row) continue;
        const auto [like, fresh] = first.try_emplace(prototype, row);
        plan.push_back({body, fresh ? kNone : like->second});
    }
    return plan;
}

std::unique_ptr<ClosestPointTree> make_tree(const World& world, uint32_t body, const ClosestPointTree* like) {
    const MeshView view = mesh_view(world.meshes, world.bodies.mesh[body]);
    const TreeSearch search = world.settings.contact.search;
    if (!is_deformable(world.bodies, body)) return std::make_unique<ClosestPointTree>(view, like, search);
    const Range range = world.bodies.particles[body];
    TROCAR_ASSERT(range.count > 0 && "make_trees comes after make_deformable");
    return std::make_unique<ClosestPointTree>(view, std::span(world.particles.offset).subspan(range.first, range.count), like, search);
}

}  // namespace

void make_trees(World& world) {
    constexpr uint32_t kGrain = 16;  // for ten thousand copies, each takes some microseconds
    const std::vector<TreePlan> plan = plan_trees(world.bodies);
    if (!plan.empty()) start_embree();
    world.trees.clear();
    world.trees.resize(plan.size());
    for (const bool copies : {false, true}) {
        parallel_for(static_cast<uint32_t>(plan.size()), copies ? kGrain : 1, [&](uint32_t begin, uint32_t end) {
            for (uint32_t row = begin; row < end; ++row) {
                const auto [body, like] = plan[row];
                if ((like != kNone) == copies) world.trees[row] = make_tree(world, body, copies ? world.trees[like].get() : nullptr);
            }
        });
    }
    for (const auto& tree : world.trees)
        if (world.settings.contact.cross_check) tree->cross_check(true);
}

namespace {

bool may_tear(const SceneFile& scene, const BodySpec& spec) {
    const bool cut = std::any_of(scene.cuts.begin(), scene.cuts.end(), [&](const CutSpec& c) { return c.body == spec.name; });
    const bool boils_away = spec.heat.parts && is_heated_by_tools(scene, spec.name);
    return spec.motion == Motion::kDeformable && (cut || boils_away || std::isfinite(spec.break_strain));
}

// Elements of a shell or sheet that instruments cut; none for other bodies.
CutRoom cut_room(const SceneFile& scene, const BodySpec& spec, const MeshInfo& info) {
    if (spec.solid || !is_cut_by_tools(scene, spec.name)) return {};
    return room_for_cuts(info, spec.cut_capacity > 0 ? spec.cut_capacity : info.triangles.count);
}

void check_cut_by_tools(const SceneFile& scene, const BodySpec& spec) {
    if (!is_cut_by_tools(scene, spec.name)) return;
    const auto fail = [&](const std::string& why) { refuse_body(scene, spec, "instruments cannot cut it: " + why); };
    if (spec.motion != Motion::kDeformable) fail("it is not deformable");
    if (spec.skin) fail("they cut the lattice of a solid, and shells and sheets, but no skin that rides on them; take skin = false");
    if (may_tear(scene, spec)) fail("it may tear (break_strain, [[cut]])");
    if (spec.tissue.pressure_modulus > 0 || spec.tissue.bending > 0) fail("set pressure_modulus and bending to 0");
    if (!spec.regions.empty()) fail("its tissue is not the same everywhere ([[body.region]])");
    if (spec.integrator == "implicit") fail("it is stepped by backward Euler; take integrator = \"leapfrog\"");
    if (spec.scatter.asked) fail("it is one of many copies");
}

// What bodies of another law than springs, or that relax, cannot do yet.
void check_law(const SceneFile& scene, const BodySpec& spec) {
    if (spec.law == TissueLaw::kSprings && spec.prony.branches() == 0) return;
    const std::string what = spec.law == TissueLaw::kSprings ? "a body with prony" : "a body of law = \"neo_hookean\"";
    if (may_tear(scene, spec)) refuse_body(scene, spec, what + " does not break (break_strain, [[cut]], heat.parts)");
    if (is_cut_by_tools(scene, spec.name))
        refuse_body(scene, spec, what + " cannot be cut by instruments; take law = \"springs\" without prony");
    if (is_heated_by_tools(scene, spec.name))
        refuse_body(scene, spec, what + " cannot be cauterised; take law = \"springs\" without prony");
    if (spec.prony.branches() > 0 && spec.scatter.rate > 0) refuse_body(scene, spec, "what comes and goes (scatter.rate) does not relax");
}

Prototype make_body_prototype(const SceneFile& scene, const BodySpec& spec, World& world, Mesh mesh, const PrototypeOptions& options) {
    check_cut_by_tools(scene, spec);
    check_law(scene, spec);
    if (spec.motion != Motion::kDeformable || (!spec.solid && !spec.skin)) {
        Prototype plain = make_prototype(world.meshes, std::move(mesh), options);
        const CutRoom room = plain.row == kNone ? CutRoom{} : cut_room(scene, spec, world.meshes.info[plain.row]);
        if (room.vertices > 0) keep_cut_room(room, world.meshes);
        return plain;
    }
    if (spec.solid && (spec.tissue.pressure_modulus > 0 || spec.tissue.bending > 0))
        refuse_body(scene, spec, "pressure_modulus and bending are for shells, not for solids");
    if (!spec.solid && may_tear(scene, spec))
        refuse_body(scene, spec,
                    "a shell under a skin is not cut and does not break: its skin would stretch over the gap; take skin = false");
    try {
        if (!spec.solid)
            return make_caged_shell(world.meshes, world.springs, world.solids, std::move(mesh), options,
                                    {.spacing = spec.spacing,
                                     .cells = spec.cells,
                                     .pressure = spec.tissue.pressure_modulus > 0,
                                     .bending = spec.tissue.bending > 0});
        return make_solid(world.meshes, world.springs, world.solids, std::move(mesh), options,
                          {.spacing = spec.spacing,
                           .cells = spec.cells,
                           .skin = spec.skin,
                           .filled = spec.filled,
                           .tears = may_tear(scene, spec),
                           .cuts = is_cut_by_tools(scene, spec.name),
                           .cut_capacity = spec.cut_capacity});
    } catch (const InputError& error) {
        refuse_body(scene, spec, error.what());
    }
}

// Two bodies with equal keys share a prototype.
auto key_of(const SceneFile& scene, const BodySpec& spec) {
    const bool caged = spec.skin && !spec.solid, swells = spec.tissue.pressure_modulus > 0, bends = spec.tissue.bending > 0;
    const std::string own =
        may_tear(scene, spec) || !spec.regions.empty() || is_cut_by_tools(scene, spec.name) || is_heated_by_tools(scene, spec.name)
            ? spec.name
            : "";  // not to be shared
    return std::tuple(own, spec.file, spec.shape, spec.triangles, spec.seed, spec.scale, spec.size, spec.cells, spec.spacing, spec.color,
                      spec.motion == Motion::kDeformable, spec.solid, spec.skin, spec.filled, caged && swells, caged && bends);
}
using PrototypeKey = decltype(key_of(SceneFile{}, BodySpec{}));

// Prototypes of a scene. Bodies with the same source share one, but rigid and deformable bodies do not share:
// springs are created in the order of the prototypes.
struct PrototypeCache {
    Looks looks = Looks::kPainted;
    std::map<PrototypeKey, Prototype> made;
    // The most recent shape: generating dominates the cost, and a scene may use a shape in several colours.
    std::string shape_name;
    uint32_t shape_triangles = 0;
    uint64_t shape_seed = 0;
    Mesh shape;

    Mesh load(const SceneFile& scene, const BodySpec& spec, std::vector<std::string>& warnings) {
        if (!spec.file.empty()) return load_body_mesh(scene, spec, looks, warnings);
        if (shape_name != spec.shape || shape_triangles != spec.triangles || shape_seed != spec.seed) {
            // a body with a colour of its own shows no texture
            const auto shows_texture = [&](const BodySpec& other) {
                return other.color[0] < 0 && other.shape == spec.shape && other.triangles == spec.triangles && other.seed == spec.seed;
            };
            const bool seen = looks == Looks::kPainted && std::any_of(scene.bodies.begin(), scene.bodies.end(), shows_texture);
            shape = load_body_mesh(scene, spec, seen ? Looks::kPainted : Looks::kPlain, warnings);
            shape_name = spec.shape, shape_triangles = spec.triangles, shape_seed = spec.seed;
        }
        return shape;
    }

    const Prototype& get(const SceneFile& scene, const BodySpec& spec, World& world, std::vector<std::string>& warnings) {
        const PrototypeKey key = key_of(scene, spec);
        if (const auto found = made.find(key); found != made.end()) return found->second;
        Mesh mesh = load(scene, spec, warnings);
        if (spec.color[0] >= 0) {
            if (mesh.material.empty()) mesh.material.emplace_back();
            for (Material& m : mesh.material) m.diffuse = spec.color, m.image = {}, m.texture.clear();
        }
        PrototypeOptions options;
        options.scale = mesh_scale(spec, mesh);
        options.recentre = spec.file.empty() ? Recentre::kNone : Recentre::kVolumeCentroid;
        Prototype prototype = make_body_prototype(scene, spec, world, std::move(mesh), options);
        const std::string source = spec.file.empty() ? "shape " + spec.shape : spec.file;
        if (prototype.row == kNone) refuse_body(scene, spec, source + ": " + prototype.judgement.reason);
        if (prototype.judgement.admitted_as != Admission::kSolid)
            warnings.push_back("body \"" + spec.name + "\" is treated as " + admission_name(prototype.judgement.admitted_as) + ": " +
                               prototype.judgement.reason);
        return made.emplace(key, std::move(prototype)).first->second;
    }
};

constexpr double kLeastStep =
    1e-9;  // s, as of the keys step and substep: a million steps a millisecond, whose number is counted in 32 bits

// Chooses the integrator of a deformable body and its parameters; "auto" is leapfrog, the fastest that is right for every load.
void choose_stepping(const SceneFile& scene, const BodySpec& spec, World& world, uint32_t body) {
    constexpr double kUsualStep = 1.0 / 480;  // s
    constexpr uint32_t kUsualIterations = 10;
    const bool implicit = spec.integrator == "implicit";
    const double limit = world.bodies.stable_dt[body];
    if (implicit && is_solid(world.solids, world.bodies.mesh[body]))
        refuse_body(
            scene, spec,
            "integrator = \"implicit\" is for shells and sheets: no constant matrix bounds the volumes of a solid. Take \"leapfrog\"");
    if (!implicit && limit < kLeastStep)
        refuse_body(
            scene, spec,
            format("its explicit step would be %.3g s, and the least is %g s: it is too stiff, light or finely meshed", limit, kLeastStep));
    if (!implicit && spec.step > limit)
        refuse_body(scene, spec,
                    format("step = %g s is above the largest stable step of leapfrog, %.4g s; take a shorter one", spec.step, limit));
    if (!implicit && spec.step == 0) return;  // the default of every body
    world.bodies.stepping.resize(body + 1);
    Stepping& stepping = world.bodies.stepping[body];
    stepping.integrator = implicit ? Integrator::kBackwardEuler : Integrator::kLeapfrog;
    stepping.step = spec.step > 0 ? spec.step : kUsualStep;
    stepping.iterations = spec.iterations > 0 ? spec.iterations : kUsualIterations;
}

// Makes an object pool of the copies up to `last`; they are inactive until they are spawned.
void add_pool(const SceneFile& scene, const BodySpec& spec, uint32_t last, World& world) {
    if (!(world.settings.sleep_speed > 0))
        refuse(scene, spec.line, "body \"" + spec.name + "\" comes and goes: sleep_speed must not be 0, empty slots sleep");
    world.pools.slots.push_back({last + 1 - spec.scatter.count, spec.scatter.count});
    world.pools.rate.push_back(spec.scatter.rate);
    world.pools.life.push_back(spec.scatter.life);
}

// Call once all bodies exist: no body of a pool has been spawned yet.
void open_pools(World& world) {
    if (world.pools.slots.empty()) return;
    const uint32_t count = static_cast<uint32_t>(world.bodies.mesh.size());
    world.pools.orientation = world.poses.orientation;
    world.spawning = {std::vector<uint8_t>(count), std::vector<uint32_t>(count), std::vector<uint64_t>(count),
                      std::vector<uint64_t>(world.pools.slots.size())};
    world.sleep = {std::vector<uint32_t>(count), std::vector<uint32_t>(count, kNone)};
    for (const Range slots : world.pools.slots) {
        for (uint32_t body = slots.first; body < slots.end(); ++body) {
            world.spawning.away[body] = 1;
            world.sleep.still[body] = kAsleepForLong, world.sleep.group[body] = body;
        }
    }
}

// m, distance that the surface of a closed body keeps from itself, in mean edges: as far as a resting body may stray between two
// passes (least_drift_bound).
constexpr double kSelfContactEdges = 0.05;

void choose_self_contact(const BodySpec& spec, World& world, uint32_t body) {
    Bodies& bodies = world.bodies;
    const MeshInfo& info = world.meshes.info[bodies.mesh[body]];
    const bool sheet = info.admission == Admission::kSheet;
    if (!spec.self_contact) return;
    bodies.self_contact.resize(bodies.mesh.size(), 0);
    bodies.self_contact[body] = sheet ? bodies.thickness[body] : kSelfContactEdges * info.mean_edge;
}

void add_scene_body(const SceneFile& scene, const BodySpec& spec, const Prototype& prototype, BuiltScene& built) {
    World& world = built.world;
    Tissue tissue = spec.tissue;
    if (spec.solid && !spec.bed) tissue.depth = kNoFoundation;
    const uint32_t body = add_body(world, spec.name, prototype.row, spec.motion, tissue, spec.anchor_frame);
    if (spec.law != TissueLaw::kSprings) world.bodies.law.resize(body + 1), world.bodies.law[body] = spec.law;
    if (spec.prony.branches() > 0) world.bodies.prony.resize(body + 1), world.bodies.prony[body] = spec.prony;
    world.bodies.thickness[body] = prototype.judgement.admitted_as == Admission::kSheet ? spec.thickness : 0;
    const Vec3d shift = spec.file_origin ? prototype.shift : Vec3d(Vec3d::Zero());  // body frame
    world.poses.origin[body] = spec.position + rotate(spec.orientation, shift);
    world.poses.orientation[body] = spec.orientation;
    if (!spec.above.empty()) place_above(scene, spec, world, body);
    if (spec.haptic.body != kNone) world.haptics.surface.push_back(spec.haptic), world.haptics.surface.back().body = body;
    if (spec.motion == Motion::kHand) world.bodies.inv_mass[body] = 1 / (spec.mass > 0 ? spec.mass : 0.05);
    if (spec.motion == Motion::kFree) {
        if (!set_rigid_mass(world.meshes, body, spec.mass, world.bodies, world.particles))
            refuse(scene, spec.line,
                   "body \"" + spec.name + "\" is free, but its surface encloses no volume: its mass and inertia are those of its inside");
        world.poses.velocity[body] = spec.velocity;
        world.poses.angular_velocity[body] = spec.spin;
    }
    if (spec.motion == Motion::kKinematic) {
        std::vector<Keyframe> path = spec.path;
        for (Keyframe& key : path) key.position += rotate(key.orientation, shift);
        add_path(world.paths, body, path);
    }
    if (spec.motion == Motion::kDeformable) {
        const CutRoom room = cut_room(scene, spec, world.meshes.info[prototype.row]);
        uint32_t columns = 0;
        if (room.vertices > 0) {
            add_springs(world.springs, world.meshes, prototype.row);
            columns = widen_springs(room, prototype.row, world.springs);
        }
        make_deformable(world, body, spec.fixed_below);
        if (room.vertices > 0)
            add_cut_body(room, columns, body, world.meshes, world.springs, world.anchors, world.bodies, world.actions,
                         world.action_state.cut);
        if (prototype.lattice_nodes > 0)
            add_cut_solid(prototype.room, prototype.lattice_nodes, prototype.lattice_tetrahedra, prototype.wall, body,
                          {world.meshes, world.springs, world.solids, world.anchors}, world.particles, world.bodies, world.actions,
                          world.action_state.lattice);
        if (!spec.regions.empty()) add_tissue_regions(scene, spec, world, body);
        if (may_tear(scene, spec)) let_tear(world, body, spec.break_strain);
        choose_stepping(scene, spec, world, body);
        choose_self_contact(spec, world, body);
    }
    if (spec.scatter.rate > 0 && spec.copy + 1 == spec.scatter.count) add_pool(scene, spec, body, world);
    if (spec.copy > 0) return;
    const std::string copies = spec.scatter.count > 1 ? "; " + std::to_string(spec.scatter.count) + " of them" : "";
    built.notes.push_back(body_note(world, body, prototype) + copies);
}

}  // namespace

BuiltScene build_scene(const SceneFile& given, Looks looks) {
    const SceneFile folded = given.nodes.empty() ? SceneFile{} : fold_nodes(given);
    const SceneFile& scene = given.nodes.empty() ? given : folded;
    BuiltScene built;
    World& world = built.world;
    world.settings = scene.settings;
    world.clock.contact_rate = scene.contact_rate;
    PrototypeCache prototypes;
    prototypes.looks = looks;
    for (const BodySpec& spec : scene.bodies) add_scene_body(scene, spec, prototypes.get(scene, spec, world, built.warnings), built);
    for (const ToolSpec& spec : scene.tools) add_tool(scene, spec, world, built.warnings);
    for (uint32_t body = 0; body < world.bodies.mesh.size(); ++body) {
        const bool held = find_of_body(world.haptics.tool, body) != kNone, jaw = find_of_body(world.haptics.jaw, body) != kNone;
        if (world.bodies.motion[body] == Motion::kHand && !held && !jaw)
            refuse(scene, scene.bodies[body].line, "body \"" + world.bodies.name[body] + "\" is hand-driven but no [[tool]] holds it");
        if (held && jaw) refuse(scene, scene.bodies[body].line, "body \"" + world.bodies.name[body] + "\" is both a tool and a jaw");
    }
    add_scene_nodes(scene, world);
    if (!world.haptics.jaw.empty()) keep_jaws_apart(world);
    add_scene_links(scene, world);
    add_scene_actions(scene, world);
    add_scene_threads(scene, world);
    for (uint32_t body = 0; body < world.links.stable_dt.size(); ++body)
        if (world.links.stable_dt[body] < kLeastStep)
            refuse(scene, 1,
                   "the links of body \"" + world.bodies.name[body] + "\" are too stiff: its explicit step would be below 1e-9 s");
    add_scene_cuts(scene, world);
    add_scene_fluids(scene, world);
    open_pools(world);
    make_trees(world);
    for (std::string& doubt : find_doubts(scene, world)) built.warnings.push_back(std::move(doubt));
    built.camera = scene.camera;
    if (!scene.camera_body.empty()) built.camera.body = find_body(scene, scene.camera_line, world, scene.camera_body, "the camera: ");
    if (built.camera.body != kNone && is_deformable(world.bodies, built.camera.body))
        refuse(scene, scene.camera_line, "the camera: body \"" + scene.camera_body + "\" must be rigid");
    world.lenses = scene.lenses;
    for (Lens& lens : world.lenses.lens) lens.body = built.camera.body;
    built.picture = scene.picture;
    return built;
}

}  // namespace trocar
