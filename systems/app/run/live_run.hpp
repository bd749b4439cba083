#pragma once
#include "systems/app/capture/capture.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/pictures/picture_writer.hpp"
#include "systems/app/player/player_recorder.hpp"
#include "systems/app/report/figures.hpp"
#include "systems/app/run/live_recording.hpp"
#include "systems/app/run/run_watch.hpp"
#include "systems/app/run/viewer_actions.hpp"
#include "systems/app/station/exercise.hpp"
#include "systems/app/view/live_view.hpp"
#include "systems/frame/frame.hpp"
namespace trocar {

// Results and costs of the frame's last pass; `time` is the simulated time at its start.
PassFigures pass_figures(const Frame& frame, double time);
// Adds the durations of the stages run in the last pass.
void add_stage_times(const Frame& frame, RunFigures& figures);

// Initialises every tool's state with what its device reports at the start of a run.
void first_device_states(World& world);

// Slip (ns) of simulated time when a pass of `period` starts `behind` schedule. Delays below one period are
// caught up by the following passes (slip 0); after a longer delay the schedule restarts from now, because
// otherwise the hand would feel an ever older state.
int64_t time_let_go(int64_t behind, int64_t period);

// A run and its observers.
struct RunParts {
    const RunOptions& options;
    double seconds;  // of simulated time
    Frame& frame;
    PictureWriter* pictures;  // may be null
    FrameRecorder* recorder;  // of captures; may be null
    RunFigures& figures;
    RunWatch* watch = nullptr;             // may be null
    PlayerRecorder* player = nullptr;      // may be null
    ExerciseRecorder* exercise = nullptr;  // may be null
    LiveView* view = nullptr;              // may be null
    ViewerActions* actions = nullptr;      // with a view
    uint64_t most_passes = 0;              // that results cover; 0 = all
    // Whether results cover the pass that was just made.
    bool keeps() const { return most_passes == 0 || frame.world().clock.pass <= most_passes; }
};

// Between two passes: does what viewers asked for, tells them what came of it, and keeps it in `recording`, which may be null.
void heed_viewers(const RunParts& run, LiveRecording* recording);
// After a pass that results do not cover: says so, once.
void note_end_of_results(const RunParts& run);

// Runs a frame against the real clock: this thread simulates, haptics tick at 1 kHz on their own thread, and a
// thread of low priority draws pictures, dropping those it has no time for. A late pass starts at once and is
// counted; see time_let_go. Stores in `recording`, if given, what a replay needs; false if ticks were lost, which
// makes the recording useless.
bool run_live(const RunParts& run, LiveRecording* recording);

}  // namespace trocar
