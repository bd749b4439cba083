#pragma once
#include <deque>
#include <string>
#include <vector>

#include "systems/app/run/live_recording.hpp"
#include "systems/app/run/viewer_actions.hpp"
#include "systems/frame/frame.hpp"
namespace trocar {

// Repeats a live run in lockstep. Every haptic tick is recomputed from the sample and the surface it used, as
// soon as a pass needs the resulting state; each pass then starts from what its mailboxes contained in the
// live run. Use with FrameOptions::external_ticks unless the recording is of a run in lockstep, and with ViewerActions::make_room if it was
// viewed; the frame and the recording must outlive this.
class LiveReplay {
 public:
    // Throws InputError "file: reason" if the recording is of another scene or of other settings.
    LiveReplay(const HapticParams& params, const LiveRecording& recording, const std::string& file, Frame& frame);
    ~LiveReplay();

    // ms of recorded simulated time.
    uint64_t end_tick() const;
    // Call before every Frame::step. Throws InputError if the recording is inconsistent. `watch` may be null.
    void begin_pass(RunWatch* watch = nullptr);
    // After the last pass: empty if ticks and state are bit-identical to the recording, otherwise a
    // description of the difference.
    std::string difference() const;

 private:
    struct Tool;
    void advance_tool(uint32_t tool, uint64_t ticks);
    void keep_models();
    HapticParams params_;
    const LiveRecording& recording_;
    std::string file_;
    Frame& frame_;
    std::vector<Tool> tools_;
    ViewerActions actions_;
    size_t pass_ = 0, next_command_ = 0;
    uint64_t different_ticks_ = 0, first_different_tick_ = 0;
};

}  // namespace trocar
