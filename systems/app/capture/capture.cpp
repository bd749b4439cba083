#include "systems/app/capture/capture.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <sstream>
#include <utility>

#include "engine/base/error.hpp"
#include "systems/app/capture/capture_picture.hpp"
#include "systems/app/console/format.hpp"
namespace trocar {
namespace {

volatile std::sig_atomic_t asked_by_signal = 0;
void ask(int) { asked_by_signal = 1; }

[[noreturn]] void refuse_trigger(const std::string& word) {
    std::string counters;
    each_number(Report{}, kTrigger, [&](const ReportNumber& n, auto) { counters += std::string(counters.empty() ? "" : ", ") + n.name; });
    throw InputError(
        "--capture " + word +
        ": write 5-25 (contact passes), worst, over=33 (ms), nan, usr1, view or counter=NAME, joined by commas (ranges and counters "
        "more than once); counters: " +
        counters);
}

void parse_trigger(const std::string& word, CaptureTriggers& triggers) {
    char* end = nullptr;
    if (word == "worst") {
        triggers.worst = true;
    } else if (word == "nan") {
        triggers.lost = true;
    } else if (word == "usr1") {
        triggers.signal = true;
    } else if (word == "view") {
        triggers.viewer = true;
    } else if (word.starts_with("over=")) {
        if (triggers.over_ms > 0) throw InputError("--capture " + word + ": over= is given twice");
        triggers.over_ms = std::strtod(word.c_str() + 5, &end);
        if (*end != 0 || !(triggers.over_ms > 0) || !std::isfinite(triggers.over_ms)) refuse_trigger(word);
    } else if (word.starts_with("counter=")) {
        triggers.counters.push_back(word.substr(8));
        if (!report_counter({}, triggers.counters.back())) refuse_trigger(word);
    } else {
        uint64_t first = 0, last = 0;
        const char* const stop = word.data() + word.size();
        const auto [dash, bad_first] = std::from_chars(word.data(), stop, first);
        if (bad_first != std::errc{} || dash == stop || *dash != '-') refuse_trigger(word);
        const auto [after, bad_last] = std::from_chars(dash + 1, stop, last);
        if (bad_last != std::errc{} || after != stop || last < first) refuse_trigger(word);
        const std::array range{first, last};
        if (std::find(triggers.ranges.begin(), triggers.ranges.end(), range) == triggers.ranges.end()) triggers.ranges.push_back(range);
    }
}

size_t bytes_of(const CaptureRecord& record) {
    size_t bytes = 0;
    for (const CaptureArray& a : record.arrays) bytes += a.bytes.size();
    return bytes;
}

}  // namespace

std::optional<uint64_t> report_counter(const Report& report, const std::string& name) {
    std::optional<uint64_t> found;
    each_number(report, kTrigger, [&](const ReportNumber& n, auto value) {
        if (name == n.name) found = static_cast<uint64_t>(value);
    });
    return found;
}

CaptureTriggers parse_capture_triggers(const std::string& text) {
    CaptureTriggers triggers;
    for (size_t from = 0; from <= text.size();) {
        const size_t comma = std::min(text.find(',', from), text.size());
        parse_trigger(text.substr(from, comma - from), triggers);
        from = comma + 1;
    }
    return triggers;
}

FrameRecorder::FrameRecorder(const Frame& frame, CaptureHeader header, const CaptureTriggers& triggers, std::filesystem::path folder,
                             size_t most_bytes, uint64_t passes)
    : frame_(frame),
      meshes_(frame.world().meshes),
      header_(std::move(header)),
      triggers_(triggers),
      folder_(std::move(folder)),
      most_bytes_(most_bytes) {
    scene_.kind = "scene";
    save_resources(frame.world(), ResourceKind::kConstant, scene_);
    report_ = frame.world().report;
    reserve(passes);
}

// State sizes hardly vary within a scene. One extra buffer is needed: a dropped state's buffer becomes free
// only after the next state has been saved.
void FrameRecorder::reserve(uint64_t passes) {
    const uint64_t wanted = std::min<uint64_t>((passes + kStatePeriod - 1) / kStatePeriod, kKept / kStatePeriod + 2);
    size_t bytes = 0;
    for (uint64_t i = 0; i < wanted && (i < 3 || bytes <= most_bytes_); ++i) {
        stretches_.push_back(std::make_shared<Stretch>());
        save_state(frame_.world(), stretches_.back()->state);
        bytes += bytes_of(stretches_.back()->state);
    }
}

std::shared_ptr<FrameRecorder::Stretch> FrameRecorder::free_stretch() {
    for (const std::shared_ptr<Stretch>& stretch : stretches_) {
        if (stretch.use_count() > 1) continue;
        stretch->steps.clear();
        return stretch;
    }
    return stretches_.emplace_back(std::make_shared<Stretch>());
}

CaptureSignal::CaptureSignal() {
    asked_by_signal = 0;
    std::signal(SIGUSR1, ask);
}
CaptureSignal::~CaptureSignal() { std::signal(SIGUSR1, SIG_DFL); }

std::unique_ptr<CaptureWriter> FrameRecorder::open(const std::string& name, const std::string& reason) {
    auto writer = std::make_unique<CaptureWriter>(folder_ / name);
    header_.reason = reason;
    writer->add(to_record(header_));
    writer->add(scene_);
    if (std::find(files_.begin(), files_.end(), name) == files_.end()) files_.push_back(name);
    return writer;
}

// A full disk must not end the simulation: capturing stops, and failure() gives the reason.
template <typename Write>
void FrameRecorder::guarded(const Write& write) {
    if (!failure_.empty()) return;
    try {
        write();
    } catch (const InputError& error) {
        failure_ = error.what();
        open_ranges_.clear();
        worst_.clear();
    }
}

void FrameRecorder::write(const Kept& kept, uint64_t last_pass, const std::string& reason, const PictureSnapshot* picture) {
    guarded([&] {
        const std::string word = reason.substr(0, reason.find(' '));
        const auto writer = open(word == "worst" ? "worst.cap" : word + "_" + std::to_string(last_pass) + ".cap", reason);
        for (const auto& stretch : kept) {
            if (stretch->steps.empty() || stretch->steps.front().pass > last_pass) break;
            writer->add(stretch->state);
            for (const CaptureStep& step : stretch->steps)
                if (step.pass <= last_pass) writer->add(to_record(step));
        }
        if (pictures_) writer->add(picture_record(picture ? *picture : snapshot_of(frame_.world()), meshes_, header_, last_pass));
        writer->finish();
    });
}

void FrameRecorder::before_pass() {
    const uint64_t pass = frame_.world().clock.pass;
    if (header_.live) {
        CaptureRecord tools;
        save_resource(frame_.world(), Resource::kToolState, tools);
        input_before_ = std::exchange(input_, std::move(tools.arrays));
    }
    const bool begins = std::any_of(triggers_.ranges.begin(), triggers_.ranges.end(), [&](const auto& range) { return range[0] == pass; });
    if (!kept_.empty() && !begins && pass % kStatePeriod != 0) return;
    std::shared_ptr<Stretch> stretch = free_stretch();
    save_state(frame_.world(), stretch->state);
    for (CaptureArray a : input_before_) {
        a.name = "before." + a.name;
        stretch->state.arrays.push_back(std::move(a));
    }
    for (const auto& [first, last] : triggers_.ranges) {
        if (first != pass) continue;
        guarded([&] {
            open_ranges_.push_back({last, open("passes_" + std::to_string(first) + "-" + std::to_string(last) + ".cap", "passes")});
        });
    }
    guarded([&] {
        for (OpenRange& range : open_ranges_) range.writer->add(stretch->state);
    });
    kept_.push_back(std::move(stretch));
    drop_old_states();
}

// Keeps at least two states: no pass after the newest has been judged by a trigger yet.
void FrameRecorder::drop_old_states() {
    size_t bytes = 0, fit = 0;
    for (auto stretch = kept_.rbegin(); stretch != kept_.rend() && fit < kKept / kStatePeriod + 1; ++stretch, ++fit) {
        bytes += bytes_of((*stretch)->state);
        if (fit >= 2 && bytes > most_bytes_) break;
    }
    while (kept_.size() > fit) kept_.pop_front();
}

void FrameRecorder::after_pass(const PassFigures& pass) {
    const World& w = frame_.world();
    CaptureStep step;
    step.pass = w.clock.pass - 1;
    step.state_hash = state_hash(w);
    step.frame_ms = pass.frame_ms, step.detection_ms = pass.detection_ms, step.response_ms = pass.response_ms;
    step.depth = pass.depth, step.force = pass.force, step.contacts = pass.contacts, step.inside_vertices = pass.inside_vertices;
    step.stage_ns = frame_.times().stage_ns;
    step.input = input_;
    if (!open_ranges_.empty()) {
        for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r)
            step.resource_hash.push_back(resource_hash(w, static_cast<Resource>(r)));
        guarded([&] {
            for (OpenRange& range : open_ranges_) {
                range.writer->add(to_record(step));
                if (step.pass != range.last) continue;
                if (pictures_) range.writer->add(picture_record(snapshot_of(w), meshes_, header_, step.pass));
                range.writer->finish();
            }
        });
        std::erase_if(open_ranges_, [&](const OpenRange& range) { return range.last == step.pass; });
    }
    kept_.back()->steps.push_back(std::move(step));
    look_for_triggers(kept_.back()->steps.back());
    report_ = w.report;
}

