#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "systems/app/station/exercise.hpp"
#include "systems/app/station/score.hpp"
#include "systems/app/station/statistics.hpp"
namespace trocar {

// One run among those compared.
struct ComparedRun {
    std::string name;  // as on the page
    Exercise exercise;
    Score score;
    std::string group, subject;  // of the cohort; empty if not stated
    double trial = 0;            // number of the subject's attempt; 0 = not stated
};

// A line of a cohort file: columns run (a path, relative to the file), and any of group, subject, trial.
struct CohortLine {
    std::filesystem::path run;
    std::string group, subject;
    double trial = 0;
};
std::vector<CohortLine> read_cohort(const std::filesystem::path& file);

// One run's time axis warped onto that of another.
struct Alignment {
    std::vector<double> time, other;  // s: at time[i] of the first run the other one is where it was at other[i]
    bool by_phases = false;           // both have the same phases, which were aligned one by one
    double distance = 0;              // m, RMS between the tips at aligned times
    double raw_distance = 0;          // m, the same at equal times, as long as both last
};
// Phases by their events, then dynamic time warping of tip positions and forces on the hand of the tools that both have, places divided by
// their standard deviation over both runs, forces by that of each run, at most 600 samples a phase.
Alignment align_runs(const Exercise& a, const Exercise& b);

// Value of a signal of a tool at a time, linear between samples.
struct Signal {
    std::vector<double> time, value;
    double at(double t) const;
};
Signal force_signal(const Exercise& exercise, uint32_t tool);  // N, on the hand
Signal speed_signal(const Exercise& exercise, uint32_t tool);  // m/s, smoothed to 10 Hz

// One metric over the runs of two groups, or of all.
struct MetricSummary {
    std::string key, unit;
    std::vector<std::array<double, 3>> quartiles;  // per group: first, median, third
    Interval area;                                 // that a run of the first group has a greater value than one of the second
    Interval reliability;                          // ICC(2,1) of subjects over their common trials
    PowerLaw learning;                             // of the medians over trials
    std::vector<double> trial, median;             // learning curve
};
struct Cohort {
    std::vector<std::string> group;
    std::vector<size_t> count;  // runs, per group
    std::vector<MetricSummary> metric;
    size_t subjects = 0, trials = 0;  // that the reliability is of
};
Cohort summarise_cohort(const std::vector<ComparedRun>& runs);

// Times of one stage in two runs.
struct StageComparison {
    std::string stage;
    double a_ms = 0, b_ms = 0;  // mean per pass
    double ratio = 1;           // geometric mean over the blocks of b / a
    double p = 1;               // of the signed-rank test over blocks, corrected by Holm over the stages
};
// Stage by stage by stages.csv of both folders (passes.csv where one has none): passes that both made are cut into `blocks` of
// consecutive ones, because times of neighbouring passes depend on each other, and the blocks' logarithmic ratios are tested. Empty if
// they have fewer than three passes a block in common.
inline constexpr size_t kTimeBlocks = 20;
std::vector<StageComparison> compare_times(const std::filesystem::path& a, const std::filesystem::path& b);

// The page; `stages` may be empty.
std::string comparison_html(const std::vector<ComparedRun>& runs, const Cohort& cohort, const std::vector<Alignment>& alignments,
                            const std::vector<StageComparison>& stages);
// Metrics side by side for a terminal.
std::string comparison_text(const std::vector<ComparedRun>& runs, const std::vector<Alignment>& alignments,
                            const std::vector<StageComparison>& stages);
std::string comparison_json(const std::vector<ComparedRun>& runs, const Cohort& cohort, const std::vector<Alignment>& alignments,
                            const std::vector<StageComparison>& stages);

}  // namespace trocar
