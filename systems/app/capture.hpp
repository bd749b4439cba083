#pragma once
#include <array>
#include <deque>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "components/picture.hpp"
#include "engine/capture_file.hpp"
#include "systems/app/figures.hpp"
#include "systems/frame.hpp"
namespace trocar {

// What sets a capture off. Several may be asked for at once.
struct CaptureTriggers {
    std::vector<std::array<uint64_t, 2>> ranges;  // these contact passes, first and last; may overlap
    bool worst = false;                           // the slowest pass of the run; neither judges the first kFirstJudged
    double over_ms = 0;                           // passes slower than this; 0 = none. At most kMostCaptures of them
    bool lost = false;                            // particles that were not finite and were restored; kMostCaptures times
    std::vector<std::string> counters;            // counters of Report, each the first time that it rises
    bool signal = false;                          // SIGUSR1, see CaptureSignal
    bool any() const { return !ranges.empty() || worst || over_ms > 0 || lost || !counters.empty() || signal; }
};
inline constexpr uint32_t kMostCaptures = 10;  // for one such reason
inline constexpr uint64_t kFirstJudged = 8;    // pass: those before pay for memory and caches and are no news

// "5-25", "worst", "over=33" (ms), "nan", "counter=ended_rows", "usr1", several joined by commas; ranges and counters more
// than once. Throws InputError that says what may be written.
CaptureTriggers parse_capture_triggers(const std::string& text);

// The value of a counter of Report by its name in metrics.json; nothing when there is none of that name.
std::optional<uint64_t> report_counter(const Report& report, const std::string& name);

// What a capture says of one contact pass.
struct CaptureStep {
    uint64_t pass = 0;        // from 0
    uint64_t state_hash = 0;  // after it
    double frame_ms = 0, detection_ms = 0, response_ms = 0;
    double depth = 0, force = 0;  // m, N
    uint64_t contacts = 0, inside_vertices = 0;
    std::vector<uint64_t> stage_ns;       // in the order of the header's stage names
    std::vector<uint64_t> resource_hash;  // after it, one per Resource; empty where only the state was hashed
    std::vector<CaptureArray> input;      // of a live run: the tools' state that the pass took, as in World
    TROCAR_FIELDS(pass, state_hash, frame_ms, detection_ms, response_ms, depth, "m", force, "N", contacts, inside_vertices, stage_ns,
                  resource_hash);
    TROCAR_OTHER_FIELDS(input);
};
CaptureRecord to_record(const CaptureStep& step);
CaptureStep read_step(const CaptureRecord& record);

// What a reader needs besides the world.
struct CaptureHeader {
    std::string scene, version, instruction_set, machine;
    std::vector<std::string> stage_names;
    Camera camera;
    PictureParams picture;
    bool live = false;
};

// Adds all resources of that kind to a record, and the reverse.
void save_resources(const World& world, ResourceKind kind, CaptureRecord& record);
void load_resources(const CaptureRecord& record, ResourceKind kind, World& world);

// While it lives SIGUSR1 is a trigger; without it the signal ends the program.
class CaptureSignal {
 public:
    CaptureSignal();
    ~CaptureSignal();
    CaptureSignal(const CaptureSignal&) = delete;
    CaptureSignal& operator=(const CaptureSignal&) = delete;
};

// Watches a run and writes captures of it: the last kKept passes are kept in memory (a state every kStatePeriod
// passes, hashes and times of every pass) and written when a trigger asks. Captures of a range of passes are written as
// they run, with hashes of every resource.
class FrameRecorder {
 public:
    // `folder` must exist. A capture that cannot be written ends capturing, not the run: see failure(). Of states that take
    // more than `most_bytes` together fewer are kept, two at least. Memory for the states of `passes` passes is taken here, as far
    // as they are kept: taken in a pass it would cost more than what is done with it.
    FrameRecorder(const Frame& frame, CaptureHeader header, const CaptureTriggers& triggers, std::filesystem::path folder,
                  size_t most_bytes = kMostKeptBytes, uint64_t passes = 0);
    void before_pass();
    void after_pass(const PassFigures& pass);
    void finish();  // after the last pass
    void forget();  // the run goes back to an earlier pass
    // Writes the last passes now, for a reason whose first word names the file.
    void write_now(const std::string& reason);
    // Why capturing ended early; empty while it goes on. What was written until then can be read.
    const std::string& failure() const { return failure_; }
    // After finish(): which of the triggers did not get all that they asked for.
    const std::vector<std::string>& notes() const { return notes_; }
    // Names of the files written, in order.
    const std::vector<std::string>& files() const { return files_; }

    static constexpr uint32_t kStatePeriod = 16, kKept = 128;    // passes
    static constexpr size_t kMostKeptBytes = size_t{256} << 20;  // a state of fifty thousand balls has 160 MB

 private:
    // A state and the passes that start from it.
    struct Stretch {
        CaptureRecord state;
        std::deque<CaptureStep> steps;
    };
    using Kept = std::deque<std::shared_ptr<Stretch>>;
    // A range of passes that is being written.
    struct OpenRange {
        uint64_t last;
        std::unique_ptr<CaptureWriter> writer;
    };
    template <typename Write>
    void guarded(const Write& write);
    void reserve(uint64_t passes);
    std::shared_ptr<Stretch> free_stretch();
    void drop_old_states();
    void look_for_triggers(const CaptureStep& step);
    void write(const Kept& kept, uint64_t last_pass, const std::string& reason);
    std::unique_ptr<CaptureWriter> open(const std::string& name, const std::string& reason);
    const Frame& frame_;
    CaptureHeader header_;
    std::vector<CaptureArray> input_, input_before_;  // of this pass and the one before
    CaptureTriggers triggers_;
    std::filesystem::path folder_;
    size_t most_bytes_;
    CaptureRecord scene_;
    std::vector<std::shared_ptr<Stretch>> stretches_;  // all; one that nobody else holds is free
    Kept kept_, worst_;
    double worst_ms_ = 0;
    uint64_t worst_pass_ = 0;
    uint32_t over_ = 0, lost_ = 0;  // captures written for that reason
    Report report_;
    std::vector<OpenRange> open_ranges_;
    std::vector<std::string> notes_;
    std::vector<std::string> files_;
    std::string failure_;
};

}  // namespace trocar
