#include "systems/constrain/contact_constraints.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/contact/contact_constraints.hpp"
#include "engine/contact/convex_pairs.hpp"
#include "engine/contact/tool_parts.hpp"
#include "engine/geometry/point_triangle.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/mesh/contact_kernels.hpp"
#include "engine/mesh/inverted_contact.hpp"
namespace trocar {
namespace {

// Marks all but the deepest contacts of a body over capacity; of equal depths the first stay.
void drop_shallowest(uint32_t capacity, uint32_t body, const Contacts& contacts, ContactConstraintsScratch& scratch, Report& report) {
    scratch.crowded.clear();
    for (uint32_t i = 0; i < contacts.body.size(); ++i) {
        if (contacts.body[i] == body) scratch.crowded.push_back(i);
    }
    const auto deeper = [&](uint32_t x, uint32_t y) {
        return contacts.distance[x] < contacts.distance[y] || (contacts.distance[x] == contacts.distance[y] && x < y);
    };
    std::nth_element(scratch.crowded.begin(), scratch.crowded.begin() + capacity, scratch.crowded.end(), deeper);
    for (uint32_t i = capacity; i < scratch.crowded.size(); ++i) scratch.dropped[scratch.crowded[i]] = 1;
    report.dropped_contacts += scratch.crowded.size() - capacity;
}

// How steeply the surface around a contact point crosses the plane of a normal: sine of the steepest edge
// from the point to the wrong side; 0 if there is none.
double plunge(const Surfaces& s, const Contacts& contacts, uint32_t i, const Vec3d& normal) {
    const uint32_t body = contacts.body[i];
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
    const auto [v, w] = contacts.vertex[i];
    const Vec3d direction = direction_to_world(s, body, mesh.position[w] - mesh.position[v]);
    double steepest = v == w ? 0 : std::abs(direction.normalized().dot(normal));
    if (const uint32_t third = contacts.third[i]; third != kNone) {
        const Vec3d side = direction_to_world(s, body, mesh.position[third] - mesh.position[v]);
        return std::max(steepest, std::abs(side.normalized().dot(normal)));
    }
    for (uint32_t k = mesh.incident_first[v]; k < mesh.incident_first[v + 1]; ++k) {
        const Triangle& t = mesh.triangle[mesh.incident[k]];
        if (v != w && t[0] != w && t[1] != w && t[2] != w) continue;
        for (const uint32_t q : t) {
            if (q == v || q == w) continue;
            const Vec3d edge = vertex_position(s, body, q) - contacts.point[i];
            steepest = std::max(steepest, -edge.normalized().dot(normal));
        }
    }
    return steepest;
}

// Whether a corner of the triangles around a contact point lies behind a plane.
bool goes_through(const Surfaces& s, const Contacts& contacts, uint32_t i, const Vec3d& plane, const Vec3d& normal) {
    const uint32_t body = contacts.body[i];
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
    for (const uint32_t v : contacts.vertex[i])
        for (uint32_t k = mesh.incident_first[v]; k < mesh.incident_first[v + 1]; ++k)
            for (const uint32_t q : mesh.triangle[mesh.incident[k]])
                if (normal.dot(vertex_position(s, body, q) - plane) < 0) return true;
    return false;
}

// Supporting plane of a contact of two rigid bodies, `distance` m from the point, on the other's `triangle`.
struct Support {
    Vec3d closest, normal;
    double distance;
    uint32_t triangle;
    bool none = false;
};

// Near an edge of the other body the closest point may be on its side although its top is the support: two
// equal boxes, one on the other. A normal lies in the other's normal cone and opposite to the point's own
// (Moreau; for polyhedra's edges Mirtich 1998), so of the faces around the closest one that have the point
// above them, the support is the one that the point's own edges penetrate least. A point outside without
// support is not in contact yet if its body already extends behind the plane (over the other's rim); else it
// may still land on it (a rod's raised end).
Support find_support(const Surfaces& s, const Contacts& contacts, uint32_t i) {
    constexpr double kCarries = 0.05;                   // sine; angle between neighbouring faces of curved surfaces
    constexpr double kSeam = 1e-3, kNearBehind = 0.05;  // of a mean edge: tolerance beyond the face, and behind the nearest one
    constexpr double kRounding = 1.0 + 1e-6;
    Support best{contacts.closest[i], contacts.normal[i], contacts.distance[i], contacts.triangle[i]};
    double least = plunge(s, contacts, i, best.normal);
    if (least < kCarries) return best;
    const double first = least;
    const uint32_t other = contacts.other[i];
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[other]);
    const Vec3d& p = contacts.point[i];
    const double reach = std::abs(contacts.distance[i]) + kNearBehind * mesh.info->mean_edge;
    const Triangle& nearest = mesh.triangle[contacts.triangle[i]];
    for (uint32_t corner = 0; corner < 3; ++corner) {
        const uint32_t v = nearest[corner];
        for (uint32_t k = mesh.incident_first[v]; k < mesh.incident_first[v + 1]; ++k) {
            const uint32_t triangle = mesh.incident[k];
            const Triangle& t = mesh.triangle[triangle];
            // already tested at another corner
            if (std::ranges::any_of(t, [&](uint32_t w) { return (corner > 0 && w == nearest[0]) || (corner > 1 && w == nearest[1]); }))
                continue;
            const Vec3d a = vertex_position(s, other, t[0]), b = vertex_position(s, other, t[1]), c = vertex_position(s, other, t[2]),
                        normal = triangle_normal(a, b, c).normalized();
            if (std::abs(normal.dot(p - a)) > kRounding * reach) continue;
            const Vec3d apart = -closest_point_on_triangle(p, a, b, c).offset, closest = p - apart;
            const double distance = normal.dot(apart), beyond = (apart - distance * normal).norm();
            if (!(std::abs(distance) < reach && beyond < kSeam * mesh.info->mean_edge)) continue;
            const double steep = plunge(s, contacts, i, normal);
            if (!(steep < least - 1e-9)) continue;
            least = steep;
            best = {closest, normal, distance, triangle};
        }
    }
    best.none = least == first && least > 0.5 && contacts.distance[i] > 0 && goes_through(s, contacts, i, best.closest, best.normal);
    return best;
}

constexpr double kAlong = 0.5;  // cosine, of normals along a separation direction
constexpr double kAnyTurn = std::numeric_limits<double>::infinity();

// Whether a rigid body's surface goes on beyond a contact point towards the plane: the contact then belongs to another point, and
// its plane, tilted against the surface, would stop or lift what slides along it. A normal lies opposite to the point's own
// normal cone, which has no width in a direction in which the surface is flat; elsewhere it may be off by three times what the
// surface bends, and by `turn` (rad), by which the body may turn in the period.
bool slopes_on(const Surfaces& s, const Contacts& contacts, uint32_t i, const Vec3d& plane_normal, double turn) {
    constexpr double kFlat = 1e-3;  // sine: above what rounding leaves of flat faces
    const uint32_t body = contacts.body[i];
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
    const auto [v, w] = contacts.vertex[i];
    const Vec3d point = mesh.position[v] + double{contacts.along[i]} * (mesh.position[w] - mesh.position[v]);
    const auto for_each_triangle = [&](const auto& visit) {
        for (uint32_t k = mesh.incident_first[v]; k < mesh.incident_first[v + 1]; ++k)
            if (const Triangle& t = mesh.triangle[mesh.incident[k]]; t[0] == w || t[1] == w || t[2] == w) visit(t);
    };
    Vec3d outward = Vec3d::Zero();
    for_each_triangle(
        [&](const Triangle& t) { outward += triangle_normal(mesh.position[t[0]], mesh.position[t[1]], mesh.position[t[2]]); });
    outward.normalize();
    const Vec3d normal = rotate_back(s.poses.orientation[body], plane_normal);
    bool slopes = false, sharp = false;
    const auto test = [&](uint32_t q) {
        const Vec3d edge = (mesh.position[q] - point).normalized();
        const double bend = std::abs(edge.dot(outward));
        sharp |= bend > kFlat;
        slopes |= -edge.dot(normal) > (bend < kFlat ? kFlat : 3 * bend + turn);
    };
    for_each_triangle([&](const Triangle& t) {
        for (const uint32_t q : t)
            if (q != v && q != w) test(q);
    });
    if (v != w && !sharp) test(v), test(w);
    return slopes;
}

// Whether a point of a closed body lies beyond a sheet that has entered the body: its own surface faces away
// from the sheet, so the body is in between. A contact of the sheet's face resolves the overlap.
bool is_beyond_sheet(const Surfaces& s, const Contacts& contacts, uint32_t i) {
    const uint32_t body = contacts.body[i], other = contacts.other[i];
    const auto is_sheet = [&](uint32_t b) { return s.meshes.info[s.bodies.mesh[b]].admission == Admission::kSheet; };
    if (!is_sheet(other) || is_sheet(body)) return false;
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
    const uint32_t v = contacts.vertex[i][0];
    Vec3d outward = Vec3d::Zero();
    for (uint32_t k = mesh.incident_first[v]; k < mesh.incident_first[v + 1]; ++k) {
        const Triangle& t = mesh.triangle[mesh.incident[k]];
        outward += triangle_normal(vertex_position(s, body, t[0]), vertex_position(s, body, t[1]), vertex_position(s, body, t[2]));
    }
    return outward.dot(contacts.normal[i]) > 0;
}

// Exit point from the other body along `direction` from a contact. False if there is none.
bool find_exit(const Surfaces& s, const Contacts& contacts, uint32_t i, const Vec3d& direction, ContactConstraintsScratch& scratch,
               Support& at) {
    const uint32_t other = contacts.other[i];
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[other]);
    if (scratch.exit_pair != contacts.pair[i] || scratch.exit_body != other) {
        scratch.exit_pair = contacts.pair[i];
        scratch.exit_body = other;
        scratch.exit_point.clear();
        for (uint32_t v = 0; v < mesh.position.size(); ++v) scratch.exit_point.push_back(vertex_position(s, other, v));
        scratch.exits.build(scratch.exit_point, mesh.triangle, direction);
    }
    const ExitGrid::Exit exit = scratch.exits.find(contacts.point[i]);
    if (exit.triangle == kNone) return false;
    at = {contacts.point[i] + exit.distance * direction, direction, -exit.distance, exit.triangle};
    return true;
}

