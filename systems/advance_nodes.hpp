#pragma once
#include <vector>

#include "components/math.hpp"
#include "engine/geometry/vec4.hpp"
#include "engine/raw_vector.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// One row of ContactNodes.
template <typename Vector, typename Number, typename Row>
struct ContactNodeRow {
    Vector& place;
    Vector& after;
    Vector& velocity;
    Number& inv_mass;
    Number& particle_inv_mass;
    Row& particle;
    Row& owner;
};
using ContactNode = ContactNodeRow<Vec4d, double, uint32_t>;
using ConstContactNode = ContactNodeRow<const Vec4d, const double, const uint32_t>;

// Particles, hands and free bodies that contact rows act on. Field by field: a sweep over rows asks for one field of many
// nodes, here and there, and a cache holds four times as many of them so.
struct ContactNodes {
    RawVector<Vec4d> place;               // m, world, at the start of the substep
    RawVector<Vec4d> after;               // m, world, at its end
    RawVector<Vec4d> velocity;            // m/s
    RawVector<double> inv_mass;           // 1/kg: m/s that an impulse of 1 N s gives
    RawVector<double> particle_inv_mass;  // 1/kg, of a particle: without what damping takes of an impulse
    std::vector<uint32_t> particle;       // row of Particles; kNone for a rigid body
    std::vector<uint32_t> owner;          // row of body, or of rigid

    size_t size() const { return place.size(); }
    size_t capacity() const { return place.capacity(); }
    ContactNode operator[](size_t i) { return {place[i], after[i], velocity[i], inv_mass[i], particle_inv_mass[i], particle[i], owner[i]}; }
    ConstContactNode operator[](size_t i) const {
        return {place[i], after[i], velocity[i], inv_mass[i], particle_inv_mass[i], particle[i], owner[i]};
    }
    // New nodes are without particle; numbers are written by who adds them.
    void resize(size_t n) {
        for (auto* field : {&place, &after, &velocity}) field->resize(n);
        for (auto* field : {&inv_mass, &particle_inv_mass}) field->resize(n);
        particle.resize(n, kNone);
        owner.resize(n, 0);
    }
    // At rest at the origin, without mass.
    void clear_row(size_t i) {
        place[i] = after[i] = velocity[i] = Vec4d{};
        inv_mass[i] = particle_inv_mass[i] = 0;
    }
    void reserve(size_t n) {
        for (auto* field : {&place, &after, &velocity}) field->reserve(n);
        for (auto* field : {&inv_mass, &particle_inv_mass}) field->reserve(n);
        for (auto* field : {&particle, &owner}) field->reserve(n);
    }
};

// One row of ContactNodeChanges.
template <typename Vector, typename Row, typename Flag>
struct ContactNodeChangeRow {
    Vector& before;
    Vector& kicked;
    Vector& damped;
    Vector& acceleration;
    Vector& change;
    Vector& way;
    Row& rows;
    Row& pushes;
    Flag& opposed;
    Flag& pushed;
};
using ContactNodeChange = ContactNodeChangeRow<Vec4d, uint32_t, uint8_t>;
using ConstContactNodeChange = ContactNodeChangeRow<const Vec4d, const uint32_t, const uint8_t>;

// What a substep does to each row of ContactNodes.
struct ContactNodeChanges {
    RawVector<Vec4d> before;        // m/s, before the kick of this substep
    RawVector<Vec4d> kicked;        // m/s, after it
    RawVector<Vec4d> damped;        // m/s, before it and what damping takes off; of a particle, while energy is accounted
    RawVector<Vec4d> acceleration;  // m/s^2, of everything else in the kick; likewise
    RawVector<Vec4d> change;        // m, of the place by push-out
    RawVector<Vec4d> way;           // of the first active row that is not in a block; then, if opposed, m, what a push-out sweep moves it
    std::vector<uint32_t> rows;     // active rows that are not in a block; then, if opposed, the most that have pushed it in a sweep
    std::vector<uint32_t> pushes;   // if opposed: rows that push it in this sweep
    std::vector<uint8_t> opposed;   // two of them press it from both sides
    std::vector<uint8_t> pushed;    // its change is booked from the springs

