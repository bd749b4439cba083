#pragma once
#include <filesystem>
#include <functional>
#include <string>

#include "tests/reference/leapfrog_double.hpp"
namespace trocar::reference {

// Places of all points (m), frame by frame.
using Frames = std::vector<std::vector<Vec3d>>;

// A body hanging under a weight that changes: frames are taken every `steps` steps of dt.
struct Run {
    std::string name;  // of the file
    DoubleBody body;
    double dt = 0;  // s
    uint32_t steps = 1, frames = 0;
    std::function<double(double time)> weight;  // m/s^2, along -z
};

// The frames of a run. They are kept in folder/name_PARAMETERS.frames, where PARAMETERS is a hash of all that goes into
// the run, weights included, and read back from there when the file's own hash says that it is whole; else they are worked
// out anew and the file is written. An empty folder keeps nothing. `worked_out` may be null.
Frames cached_frames(const std::filesystem::path& folder, const Run& run, bool* worked_out = nullptr);

}  // namespace trocar::reference
