#include "systems/app/station/comparison.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "engine/base/error.hpp"
#include "systems/app/station/exercise_file.hpp"
#include "systems/app/station/smooth_path.hpp"
namespace trocar {
namespace fs = std::filesystem;
namespace {

constexpr size_t kMostSamples = 600;  // of a phase: dynamic time warping takes the square of it
constexpr size_t kWarpWidth = 4;      // numbers a sample and tool: place and force

// Columns of a tool by time.
struct ToolTrack {
    std::vector<double> time;
    std::vector<Vec3d> tip;
    std::vector<double> force;
};

ToolTrack track_of(const Exercise& e, uint32_t tool) {
    ToolTrack t;
    for (const ExerciseSample& s : e.sample)
        if (s.tool == tool) t.time.push_back(s.time), t.tip.push_back(s.tip), t.force.push_back(s.hand.norm());
    return t;
}

// Index of the sample before t, and the share of the way to the next.
std::pair<size_t, double> place_in(const std::vector<double>& time, double t) {
    if (time.size() < 2 || t <= time.front()) return {0, 0.0};
    if (t >= time.back()) return {time.size() - 2, 1.0};
    const size_t next = static_cast<size_t>(std::ranges::upper_bound(time, t) - time.begin());
    return {next - 1, (t - time[next - 1]) / (time[next] - time[next - 1])};
}

template <typename T>
T value_at(const std::vector<double>& time, const std::vector<T>& value, double t) {
    if (value.size() < 2) return value.front();
    const auto [i, share] = place_in(time, t);
    return value[i] + share * (value[i + 1] - value[i]);
}

using Tracks = std::vector<std::array<ToolTrack, 2>>;  // of the tools that both runs have

Tracks common_tracks(const Exercise& a, const Exercise& b) {
    Tracks tracks;
    for (uint32_t i = 0; i < a.tool.size(); ++i) {
        const auto j = std::ranges::find(b.tool, a.tool[i]);
        if (j == b.tool.end()) continue;
        std::array<ToolTrack, 2> both{track_of(a, i), track_of(b, static_cast<uint32_t>(j - b.tool.begin()))};
        if (both[0].time.size() > 1 && both[1].time.size() > 1) tracks.push_back(std::move(both));
    }
    return tracks;
}

// What distances are measured in, per tool: the standard deviation of places over both runs, and that of the force in each run, so that
// a hand that presses twice as hard at the same time does not shift it.
struct WarpScale {
    double place = 0;               // m
    std::array<double, 2> force{};  // N
};

std::vector<WarpScale> scales_of(const Tracks& tracks) {
    std::vector<WarpScale> scales;
    for (const auto& both : tracks) {
        WarpScale scale;
        Vec3d mean = Vec3d::Zero();
        double count = 0, spread = 0;
        for (const ToolTrack& t : both)
            for (const Vec3d& tip : t.tip) mean += tip, count += 1;
        mean /= count;
        for (size_t run = 0; run < 2; ++run) {
            const std::vector<double>& force = both[run].force;
            const double n = static_cast<double>(force.size()), level = std::accumulate(force.begin(), force.end(), 0.0) / n;
            for (const double f : force) scale.force[run] += (f - level) * (f - level) / n;
            scale.force[run] = std::sqrt(scale.force[run]);
            for (const Vec3d& tip : both[run].tip) spread += (tip - mean).squaredNorm();
        }
        scale.place = std::sqrt(spread / count);
        scales.push_back(scale);
    }
    return scales;
}

// Samples of one run in even intervals, scaled, for the warping.
std::vector<double> features(const Tracks& tracks, const std::vector<WarpScale>& scales, size_t run, double from, double to, size_t count) {
    std::vector<double> out;
    for (size_t i = 0; i < count; ++i) {
        const double t = from + (to - from) * (count > 1 ? static_cast<double>(i) / static_cast<double>(count - 1) : 0);
        for (size_t k = 0; k < tracks.size(); ++k) {
            const ToolTrack& track = tracks[k][run];
            const Vec3d tip = value_at(track.time, track.tip, t);
            for (int c = 0; c < 3; ++c) out.push_back(scales[k].place > 0 ? tip[c] / scales[k].place : 0);
            out.push_back(scales[k].force[run] > 0 ? value_at(track.time, track.force, t) / scales[k].force[run] : 0);
        }
    }
    return out;
}

double rms_distance(const Tracks& tracks, const std::vector<double>& time, const std::vector<double>& other) {
    double sum = 0, count = 0;
    for (size_t i = 0; i < time.size(); ++i)
        for (const auto& both : tracks)
            sum += (value_at(both[0].time, both[0].tip, time[i]) - value_at(both[1].time, both[1].tip, other[i])).squaredNorm(), count += 1;
    return count > 0 ? std::sqrt(sum / count) : 0;
}

bool same_phases(const std::vector<ExercisePhase>& a, const std::vector<ExercisePhase>& b) {
    return std::ranges::equal(a, b, {}, &ExercisePhase::name, &ExercisePhase::name);
}

// Adds the values of a metric of the runs of one group, where they have it.
std::vector<double> values_of(const std::vector<ComparedRun>& runs, const std::string& key, const std::string* group) {
    std::vector<double> values;
    for (const ComparedRun& r : runs)
        if (const auto at = r.score.all.find(key); at != r.score.all.end() && (!group || r.group == *group)) values.push_back(at->second);
    return values;
}

// Trials of all subjects: a subject's value per trial; only subjects and trials without gaps count.
void add_trials(const std::vector<ComparedRun>& runs, MetricSummary& m, Cohort& cohort) {
    std::map<std::string, std::map<double, double>> by_subject;
    std::map<double, std::vector<double>> by_trial;
    for (const ComparedRun& r : runs) {
        const auto at = r.score.all.find(m.key);
        if (at == r.score.all.end() || !(r.trial > 0)) continue;
        by_trial[r.trial].push_back(at->second);
        if (!r.subject.empty()) by_subject[r.subject][r.trial] = at->second;
    }
    for (const auto& [trial, values] : by_trial) m.trial.push_back(trial), m.median.push_back(quantile_between(values, 0.5));
    m.learning = fit_power_law(m.trial, m.median);
    size_t most = 0;
    for (const auto& [subject, trials] : by_subject) most = std::max(most, trials.size());
    std::vector<double> table;
    size_t subjects = 0;
    for (const auto& [subject, trials] : by_subject) {
        if (trials.size() < most) continue;
        for (const auto& [trial, value] : trials) table.push_back(value);
        ++subjects;
    }
    m.reliability = intraclass_correlation(table, most);
    cohort.subjects = std::max(cohort.subjects, subjects), cohort.trials = std::max(cohort.trials, most);
}

// ms per pass and stage, with the time of each pass.
struct StageTimes {
    std::vector<double> time;
    std::vector<std::string> stage;
    std::vector<std::vector<double>> ms;  // per stage
};

StageTimes read_stage_times(const fs::path& folder) {
    std::error_code error;
    const bool by_stage = fs::exists(folder / "stages.csv", error);
    if (!by_stage && !fs::exists(folder / "passes.csv", error)) return {};
    const CsvTable t = read_csv(folder / (by_stage ? "stages.csv" : "passes.csv"));
    StageTimes out;
    const size_t time = t.find("time_s");
    if (time == t.column.size()) throw InputError(t.file + ":1: column time_s is missing");
    for (size_t r = 0; r < t.row.size(); ++r) out.time.push_back(t.number(r, time));
    for (size_t c = 0; c < t.column.size(); ++c) {
        if (!t.column[c].ends_with("_ms")) continue;
        out.stage.push_back(t.column[c].substr(0, t.column[c].size() - 3));
        std::vector<double>& ms = out.ms.emplace_back();
        for (size_t r = 0; r < t.row.size(); ++r) ms.push_back(t.number(r, c));
    }
    return out;
}

}  // namespace

std::vector<CohortLine> read_cohort(const fs::path& file) {
    const CsvTable t = read_csv(file);
    const size_t run = t.find("run"), group = t.find("group"), subject = t.find("subject"), trial = t.find("trial"), none = t.column.size();
    if (run == none) throw InputError(t.file + ":1: column run is missing; a cohort has the columns run, group, subject, trial");
    std::vector<CohortLine> lines;
    for (size_t r = 0; r < t.row.size(); ++r) {
        CohortLine line{file.parent_path() / std::string(t.row[r][run]), "", "", 0};
        if (group != none) line.group = t.row[r][group];
        if (subject != none) line.subject = t.row[r][subject];
        if (trial != none && !t.row[r][trial].empty()) {
            line.trial = t.number(r, trial);
            if (!(line.trial > 0)) throw InputError(t.file + ":" + std::to_string(r + 2) + ": trials count from 1");
        }
        lines.push_back(line);
    }
    return lines;
}

Alignment align_runs(const Exercise& a, const Exercise& b) {
    Alignment out;
    const Tracks tracks = common_tracks(a, b);
    if (tracks.empty()) return out;
    const std::vector<WarpScale> scales = scales_of(tracks);
    std::vector<ExercisePhase> pa = phases_of(a), pb = phases_of(b);
    out.by_phases = pa.size() > 1 && same_phases(pa, pb);
    if (!out.by_phases) pa = {{"", pa.front().from, pa.back().to}}, pb = {{"", pb.front().from, pb.back().to}};
    const double rate_a =
        static_cast<double>(tracks[0][0].time.size() - 1) / std::max(1e-9, tracks[0][0].time.back() - tracks[0][0].time.front());
    for (size_t p = 0; p < pa.size(); ++p) {
        const double la = pa[p].to - pa[p].from, lb = pb[p].to - pb[p].from;
        const double rate = std::min(rate_a, static_cast<double>(kMostSamples - 1) / std::max({la, lb, 1e-9}));
        const size_t n = std::max<size_t>(2, static_cast<size_t>(la * rate) + 1),
                     m = std::max<size_t>(2, static_cast<size_t>(lb * rate) + 1);
        const std::vector<double> map = warp_onto(features(tracks, scales, 0, pa[p].from, pa[p].to, n),
                                                  features(tracks, scales, 1, pb[p].from, pb[p].to, m), kWarpWidth * tracks.size());
        for (size_t i = 0; i < n; ++i) {
            out.time.push_back(pa[p].from + la * static_cast<double>(i) / static_cast<double>(n - 1));
            out.other.push_back(pb[p].from + lb * map[i] / static_cast<double>(m - 1));
        }
    }
    out.distance = rms_distance(tracks, out.time, out.other);
    std::vector<double> equal;
    const double start = pa.front().from, shift = pb.front().from - start, last = std::min(pa.back().to, pb.back().to - shift);
    for (double t = start; t <= last; t += std::max(1e-3, (last - start) / 2000)) equal.push_back(t);
    std::vector<double> there = equal;
    for (double& t : there) t += shift;
    out.raw_distance = rms_distance(tracks, equal, there);
    return out;
}

double Signal::at(double t) const { return value.empty() ? 0 : value_at(time, value, t); }

Signal force_signal(const Exercise& e, uint32_t tool) {
    ToolTrack t = track_of(e, tool);
    return {std::move(t.time), std::move(t.force)};
}

Signal speed_signal(const Exercise& e, uint32_t tool) {
    const ToolTrack t = track_of(e, tool);
    SmoothPath p = smooth_path(t.time, t.tip, {});
    return {std::move(p.time), std::move(p.speed)};
}

Cohort summarise_cohort(const std::vector<ComparedRun>& runs) {
    Cohort cohort;
    for (const ComparedRun& r : runs)
        if (std::ranges::find(cohort.group, r.group) == cohort.group.end()) cohort.group.push_back(r.group);
    for (const std::string& group : cohort.group)
        cohort.count.push_back(static_cast<size_t>(std::ranges::count(runs, group, &ComparedRun::group)));
    for (const MetricText& text : tool_metrics()) {
        if (values_of(runs, text.key, nullptr).empty()) continue;
        MetricSummary m;
        m.key = text.key, m.unit = text.unit;
        for (const std::string& group : cohort.group) {
            const std::vector<double> values = values_of(runs, m.key, &group);
            m.quartiles.push_back({quantile_between(values, 0.25), quantile_between(values, 0.5), quantile_between(values, 0.75)});
        }
        if (cohort.group.size() == 2)
            m.area = bootstrap_area(values_of(runs, m.key, &cohort.group[0]), values_of(runs, m.key, &cohort.group[1]));
        add_trials(runs, m, cohort);
        cohort.metric.push_back(std::move(m));
    }
    return cohort;
}

std::vector<StageComparison> compare_times(const fs::path& a, const fs::path& b) {
    const StageTimes ta = read_stage_times(a), tb = read_stage_times(b);
    size_t passes = 0;
    while (passes < std::min(ta.time.size(), tb.time.size()) && std::abs(ta.time[passes] - tb.time[passes]) < 5e-4) ++passes;
    std::vector<StageComparison> out;
    if (passes < 3 * kTimeBlocks) return out;
    std::vector<double> p;
    for (size_t s = 0; s < ta.stage.size(); ++s) {
        const size_t other = static_cast<size_t>(std::ranges::find(tb.stage, ta.stage[s]) - tb.stage.begin());
        if (other == tb.stage.size()) continue;
        StageComparison c;
        c.stage = ta.stage[s];
        std::vector<double> log_ratio;
        for (size_t k = 0; k < kTimeBlocks; ++k) {
            const auto sum = [&](const std::vector<double>& ms) {
                return std::accumulate(ms.begin() + static_cast<ptrdiff_t>(passes * k / kTimeBlocks),
                                       ms.begin() + static_cast<ptrdiff_t>(passes * (k + 1) / kTimeBlocks), 0.0);
            };
            const double x = sum(ta.ms[s]), y = sum(tb.ms[other]);
            c.a_ms += x, c.b_ms += y;
            if (x > 0 && y > 0) log_ratio.push_back(std::log(y / x));
        }
        if (log_ratio.empty()) continue;
        c.a_ms /= static_cast<double>(passes), c.b_ms /= static_cast<double>(passes);
        c.ratio = std::exp(std::accumulate(log_ratio.begin(), log_ratio.end(), 0.0) / static_cast<double>(log_ratio.size()));
        p.push_back(signed_rank_p(log_ratio));
        out.push_back(c);
    }
    const std::vector<double> corrected = holm(p);
    for (size_t i = 0; i < out.size(); ++i) out[i].p = corrected[i];
    return out;
}

}  // namespace trocar
