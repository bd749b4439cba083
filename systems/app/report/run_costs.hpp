#pragma once
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "systems/app/report/figures.hpp"
#include "systems/app/report/report_page.hpp"
#include "systems/frame/frame.hpp"
namespace trocar {

// Adds the times of a pass to the figures: every stage, and each pair's part of detection. The pair's part is
// its share of the pass's candidate vertices (those near the other body, on both bodies).
class CostMeter {
 public:
    void add(const Frame& frame, RunFigures& figures);
    void finish(const Frame& frame, RunFigures& figures) const;  // writes figures.pair, most expensive first

 private:
    std::map<uint64_t, PairFigures> pairs_;  // key: both body indices
};

// The pairs of the last pass that had candidate vertices.
struct PairCost {
    uint32_t a, b, vertices;
    double share;  // of the detection time
};
std::vector<PairCost> pair_costs(const World& w);

// Writes spans for the pairs of the last pass under its detection, one after the other, as thread kPairTrack;
// pairs below 20 us are left out. `names` owns the strings that the trace refers to.
inline constexpr uint32_t kPairTrack = 1000, kPassTrack = 1001;
void trace_pairs(const Frame& frame, std::map<uint64_t, std::string_view>& names, Trace& trace);

// Indices into figures.pass, slowest first; skips the first `skip` passes (cold memory and caches).
std::vector<size_t> worst_passes(const RunFigures& figures, size_t count, size_t skip = 4);

// Index of the picture that shows a pass.
size_t picture_of_pass(const RunFigures& figures, size_t pass);

// Sections of report.html: timeline of stage costs, histogram of frames, the slowest passes with pictures, a
// bar per pair. media.worst holds the pictures of worst_passes in the same order.
std::string cost_sections(const RunFigures& figures, const ReportMedia& media);

// Writes a trace; with figures also counters over time (contacts, depth, force on the hand, resident memory grown) and a track of passes,
// each with its number and figures as arguments. Prints on standard error how much of it did not fit.
void write_trace(const std::filesystem::path& file, const Trace& trace, const std::vector<std::string>& thread_names,
                 const RunFigures* figures = nullptr);
// The events that `figures` add, each after a comma.
std::string pass_events(const Trace& trace, const RunFigures& figures);

}  // namespace trocar
