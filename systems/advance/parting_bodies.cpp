#include "systems/advance/parting_bodies.hpp"

#include <algorithm>
#include <cmath>
#include <ranges>
#include <utility>

#include "engine/geometry/quaternion.hpp"
#include "engine/mesh/surfaces.hpp"

namespace trocar {
namespace {

Range mass_nodes_of(const AdvanceInputs& in, uint32_t body) {
    const uint32_t skin = in.springs.info[in.bodies.mesh[body]].skin;
    return {in.bodies.particles[body].first + skin, in.bodies.particles[body].count - skin};
}

constexpr float kNoAnchor = 1e-6f;   // of the springs: solids without a bed have anchors of next to nothing
constexpr double kMostStrain = 0.5;  // of the smaller body: two that are held and overlap by more are not pressed flat
constexpr double kSpent = 1e-9;      // m, of travel: a pair that has no more is left as it is
// of the travel that a held pair brings (parting_pairs.cpp: 4 times what parts it) for each way of a correction: so long are two
// pressed flat as 1.25 times the way takes at push_speed. What yields is apart after 1.0 (balls of tissue, solid and shell, that
// overlap by 10 to 45 % of their size); what does not, gains energy with every correction from there on
constexpr double kHeldTravel = 4 / 1.25;
// What is left after so many sweeps is moved in later passes: of a neighbour and a body 100 times as light the lighter one takes 99 % of
// what the other undoes.
constexpr int kPartingShifts = 256;
constexpr double kShiftsDone = 1e-7;  // m, sweeps end when none moves bodies by more
constexpr double kLeastUsed = 0.1;    // of a step: travel that a pair loses though neighbours block it, so that it comes to rest

bool is_anchored(const AdvanceInputs& in, const Particles& particles, uint32_t body) {
    const Range nodes = mass_nodes_of(in, body);
    const auto fixed = [&](uint32_t i) { return particles.offset[i].w == 0; };
    const auto anchored = [&](uint32_t i) { return in.anchors.stiffness[i] > kNoAnchor * in.bodies.spring_stiffness[body]; };
    const bool in_world = in.bodies.anchor_frame[body] == AnchorFrame::kWorld;
    for (uint32_t i = nodes.first; i < nodes.end(); ++i) {
        if (in_world && anchored(i)) return true;
        if (fixed(i) && i + kSliceWidth < nodes.end()) return true;  // padding, which has no mass either, is in the last slice
    }
    return false;
}

// kg, of a body that can be moved as a whole; else 0.
double loose_mass(const AdvanceInputs& in, const PartingBodies& parting, const Particles& particles, uint32_t body) {
    if (std::ranges::any_of(parting.joined, [&](const auto& pair) { return pair[0] == body || pair[1] == body; })) return 0;
    if (in.bodies.motion[body] == Motion::kFree) {
        const bool driven = std::ranges::any_of(parting.nodes.drive, [&](const NodeDrive& drive) { return drive.body == body; });
        const auto own = std::ranges::find(in.bodies.rigid_mass, uint64_t{body}, &RigidMass::body);
        return driven || own == in.bodies.rigid_mass.end() ? 0 : own->mass;
    }
    if (!is_deformable(in.bodies, body) || is_anchored(in, particles, body)) return 0;
    const Range nodes = mass_nodes_of(in, body);
    double mass = 0;
    for (uint32_t i = nodes.first; i < nodes.end(); ++i)
        if (particles.offset[i].w > 0) mass += 1 / double{particles.offset[i].w};
    return mass;
}

// Moves b by `step` relative to a; both by their inverse masses, as far as they can be moved.
void move_apart(const Vec3d& step, std::array<double, 2> mass, uint32_t a, uint32_t b, std::vector<Vec3d>& shift) {
    const double share = mass[0] == 0 ? 1 : mass[1] == 0 ? 0 : mass[0] / (mass[0] + mass[1]);  // of b
    shift[a] -= (1 - share) * step;
    shift[b] += share * step;
}

// Shifts that part the pairs by `step`, m along their directions, and bring no body nearer to a neighbour than they touch.
void find_shifts(const PairMemory& pairs, std::span<const double> step, PartingBodiesScratch& scratch) {
    const auto along = [&](const Vec3d& direction, uint32_t a, uint32_t b) { return direction.dot(scratch.shift[b] - scratch.shift[a]); };
    double moved = 1;  // m
    for (int sweep = 0; sweep < kPartingShifts && moved > kShiftsDone; ++sweep) {
        moved = 0;
        for (size_t p = 0; p < pairs.a.size(); ++p) {
            if (!(step[p] > 0)) continue;
            const Vec3d direction = pairs.direction[p].normalized();
            const double way = step[p] - along(direction, pairs.a[p], pairs.b[p]);
            if (!(way > 0)) continue;
            move_apart(way * direction, scratch.mass[p], pairs.a[p], pairs.b[p], scratch.shift);
            moved = std::max(moved, way);
        }
        for (const PartingNeighbour& n : scratch.neighbours) {
            const double way = -n.gap - along(n.direction, n.a, n.b);
            if (!(way > 0)) continue;
            move_apart(way * n.direction, n.mass, n.a, n.b, scratch.shift);
            moved = std::max(moved, way);
        }
    }
}

bool is_spent(const Vec3d& travel) { return travel.norm() <= 2 * kSpent; }

void shorten(double by, Vec3d& travel) {
    const double length = travel.norm();
    travel *= std::max(kSpent, length - by) / length;
}

void move_body(const Vec3d& shift, uint32_t body, const AdvanceInputs& in, Particles& particles, Poses& poses) {
    if (in.bodies.motion[body] == Motion::kFree) {
        poses.origin[body] += shift;
        return;
    }
    const uint32_t skin = mass_nodes_of(in, body).first;
    for (uint32_t i = in.bodies.particles[body].first; i < in.bodies.particles[body].end(); ++i) {
        Float4& o = particles.offset[i];
        if (i >= skin && o.w == 0) continue;  // padding
        o.x += static_cast<float>(shift.x()), o.y += static_cast<float>(shift.y()), o.z += static_cast<float>(shift.z());
    }
}

// What the bodies that are moved as a whole touch, or are near to, besides the bodies they are parted from.
void find_neighbours(const AdvanceInputs& inputs, const PairMemory& pairs, const Poses& poses, const ContactConstraints& constraints,
                     PartingBodiesScratch& scratch) {
    scratch.neighbours.clear();
    std::vector<double>& mass = scratch.mass_of_body;
    mass.assign(inputs.bodies.mesh.size(), 0);
    for (size_t p = 0; p < pairs.a.size(); ++p) mass[pairs.a[p]] = scratch.mass[p][0], mass[pairs.b[p]] = scratch.mass[p][1];
    for (size_t c = 0; c < constraints.body.size(); ++c) {
        const uint32_t b = constraints.body[c], a = constraints.other[c];
        if (scratch.left[c] || (mass[a] == 0 && mass[b] == 0) || std::isinf(constraints.distance[c])) continue;
        const Vec3d normal = is_deformable(inputs.bodies, a) ? constraints.normal[c] : rotate(poses.orientation[a], constraints.normal[c]);
        scratch.neighbours.push_back({a, b, {mass[a], mass[b]}, normal, std::max(0.0, constraints.distance[c])});
    }
}

}  // namespace

void find_parting_contacts(const AdvanceInputs& inputs, const PartingBodies& parting, const Particles& particles, const Poses& poses,
                           const ContactConstraints& constraints, PartingBodiesScratch& scratch) {
    const PairMemory& pairs = parting.pairs;
    const size_t count = pairs.a.size();
    scratch.left.clear();
    scratch.depth.assign(count, 0);
    scratch.mass.clear();
    for (size_t p = 0; p < count; ++p)
        scratch.mass.push_back({loose_mass(inputs, parting, particles, pairs.a[p]), loose_mass(inputs, parting, particles, pairs.b[p])});
    scratch.neighbours.clear();
    if (count == 0) return;
    scratch.left.assign(constraints.body.size(), 0);
    bool any = false;
    for (size_t c = 0; c < constraints.body.size(); ++c) {
        const std::pair key(std::min(constraints.body[c], constraints.other[c]), std::max(constraints.body[c], constraints.other[c]));
        const auto all = std::views::iota(size_t{0}, count);
        const auto found = std::ranges::lower_bound(all, key, {}, [&](size_t p) { return std::pair(pairs.a[p], pairs.b[p]); });
        if (found == all.end() || pairs.a[*found] != key.first || pairs.b[*found] != key.second) continue;
        const size_t p = *found;
        const bool left = scratch.mass[p][0] > 0 || scratch.mass[p][1] > 0 || is_spent(pairs.direction[p]);
        scratch.left[c] = left, any = any || left;
        scratch.depth[p] = std::max(scratch.depth[p], -constraints.distance[c]);
    }
    find_neighbours(inputs, pairs, poses, constraints, scratch);
    if (!any) scratch.left.clear();
}

double part_bodies(const AdvanceInputs& inputs, const AdvanceParams& params, double seconds, PartingBodiesScratch& scratch,
                   PairMemory& pairs, Particles& particles, Poses& poses, double& work_push) {
    const double most = params.contact.push_speed * seconds;
    double deepest = 0;
    scratch.shift.assign(inputs.bodies.mesh.size(), Vec3d::Zero());
    scratch.step.assign(pairs.a.size(), 0);
    for (size_t p = 0; p < pairs.a.size(); ++p) {
        const auto [a, b] = scratch.mass[p];
        const double length = pairs.direction[p].norm(), step = std::min({scratch.depth[p], most, length});
        if (is_spent(pairs.direction[p])) deepest = std::max(deepest, scratch.depth[p]);
        if (is_spent(pairs.direction[p]) || !(step > 0)) continue;
        if (a == 0 && b == 0) {
            const auto radius = [&](uint32_t body) { return inputs.meshes.info[inputs.bodies.mesh[body]].radius; };
            const auto yields = [&](uint32_t body) { return is_deformable(inputs.bodies, body) ? 1 : 0; };
            const bool too_deep = scratch.depth[p] > kMostStrain * 2 * std::min(radius(pairs.a[p]), radius(pairs.b[p]));
            shorten(too_deep ? length : kHeldTravel * (yields(pairs.a[p]) + yields(pairs.b[p])) * step, pairs.direction[p]);
            continue;
        }
        scratch.step[p] = step;
    }
    find_shifts(pairs, scratch.step, scratch);
    for (Vec3d& shift : scratch.shift)
        if (const double length = shift.norm(); length > most) shift *= most / length;
    for (size_t p = 0; p < pairs.a.size(); ++p) {
        if (!(scratch.step[p] > 0)) continue;
        const double parted = pairs.direction[p].normalized().dot(scratch.shift[pairs.b[p]] - scratch.shift[pairs.a[p]]);
        deepest = std::max(deepest, scratch.depth[p] - parted);
        shorten(std::clamp(parted, kLeastUsed * scratch.step[p], scratch.step[p]), pairs.direction[p]);
    }
    for (size_t p = 0; p < pairs.a.size(); ++p) {
        for (const auto& [body, mass] : {std::pair(pairs.a[p], scratch.mass[p][0]), {pairs.b[p], scratch.mass[p][1]}}) {
            const Vec3d shift = scratch.shift[body];
            scratch.shift[body].setZero();
            if (shift.isZero(0)) continue;
            move_body(shift, body, inputs, particles, poses);
            if (params.account_energy) work_push -= mass * params.gravity.dot(shift);
        }
    }
    return deepest;
}

}  // namespace trocar