// Plane of a contact of hulls: through a corner of the triangle, or where the line through two of them meets it. Repeated corners say
// that it is not bounded by a triangle.
void attach_plane(const ContactInputs& in, const Contacts& contacts, uint32_t i, ContactConstraints& constraints) {
    const uint32_t other = contacts.other[i], prototype = in.surfaces.bodies.mesh[other];
    const MeshView mesh = mesh_view(in.surfaces.meshes, prototype);
    const Vec3d normal = constraints.normal[i], closest = world_to_frame(in.surfaces, other, contacts.closest[i]);
    Triangle corner = mesh.triangle[contacts.triangle[i]];
    std::array<double, 3> height;
    for (int k = 0; k < 3; ++k) height[k] = normal.dot(mesh.position[corner[k]] - closest);
    const auto lower = [&](int a, int b) { return std::abs(height[a]) < std::abs(height[b]); };
    const int near = lower(1, 0) ? (lower(2, 1) ? 2 : 1) : (lower(2, 0) ? 2 : 0);
    float along = 0;
    int far = near;
    if (std::abs(height[near]) > kConvexTolerance * mesh.info->radius) {
        for (int k = 0; k < 3; ++k)
            if (std::abs(height[k] - height[near]) > std::abs(height[far] - height[near])) far = k;
        if (far != near) along = static_cast<float>(height[near] / (height[near] - height[far]));
    }
    constraints.triangle[i] = {corner[near], corner[far], corner[far]};
    constraints.weight[i] = {1.0f - along, along, 0.0f};
}

