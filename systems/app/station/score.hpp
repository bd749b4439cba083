#pragma once
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "systems/app/station/exercise.hpp"
namespace trocar {

// A metric: its key in files, unit, what it is, where it is from, and whether less is better.
struct MetricText {
    const char *key, *unit, *text, *source;
    int better;  // 1: more, -1: less, 0: neither is said to be
};
// Metrics of an exercise and of a tool; of an organ.
std::span<const MetricText> tool_metrics();
std::span<const MetricText> organ_metrics();

// Values by the keys of metrics; a key that does not apply is absent.
using MetricValues = std::map<std::string, double>;

struct ScoreOptions {
    double idle_speed = 0.01;              // m/s: slower is idle ...
    double idle_time = 0.5;                // s: ... if it lasts
    std::map<std::string, double> damage;  // N, by name of organ, besides the measured ones (measured_damage)
};

// Everything computed from one exercise.
struct Score {
    MetricValues all;  // of all tools: sums of paths, turns and impulses, means of shares and smoothness, largest forces
    std::vector<MetricValues> tool, organ;  // as Exercise::tool, Exercise::organ
    std::vector<std::pair<ExercisePhase, MetricValues>> phase;
};
Score score_exercise(const Exercise& exercise, const ScoreOptions& options);

// N, tractive force on a suture at which a pig's tissue was damaged visibly, of organs whose name contains fascia, fallopian or bowel
// (Rodrigues et al. 2012, doi 10.1007/s00464-011-1986-5; bowel as cited from it: 1.5 N); 0 for others.
double measured_damage(const std::string& organ);

// The value at quantile q in [0, 1] between order statistics (Hyndman and Fan 1996, definition 7); NaN if there are none.
double quantile_between(std::vector<double> values, double q);

std::string score_json(const Exercise& exercise, const Score& score);
// As text of lines for a terminal.
std::string score_text(const Exercise& exercise, const Score& score);

}  // namespace trocar
