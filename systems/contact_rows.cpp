#include "systems/contact_rows.hpp"

#include <algorithm>
#include <cmath>

#include "engine/contact_rows.hpp"
#include "engine/geometry/contact_kernels.hpp"
#include "engine/geometry/point_triangle.hpp"
#include "engine/nose_first.hpp"
#include "engine/parallel.hpp"
namespace trocar {
namespace {

// Coordinates on a grid of 2^-23, so that the three floats add up to exactly one.
std::array<float, 3> barycentric(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    const Vec3d u = b - a, v = c - a, w = p - a;
    const double uu = u.dot(u), uv = u.dot(v), vv = v.dot(v), wu = w.dot(u), wv = w.dot(v);
    const double area = uu * vv - uv * uv;
    double y = 0, z = 0;
    if (area > 1e-12 * uu * vv) {
        y = (vv * wu - uv * wv) / area;
        z = (uu * wv - uv * wu) / area;
    } else if (std::max(uu, vv) > 0) {
        // a sliver: along its longer side from a
        (uu >= vv ? y : z) = uu >= vv ? wu / uu : wv / vv;
    }
    y = std::clamp(y, 0.0, 1.0);
    z = std::clamp(z, 0.0, 1.0 - y);
    const double unit = 1 << 23;
    const double fy = std::floor(y * unit) / unit, fz = std::floor(z * unit) / unit;
    return {float(1.0 - fy - fz), float(fy), float(fz)};
}

// Marks the contacts that a crowded body loses: all but its deepest, of equal depth the first stay.
void drop_shallowest(uint32_t capacity, uint32_t body, const Contacts& contacts, ContactRowsScratch& scratch, Report& report) {
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

// How steeply the body of a contact point runs through the plane of a normal: sine of the steepest edge that leaves
// the point to the wrong side. 0 where the plane carries it.
double plunge(const Surfaces& s, const Contacts& contacts, uint32_t i, const Vec3d& normal) {
    const uint32_t body = contacts.body[i];
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
    const auto [v, w] = contacts.vertex[i];
    const Vec3d way = direction_to_world(s, body, mesh.position[w] - mesh.position[v]);
    double steepest = v == w ? 0 : std::abs(way.normalized().dot(normal));
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

// The plane that carries a contact between two rigid bodies: `distance` m from the point, on `triangle` of the other.
struct Support {
    Vec3d closest, normal;
    double distance;
    uint32_t triangle;
    bool none = false;
};

// Near an edge of the other body the nearest point may lie on its side, while what carries is its top: two equal boxes
// on top of each other. The normal of a contact lies in the other body's normal cone and against the point's own (Moreau;
// as for the edges of polyhedra in Mirtich 1998), so of the faces around the nearest one that the point is over, the one
// that its own edges run through least carries it. A point outside that no face carries touches nothing yet where its body
// already reaches behind the plane (over the rim of the other); else it may come down on it (the raised end of a rod).
Support find_support(const Surfaces& s, const Contacts& contacts, uint32_t i) {
    constexpr double kCarries = 0.05;             // sine; what faces of curved surfaces differ by
    constexpr double kSeam = 1e-3, kNear = 0.05;  // of a mean edge: how far beyond its face and behind the nearest
    constexpr double kRounding = 1.0 + 1e-6;
    Support best{contacts.closest[i], contacts.normal[i], contacts.distance[i], contacts.triangle[i]};
    double least = plunge(s, contacts, i, best.normal);
    if (least < kCarries) return best;
    const double first = least;
    const uint32_t other = contacts.other[i];
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[other]);
    const Vec3d& p = contacts.point[i];
    const double reach = std::abs(contacts.distance[i]) + kNear * mesh.info->mean_edge;
    const Triangle& nearest = mesh.triangle[contacts.triangle[i]];
    for (uint32_t corner = 0; corner < 3; ++corner) {
        const uint32_t v = nearest[corner];
        for (uint32_t k = mesh.incident_first[v]; k < mesh.incident_first[v + 1]; ++k) {
            const uint32_t triangle = mesh.incident[k];
            const Triangle& t = mesh.triangle[triangle];
            // seen at another corner already
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

// Whether a point of a closed body lies beyond a sheet that has passed into the body: its own surface looks away from the
// sheet, so that the body lies between. The face of the sheet has a contact of its own, which leads it out.
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

// Where the line from a contact along `way` leaves the other body. False if it does not.
bool find_exit(const Surfaces& s, const Contacts& contacts, uint32_t i, const Vec3d& way, ContactRowsScratch& scratch, Support& at) {
    const uint32_t other = contacts.other[i];
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[other]);
    if (scratch.exit_pair != contacts.pair[i] || scratch.exit_body != other) {
        scratch.exit_pair = contacts.pair[i];
        scratch.exit_body = other;
        scratch.exit_point.clear();
        for (uint32_t v = 0; v < mesh.position.size(); ++v) scratch.exit_point.push_back(vertex_position(s, other, v));
        scratch.exits.build(scratch.exit_point, mesh.triangle, way);
    }
    const ExitGrid::Exit exit = scratch.exits.find(contacts.point[i]);
    if (exit.triangle == kNone) return false;
    at = {contacts.point[i] + exit.way * way, way, -exit.way, exit.triangle};
    return true;
}

// Writes the row of contact i into row i. False if it has none.
bool make_row(const ContactInputs& in, const Contacts& contacts, const Penetrations& penetrations, uint32_t i, ContactRowsScratch& scratch,
              ContactRows& rows) {
    const Surfaces& surfaces = in.surfaces;
    if (in.params.faces && is_beyond_sheet(surfaces, contacts, i)) return false;
    const uint32_t body = contacts.body[i], other = contacts.other[i];
    Support at{contacts.closest[i], contacts.normal[i], contacts.distance[i], contacts.triangle[i]};
    const bool both_rigid = !is_deformable(surfaces.bodies, body) && !is_deformable(surfaces.bodies, other);
    if (both_rigid && surfaces.bodies.thickness[other] == 0) at = find_support(surfaces, contacts, i);
    if (at.none) return false;
    const uint32_t overlap = scratch.overlap[contacts.pair[i]];
    const bool first = body == in.pairs.a[contacts.pair[i]];
    Vec3d lead = Vec3d::Zero();  // the way out of a deep pair, for this side
    if (in.params.deep == DeepResponse::kLastFree && overlap != kNone && penetrations.saturated[overlap]) {
        const Vec3d& way = penetrations.way_out[overlap];
        lead = first ? Vec3d(-way) : way;
    }
    const bool nearest_way = in.params.direction != ResponseDirection::kThesis && lead == Vec3d::Zero();
    const auto is_pushed = [&](uint32_t b) {
        return surfaces.bodies.motion[b] == Motion::kHand || surfaces.bodies.motion[b] == Motion::kFree;
    };
    scratch.nose_first[i] = (is_pushed(body) || is_pushed(other)) && !both_rigid && nearest_way && leaves_nose_first(surfaces, contacts, i);
    // what would hold the pair back on its way
    if (at.distance >= 0 && at.normal.dot(lead) < 0) return false;
    Vec3d normal = at.normal;
    double distance = at.distance;
    if (in.params.direction == ResponseDirection::kThesis && distance < 0 && overlap != kNone) {
        const Vec3d& way = penetrations.direction[overlap];
        const Vec3d out = first ? Vec3d(-way) : way;
        distance *= std::max(0.0, normal.dot(out));
        normal = out;
    }
    if (lead != Vec3d::Zero() && distance < 0 && find_exit(surfaces, contacts, i, lead, scratch, at)) {
        normal = lead;
        distance = at.distance;
    }
    const Triangle& corner = mesh_view(surfaces.meshes, surfaces.bodies.mesh[other]).triangle[at.triangle];
    const Vec3d p = world_to_frame(surfaces, other, at.closest);
    rows.contact[i] = i;
    rows.body[i] = body;
    rows.other[i] = other;
    rows.vertex[i] = contacts.vertex[i];
    rows.along[i] = contacts.along[i];
    rows.third[i] = contacts.third[i];
    rows.across[i] = contacts.across[i];
    rows.triangle[i] = corner;
    rows.weight[i] = barycentric(p, vertex_in_frame(surfaces, other, corner[0]), vertex_in_frame(surfaces, other, corner[1]),
                                 vertex_in_frame(surfaces, other, corner[2]));
    rows.normal[i] = is_deformable(surfaces.bodies, other) ? normal : rotate_back(surfaces.poses.orientation[other], normal);
    rows.distance[i] = distance;
    rows.friction[i] = float(std::max(surfaces.bodies.tissue[body].friction, surfaces.bodies.tissue[other].friction));
    return true;
}

// Marks the rows of points that leave nose first, of pairs that other points inside lead apart. Through a fold of thin tissue
// the nearest surface is its far side: a tool or a free body would hang in it, and pull the tissue over itself like a sock.
void drop_nose_first(const Contacts& contacts, ContactRowsScratch& scratch) {
    const uint32_t count = uint32_t(contacts.pair.size());
    for (uint32_t first = 0, end = 0; first < count; first = end) {
        bool any = false, others = false;
        for (end = first; end < count && contacts.pair[end] == contacts.pair[first]; ++end) {
            any = any || scratch.nose_first[end];
            others = others || (contacts.distance[end] < 0 && !scratch.dropped[end] && !scratch.nose_first[end]);
        }
        if (!any || !others) continue;
        for (uint32_t i = first; i < end; ++i) scratch.dropped[i] = scratch.dropped[i] || scratch.nose_first[i];
    }
}

constexpr uint32_t kRowsPerChunk = 512;

}  // namespace

void make_contact_rows(const ContactInputs& in, const Contacts& contacts, const Penetrations& penetrations, ContactRowsScratch& scratch,
                       Report& report, ContactRows& rows) {
    const uint32_t count = uint32_t(contacts.pair.size()), bodies = uint32_t(in.surfaces.bodies.mesh.size());
    const uint32_t capacity = in.params.row_capacity;
    scratch.count.assign(bodies, 0);
    scratch.dropped.assign(count, 0);
    scratch.nose_first.assign(count, 0);
    scratch.exit_pair = kNone;
    for (const uint32_t body : contacts.body) ++scratch.count[body];
    for (uint32_t body = 0; body < bodies; ++body) {
        if (scratch.count[body] > capacity) drop_shallowest(capacity, body, contacts, scratch, report);
    }
    scratch.overlap.assign(in.pairs.a.size(), kNone);
    for (uint32_t i = 0; i < penetrations.pair.size(); ++i) scratch.overlap[penetrations.pair[i]] = i;

    resize_rows(rows, count);
    // deep pairs share the grid of exits
    const uint32_t grain = in.params.deep == DeepResponse::kLastFree ? std::max(count, 1u) : kRowsPerChunk;
    parallel_for(count, grain, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i)
            scratch.dropped[i] = scratch.dropped[i] || !make_row(in, contacts, penetrations, i, scratch, rows);
    });
    drop_nose_first(contacts, scratch);
    take_out_rows(scratch.dropped, rows);
}

}  // namespace trocar
