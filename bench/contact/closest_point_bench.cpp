#include <algorithm>
#include <cstdio>
#include <random>

#include "bench/contact/contact_parts.hpp"
#include "engine/base/cpu.hpp"
#include "engine/distance/closest_point.hpp"
#include "engine/geometry/space_curve.hpp"
#include "tests/engine/distance/hard_surfaces.hpp"
#include "tests/reference/brute_force_distance.hpp"
#include "tests/reference/exact_side.hpp"
#ifdef TROCAR_WITH_CGAL
#include "bench/peers/cgal_surface.hpp"
#endif
// Speed and error of closest points and signs, one thread.
namespace trocar::bench {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

Box box_of(const std::vector<Vec3d>& points) {
    Box box;
    for (const Vec3d& p : points) box.min = box.min.cwiseMin(p), box.max = box.max.cwiseMax(p);
    return box;
}
void sort_along_curve(std::vector<Vec3d>& points) {
    const Box box = box_of(points);
    std::sort(points.begin(), points.end(), [&](const Vec3d& a, const Vec3d& b) { return hilbert_key(a, box) < hilbert_key(b, box); });
}

std::unique_ptr<ClosestPointTree> make_tree(const TestMesh& mesh, const std::vector<Float4>* floats, bool embree) {
    const TreeSearch search = embree ? TreeSearch::kEmbree : TreeSearch::kOwn;
    return floats ? std::make_unique<ClosestPointTree>(mesh.view(), *floats, nullptr, search)
                  : std::make_unique<ClosestPointTree>(mesh.view(), nullptr, search);
}

// Largest error over some of the points, in diagonals; a wrong sign counts as infinite.
double largest_error(const TestMesh& mesh, std::span<const Vec3d> points, std::span<const double> distance) {
    double worst = 0;
    for (size_t i = 0; i < points.size(); i += std::max<size_t>(1, points.size() / 200)) {
        const BruteForceAnswer truth = brute_force_distance(mesh.position, mesh.triangle, points[i]);
        const bool inside = truth.winding > 0.5;
        if (truth.distance > 1e-9 * mesh.diagonal() && (distance[i] < 0) != inside) worst = kInfinity;
        worst = std::max(worst, std::abs(std::abs(distance[i]) - truth.distance) / mesh.diagonal());
    }
    return worst;
}

struct Answers {
    std::vector<SurfacePoint> surface;
    std::vector<double> radius, distance;
    QueryCounters counters;
    Answers(size_t count, double r) : surface(count), radius(count, r), distance(count) {}
    void ask(const ClosestPointTree& tree, std::span<const Vec3d> points, std::span<const uint32_t> hint = {}) {
        tree.query(points, radius, hint, surface, counters);
    }
    void take_distances() {
        for (size_t i = 0; i < surface.size(); ++i) distance[i] = surface[i].distance;
    }
};

// One set of points on one mesh: ours without hints and with the last frame's, rtcPointQuery, CGAL.
void query_rows(const TestMesh& mesh, const std::string& name, std::vector<Vec3d> points, bool judged, Report& report) {
    const std::unique_ptr<ClosestPointTree> own = make_tree(mesh, nullptr, false), embree = make_tree(mesh, nullptr, true);
    const double margin = 0.01 * mesh.diagonal();
    Answers cold(points.size(), kInfinity), warm(points.size(), kInfinity), reference(points.size(), kInfinity);
    std::mt19937_64 random(3);
    std::vector<Vec3d> before = points;  // the points of the previous frame
    for (Vec3d& p : before) p += 0.2 * margin * random_direction(random);
    warm.ask(*own, before);
    std::vector<uint32_t> hint;
    for (const SurfacePoint& s : warm.surface) hint.push_back(s.triangle);
    std::vector<std::function<void()>> jobs = {[&] { cold.ask(*own, points); }, [&] { warm.ask(*own, points, hint); },
                                               [&] { reference.ask(*embree, points); }, [&] { reference.ask(*embree, points, hint); }};
#ifdef TROCAR_WITH_CGAL
    const CgalSurface peer(mesh.position, mesh.triangle);
    std::vector<double> peer_distance(points.size());
    jobs.push_back([&] { peer.query(points, peer_distance); });
#endif
    const std::vector<double> seconds = interleaved_medians(report.quick() ? 3 : 9, jobs);
    const double per_query = 1e9 / static_cast<double>(points.size());
    cold.take_distances();
    warm.take_distances();
    reference.take_distances();
    const double error = largest_error(mesh, points, cold.distance);
    const auto row = [&](const std::string& what, double ours, const char* peer_name, double peer_value, double peer_error) {
        Row r{name + ", " + what, ours * per_query, "ns", peer_name, peer_value * per_query};
        r.error = error;
        r.peer_error = peer_error;
        r.error_unit = "diagonals";
        return r;
    };
    Row own_row = row("against rtcPointQuery", seconds[0], "rtcPointQuery", seconds[2], largest_error(mesh, points, reference.distance));
    own_row.note = cold.distance == reference.distance ? "same bits" : "ANSWERS DIFFER";
    report.add(own_row);
    Row warm_row = row("last frame's triangle known", seconds[1], "rtcPointQuery", seconds[3], kNoValue);
    warm_row.note = cold.distance == warm.distance ? "same bits" : "ANSWERS DIFFER";
    report.add(warm_row);
#ifdef TROCAR_WITH_CGAL
    Row cgal = row("against CGAL", seconds[0], "CGAL closest point + side", seconds[4], largest_error(mesh, points, peer_distance));
    if (judged) cgal.goal = Goal::kRatio, cgal.at_least = 5, cgal.aim = 8;
    report.add(cgal);
#else
    (void)judged;
#endif
}

void refit_rows(const TestMesh& mesh, Report& report) {
    const std::vector<Float4> rest = mesh.offsets();
    std::vector<Float4> bent = rest;
    for (Float4& o : bent) o.z += 0.02f * o.x;
    const auto own = make_tree(mesh, &rest, false), embree = make_tree(mesh, &rest, true);
    bool odd = false;
    const std::vector<double> seconds =
        interleaved_medians(21, {[&] { own->refit((odd = !odd) ? bent : rest); }, [&] { embree->refit(odd ? bent : rest); }});
    const double per_100k = 1e8 / static_cast<double>(mesh.triangle.size());
    Row row{"refit per 100,000 triangles, signs included", seconds[0] * per_100k, "ms", "with Embree's tree too", seconds[1] * per_100k};
    std::vector<Vec3d> points = points_near(mesh, 200, 0.01 * mesh.diagonal(), 7);
    TestMesh now = mesh;
    const std::vector<Float4>& floats = odd ? bent : rest;
    for (size_t v = 0; v < floats.size(); ++v) now.position[v] = Vec3d(floats[v].x, floats[v].y, floats[v].z);
    Answers answers(points.size(), kInfinity);
    answers.ask(*own, points);
    answers.take_distances();
    row.error = largest_error(now, points, answers.distance);
    row.error_unit = "diagonals";
    row.goal = Goal::kLimit, row.at_least = 1.2, row.aim = 0.8;
    report.add(row);
}

// A deforming pair: each frame both surfaces move by 0.05 % of the diagonal; refit both, query every vertex
// of each inside the other's enlarged box, take the depth.
struct Pair {
    struct Body {
        std::vector<Float4> offset;
        std::unique_ptr<ClosestPointTree> tree;
        std::vector<uint32_t> order, hint;  // vertices along a space-filling curve
    };
    const TestMesh& mesh;
    double margin;
    Body body[2];
    Vec3d shift;  // of the second relative to the first
    uint64_t queries = 0, contacts = 0;
    double depth = 0;

