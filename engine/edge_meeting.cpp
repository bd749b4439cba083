#include "engine/edge_meeting.hpp"

#include <algorithm>
namespace trocar {

void append_edge_row(const Surfaces& s, const EdgeMeeting& m, ContactRows& rows) {
    const Triangle& corner = mesh_view(s.meshes, s.bodies.mesh[m.other]).triangle[m.triangle];
    std::array<float, 3> weight{};
    for (int k = 0; k < 3; ++k) {
        if (corner[k] == m.other_edge[0]) weight[k] = 1.0f - m.other_along;
        if (corner[k] == m.other_edge[1]) weight[k] = m.other_along;
    }
    rows.contact.push_back(kNone);
    rows.body.push_back(m.body);
    rows.other.push_back(m.other);
    rows.vertex.push_back(m.edge);
    rows.along.push_back(m.along);
    rows.third.push_back(kNone);
    rows.across.push_back(0);
    rows.triangle.push_back(corner);
    rows.weight.push_back(weight);
    rows.normal.push_back(is_deformable(s.bodies, m.other) ? m.normal : rotate_back(s.poses.orientation[m.other], m.normal));
    rows.distance.push_back(m.distance);
    rows.friction.push_back(static_cast<float>(std::max(s.bodies.tissue[m.body].friction, s.bodies.tissue[m.other].friction)));
    rows.impulse.push_back(Vec3d::Zero());
}

}  // namespace trocar
