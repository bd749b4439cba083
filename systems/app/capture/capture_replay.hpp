#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "systems/app/capture/capture.hpp"
#include "systems/app/capture/capture_picture.hpp"
namespace trocar {

// A capture as read from disk: states, each with the passes that start from it.
struct Capture {
    struct Stretch {
        CaptureRecord state;
        uint64_t pass = 0;  // first pass after the state
        std::vector<CaptureStep> steps;
    };
    CaptureHeader header;
    CaptureRecord scene;
    std::vector<Stretch> stretches;
    CapturePicture picture;  // empty in captures of older versions, and in unfinished ones
    std::string damage;      // empty = complete
    std::string file;
    size_t passes() const;
};

// Reads a truncated capture up to its last complete record. Throws InputError "file: reason" if nothing is
// left.
Capture open_capture(const std::filesystem::path& path);

// Index of the stretch that contains a pass; nullopt if there is none.
std::optional<size_t> stretch_of(const Capture& capture, uint64_t pass);

// The world at the start of a stretch. Throws InputError if it cannot be simulated.
World world_at(const Capture& capture, size_t stretch);
// Frame options that reproduce the recording.
FrameOptions replay_options(const Capture& capture, Trace* trace);
// Gives the frame the tool input recorded in a live run. Call before every pass.
void take_up(const Capture& capture, size_t stretch, Frame& frame);
void take_input(const CaptureStep& step, Frame& frame);

// First stage, in frame order, whose results differ from the recording: "overlap (contacts)"; empty if all
// agree or no hashes are stored.
std::string first_stage(const Frame& frame, const CaptureStep& recorded);

struct ReplayVerdict {
    uint64_t compared = 0;   // passes
    std::string difference;  // empty = bit-identical
};
// Called after each pass with its recorded data; may be empty.
struct ReplayObserver {
    void (*pass)(void* user, Frame& frame, const CaptureStep& recorded) = nullptr;
    void* user = nullptr;
};
// Replays the whole capture from its first state and compares every pass and every stored state, up to the
// first difference. Call inside ThreadPool::run.
ReplayVerdict replay_capture(const Capture& capture, const ReplayObserver& observer);

// Replays pass `pass` `repeat` times from its own start with warm caches and returns the stage times. Throws
// InputError if the capture does not contain the pass.
struct PassProfile {
    std::vector<std::string> stage;
    std::vector<std::vector<double>> stage_ms;  // per stage and repetition
    std::vector<double> pass_ms;
    bool same = true;  // whether every repetition ended bit-identical to the recording
};
PassProfile profile_pass(const Capture& capture, uint64_t pass, uint32_t repeat, Trace* trace);

}  // namespace trocar
