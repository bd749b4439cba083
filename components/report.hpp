#pragma once
#include <algorithm>
#include <cstdint>
#include <limits>
#include <type_traits>

#include "components/fields.hpp"
namespace trocar {

// Energy of all deformable and free rigid bodies and the work done on them since the start. J.
// Balance: kinetic + elastic + pressure + bending + links + gravity - all work_* = its value at the start.
struct Energy {
    double kinetic = 0;
    double elastic = 0;       // springs, anchors and volumes of tetrahedra
    double pressure = 0;      // of enclosed volumes
    double bending = 0;       // of surfaces
    double links = 0;         // of springs between bodies
    double gravity = 0;       // potential
    double work_hand = 0;     // of hands and scripts, through contact constraints
    double work_contact = 0;  // of inelastic impact and friction, <= 0
    double work_damping = 0;  // <= 0
    double work_push = 0;     // of position correction
    double work_numeric = 0;  // lost by implicit steps, and energy of bodies when they fell asleep or were removed
    double work_links = 0;    // energy of links and springs when made, less that of links, springs and removed tissue at their removal
    double work_cuts = 0;     // of hands on the new surfaces of cuts, toughness times area, <= 0
    double balance = 0;       // the sum above minus its initial value
    TROCAR_FIELDS(kinetic, "J", elastic, "J", pressure, "J", bending, "J", links, "J", gravity, "J", work_hand, "J", work_contact, "J",
                  work_damping, "J", work_push, "J", work_numeric, "J", work_links, "J", work_cuts, "J", balance, "J");
};

// Reference of Energy::balance.
struct EnergyStart {
    bool known = false;
    double sum = 0;  // J, energies minus work at the start, plus the energies of bodies added since
    TROCAR_FIELDS(known, sum, "J");
};

// How the values of several islands or passes are merged: the sum of integers, or the greatest or least of reals.
enum class Merge : uint8_t { kSum, kGreatest, kLeast };
// Destinations of a number of the report.
inline constexpr uint8_t kStored = 1, kInMetrics = 2, kTrigger = 4, kOnPage = 8;  // captures, metrics.json, --capture counter=, report.html
inline constexpr uint8_t kFigure = kStored | kInMetrics, kEvent = kFigure | kTrigger, kTrouble = kEvent | kOnPage;
inline constexpr uint8_t kOfRun = kInMetrics | kOnPage;  // counted by the run, not by its passes: not part of the state

// Every number of the report, one per line: a new one needs only a line here and the code that counts it.
// PASS: counted by a pass. ISLAND: counted by each island while it is advanced, merged into the report at the end of the pass.
//        merge, name, unit, destinations, text after the number in report.html
#define TROCAR_REPORT(PASS, ISLAND)                                                                                                    \
    PASS(kSum, contact_passes, "", kFigure, "contact passes")                                                                          \
    PASS(kSum, contact_events, "", kEvent, "passes with at least one overlapping pair")                                                \
    PASS(kSum, dropped_contacts, "", kTrouble, "contacts beyond the capacity of a body, the shallowest, were dropped")                 \
    PASS(kSum, oversize_triangles, "", kTrouble, "times a triangle spanned more than 64 cells of the grid and was tested by its box")  \
    PASS(kSum, unswept_bodies, "", kFigure, "times a soft or scripted body moved farther in a pass than contacts look ahead")          \
    PASS(kSum, deferred_pairs, "", kTrouble, "times a pair of free bodies was left to a later pass at the bound on work")              \
    PASS(kSum, queries, "", kStored, "closest-point queries of the overlap and edge stages")                                           \
    PASS(kSum, tie_overflows, "", kTrouble, "closest-point queries met too many ties and were repeated in double")                     \
    PASS(kSum, sign_disagreements, "", kTrouble, "signs were settled by the winding number, because a surface had folded over itself") \
    PASS(kSum, disagreements, "", kTrouble, "signs by pseudonormal differed from the winding number (contact.cross_check)")            \
    ISLAND(kSum, expired_constraints, "", kTrouble, "contact constraints expired: their points slid off the triangle")                 \
    ISLAND(kSum, unsolved_substeps, "", kTrouble, "substeps stopped solving contacts of free bodies at the bound on work")             \
    ISLAND(kSum, opposing_planes, "", kTrouble, "vertices at the end of a pass had planes that press from opposite sides")             \
    ISLAND(kSum, nonfinite_particles, "", kTrouble, "particles became non-finite and their bodies were restored")                      \
    ISLAND(kGreatest, deepest_residual, "m", kFigure, "deepest overlap at the end of a pass")                                          \
    ISLAND(kLeast, min_volume_ratio, "", kStored,                                                                                      \
           "least signed volume of a tetrahedron / its volume at rest, all substeps so far; infinity without solids")                  \
    ISLAND(kSum, inverted_tetrahedra, "", kTrouble, "times a tetrahedron was inside out at the end of a pass")                         \
    PASS(kSum, self_crossings, "", kTrouble, "pairs of faces of one body crossed at the end of a displayed frame, at most")            \
    PASS(kSum, self_contacts, "", kFigure, "contact constraints of surfaces with themselves and of two sheets, sum over passes")       \
    PASS(kSum, turned_sides, "", kTrouble, "times parts of one surface, or two sheets, were found on the wrong side of each other")    \
    PASS(kSum, held_vertices, "", kTrouble, "times a vertex was held back at the end of a pass, where its surface would have crossed")  \
    PASS(kSum, untangled_edges, "", kTrouble, "times an edge was moved out of a face that it crossed")                                 \
    ISLAND(kSum, short_steps, "", kTrouble, "steps shorter than 0.02 ms")                                                              \
    ISLAND(kSum, runaway_bodies, "", kTrouble, "times a body was restored because its energy had grown spontaneously")                 \
    PASS(kSum, awake_bodies, "", kFigure, "deformable bodies that were moved in the last pass")                                        \
    PASS(kSum, asleep_bodies, "", kFigure, "deformable bodies that slept in the last pass")                                            \
    ISLAND(kSum, implicit_steps, "", kFigure, "steps of bodies by backward Euler")                                                     \
    ISLAND(kSum, implicit_iterations, "", kFigure, "iterations in all of them")                                                        \
    PASS(kSum, tools_inside, "", kTrouble, "times a tool was found inside a body, which let it go until it was pushed out")            \
    PASS(kSum, passed_surfaces, "", kTrouble, "times a tool went through the surface of a deformable body")                            \
    PASS(kSum, links, "", kFigure, "springs between bodies that hold now")                                                             \
    ISLAND(kSum, broken_links, "", kEvent, "springs between bodies that broke")                                                        \
    ISLAND(kSum, broken_springs, "", kEvent, "springs that broke or went with removed triangles")                                      \
    PASS(kSum, removed_triangles, "", kEvent, "triangles that were cut away")                                                          \
    PASS(kSum, removed_tetrahedra, "", kEvent, "tetrahedra that were cut away")                                                        \
    PASS(kSum, opened_bodies, "", kEvent, "closed surfaces that a cut opened or made non-manifold: inside by winding number")          \
    ISLAND(kGreatest, worst_implicit_residual, "", kFigure, "largest change left by an implicit step, as Stepping::tolerance")         \
    PASS(kSum, start_overlaps, "", kOfRun, "pairs of bodies started more than 1 % of the smaller one inside each other")               \
    PASS(kSum, left_overlaps, "", kOfRun, "pairs of bodies were left more than 2 % of the smaller one inside each other")              \
    PASS(kSum, unearned_energy, "", kOfRun, "pictures with more energy, or work of contact or numerics, than had entered the scene")   \
    PASS(kSum, dropped_pictures, "", kOfRun, "pictures were dropped, because drawing was late")                                        \
    PASS(kSum, late_passes, "", kOfRun | kTrigger, "contact passes were late")

template <Merge merge>
using ReportValue = std::conditional_t<merge == Merge::kSum, uint64_t, double>;
template <Merge merge>
constexpr ReportValue<merge> kReportStart = static_cast<ReportValue<merge>>(merge == Merge::kLeast ? std::numeric_limits<double>::infinity()
                                                                                                   : 0);

#define TROCAR_NO_NUMBER(...)
#define TROCAR_DECLARE_NUMBER(merge, name, ...) ReportValue<Merge::merge> name = kReportStart<Merge::merge>;

// A pass neither throws nor prints; its events are counted here.
struct Report {
    TROCAR_REPORT(TROCAR_DECLARE_NUMBER, TROCAR_DECLARE_NUMBER)
};
// The same, of one island.
struct IslandReport {
    TROCAR_REPORT(TROCAR_NO_NUMBER, TROCAR_DECLARE_NUMBER)
};

// A line of the list above.
struct ReportNumber {
    const char *name, *unit;
    uint8_t where;
    const char* text;
};

// visit(ReportNumber, number) for every number of a report with a destination in `where`.
template <typename R, typename Visit>
void each_number(R&& report, uint8_t where, const Visit& visit) {
#define TROCAR_VISIT_NUMBER(merge, name, unit, uses, text) \
    if (((uses)&where) != 0) visit(ReportNumber{#name, unit, uses, text}, report.name);
    TROCAR_REPORT(TROCAR_VISIT_NUMBER, TROCAR_VISIT_NUMBER)
#undef TROCAR_VISIT_NUMBER
}

// Merges an island's counts into the report.
inline void add_to_report(const IslandReport& island, Report& report) {
    const auto merge = [](Merge how, auto& sum, auto value) {
        sum = how == Merge::kSum ? sum + value : how == Merge::kGreatest ? std::max(sum, value) : std::min(sum, value);
    };
#define TROCAR_MERGE_NUMBER(how, name, ...) merge(Merge::how, report.name, island.name);
    TROCAR_REPORT(TROCAR_NO_NUMBER, TROCAR_MERGE_NUMBER)
#undef TROCAR_MERGE_NUMBER
}

}  // namespace trocar
