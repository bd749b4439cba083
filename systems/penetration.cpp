#include "systems/penetration.hpp"
namespace trocar {
namespace {

void add_row(uint32_t pair, uint32_t contact, Penetrations& out) {
    out.pair.push_back(pair);
    out.depth.push_back(-1);
    out.direction.push_back(Vec3d::Zero());
    out.witness.push_back(contact);
    out.vertices_a_in_b.push_back(0);
    out.vertices_b_in_a.push_back(0);
    out.edge_contacts.push_back(0);
}

}  // namespace

void measure_penetrations(const CandidatePairs& pairs, const Contacts& contacts, Penetrations& out) {
    out.pair.clear();
    out.depth.clear();
    out.direction.clear();
    out.witness.clear();
    out.vertices_a_in_b.clear();
    out.vertices_b_in_a.clear();
    out.edge_contacts.clear();
    for (uint32_t i = 0; i < contacts.pair.size(); ++i) {
        if (!(contacts.distance[i] <= 0)) continue;
        const uint32_t pair = contacts.pair[i];
        if (out.pair.empty() || out.pair.back() != pair) add_row(pair, i, out);
        const bool of_a = contacts.body[i] == pairs.a[pair];
        if (-contacts.distance[i] > out.depth.back()) {
            out.depth.back() = 0.0 - contacts.distance[i];
            out.direction.back() = of_a ? Vec3d(-contacts.normal[i]) : contacts.normal[i];
            out.witness.back() = i;
        }
        if (contacts.vertex[i][0] != contacts.vertex[i][1]) {
            ++out.edge_contacts.back();
        } else if (contacts.distance[i] < 0) {
            ++(of_a ? out.vertices_a_in_b : out.vertices_b_in_a).back();
        }
    }
}

}  // namespace trocar
