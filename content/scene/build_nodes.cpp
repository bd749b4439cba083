#include "content/scene/build_nodes.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "content/scene/find_body.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/mesh/mass_properties.hpp"
#include "engine/mesh/surfaces.hpp"
#include "engine/motion/node_drive.hpp"
#include "engine/motion/node_switches.hpp"
namespace trocar {
namespace {

// Index of a node among the first `count`.
uint32_t find_node(const SceneFile& scene, const std::string& name, size_t count) {
    for (uint32_t n = 0; n < count; ++n)
        if (scene.nodes[n].name == name) return n;
    return kNone;
}
uint32_t node_of(const SceneFile& scene, const BodySpec& body) {
    if (body.node.empty()) return kNone;
    const uint32_t node = find_node(scene, body.node, scene.nodes.size());
    if (node == kNone) refuse(scene, body.line, "body \"" + body.name + "\": no node is named \"" + body.node + "\"");
    return node;
}

// x -> origin + turn * (scale * x)
struct NodeFrame {
    Vec3d origin = Vec3d::Zero();
    Quat turn;
    double scale = 1;
    Vec3d operator()(const Vec3d& x) const { return origin + rotate(turn, scale * x); }
};

std::vector<NodeFrame> node_frames(const SceneFile& scene) {
    std::vector<NodeFrame> frames;
    for (uint32_t n = 0; n < scene.nodes.size(); ++n) {
        const NodeSpec& node = scene.nodes[n];
        if (find_node(scene, node.name, n) != kNone) refuse(scene, node.line, "two nodes are named \"" + node.name + "\"");
        NodeFrame above;
        if (!node.parent.empty()) {
            const uint32_t parent = find_node(scene, node.parent, n);
            if (parent == kNone)
                refuse(scene, node.line, "node \"" + node.name + "\": parent \"" + node.parent + "\" names no node before it");
            if (scene.nodes[parent].drive.behaviour != NodeBehaviour::kNone)
                refuse(scene, node.line,
                       "node \"" + node.name +
                           "\": what hangs on a node that moves would have to move with it; take a parent without a behaviour");
            above = frames[parent];
        }
        frames.push_back({above(node.position), normalized(multiply(above.turn, node.orientation)), above.scale * node.scale});
        if (!(frames.back().scale >= 1e-9 && frames.back().scale <= 1e9) || !(frames.back().origin.norm() < 1e9))
            refuse(scene, node.line, "node \"" + node.name + "\": with those above it lies or scales beyond 1e9");
    }
    return frames;
}

void fold_body(const SceneFile& scene, const NodeFrame& frame, BodySpec& body) {
    if (!body.above.empty())
        refuse(scene, body.line, "body \"" + body.name + "\" stands above another body: it cannot lie in a node as well");
    if (frame.scale != 1 && body.scale == 0 && body.size == 0)
        refuse(scene, body.line, "body \"" + body.name + "\": a guessed scale cannot lie in a node with a scale of its own");
    body.position = frame(body.position);
    body.orientation = normalized(multiply(frame.turn, body.orientation));
    body.scale *= frame.scale;
    body.size *= frame.scale;
    body.velocity = rotate(frame.turn, body.velocity);
    body.spin = rotate(frame.turn, body.spin);
    for (Keyframe& key : body.path) {
        key.position = frame(key.position);
        key.orientation = normalized(multiply(frame.turn, key.orientation));
    }
}

void add_drive(const SceneFile& scene, uint32_t node, uint32_t body, const NodeFrame& frame, World& world) {
    const NodeSpec& spec = scene.nodes[node];
    const auto fail = [&](const std::string& reason) { refuse(scene, spec.line, "node \"" + spec.name + "\": " + reason); };
    const RigidMass* mass = world.bodies.motion[body] == Motion::kFree ? find_rigid_mass(world.bodies, body) : nullptr;
    if (!mass) fail("the body that it moves, \"" + world.bodies.name[body] + "\", must have motion = \"free\"");
    Poses& poses = world.poses;
    NodeDrive drive = spec.drive;
    drive.node = node, drive.body = body;
    drive.axis = rotate(frame.turn, spec.drive.axis).normalized();
    drive.origin = poses.origin[body];
    drive.orientation = poses.orientation[body];
    const Vec3d centre = drive.origin + rotate(drive.orientation, mass->centre);
    drive.pivot = turns(drive) ? frame.origin : centre;
    if (turns(drive)) {
        constexpr double kDegree = std::numbers::pi / 180;
        drive.lowest *= kDegree, drive.highest *= kDegree, drive.rest *= kDegree;
    }
    drive.inertia = drive_inertia(drive, *mass, drive.orientation, centre);
    DriveState state;
    state.rate = drive.axis.dot(turns(drive) ? poses.angular_velocity[body] : poses.velocity[body]);
    state.limit = drive.lowest == 0 ? -1 : drive.highest == 0 ? 1 : 0;
    // only one coordinate is free: discard all other components of the scene's initial velocity
    poses.angular_velocity[body] = turns(drive) ? Vec3d(state.rate * drive.axis) : Vec3d::Zero();
    poses.velocity[body] = turns(drive) ? poses.angular_velocity[body].cross(drive.origin - drive.pivot) : Vec3d(state.rate * drive.axis);
    constexpr double kStepOfPeriod = 0.2;  // rad per step: keeps the frequency of a spring correct to 0.2 %
    const double omega2 = drive_omega_squared(drive);
    if (omega2 > 0) world.bodies.stable_dt[body] = kStepOfPeriod / std::sqrt(omega2);
    if (world.bodies.stable_dt[body] < 1e-6) fail("so light a body on so stiff a spring would need steps below a microsecond");
    world.nodes.drive.push_back(drive);
    world.node_state.drive.push_back(state);
}

// Excludes pairs from collision: a driven body does not collide with the static bodies or other driven bodies
// of its parent node, because its limits come from its parameters. Also excludes pairs listed in the scene.
void keep_apart(const SceneFile& scene, World& world) {
    Nodes& nodes = world.nodes;
    for (uint32_t body = 0; body < scene.bodies.size(); ++body) {
        for (const std::string& name : scene.bodies[body].apart) {
            const uint32_t other = find_body(scene, scene.bodies[body].line, world, name, "apart: ");
            if (other == body) refuse(scene, scene.bodies[body].line, "apart: body \"" + name + "\" names itself");
            nodes.apart.push_back({std::min(body, other), std::max(body, other)});
        }
    }
    const auto parent_of = [&](uint32_t body) { return nodes.of_body[body] == kNone ? kNone : nodes.parent[nodes.of_body[body]]; };
    for (const NodeDrive& drive : nodes.drive) {
        for (uint32_t other = 0; other < world.bodies.mesh.size(); ++other) {
            const bool stands = world.bodies.motion[other] == Motion::kStatic;
            const bool sibling =
                other > drive.body && find_of_body(nodes.drive, other) != kNone && parent_of(other) == parent_of(drive.body);
            if (stands || sibling) nodes.apart.push_back({std::min(drive.body, other), std::max(drive.body, other)});
        }
    }
    std::sort(nodes.apart.begin(), nodes.apart.end());
    nodes.apart.erase(std::unique(nodes.apart.begin(), nodes.apart.end()), nodes.apart.end());
}

void add_switches(const SceneFile& scene, World& world) {
    for (uint32_t n = 0; n < scene.nodes.size(); ++n) {
        for (const NodeSwitchSpec& spec : scene.nodes[n].switches) {
            NodeSwitch s = spec.toggle;
            s.node = n;
            if (s.buttons != 0 && world.haptics.tool.empty()) refuse(scene, spec.line, "a switch by buttons, but there is no tool");
            if (!spec.tool.empty()) {
                s.tool = find_of_body(world.haptics.tool, find_body(scene, spec.line, world, spec.tool));
                if (s.tool == kNone) refuse(scene, spec.line, "no [[tool]] holds \"" + spec.tool + "\"");
            }
            if (!spec.driven.empty()) {
                s.drive = find_of_body(world.nodes.drive, find_body(scene, spec.line, world, spec.driven));
                if (s.drive == kNone) refuse(scene, spec.line, "body \"" + spec.driven + "\" hangs on no node with a behaviour");
            }
            world.nodes.toggle.push_back(s);
        }
    }
}

// Whether a body may be inactive for part of the scene.
bool may_be_off(const World& world, uint32_t body) {
    for (uint32_t node = world.nodes.of_body[body]; node != kNone; node = world.nodes.parent[node]) {
        const auto& toggle = world.nodes.toggle;
        if (!world.node_state.enabled[node] ||
            std::any_of(toggle.begin(), toggle.end(), [&](const NodeSwitch& s) { return s.node == node; }))
            return true;
    }
    return false;
}

void check_bodies_of_nodes(const SceneFile& scene, const World& world) {
    for (const LinkSpec& link : scene.links) {
        for (const std::string& name : {link.body, link.holder}) {
            const uint32_t body = find_body(world, name);
            if (body == kNone) continue;  // reported by add_scene_links
            const std::string what = "link \"" + link.link.name + "\": \"" + name + "\" ";
            if (find_of_body(world.nodes.drive, body) != kNone)
                refuse(scene, link.line, what + "is moved by its node and cannot be linked");
            if (may_be_off(world, body))
                refuse(scene, link.line, what + "hangs on a node that is disabled or switched and cannot be linked");
        }
    }
    for (const ToolSpec& tool : scene.tools)
        for (const ActionSpec& action : tool.actions)
            for (const std::string& name : action.action.kind == ActionKind::kSuture ? action.bodies : std::vector<std::string>{}) {
                const uint32_t body = find_body(world, name);
                if (body != kNone && may_be_off(world, body))
                    refuse(scene, action.line,
                           "a suture: \"" + name + "\" hangs on a node that is disabled or switched and cannot be sewn");
            }
    for (uint32_t body = 0; body < scene.bodies.size(); ++body)
        if (scene.bodies[body].scatter.rate > 0 && may_be_off(world, body))
            refuse(scene, scene.bodies[body].line,
                   "body \"" + scene.bodies[body].name + "\" comes and goes: its node can be neither disabled nor switched");
}

}  // namespace

SceneFile fold_nodes(const SceneFile& scene) {
    SceneFile folded = scene;
    const std::vector<NodeFrame> frames = node_frames(scene);
    for (BodySpec& body : folded.bodies)
        if (const uint32_t node = node_of(scene, body); node != kNone) fold_body(scene, frames[node], body);
    return folded;
}

void add_tool_exchanges(const SceneFile& scene, const ToolSpec& spec, World& world, uint32_t tool) {
    if (!spec.exchanges.empty() && world.haptics.tool[tool].jaws.count > 0)
        refuse(scene, spec.exchanges[0].line, "tool \"" + spec.body + "\" has jaws: it cannot be exchanged");
    uint32_t from = tool;
    for (const ToolExchangeSpec& exchange : spec.exchanges) {
        const uint32_t body = find_body(scene, exchange.line, world, exchange.body);
        if (world.bodies.motion[body] != Motion::kHand)
            refuse(scene, exchange.line, "body \"" + exchange.body + "\" of a tool must have motion = \"hand\"");
        const auto& tools = world.haptics.tool;
        uint32_t to = find_of_body(tools, body);  // the instrument may come back
        if (to != kNone && (to < tool || to == from)) refuse(scene, exchange.line, "body \"" + exchange.body + "\" is in a hand already");
        if (to == kNone) {
            to = static_cast<uint32_t>(tools.size());
            if (tools.size() == kMaxTools)
                refuse(scene, exchange.line, "more than " + std::to_string(kMaxTools) + " tools and instruments to exchange");
            HandTool other = tools[tool];
            other.body = body;
            other.tip = exchange.tip;
            if (exchange.tip_radius > 0 || spec.dof != 6)
                other.tip_radius = exchange.tip_radius > 0 ? exchange.tip_radius : spec.tool.tip_radius;
            world.haptics.tool.push_back(other);
            world.haptics.state.emplace_back();
        }
        world.node_state.laid_down.resize(world.haptics.tool.size(), 0);
        if (to != tool) world.node_state.laid_down[to] = 1;
        world.nodes.exchange.push_back({from, to, exchange.time, exchange.buttons});
        from = to;
    }
}

void add_scene_nodes(const SceneFile& scene, World& world) {
    if (scene.nodes.empty() && world.nodes.exchange.empty()) return keep_apart(scene, world);
    Nodes& nodes = world.nodes;
    if (!nodes.exchange.empty()) world.node_state.laid_down.resize(world.haptics.tool.size(), 0);
    const std::vector<NodeFrame> frames = node_frames(scene);
    for (uint32_t n = 0; n < scene.nodes.size(); ++n) {
        const NodeSpec& node = scene.nodes[n];
        nodes.name.push_back(node.name);
        nodes.parent.push_back(node.parent.empty() ? kNone : find_node(scene, node.parent, n));
        world.node_state.enabled.push_back(node.enabled);
    }
    std::vector<uint32_t> driven(scene.nodes.size(), kNone);
    for (uint32_t body = 0; body < scene.bodies.size() && !scene.nodes.empty(); ++body) {
        const uint32_t node = node_of(scene, scene.bodies[body]);
        nodes.of_body.push_back(node);
        if (node == kNone || scene.nodes[node].drive.behaviour == NodeBehaviour::kNone) continue;
        if (driven[node] != kNone)
            refuse(scene, scene.bodies[body].line, "node \"" + scene.nodes[node].name + "\" moves one body and has two");
        driven[node] = body;
        add_drive(scene, node, body, frames[node], world);
    }
    for (uint32_t n = 0; n < scene.nodes.size(); ++n)
        if (scene.nodes[n].drive.behaviour != NodeBehaviour::kNone && driven[n] == kNone)
            refuse(scene, scene.nodes[n].line, "node \"" + scene.nodes[n].name + "\" has a behaviour but no body");
    keep_apart(scene, world);
    add_switches(scene, world);
    if (!nodes.name.empty()) check_bodies_of_nodes(scene, world);
    NodeState& state = world.node_state;
    state.seen.assign(nodes.toggle.size() + nodes.exchange.size(), 0);
    find_bodies_off(static_cast<uint32_t>(world.bodies.mesh.size()), nodes, world.haptics.tool, state);
}

}  // namespace trocar
