#pragma once
#include <vector>

#include "components/math.hpp"
#include "engine/base/raw_vector.hpp"
#include "engine/geometry/vec4.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// One element of ContactNodes.
template <typename Vector, typename Number, typename Index>
struct ContactNodeRef {
    Vector& position;
    Vector& after;
    Vector& velocity;
    Number& inv_mass;
    Number& particle_inv_mass;
    Index& particle;
    Index& owner;
};
using ContactNode = ContactNodeRef<Vec4d, double, uint32_t>;
using ConstContactNode = ContactNodeRef<const Vec4d, const double, const uint32_t>;

// Particles, hands and free bodies on which contact constraints act. One array per field: a sweep reads one
// field of many scattered nodes, and a cache holds four times as many of them like this.
struct ContactNodes {
    RawVector<Vec4d> position;            // m, world, at the start of the substep
    RawVector<Vec4d> after;               // m, world, at its end
    RawVector<Vec4d> velocity;            // m/s
    RawVector<double> inv_mass;           // 1/kg: velocity change per impulse
    RawVector<double> particle_inv_mass;  // 1/kg, of a particle: without the damping of impulses
    std::vector<uint32_t> particle;       // index in Particles; kNone for a rigid body
    std::vector<uint32_t> owner;          // index in body, or in rigid

    size_t size() const { return position.size(); }
    size_t capacity() const { return position.capacity(); }
    ContactNode operator[](size_t i) {
        return {position[i], after[i], velocity[i], inv_mass[i], particle_inv_mass[i], particle[i], owner[i]};
    }
    ConstContactNode operator[](size_t i) const {
        return {position[i], after[i], velocity[i], inv_mass[i], particle_inv_mass[i], particle[i], owner[i]};
    }
    // New nodes have no particle; the caller writes the other fields.
    void resize(size_t n) {
        for (auto* field : {&position, &after, &velocity}) field->resize(n);
        for (auto* field : {&inv_mass, &particle_inv_mass}) field->resize(n);
        particle.resize(n, kNone);
        owner.resize(n, 0);
    }
    // At rest at the origin, without mass.
    void clear_at(size_t i) {
        position[i] = after[i] = velocity[i] = Vec4d{};
        inv_mass[i] = particle_inv_mass[i] = 0;
    }
    void reserve(size_t n) {
        for (auto* field : {&position, &after, &velocity}) field->reserve(n);
        for (auto* field : {&inv_mass, &particle_inv_mass}) field->reserve(n);
        for (auto* field : {&particle, &owner}) field->reserve(n);
    }
};

// One element of ContactNodeChanges.
template <typename Vector, typename Index, typename Flag>
struct ContactNodeChangeRef {
    Vector& before;
    Vector& kicked;
    Vector& damped;
    Vector& acceleration;
    Vector& change;
    Vector& displacement;
    Index& constraint_count;
    Index& corrections;
    Flag& conflicting;
    Flag& corrected;
};
using ContactNodeChange = ContactNodeChangeRef<Vec4d, uint32_t, uint8_t>;
using ConstContactNodeChange = ContactNodeChangeRef<const Vec4d, const uint32_t, const uint8_t>;

// Changes of each element of ContactNodes in a substep.
struct ContactNodeChanges {
    RawVector<Vec4d> before;        // m/s, before the kick of this substep
    RawVector<Vec4d> kicked;        // m/s, after it
    RawVector<Vec4d> damped;        // m/s, before it, and the part that damping removes; of a particle, while energy is accounted
    RawVector<Vec4d> acceleration;  // m/s^2, of all else in the kick; likewise
    RawVector<Vec4d> change;        // m, position correction
    RawVector<Vec4d> displacement;  // of the first active scalar constraint; then, if conflicting, m, displacement by a correction sweep
    std::vector<uint32_t> constraint_count;  // active scalar constraints; then, if conflicting, the most that have moved it in a sweep
    std::vector<uint32_t> corrections;       // if conflicting: constraints that move it in this sweep
    std::vector<uint8_t> conflicting;        // constraints press it from opposite sides
    std::vector<uint8_t> corrected;          // its change is accounted for by the springs

