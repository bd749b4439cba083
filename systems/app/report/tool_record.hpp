#pragma once
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "components/math.hpp"
namespace trocar {

class Frame;

// Position of a tool at the end of a contact pass, and the forces on it.
struct ToolSample {
    double time = 0;               // s
    uint32_t tool = 0;             // index into the scene's tools
    Vec3d device = Vec3d::Zero();  // m, world
    Vec3d proxy = Vec3d::Zero();   // m, world: centre of the tip, kept outside the surface
    Vec3d force = Vec3d::Zero();   // N, on the hand
    Vec3d torque = Vec3d::Zero();  // N m, on the hand, about the tip
    Vec3d tissue = Vec3d::Zero();  // N, of tissue on the simulated tool, contacts and links, mean over the pass
    uint32_t contacts = 0;         // surface constraints on the proxy
    double grip = 0;               // rad, jaw angle of the device
    double grip_torque = 0;        // N m, on the fingers, mean over the pass
};

// Adds a sample of every tool after a pass.
void record_tools(const Frame& frame, std::vector<ToolSample>& samples);

// CSV with one line per sample; `tools` has their names.
std::string tools_csv(std::span<const ToolSample> samples, std::span<const std::string> tools);

// Force by position: the force along its mean direction, over the plane perpendicular to it, seen from the
// side of the tool. A cell's value is the Nadaraya-Watson mean of the samples in contact around it (Nadaraya
// 1964, Watson 1964; Gaussian kernel, width one cell).
struct ForceMap {
    Vec3d normal, right, up;             // unit, world; normal points in the direction of the surface's force
    double cell = 0;                     // m
    double right_from = 0, up_from = 0;  // m, lower left corner
    uint32_t columns = 0, rows = 0;
    std::vector<double> force;  // N, row by row from below; NaN where the tool never was
};

// Nullopt if the tool was in contact for fewer than 30 samples or only along a line.
std::optional<ForceMap> force_map(std::span<const ToolSample> samples, uint32_t tool);

// As an <svg> element with a colour scale.
std::string svg_force_map(const std::string& title, const ForceMap& map);

}  // namespace trocar
