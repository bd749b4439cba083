#include "engine/world/add_body.hpp"

#include "engine/base/check.hpp"
namespace trocar {

uint32_t add_body(World& world, const std::string& name, uint32_t prototype, Motion motion, const Tissue& tissue,
                  AnchorFrame anchor_frame) {
    TROCAR_ASSERT(prototype < world.meshes.info.size() && "add_body: no such prototype; was its mesh refused?");
    Bodies& bodies = world.bodies;
    const uint32_t body = static_cast<uint32_t>(bodies.mesh.size());
    bodies.entity.push_back({body, 0});
    bodies.name.push_back(name);
    bodies.mesh.push_back(prototype);
    bodies.motion.push_back(motion);
    bodies.particles.push_back({});
    bodies.tree.push_back(kNone);
    bodies.anchor_frame.push_back(anchor_frame);
    bodies.tissue.push_back(tissue);
    bodies.spring_stiffness.push_back(0);
    bodies.inv_mass.push_back(0);
    bodies.stable_dt.push_back(std::numeric_limits<double>::infinity());
    bodies.thickness.push_back(0);
    world.poses.origin.push_back(Vec3d::Zero());
    world.poses.orientation.push_back({});
    world.poses.velocity.push_back(Vec3d::Zero());
    world.poses.angular_velocity.push_back(Vec3d::Zero());
    // resizes arrays that are either empty or have one element per body
    if (!world.sleep.still.empty()) world.sleep.still.push_back(0), world.sleep.group.push_back(kNone);
    if (!world.spawning.away.empty()) {
        world.spawning.away.push_back(0), world.spawning.generation.push_back(0), world.spawning.since.push_back(world.clock.tick);
        world.pools.orientation.push_back({});
    }
    if (!world.nodes.of_body.empty()) world.nodes.of_body.push_back(kNone);
    if (!world.node_state.off.empty()) world.node_state.off.push_back(0);
    return body;
}

}  // namespace trocar