    Pair(const TestMesh& m, const Vec3d& s, bool embree) : mesh(m), margin(0.01 * m.diagonal()), shift(s) {
        for (Body& b : body) {
            b.offset = mesh.offsets();
            b.tree = make_tree(mesh, &b.offset, embree);
            for (uint32_t v = 0; v < mesh.position.size(); ++v) b.order.push_back(v);
            const Box box = box_of(mesh.position);
            std::sort(b.order.begin(), b.order.end(),
                      [&](uint32_t u, uint32_t v) { return hilbert_key(mesh.position[u], box) < hilbert_key(mesh.position[v], box); });
            b.hint.assign(mesh.position.size(), kNone);
        }
    }
    void deform(int frame) {
        const float step = static_cast<float>(5e-4 * mesh.diagonal());
        for (int side = 0; side < 2; ++side)
            for (size_t v = 0; v < mesh.position.size(); ++v) {
                Float4& o = body[side].offset[v];
                o.z += step * std::sin(0.7f * static_cast<float>(frame) + 3 * o.x + static_cast<float>(side));
            }
    }
    void look(std::vector<Vec3d>& points, std::vector<uint32_t>& vertex, std::vector<uint32_t>& hint) {
        queries = contacts = 0;
        depth = 0;
        for (Body& b : body) b.tree->refit(b.offset);
        for (int side = 0; side < 2; ++side) {
            Body &from = body[side], &to = body[1 - side];
            const Vec3d move = side == 0 ? Vec3d(-shift) : shift;  // into the frame of `to`
            Vec3 low = Vec3::Constant(INFINITY), high = -low;
            for (const Float4& o : to.offset) low = low.cwiseMin(Vec3(o.x, o.y, o.z)), high = high.cwiseMax(Vec3(o.x, o.y, o.z));
            points.clear(), vertex.clear(), hint.clear();
            for (const uint32_t v : from.order) {
                const Float4& o = from.offset[v];
                const Vec3d p = Vec3d(o.x, o.y, o.z) + move;
                if (((low.cast<double>() - p).array() > margin).any() || ((p - high.cast<double>()).array() > margin).any()) continue;
                points.push_back(p), vertex.push_back(v), hint.push_back(from.hint[v]);
            }
            Answers answers(points.size(), margin);
            answers.ask(*to.tree, points, hint);
            queries += points.size();
            for (size_t i = 0; i < points.size(); ++i) {
                const SurfacePoint& s = answers.surface[i];
                if (s.triangle == kNone) continue;
                from.hint[vertex[i]] = s.triangle;
                ++contacts;
                depth = std::max(depth, -s.distance);
            }
        }
    }
};

void pair_row(const TestMesh& mesh, const std::string& name, const Vec3d& shift, double at_least, double aim, Report& report) {
    Pair own(mesh, shift, false), embree(mesh, shift, true);
    std::vector<double> seconds[2];
    std::vector<Vec3d> points;
    std::vector<uint32_t> vertex, hint;
    bool same = true;
    for (int frame = 0; frame < (report.quick() ? 9 : 31); ++frame) {
        for (int k = 0; k < 2; ++k) {
            Pair& pair = k ? embree : own;
            pair.deform(frame);
            const double begin = thread_seconds();
            pair.look(points, vertex, hint);
            if (frame > 0) seconds[k].push_back(thread_seconds() - begin);
        }
        same = same && own.depth == embree.depth && own.contacts == embree.contacts;
    }
    for (std::vector<double>& s : seconds) std::nth_element(s.begin(), s.begin() + static_cast<ptrdiff_t>(s.size() / 2), s.end());
    Row row{name, 1e3 * seconds[0][seconds[0].size() / 2], "ms", "rtcPointQuery", 1e3 * seconds[1][seconds[1].size() / 2]};
    // check the last frame's deepest vertices by brute force
    double truth = 0;
    for (int side = 0; side < 2; ++side) {
        const Pair::Body &from = own.body[side], &to = own.body[1 - side];
        TestMesh now = mesh;
        for (size_t v = 0; v < to.offset.size(); ++v) now.position[v] = Vec3d(to.offset[v].x, to.offset[v].y, to.offset[v].z);
        for (size_t v = 0; v < from.offset.size(); ++v) {
            const Vec3d p = Vec3d(from.offset[v].x, from.offset[v].y, from.offset[v].z) + (side == 0 ? Vec3d(-shift) : shift);
            if (!(to.tree->query(p, own.margin).distance < -0.98 * own.depth)) continue;
            const BruteForceAnswer answer = brute_force_distance(now.position, now.triangle, p);
            if (answer.winding > 0.5) truth = std::max(truth, answer.distance);
        }
    }
    row.error = std::abs(truth - own.depth) / mesh.diagonal();
    row.error_unit = "diagonals of depth";
    row.goal = Goal::kLimit, row.at_least = at_least, row.aim = aim;
    row.note = std::to_string(own.queries) + " queries, " + std::to_string(own.contacts) + " contacts, " +
               (same ? "same as rtcPointQuery" : "RTCPOINTQUERY DIFFERS");
    report.add(row);
}

// Signs of 400,000 points against our exact arithmetic and, if installed, CGAL's exact kernel.
void sign_rows(Report& report) {
    const uint32_t each = report.quick() ? 500 : 23000;
    uint64_t points = 0, wrong = 0, cgal_differs = 0;
    for (const HardSurface& surface : hard_surfaces()) {
        uint64_t seed = 401;
        for (const double away : {0.0, 1e3, 1e5}) {
            const PlacedSurface placed = place_surface(surface.mesh, away, each, seed++);
            Answers answers(placed.point.size(), kInfinity);
            answers.ask(*make_tree(placed.mesh, nullptr, false), placed.point);
            std::vector<int> side(placed.point.size());
#ifdef TROCAR_WITH_CGAL
            cgal_exact_sides(placed.mesh.position, placed.mesh.triangle, placed.point, side);
#endif
            for (size_t i = 0; i < placed.point.size(); ++i) {
                int windings;
                const double d = answers.surface[i].distance;
                if (std::abs(d) < 1e-9 * surface.mesh.diagonal()) continue;
                if (!exact_windings(placed.mesh.position, placed.mesh.triangle, placed.point[i], windings)) continue;
                ++points;
                wrong += (d < 0) != (windings > 0);
                cgal_differs += side[i] != 0 && (side[i] < 0) != (windings > 0);
            }
        }
    }
    Row row{"wrong signs, " + std::to_string(points) + " points, distances over 1e-9 diagonals", static_cast<double>(wrong), ""};
    row.goal = Goal::kLimit, row.at_least = 0, row.aim = 0;
    row.note = "exact arithmetic of our own";
#ifdef TROCAR_WITH_CGAL
    row.note += "; CGAL's exact kernel says otherwise " + std::to_string(cgal_differs) + " times";
#endif
    report.add(row);
}

// Sign of meshes not admitted as solids: clustered far triangles against the direct sum.
void winding_rows(const TestMesh& organ, Report& report) {
    TestMesh mesh = organ;
    mesh.info.admission = Admission::kWinding;
    mesh.triangle.resize(mesh.triangle.size() - 200);
    const TestMesh open(mesh.position, mesh.triangle, Admission::kWinding);
    const auto tree = make_tree(open, nullptr, false);
    std::vector<Vec3d> points = points_near(open, 100, 0.01 * open.diagonal(), 7);
    for (const Vec3d& p : points_in_box(open, 100, 8)) points.push_back(p);
    std::vector<char> fast(points.size()), direct(points.size());
    const std::vector<double> seconds = interleaved_medians(3, {[&] {
                                                                    for (int repeat = 0; repeat < 20; ++repeat)
                                                                        for (size_t i = 0; i < points.size(); ++i)
                                                                            fast[i] = tree->winds_around(points[i]);
                                                                },
                                                                [&] {
                                                                    for (size_t i = 0; i < points.size(); ++i)
                                                                        direct[i] = tree->winding_number(points[i]) > 0.5;
                                                                }});
    const double count = static_cast<double>(points.size());
    Row row{"winding number's side, open mesh of " + std::to_string(open.triangle.size()) + " triangles", 1e6 * seconds[0] / (20 * count),
            "us", "sum of all triangles", 1e6 * seconds[1] / count};
    uint64_t differ = 0;
    for (size_t i = 0; i < points.size(); ++i) differ += fast[i] != direct[i];
    row.error = static_cast<double>(differ);
    row.error_unit = "sides differ";
    report.add(row);
}

}  // namespace

