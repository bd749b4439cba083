#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "systems/app/report/drift.hpp"
namespace trocar {

// Measurements at the end of one episode.
struct Episode {
    double minute = 0;              // min since the start
    double resident = 0, heap = 0;  // MiB
    uint32_t descriptors = 0;
    double median_ms = 0, p99_ms = 0, worst_ms = 0;  // of its passes
    double tick_p99_us = 0;
    double residual_mm = 0;   // mm, deepest overlap at the end of a pass
    double energy_share = 0;  // largest |balance| / largest energy
    uint64_t lost = 0;        // particles restored
    double pass_s = 0;        // all passes together
    uint64_t passes = 0, hash = 0;
    bool with_fault = false;  // a fault was injected that may change the result
    bool of_device = false;   // of a hand's device: nothing else is excused
    double over_force = 0;    // N, by which a force on a hand was above what its device bears
};

struct Soak {
    std::string scene;
    std::vector<Episode> episode;  // the first, then one at regular intervals
    uint64_t episodes = 0, passes = 0, lost = 0;
    std::string broken;                      // the violated rule and its cause; empty = none
    uint64_t faults = 0;                     // faults injected
    std::vector<std::string> faults_wanted;  // injected in turn
    uint32_t threads = 1;
    std::string version;
    double minutes = 0;
    double pass_minutes = 0;  // minutes spent in passes; the rest went to states, hashes and judging
};

// Drifts over the episodes after the warm-up (a minute, or a fifth of a shorter run).
struct Drifts {
    Drift resident, heap, median;  // MiB, MiB, ms
};
Drifts measure_drifts(const Soak& soak);

// What there was too little data for, and how much more is needed.
std::vector<std::string> not_judged(const Soak& soak, const Drifts& drifts);

// Rules that a single episode can break, and rules that need many; see `trocar soak --help`. Set soak.broken.
void judge_episode(const Episode& e, const Episode& first, Soak& soak);
void judge_drifts(const Drifts& drifts, Soak& soak);

}  // namespace trocar
