#pragma once
#include <filesystem>

#include "systems/app/station/exercise.hpp"
namespace trocar {

// The ticks of a live.recording as an exercise: a thousand samples a second, in the device's own space and with its forces on the hand;
// names, organs and tissue need the scene. A force counts as a touch. Throws InputError "file: reason".
Exercise read_recorded_exercise(const std::filesystem::path& file);

}  // namespace trocar
