#include "systems/detect/narrow/separation.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
namespace trocar {
namespace {

constexpr size_t kPlanesPerProbe = 24;
constexpr int kDescentSteps = 12;

// Half-space of translations: direction . t >= least.
struct Plane {
    Vec3d direction;
    double least;
};

struct Search {
    const SeparationParams& params;
    std::span<const Vec3d> a, b;
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

// Distance that b must move along a direction to leave the slab around a.
double exit_of_slab(const Search& s, const Vec3d& d) {
    double top = -std::numeric_limits<double>::infinity(), bottom = -top;
    for (const Vec3d& p : s.a) top = std::max(top, d.dot(p));
    for (const Vec3d& p : s.b) bottom = std::min(bottom, d.dot(p));
    return top - bottom;
}

// Finds a shorter separating translation along a direction. Steps by the depth cannot skip the first.
void search_line(Search& s, const Vec3d& d, double from) {
    const double step = 0.1 * s.best.upper;  // minimum step: narrow exits may be skipped
    double taken = from;
    for (double at = from; at < (1 - s.params.accuracy) * s.best.upper && !s.spent();) {
        const SeparationAnswer answer = s.probe(at * d);
        if (answer.free) break;
        taken = at;
        at += std::max(answer.depth, step);
    }
    // bisect
    if (s.best.upper <= taken || s.best.translation.dot(d) < (1 - 1e-9) * s.best.upper) return;
    while (s.best.upper - taken > s.params.accuracy * s.best.upper && !s.spent()) {
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
        t = (1 + s.params.accuracy) * least_translation(planes);
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
                const double shorter = (1 - 2 * s.params.accuracy) * s.best.upper;
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
    for (const Vec3d& p : s.b) apart += p / double(s.b.size());
    for (const Vec3d& p : s.a) apart -= p / double(s.a.size());
    if (apart.norm() > 0) d.push_back(apart.normalized());
    std::stable_sort(d.begin(), d.end(), [&](const Vec3d& x, const Vec3d& y) { return exit_of_slab(s, x) < exit_of_slab(s, y); });
    return d;
}

}  // namespace

Separation find_separation(const SeparationParams& params, std::span<const Vec3d> a, std::span<const Vec3d> b,
                           const std::function<SeparationAnswer(const Vec3d&)>& ask) {
    Search s{params, a, b, ask, {}};
    s.best.upper = std::numeric_limits<double>::infinity();
    const SeparationAnswer here = s.probe(Vec3d::Zero());
    s.best.lower = here.depth;
    if (here.free) return s.best;
    const std::vector<Vec3d> starts = start_directions(s, here.directions);
    for (const Vec3d& d : starts) {
        const double exit = 1.0001 * exit_of_slab(s, d);
        if (exit < s.best.upper) s.probe(exit * d);
    }
    if (!std::isfinite(s.best.upper)) return s.best;
    descend(s, Vec3d::Zero());
    for (const Vec3d& d : starts) search_line(s, d, std::max(here.depth, 1e-3 * s.best.upper));
    // from slightly inside the best one: the planes there slide it to a shorter one
    for (int i = 0; i < 3; ++i) descend(s, 0.97 * s.best.translation);
    turn_best(s);
    for (int i = 0; i < 2; ++i) descend(s, 0.97 * s.best.translation);
    const Vec3d d = s.best.translation / s.best.upper;
    search_line(s, d, 0.97 * s.best.upper);
    return s.best;
}

}  // namespace trocar
