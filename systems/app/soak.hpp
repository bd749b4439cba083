#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "systems/app/drift.hpp"
namespace trocar {

// What was seen at the end of one episode.
struct Episode {
    double minute = 0;              // since the start
    double resident = 0, heap = 0;  // MiB
    uint32_t descriptors = 0;
    double median_ms = 0, p99_ms = 0, worst_ms = 0;  // of its passes
    double tick_p99_us = 0;
    double residual_mm = 0;   // deepest overlap at the end of a pass
    double energy_share = 0;  // largest |balance| / largest energy
    uint64_t lost = 0;        // particles restored
    double pass_s = 0;        // all passes together
    uint64_t passes = 0, hash = 0;
    bool with_fault = false;  // that may change how it ends
};

struct Soak {
    std::string scene;
    std::vector<Episode> episode;  // the first, and one every so often
    uint64_t episodes = 0, passes = 0, lost = 0;
    std::string broken;                      // the rule that broke and why; empty = none
    uint64_t faults = 0;                     // put in
    std::vector<std::string> faults_wanted;  // put in one after the other
    uint32_t threads = 1;
    std::string version;
    double minutes = 0;
    double pass_minutes = 0;  // of these in passes; the rest in states, hashes and judging
};

// Medians and intervals over the episodes after the warm-up: a minute, or a fifth of a shorter run.
struct Drifts {
    Drift resident, heap, median;  // MiB, MiB, ms
};
Drifts measure_drifts(const Soak& soak);

// What there was too little of, and what more it takes.
std::vector<std::string> not_judged(const Soak& soak, const Drifts& drifts);

// Rules that one episode can break by itself, and those that only many can; see `trocar soak --help`. Set soak.broken.
void judge_episode(const Episode& e, const Episode& first, Soak& soak);
void judge_drifts(const Drifts& drifts, Soak& soak);

}  // namespace trocar
