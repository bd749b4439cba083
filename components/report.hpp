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
    double work_hand = 0;     // of hands and scripts, through contact rows
    double work_contact = 0;  // of inelastic impact and friction, <= 0
    double work_damping = 0;  // <= 0
    double work_push = 0;     // of push-out moves
    double work_numeric = 0;  // what implicit steps lost by themselves, what bodies fell asleep or left with
    double work_links = 0;    // what links and springs held as they were made, less what they and removed tissue held as they went
    double balance = 0;       // the sum above - its value at the start
    TROCAR_FIELDS(kinetic, "J", elastic, "J", pressure, "J", bending, "J", links, "J", gravity, "J", work_hand, "J", work_contact, "J",
                  work_damping, "J", work_push, "J", work_numeric, "J", work_links, "J", balance, "J");
};

// What Energy::balance is measured from.
struct EnergyStart {
    bool known = false;
    double sum = 0;  // J, energies less works when the accounts were opened, and the energies of bodies added since
    TROCAR_FIELDS(known, sum, "J");
};

// How what several islands or passes counted becomes one number: a whole number that adds up, or the greatest or least of real ones.
enum class Merge : uint8_t { kSum, kGreatest, kLeast };
// Where a number of the report goes.
inline constexpr uint8_t kStored = 1, kInMetrics = 2, kTrigger = 4, kOnPage = 8;  // captures, metrics.json, --capture counter=, report.html
inline constexpr uint8_t kFigure = kStored | kInMetrics, kEvent = kFigure | kTrigger, kTrouble = kEvent | kOnPage;
inline constexpr uint8_t kLive = kInMetrics | kOnPage;  // of the clock on the wall: no part of the state

// Every number of the report, a line each: all that a new one needs besides the place that counts it.
// PASS: counted by a pass. ISLAND: counted by each island while it is advanced, merged into the report at the end of the pass.
//        merge, name, unit, where it goes, what it says on the page after the number
#define TROCAR_REPORT(PASS, ISLAND)                                                                                                        \
    PASS(kSum, contact_passes, "", kFigure, "contact passes")                                                                              \
    PASS(kSum, contact_events, "", kEvent, "passes with at least one overlapping pair")                                                    \
    PASS(kSum, dropped_contacts, "", kTrouble, "contacts beyond the capacity of a body, the shallowest, were dropped")                     \
    PASS(kSum, oversize_triangles, "", kTrouble, "times a triangle spanned more than 64 cells of the grid and was tested by its box")      \
    PASS(kSum, queries, "", kStored, "closest points that the overlap and the edge pass asked for")                                        \
    PASS(kSum, tie_overflows, "", kTrouble, "closest-point queries met too many equal answers and started again in double")                \
    PASS(kSum, sign_disagreements, "", kTrouble, "signs were settled by the winding number, because a surface had folded over itself")     \
    PASS(kSum, disagreements, "", kTrouble, "signs by pseudonormal differed from the winding number (contact.cross_check)")                \
    ISLAND(kSum, ended_rows, "", kTrouble, "contact planes were left behind by a sliding point")                                           \
    ISLAND(kSum, opposing_planes, "", kTrouble, "vertices at the end of a pass had planes that press from opposite sides")                 \
    ISLAND(kSum, nonfinite_particles, "", kTrouble, "particles were lost and their bodies restored: the simulation broke")                 \
    ISLAND(kGreatest, deepest_residual, "m", kFigure, "deepest overlap at the end of a pass")                                              \
    ISLAND(kLeast, min_volume_ratio, "", kStored,                                                                                          \
           "least signed volume of a tetrahedron / its volume at rest, all substeps so far; infinity without solids")                      \
    ISLAND(kSum, runaway_bodies, "", kTrouble, "times a body was put back because its energy had grown of itself")                         \
    PASS(kSum, awake_bodies, "", kFigure, "deformable bodies that were moved in the last pass")                                            \
    PASS(kSum, asleep_bodies, "", kFigure, "deformable bodies that lay still in the last pass")                                            \
    ISLAND(kSum, implicit_steps, "", kFigure, "steps of bodies by implicit midpoint")                                                      \
    ISLAND(kSum, implicit_iterations, "", kFigure, "iterations of conjugate gradients in all of them")                                     \
    PASS(kSum, links, "", kFigure, "springs between bodies that hold now")                                                                 \
    ISLAND(kSum, broken_links, "", kEvent, "springs between bodies that broke")                                                            \
    ISLAND(kSum, broken_springs, "", kEvent, "springs that broke or went with removed triangles")                                          \
    PASS(kSum, removed_triangles, "", kEvent, "triangles that were cut away")                                                              \
    PASS(kSum, removed_tetrahedra, "", kEvent, "tetrahedra that were cut away")                                                            \
    PASS(kSum, opened_bodies, "", kEvent, "closed surfaces that a cut opened or left without a manifold: inside is what they wind around") \
    ISLAND(kGreatest, worst_implicit_residual, "", kFigure, "largest residual of an implicit step, as Stepping::tolerance")                \
    PASS(kSum, dropped_pictures, "", kLive, "pictures were dropped, because drawing was late")                                             \
    PASS(kSum, late_passes, "", kLive | kTrigger, "contact passes were late")

template <Merge merge>
using ReportValue = std::conditional_t<merge == Merge::kSum, uint64_t, double>;
template <Merge merge>
constexpr ReportValue<merge> kReportStart = static_cast<ReportValue<merge>>(merge == Merge::kLeast ? std::numeric_limits<double>::infinity()
                                                                                                   : 0);

#define TROCAR_NO_NUMBER(...)
#define TROCAR_DECLARE_NUMBER(merge, name, ...) ReportValue<Merge::merge> name = kReportStart<Merge::merge>;

// What happens in a pass neither throws nor prints: it is counted here.
struct Report {
    TROCAR_REPORT(TROCAR_DECLARE_NUMBER, TROCAR_DECLARE_NUMBER)
};
// And here by one island.
struct IslandReport {
    TROCAR_REPORT(TROCAR_NO_NUMBER, TROCAR_DECLARE_NUMBER)
};

// A line of the list above.
struct ReportNumber {
    const char *name, *unit;
    uint8_t where;
    const char* text;
};

// visit(ReportNumber, number) for every number of a report that goes to one of the places in `where`.
template <typename R, typename Visit>
void each_number(R&& report, uint8_t where, const Visit& visit) {
#define TROCAR_VISIT_NUMBER(merge, name, unit, uses, text) \
    if (((uses)&where) != 0) visit(ReportNumber{#name, unit, uses, text}, report.name);
    TROCAR_REPORT(TROCAR_VISIT_NUMBER, TROCAR_VISIT_NUMBER)
#undef TROCAR_VISIT_NUMBER
}

// Merges what an island counted into the report.
inline void add_to_report(const IslandReport& island, Report& report) {
    const auto merge = [](Merge how, auto& sum, auto value) {
        sum = how == Merge::kSum ? sum + value : how == Merge::kGreatest ? std::max(sum, value) : std::min(sum, value);
    };
#define TROCAR_MERGE_NUMBER(how, name, ...) merge(Merge::how, report.name, island.name);
    TROCAR_REPORT(TROCAR_NO_NUMBER, TROCAR_MERGE_NUMBER)
#undef TROCAR_MERGE_NUMBER
}

}  // namespace trocar