// Writes the constraint of contact i of two hulls.
void make_hull_constraint(const ContactInputs& in, const Contacts& contacts, uint32_t i, ContactConstraints& constraints) {
    const Bodies& bodies = in.surfaces.bodies;
    const uint32_t body = contacts.body[i], other = contacts.other[i];
    constraints.contact[i] = i;
    constraints.body[i] = body, constraints.other[i] = other;
    constraints.vertex[i] = contacts.vertex[i];
    constraints.along[i] = contacts.along[i];
    constraints.third[i] = kNone, constraints.across[i] = 0;
    constraints.normal[i] = rotate_back(in.surfaces.poses.orientation[other], contacts.normal[i]);
    constraints.distance[i] = contacts.distance[i];
    constraints.friction[i] = float(std::max(bodies.tissue[body].friction, bodies.tissue[other].friction));
    attach_plane(in, contacts, i, constraints);
}

// Writes contact i's constraint to index i. False if it has none.
bool make_constraint(const ContactInputs& in, const Contacts& contacts, const Penetrations& penetrations, uint32_t i,
                     ContactConstraintsScratch& scratch, ContactConstraints& constraints) {
    const Surfaces& surfaces = in.surfaces;
    if (touch_as_hulls(in, contacts.pair[i])) {
        make_hull_constraint(in, contacts, i, constraints);
        return true;
    }
    if (touch_as_sheets(surfaces, contacts.body[i], contacts.other[i])) return false;
    if (in.params.faces && is_beyond_sheet(surfaces, contacts, i)) return false;
    const uint32_t body = contacts.body[i], other = contacts.other[i];
    Support at{contacts.closest[i], contacts.normal[i], contacts.distance[i], contacts.triangle[i]};
    const bool both_rigid = !is_deformable(surfaces.bodies, body) && !is_deformable(surfaces.bodies, other);
    const uint32_t overlap = scratch.overlap[contacts.pair[i]];
    const bool first = body == in.pairs.a[contacts.pair[i]];
    Vec3d lead = Vec3d::Zero();  // separation direction of a deep pair, for this side
    if (overlap != kNone && penetrations.saturated[overlap]) {
        const Vec3d& direction = penetrations.separation_direction[overlap];
        lead = first ? Vec3d(-direction) : direction;
    }
    const bool parts = both_rigid && lead != Vec3d::Zero();
    if (both_rigid && !parts && surfaces.bodies.thickness[other] == 0) at = find_support(surfaces, contacts, i);
    if (at.none) return false;
    const bool along_nearest = in.params.direction != ResponseDirection::kThesis && lead == Vec3d::Zero();
    const auto is_pushed = [&](uint32_t b) {
        return surfaces.bodies.motion[b] == Motion::kHand || surfaces.bodies.motion[b] == Motion::kFree;
    };
    scratch.inverted[i] = (is_pushed(body) || is_pushed(other)) && !both_rigid && along_nearest && leaves_inverted(surfaces, contacts, i);
    // the thickness of a sheet is only in its planes
    const bool on_sheet = surfaces.meshes.info[surfaces.bodies.mesh[other]].admission == Admission::kSheet;
    if (((both_rigid && !parts) || surfaces.bodies.motion[body] == Motion::kStatic) && contacts.third[i] == kNone && !on_sheet) {
        const bool inside = at.distance < -in.params.tolerance;
        const double turn = inside ? kAnyTurn : surfaces.poses.angular_velocity[body].norm() * in.period;
        const bool slopes = slopes_on(surfaces, contacts, i, at.normal, turn);
        if (slopes && !inside) return false;
        scratch.slopes[i] = slopes && along_nearest;
    }
    // it would oppose the separation, or turn rigid bodies that part
    if (at.distance >= 0 && at.normal.dot(lead) < (parts ? kAlong : 0)) return false;
    Vec3d normal = at.normal;
    double distance = at.distance;
    if (in.params.direction == ResponseDirection::kThesis && distance < 0 && overlap != kNone) {
        const Vec3d& direction = penetrations.direction[overlap];
        const Vec3d out = first ? Vec3d(-direction) : direction;
        distance *= std::max(0.0, normal.dot(out));
        normal = out;
    }
    if (lead != Vec3d::Zero() && distance < 0 && (in.params.deep != DeepResponse::kNone || !on_sheet) &&
        find_exit(surfaces, contacts, i, lead, scratch, at)) {
        normal = lead;
        distance = at.distance;
    } else if (parts && distance < 0) {
        return false;
    } else if (in.params.deep == DeepResponse::kNone && normal.dot(lead) < 0) {
        return false;
    }
    const Meshes& meshes = surfaces.meshes;
    const Triangle& corner = meshes.triangle[meshes.info[surfaces.bodies.mesh[other]].triangles.first + at.triangle];
    const Vec3d p = world_to_frame(surfaces, other, at.closest);
    constraints.contact[i] = i;
    constraints.body[i] = body;
    constraints.other[i] = other;
    constraints.vertex[i] = contacts.vertex[i];
    constraints.along[i] = contacts.along[i];
    constraints.third[i] = contacts.third[i];
    constraints.across[i] = contacts.across[i];
    constraints.triangle[i] = corner;
    constraints.weight[i] = barycentric_weights(p, vertex_in_frame(surfaces, other, corner[0]), vertex_in_frame(surfaces, other, corner[1]),
                                                vertex_in_frame(surfaces, other, corner[2]));
    constraints.normal[i] = is_deformable(surfaces.bodies, other) ? normal : rotate_back(surfaces.poses.orientation[other], normal);
    constraints.distance[i] = distance;
    constraints.friction[i] = float(std::max(surfaces.bodies.tissue[body].friction, surfaces.bodies.tissue[other].friction));
    return true;
}

