#pragma once
#include <cstdint>
#include <memory>
#include <span>
#include <string_view>
#include <utility>
#include <vector>
namespace trocar {

struct FrameState;  // data that stages work on; defined by the owner of the frame
__extension__ typedef unsigned __int128 ResourceMask;  // one bit per World resource, see engine/world/world.hpp

// One step of the frame. Stages are listed in the order of a serial run.
struct Stage {
    std::string_view name;
    void (*run)(FrameState&);
    ResourceMask reads = 0;
    ResourceMask writes = 0;
};

// Edge (a, b), a < b: stage b must wait for stage a because one writes what the other touches.
std::vector<std::pair<uint32_t, uint32_t>> stage_edges(std::span<const Stage> stages);

// Called around every stage with its index; may be empty. begin and end run on the stage's thread.
struct StageObserver {
    void (*begin)(void* user, uint32_t stage) = nullptr;
    void (*end)(void* user, uint32_t stage) = nullptr;
    void* user = nullptr;
};

void run_serial(std::span<const Stage> stages, FrameState& state, const StageObserver& observer = {});

// The graph of a list of stages, built once and run every frame. Same result as run_serial, bitwise.
class JobGraph {
 public:
    JobGraph(std::span<const Stage> stages, FrameState& state, const StageObserver& observer = {});
    ~JobGraph();
    void run();

 private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace trocar
