#pragma once
#include <deque>
#include <string>
#include <vector>

#include "systems/app/live_recording.hpp"
#include "systems/frame.hpp"
namespace trocar {

// Repeats a live run in lockstep. Every haptic tick is computed again from the sample and the surface it had, as soon
// as a pass takes a state that it led to; the simulation then starts each pass from what its mailboxes held in the
// live run. Use with FrameOptions::external_ticks; the frame and the recording must outlive it.
class LiveReplay {
 public:
    // Throws InputError "file: reason" when the recording is of another scene, or of this one with other settings.
    LiveReplay(const HapticParams& params, const LiveRecording& recording, const std::string& file, Frame& frame);
    ~LiveReplay();

    // ms of simulated time that were recorded.
    uint64_t end_tick() const;
    // Before every Frame::step. Throws InputError when the recording contradicts itself.
    void begin_pass();
    // After the last pass: empty when ticks and state came out the same to the bit, else what did not.
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
    size_t pass_ = 0;
    uint64_t different_ticks_ = 0, first_different_tick_ = 0;
};

}  // namespace trocar
