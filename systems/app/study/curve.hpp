#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "content/scene/scene_file.hpp"
namespace trocar {

// Force on a tool over time, or over how deep its tip is below the undeformed surfaces.
struct ForceCurve {
    bool by_depth = false;
    std::vector<double> at;     // s or m, ascending
    std::vector<double> force;  // N
};

// Reads a CSV with the columns force_n and either time_s or depth_m; others are passed over. Throws InputError "file:line: reason".
ForceCurve read_curve(const std::filesystem::path& file);

// Runs a scene in lockstep on the calling thread for `seconds` and returns the force of the tissue on a tool, the mean of each
// contact pass, at the middle of the pass. By depth (3 degrees of freedom): while the tip goes deeper than ever before.
ForceCurve simulate_curve(const SceneFile& scene, const std::string& tool, bool by_depth, double seconds);

// The force of a simulated curve where another one has its points: linear in between. Throws InputError if it does not reach them.
std::vector<double> force_at(const ForceCurve& simulated, const std::vector<double>& at);

}  // namespace trocar