// Marks inverted contacts of pairs that other inside points separate, and sloping ones of pairs that have another as deep. In a
// fold of thin tissue the nearest surface is the far side: a tool or free body would be caught and pull the tissue over itself
// like a sock.
void drop_contacts(double tolerance, const Contacts& contacts, ContactConstraintsScratch& scratch) {
    const uint32_t count = uint32_t(contacts.pair.size());
    for (uint32_t first = 0, end = 0; first < count; first = end) {
        bool any = false;
        double deepest = 0;
        for (end = first; end < count && contacts.pair[end] == contacts.pair[first]; ++end) {
            any = any || scratch.inverted[end] || scratch.slopes[end];
            if (!scratch.dropped[end] && !scratch.inverted[end] && !scratch.slopes[end])
                deepest = std::max(deepest, -contacts.distance[end]);
        }
        for (uint32_t i = first; any && deepest > 0 && i < end; ++i)
            scratch.dropped[i] |= scratch.inverted[i] || (scratch.slopes[i] && -contacts.distance[i] <= deepest + tolerance);
    }
}

// Marks the contacts of tools that leave a body.
void let_go(const Haptics& haptics, const Contacts& contacts, std::vector<uint8_t>& dropped) {
    for (size_t t = 0; t < haptics.tool.size(); ++t) {
        if (haptics.state[t].exit.body == kNone) continue;
        const auto is_part = [&](uint32_t body) { return is_part_of_tool(haptics, haptics.tool[t], body); };
        for (size_t i = 0; i < dropped.size(); ++i) dropped[i] = dropped[i] || is_part(contacts.body[i]) || is_part(contacts.other[i]);
    }
}

