#include "engine/mesh/convex_contact.hpp"

#include <immintrin.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/geometry/quaternion.hpp"
namespace trocar {
namespace {

constexpr double kUnbounded = std::numeric_limits<double>::infinity();
constexpr double kBeside = 1e-4;      // of the smaller radius: a corner so far beyond a side still counts as over the face
constexpr double kParallel2 = 1e-12;  // squared sine between edges that give no direction: it is that of a face within 1e-6 edge lengths
constexpr double kOpposite = -0.9;    // cosine of faces of which a corner of one over the inside of the other is a contact

struct HullSide {
    const ConvexHull& hull;
    HullContactScratch::Side& at;  // in the frame of a
    Vec3d centre;
};

void lay_out(const ConvexHull& hull, HullContactScratch::Side& at) {
    const size_t padded = (hull.point.size() + 3) / 4 * 4;
    for (auto* column : {&at.x, &at.y, &at.z}) column->resize(padded);
    for (size_t i = 0; i < padded; ++i) {
        const Vec3d& p = at.point[i < hull.point.size() ? i : 0];
        at.x[i] = p.x(), at.y[i] = p.y(), at.z[i] = p.z();
    }
}

void place_first(const ConvexHull& hull, HullContactScratch::Side& at) {
    at.point.assign(hull.point.begin(), hull.point.end());
    at.normal.resize(hull.face.size());
    at.offset.resize(hull.face.size());
    for (size_t f = 0; f < hull.face.size(); ++f) at.normal[f] = hull.face[f].normal, at.offset[f] = hull.face[f].offset;
    lay_out(hull, at);
}

void place_second(const ConvexHull& hull, const Quat& turn, const Vec3d& shift, HullContactScratch::Side& at) {
    const Vec3d column[3] = {rotate(turn, Vec3d::Unit(0)), rotate(turn, Vec3d::Unit(1)), rotate(turn, Vec3d::Unit(2))};
    const auto turned = [&](const Vec3d& v) -> Vec3d { return column[0] * v.x() + column[1] * v.y() + column[2] * v.z(); };
    at.point.resize(hull.point.size());
    for (size_t i = 0; i < hull.point.size(); ++i) at.point[i] = turned(hull.point[i]) + shift;
    at.normal.resize(hull.face.size());
    at.offset.resize(hull.face.size());
    for (size_t f = 0; f < hull.face.size(); ++f) {
        at.normal[f] = turned(hull.face[f].normal);
        at.offset[f] = hull.face[f].offset + at.normal[f].dot(shift);
    }
    lay_out(hull, at);
}

// Least coordinate of a hull's points along a direction, and the first point that has it.
double least_along(const HullContactScratch::Side& side, const Vec3d& direction, uint32_t& least) {
    const __m256d dx = _mm256_set1_pd(direction.x()), dy = _mm256_set1_pd(direction.y()), dz = _mm256_set1_pd(direction.z());
    __m256d best = _mm256_set1_pd(kUnbounded);
    __m256i best_at = _mm256_setzero_si256(), at = _mm256_setr_epi64x(0, 1, 2, 3);
    for (size_t i = 0; i < side.x.size(); i += 4) {
        const __m256d sum =
            _mm256_add_pd(_mm256_add_pd(_mm256_mul_pd(dx, _mm256_loadu_pd(&side.x[i])), _mm256_mul_pd(dy, _mm256_loadu_pd(&side.y[i]))),
                          _mm256_mul_pd(dz, _mm256_loadu_pd(&side.z[i])));
        const __m256d less = _mm256_cmp_pd(sum, best, _CMP_LT_OQ);
        best = _mm256_blendv_pd(best, sum, less);
        best_at = _mm256_castpd_si256(_mm256_blendv_pd(_mm256_castsi256_pd(best_at), _mm256_castsi256_pd(at), less));
        at = _mm256_add_epi64(at, _mm256_set1_epi64x(4));
    }
    alignas(32) double value[4];
    alignas(32) int64_t index[4];
    _mm256_store_pd(value, best);
    _mm256_store_si256(reinterpret_cast<__m256i*>(index), best_at);
    int k = 0;
    for (int i = 1; i < 4; ++i)
        if (value[i] < value[k] || (value[i] == value[k] && index[i] < index[k])) k = i;
    least = index[k] < int64_t(side.point.size()) ? uint32_t(index[k]) : 0;
    return value[k];
}

struct FaceAxis {
    double separation = -kUnbounded;
    uint32_t face = 0, support = 0;  // of the other hull: its point nearest to the face's plane
};

// The face with the largest separation. False if one separates by more than the margin.
bool find_face_axis(const HullSide& own, const HullSide& other, double margin, FaceAxis& best) {
    uint32_t near = 0;
    least_along(other.at, other.centre - own.centre, near);
    for (uint32_t f = 0; f < own.at.normal.size(); ++f) {
        const Vec3d& normal = own.at.normal[f];
        if (!(normal.dot(other.at.point[near]) - own.at.offset[f] > best.separation)) continue;
        uint32_t support;
        const double separation = least_along(other.at, normal, support) - own.at.offset[f];
        if (separation > margin) return false;
        if (separation > best.separation) best = {separation, f, support}, near = support;
    }
    return true;
}

// Edges whose normals may separate by more than `least`, where the other hull has a point `near`.
void find_open_edges(const HullSide& own, const Vec3d& near, double least, std::vector<uint32_t>& edges) {
    auto& height = own.at.height;
    height.resize(own.at.normal.size());
    for (size_t f = 0; f < height.size(); ++f) height[f] = own.at.normal[f].dot(near) - own.at.offset[f];
    edges.clear();
    for (uint32_t e = 0; e < own.hull.edge.size(); ++e) {
        const HullEdge& edge = own.hull.edge[e];
        const double h0 = height[edge.faces[0]], h1 = height[edge.faces[1]], c = edge.cosine;
        double most = std::max(h0, h1);
        const double squared_sine = 1 - c * c;
        if (h0 > c * h1 && h1 > c * h0 && squared_sine > 1e-12)
            most = std::sqrt(std::max(0.0, h0 * h0 + h1 * h1 - 2 * c * h0 * h1) / squared_sine);
        else if (c < -0.999999)
            most = kUnbounded;
        if (most > least) edges.push_back(e);
    }
}

struct EdgeAxis {
    double separation = -kUnbounded;
    std::array<uint32_t, 2> edge{};
    Vec3d normal = Vec3d::Zero();  // from a to b
};

// The pair of edges with the largest separation above `least`. False if one separates by more than the margin. Hulls that are apart may
// be separated by no faces and only by edges that cross beside each other.
bool find_edge_axis(const HullSide& a, const HullSide& b, double margin, double least, EdgeAxis& best) {
    best.separation = least;
    const double slack = 1e-12 * (a.hull.radius + b.hull.radius);
    for (const uint32_t i : a.at.edge) {
        const auto [a0, a1] = a.hull.edge[i].ends;
        const Vec3d &p = a.at.point[a0], u = a.at.point[a1] - p;
        for (const uint32_t k : b.at.edge) {
            const auto [b0, b1] = b.hull.edge[k].ends;
            const Vec3d &q = b.at.point[b0], v = b.at.point[b1] - q;
            Vec3d normal = u.cross(v);
            const double size2 = normal.squaredNorm();
            if (!(size2 > kParallel2 * u.squaredNorm() * v.squaredNorm())) continue;
            if (normal.dot(p - a.centre) < 0) normal = -normal;
            normal /= std::sqrt(size2);
            const double apart = normal.dot(q - p);
            if (!(apart > best.separation)) continue;
            uint32_t support;
            const double separation = least_along(b.at, normal, support) + least_along(a.at, -normal, support);
            if (separation > margin) return false;
            if (!(separation > best.separation) || separation < apart - slack) continue;  // or other points are nearer
            best = {separation, {i, k}, normal};
        }
    }
    return true;
}

// The face around a point that faces most against a direction.
uint32_t incident_face(const HullSide& side, uint32_t point, const Vec3d& direction) {
    uint32_t best = side.hull.around[side.hull.around_first[point]];
    for (uint32_t k = side.hull.around_first[point]; k < side.hull.around_first[point + 1]; ++k)
        if (const uint32_t f = side.hull.around[k]; side.at.normal[f].dot(direction) < side.at.normal[best].dot(direction)) best = f;
    return best;
}

uint32_t corner_of(const ConvexHull& hull, uint32_t face, uint32_t k) {
    const Range corners = hull.face[face].corners;
    return hull.corner[corners.first + k % corners.count];
}

// Cuts the incident face off at the sides of the reference face. New corners are named by the features that cross.
void clip_face(const HullSide& reference, uint32_t face, const HullSide& incident, uint32_t incident_face, HullContactScratch& scratch) {
    using Corner = HullContactScratch::Corner;
    auto &polygon = scratch.polygon, &clipped = scratch.clipped;
    const uint32_t own = incident.hull.face[incident_face].corners.count, sides = reference.hull.face[face].corners.count;
    polygon.clear();
    for (uint32_t k = 0; k < own; ++k) {
        const uint32_t p = corner_of(incident.hull, incident_face, k);
        polygon.push_back({incident.at.point[p], {p, p}, 0, false, k});
    }
    const double beside = kBeside * std::min(reference.hull.radius, incident.hull.radius);
    for (uint32_t side = 0; side < sides && !polygon.empty(); ++side) {
        const Vec3d& from = reference.at.point[corner_of(reference.hull, face, side)];
        const Vec3d outward =
            (reference.at.point[corner_of(reference.hull, face, side + 1)] - from).cross(reference.at.normal[face]).normalized();
        clipped.clear();
        for (size_t i = 0; i < polygon.size(); ++i) {
            const Corner &start = polygon[i], &end = polygon[(i + 1) % polygon.size()];
            const double d0 = outward.dot(start.point - from), d1 = outward.dot(end.point - from);
            const bool in0 = d0 <= beside, in1 = d1 <= beside;
            if (in0) clipped.push_back(start);
            if (in0 == in1) continue;
            Corner cut;
            cut.point = start.point + std::clamp(d0 / (d0 - d1), 0.0, 1.0) * (end.point - start.point);
            cut.leaves = in0 ? own + side : start.leaves;
            if (start.leaves < own) {
                cut.ends = {corner_of(incident.hull, incident_face, start.leaves),
                            corner_of(incident.hull, incident_face, start.leaves + 1)};
                if (cut.ends[0] > cut.ends[1]) std::swap(cut.ends[0], cut.ends[1]);
                const Vec3d &e0 = incident.at.point[cut.ends[0]], edge = incident.at.point[cut.ends[1]] - e0;
                cut.along = std::clamp(edge.dot(cut.point - e0) / edge.squaredNorm(), 0.0, 1.0);
                cut.point = e0 + cut.along * edge;
            } else {
                const uint32_t before = start.leaves - own;
                const uint32_t corner = corner_of(reference.hull, face,
                                                  (before + 1) % sides == side   ? side
                                                  : (side + 1) % sides == before ? before
                                                                                 : side);
                cut.ends = {corner, corner};
                cut.of_reference = true;
            }
            clipped.push_back(cut);
        }
        std::swap(polygon, clipped);
    }
}

// Of many contacts the deepest, the farthest from it and, on either side of the line through both, the ones that span most area.
uint32_t choose_four(const Vec3d& normal, std::vector<HullContact>& found) {
    if (found.size() <= 4) return uint32_t(found.size());
    const auto take = [&](size_t place, const auto& value) {
        size_t best = place;
        for (size_t i = place + 1; i < found.size(); ++i)
            if (value(found[i]) > value(found[best])) best = i;
        std::swap(found[place], found[best]);
    };
    take(0, [](const HullContact& c) { return -c.distance; });
    const Vec3d first = found[0].point;
    take(1, [&](const HullContact& c) { return (c.point - first).squaredNorm(); });
    const Vec3d across = normal.cross(found[1].point - first);
    take(2, [&](const HullContact& c) { return std::abs(across.dot(c.point - first)); });
    const double side = across.dot(found[2].point - first) < 0 ? 1 : -1;
    take(3, [&](const HullContact& c) { return side * across.dot(c.point - first); });
    return 4;
}

Vec3d closest_on_segment(const Vec3d& p, const Vec3d& a, const Vec3d& b) {
    const Vec3d edge = b - a;
    return a + std::clamp(edge.dot(p - a) / edge.squaredNorm(), 0.0, 1.0) * edge;
}

// The contact of hulls whose facing faces lie side by side: the incident hull's nearest point against the plane through the nearest
// point of the reference face, perpendicular to the line between both, if it separates the hulls by no less; else against the face's own
// plane.
HullContact beside_face(const HullSide& reference, const FaceAxis& axis, const HullSide& incident, bool of_b, double preferred) {
    HullContact contact{
        of_b, {axis.support, axis.support}, 0, incident.at.point[axis.support], reference.at.normal[axis.face], axis.separation, axis.face};
    if (!(axis.separation > 0)) return contact;
    Vec3d closest = contact.point - axis.separation * contact.normal;
    double nearest2 = kUnbounded;
    bool over = true;
    const uint32_t sides = reference.hull.face[axis.face].corners.count;
    Vec3d on_rim = closest;
    for (uint32_t k = 0; k < sides; ++k) {
        const Vec3d &c0 = reference.at.point[corner_of(reference.hull, axis.face, k)],
                    &c1 = reference.at.point[corner_of(reference.hull, axis.face, k + 1)];
        over &= (c1 - c0).cross(contact.normal).dot(closest - c0) <= 0;
        const Vec3d q = closest_on_segment(contact.point, c0, c1);
        if ((q - contact.point).squaredNorm() < nearest2) nearest2 = (q - contact.point).squaredNorm(), on_rim = q;
    }
    if (over) return contact;
    const double distance = std::sqrt(nearest2);
    const Vec3d normal = (contact.point - on_rim) / distance;
    uint32_t support;
    const double separation = least_along(incident.at, normal, support) + least_along(reference.at, -normal, support);
    if (separation >= axis.separation - preferred && separation >= distance - preferred)
        contact.normal = normal, contact.distance = distance;
    return contact;
}

// Appends the contacts over a face: of the face that lies against it. All that are inside are inside the other hull.
void add_face_contacts(const HullSide& reference, const FaceAxis& axis, const HullSide& incident, bool of_b, double margin,
                       HullContactScratch& scratch) {
    std::vector<HullContact>& found = scratch.found;
    const Vec3d& normal = reference.at.normal[axis.face];
    const double offset = reference.at.offset[axis.face];
    const uint32_t face = incident_face(incident, axis.support, normal);
    clip_face(reference, axis.face, incident, face, scratch);
    for (const HullContactScratch::Corner& corner : scratch.polygon) {
        if (corner.of_reference) {
            const Vec3d& against = incident.at.normal[face];
            if (!(against.dot(normal) < kOpposite)) continue;
            const Vec3d& p = reference.at.point[corner.ends[0]];
            found.push_back({!of_b, corner.ends, 0, p, against, against.dot(p) - incident.at.offset[face], face});
        } else {
            found.push_back({of_b, corner.ends, corner.along, corner.point, normal, normal.dot(corner.point) - offset, axis.face});
        }
        if (!(found.back().distance < margin)) found.pop_back();
    }
}

void find_face_contacts(const HullSide& reference, const FaceAxis& axis, const HullSide& incident, bool of_b, double margin,
                        double preferred, HullContactScratch& scratch, HullManifold& manifold) {
    std::vector<HullContact>& found = scratch.found;
    const Vec3d& normal = reference.at.normal[axis.face];
    found.clear();
    add_face_contacts(reference, axis, incident, of_b, margin, scratch);
    if (found.empty()) {
        const HullContact beside = beside_face(reference, axis, incident, of_b, preferred);
        if (beside.distance < margin) found.push_back(beside);
    }
    manifold.count = choose_four(normal, found);
    std::copy_n(found.begin(), manifold.count, manifold.contact.begin());
    manifold.separation = axis.separation;
    manifold.direction = of_b ? normal : Vec3d(-normal);
}

// Shares of two segments, p + s u and q + t v, at which they are nearest to each other.
std::array<double, 2> nearest_of_segments(const Vec3d& p, const Vec3d& u, const Vec3d& q, const Vec3d& v) {
    const Vec3d gap = p - q;
    const double uu = u.squaredNorm(), vv = v.squaredNorm(), uv = u.dot(v), ug = u.dot(gap), vg = v.dot(gap);
    const double s = std::clamp((uv * vg - vv * ug) / (uu * vv - uv * uv), 0.0, 1.0);
    const double t = std::clamp((uv * s + vg) / vv, 0.0, 1.0);
    return {std::clamp((uv * t - ug) / uu, 0.0, 1.0), t};
}

// The contact of hulls that two edges separate best. Edges that are apart may cross beside their ends: then it is that of the points
// nearest to each other, if the plane between them separates the hulls by no less.
void find_edge_contact(const HullSide& a, const HullSide& b, const EdgeAxis& axis, double preferred, HullManifold& manifold) {
    const HullEdge &edge = a.hull.edge[axis.edge[0]], &across = b.hull.edge[axis.edge[1]];
    const Vec3d &p = a.at.point[edge.ends[0]], u = a.at.point[edge.ends[1]] - p;
    const Vec3d &q = b.at.point[across.ends[0]], v = b.at.point[across.ends[1]] - q;
    const auto [s, t] = nearest_of_segments(p, u, q, v);
    HullContact& contact = manifold.contact[0];
    contact = {false, edge.ends, s, p + s * u, -axis.normal, axis.separation, across.faces[0]};
    manifold.count = 1;
    manifold.separation = axis.separation;
    manifold.direction = axis.normal;
    if (!(axis.separation > 0)) return;
    const Vec3d gap = contact.point - (q + t * v);
    const double distance = gap.norm();
    const Vec3d normal = gap / distance;
    uint32_t support;
    const double separation = least_along(b.at, -normal, support) + least_along(a.at, normal, support);
    if (separation >= axis.separation - preferred && separation >= distance - preferred)
        contact.normal = normal, contact.distance = distance;
}

// Where hulls lie almost flat on each other, the contact of two edges at the rim alone would let them turn into each other: the contacts
// over the face join it, those no deeper.
void widen_edge_contact(const HullSide& reference, const FaceAxis& axis, const HullSide& incident, bool of_b, double margin,
                        HullContactScratch& scratch, HullManifold& manifold) {
    const Vec3d& normal = reference.at.normal[axis.face];
    if (!(std::abs(normal.dot(manifold.direction)) > -kOpposite)) return;
    std::vector<HullContact>& found = scratch.found;
    found.assign(1, manifold.contact[0]);
    add_face_contacts(reference, axis, incident, of_b, margin, scratch);
    std::erase_if(found, [&](const HullContact& c) { return c.distance < manifold.contact[0].distance; });
    manifold.count = choose_four(normal, found);
    std::copy_n(found.begin(), manifold.count, manifold.contact.begin());
}

}  // namespace

void find_hull_contacts(const ConvexHull& a, const ConvexHull& b, const Quat& turn, const Vec3d& shift, double margin, double preferred,
                        HullContactScratch& scratch, HullManifold& manifold) {
    manifold.count = 0;
    manifold.separation = kUnbounded;
    constexpr size_t kRoom = 64;  // a warm pass allocates nothing: more than the corners of most faces together
    scratch.polygon.reserve(kRoom), scratch.clipped.reserve(kRoom), scratch.found.reserve(kRoom);
    scratch.a.edge.reserve(a.edge.size()), scratch.b.edge.reserve(b.edge.size());
    place_first(a, scratch.a);
    place_second(b, turn, shift, scratch.b);
    const HullSide first{a, scratch.a, a.centre}, second{b, scratch.b, rotate(turn, b.centre) + shift};
    FaceAxis of_a, of_b;
    if (!find_face_axis(first, second, margin, of_a) || !find_face_axis(second, first, margin, of_b)) return;
    const bool on_b = of_b.separation > of_a.separation + preferred;
    const double by_faces = std::max(of_a.separation, of_b.separation);
    find_open_edges(first, scratch.b.point[on_b ? corner_of(b, of_b.face, 0) : of_a.support], by_faces + preferred, scratch.a.edge);
    find_open_edges(second, scratch.a.point[on_b ? of_b.support : corner_of(a, of_a.face, 0)], by_faces + preferred, scratch.b.edge);
    EdgeAxis of_edges;
    if (!find_edge_axis(first, second, margin, by_faces + preferred, of_edges)) return;
    if (of_edges.separation > by_faces + preferred) {
        find_edge_contact(first, second, of_edges, preferred, manifold);
        if (on_b)
            widen_edge_contact(second, of_b, first, false, margin, scratch, manifold);
        else
            widen_edge_contact(first, of_a, second, true, margin, scratch, manifold);
    } else if (on_b) {
        find_face_contacts(second, of_b, first, false, margin, preferred, scratch, manifold);
    } else {
        find_face_contacts(first, of_a, second, true, margin, preferred, scratch, manifold);
    }
}

}  // namespace trocar
