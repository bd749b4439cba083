#pragma once
#include <filesystem>

#include "engine/world/world.hpp"
namespace trocar {

// Writes the occupancy grid of the last contact pass in world axes and units. The file extension selects the
// format: .json, the three layers (cell, object, primitive); .vtp, one box per shared cell with its object
// and primitive counts, for ParaView; .png, the bodies with the triangles of shared cells in colour, and the
// cells. Throws InputError for any other extension or if the file cannot be written.
void write_cells(const World& world, const std::filesystem::path& path);

}  // namespace trocar