// Appends a copy of a constraint that contact memory does not keep.
void repeat_constraint(uint32_t from, ContactConstraints& constraints) {
    const size_t to = constraints.body.size();
    resize_constraints(constraints, to + 1);
    constraints.contact[to] = kNone;
    constraints.body[to] = constraints.body[from], constraints.other[to] = constraints.other[from];
    constraints.vertex[to] = constraints.vertex[from], constraints.third[to] = constraints.third[from];
    constraints.along[to] = constraints.along[from], constraints.across[to] = constraints.across[from];
    constraints.friction[to] = constraints.friction[from];
}

// Whether faces around a vertex meet at more than 60 degrees.
bool is_sharp(const Surfaces& s, uint32_t body, uint32_t vertex) {
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
    const auto faces = mesh.incident.subspan(mesh.incident_first[vertex], mesh.incident_first[vertex + 1] - mesh.incident_first[vertex]);
    const auto normal_of = [&](uint32_t t) {
        const auto [a, b, c] = mesh.triangle[t];
        return triangle_normal(mesh.position[a], mesh.position[b], mesh.position[c]).normalized();
    };
    return std::ranges::any_of(faces, [&, first = normal_of(faces[0])](uint32_t t) { return first.dot(normal_of(t)) < 0.5; });
}

// A corner that has dented tissue touches several triangles of the dent at once, of which its contact has the nearest: left to
// it alone, the point goes through the others in turn, from pass to pass. Adds the planes of the neighbours across a
// concave edge above whose triangles the point is, or nearly.
void add_dent_planes(const ContactInputs& in, const Contacts& contacts, const Haptics& haptics, ContactConstraints& constraints) {
    constexpr double kNearly = 0.1;  // of a mean edge; of 0.05 to 1 what left 24 held corners stillest and their mean unchanged
    constexpr double kFlat = 1e-3;   // of a mean edge
    const Surfaces& s = in.surfaces;
    if (std::ranges::all_of(haptics.tool, [](const HandTool& t) { return t.point_shell.empty(); })) return;
    const auto turns = [&](uint32_t body) {
        return std::ranges::any_of(haptics.tool, [&](const HandTool& t) { return t.body == body && !t.point_shell.empty(); });
    };
    const uint32_t count = uint32_t(constraints.body.size());
    for (uint32_t c = 0; c < count; ++c) {
        const uint32_t i = constraints.contact[c], other = constraints.other[c];
        const bool corner_of_tool = turns(constraints.body[c]) && contacts.vertex[i][0] == contacts.vertex[i][1];
        if (!corner_of_tool || contacts.third[i] != kNone || !is_deformable(s.bodies, other) ||
            !is_sharp(s, constraints.body[c], contacts.vertex[i][0]))
            continue;
        const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[other]);
        const double nearly = kNearly * mesh.info->mean_edge;
        const auto corners_of = [&](const Triangle& t) {
            return std::array{vertex_position(s, other, t[0]), vertex_position(s, other, t[1]), vertex_position(s, other, t[2])};
        };
        const auto normal_of = [](const std::array<Vec3d, 3>& at) { return triangle_normal(at[0], at[1], at[2]).normalized(); };
        const auto mine = corners_of(mesh.triangle[contacts.triangle[i]]);
        const Vec3d normal = normal_of(mine), &p = contacts.point[i];
        for (const uint32_t neighbour : mesh.neighbour[contacts.triangle[i]]) {
            if (neighbour == kNone) continue;
            const auto at = corners_of(mesh.triangle[neighbour]);
            if (std::ranges::none_of(at, [&](const Vec3d& q) { return normal.dot(q - mine[0]) > kFlat * mesh.info->mean_edge; })) continue;
            const Vec3d across = normal_of(at);
            const double distance = across.dot(p - at[0]);
            const Vec3d foot = p - distance * across;
            if (!(distance < nearly && closest_point_on_triangle(foot, at[0], at[1], at[2]).squared_distance <= nearly * nearly)) continue;
            repeat_constraint(c, constraints);
            constraints.triangle.back() = mesh.triangle[neighbour];
            constraints.weight.back() = barycentric_weights(foot, at[0], at[1], at[2]);
            constraints.normal.back() = across;
            constraints.distance.back() = distance;
        }
    }
}

