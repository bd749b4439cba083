#pragma once
#include <optional>
#include <string>
#include <string_view>

#include "engine/files/capture_file.hpp"
#include "engine/world/world.hpp"
namespace trocar {

// One array or number of World where it lies in memory: rows x columns elements, row-major, without gaps. Names
// are those of captures: "particles.offset", "energy.kinetic".
struct WorldArray {
    std::string name;
    std::string_view unit;  // as in TROCAR_FIELDS; empty without one
    Resource resource = Resource::kCount;
    ArrayType type = ArrayType::kU8;
    uint64_t rows = 0;
    uint32_t columns = 1;
    const void* data = nullptr;
    bool fixed = false;  // neither address nor size changes while the world runs
};

// Visits every array and number with plain elements, in the order of captures. Structs with arrays or text of
// their own inside (tools, link groups, materials) are left out.
void each_array(const World& world, void (*visit)(void* user, const WorldArray& array), void* user);
// The one of that name; nullopt if there is none.
std::optional<WorldArray> find_array(const World& world, std::string_view name);

}  // namespace trocar
