#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "systems/app/capture.hpp"
namespace trocar {

// A capture as read back: states, each with the passes that start from it.
struct Capture {
    struct Stretch {
        CaptureRecord state;
        uint64_t pass = 0;  // that starts from the state
        std::vector<CaptureStep> steps;
    };
    CaptureHeader header;
    std::string reason;  // what set it off
    CaptureRecord scene;
    std::vector<Stretch> stretches;
    std::string damage;  // empty = whole
    std::string file;
    size_t passes() const;
};

// Throws InputError "file: reason" when it holds nothing that can be replayed. A capture that was cut short is read up to
// its last complete record.
Capture open_capture(const std::filesystem::path& path);

// The stretch that holds a pass; none when the capture does not.
std::optional<size_t> stretch_of(const Capture& capture, uint64_t pass);

// The world at the start of a stretch. Throws InputError when the capture describes no world that can be simulated.
World world_at(const Capture& capture, size_t stretch);
// How a frame has to be made to run it again.
FrameOptions replay_options(const Capture& capture, Trace* trace);
// A frame to step it with takes the inputs that a live run had: call before the first pass and before every pass.
void take_up(const Capture& capture, size_t stretch, Frame& frame);
void take_input(const CaptureStep& step, Frame& frame);

// The first stage in the order of the frame whose results differ: "overlap (contacts)"; empty when hashes are not stored
// or all agree.
std::string first_stage(const Frame& frame, const CaptureStep& recorded);

struct ReplayVerdict {
    uint64_t compared = 0;   // passes
    std::string difference;  // empty = the same to the bit
};
// Called after each pass, with what was recorded of it; may be empty.
struct ReplayObserver {
    void (*pass)(void* user, Frame& frame, const CaptureStep& recorded) = nullptr;
    void* user = nullptr;
};
// Runs the whole capture again from its first state and compares every pass and every stored state. Stops at the first
// difference. Inside ThreadPool::run.
ReplayVerdict replay_capture(const Capture& capture, const ReplayObserver& observer);

// Runs pass `pass` `repeat` times from its own start, caches warm, and returns what its stages took. Throws InputError
// when the capture does not hold the pass.
struct PassProfile {
    std::vector<std::string> stage;
    std::vector<std::vector<double>> stage_ms;  // one row per stage, one value per repetition
    std::vector<double> pass_ms;
    bool same = true;  // whether it ended as captured, to the bit
};
PassProfile profile_pass(const Capture& capture, uint64_t pass, uint32_t repeat, Trace* trace);

}  // namespace trocar
