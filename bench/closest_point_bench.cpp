// Cost of signed closest-point queries and refits on one thread: medians of repeated runs, ns a query, ms a refit.
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <functional>
#include <numeric>

#include "bench/suites.hpp"
#include "engine/closest_point.hpp"
#include "engine/thread_pool.hpp"
#include "tests/engine/closest_point_meshes.hpp"
namespace trocar {
namespace {

uint64_t spread(uint64_t x) {
    x = (x | x << 32) & 0x1f00000000ffffull;
    x = (x | x << 16) & 0x1f0000ff0000ffull;
    x = (x | x << 8) & 0x100f00f00f00f00full;
    x = (x | x << 4) & 0x10c30c30c30c30c3ull;
    return (x | x << 2) & 0x1249249249249249ull;
}
void sort_by_morton_code(std::vector<Vec3d>& points) {
    const auto code = [](const Vec3d& p) {
        const auto cell = [](double x) { return spread(static_cast<uint64_t>((x + 4) * 128)); };
        return cell(p.x()) | cell(p.y()) << 1 | cell(p.z()) << 2;
    };
    std::sort(points.begin(), points.end(), [&](const Vec3d& a, const Vec3d& b) { return code(a) < code(b); });
}

// time of this thread alone, so that a busy machine does not count
double thread_seconds() {
    timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

double median_seconds(int runs, const std::function<void()>& work) {
    std::vector<double> seconds;
    for (int i = 0; i < runs; ++i) {
        const double start = thread_seconds();
        work();
        seconds.push_back(thread_seconds() - start);
    }
    std::nth_element(seconds.begin(), seconds.begin() + runs / 2, seconds.end());
    return seconds[static_cast<size_t>(runs / 2)];
}

void measure_queries(const ClosestPointTree& tree, const std::vector<Vec3d>& points, double margin, const char* name) {
    const size_t n = points.size();
    std::vector<SurfacePoint> out(n);
    std::vector<double> radius(n, std::numeric_limits<double>::infinity());
    QueryCounters counters;
    std::mt19937_64 random(3);
    std::vector<Vec3d> before = points;  // the points one frame ago, 0.2 margins away
    for (Vec3d& p : before) p += 0.2 * margin * random_direction(random);
    tree.query(before, radius, {}, out, counters);
    std::vector<uint32_t> hint;
    for (const SurfacePoint& s : out) hint.push_back(s.triangle);
    const auto time = [&](std::span<const uint32_t> hints) {
        return 1e9 / static_cast<double>(n) *
               median_seconds(11, [&] { tree.query(points, radius, hints, out, counters); });
    };
    const double cold = time({}), warm = time(hint);
    std::fill(radius.begin(), radius.end(), margin);
    const double bounded = time({});
    std::printf("  %-28s cold %6.0f   warm %6.0f   within the margin %6.0f ns/query\n", name, cold, warm, bounded);
}

void measure_mesh(int n) {
    const TestMesh organ = make_organ(n);
    const std::vector<Float4> rest = organ.offsets();
    std::vector<Float4> bent = rest;
    for (Float4& o : bent) o.z += 0.02f * o.x;
    ClosestPointTree tree(organ.view(), rest);
    const double triangles = static_cast<double>(organ.triangle.size());
    bool odd = false;
    const double refit = median_seconds(21, [&] { tree.refit((odd = !odd) ? bent : rest); });
    const double build = median_seconds(3, [&] { ClosestPointTree(organ.view(), rest); });
    std::printf("%.0f triangles, %s: build %.1f ms, refit %.3f ms (%.2f ms per 100,000)\n", triangles,
                instruction_set(), 1e3 * build, 1e3 * refit, 1e8 * refit / triangles);
    const double margin = 0.01 * organ.diagonal();
    std::vector<Vec3d> near = points_near(organ, 10000, margin, 7), box = points_in_box(organ, 10000, 7);
    measure_queries(tree, near, margin, "near, random order");
    sort_by_morton_code(near);
    measure_queries(tree, near, margin, "near, sorted");
    sort_by_morton_code(box);
    measure_queries(tree, box, margin, "uniform, sorted");
}

}  // namespace
}  // namespace trocar

int query_suite(int, char**) {
    for (const bool plain : {false, true}) {
        trocar::force_avx2(plain);
        for (const int n : {22, 71}) trocar::measure_mesh(n);
    }
    return 0;
}
