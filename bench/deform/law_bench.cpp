#include <cstdio>

#include "bench/deform/deform.hpp"
#include "content/scene/make_solid.hpp"
#include "content/shapes/shape_library.hpp"
#include "tests/systems/advance/tissue/law_block.hpp"
namespace trocar::bench {
namespace {

constexpr double kE = 1e4;  // Pa

const char* name_of(TissueLaw law) { return law == TissueLaw::kSprings ? "springs" : "neo-Hookean"; }

// How far the engine is from a closed form of the neo-Hookean law; only that law is judged by it.
void add_error(Report& report, const std::string& closed_form, TissueLaw law, double measured, double exact, double at_least, double aim) {
    Row row{closed_form + ": " + name_of(law), 100 * (measured / exact - 1), "%"};
    row.error = 100 * std::abs(measured / exact - 1), row.error_unit = "% of " + std::to_string(exact) + " Pa";
    report.add(row);
    if (law != TissueLaw::kNeoHookean) return;
    Row limit{closed_form + ": size of that error", 100 * std::abs(measured / exact - 1), "%"};
    limit.goal = Goal::kLimit, limit.at_least = at_least, limit.aim = aim;
    report.add(limit);
}

void stress_rows(Report& report, double nu) {
    const NeoHookeanLaw exact(kE, nu);
    for (const TissueLaw law : {TissueLaw::kSprings, TissueLaw::kNeoHookean}) {
        LawBlock block(law, {}, kE, nu, report.quick() ? 4 : 8);
        char text[80];
        for (const double along : {0.6, 0.8, 0.9, 1.1, 1.2, 1.4}) {
            std::snprintf(text, sizeof text, "uniaxial stretch %.1f, nu %.2f", along, nu);
            const double across = exact.across(along);
            add_error(report, text, law, block.pull(along).stress, exact.stress(Eigen::Vector3d(along, across, across).asDiagonal())(0, 0),
                      1, 0.2);
        }
        for (const double by : {0.1, 0.2, 0.4}) {
            std::snprintf(text, sizeof text, "simple shear %.1f, nu %.2f", by, nu);
            const Eigen::Matrix3d f = block.sheared(by);
            add_error(report, text, law, block.stress(f)(0, 1), exact.stress(f)(0, 1), 1, 0.2);
        }
    }
}

void relaxation_rows(Report& report) {
    const Prony prony{{0.8, 0.5}, {0.05, 0.6}};
    for (const TissueLaw law : {TissueLaw::kSprings, TissueLaw::kNeoHookean}) {
        for (const double omega : {2.0, 20.0, 100.0}) {
            const auto [storage, loss] = storage_and_loss(prony, omega);
            const auto [measured, lost] = measured_storage_and_loss(law, prony, omega);
            char text[80];
            const auto add = [&](const char* what, double value, double right) {
                std::snprintf(text, sizeof text, "%s modulus at %.0f rad/s: %s", what, omega, name_of(law));
                Row row{text, 100 * std::abs(value / right - 1), "%"};
                row.goal = Goal::kLimit, row.at_least = 0.5, row.aim = 0.1;
                report.add(row);
            };
            add("storage", measured, storage);
            add("loss", lost, loss);
        }
    }
}

// Time of a tetrahedron in a step, all of them in turn on the same organ.
void cost_rows(Report& report) {
    struct Kind {
        const char* name;
        TissueLaw law;
        Prony prony;
    };
    const Kind kinds[] = {{"springs", TissueLaw::kSprings, {}},
                          {"neo-Hookean", TissueLaw::kNeoHookean, {}},
                          {"springs, two relaxation times", TissueLaw::kSprings, {{0.4, 0.3}, {0.05, 0.6}}},
                          {"neo-Hookean, two relaxation times", TissueLaw::kNeoHookean, {{0.4, 0.3}, {0.05, 0.6}}}};
    std::vector<std::unique_ptr<AdvanceScene>> scenes;
    for (const Kind& kind : kinds) {
        AdvanceScene& s = *scenes.emplace_back(std::make_unique<AdvanceScene>());
        const Prototype made = make_solid(s.meshes, s.springs, s.solids, make_shape("liver", 10000, 1), {}, {.cells = 24, .skin = true});
        Tissue tissue;
        tissue.depth = kNoFoundation;
        s.bodies.law = {kind.law}, s.bodies.prony = {kind.prony};
        s.params.gravity.setZero();
        s.params.account_energy = false;
        s.add_body(made.row, Motion::kDeformable, Vec3d::Zero(), tissue);
    }
    constexpr uint32_t kSteps = 16;
    double least[4] = {1e9, 1e9, 1e9, 1e9};
    for (int turn = 0; turn < (report.quick() ? 20 : 100); ++turn) {
        for (int k = 0; k < 4; ++k) {
            const double start = thread_seconds();
            scenes[k]->advance(1, kSteps);
            least[k] = std::min(least[k], thread_seconds() - start);
        }
    }
    for (int k = 0; k < 4; ++k) {
        const double tets = scenes[k]->solids.info[0].count;
        Row row{std::string("step of a tetrahedron, ") + kinds[k].name, 1e9 * least[k] / (kSteps * tets), "ns"};
        row.note = std::to_string(scenes[k]->solids.info[0].count) + " tetrahedra, " +
                   std::to_string(scenes[k]->solids.info[0].nodes.count) + " nodes; stable step " +
                   std::to_string(1e3 * scenes[k]->bodies.stable_dt[0]) + " ms";
        if (k > 0) row.peer = "springs", row.peer_value = 1e9 * least[0] / (kSteps * tets);
        report.add(row);
    }
}

}  // namespace

void law_rows(Report& report) {
    report.heading("Laws of solids against closed forms of the neo-Hookean law, through the engine's steps");
    for (const double nu : {0.3, 0.45, 0.49}) stress_rows(report, nu);
    report.heading("Relaxation against the Prony series");
    relaxation_rows(report);
    report.heading("Cost of the laws");
    cost_rows(report);
}

}  // namespace trocar::bench
