#pragma once
#include <span>
#include <string>

#include "components/bodies.hpp"
namespace trocar {

// Tissue values by name, for `tissue = "liver"` in a scene; every key can be overridden.
struct TissuePreset {
    const char* name;
    const char* sources;  // of Young's modulus and density; values without a source are chosen
    Tissue tissue;
};

// In the order of listing. Young's modulus and density come from the literature named in `sources`. Wall,
// depth and friction (properties of the shell model) are chosen, and so is the damping, which lets motion
// decay within a second. Volume is kept with ten times Young's modulus: real soft tissue is as incompressible
// as water, 2 GPa, far too stiff for explicit steps. Walls of hollow organs and sheets bend with Young's
// modulus. Full organs have an elastic foundation: bending of an 8 mm wall would need five times as many
// steps.
std::span<const TissuePreset> tissue_presets();

// The preset of that name, or nullptr.
const TissuePreset* find_tissue(const std::string& name);

// "liver, kidney, ..."
std::string tissue_names();

}  // namespace trocar
