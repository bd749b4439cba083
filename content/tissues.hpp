#pragma once
#include <span>
#include <string>

#include "components/bodies.hpp"
namespace trocar {

// Tissue values by name, for `tissue = "liver"` in a scene; every key can be overridden.
struct TissuePreset {
    const char* name;
    const char* sources;  // of Young's modulus and density; what is not named there is chosen, not measured
    Tissue tissue;
};

// In the order they are listed. Of each preset Young's modulus and density come from the literature named in `sources`.
// Wall, depth and friction are what the shell stands for and the damping what settles within a second: chosen. The volume
// is kept with ten times Young's modulus (soft tissue keeps it as water does, 2 GPa, far beyond an explicit step). Walls
// of hollow organs and sheets bend with Young's modulus; full organs have a bed instead: bending of a wall of 8 mm would
// ask for five times as many steps.
std::span<const TissuePreset> tissue_presets();

// The preset of that name, or nullptr.
const TissuePreset* find_tissue(const std::string& name);

// "liver, kidney, ..."
std::string tissue_names();

}  // namespace trocar
