#include "systems/implied_rows.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

#include "engine/contact_rows.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/parallel.hpp"
namespace trocar {
namespace {

constexpr double kOneNormal = 1e-3;                   // rad
constexpr double kSameHeight = 1e-5, kBeside = 1e-4;  // of the extent
constexpr uint32_t kPairsPerChunk = 32;
// Of a pair that are looked at: curved surfaces have one a row, and imply nothing.
constexpr uint32_t kMostNormals = 8;

using Places = std::vector<SharedPlaneRow>;

bool is_rigid_row(const Surfaces& s, const ContactRows& rows, uint32_t row) {
    return !is_deformable(s.bodies, rows.body[row]) && !is_deformable(s.bodies, rows.other[row]) && std::isfinite(rows.distance[row]);
}

std::pair<uint32_t, uint32_t> pair_of(const ContactRows& rows, uint32_t row) { return std::minmax(rows.body[row], rows.other[row]); }

// From the pair's second body to its first, whichever the row's point is of.
Vec3d normal_of(const Surfaces& s, const ContactRows& rows, uint32_t row) {
    const Vec3d normal = rotate(s.poses.orientation[rows.other[row]], rows.normal[row]);
    return rows.body[row] < rows.other[row] ? normal : Vec3d(-normal);
}

Vec3d point_of(const Surfaces& s, const ContactRows& rows, uint32_t row) {
    const uint32_t body = rows.body[row];
    const auto [v, w] = rows.vertex[row];
    const double along = rows.along[row], across = rows.third[row] == kNone ? 0.0 : rows.across[row];
    Vec3d point = vertex_position(s, body, v);
    const Vec3d start = point;
    if (along != 0) point += along * (vertex_position(s, body, w) - start);
    if (across != 0) point += across * (vertex_position(s, body, rows.third[row]) - start);
    return point;
}

// Moves the rows that share the first one's normal from `left` to `places`, seen along it.
void take_one_normal(const Surfaces& s, const ContactRows& rows, std::vector<uint32_t>& left, Places& places) {
    const Vec3d normal = normal_of(s, rows, left.front()), origin = point_of(s, rows, left.front());
    const Vec3d u = normal.unitOrthogonal(), v = normal.cross(u);
    places.clear();
    std::erase_if(left, [&](uint32_t row) {
        if ((normal_of(s, rows, row) - normal).norm() > kOneNormal) return false;
        const Vec3d way = point_of(s, rows, row) - origin;
        places.push_back({row, u.dot(way), v.dot(way), rows.distance[row]});
        return true;
    });
}

double extent_of(const Places& places, double least) {
    double low_x = 0, low_y = 0, high_x = 0, high_y = 0;  // the first lies at the origin
    for (const SharedPlaneRow& p : places) {
        low_x = std::min(low_x, p.x), high_x = std::max(high_x, p.x);
        low_y = std::min(low_y, p.y), high_y = std::max(high_y, p.y);
    }
    return std::max({high_x - low_x, high_y - low_y, least});
}

double cross(const SharedPlaneRow& a, const SharedPlaneRow& b, double x, double y) {
    return (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x);
}

// Tilts the plane that lies under all places about the line through `about` along (-to_y, to_x) until it meets another place on
// the side of (to_x, to_y), and returns that one; kNone if there is none on that side.
uint32_t tilt(Places& places, const SharedPlaneRow& about, double to_x, double to_y, double least) {
    uint32_t met = kNone;
    double slope = std::numeric_limits<double>::infinity();
    const auto side = [&](const SharedPlaneRow& p) { return to_x * (p.x - about.x) + to_y * (p.y - about.y); };
    for (uint32_t i = 0; i < places.size(); ++i) {
        const double away = side(places[i]);
        if (away > least && places[i].above < slope * away) slope = std::max(0.0, places[i].above) / away, met = i;
    }
    if (met == kNone) return kNone;
    const SharedPlaneRow axis = about;
    for (SharedPlaneRow& p : places) p.above -= slope * (to_x * (p.x - axis.x) + to_y * (p.y - axis.y));
    return met;
}

// Subtracts from the distances a plane under all of them that touches the lower hull below their middle: the linear program of
// three unknowns, by pivots.
void subtract_support(double extent, Places& places) {
    uint32_t a = 0;
    double x = 0, y = 0;
    for (uint32_t i = 0; i < places.size(); ++i) {
        if (places[i].above < places[a].above) a = i;
        x += places[i].x / static_cast<double>(places.size()), y += places[i].y / static_cast<double>(places.size());
    }
    const double lowest = places[a].above, least = kBeside * extent;
    for (SharedPlaneRow& p : places) p.above -= lowest;
    const double length = std::hypot(x - places[a].x, y - places[a].y);
    uint32_t b = length > least ? tilt(places, places[a], (x - places[a].x) / length, (y - places[a].y) / length, least) : kNone;
    if (b == kNone) b = tilt(places, places[a], 1, 0, least);
    if (b == kNone) b = tilt(places, places[a], -1, 0, least);
    if (b == kNone) return;
    constexpr int kMostPivots = 32;
    for (int pivot = 0; pivot < kMostPivots; ++pivot) {
        const double along_x = places[b].x - places[a].x, along_y = places[b].y - places[a].y, edge = std::hypot(along_x, along_y);
        const double sign = cross(places[a], places[b], x, y) >= 0 ? 1 : -1;
        uint32_t c = tilt(places, places[a], -sign * along_y / edge, sign * along_x / edge, least);
        if (c == kNone && pivot == 0) c = tilt(places, places[a], sign * along_y / edge, -sign * along_x / edge, least);
        if (c == kNone) return;
        // the middle lies beyond one of the new edges, or over the triangle
        const double turn = cross(places[a], places[b], places[c].x, places[c].y) >= 0 ? 1 : -1;
        if (turn * cross(places[b], places[c], x, y) < 0)
            a = c;
        else if (turn * cross(places[c], places[a], x, y) < 0)
            b = c;
        else
            return;
    }
}

// The places on the supporting plane. Where several lie together the first row stands for them, so that it stays the one that
// remembers its impulse.
void find_patch(const Places& places, double same_height, double beside, std::vector<uint32_t>& patch) {
    constexpr uint32_t kMostCompared = 128;
    patch.clear();
    for (uint32_t i = 0; i < places.size(); ++i) {
        const SharedPlaneRow& p = places[i];
        const auto is_here = [&](uint32_t k) { return std::hypot(places[k].x - p.x, places[k].y - p.y) <= beside; };
        if (p.above > same_height || (patch.size() < kMostCompared && std::ranges::any_of(patch, is_here))) continue;
        patch.push_back(i);
    }
}

// Corners of the convex hull of the patch, counter-clockwise (Andrew's monotone chain); what lies within `beside` of an edge is
// none.
void find_hull(const Places& places, double beside, std::vector<uint32_t>& patch, std::vector<uint32_t>& hull) {
    std::ranges::sort(patch, [&](uint32_t i, uint32_t k) {
        return std::tuple(places[i].x, places[i].y, places[i].row) < std::tuple(places[k].x, places[k].y, places[k].row);
    });
    hull.clear();
    if (patch.size() == 1) hull.push_back(patch.front());
    if (patch.size() < 2) return;
    const auto add_chain = [&](auto begin, auto end) {
        const size_t first = hull.size();
        for (auto it = begin; it != end; ++it) {
            const SharedPlaneRow& next = places[*it];
            while (hull.size() > first + 1) {
                const SharedPlaneRow &a = places[hull[hull.size() - 2]], &b = places[hull.back()];
                if (cross(a, b, next.x, next.y) > beside * std::hypot(next.x - a.x, next.y - a.y)) break;
                hull.pop_back();
            }
            hull.push_back(*it);
        }
        if (hull.size() > first + 1) hull.pop_back();  // begins the other chain
    };
    add_chain(patch.begin(), patch.end());
    add_chain(patch.rbegin(), patch.rend());
}

// Whether a place lies inside the hull, or within `beside` of it.
bool is_inside(const Places& places, const std::vector<uint32_t>& hull, double beside, const SharedPlaneRow& p) {
    for (size_t k = 0; k < hull.size(); ++k) {
        const SharedPlaneRow &a = places[hull[k]], &b = places[hull[(k + 1) % hull.size()]];
        const double length = std::hypot(b.x - a.x, b.y - a.y);
        if (length == 0 ? std::hypot(p.x - a.x, p.y - a.y) > beside : cross(a, b, p.x, p.y) < -beside * length) return false;
    }
    if (hull.size() != 2) return true;
    const SharedPlaneRow &a = places[hull[0]], &b = places[hull[1]];
    const double length2 = (b.x - a.x) * (b.x - a.x) + (b.y - a.y) * (b.y - a.y);
    const double way = ((p.x - a.x) * (b.x - a.x) + (p.y - a.y) * (b.y - a.y)) / std::max(length2, 1e-300);
    const double slack = beside / std::sqrt(std::max(length2, 1e-300));
    return way >= -slack && way <= 1 + slack;
}

void mark_pair(const Surfaces& s, const ContactRows& rows, std::span<const uint32_t> of_pair, ImpliedRowsScratch::Chunk& chunk,
               std::vector<uint8_t>& dropped) {
    constexpr double kPoint = 0.01;  // of the smaller body: places that lie so near each other are as good as one
    const auto radius = [&](uint32_t body) { return s.meshes.info[s.bodies.mesh[body]].radius; };
    const double least = kPoint * std::min(radius(rows.body[of_pair.front()]), radius(rows.other[of_pair.front()]));
    chunk.left.assign(of_pair.begin(), of_pair.end());
    for (uint32_t normals = 0; normals < kMostNormals && !chunk.left.empty(); ++normals) {
        take_one_normal(s, rows, chunk.left, chunk.rows);
        Places& places = chunk.rows;
        if (places.size() < 2) continue;
        const double extent = extent_of(places, least), beside = kBeside * extent;
        subtract_support(extent, places);
        find_patch(places, kSameHeight * extent, beside, chunk.patch);
        find_hull(places, beside, chunk.patch, chunk.hull);
        for (const SharedPlaneRow& p : places) dropped[p.row] = is_inside(places, chunk.hull, beside, p);
        for (const uint32_t corner : chunk.hull) dropped[places[corner].row] = 0;
    }
}

void find_pairs(const Surfaces& s, const ContactRows& rows, ImpliedRowsScratch& scratch) {
    scratch.row.clear();
    scratch.pair.clear();
    for (uint32_t row = 0; row < rows.body.size(); ++row)
        if (is_rigid_row(s, rows, row)) scratch.row.push_back(row);
    std::ranges::sort(scratch.row, {}, [&](uint32_t row) { return std::pair(pair_of(rows, row), row); });
    for (uint32_t first = 0, end = 0; first < scratch.row.size(); first = end) {
        for (end = first; end < scratch.row.size() && pair_of(rows, scratch.row[end]) == pair_of(rows, scratch.row[first]);) ++end;
        if (end > first + 1) scratch.pair.push_back({first, end - first});
    }
}

}  // namespace

void drop_implied_rows(const Surfaces& surfaces, ImpliedRowsScratch& scratch, ContactRows& rows) {
    find_pairs(surfaces, rows, scratch);
    if (scratch.pair.empty()) return;
    const uint32_t pairs = static_cast<uint32_t>(scratch.pair.size());
    scratch.dropped.assign(rows.body.size(), 0);
    if (const size_t chunks = (pairs + kPairsPerChunk - 1) / kPairsPerChunk; scratch.chunk.size() < chunks) scratch.chunk.resize(chunks);
    parallel_for(pairs, kPairsPerChunk, [&](uint32_t begin, uint32_t end) {
        ImpliedRowsScratch::Chunk& chunk = scratch.chunk[begin / kPairsPerChunk];
        for (uint32_t i = begin; i < end; ++i) {
            const Range range = scratch.pair[i];
            mark_pair(surfaces, rows, std::span(scratch.row).subspan(range.first, range.count), chunk, scratch.dropped);
        }
    });
    take_out_rows(scratch.dropped, rows);
}

}  // namespace trocar
