#pragma once
#include <filesystem>

#include "systems/app/station/exercise.hpp"
namespace trocar {

// What `trocar score`, `compare` and `exercise` take: a run's folder, or an exercise.csv, tools.csv or live.recording. Of a folder the
// first of these that is there. Throws InputError "file:line: reason".
Exercise read_run(const std::filesystem::path& run);

}  // namespace trocar
