#include "systems/app/run/viewer_actions.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/base/error.hpp"
#include "engine/fluid/film_setup.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/mesh/mass_properties.hpp"
#include "engine/mesh/surfaces.hpp"
#include "engine/tissue/embedded_surface.hpp"
#include "engine/tissue/links.hpp"
#include "systems/app/capture/what_if.hpp"
#include "systems/frame/state.hpp"
#include "systems/output/deformable_energy.hpp"
namespace trocar {
namespace {

// m, radius around the grabbed point in which nodes are held: of the body's radius, so that there are some in coarse bodies too.
constexpr double kGrabShare = 0.25;

void wake_held(World& w, uint32_t body) {
    if (body < w.sleep.still.size()) w.sleep.still[body] = 0;
}

uint32_t particle_of(const World& w, uint32_t body, uint32_t node) {
    return w.bodies.particles[body].first + embedded_count(w.solids, w.bodies.mesh[body]) + node;
}

// At the time of the velocities, to which the energy of links refers.
Vec3d place_of_node(const World& w, uint32_t body, uint32_t node) {
    const uint32_t p = particle_of(w, body, node);
    const Float4& o = w.particles.offset[p];
    const Vec3d velocity(w.particles.velocity_x[p], w.particles.velocity_y[p], w.particles.velocity_z[p]);
    return w.poses.origin[body] + Vec3d(o.x, o.y, o.z) - 0.5 * w.particles.last_dt[body] * velocity;
}

double kinetic_energy_of(const RigidMass& m, const Poses& poses) {
    const uint64_t b = m.body;
    const Vec3d arm = rotate(poses.orientation[b], m.centre), velocity = poses.velocity[b] + poses.angular_velocity[b].cross(arm);
    const Vec3d spin = rotate_back(multiply(poses.orientation[b], m.axes), poses.angular_velocity[b]);
    return 0.5 * m.mass * velocity.squaredNorm() + 0.5 * spin.dot(m.moments.cwiseProduct(spin));
}

// J, potential energy of gravity of all bodies.
double potential_of_gravity(World& w) {
    EnergyStart start{true, 0};
    EnergyScratch scratch;
    Energy energy;
    measure_energy(energy_inputs(w), start, scratch, energy);
    return energy.gravity;
}

Eigen::Matrix3d cross_matrix(const Vec3d& a) {
    Eigen::Matrix3d m;
    m << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
    return m;
}

}  // namespace

bool ViewerActions::is_marked(std::string_view key) {
    for (const std::string_view known : {"gravity", "substep", "contact.tolerance", "contact.push_speed", "contact.iterations"})
        if (key == known) return true;
    for (const std::string_view end : {".tissue.friction", ".tissue.damping", ".tissue.restitution"})
        if (key.ends_with(end)) return true;
    return false;
}

void ViewerActions::make_room(World& world) {
    Links& l = world.links;
    if (!world.fluids.body.empty()) world.fluid_state.edge.reserve(world.fluid_state.edge.capacity() + kVessels);
    if (world.particles.offset.empty()) return;
    const size_t links = l.node.capacity() + kNodes;
    l.group.reserve(l.group.capacity() + 1);
    l.node.reserve(links), l.far_node.reserve(links), l.point.reserve(links), l.rest.reserve(links), l.stretch.reserve(links);
    l.whole.reserve(links), l.stable_dt.reserve(world.bodies.mesh.size());
}

void ViewerActions::obey(const ViewCommand& command, Frame& frame, RunWatch* watch) {
    World& w = frame.world();
    switch (command.kind) {
        case ViewCommand::Kind::kSet: {
            if (!is_marked(command.key))
                throw InputError(command.key +
                                 ": while a run lasts these can be changed: gravity, substep, contact.tolerance, contact.push_speed, "
                                 "contact.iterations, BODY.tissue.friction, .damping, .restitution (body: of every body)");
            // a change of gravity lifts or lowers everything at once, which nobody's work does
            const bool falls = command.key == "gravity";
            const SceneSettings settings = w.settings;
            const std::vector<Tissue> tissue = w.bodies.tissue;
            const double before = falls ? potential_of_gravity(w) : 0;
            try {
                change_world({command.key, command.value}, w);
            } catch (const InputError&) {
                w.settings = settings, w.bodies.tissue = tissue;
                throw;
            }
            if (falls) {
                const double gained = potential_of_gravity(w) - before;
                w.energy_start.sum += gained;
                if (watch) watch->shift_gravity(gained);
            }
            for (uint32_t b = 0; b < w.sleep.still.size(); ++b) wake_held(w, b);
            break;
        }
        case ViewCommand::Kind::kGrab:
            grab(command.body, command.point, w);
            break;
        case ViewCommand::Kind::kPull:
            if (!holds()) throw InputError("no body is held");
            goal_ = command.point;
            break;
        case ViewCommand::Kind::kLet:
            let_go(w);
            break;
        case ViewCommand::Kind::kBleed:
            open_vessel(command.body, command.point, command.rate, w);
            break;
        case ViewCommand::Kind::kSlip:
            slip_staple(command.point, w);
            break;
    }
}

void ViewerActions::grab(uint32_t body, const Vec3d& point, World& w) {
    if (body >= w.bodies.mesh.size()) throw InputError("there is no body " + std::to_string(body));
    const std::string name = "\"" + w.bodies.name[body] + "\"";
    const bool soft = is_deformable(w.bodies, body);
    if (!soft && (w.bodies.motion[body] != Motion::kFree || !find_rigid_mass(w.bodies, body)))
        throw InputError(name + " is not moved by forces: a hand cannot drag it");
    for (const auto& slots : w.pools.slots)
        if (body >= slots.first && body < slots.end()) throw InputError(name + " comes and goes: a hand cannot drag it");
    const uint32_t held_before = body_;
    const Entity links_before = links_;
    const Links links_of_world = w.links;
    const Energy energy_before = w.energy;
    let_go(w);
    if (!soft) {
        arm_ = rotate_back(w.poses.orientation[body], point - w.poses.origin[body]);
        body_ = body, goal_ = hand_ = point;
        wake_held(w, body);
        return;
    }
    LinkGroup group;
    group.name = "hand";
    group.body = body;
    group.frame = RegionFrame::kWorld;
    const MeshInfo& info = w.meshes.info[w.bodies.mesh[body]];
    group.region = {RegionKind::kSphere, point, point, std::max(kGrabShare * info.radius, 2 * info.mean_edge)};
    group.most = kNodes;
    group.stiffness = kStiffness / kNodes;
    group.gauge = info.mean_edge;
    const Entity made = add_link_group(w.links, group);
    LinkScratch scratch;
    const uint32_t links = make_links({surfaces_of(w), w.solids, w.trees}, made.index, scratch, w.links, w.energy);
    if (links == 0) {
        w.links = links_of_world, w.energy = energy_before;
        body_ = held_before, links_ = links_before;
        throw InputError(name + ": no node that can move is near");
    }
    LinkGroup& held = w.links.group[made.index];
    held.stiffness = kStiffness / links;
    // where the velocities are, the links are stretched by half a step of motion: the hand's first work
    double energy = 0;
    for (uint32_t i = held.links.first; i < held.links.end(); ++i) {
        w.links.stretch[i] = (w.links.point[i] - place_of_node(w, body, w.links.node[i])).norm();
        energy += 0.5 * held.stiffness * w.links.stretch[i] * w.links.stretch[i];
    }
    w.energy.work_hand += energy;
    update_link_limits(w.bodies, w.solids, w.particles, scratch, w.links);
    body_ = body, links_ = made, goal_ = hand_ = point;
    wake_held(w, body);
}

// At both ends of the edge whose vertices are nearest to the point.
void ViewerActions::open_vessel(uint32_t body, const Vec3d& point, double rate, World& w) {
    if (body >= w.bodies.mesh.size()) throw InputError("there is no body " + std::to_string(body));
    const std::string name = "\"" + w.bodies.name[body] + "\"";
    const uint32_t film = find_film(w.fluids, body);
    if (film == kNone) throw InputError(name + " is never wet: [fluid] bodies of its scene does not name it");
    if (is_off(w.node_state, body)) throw InputError(name + " is not there");
    if (vessels_ >= kVessels || w.fluid_state.edge.size() >= w.fluid_state.edge.capacity())
        throw InputError("there is no room for more bleeding");
    const Surfaces s = surfaces_of(w);
    const Range triangles = w.meshes.info[w.bodies.mesh[body]].triangles;
    BleedingEdge edge{film, kNone, kNone, rate};
    double least = kNear, sum = std::numeric_limits<double>::infinity();
    for (uint32_t t = triangles.first; t < triangles.end(); ++t) {
        const Triangle& corner = w.meshes.triangle[t];
        for (size_t k = 0; k < 3; ++k) {
            const uint32_t a = corner[k], b = corner[(k + 1) % 3];
            const double at_a = (vertex_position(s, body, a) - point).norm(), at_b = (vertex_position(s, body, b) - point).norm();
            if (!(std::min(at_a, at_b) <= least) || !(at_a + at_b < sum)) continue;
            edge.a = a, edge.b = b, sum = at_a + at_b;
        }
    }
    if (edge.a == kNone) throw InputError(name + ": no surface is near");
    w.fluid_state.edge.push_back(edge);
    ++vessels_;
}

void ViewerActions::slip_staple(const Vec3d& point, World& w) {
    std::vector<ToolStaple>& staples = w.action_state.staple;
    size_t nearest = staples.size();
    double least = kNear;
    for (size_t i = 0; i < staples.size(); ++i) {
        const uint32_t index = find_link_group(w.links, staples[i].group);
        if (index == kNone || w.links.group[index].links.count == 0) continue;
        const LinkGroup& g = w.links.group[index];
        const double away = (place_of_node(w, g.body, w.links.node[g.links.first]) - point).norm();
        if (away <= least) least = away, nearest = i;
    }
    if (nearest == staples.size()) throw InputError("no staple is near");
    const LinkGroup& g = w.links.group[find_link_group(w.links, staples[nearest].group)];
    for (const uint32_t body : {g.body, g.holder})
        if (body != kNone) wake_held(w, body);
    double& most = w.action_state.progress[staples[nearest].action].largest_force;
    most = std::max(most, g.largest_force);
    free_link_group(w.links, staples[nearest].group, w.energy);
    staples.erase(staples.begin() + static_cast<ptrdiff_t>(nearest));
    LinkScratch scratch;
    update_link_limits(w.bodies, w.solids, w.particles, scratch, w.links);
}

void ViewerActions::let_go(World& w) {
    if (!holds()) return;
    const uint32_t body = std::exchange(body_, kNone);
    wake_held(w, body);
    if (!is_deformable(w.bodies, body)) return;
    if (!free_link_group(w.links, links_, w.energy)) return;
    LinkScratch scratch;
    update_link_limits(w.bodies, w.solids, w.particles, scratch, w.links);
}

// m, world: where the hand would not pull.
Vec3d ViewerActions::held_place(const World& w) const {
    if (!is_deformable(w.bodies, body_)) return w.poses.origin[body_] + rotate(w.poses.orientation[body_], arm_);
    const uint32_t index = find_link_group(w.links, links_);
    if (index == kNone || w.links.group[index].links.count == 0) return hand_;
    const Range links = w.links.group[index].links;
    Vec3d away = Vec3d::Zero();
    for (uint32_t i = links.first; i < links.end(); ++i) {
        const Float4& o = w.particles.offset[particle_of(w, body_, w.links.node[i])];
        away += w.poses.origin[body_] + Vec3d(o.x, o.y, o.z) - w.links.point[i];
    }
    return hand_ + away / links.count;
}

void ViewerActions::before_pass(Frame& frame) {
    if (!holds()) return;
    World& w = frame.world();
    const double seconds = 1e-3 * w.clock.period, reach = kStrongest / kStiffness;
    Vec3d by = goal_ - hand_;
    if (by.norm() > kFastest * seconds) by *= kFastest * seconds / by.norm();
    const Vec3d held = held_place(w);
    Vec3d pull = hand_ + by - held;
    if (pull.norm() > reach) by = held + pull * (reach / pull.norm()) - hand_;
    hand_ += by;
    if (is_deformable(w.bodies, body_))
        move_links(w, by);
    else
        pull_rigid(w, seconds);
}

void ViewerActions::move_links(World& w, const Vec3d& by) {
    const uint32_t index = find_link_group(w.links, links_);
    if (index == kNone) return;
    if (by != Vec3d::Zero()) wake_held(w, body_);
    const LinkGroup& g = w.links.group[index];
    for (uint32_t i = g.links.first; i < g.links.end(); ++i) {
        if (!w.links.whole[i]) continue;
        w.links.point[i] += by;
        const double before = w.links.stretch[i], now = (w.links.point[i] - place_of_node(w, body_, w.links.node[i])).norm();
        w.energy.work_hand += 0.5 * g.stiffness * (now * now - before * before);
        w.links.stretch[i] = now;
    }
}

void ViewerActions::pull_rigid(World& w, double seconds) {
    const RigidMass& m = *find_rigid_mass(w.bodies, body_);
    Poses& poses = w.poses;
    const double before = kinetic_energy_of(m, poses);
    const Vec3d arm = rotate(poses.orientation[body_], m.centre), centre = poses.origin[body_] + arm;
    const Vec3d at = held_place(w), lever = at - centre;
    // without the hand, the mean over the pass: with what gravity gives until its middle, the hand holds a weight at m g / k
    const Vec3d spin = poses.angular_velocity[body_], velocity = poses.velocity[body_] + spin.cross(at - poses.origin[body_]) +
                                                                 0.5 * (seconds + w.particles.last_dt[body_]) * w.settings.gravity;
    Eigen::Matrix3d turn;
    const Quat axes = multiply(poses.orientation[body_], m.axes);
    for (int k = 0; k < 3; ++k) turn.col(k) = rotate(axes, Vec3d::Unit(k));
    const Eigen::Matrix3d inverse_inertia = turn * m.moments.cwiseInverse().asDiagonal() * turn.transpose(),
                          lever_matrix = cross_matrix(lever);
    const Eigen::Matrix3d response = Eigen::Matrix3d::Identity() / m.mass - lever_matrix * inverse_inertia * lever_matrix;
    const double damping = 2 * std::sqrt(kStiffness * m.mass), soft = 1 / (seconds * (damping + seconds * kStiffness));
    const Vec3d pull = kStiffness * seconds * soft * (hand_ - at);
    Vec3d impulse = (response + soft * Eigen::Matrix3d::Identity()).ldlt().solve(pull - velocity);
    if (impulse.norm() > kStrongest * seconds) impulse *= kStrongest * seconds / impulse.norm();
    const Vec3d turned = inverse_inertia * lever.cross(impulse);
    poses.angular_velocity[body_] = spin + turned;
    poses.velocity[body_] += impulse / m.mass - turned.cross(arm);
    w.energy.work_hand += kinetic_energy_of(m, poses) - before;
    wake_held(w, body_);
}

}  // namespace trocar
