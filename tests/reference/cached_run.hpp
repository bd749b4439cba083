#pragma once
#include <filesystem>
#include <functional>
#include <string>

#include "tests/reference/leapfrog_double.hpp"
namespace trocar::reference {

// Positions of all points (m), frame by frame.
using Frames = std::vector<std::vector<Vec3d>>;

// A body hanging under a varying weight: a frame is stored every `steps` steps of dt.
struct Run {
    std::string name;  // of the file
    DoubleBody body;
    double dt = 0;  // s
    uint32_t steps = 1, frames = 0;
    std::function<double(double time)> weight;  // m/s^2, along -z
};

// The frames of a run. They are cached in folder/name_PARAMETERS.frames, where PARAMETERS is a hash of all
// inputs of the run, weights included. If the file is missing or its own hash does not match, they are
// computed and the file is written. An empty folder disables the cache. `worked_out` may be null.
Frames cached_frames(const std::filesystem::path& folder, const Run& run, bool* worked_out = nullptr);

}  // namespace trocar::reference