void FrameRecorder::look_for_triggers(const CaptureStep& step) {
    const Report& now = frame_.world().report;
    const auto rose = [&](const std::string& name) { return *report_counter(now, name) > *report_counter(report_, name); };
    if (triggers_.signal && asked_by_signal) {
        asked_by_signal = 0;
        write(kept_, step.pass, "usr1");
    }
    if (triggers_.lost && rose("nonfinite_particles") && lost_ < kMostCaptures) {
        ++lost_;
        write(kept_, step.pass, "nan");
    }
    // fires the first time only: a counter may rise in every pass
    std::erase_if(triggers_.counters, [&](const std::string& counter) {
        if (!rose(counter)) return false;
        write(kept_, step.pass, counter + " rose");
        return true;
    });
    if (step.pass < kFirstJudged) return;
    if (triggers_.over_ms > 0 && step.frame_ms > triggers_.over_ms) keep_over(step);
    if (triggers_.worst && step.frame_ms > worst_ms_) {
        worst_ms_ = step.frame_ms;
        worst_pass_ = step.pass;
        if (pictures_) worst_picture_ = snapshot_of(frame_.world());
        worst_ = kept_;  // shares the stretches; written at the end, once it is known to be the worst
    }
}

// Of the passes over the limit the worst are kept: one that is worse takes the place, and its file, of the least of them.
void FrameRecorder::keep_over(const CaptureStep& step) {
    ++over_;
    if (over_worst_.size() == kMostCaptures) {
        const auto least = std::ranges::min_element(over_worst_, {}, &OverPass::ms);
        if (step.frame_ms <= least->ms) return;
        std::error_code error;
        std::filesystem::remove(folder_ / least->file, error);
        std::erase(files_, least->file);
        over_worst_.erase(least);
    }
    write(kept_, step.pass, format("over %g ms: %.3f ms", triggers_.over_ms, step.frame_ms));
    if (failure_.empty()) over_worst_.push_back({step.frame_ms, files_.back()});
}

