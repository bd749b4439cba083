#include "systems/contact_rows.hpp"

#include <algorithm>
#include <cmath>

#include "engine/geometry/contact_kernels.hpp"
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
void drop_shallowest(uint32_t capacity, uint32_t body, const Contacts& contacts, ContactRowsScratch& scratch,
                     Report& report) {
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

void resize_rows(ContactRows& rows, size_t count) {
    rows.contact.resize(count);
    rows.body.resize(count);
    rows.other.resize(count);
    rows.vertex.resize(count);
    rows.along.resize(count);
    rows.triangle.resize(count);
    rows.weight.resize(count);
    rows.normal.resize(count);
    rows.distance.resize(count);
    rows.friction.resize(count);
    rows.impulse.assign(count, Vec3d::Zero());
}

}  // namespace

void make_contact_rows(const ContactParams& params, const Surfaces& surfaces, const CandidatePairs& pairs,
                       const Contacts& contacts, const Penetrations& penetrations, ContactRowsScratch& scratch,
                       Report& report, ContactRows& rows) {
    const uint32_t count = uint32_t(contacts.pair.size()), bodies = uint32_t(surfaces.bodies.mesh.size());
    scratch.count.assign(bodies, 0);
    scratch.dropped.assign(count, 0);
    for (const uint32_t body : contacts.body) ++scratch.count[body];
    for (uint32_t body = 0; body < bodies; ++body) {
        if (scratch.count[body] > params.row_capacity) {
            drop_shallowest(params.row_capacity, body, contacts, scratch, report);
        }
    }
    scratch.overlap.assign(pairs.a.size(), kNone);
    for (uint32_t i = 0; i < penetrations.pair.size(); ++i) scratch.overlap[penetrations.pair[i]] = i;

    resize_rows(rows, count);
    uint32_t kept = 0;
    for (uint32_t i = 0; i < count; ++i) {
        if (scratch.dropped[i]) continue;
        const uint32_t body = contacts.body[i], other = contacts.other[i], row = kept++;
        const uint32_t overlap = scratch.overlap[contacts.pair[i]];
        Vec3d normal = contacts.normal[i];
        double distance = contacts.distance[i];
        if (params.direction == ResponseDirection::kThesis && distance < 0 && overlap != kNone) {
            const Vec3d& way = penetrations.direction[overlap];
            const Vec3d out = body == pairs.a[contacts.pair[i]] ? Vec3d(-way) : way;
            distance *= std::max(0.0, normal.dot(out));
            normal = out;
        }
        if (params.deep == DeepResponse::kLastFree && distance < 0 && overlap != kNone &&
            penetrations.saturated[overlap] && penetrations.way_out[overlap] != Vec3d::Zero()) {
            const Vec3d& way = penetrations.way_out[overlap];
            normal = body == pairs.a[contacts.pair[i]] ? Vec3d(-way) : way;
            distance = contacts.distance[i];  // the way out is at least this long in any direction
        }
        const bool moves = is_deformable(surfaces.bodies, other);
        const Triangle& corner = mesh_view(surfaces.meshes, surfaces.bodies.mesh[other]).triangle[contacts.triangle[i]];
        const Vec3d p = world_to_frame(surfaces, other, contacts.closest[i]);
        rows.contact[row] = i;
        rows.body[row] = body;
        rows.other[row] = other;
        rows.vertex[row] = contacts.vertex[i];
        rows.along[row] = contacts.along[i];
        rows.triangle[row] = corner;
        rows.weight[row] =
            barycentric(p, vertex_in_frame(surfaces, other, corner[0]), vertex_in_frame(surfaces, other, corner[1]),
                        vertex_in_frame(surfaces, other, corner[2]));
        rows.normal[row] = moves ? normal : rotate_back(surfaces.poses.orientation[other], normal);
        rows.distance[row] = distance;
        rows.friction[row] =
            float(std::max(surfaces.bodies.tissue[body].friction, surfaces.bodies.tissue[other].friction));
    }
    resize_rows(rows, kept);
}

}  // namespace trocar