    size_t size() const { return before.size(); }
    size_t capacity() const { return before.capacity(); }
    ContactNodeChange operator[](size_t i) {
        return {before[i], kicked[i], damped[i], acceleration[i], change[i], way[i], rows[i], pushes[i], opposed[i], pushed[i]};
    }
    ConstContactNodeChange operator[](size_t i) const {
        return {before[i], kicked[i], damped[i], acceleration[i], change[i], way[i], rows[i], pushes[i], opposed[i], pushed[i]};
    }
    void resize(size_t n) {
        for (auto* field : {&before, &kicked, &damped, &acceleration, &change, &way}) field->resize(n);
        for (auto* field : {&rows, &pushes}) field->resize(n, 0);
        for (auto* field : {&opposed, &pushed}) field->resize(n, 0);
    }
    void clear_row(size_t i) { before[i] = kicked[i] = damped[i] = acceleration[i] = change[i] = way[i] = Vec4d{}; }
    void reserve(size_t n) {
        for (auto* field : {&before, &kicked, &damped, &acceleration, &change, &way}) field->reserve(n);
        for (auto* field : {&rows, &pushes}) field->reserve(n);
        for (auto* field : {&opposed, &pushed}) field->reserve(n);
    }
};

// A vertex of a skin that rows act on: they name it by kSkinPoint | its row of skin_point, and give to its nodes.
inline constexpr uint32_t kSkinPoint = 1u << 31;
struct ContactSkinPoint {
    std::array<uint32_t, 4> node;  // rows of node
    std::array<double, 4> weight;
};

// What the nodes of a chunk add up to.
struct NodeSums {
    Vec4d fastest = {}, total = {};  // (m/s)^2, largest of each axis; m/s
    Vec4d work = {}, damped = {};    // J
};

// The contact nodes of an island: particles, hands and free bodies that contact constraints act on.
struct ContactNodeSet {
    ContactNodes node;
    ContactNodeChanges change;               // as node
    std::vector<uint8_t> moved_in;           // as node: sweep of push_out, from 1, that moved it last in this substep; 0: none
    std::vector<uint32_t> node_of_particle;  // row of node or kNone, one per particle of the world
    std::vector<ContactSkinPoint> skin_point;
    std::vector<NodeSums> node_sums;  // per chunk of nodes
};
constexpr uint32_t kNodesPerChunk = 4096;

// A new node: at rest at the origin, without particle or mass.
inline ContactNode add_node(ContactNodeSet& nodes) {
    const size_t row = nodes.node.size();
    nodes.node.resize(row + 1);
    nodes.change.resize(row + 1);
    nodes.node.clear_row(row);
    nodes.change.clear_row(row);
    return nodes.node[row];
}

// Calls visit(node, share) for a node, or for the nodes of a skin point.
template <typename Visit>
void visit_nodes(const ContactNodeSet& nodes, uint32_t point, const Visit& visit) {
    if (!(point & kSkinPoint)) return visit(point, 1.0);
    const ContactSkinPoint& skin = nodes.skin_point[point & ~kSkinPoint];
    for (int k = 0; k < 4; ++k) visit(skin.node[k], skin.weight[k]);
}
// Place, after or velocity of a node or of a skin point.
inline Vec4d field_at(const ContactNodeSet& nodes, uint32_t point, RawVector<Vec4d> ContactNodes::*field) {
    if (!(point & kSkinPoint)) return (nodes.node.*field)[point];
    Vec4d sum = {};
    visit_nodes(nodes, point, [&](uint32_t node, double share) { sum += share * (nodes.node.*field)[node]; });
    return sum;
}

}  // namespace trocar
#pragma GCC diagnostic pop
