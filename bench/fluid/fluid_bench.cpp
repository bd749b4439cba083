// Liquids: fluid [--quick] [--json FILE]. Processor time of one thread: a pass of the film on 20,000 wet triangles with its shape, and
// the same wetted area as particles.
#include <numeric>

#include "bench/peers/pbf.hpp"
#include "bench/suites.hpp"
#include "bench/table.hpp"
#include "content/scene/make_prototype.hpp"
#include "content/shapes/shape_library.hpp"
#include "engine/fluid/film_setup.hpp"
#include "engine/fluid/film_shape.hpp"
#include "engine/world/add_body.hpp"

namespace trocar {
namespace {

// A liver, wet all over by 0.3 mm of blood.
struct WetLiver {
    World w;
    FilmShape shape;
    FilmShapeScratch shape_scratch;
    FilmScratch scratch;
    double area = 0;  // m^2
    std::vector<double> start;

    explicit WetLiver(uint32_t triangles) {
        make_prototype(w.meshes, make_shape("liver", triangles), {});
        add_body(w, "liver", 0, Motion::kStatic);
        add_film(w.meshes, 0, 0, {}, w.fluids, w.fluid_state);
        find_shape();
        for (uint32_t v = 0; v < w.meshes.info[0].vertices.count; ++v) {
            const double cell = shape.inverse_area[v] > 0 ? 1 / static_cast<double>(shape.inverse_area[v]) : 0;
            area += cell;
            w.fluid_state.volume[v] = w.fluid_state.blood[v] = 3e-4 * cell;
        }
        start = w.fluid_state.volume;
    }
    void find_shape() { find_film_shape(surfaces_of(w), 0, w.fluids.body[0].cells.count, -Vec3d::UnitZ(), shape_scratch, shape); }
    void pass() {
        find_shape();
        flow_film(w.fluids.params, 9.81, 1.0 / 60, shape, film_of(w.fluids, w.fluid_state, 0), scratch);
    }
};

}  // namespace
}  // namespace trocar

int fluid_suite(int argc, char** argv) {
    using namespace trocar;
    using bench::Goal, bench::Row;
    bench::Report report("fluid", argc, argv);
    report.check_parts(argc, argv, {});
    WetLiver liver(20000);
    constexpr uint32_t kSide = 71;  // 5,041 particles, one layer of 1 mm
    bench::Pbf particles = bench::pbf_layer(kSide, kSide, 1);
    const double particle_area = kSide * kSide * 1e-6;
    const int rounds = report.quick() ? 10 : 60;
    uint32_t steps = 0, passes = 0;
    const auto film = [&] { liver.pass(), steps += liver.scratch.steps, ++passes; };
    const auto pbf = [&] { bench::step_pbf(1.0f / 60, {0, 0, -9.81f}, particles); };
    const std::vector<double> cost = bench::interleaved_medians(rounds, {film, [&] { liver.find_shape(); }, pbf});
    report.heading("film on " + std::to_string(liver.w.meshes.info[0].triangles.count) + " wet triangles, " +
                   std::to_string(static_cast<int>(1e4 * liver.area)) + " cm^2");
    Row row{"a pass of 1/60 s", 1e3 * cost[0], "ms"};
    row.goal = Goal::kLimit, row.at_least = 0.3;
    const auto blocks = static_cast<double>(liver.w.fluid_state.flow.size() / kFilmBlock);
    row.note =
        std::to_string(steps / blocks / passes) + " steps of an edge a pass; of it the shape " + std::to_string(1e3 * cost[1]) + " ms";
    report.add(row);
    Row beside{"per wetted area", 1e6 * cost[0] / (1e4 * liver.area), "us/cm^2"};
    beside.peer = "PBF, 5,041 particles in a layer of 1 mm, 4 iterations";
    beside.peer_value = 1e6 * cost[2] / (1e4 * particle_area);
    beside.goal = Goal::kRatio, beside.at_least = 50;
    report.add(beside);
    return report.finish();
}
