#pragma once
#include <cstdint>
#include <string>
#include <vector>
namespace trocar::fuzz {

// A scene as blocks of lines of TOML: a table and its keys, or several that belong together. Without a block or a line
// it is a smaller scene, or one that is refused.
struct RandomScene {
    std::vector<std::vector<std::string>> block;
    std::string text() const;
};

// The scene of a seed: the same on every machine. One to five small bodies of any motion, model and material, at most
// two hands. Half of the scenes have usual materials, the others let some or all of them range over everything that
// docs/scenes.md admits.
RandomScene random_scene(uint64_t seed);

}  // namespace trocar::fuzz
