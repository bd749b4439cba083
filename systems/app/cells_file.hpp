#pragma once
#include <filesystem>

#include "engine/world.hpp"
namespace trocar {

// Writes what the occupancy grid of the last contact pass held, by the ending of the name. .json: the three layers (cell,
// object, primitive) as they are; .vtp: one box a shared cell for ParaView, with its counts of objects and primitives;
// .png: the bodies with the triangles of shared cells in colour, and the cells. World axes and units. Throws InputError
// for another ending, or when the file cannot be written.
void write_cells(const World& world, const std::filesystem::path& path);

}  // namespace trocar
