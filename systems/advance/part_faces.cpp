#include "systems/advance/part_faces.hpp"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>

namespace trocar {
namespace {

constexpr double kFixedMass = 1e9;    // of the greatest mass of the corners, of a fixed one: the plane stays at it
constexpr double kTouching = 1e-6;    // of an edge: overlap at the start that is rounding
constexpr uint32_t kPlaneSteps = 50;  // of bisection: to the rounding of doubles
constexpr double kTouchedAt = 4;      // clearances, below which sides touch
constexpr uint32_t kStopSweeps = 4;

// The corners of one side, before and after.
struct PartedSide {
    std::array<Vec3d, 3> start, end;
    uint32_t count = 0;
};

Vec3d start_of(const PartedSurface& s, uint32_t v) { return {s.start[v].x, s.start[v].y, s.start[v].z}; }

// The rotation that takes points nearest to others, about their centres (Kabsch 1976).
Eigen::Matrix3d best_turn(const PartedSide& a, const PartedSide& b) {
    Vec3d from = Vec3d::Zero(), to = Vec3d::Zero();
    for (const PartedSide* side : {&a, &b})
        for (uint32_t k = 0; k < side->count; ++k) from += side->start[k], to += side->end[k];
    const double count = a.count + b.count;
    from /= count, to /= count;
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (const PartedSide* side : {&a, &b})
        for (uint32_t k = 0; k < side->count; ++k) sum += (side->end[k] - to) * (side->start[k] - from).transpose();
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(sum, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Eigen::Matrix3d sign = Eigen::Matrix3d::Identity();
    if ((svd.matrixU() * svd.matrixV().transpose()).determinant() < 0) sign(2, 2) = -1;
    return svd.matrixU() * sign * svd.matrixV().transpose();
}

// Distance of the sides along a direction, m; negative where they overlap.
double gap_in(const Vec3d& normal, const std::array<Vec3d, 3>& a, uint32_t count_a, const std::array<Vec3d, 3>& b, uint32_t count_b) {
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (uint32_t k = 0; k < count_a; ++k) low = std::min(low, normal.dot(a[k]));
    for (uint32_t k = 0; k < count_b; ++k) high = std::max(high, normal.dot(b[k]));
    return low - high;
}

// Calls visit(direction) for all that may part the sides at the start, of any length.
template <typename Visit>
void each_direction(const PartedSide& a, const PartedSide& b, const Visit& visit) {
    struct Edges {
        std::array<Vec3d, 3> edge;
        uint32_t count = 0;
        Vec3d normal = Vec3d::Zero();
    };
    const auto edges_of = [](const PartedSide& s) {
        Edges e;
        if (s.count == 2) e.edge[e.count++] = s.start[1] - s.start[0];
        if (s.count != 3) return e;
        for (uint32_t k = 0; k < 3; ++k) e.edge[e.count++] = s.start[(k + 1) % 3] - s.start[k];
        e.normal = e.edge[0].cross(e.edge[1]);
        return e;
    };
    const Edges mine = edges_of(a), theirs = edges_of(b);
    for (const Edges* e : {&mine, &theirs}) {
        visit(e->normal);
        for (const Edges* other : {&mine, &theirs})
            for (uint32_t k = 0; k < e->count; ++k) visit(e->edge[k].cross(other->normal));
    }
    for (uint32_t i = 0; i < mine.count; ++i)
        for (uint32_t k = 0; k < theirs.count; ++k) visit(mine.edge[i].cross(theirs.edge[k]));
    for (uint32_t i = 0; i < a.count; ++i)
        for (uint32_t k = 0; k < b.count; ++k) visit(a.start[i] - b.start[k]);
}

// Parts the first vertices from the second if there are any of both.
void add_sides(const PartedSurface& s, const PartedCorners& corners, std::vector<PartedCorners>& parted) {
    if (corners.count[0] == 0 || corners.count[1] == 0) return;
    std::array<PartedSide, 2> side;
    double longest = 0;
    for (uint32_t i = 0, at = 0; i < 2; ++i) {
        side[i].count = corners.count[i];
        for (uint32_t k = 0; k < corners.count[i]; ++k, ++at)
            side[i].start[k] = start_of(s, corners.vertex[at]), side[i].end[k] = s.place[corners.vertex[at]];
        for (uint32_t k = 0; k < side[i].count; ++k) longest = std::max(longest, (side[i].start[k] - side[i].start[0]).norm());
    }
    const Eigen::Matrix3d turn = best_turn(side[0], side[1]);
    PartedCorners found = corners;
    double widest = -std::numeric_limits<double>::infinity();
    each_direction(side[0], side[1], [&](const Vec3d& direction) {
        const double length = direction.norm();
        if (!(length > 0) || !std::isfinite(length)) return;
        for (const double sign : {1 / length, -1 / length}) {
            const Vec3d normal = sign * direction, turned = turn * normal;
            if (gap_in(normal, side[0].start, side[0].count, side[1].start, side[1].count) < -kTouching * longest) continue;
            const double gap = gap_in(turned, side[0].end, side[0].count, side[1].end, side[1].count);
            if (gap > widest) widest = gap, found.normal = turned;
        }
    });
    if (std::isfinite(widest)) parted.push_back(found);
}

double mass_of_corner(const PartedSurface& s, const PartedCorners& c, uint32_t at) {
    const double w = s.start[c.vertex[at]].w;
    if (w > 0) return 1 / w;
    double most = 1e-12;
    for (uint32_t k = 0; k < c.count[0] + c.count[1]; ++k)
        if (const double other = s.start[c.vertex[k]].w; other > 0) most = std::max(most, 1 / other);
    return kFixedMass * most;
}

// Height of every corner along the normal, m.
std::array<double, 6> heights_of(const PartedSurface& s, const PartedCorners& c) {
    std::array<double, 6> height = {};
    for (uint32_t k = 0; k < c.count[0] + c.count[1]; ++k) height[k] = c.normal.dot(s.place[c.vertex[k]]);
    return height;
}
double gap_of(const PartedCorners& c, const std::array<double, 6>& height) {
    const auto first = height.begin() + c.count[0];
    return *std::min_element(height.begin(), first) - *std::max_element(first, first + c.count[1]);
}

// Returns by how much the sides lacked the clearance, m.
double part_sides(const PartedSurface& s, const PartedCorners& c) {
    const std::array<double, 6> height = heights_of(s, c);
    const double gap = gap_of(c, height), half = 0.5 * s.clearance;
    if (gap >= s.clearance) return 0;
    const auto [lowest, highest] = std::minmax_element(height.begin(), height.begin() + c.count[0] + c.count[1]);
    std::array<double, 6> mass = {};
    for (uint32_t k = 0; k < c.count[0] + c.count[1]; ++k) mass[k] = mass_of_corner(s, c, k);
    const auto shift = [&](uint32_t k, double plane) {
        return k < c.count[0] ? std::max(0.0, plane + half - height[k]) : std::min(0.0, plane - half - height[k]);
    };
    double low = *lowest - half, high = *highest + half;
    for (uint32_t step = 0; step < kPlaneSteps; ++step) {
        const double plane = 0.5 * (low + high);
        double moment = 0;
        for (uint32_t k = 0; k < c.count[0] + c.count[1]; ++k) moment += mass[k] * shift(k, plane);
        (moment < 0 ? low : high) = plane;
    }
    for (uint32_t k = 0; k < c.count[0] + c.count[1]; ++k)
        if (s.start[c.vertex[k]].w > 0) s.place[c.vertex[k]] += shift(k, 0.5 * (low + high)) * c.normal;
    return s.clearance - gap;
}

}  // namespace

void add_parted(const PartedSurface& s, const std::array<uint32_t, 2>& faces, std::vector<PartedCorners>& parted) {
    const Triangle &t = s.triangle[faces[0]], &u = s.triangle[faces[1]];
    const auto add = [&](const Triangle& mine, const Triangle& theirs) {
        PartedCorners c;
        for (const uint32_t v : mine)
            if (std::ranges::find(theirs, v) == theirs.end()) c.vertex[c.count[0]++] = v;
        for (const uint32_t v : theirs) c.vertex[c.count[0] + c.count[1]++] = v;
        add_sides(s, c, parted);
        return c.count[0];
    };
    if (add(t, u) < 3) add(u, t);
}

void part_corners(const PartedSurface& s, std::span<const PartedCorners> parted, uint32_t sweeps) {
    for (uint32_t sweep = 0; sweep < sweeps; ++sweep) {
        double worst = 0;
        for (const PartedCorners& c : parted) worst = std::max(worst, part_sides(s, c));
        if (worst < 0.1 * s.clearance) return;
    }
}

void stop_approach(const PartedSurface& s, std::span<const PartedCorners> parted, std::vector<Vec3d>& velocity) {
    for (uint32_t sweep = 0; sweep < kStopSweeps; ++sweep)
        for (const PartedCorners& c : parted) {
            const std::array<double, 6> height = heights_of(s, c);
            if (gap_of(c, height) > kTouchedAt * s.clearance) continue;
            const auto edge = height.begin() + c.count[0];
            const double near = *std::min_element(height.begin(), edge) + kTouchedAt * s.clearance,
                         far = *std::max_element(edge, edge + c.count[1]) - kTouchedAt * s.clearance;
            const auto touches = [&](uint32_t k) { return k < c.count[0] ? height[k] <= near : height[k] >= far; };
            std::array<double, 2> mass = {}, momentum = {};
            for (uint32_t k = 0; k < c.count[0] + c.count[1]; ++k) {
                if (!touches(k)) continue;
                const double m = mass_of_corner(s, c, k);
                const size_t side = k < c.count[0] ? 0 : 1;
                mass[side] += m, momentum[side] += m * c.normal.dot(velocity[c.vertex[k]]);
            }
            const std::array<double, 2> speed{momentum[0] / mass[0], momentum[1] / mass[1]};
            if (speed[0] >= speed[1]) continue;
            const double common = (momentum[0] + momentum[1]) / (mass[0] + mass[1]);
            for (uint32_t k = 0; k < c.count[0] + c.count[1]; ++k)
                if (touches(k) && s.start[c.vertex[k]].w > 0) velocity[c.vertex[k]] += (common - speed[k < c.count[0] ? 0 : 1]) * c.normal;
        }
}

}  // namespace trocar
