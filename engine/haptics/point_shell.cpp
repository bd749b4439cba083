#include "engine/haptics/point_shell.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <unordered_map>

#include "engine/geometry/quaternion.hpp"
#include "engine/geometry/space_curve.hpp"
namespace trocar {
namespace {

constexpr uint32_t kTrials = 24;    // candidate positions tried for every point wanted
constexpr uint32_t kHalvings = 18;  // bisections of the spacing until the number of points fits

Vec3d area_vector(const MeshView& mesh, uint32_t t) {
    const Triangle& c = mesh.triangle[t];
    return 0.5 * (mesh.position[c[1]] - mesh.position[c[0]]).cross(mesh.position[c[2]] - mesh.position[c[0]]);
}

Vec3d unit_normal(const MeshView& mesh, uint32_t t) {
    const Vec3d area = area_vector(mesh, t);
    const double size = area.norm();
    return size > 0 ? Vec3d(area / size) : Vec3d(Vec3d::Zero());
}

struct SharpEdge {
    Vec3d from, to;
    std::array<uint32_t, 2> vertex;
    Vec3d outward;
};

// Convex edges sharper than an angle, and rims.
std::vector<SharpEdge> find_sharp_edges(const MeshView& mesh, double sharp_angle) {
    std::vector<SharpEdge> found;
    for (uint32_t e = 0; e < mesh.edge.size(); ++e) {
        const auto [left, right] = mesh.edge_triangle[e];
        const auto [a, b] = mesh.edge[e];
        if (left == kNone || right == kNone) {
            const Vec3d n = unit_normal(mesh, left == kNone ? right : left);
            found.push_back({mesh.position[a], mesh.position[b], {a, b}, n});
            continue;
        }
        const Vec3d m = unit_normal(mesh, left), n = unit_normal(mesh, right);
        if (std::atan2(m.cross(n).norm(), m.dot(n)) <= sharp_angle) continue;
        Vec3d across = Vec3d::Zero();  // to the corner of the right triangle opposite the edge
        for (const uint32_t v : mesh.triangle[right])
            if (v != a && v != b) across = mesh.position[v] - mesh.position[a];
        if (m.dot(across) >= 0) continue;  // a groove
        const Vec3d outward = m + n;
        if (outward.squaredNorm() > 1e-12) found.push_back({mesh.position[a], mesh.position[b], {a, b}, outward.normalized()});
    }
    return found;
}

// Angle-weighted normal of a vertex.
Vec3d vertex_normal(const MeshView& mesh, uint32_t v) {
    Vec3d sum = Vec3d::Zero();
    for (uint32_t k = mesh.incident_first[v]; k < mesh.incident_first[v + 1]; ++k) {
        const Triangle& c = mesh.triangle[mesh.incident[k]];
        const int at = c[0] == v ? 0 : c[1] == v ? 1 : 2;
        const Vec3d u = mesh.position[c[(at + 1) % 3]] - mesh.position[v], w = mesh.position[c[(at + 2) % 3]] - mesh.position[v];
        sum += std::atan2(u.cross(w).norm(), u.dot(w)) * unit_normal(mesh, mesh.incident[k]);
    }
    return sum.squaredNorm() > 0 ? Vec3d(sum.normalized()) : Vec3d(Vec3d::Zero());
}

struct Candidate {
    Vec3d point, outward;
};

// Points of a low-discrepancy sequence over the surface (Cranley & Patterson rotations of the golden and
// plastic numbers), in a scattered order.
std::vector<Candidate> spread_trials(const MeshView& mesh, uint32_t count) {
    std::vector<double> until(mesh.triangle.size());
    double area = 0;
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t) until[t] = area += area_vector(mesh, t).norm();
    std::vector<Candidate> trials;
    if (!(area > 0)) return trials;
    trials.reserve(count);
    const auto part = [](double x) { return x - std::floor(x); };
    for (uint32_t k = 0; k < count; ++k) {
        const double where = part(0.5 + 0.8191725133961645 * (k + 1)) * area;
        double u = part(0.5 + 0.6710436067037893 * (k + 1)), v = part(0.5 + 0.5497004779019703 * (k + 1));
        const size_t t =
            std::min<size_t>(static_cast<size_t>(std::upper_bound(until.begin(), until.end(), where) - until.begin()), until.size() - 1);
        if (u + v > 1) u = 1 - u, v = 1 - v;
        const Triangle& c = mesh.triangle[t];
        const Vec3d& a = mesh.position[c[0]];
        trials.push_back({a + u * (mesh.position[c[1]] - a) + v * (mesh.position[c[2]] - a), unit_normal(mesh, static_cast<uint32_t>(t))});
    }
    return trials;
}

// Accepts positions that keep a spacing from those accepted earlier. Cells as wide as the spacing.
struct Spacer {
    double spacing;
    std::vector<Candidate> kept;
    std::unordered_map<uint64_t, std::vector<uint32_t>> cell;

