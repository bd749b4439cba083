#pragma once
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "components/math.hpp"
namespace trocar {

class Frame;

// Where a tool was at the end of a contact pass and what it felt.
struct ToolSample {
    double time = 0;               // s
    uint32_t tool = 0;             // row of the scene's tools
    Vec3d device = Vec3d::Zero();  // m, world
    Vec3d proxy = Vec3d::Zero();   // m, world: centre of the tip, kept outside the surface
    Vec3d force = Vec3d::Zero();   // N, on the hand
    Vec3d torque = Vec3d::Zero();  // N m, on the hand, about the tip
    Vec3d tissue = Vec3d::Zero();  // N, of the tissue on the simulated tool, mean over the pass
    uint32_t contacts = 0;         // surface constraints on the proxy
    double grip = 0;               // rad, of the device
    double grip_torque = 0;        // N m, on the fingers, mean over the pass
};

// Adds a sample of every tool after a pass.
void record_tools(const Frame& frame, std::vector<ToolSample>& samples);

// One line a sample, for spreadsheets; `tools` names them.
std::string tools_csv(std::span<const ToolSample> samples, std::span<const std::string> tools);

// What a tool felt by place: the force along its mean direction over the plane square to that, seen from where the tool
// presses. A cell's value is the mean of the samples in touch around it (Nadaraya 1964 and Watson 1964, Gaussian kernel of
// one cell's width).
struct ForceMap {
    Vec3d normal, right, up;             // unit, world; normal points the way the surface pushes
    double cell = 0;                     // m
    double right_from = 0, up_from = 0;  // m, lower left corner
    uint32_t columns = 0, rows = 0;
    std::vector<double> force;  // N, row by row from below; NaN where the tool never was
};

// Empty when the tool touched less than 30 times or along a line only.
std::optional<ForceMap> force_map(std::span<const ToolSample> samples, uint32_t tool);

// As an <svg> element with its scale.
std::string svg_force_map(const std::string& title, const ForceMap& map);

}  // namespace trocar
