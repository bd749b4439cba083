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
    uint64_t passes = 0, hash = 0;
    bool with_fault = false;  // that may change how it ends
};

struct Soak {
    std::string scene;
    std::vector<Episode> episode;  // the first, and one every so often
    uint64_t episodes = 0, passes = 0, lost = 0;
    std::string broken;   // the rule that broke and why; empty = none
    uint64_t faults = 0;  // put in
    bool faults_wanted = false;
    double minutes = 0;
};

// Medians and intervals over the episodes after the warm-up: a minute, or a fifth of a shorter run.
struct Drifts {
    Drift resident, heap, median;  // MiB, MiB, ms
};
Drifts measure_drifts(const Soak& soak);

// Rules that one episode can break by itself, and those that only many can; see `trocar soak --help`. Set soak.broken.
void judge_episode(const Episode& e, const Episode& first, Soak& soak);
void judge_drifts(const Drifts& drifts, Soak& soak);

}  // namespace trocar
