#pragma once
#include "systems/app/capture.hpp"
#include "systems/app/commands.hpp"
#include "systems/app/figures.hpp"
#include "systems/app/live_recording.hpp"
#include "systems/app/picture_writer.hpp"
#include "systems/frame.hpp"
namespace trocar {

// What the last pass of a frame found and cost; `time` is the simulated time at its start.
PassFigures pass_figures(const Frame& frame, double time);
// Adds the durations of the stages that ran in the last pass.
void add_stage_times(const Frame& frame, RunFigures& figures);

// Gives every tool's state what its device reports at the start of a run.
void first_device_states(World& world);

// How far (ns) simulated time slips when a pass of `period` would start `behind` its time. By less than a pass, those after it catch up; by
// more it starts anew from now, or else what hands feel would only grow older.
int64_t time_let_go(int64_t behind, int64_t period);

// A run and those who watch it.
struct RunParts {
    const RunOptions& options;
    double seconds;  // of simulated time
    Frame& frame;
    PictureWriter* pictures;  // may be null
    FrameRecorder* recorder;  // of captures; may be null
    RunFigures& figures;
};

// Runs a frame against the real clock: this thread simulates, haptics tick at 1 kHz on a thread of their own, pictures
// are drawn on a thread of low priority that drops what it cannot keep up with. A late pass starts at once and is
// counted; see time_let_go. With `recording` it keeps what a replay needs; false if ticks got lost on the
// way there, so that the recording is worth nothing.
bool run_live(const RunParts& run, LiveRecording* recording);

}  // namespace trocar
