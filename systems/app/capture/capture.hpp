#pragma once
#include <array>
#include <deque>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "components/picture.hpp"
#include "engine/files/capture_file.hpp"
#include "engine/world/capture_record.hpp"
#include "systems/app/report/figures.hpp"
#include "systems/frame/frame.hpp"
namespace trocar {

// What starts a capture. Several triggers may be combined.
struct CaptureTriggers {
    std::vector<std::array<uint64_t, 2>> ranges;  // contact passes, first and last of each range; may overlap
    bool worst = false;                           // the slowest; `worst` and `over_ms` skip kFirstJudged
                                                  // passes
    double over_ms = 0;                           // ms, slower passes; 0 = off. The worst kMostCaptures
    bool lost = false;                            // particles became non-finite; at most kMostCaptures
    std::vector<std::string> counters;            // counters in Report; each triggers when it first rises
    bool signal = false;                          // SIGUSR1, see CaptureSignal
    bool viewer = false;                          // the button of a live view, which calls write_now
    bool any() const { return !ranges.empty() || worst || over_ms > 0 || lost || !counters.empty() || signal || viewer; }
};
inline constexpr uint32_t kMostCaptures = 10;  // per trigger of this kind
inline constexpr uint64_t kFirstJudged = 8;    // passes; earlier ones pay for memory and cold caches

// Parses "5-25", "worst", "over=33" (ms), "nan", "counter=expired_constraints", "usr1", "view", or several joined by commas;
// ranges and counters may be repeated. Throws InputError that lists the accepted forms.
CaptureTriggers parse_capture_triggers(const std::string& text);

// Value of the Report counter with this name in metrics.json; nullopt if there is none.
std::optional<uint64_t> report_counter(const Report& report, const std::string& name);

// While an object of this class exists, SIGUSR1 triggers a capture; without one the signal ends the program.
class CaptureSignal {
 public:
    CaptureSignal();
    ~CaptureSignal();
    CaptureSignal(const CaptureSignal&) = delete;
    CaptureSignal& operator=(const CaptureSignal&) = delete;
};

// Watches a run and writes captures of it. The last kKept passes stay in memory (a state every kStatePeriod
// passes, hashes and times of every pass) and are written when a trigger fires. Captures of a pass range are
// written as the run proceeds, with hashes of every resource.
class FrameRecorder {
 public:
    // `folder` must exist. A capture that cannot be written ends capturing, not the run: see failure(). If
    // the states would take more than `most_bytes` in total, fewer are kept, but at least two. Memory for the
    // states of `passes` passes is allocated here: allocating it during a pass would cost more than the
    // recording.
    FrameRecorder(const Frame& frame, CaptureHeader header, const CaptureTriggers& triggers, std::filesystem::path folder,
                  size_t most_bytes = kMostKeptBytes, uint64_t passes = 0);
    // Captures hold no picture from here on: for runs that draw none. A snapshot of 10,000 bodies takes longer than their state.
    void leave_out_pictures() { pictures_ = false; }
    void before_pass();
    void after_pass(const PassFigures& pass);
    void finish();             // call after the last pass
    void forget();             // call when the run returns to an earlier pass, or its state was changed between two passes
    void constants_changed();  // call when constants of the world, or which stages it needs, were changed between two passes
    // Writes the passes in memory now. The first word of `reason` becomes part of the file name.
    void write_now(const std::string& reason);
    // Why capturing ended early; empty if it did not. Everything written until then can be read.
    const std::string& failure() const { return failure_; }
    // After finish(): which triggers did not get everything they requested.
    const std::vector<std::string>& notes() const { return notes_; }
    // Names of the files written, in the order of writing.
    const std::vector<std::string>& files() const { return files_; }

    static constexpr uint32_t kStatePeriod = 16, kKept = 128;    // passes
    static constexpr size_t kMostKeptBytes = size_t{256} << 20;  // fifty thousand balls: 160 MB per state

 private:
    // A state and the passes that start from it.
    struct Stretch {
        CaptureRecord state;
        std::deque<CaptureStep> steps;
    };
    using Kept = std::deque<std::shared_ptr<Stretch>>;
    // A range of passes that is currently being written.
    struct OpenRange {
        uint64_t last;
        std::unique_ptr<CaptureWriter> writer;
    };
    template <typename Write>
    void guarded(const Write& write);
    void reserve(uint64_t passes);
    void finish_ranges();
    void write_worst();
    std::shared_ptr<Stretch> free_stretch();
    void drop_old_states();
    void look_for_triggers(const CaptureStep& step);
    void write(const Kept& kept, uint64_t last_pass, const std::string& reason, const PictureSnapshot* picture = nullptr);
    std::unique_ptr<CaptureWriter> open(const std::string& name, const std::string& reason);
    const Frame& frame_;
    const Meshes meshes_;  // before any cut: pictures are drawn from these and what snapshots add
    CaptureHeader header_;
    std::vector<CaptureArray> input_, input_before_;  // of this pass and of the previous one
    CaptureTriggers triggers_;
    std::filesystem::path folder_;
    size_t most_bytes_;
    CaptureRecord scene_;
    std::vector<std::shared_ptr<Stretch>> stretches_;  // all buffers; free if there is no other owner
    Kept kept_, worst_;
    double worst_ms_ = 0;
    uint64_t worst_pass_ = 0;
    bool pictures_ = true;
    PictureSnapshot worst_picture_;  // at the end of that pass
    struct OverPass {
        double ms = 0;
        std::string file;
    };
    void keep_over(const CaptureStep& step);
    uint64_t over_ = 0;                 // passes over the limit so far
    std::vector<OverPass> over_worst_;  // that have a file
    uint32_t lost_ = 0;                 // captures written so far
    Report report_;
    std::vector<OpenRange> open_ranges_;
    std::vector<std::string> notes_;
    std::vector<std::string> files_;
    std::string failure_;
};

}  // namespace trocar