void FrameRecorder::forget() {
    kept_.clear();
    report_ = frame_.world().report;
}

void FrameRecorder::constants_changed() {
    write_worst();
    if (!open_ranges_.empty()) notes_.push_back("a range of passes ends where a viewer changed the scene");
    finish_ranges();
    forget();
    scene_.arrays.clear();
    save_resources(frame_.world(), ResourceKind::kConstant, scene_);
}

void FrameRecorder::write_now(const std::string& reason) {
    if (!kept_.empty() && !kept_.back()->steps.empty()) write(kept_, kept_.back()->steps.back().pass, reason);
}

void FrameRecorder::finish() {
    const uint64_t pass = frame_.world().clock.pass;
    for (const auto& [first, last] : triggers_.ranges) {
        if (last >= pass)
            notes_.push_back(std::to_string(first) + "-" + std::to_string(last) + ": the run ended before pass " + std::to_string(pass));
    }
    if (over_ > kMostCaptures)
        notes_.push_back("over: of " + std::to_string(over_) + " passes the worst " + std::to_string(kMostCaptures) + " are kept");
    if (lost_ == kMostCaptures) notes_.push_back("nan: the first " + std::to_string(lost_) + " passes are kept");
    finish_ranges();
    write_worst();
}

void FrameRecorder::finish_ranges() {
    guarded([&] {
        for (OpenRange& range : open_ranges_) range.writer->finish();
    });
    open_ranges_.clear();
}

void FrameRecorder::write_worst() {
    if (worst_.empty()) return;
    const std::string reason = format("worst pass %llu: %.3f ms", static_cast<unsigned long long>(worst_pass_), worst_ms_);
    write(worst_, worst_pass_, reason, &worst_picture_);
    worst_.clear();
}

}  // namespace trocar