constexpr uint32_t kConstraintsPerChunk = 512;

}  // namespace

void make_contact_constraints(const ContactInputs& in, const Contacts& contacts, const Penetrations& penetrations,
                              ContactConstraintsScratch& scratch, Report& report, ContactConstraints& constraints, const Haptics& haptics) {
    const uint32_t count = uint32_t(contacts.pair.size()), bodies = uint32_t(in.surfaces.bodies.mesh.size());
    const uint32_t capacity = in.params.constraint_capacity;
    scratch.count.assign(bodies, 0);
    scratch.dropped.assign(count, 0);
    scratch.inverted.assign(count, 0);
    scratch.slopes.assign(count, 0);
    scratch.exit_pair = kNone;
    let_go(haptics, contacts, scratch.dropped);
    for (const uint32_t body : contacts.body) ++scratch.count[body];
    for (uint32_t body = 0; body < bodies; ++body) {
        if (scratch.count[body] > capacity) drop_shallowest(capacity, body, contacts, scratch, report);
    }
    scratch.overlap.assign(in.pairs.a.size(), kNone);
    for (uint32_t i = 0; i < penetrations.pair.size(); ++i) scratch.overlap[penetrations.pair[i]] = i;

    resize_constraints(constraints, count);
    // a deep pair's contacts share one exit grid, so they must not be split
    const bool any_deep = std::ranges::any_of(penetrations.saturated, [](uint8_t deep) { return deep != 0; });
    const uint32_t grain = any_deep ? std::max(count, 1u) : kConstraintsPerChunk;
    parallel_for(count, grain, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i)
            scratch.dropped[i] = scratch.dropped[i] || !make_constraint(in, contacts, penetrations, i, scratch, constraints);
    });
    drop_contacts(in.params.tolerance, contacts, scratch);
    remove_constraints(scratch.dropped, constraints);
    add_dent_planes(in, contacts, haptics, constraints);
}

}  // namespace trocar
