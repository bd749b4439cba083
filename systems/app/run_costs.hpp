#pragma once
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "systems/app/figures.hpp"
#include "systems/app/report_page.hpp"
#include "systems/frame.hpp"
namespace trocar {

// Takes the times of a pass into the figures: every stage, and what its pairs of bodies took of detection. A pair's part is
// that of its candidate vertices (those near the other body, on both sides) among all of the pass.
class CostMeter {
 public:
    void add(const Frame& frame, RunFigures& figures);
    void finish(const Frame& frame, RunFigures& figures) const;  // writes figures.pair, dearest first

 private:
    std::map<uint64_t, PairFigures> pairs_;  // by both bodies
};

// The pairs of the newest pass that had candidate vertices.
struct PairCost {
    uint32_t a, b, vertices;
    double share;  // of detection
};
std::vector<PairCost> pair_costs(const World& w);

// Spans of the pairs of the newest pass, one after the other below its detection, as the thread kPairTrack; those that took
// less than 20 us are left out. `names` remembers what the trace keeps.
inline constexpr uint32_t kPairTrack = 1000;
void trace_pairs(const Frame& frame, std::map<uint64_t, std::string_view>& names, Trace& trace);

// Rows of figures.pass, the slowest first; the first `skip` passes, which pay for memory and caches, are no news.
std::vector<size_t> worst_passes(const RunFigures& figures, size_t count, size_t skip = 4);

// Number of the picture that shows a pass.
size_t picture_of_pass(const RunFigures& figures, size_t pass);

// Sections of report.html: timeline of stage costs, histogram of frames, the worst passes with their pictures, a meter per
// pair. media.worst holds the pictures of worst_passes in their order.
std::string cost_sections(const RunFigures& figures, const ReportMedia& media);

// Writes a trace, and on standard error how much of it there was no room for.
void write_trace(const std::filesystem::path& file, const Trace& trace, const std::vector<std::string>& thread_names);

}  // namespace trocar
