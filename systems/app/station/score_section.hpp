#pragma once
#include <string>

#include "systems/app/station/score.hpp"
namespace trocar {

// Section of report.html: metrics of the run, its phases and events.
std::string score_section(const Exercise& exercise, const Score& score);

}  // namespace trocar
