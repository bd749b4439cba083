#include "content/scene/build_fluids.hpp"

#include <algorithm>
#include <numbers>

#include "content/scene/find_body.hpp"
#include "engine/fluid/film_setup.hpp"
#include "engine/tissue/tet_forces.hpp"
namespace trocar {
namespace {

bool uses_fluids(const SceneFile& scene, const World& world) {
    const auto nozzle = [](const ToolAction& a) { return is_nozzle(a.kind); };
    return scene.fluid.line > 0 || !scene.wounds.empty() || std::ranges::any_of(world.actions.action, nozzle);
}

// Why a body cannot be wet; empty if it can.
std::string why_dry(const World& world, uint32_t body) {
    const auto has = [&](const auto& list) { return find_of_body(list, body) != kNone; };
    if (world.bodies.motion[body] == Motion::kHand) return "it is held by a hand";
    if (has(world.tears.body) && is_solid(world.solids, world.bodies.mesh[body])) return "it is solid and may tear (break_strain, [[cut]])";
    for (const Range slots : world.pools.slots)
        if (body - slots.first < slots.count) return "it comes and goes";
    return "";
}

// The bodies that may be wet, ascending.
std::vector<uint32_t> choose_bodies(const SceneFile& scene, const World& world) {
    std::vector<uint32_t> chosen;
    for (const std::string& name : scene.fluid.bodies) {
        const uint32_t body = find_body(scene, scene.fluid.line, world, name, "[fluid] bodies: ");
        if (const std::string why = why_dry(world, body); !why.empty())
            refuse(scene, scene.fluid.line, "[fluid] bodies: \"" + name + "\" cannot be wet: " + why);
        chosen.push_back(body);
    }
    for (uint32_t body = 0; scene.fluid.bodies.empty() && body < world.bodies.mesh.size(); ++body)
        if (why_dry(world, body).empty()) chosen.push_back(body);
    std::sort(chosen.begin(), chosen.end());
    chosen.erase(std::unique(chosen.begin(), chosen.end()), chosen.end());
    return chosen;
}

// Puffs of smoke and edges that bleed, for which there is room. A puff leaves in every pass of a cautery: ten seconds of it.
constexpr uint32_t kMostPuffs = 600, kMostEdges = 4096;

// What a body may have after cuts.
FilmRoom room_of(const World& world, uint32_t body) {
    for (const CutBody& cut : world.actions.cut_body)
        if (cut.body == body) return {cut.vertices.count, cut.edges, true};
    for (const CutSolid& cut : world.actions.cut_solid)
        if (cut.body == body) return {cut.vertices.count, cut.mesh_edges, true};
    return {0, 0, find_of_body(world.tears.body, body) != kNone};
}

// Where drops are still followed: around all bodies, with room to fall and to splash.
Box find_inside(const World& world) {
    constexpr double kRoom = 0.5;  // m
    Box box;
    for (uint32_t body = 0; body < world.bodies.mesh.size(); ++body) {
        const double radius = world.meshes.info[world.bodies.mesh[body]].radius;
        grow(box, Box{world.poses.origin[body] - Vec3d::Constant(radius), world.poses.origin[body] + Vec3d::Constant(radius)});
    }
    return {box.min - Vec3d::Constant(kRoom), box.max + Vec3d::Constant(kRoom)};
}

// Poiseuille's law, m^3/s.
double rate_of(const WoundSpec& spec, const FluidParams& params) {
    if (spec.rate > 0) return spec.rate;
    const double d2 = spec.diameter * spec.diameter;
    return std::numbers::pi * d2 * d2 * spec.pressure / (128 * params.blood_viscosity * spec.length);
}

// m, from a staple to the vessel that it closes: half the crown of a staple of 5 mm.
constexpr double kStapleReach = 2.5e-3;

void add_wound(const SceneFile& scene, const WoundSpec& spec, World& world) {
    const std::string where = spec.name.empty() ? "a wound: " : "wound \"" + spec.name + "\": ";
    const uint32_t body = find_body(scene, spec.line, world, spec.body, where), film = find_film(world.fluids, body);
    if (film == kNone) {
        const std::string why = why_dry(world, body);
        refuse(scene, spec.line,
               where + "body \"" + spec.body + "\" cannot be wet: " + (why.empty() ? "it is not among [fluid] bodies" : why));
    }
    const Vec3d local = rotate_back(world.poses.orientation[body], spec.place - world.poses.origin[body]);
    Wound wound = place_wound(world.meshes, world.bodies.mesh[body], film, local, spec.radius, world.fluids);
    wound.rate = rate_of(spec, world.fluids.params);
    wound.pressure = spec.pressure > 0 ? spec.pressure : world.fluids.params.blood_pressure;
    wound.reach = std::max(spec.radius, kStapleReach);
    wound.begin = spec.from, wound.end = spec.until;
    world.fluids.wound.push_back(wound);
    world.fluid_state.bleeding.push_back(0);
}

}  // namespace

void add_scene_fluids(const SceneFile& scene, World& world) {
    if (!uses_fluids(scene, world)) return;
    world.fluids.params = scene.fluid.params;
    world.fluids.params.inside = find_inside(world);
    if (!scene.fluid.gravity_given) world.fluids.params.gravity = scene.settings.gravity;
    for (const uint32_t body : choose_bodies(scene, world))
        add_film(world.meshes, world.bodies.mesh[body], body, room_of(world, body), world.fluids, world.fluid_state);
    const bool burns = !world.actions.heats.empty();
    reserve_drops(scene.fluid.drops, burns ? kMostPuffs : 0, world.actions.cut_body.empty() ? 0 : kMostEdges, world.fluids,
                  world.fluid_state);
    world.fluid_state.heat.assign(burns ? world.actions.action.size() : 0, 0.0);
    for (const WoundSpec& spec : scene.wounds) add_wound(scene, spec, world);
}

}  // namespace trocar
