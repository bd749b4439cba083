#include <cmath>
#include <cstdio>

#include "bench/deform/deform.hpp"
#include "content/scene/make_solid.hpp"
#include "tests/reference/embedded_statics.hpp"
#include "tests/systems/advance/advance_scene.hpp"
#include "tests/systems/advance/tissue/heavy_column.hpp"
namespace trocar::bench {
namespace {

using reference::ElasticCase;

enum class Boundary { kStuffed, kSkin, kFilled };

struct Missed {
    reference::StaticsOutcome statics;
    double volume, step;  // of the shape, s
};
Missed miss(const ElasticCase& what, double cells, double nu, Boundary boundary, TissueLaw law) {
    AdvanceScene s;
    const Prototype made = make_solid(s.meshes, s.springs, s.solids, what.shape, {},
                                      {.cells = cells, .skin = boundary != Boundary::kStuffed, .filled = boundary == Boundary::kFilled});
    Tissue tissue;
    tissue.youngs_modulus = reference::kCaseModulus, tissue.poisson = nu, tissue.depth = kNoFoundation, tissue.damping = 0;
    s.bodies.law = {law};
    s.add_body(made.row, Motion::kDeformable, Vec3d::Zero(), tissue);
    double volume = 0;
    for (const Triangle& t : what.shape.triangle)
        volume += what.shape.position[t[0]].dot(what.shape.position[t[1]].cross(what.shape.position[t[2]])) / 6;
    return {reference::load_surface(s.meshes, s.springs, s.solids, made.row, law, nu, what), volume, s.bodies.stable_dt[0]};
}

// `most`: limit of the error at 24 cells, %.
void case_rows(Report& report, const ElasticCase& what, double nu, Boundary boundary, TissueLaw law, double most) {
    constexpr const char* kNames[] = {"stuffed", "stuffed under a skin", "filled"};
    double before = 0;
    for (const double cells : {6.0, 12.0, 24.0}) {
        if (report.quick() && cells > 12) continue;
        const Missed m = miss(what, cells, nu, boundary, law);
        char text[160];
        std::snprintf(text, sizeof text, "%s, nu %.2f, %g cells: %s, %s", what.name.c_str(), nu, cells,
                      kNames[static_cast<size_t>(boundary)], law == TissueLaw::kSprings ? "springs" : "neo-Hookean");
        Row row{text, 100 * m.statics.compliance, "%"};
        if (what.displacement) row.error = 100 * m.statics.off, row.error_unit = "% of the displacement, RMS over the surface";
        std::snprintf(text, sizeof text, "volume %+.2f %%, step %.3g ms", 100 * (m.statics.volume / m.volume - 1), 1e3 * m.step);
        row.note = text;
        if (cells > 6)
            std::snprintf(text, sizeof text, ", order %.2f", std::log2(std::abs(before / m.statics.compliance))), row.note += text;
        before = m.statics.compliance;
        if (boundary == Boundary::kFilled && law == TissueLaw::kNeoHookean && nu < 0.4 && cells > 12) {
            report.add(row);
            Row limit{what.name + ", 24 cells: size of that error", 100 * std::abs(m.statics.compliance), "%"};
            limit.goal = Goal::kLimit, limit.at_least = most, limit.aim = 1;
            row = limit;
        }
        report.add(row);
    }
}

// Curved bodies, contacts, a corner. The flat punch and Cook's membrane have stresses without bound: no mesh of even cells is of second
// order there.
void closed_form_rows(Report& report, double nu) {
    struct Case {
        ElasticCase what;
        double most;
    };
    const Case cases[] = {{reference::blown_sphere(0.02, 0.04, nu, 40), 2.5},
                          {reference::half_space_under_ball(0.02, 0.05, nu, 24), 2.5},
                          {reference::punched_half_space(0.02, 0.05, nu, 24), 6},
                          {reference::cooks_membrane(nu, 40), 1.5}};
    for (const Case& c : cases)
        for (const TissueLaw law : {TissueLaw::kSprings, TissueLaw::kNeoHookean})
            case_rows(report, c.what, nu, Boundary::kFilled, law, c.most);
}

void column_rows(Report& report) {
    for (const double share : {0.15, 0.25}) {
        const HeavyColumn column{share * HeavyColumn::kLength, 0.3};
        const double exact = column.critical_weight();
        double before = 0;
        for (const double cells : {6.0, 12.0, 24.0}) {
            if (report.quick() && cells > 12) continue;
            const double off = column.measured_weight(cells, TissueLaw::kNeoHookean) / exact - 1;
            char text[160];
            std::snprintf(text, sizeof text, "column under its own weight buckles (Greenhill), width %g of its length, nu 0.30, %g cells",
                          share, cells);
            Row row{text, 100 * off, "%"};
            std::snprintf(text, sizeof text, "of %.4g N/m, %.1f cells wide", exact, share * cells);
            row.note = text;
            if (cells > 6) std::snprintf(text, sizeof text, ", order %.2f", std::log2(std::abs(before / off))), row.note += text;
            before = off;
            report.add(row);
        }
    }
}

}  // namespace

void boundary_rows(Report& report) {
    report.heading("Solids cut from a lattice against exact solutions: work of the loads against theirs (positive: too soft)");
    const Vec3d bar(0.031, 0.029, 0.103), block(0.083, 0.071, 0.09);
    for (const double nu : {0.3, 0.45, 0.49}) {
        for (const ElasticCase& what :
             {reference::pulled_bar(bar, nu, 0, 72), reference::bent_bar(bar, nu, 0, 72), reference::block_under_weight(block, nu, 0, 48),
              reference::twisted_cylinder(0.021, 0.09, nu, 0, 48)}) {
            for (const Boundary boundary : {Boundary::kStuffed, Boundary::kSkin, Boundary::kFilled}) {
                if (nu != 0.3 && boundary != Boundary::kFilled) continue;
                for (const TissueLaw law : {TissueLaw::kSprings, TissueLaw::kNeoHookean}) case_rows(report, what, nu, boundary, law, 1.5);
            }
        }
        closed_form_rows(report, nu);
    }
    report.heading("Load at which a column buckles (positive: too stiff)");
    column_rows(report);
}

}  // namespace trocar::bench
