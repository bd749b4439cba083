#include "systems/constrain/redundant_constraints.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

#include "engine/contact/contact_constraints.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/jobs/parallel.hpp"
namespace trocar {
namespace {

constexpr double kOneNormal = 1e-3;                            // rad
constexpr double kSameHeight = 1e-5, kInsideTolerance = 1e-4;  // of the extent
constexpr uint32_t kPairsPerChunk = 32;
// Normals examined per pair: on curved surfaces every constraint has its own, and none is redundant.
constexpr uint32_t kMostNormals = 8;

using Points = std::vector<CoplanarConstraint>;

bool is_rigid(const Surfaces& s, const ContactConstraints& constraints, uint32_t constraint) {
    return !is_deformable(s.bodies, constraints.body[constraint]) && !is_deformable(s.bodies, constraints.other[constraint]) &&
           std::isfinite(constraints.distance[constraint]) &&
           constraints.triangle[constraint][1] != constraints.triangle[constraint][2];  // of hulls: few already
}

std::pair<uint32_t, uint32_t> pair_of(const ContactConstraints& constraints, uint32_t constraint) {
    return std::minmax(constraints.body[constraint], constraints.other[constraint]);
}

// From the pair's second body to its first, for a point of either.
Vec3d normal_of(const Surfaces& s, const ContactConstraints& constraints, uint32_t constraint) {
    const Vec3d normal = rotate(s.poses.orientation[constraints.other[constraint]], constraints.normal[constraint]);
    return constraints.body[constraint] < constraints.other[constraint] ? normal : Vec3d(-normal);
}

Vec3d point_of(const Surfaces& s, const ContactConstraints& constraints, uint32_t constraint) {
    const uint32_t body = constraints.body[constraint];
    const auto [v, w] = constraints.vertex[constraint];
    const double along = constraints.along[constraint],
                 across = constraints.third[constraint] == kNone ? 0.0 : constraints.across[constraint];
    Vec3d point = vertex_position(s, body, v);
    const Vec3d start = point;
    if (along != 0) point += along * (vertex_position(s, body, w) - start);
    if (across != 0) point += across * (vertex_position(s, body, constraints.third[constraint]) - start);
    return point;
}

// Moves the constraints with the first one's normal from `left` to `points`, projected along it.
void take_one_normal(const Surfaces& s, const ContactConstraints& constraints, std::vector<uint32_t>& left, Points& points) {
    const Vec3d normal = normal_of(s, constraints, left.front()), origin = point_of(s, constraints, left.front());
    const Vec3d u = normal.unitOrthogonal(), v = normal.cross(u);
    points.clear();
    std::erase_if(left, [&](uint32_t constraint) {
        if ((normal_of(s, constraints, constraint) - normal).norm() > kOneNormal) return false;
        const Vec3d offset = point_of(s, constraints, constraint) - origin;
        points.push_back({constraint, u.dot(offset), v.dot(offset), constraints.distance[constraint]});
        return true;
    });
}

double extent_of(const Points& points, double least) {
    double low_x = 0, low_y = 0, high_x = 0, high_y = 0;  // the first is at the origin
    for (const CoplanarConstraint& p : points) {
        low_x = std::min(low_x, p.x), high_x = std::max(high_x, p.x);
        low_y = std::min(low_y, p.y), high_y = std::max(high_y, p.y);
    }
    return std::max({high_x - low_x, high_y - low_y, least});
}

double cross(const CoplanarConstraint& a, const CoplanarConstraint& b, double x, double y) {
    return (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x);
}

// Tilts the plane below all points about the line through `about` along (-to_y, to_x) until it meets another
// point on the side of (to_x, to_y); returns that point, or kNone if that side is empty.
uint32_t tilt(Points& points, const CoplanarConstraint& about, double to_x, double to_y, double least) {
    uint32_t met = kNone;
    double slope = std::numeric_limits<double>::infinity();
    const auto side = [&](const CoplanarConstraint& p) { return to_x * (p.x - about.x) + to_y * (p.y - about.y); };
    for (uint32_t i = 0; i < points.size(); ++i) {
        const double away = side(points[i]);
        if (away > least && points[i].above < slope * away) slope = std::max(0.0, points[i].above) / away, met = i;
    }
    if (met == kNone) return kNone;
    const CoplanarConstraint axis = about;
    for (CoplanarConstraint& p : points) p.above -= slope * (to_x * (p.x - axis.x) + to_y * (p.y - axis.y));
    return met;
}

// Subtracts from the distances a plane below all of them that touches the lower hull below their mean: a
// linear program in three unknowns, by pivots.
void subtract_support(double extent, Points& points) {
    uint32_t a = 0;
    double x = 0, y = 0;
    for (uint32_t i = 0; i < points.size(); ++i) {
        if (points[i].above < points[a].above) a = i;
        x += points[i].x / static_cast<double>(points.size()), y += points[i].y / static_cast<double>(points.size());
    }
    const double lowest = points[a].above, least = kInsideTolerance * extent;
    for (CoplanarConstraint& p : points) p.above -= lowest;
    const double length = std::hypot(x - points[a].x, y - points[a].y);
    uint32_t b = length > least ? tilt(points, points[a], (x - points[a].x) / length, (y - points[a].y) / length, least) : kNone;
    if (b == kNone) b = tilt(points, points[a], 1, 0, least);
    if (b == kNone) b = tilt(points, points[a], -1, 0, least);
    if (b == kNone) return;
    constexpr int kMostPivots = 32;
    for (int pivot = 0; pivot < kMostPivots; ++pivot) {
        const double along_x = points[b].x - points[a].x, along_y = points[b].y - points[a].y, edge = std::hypot(along_x, along_y);
        const double sign = cross(points[a], points[b], x, y) >= 0 ? 1 : -1;
        uint32_t c = tilt(points, points[a], -sign * along_y / edge, sign * along_x / edge, least);
        if (c == kNone && pivot == 0) c = tilt(points, points[a], sign * along_y / edge, -sign * along_x / edge, least);
        if (c == kNone) return;
        // the mean lies beyond one of the new edges, or over the triangle
        const double turn = cross(points[a], points[b], points[c].x, points[c].y) >= 0 ? 1 : -1;
        if (turn * cross(points[b], points[c], x, y) < 0)
            a = c;
        else if (turn * cross(points[c], points[a], x, y) < 0)
            b = c;
        else
            return;
    }
}

// Points on the supporting plane. Of coinciding points the first is taken, so that the same one keeps its
// warm-start impulse.
void find_patch(const Points& points, double same_height, double beside, std::vector<uint32_t>& patch) {
    constexpr uint32_t kMostCompared = 128;
    patch.clear();
    for (uint32_t i = 0; i < points.size(); ++i) {
        const CoplanarConstraint& p = points[i];
        const auto is_here = [&](uint32_t k) { return std::hypot(points[k].x - p.x, points[k].y - p.y) <= beside; };
        if (p.above > same_height || (patch.size() < kMostCompared && std::ranges::any_of(patch, is_here))) continue;
        patch.push_back(i);
    }
}

// Corners of the convex hull of the patch, counter-clockwise (Andrew's monotone chain), without points within
// `beside` of an edge.
void find_hull(const Points& points, double beside, std::vector<uint32_t>& patch, std::vector<uint32_t>& hull) {
    std::ranges::sort(patch, [&](uint32_t i, uint32_t k) {
        return std::tuple(points[i].x, points[i].y, points[i].constraint) < std::tuple(points[k].x, points[k].y, points[k].constraint);
    });
    hull.clear();
    if (patch.size() == 1) hull.push_back(patch.front());
    if (patch.size() < 2) return;
    const auto add_chain = [&](auto begin, auto end) {
        const size_t first = hull.size();
        for (auto it = begin; it != end; ++it) {
            const CoplanarConstraint& next = points[*it];
            while (hull.size() > first + 1) {
                const CoplanarConstraint &a = points[hull[hull.size() - 2]], &b = points[hull.back()];
                if (cross(a, b, next.x, next.y) > beside * std::hypot(next.x - a.x, next.y - a.y)) break;
                hull.pop_back();
            }
            hull.push_back(*it);
        }
        if (hull.size() > first + 1) hull.pop_back();  // starts the other chain
    };
    add_chain(patch.begin(), patch.end());
    add_chain(patch.rbegin(), patch.rend());
}

// Whether a point lies inside the hull, or within `beside` of it.
bool is_inside(const Points& points, const std::vector<uint32_t>& hull, double beside, const CoplanarConstraint& p) {
    for (size_t k = 0; k < hull.size(); ++k) {
        const CoplanarConstraint &a = points[hull[k]], &b = points[hull[(k + 1) % hull.size()]];
        const double length = std::hypot(b.x - a.x, b.y - a.y);
        if (length == 0 ? std::hypot(p.x - a.x, p.y - a.y) > beside : cross(a, b, p.x, p.y) < -beside * length) return false;
    }
    if (hull.size() != 2) return true;
    const CoplanarConstraint &a = points[hull[0]], &b = points[hull[1]];
    const double length2 = (b.x - a.x) * (b.x - a.x) + (b.y - a.y) * (b.y - a.y);
    const double part = ((p.x - a.x) * (b.x - a.x) + (p.y - a.y) * (b.y - a.y)) / std::max(length2, 1e-300);
    const double slack = beside / std::sqrt(std::max(length2, 1e-300));
    return part >= -slack && part <= 1 + slack;
}

void mark_pair(const Surfaces& s, const ContactConstraints& constraints, std::span<const uint32_t> of_pair,
               RedundantConstraintsScratch::Chunk& chunk, std::vector<uint8_t>& dropped) {
    constexpr double kPoint = 0.01;  // of the smaller body: points this close together count as one
    const auto radius = [&](uint32_t body) { return s.meshes.info[s.bodies.mesh[body]].radius; };
    const double least = kPoint * std::min(radius(constraints.body[of_pair.front()]), radius(constraints.other[of_pair.front()]));
    chunk.left.assign(of_pair.begin(), of_pair.end());
    for (uint32_t normals = 0; normals < kMostNormals && !chunk.left.empty(); ++normals) {
        take_one_normal(s, constraints, chunk.left, chunk.coplanar);
        Points& points = chunk.coplanar;
        if (points.size() < 2) continue;
        const double extent = extent_of(points, least), beside = kInsideTolerance * extent;
        subtract_support(extent, points);
        find_patch(points, kSameHeight * extent, beside, chunk.patch);
        find_hull(points, beside, chunk.patch, chunk.hull);
        for (const CoplanarConstraint& p : points) dropped[p.constraint] = is_inside(points, chunk.hull, beside, p);
        for (const uint32_t corner : chunk.hull) dropped[points[corner].constraint] = 0;
    }
}

void find_pairs(const Surfaces& s, const ContactConstraints& constraints, RedundantConstraintsScratch& scratch) {
    scratch.of_rigid_pairs.clear();
    scratch.pair.clear();
    for (uint32_t constraint = 0; constraint < constraints.body.size(); ++constraint)
        if (is_rigid(s, constraints, constraint)) scratch.of_rigid_pairs.push_back(constraint);
    std::ranges::sort(scratch.of_rigid_pairs, {},
                      [&](uint32_t constraint) { return std::pair(pair_of(constraints, constraint), constraint); });
    for (uint32_t first = 0, end = 0; first < scratch.of_rigid_pairs.size(); first = end) {
        for (end = first; end < scratch.of_rigid_pairs.size() &&
                          pair_of(constraints, scratch.of_rigid_pairs[end]) == pair_of(constraints, scratch.of_rigid_pairs[first]);)
            ++end;
        if (end > first + 1) scratch.pair.push_back({first, end - first});
    }
}

}  // namespace

void drop_redundant_constraints(const Surfaces& surfaces, RedundantConstraintsScratch& scratch, ContactConstraints& constraints) {
    find_pairs(surfaces, constraints, scratch);
    if (scratch.pair.empty()) return;
    const uint32_t pairs = static_cast<uint32_t>(scratch.pair.size());
    scratch.dropped.assign(constraints.body.size(), 0);
    if (const size_t chunks = (pairs + kPairsPerChunk - 1) / kPairsPerChunk; scratch.chunk.size() < chunks) scratch.chunk.resize(chunks);
    parallel_for(pairs, kPairsPerChunk, [&](uint32_t begin, uint32_t end) {
        RedundantConstraintsScratch::Chunk& chunk = scratch.chunk[begin / kPairsPerChunk];
        for (uint32_t i = begin; i < end; ++i) {
            const Range range = scratch.pair[i];
            mark_pair(surfaces, constraints, std::span(scratch.of_rigid_pairs).subspan(range.first, range.count), chunk, scratch.dropped);
        }
    });
    remove_constraints(scratch.dropped, constraints);
}

}  // namespace trocar
