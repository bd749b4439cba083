#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>

#include "bench/deform/deform.hpp"
#include "bench/suites.hpp"
#include "content/scene/build_scene.hpp"
#include "content/scene/make_prototype.hpp"
#include "content/scene/make_solid.hpp"
#include "content/shapes/shape_library.hpp"
#include "engine/base/error.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/tissue/solid_limit.hpp"
namespace trocar::bench {

#ifdef TROCAR_WITH_AVX512_GATHER
extern float gather_sum_avx512(const float* values, const int* number, unsigned numbers, unsigned repeats);
double gather_seconds(uint32_t elements) {
    if (!__builtin_cpu_supports("avx512f")) return kNoValue;
    std::vector<float> values(elements, 1.0f);
    std::vector<int> number(1 << 16);
    std::mt19937 random(1);
    for (size_t i = 0; i < number.size(); ++i) number[i] = static_cast<int>((i * 7 / 10 + random() % 64) % elements);
    double best = 1e9, sum = 0;
    for (int round = 0; round < 15; ++round) {
        const double start = thread_seconds();
        sum += static_cast<double>(gather_sum_avx512(values.data(), number.data(), 1 << 16, 20));
        best = std::min(best, (thread_seconds() - start) / (20 << 16));
    }
    return sum > 0 ? best : kNoValue;
}
#else
double gather_seconds(uint32_t) { return kNoValue; }
#endif

namespace {

double wall_seconds() {
    timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

struct Named {
    const char* name;
    SpringGraph graph;
    double at_least, aim;  // relative to Bullet's links
};

std::vector<Named> rate_scenes() {
    return {{"10k sheet", sheet_graph(100, 0.2, 0.08, 50), 8, 11},
            {"20k-tet block", block_graph(15, 0.15, 3.375, 50), 7, 9},
            {"100k sheet", sheet_graph(316, 0.2, 0.08, 50), 8, 11}};
}

std::unique_ptr<AdvanceScene> scene_of(const SpringGraph& graph) {
    auto s = std::make_unique<AdvanceScene>();
    add_graph(*s, graph);
    s->params.account_energy = false;
    return s;
}

// RMS distance to the double reference after `steps` steps of dt = 1 ms / per_ms, m.
double error_of_steps(const SpringGraph& graph, uint32_t steps, uint32_t per_ms) {
    auto s = scene_of(graph);
    reference::DoubleBody b = double_copy(*s, 0, graph);
    s->advance(steps / per_ms, steps);
    constexpr int kFiner = 8;
    for (uint32_t i = 0; i < steps * kFiner; ++i) reference::step(b, 1e-3 / per_ms / kFiner);
    double sum = 0;
    for (uint32_t v = 0; v < graph.position.size(); ++v) sum += (s->offset(0, v) - b.position[v]).squaredNorm();
    return std::sqrt(sum / static_cast<double>(graph.position.size()));
}

// Explicit steps on one core: against Bullet's links, against the gather limit, small against large bodies.
void rate_rows(Report& report) {
    report.heading("One explicit step on one core (gather over both ends of every spring), ns per spring");
    const int rounds = report.quick() ? 9 : 25;
    std::vector<double> ours;
    std::vector<double> springs;
    for (const Named& named : rate_scenes()) {
        auto scene = scene_of(named.graph);
        const double n = static_cast<double>(named.graph.edge.size());
        const BulletBody bullet = bullet_links(named.graph, 10);
        // at 0.05 ms, below the limit of the lightest sheet: the rate does not depend on the step size
        constexpr uint32_t kSteps = 20;
        std::vector<std::function<void()>> jobs{[&] { scene->advance(1, kSteps); }};
        if (bullet) jobs.push_back(bullet.step);
        const std::vector<double> cost = interleaved_medians(n > 1e5 && bullet ? rounds / 2 : rounds, jobs);
        ours.push_back(cost[0] / kSteps / n);
        springs.push_back(n);
        Row row{std::string("explicit step, ") + named.name, ours.back() * 1e9, "ns"};
        if (bullet) {
            row.peer = "Bullet links, 10 iterations, ns per spring-iteration";
            row.peer_value = cost[1] / 10 / n * 1e9;
            row.goal = Goal::kRatio, row.at_least = named.at_least, row.aim = named.aim;
        } else {
            row.note = "Bullet is not there (libbullet-dev)";
        }
        // ten springs along the side suffice for the error: the sheet of 100k then equals that of 10k
        row.error = n < 1e5 ? error_of_steps(named.graph, 20, 20) * 1e3 : kNoValue;
        row.error_unit = "mm RMS after 1 ms against double";
        report.add(row);
    }
    const double gather = gather_seconds(4096);
    for (int i = 0; i < 2; ++i) {
        Row row{std::string("explicit step against 6 gathers, ") + (i ? "20k-tet block" : "10k sheet"), ours[i] * 1e9, "ns"};
        row.peer = "gather limit", row.peer_value = 6 * gather * 1e9;
        row.goal = Goal::kRatio, row.at_least = 0.95, row.aim = 1.2;
        if (!(gather > 0)) row.not_judged = "no AVX-512 here";
        report.add(row);
    }
    Row large{"rate at 300k springs against 30k", ours[2] * 1e9, "ns"};
    large.peer = "30k springs", large.peer_value = ours[0] * 1e9;
    large.goal = Goal::kRatio, large.at_least = 0.75, large.aim = 0.92;
    report.add(large);
}

void thread_rows(Report& report) {
    report.heading("Two threads, wall time, best of interleaved runs");
    const std::vector<Named> scenes = rate_scenes();
    double load[1] = {0};
    if (getloadavg(load, 1) != 1) load[0] = 0;
    for (const int which : {0, 2}) {
        double best[2] = {1e9, 1e9};
        std::unique_ptr<AdvanceScene> scene[2] = {scene_of(scenes[which].graph), scene_of(scenes[which].graph)};
        // a frame makes one call for the 16 ms between two contact passes
        constexpr uint32_t kTicks = 16, kSteps = 320;
        for (int round = 0; round < (report.quick() ? 5 : 10); ++round) {
            for (const int threads : {1, 2}) {
                ThreadPool pool(static_cast<uint32_t>(threads));
                pool.run([&] {
                    for (int i = 0; i < 2; ++i) {
                        const double start = wall_seconds();
                        scene[threads - 1]->advance(kTicks, kSteps);
                        best[threads - 1] = std::min(best[threads - 1], (wall_seconds() - start) / kSteps);
                    }
                });
            }
        }
        Row row{std::string("two threads, ") + scenes[which].name, best[1] * 1e6, "us"};
        row.peer = "one thread", row.peer_value = best[0] * 1e6;
        row.goal = Goal::kRatio, row.at_least = which == 0 ? 1.6 : 1.8, row.aim = which == 0 ? 1.8 : 1.95;
        if (load[0] > 1.5) row.not_judged = "the machine is busy";
        row.error = 0;
        for (uint32_t v = 0; v < scene[0]->particles.offset.size(); ++v) {
            row.error = std::max(row.error, (scene[0]->offset(0, v) - scene[1]->offset(0, v)).norm());
        }
        row.error_unit = "m between one and two threads";
        report.add(row);
    }
}

// ---- the largest stable step ----

// Whether a slightly perturbed body stays in place for `steps` steps of about dt.
bool stays(AdvanceScene& s, double dt, uint32_t steps) {
    const Particles start = s.particles;
    std::mt19937 random(3);
    std::uniform_real_distribution<float> shake(-1, 1);
    for (Float4& o : s.particles.offset) {
        if (o.w > 0) o.x += 1e-6f * shake(random), o.y += 1e-6f * shake(random), o.z += 1e-6f * shake(random);
    }
    const uint32_t ticks = std::max(1u, static_cast<uint32_t>(std::lround(steps * dt * 1e3)));
    s.advance(ticks, static_cast<uint32_t>(std::lround(ticks * 1e-3 / dt)));
    bool calm = s.result.nonfinite_particles == 0;
    for (size_t p = 0; p < start.offset.size(); ++p) {
        const Float4 &a = s.particles.offset[p], &b = start.offset[p];
        calm = calm && std::abs(a.x - b.x) + std::abs(a.y - b.y) + std::abs(a.z - b.z) < 1e-3f;
    }
    s.particles = start;
    return calm;
}

// Predicted step limit of an unsupported body, and the largest step at which it stays calm. A run uses
// kStableShare of a shell's limit, kSolidShare of a solid's.
void stability_row(Report& report, const std::string& name, AdvanceScene& s, uint32_t prototype, std::vector<double>& shares) {
    Tissue tissue;
    tissue.damping = 0;
    if (is_solid(s.solids, prototype)) tissue.depth = kNoFoundation;
    s.params.gravity.setZero();
    s.params.account_energy = false;
    s.add_body(prototype, Motion::kDeformable, Vec3d::Zero(), tissue);
    const double predicted = s.bodies.stable_dt[0] / (is_solid(s.solids, prototype) ? kSolidShare : kStableShare);
    double low = 0.9 * predicted, high = 2 * predicted;
    if (!stays(s, low, 3000)) low = 0, high = predicted;
    while (high - low > 0.005 * predicted) {
        const double middle = 0.5 * (low + high);
        (stays(s, middle, 3000) ? low : high) = middle;
    }
    Row row{"limit of the step, " + name, predicted * 1e3, "ms"};
    row.peer = "measured", row.peer_value = low * 1e3;
    report.add(row);
    shares.push_back(predicted / low);
}

void stability_rows(Report& report) {
    report.heading("Predicted limit of the step, and the largest at which the body stays calm (bisection to 0.5 %)");
    std::vector<double> shares;
    for (const bool solid : {false, true}) {
        for (const std::string& name : shape_names()) {
            if (name == "plane" || name == "table") continue;
            AdvanceScene s;
            Mesh mesh = make_shape(name, report.quick() ? 1000 : 4000, 1);
            Prototype made;
            try {
                made = solid ? make_solid(s.meshes, s.springs, s.solids, std::move(mesh), {}, {0, report.quick() ? 6.0 : 10.0})
                             : make_prototype(s.meshes, std::move(mesh), {});
            } catch (const InputError&) {
                continue;  // a sheet, or too thin for the lattice
            }
            if (made.row == kNone) continue;
            if (!solid) add_springs(s.springs, s.meshes, made.row);
            stability_row(report, (solid ? "solid " : "") + name, s, made.row, shares);
        }
    }
    const auto [least, most] = std::minmax_element(shares.begin(), shares.end());
    Row above{"predicted / measured limit of the step, largest of " + std::to_string(shares.size()) + " meshes", *most, ""};
    above.goal = Goal::kLimit, above.at_least = 1, above.aim = 1;
    report.add(above);
    Row below{"measured / predicted limit of the step, largest", 1 / *least, ""};
    below.goal = Goal::kLimit, below.at_least = 1 / 0.8, below.aim = 1 / 0.9;
    below.note = "1.25 is 0.8 the other way round";
    report.add(below);
}

}  // namespace
}  // namespace trocar::bench

// Deformation: deform [rates|threads|stability|errors|sheets|models|laws|boundary] [--quick] [--json FILE] [--cache DIR]
int deform_suite(int argc, char** argv) {
    using namespace trocar::bench;
    Report report("deform", argc, argv);
    std::string cache = "out/bench";  // of references
    for (int i = 1; i + 1 < argc; ++i) {
        if (std::strcmp(argv[i], "--cache") != 0) continue;
        cache = argv[i + 1];
        std::copy(argv + i + 2, argv + argc, argv + i);
        argc -= 2;
    }
    report.check_parts(argc, argv, {"rates", "threads", "stability", "errors", "sheets", "models", "laws", "boundary"});
    const std::string only = argc > 1 ? argv[1] : "";
    const auto wanted = [&](const char* part) { return only.empty() || only == part; };
    if (wanted("rates")) rate_rows(report);
    if (wanted("threads")) thread_rows(report);
    if (wanted("stability")) stability_rows(report);
    if (wanted("errors")) error_rows(report, cache);
    if (wanted("sheets")) sheet_rows(report);
    if (wanted("models")) model_rows(report);
    if (wanted("laws")) law_rows(report);
    if (wanted("boundary")) boundary_rows(report);
    return report.finish();
}
