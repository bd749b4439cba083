#include "systems/detect/narrow/separation.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>

#include "engine/geometry/point_triangle.hpp"
namespace trocar {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr size_t kPlanesPerProbe = 24;
constexpr int kDescentSteps = 12;

// Half-space of translations: direction . t >= least.
struct Plane {
    Vec3d direction;
    double least;
};

struct Search {
    const SeparationParams& params;
    const std::array<SeparatedBody, 2>& bodies;
    const std::function<SeparationAnswer(const Vec3d&)>& ask;
    Separation best;

    bool spent() const { return best.probes >= params.most_probes; }
    SeparationAnswer probe(const Vec3d& t) {
        ++best.probes;
        SeparationAnswer answer = ask(t);
        if (answer.free && t.norm() < best.upper) {
            best.upper = t.norm();
            best.translation = t;
        }
        return answer;
    }
};

// Point of the difference of the hulls, a - b, farthest along d: translations of b up to it keep them in contact. Of
// equal ones that farthest along a fixed oblique direction, so that it is a corner.
Vec3d support(const std::array<SeparatedBody, 2>& bodies, const Vec3d& d) {
    static const Vec3d kOblique = Vec3d(0.5773, 0.2113, 0.7887);
    Vec3d sum = Vec3d::Zero();
    for (int body = 0; body < 2; ++body) {
        const Vec3d along = body ? Vec3d(-d) : d;
        double most = -kInfinity, tie = -kInfinity;
        Vec3d best = Vec3d::Zero();
        for (const Vec3d& p : bodies[body].point) {
            const double x = along.dot(p), slack = 1e-15 * (std::abs(x) + std::abs(most));
            if (x < most - slack || (x <= most + slack && kOblique.dot(p) <= tie)) continue;
            most = x, tie = kOblique.dot(p), best = p;
        }
        sum += body ? Vec3d(-best) : best;
    }
    return sum;
}

// Distance that b must move along a unit direction to leave the slab around a.
double exit_of_slab(const std::array<SeparatedBody, 2>& bodies, const Vec3d& d) { return d.dot(support(bodies, d)); }

struct HullFace {
    std::array<uint32_t, 3> corner;
    Vec3d normal;     // unit, outward; zero for slivers
    double distance;  // of its plane from the origin, along the normal
};

// The shortest translation that separates the hulls, between bounds.
struct HullSeparation {
    double lower = 0, upper = kInfinity;
    Vec3d direction = Vec3d::Zero();
};

// Expanding polytope algorithm (van den Bergen, Collision Detection in Interactive 3D Environments, 2004) inside the
// difference of the hulls: the face nearest to the origin grows until none of the difference lies beyond it.
HullSeparation separate_hulls(const std::array<SeparatedBody, 2>& bodies, double accuracy) {
    constexpr int kMostPoints = 4000;
    std::vector<Vec3d> point{support(bodies, Vec3d::UnitX())};
    HullSeparation out;
    const auto farthest = [&](const Vec3d& d, const Vec3d& from) {
        const Vec3d p = support(bodies, d), q = support(bodies, -d);
        return std::abs(d.dot(p - from)) > std::abs(d.dot(q - from)) ? p : q;
    };
    point.push_back(farthest(Vec3d::UnitX(), point[0]));
    Vec3d edge = point[1] - point[0];
    point.push_back(farthest(edge.unitOrthogonal(), point[0]));
    point.push_back(farthest(edge.cross(point[2] - point[0]).normalized(), point[0]));
    const Vec3d inner = 0.25 * (point[0] + point[1] + point[2] + point[3]);
    double size = 0;
    for (const Vec3d& p : point) size = std::max(size, (p - inner).norm());
    std::vector<HullFace> faces;
    const auto add_face = [&](uint32_t i, uint32_t j, uint32_t k) {
        Vec3d n = triangle_normal(point[i], point[j], point[k]);
        if (!(n.norm() > 1e-30 * size * size)) return faces.push_back({{i, j, k}, Vec3d::Zero(), kInfinity});
        n.normalize();
        const bool inward = n.dot(inner - point[i]) > 0;
        if (inward) n = -n, std::swap(j, k);
        faces.push_back({{i, j, k}, n, n.dot(point[i])});
    };
    for (const auto& [i, j, k] : {std::array{0u, 1u, 2u}, {0u, 1u, 3u}, {0u, 2u, 3u}, {1u, 2u, 3u}}) add_face(i, j, k);
    std::vector<std::array<uint32_t, 2>> edges, horizon;
    while (true) {
        const HullFace face =
            *std::min_element(faces.begin(), faces.end(), [](const HullFace& a, const HullFace& b) { return a.distance < b.distance; });
        const Vec3d p = support(bodies, face.normal);
        const double reach = face.normal.dot(p);
        if (reach < out.upper) out.upper = reach, out.direction = face.normal;
        out.lower = face.distance;
        if (out.upper - out.lower <= std::max(accuracy * out.upper, 1e-13 * size) || point.size() >= kMostPoints) return out;
        if (reach - face.distance <= 1e-13 * size) return out;  // of the difference itself, and no other is nearer
        const uint32_t fresh = static_cast<uint32_t>(point.size());
        point.push_back(p);
        edges.clear(), horizon.clear();
        std::erase_if(faces, [&](const HullFace& f) {
            if (!(f.normal.dot(p) - f.distance > 1e-14 * size)) return false;
            for (int k = 0; k < 3; ++k) edges.push_back({f.corner[k], f.corner[(k + 1) % 3]});
            return true;
        });
        std::sort(edges.begin(), edges.end());
        for (const auto& [i, j] : edges)
            if (!std::binary_search(edges.begin(), edges.end(), std::array{j, i})) horizon.push_back({i, j});
        for (const auto& [i, j] : horizon) add_face(i, j, fresh);
    }
}

// Finds a shorter separating translation along a direction. Steps by the depth cannot skip the first.
void search_line(Search& s, const Vec3d& d, double from) {
    const double step = 0.1 * s.best.upper;  // minimum step: narrow exits may be skipped
    double taken = from;
    for (double at = from; at < (1 - s.params.line) * s.best.upper && !s.spent();) {
        const SeparationAnswer answer = s.probe(at * d);
        if (answer.free) break;
        taken = at;
        at += std::max(answer.depth, step);
    }
    // bisect
    if (s.best.upper <= taken || s.best.translation.dot(d) < (1 - 1e-9) * s.best.upper) return;
    while (s.best.upper - taken > s.params.line * s.best.upper && !s.spent()) {
        const double middle = 0.5 * (taken + s.best.upper);
        if (!s.probe(middle * d).free) taken = middle;
    }
}

// Adds the planes of the deepest contacts with distinct directions.
void add_planes(std::vector<SeparatingTranslation> directions, const Vec3d& t, std::vector<Plane>& planes) {
    std::stable_sort(directions.begin(), directions.end(),
                     [](const SeparatingTranslation& x, const SeparatingTranslation& y) { return x.depth > y.depth; });
    const size_t first = planes.size();
    for (const SeparatingTranslation& w : directions) {
        const auto alike = [&](const Plane& p) { return p.direction.dot(w.direction) > 0.97; };
        if (std::any_of(planes.begin() + long(first), planes.end(), alike)) continue;
        planes.push_back({w.direction, w.direction.dot(t) + w.depth});
        if (planes.size() - first == kPlanesPerProbe) return;
    }
}

// Shortest translation within all half-spaces: Hildreth's method, one multiplier at a time.
Vec3d least_translation(const std::vector<Plane>& planes) {
    std::vector<double> force(planes.size(), 0);
    Vec3d t = Vec3d::Zero();
    for (int sweep = 0; sweep < 300; ++sweep) {
        double change = 0;
        for (size_t i = 0; i < planes.size(); ++i) {
            const double more = std::max(-force[i], planes[i].least - planes[i].direction.dot(t));
            force[i] += more;
            t += more * planes[i].direction;
            change = std::max(change, std::abs(more));
        }
        if (change < 1e-9 * t.norm()) break;
    }
    return t;
}

// Projects from a start onto the contacts' planes until it is free or longer than the best.
void descend(Search& s, Vec3d t) {
    std::vector<Plane> planes;
    for (int i = 0; i < kDescentSteps && !s.spent(); ++i) {
        SeparationAnswer answer = s.probe(t);
        if (answer.free) return;
        add_planes(std::move(answer.directions), t, planes);
        t = (1 + s.params.line) * least_translation(planes);
        if (!(t.norm() < s.best.upper)) return;
    }
}

// Rotates the best translation slightly in every direction; keeps results that are free and shorter.
void turn_best(Search& s) {
    for (double angle = 0.5; angle > 0.02 && !s.spent(); angle *= 0.5) {
        for (bool better = true; better && !s.spent();) {
            better = false;
            const Vec3d d = s.best.translation / s.best.upper;
            const Vec3d u = d.unitOrthogonal(), v = d.cross(u);
            for (int k = 0; k < 8 && !better && !s.spent(); ++k) {
                const Vec3d side = std::cos(k * M_PI / 4) * u + std::sin(k * M_PI / 4) * v;
                const Vec3d turned = std::cos(angle) * d + std::sin(angle) * side;
                const double shorter = (1 - 2 * s.params.line) * s.best.upper;
                better = s.probe(shorter * turned).free;
            }
        }
    }
}

std::vector<Vec3d> start_directions(const Search& s, const std::vector<SeparatingTranslation>& directions) {
    std::vector<Plane> planes;
    add_planes(directions, Vec3d::Zero(), planes);
    std::vector<Vec3d> d;
    for (const Plane& p : planes) d.push_back(p.direction);
    for (int x = -1; x <= 1; ++x)
        for (int y = -1; y <= 1; ++y)
            for (int z = -1; z <= 1; ++z)
                if (x != 0 || y != 0 || z != 0) d.push_back(Vec3d(x, y, z).normalized());
    Vec3d apart = Vec3d::Zero();
    for (int body = 0; body < 2; ++body)
        for (const Vec3d& p : s.bodies[body].point) apart += (body ? 1 : -1) * p / double(s.bodies[body].point.size());
    if (apart.norm() > 0) d.push_back(apart.normalized());
    std::stable_sort(d.begin(), d.end(),
                     [&](const Vec3d& x, const Vec3d& y) { return exit_of_slab(s.bodies, x) < exit_of_slab(s.bodies, y); });
    return d;
}

// Looks for a shorter translation than that of the hulls.
void search_shorter(Search& s, const SeparationAnswer& here) {
    const std::vector<Vec3d> starts = start_directions(s, here.directions);
    descend(s, Vec3d::Zero());
    for (const Vec3d& d : starts) search_line(s, d, std::max(here.depth, 1e-3 * s.best.upper));
    // from slightly inside the best one: the planes there slide it to a shorter one
    for (int i = 0; i < 3; ++i) descend(s, 0.97 * s.best.translation);
    turn_best(s);
    for (int i = 0; i < 2; ++i) descend(s, 0.97 * s.best.translation);
    const Vec3d d = s.best.translation / s.best.upper;
    search_line(s, d, 0.97 * s.best.upper);
}

// Ball inside a body.
struct InnerBall {
    int body;
    Vec3d centre;   // m
    double radius;  // m
};

// Largest balls inside a body that touch its surface at some of its vertices (Ma, Bae & Choi, 3D medial axis point
// approximation using nearest neighbors and the normal field, Visual Computer 28, 2012), the largest first.
void add_inner_balls(const SeparatedBody& body, int index, std::vector<InnerBall>& balls) {
    constexpr size_t kTouched = 400, kKept = 100, kSamples = 4000;
    double size = 0;
    for (const Vec3d& p : body.point) size = std::max(size, (p - body.point[0]).norm());
    std::vector<InnerBall> found;
    const size_t step = (body.point.size() + kTouched - 1) / kTouched;
    for (size_t i = 0; i < body.point.size(); i += step) {
        const Vec3d p = body.point[i], n = body.nearest(p).normal;
        double radius = size;
        for (int shrink = 0; shrink < 20; ++shrink) {
            const Vec3d to = p - body.nearest(p - radius * n).point;
            const double smaller = to.squaredNorm() / (2 * to.dot(n));
            if (!(to.dot(n) > 0) || !(smaller < (1 - 1e-6) * radius)) break;
            radius = smaller;
        }
        const Vec3d centre = p - radius * n;
        const double inside = -body.nearest(centre).distance;
        if (inside > 1e-6 * size) found.push_back({index, centre, inside});
    }
    std::stable_sort(found.begin(), found.end(), [](const InnerBall& a, const InnerBall& b) { return a.radius > b.radius; });
    const size_t first = balls.size();
    for (const InnerBall& ball : found) {
        if (balls.size() - first == kKept) break;
        const auto covers = [&](const InnerBall& kept) { return (ball.centre - kept.centre).norm() < 0.3 * kept.radius; };
        if (std::none_of(balls.begin() + long(first), balls.end(), covers)) balls.push_back(ball);
    }
    const size_t stride = (body.sample.size() + kSamples - 1) / kSamples;
    for (size_t i = 0; i < body.sample.size(); i += stride) balls.push_back({index, body.sample[i], 0});
}

// Cube of translations, halved along its sides until balls keep all of it from being free.
struct Cell {
    Vec3d centre;                                        // m
    double half;                                         // m
    double nearest;                                      // m, least length of its translations
    std::shared_ptr<const std::vector<uint32_t>> balls;  // that may keep some of it from being free, the deepest first
};

// Proves a lower bound: the cell with the shortest translation that may be free comes first. Tests what no ball holds.
void bound_translations(Search& s) {
    std::vector<InnerBall> balls;
    for (int body = 0; body < 2; ++body) add_inner_balls(s.bodies[body], body, balls);
    if (balls.empty()) return;
    double enough = (1 - s.params.bracket) * s.best.upper;
    const auto overlap = [&](const InnerBall& ball, const Vec3d& t) {
        const Vec3d there = ball.body ? Vec3d(ball.centre + t) : Vec3d(ball.centre - t);
        return ball.radius - s.bodies[!ball.body].nearest(there).distance;
    };
    const auto farther = [](const Cell& a, const Cell& b) { return a.nearest > b.nearest; };
    const auto all = std::make_shared<std::vector<uint32_t>>(balls.size());
    std::iota(all->begin(), all->end(), 0u);
    std::vector<Cell> cells{{Vec3d::Zero(), s.best.upper, 0, all}};
    double proven = kInfinity;
    for (uint32_t count = 0; !cells.empty(); ++count) {
        std::pop_heap(cells.begin(), cells.end(), farther);
        const Cell cell = cells.back();
        cells.pop_back();
        if (cell.nearest >= enough) break;
        if (count == s.params.most_cells) {
            proven = cell.nearest;
            break;
        }
        const double reach = std::sqrt(3.0) * cell.half;
        if (cell.centre.norm() + reach <= s.best.lower) continue;
        const auto near = std::make_shared<std::vector<uint32_t>>();
        double deepest = -kInfinity;
        for (const uint32_t i : *cell.balls) {
            const double deep = overlap(balls[i], cell.centre);  // changes by at most the length of a translation
            if (!(deep > -reach)) continue;
            near->push_back(i);
            if (deep > deepest) std::swap(near->front(), near->back());
            deepest = std::max(deepest, deep);
            if (deepest > reach) break;
        }
        if (deepest > reach) continue;
        if (near->empty()) {  // free, or held by edges and faces alone
            if (s.spent()) {
                proven = cell.nearest;
                break;
            }
            const double before = s.best.upper;
            if (s.probe(cell.centre).depth > reach) continue;
            if (s.best.upper < before) descend(s, 0.97 * s.best.translation);
            enough = (1 - s.params.bracket) * s.best.upper;
        }
        for (int i = 0; i < 8; ++i) {
            Cell part{cell.centre, 0.5 * cell.half, 0, near};
            for (int k = 0; k < 3; ++k) part.centre[k] += (i >> k & 1) ? part.half : -part.half;
            part.nearest = (part.centre.cwiseAbs().array() - part.half).max(0).matrix().norm();
            if (part.nearest >= enough) continue;
            cells.push_back(part);
            std::push_heap(cells.begin(), cells.end(), farther);
        }
    }
    s.best.lower = std::max(s.best.lower, std::min(proven, enough));
}

// Bound on how far the supports of a shape inside the body lie below those of its hull: no face is deeper inside the
// hull than its own plane, so all of the hull deeper than the deepest such plane belongs to the body, and with it the
// hull shrunk towards an inner point by that share of the point's depth. Infinite if the body is far from convex.
double concavity_of(const SeparatedBody& b, const Surfaces& surfaces, uint32_t body) {
    const MeshView mesh = mesh_view(surfaces.meshes, surfaces.bodies.mesh[body]);
    Vec3d middle = Vec3d::Zero();
    for (const Vec3d& p : b.point) middle += p / double(b.point.size());
    double size = 0, deepest = 0;
    for (const Vec3d& p : b.point) size = std::max(size, (p - middle).norm());
    const double depth = -b.nearest(middle).distance;
    for (const Triangle& t : mesh.triangle) {
        const Vec3d n = triangle_normal(b.point[t[0]], b.point[t[1]], b.point[t[2]]).normalized();
        for (const Vec3d& p : b.point) deepest = std::max(deepest, n.dot(p - b.point[t[0]]));
        if (!(deepest < 0.1 * depth)) return kInfinity;
    }
    return deepest / depth * size;
}

}  // namespace