    size_t size() const { return before.size(); }
    size_t capacity() const { return before.capacity(); }
    ContactNodeChange operator[](size_t i) {
        return {before[i],       kicked[i],           damped[i],      acceleration[i], change[i],
                displacement[i], constraint_count[i], corrections[i], conflicting[i],  corrected[i]};
    }
    ConstContactNodeChange operator[](size_t i) const {
        return {before[i],       kicked[i],           damped[i],      acceleration[i], change[i],
                displacement[i], constraint_count[i], corrections[i], conflicting[i],  corrected[i]};
    }
    void resize(size_t n) {
        for (auto* field : {&before, &kicked, &damped, &acceleration, &change, &displacement}) field->resize(n);
        for (auto* field : {&constraint_count, &corrections}) field->resize(n, 0);
        for (auto* field : {&conflicting, &corrected}) field->resize(n, 0);
    }
    void clear_at(size_t i) { before[i] = kicked[i] = damped[i] = acceleration[i] = change[i] = displacement[i] = Vec4d{}; }
    void reserve(size_t n) {
        for (auto* field : {&before, &kicked, &damped, &acceleration, &change, &displacement}) field->reserve(n);
        for (auto* field : {&constraint_count, &corrections}) field->reserve(n);
        for (auto* field : {&conflicting, &corrected}) field->reserve(n);
    }
};

// A vertex of an embedded surface on which constraints act: they refer to it by kEmbeddedPoint | its index in
// embedded_point, and pass impulses on to its nodes.
inline constexpr uint32_t kEmbeddedPoint = 1u << 31;
struct EmbeddedPoint {
    std::array<uint32_t, 4> node;  // indices in node
    std::array<double, 4> weight;
};

// Sums over the nodes of a chunk.
struct NodeSums {
    Vec4d fastest = {}, total = {};  // (m/s)^2, largest of each axis; m/s
    Vec4d work = {}, damped = {};    // J
};

// What a node's velocity does under impulses of contact constraints, in islands with bodies that are stepped implicitly in
// contact.
struct NodeResponse {
    Vec4d column[3];  // 1/kg, velocity change per impulse
    Vec4d impulse;    // N s, of this substep's constraints

    Vec4d operator()(Vec4d j) const { return j[0] * column[0] + j[1] * column[1] + j[2] * column[2]; }
};

// The contact nodes of an island: particles, hands and free bodies that contact constraints act on.
struct ContactNodeSet {
    ContactNodes node;
    ContactNodeChanges change;               // as node
    RawVector<Vec4d> pressed;                // as node: sum of the directions of what corrections find overlapping
    std::vector<uint8_t> tangled;            // as node: no displacement frees it of that; corrections leave its constraints alone
    std::vector<uint8_t> moved_in;           // as node: sweep of correct_positions, from 1, that moved it last in this substep; 0: none
    std::vector<uint32_t> node_of_particle;  // index in node or kNone, one per particle of the world
    std::vector<EmbeddedPoint> embedded_point;
    std::vector<NodeSums> node_sums;   // per chunk of nodes
    RawVector<NodeResponse> response;  // as node; empty: nodes respond by their inverse masses
};
constexpr uint32_t kNodesPerChunk = 4096;

// A new node: at rest at the origin, without particle or mass.
inline ContactNode add_node(ContactNodeSet& nodes) {
    const size_t index = nodes.node.size();
    nodes.node.resize(index + 1);
    nodes.change.resize(index + 1);
    nodes.node.clear_at(index);
    nodes.change.clear_at(index);
    return nodes.node[index];
}

// Calls visit(node, share) for a node, or for the nodes of an embedded point.
template <typename Visit>
void visit_nodes(const ContactNodeSet& nodes, uint32_t point, const Visit& visit) {
    if (!(point & kEmbeddedPoint)) return visit(point, 1.0);
    const EmbeddedPoint& skin = nodes.embedded_point[point & ~kEmbeddedPoint];
    for (int k = 0; k < 4; ++k) visit(skin.node[k], skin.weight[k]);
}
// One field of a node (position, after or velocity), interpolated for an embedded point.
inline Vec4d field_at(const ContactNodeSet& nodes, uint32_t point, RawVector<Vec4d> ContactNodes::*field) {
    if (!(point & kEmbeddedPoint)) return (nodes.node.*field)[point];
    Vec4d sum = {};
    visit_nodes(nodes, point, [&](uint32_t node, double share) { sum += share * (nodes.node.*field)[node]; });
    return sum;
}

}  // namespace trocar
#pragma GCC diagnostic pop