    uint64_t key(const Vec3d& p, int dx, int dy, int dz) const {
        const auto at = [&](double x, int d) {
            return static_cast<uint64_t>(static_cast<int64_t>(std::floor(x / spacing)) + d) & 0x1fffff;
        };
        return at(p.x(), dx) | at(p.y(), dy) << 21 | at(p.z(), dz) << 42;
    }
    void keep(const Candidate& candidate) {
        cell[key(candidate.point, 0, 0, 0)].push_back(static_cast<uint32_t>(kept.size()));
        kept.push_back(candidate);
    }
    // Points on the two sides of a thin wall do not exclude each other.
    bool is_free(const Candidate& candidate, double share) const {
        for (int n = 0; n < 27; ++n) {
            const auto found = cell.find(key(candidate.point, n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1));
            if (found == cell.end()) continue;
            for (const uint32_t k : found->second)
                if ((kept[k].point - candidate.point).norm() < share * spacing && kept[k].outward.dot(candidate.outward) > -0.5)
                    return false;
        }
        return true;
    }
};

std::vector<Candidate> place_points(const MeshView& mesh, const std::vector<SharpEdge>& edges, const std::vector<Candidate>& trials,
                                    double spacing) {
    Spacer spacer{spacing, {}, {}};
    std::vector<uint32_t> corners;
    for (const SharpEdge& e : edges) corners.insert(corners.end(), e.vertex.begin(), e.vertex.end());
    std::sort(corners.begin(), corners.end());
    corners.erase(std::unique(corners.begin(), corners.end()), corners.end());
    constexpr double kAlong = 0.75;  // of the spacing: denser along edges, which make contact first
    for (const uint32_t v : corners) {
        const Candidate candidate{mesh.position[v], vertex_normal(mesh, v)};
        if (spacer.is_free(candidate, kAlong)) spacer.keep(candidate);
    }
    for (const SharpEdge& e : edges) {
        const double length = (e.to - e.from).norm();
        const uint32_t parts = static_cast<uint32_t>(std::ceil(length / spacing));
        for (uint32_t k = 1; k < parts; ++k) {
            const Candidate candidate{e.from + (e.to - e.from) * (double(k) / parts), e.outward};
            if (spacer.is_free(candidate, kAlong)) spacer.keep(candidate);
        }
    }
    for (const Candidate& candidate : trials)
        if (spacer.is_free(candidate, 1)) spacer.keep(candidate);
    return std::move(spacer.kept);
}

}  // namespace

std::vector<ShellPoint> make_point_shell(const MeshView& mesh, const Vec3d& tip, uint32_t count, double sharp_angle) {
    const std::vector<Candidate> trials = spread_trials(mesh, count * kTrials);
    if (trials.empty()) return {};
    const std::vector<SharpEdge> edges = find_sharp_edges(mesh, sharp_angle);
    double area = 0;
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t) area += area_vector(mesh, t).norm();
    // the finest spacing that gives at most the wanted number
    double low = 0.2 * std::sqrt(area / count), high = 4 * std::sqrt(area / count);
    std::vector<Candidate> best = place_points(mesh, edges, trials, high);
    for (uint32_t k = 0; k < kHalvings; ++k) {
        const double middle = 0.5 * (low + high);
        std::vector<Candidate> candidates = place_points(mesh, edges, trials, middle);
        if (candidates.size() > count) {
            low = middle;
        } else {
            high = middle;
            best = std::move(candidates);
            if (best.size() >= count - count / 200) break;
        }
    }
    Box box;
    for (const Candidate& p : best) box.min = box.min.cwiseMin(p.point), box.max = box.max.cwiseMax(p.point);
    std::vector<std::pair<uint64_t, uint32_t>> order;
    for (uint32_t k = 0; k < best.size(); ++k) order.push_back({hilbert_key(best[k].point, box), k});
    std::sort(order.begin(), order.end());
    std::vector<ShellPoint> point_shell;
    for (const auto& [key, k] : order) point_shell.push_back({best[k].point - tip, -best[k].outward});
    return point_shell;
}

std::span<const ShellPoint> points_at_grip(const HandTool& tool, double grip, std::vector<ShellPoint>& placed) {
    if (tool.shell_jaw.empty()) return tool.point_shell;
    placed.assign(tool.point_shell.begin(), tool.point_shell.end());
    for (ShellPoint& p : placed) {
        if (p.jaw == kNone) continue;
        const ToolJaw& jaw = tool.shell_jaw[p.jaw];
        const Quat turn = multiply(from_rotation_vector(jaw.share * grip * jaw.axis), jaw.closed);
        p.arm = jaw.pivot - tool.tip + rotate(turn, p.arm);
        p.inward = rotate(turn, p.inward);
    }
    return placed;
}

double jaw_reach(const HandTool& tool) {
    double most = 0;
    for (const ShellPoint& p : tool.point_shell)
        if (p.jaw != kNone) most = std::max(most, std::abs(tool.shell_jaw[p.jaw].share) * p.arm.norm());
    return most;
}

double shell_radius(const std::vector<ShellPoint>& point_shell) {
    double most = 0;
    for (const ShellPoint& p : point_shell) most = std::max(most, p.arm.norm());
    return most;
}

}  // namespace trocar