SeparatedBody separated_body(const Surfaces& surfaces, const ClosestPointTree& tree, uint32_t body) {
    const MeshView mesh = mesh_view(surfaces.meshes, surfaces.bodies.mesh[body]);
    SeparatedBody out;
    for (uint32_t v = 0; v < mesh.position.size(); ++v) out.point.push_back(vertex_position(surfaces, body, v));
    out.sample = out.point;
    for (const Triangle& t : mesh.triangle) {
        const Vec3d &a = out.point[t[0]], &b = out.point[t[1]], &c = out.point[t[2]];
        for (const Vec3d& p : {Vec3d((a + b + c) / 3), Vec3d(0.5 * (a + b)), Vec3d(0.5 * (b + c)), Vec3d(0.5 * (c + a))})
            out.sample.push_back(p);
    }
    out.nearest = [&surfaces, &tree, body](const Vec3d& p) {
        SurfacePoint found = tree.query(world_to_frame(surfaces, body, p));
        found.point = frame_to_world(surfaces, body, found.point);
        found.normal = direction_to_world(surfaces, body, found.normal);
        return found;
    };
    out.concavity = concavity_of(out, surfaces, body);
    return out;
}

Separation find_separation(const SeparationParams& params, const std::array<SeparatedBody, 2>& bodies,
                           const std::function<SeparationAnswer(const Vec3d&)>& ask) {
    Search s{params, bodies, ask, {}};
    s.best.upper = kInfinity;
    const SeparationAnswer here = s.probe(Vec3d::Zero());
    s.best.lower = here.depth;
    if (here.free) return s.best;
    const HullSeparation hulls = separate_hulls(bodies, params.accuracy);
    for (const double beyond : {1e-9, 1e-6, 1e-4, 1e-2})
        if (s.best.upper == kInfinity) s.probe((1 + beyond) * hulls.upper * hulls.direction);
    if (s.best.upper == kInfinity) return s.best;
    s.best.lower = std::clamp(hulls.lower - bodies[0].concavity - bodies[1].concavity, s.best.lower, s.best.upper);
    if (s.best.lower >= 0.99 * s.best.upper) return s.best;
    search_shorter(s, here);
    if (s.best.lower < (1 - params.bracket) * s.best.upper) bound_translations(s);
    return s.best;
}

}  // namespace trocar
