#pragma once
#include <string>

#include "systems/app/station/exercise.hpp"
namespace trocar {

// The exercise as an MCAP file (mcap.dev/spec): a JSON channel with its schema per tool ("/tool/NAME": the columns of exercise.csv) and one
// of events ("/events"), in chunks without compression, with checksums, message indices, statistics and a summary. Times in nanoseconds.
std::string exercise_mcap(const Exercise& exercise);

}  // namespace trocar
