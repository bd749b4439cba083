#pragma once
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "content/scene/scene_file.hpp"
namespace trocar {

// One key of [vary] and its values, as --set takes them.
struct SweepAxis {
    std::string key;  // "scene", or a key of --set
    std::vector<std::string> values;
};

// A sweep file: a scene, fixed keys and varied keys; every combination is a separate run.
struct SweepFile {
    std::filesystem::path path;
    std::string name, scene;           // scene: file (also relative to the sweep file) or name; may be varied
    double seconds = 0;                // 0 = the scene's
    uint32_t threads = 1;              // of each run
    uint32_t repeat = 1;               // runs per combination
    std::vector<Override> fixed;       // [set]
    std::vector<SweepAxis> axes;       // [vary], in the order of the parsed keys, which TOML sorts
    std::vector<std::string> columns;  // of the table: paths into metrics.json, "contact.total_ms_mean"
};

// Throws InputError "file:line:column: reason".
SweepFile read_sweep_file(const std::filesystem::path& path);

// All combinations: one value per axis, the last axis varying fastest. Without repetitions.
std::vector<std::vector<std::string>> combinations(const SweepFile& sweep);

}  // namespace trocar
