#pragma once
#include <string>
#include <vector>

#include "content/scene/scene_file.hpp"
namespace trocar {

// Scenes times numbers of threads: passes a second and state hashes, in one table.
struct SpeedOptions {
    std::vector<std::string> scenes;
    std::vector<Override> overrides;
    std::vector<uint32_t> threads;  // empty = 1, 2, 4 ... up to all cores
    double seconds = 1;             // simulated, of each run
    uint32_t repeat = 3;            // runs of each, of which the fastest counts
    bool json = false;
};
// Exit code 1 if a scene ends in another state with another number of threads, or in another run.
int speed_command(const SpeedOptions& options);

}  // namespace trocar