void compare_queries(Report& report) {
    for (const bool plain : {false, true}) {
        force_avx2(plain);
        if (plain && report.quick()) break;
        const std::string set = instruction_set();
        report.heading("Signed closest points, " + set);
        for (const int n : {22, 50, 71}) {
            const TestMesh organ = make_organ(n);
            const std::string name = set + ", " + std::to_string(organ.triangle.size()) + " triangles";
            const uint32_t count = report.quick() ? 2000 : 10000;
            std::vector<Vec3d> near = points_near(organ, count, 0.01 * organ.diagonal(), 7);
            std::vector<Vec3d> box = points_in_box(organ, count, 7);
            sort_along_curve(near);
            sort_along_curve(box);
            query_rows(organ, name + ", near", near, true, report);
            if (!plain) query_rows(organ, name + ", uniform", box, false, report);
            if (n == 71) refit_rows(organ, report);
        }
    }
    force_avx2(false);
    report.heading("A deforming pair: refit, queries, depth");
    const TestMesh organ = make_organ(50);
    pair_row(organ, "50,000-triangle deforming pair, light contact", Vec3d(1.84, 0, 0), 3, 2, report);
    pair_row(organ, "50,000-triangle deforming pair, full contact", Vec3d(0.01, 0.005, 0), 18, 12, report);
    report.heading("Signs");
    winding_rows(organ, report);
    sign_rows(report);
}

}  // namespace trocar::bench
