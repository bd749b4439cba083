#include "systems/app/station/score.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "systems/app/console/format.hpp"
#include "systems/app/station/smooth_path.hpp"
namespace trocar {
namespace {

constexpr MetricText kTool[] = {
    {"time_s", "s", "duration of the record, first to last sample", "FLS counts time and errors", -1},
    {"path_m", "m", "length of the way of the tip, smoothed to 10 Hz: integral of its speed",
     "Rivard et al. 2014, doi 10.1007/s00464-013-3414-5", -1},
    {"economy", "", "straight distances between the tip's places at the ends of phases, over path_m: 1 is straight",
     "Rivard et al. 2014, doi 10.1007/s00464-013-3414-5", 1},
    {"sparc", "", "spectral arc length of the tip's speed up to 10 Hz: nearer to zero is smoother",
     "Balasubramanian et al. 2015, doi 10.1186/s12984-015-0090-9", 1},
    {"ldlj", "", "log dimensionless jerk -ln(T^3 / v_max^2 * integral of jerk^2), smoothed to 10 Hz: nearer to zero is smoother",
     "Balasubramanian et al. 2012, doi 10.1109/TBME.2011.2179545", 1},
    {"idle_share", "", "share of the time in which no tool is faster than the idle speed for at least the idle time",
     "D'Angelo et al. 2015, doi 10.1016/j.amjsurg.2014.12.013", -1},
    {"bimanual_overlap", "", "time in which two or more tools are faster than the idle speed, over the time in which any is",
     "after Hofstad et al. 2013", 1},
    {"turn_rad", "rad", "angle through which the tool turned in all, smoothed to 10 Hz", "", -1},
    {"contact_share", "", "share of the time in which the tip touches or holds something", "", 0},
    {"peak_force_n", "N", "largest force on the hand within limits, of all ticks", "doi 10.1089/end.2017.0894", -1},
    {"p95_force_n", "N", "95th percentile of the force on the hand at the ends of passes with any", "as peak_force_n", -1},
    {"impulse_ns", "N s", "integral of the force on the hand over time", "as peak_force_n", -1},
};
constexpr MetricText kOrgan[] = {
    {"peak_n", "N", "largest force of a tool on the organ, mean over a contact pass", "doi 10.1089/end.2017.0894", -1},
    {"p95_n", "N", "95th percentile of that force while there is any", "as peak_n", -1},
    {"impulse_ns", "N s", "integral of that force over time", "as peak_n", -1},
    {"damage_n", "N", "damage threshold: --damage ORGAN=N, or as measured for fascia, fallopian tube, bowel (traction on a suture)",
     "Rodrigues et al. 2012, doi 10.1007/s00464-011-1986-5", 0},
    {"over_damage_share", "", "time above damage_n over the time with any force", "Rodrigues et al. 2012", -1},
};

// The samples of one tool.
struct Track {
    std::vector<double> time, force, peak;
    std::vector<Vec3d> place;
    std::vector<Quat> turn;
    std::vector<uint8_t> touches;
    std::vector<uint32_t> row;  // of Exercise::sample
    SmoothPath path;
};

std::vector<Track> tracks_of(const Exercise& e) {
    std::vector<Track> tracks(e.tool.size());
    for (uint32_t i = 0; i < e.sample.size(); ++i) {
        const ExerciseSample& s = e.sample[i];
        Track& t = tracks[s.tool];
        t.time.push_back(s.time), t.place.push_back(s.tip), t.row.push_back(i);
        if (e.has_turn) t.turn.push_back(s.turn);
        t.force.push_back(s.hand.norm()), t.peak.push_back(s.hand_peak);
        t.touches.push_back(s.contacts > 0 || s.organs.count > 0);
    }
    for (Track& t : tracks) t.path = smooth_path(t.time, t.place, t.turn);
    return tracks;
}

// s, that a sample stands for: half the way to its neighbours.
double span_of(const std::vector<double>& time, size_t i) {
    const double from = i > 0 ? 0.5 * (time[i - 1] + time[i]) : time[i];
    return (i + 1 < time.size() ? 0.5 * (time[i] + time[i + 1]) : time[i]) - from;
}

// Samples, by index, within a span of time; the ends are those of the phase.
std::pair<size_t, size_t> part_of(const Track& t, double from, double to) {
    const auto low = std::ranges::lower_bound(t.time, from - 1e-9), high = std::ranges::upper_bound(t.time, to + 1e-9);
    return {static_cast<size_t>(low - t.time.begin()), static_cast<size_t>(high - t.time.begin())};
}

SmoothPath cut(const SmoothPath& p, size_t low, size_t high) {
    const auto part = [&](const auto& v) {
        return std::remove_cvref_t<decltype(v)>(v.begin() + static_cast<ptrdiff_t>(low), v.begin() + static_cast<ptrdiff_t>(high));
    };
    return {part(p.time), part(p.speed), part(p.jerk), part(p.place), part(p.turn)};
}

double straight(const Track& t, std::span<const ExercisePhase> phases) {
    double sum = 0;
    for (const ExercisePhase& p : phases) {
        const auto [low, high] = part_of(t, p.from, p.to);
        if (high > low) sum += (t.path.place[high - 1] - t.path.place[low]).norm();
    }
    return sum;
}

MetricValues motion_of(const Exercise& e, const Track& t, std::span<const ExercisePhase> phases, double from, double to) {
    MetricValues m;
    const auto [low, high] = part_of(t, from, to);
    if (high < low + 2) return m;
    const SmoothPath p = cut(t.path, low, high);
    m["time_s"] = p.time.back() - p.time.front();
    m["path_m"] = integral(p.time, p.speed);
    if (m["path_m"] > 0) m["economy"] = std::min(1.0, straight(t, phases) / m["path_m"]);
    m["sparc"] = spectral_arc_length(p), m["ldlj"] = log_dimensionless_jerk(p);
    if (e.has_turn) m["turn_rad"] = 0;
    std::vector<double> force(t.force.begin() + static_cast<ptrdiff_t>(low), t.force.begin() + static_cast<ptrdiff_t>(high)), felt;
    double touched = 0, peak = 0;
    for (size_t i = 0; i < p.time.size(); ++i) {
        if (e.has_turn && i > 0) m["turn_rad"] += p.turn[i];
        if (t.touches[low + i]) touched += span_of(p.time, i);
        if (force[i] > 0) felt.push_back(force[i]);
        peak = std::max(peak, t.peak[low + i]);
    }
    if (e.has_turn && m["turn_rad"] < 1e-9) m["turn_rad"] = 0;  // rounding
    m["contact_share"] = touched / m["time_s"];
    m["peak_force_n"] = peak;
    m["p95_force_n"] = felt.empty() ? 0 : quantile_between(felt, 0.95);
    m["impulse_ns"] = integral(p.time, force);
    return m;
}

// Whether the tool moves at each of its samples: slower spans shorter than the idle time count as motion.
std::vector<uint8_t> moving(const Track& t, const ScoreOptions& o) {
    std::vector<uint8_t> moves(t.time.size(), 1);
    for (size_t i = 0; i < moves.size();) {
        size_t j = i;
        while (j < moves.size() && t.path.speed[j] < o.idle_speed) ++j;
        if (j > i && t.time[j - 1] - t.time[i] >= o.idle_time)
            std::fill(moves.begin() + static_cast<ptrdiff_t>(i), moves.begin() + static_cast<ptrdiff_t>(j), 0);
        i = std::max(j, i + 1);
    }
    return moves;
}

// idle_share and bimanual_overlap of tools within a span of time, at the samples of the first of them.
void add_idleness(const std::vector<Track>& tracks, const std::vector<std::vector<uint8_t>>& moves, std::span<const size_t> tools,
                  double from, double to, MetricValues& m) {
    const Track& first = tracks[tools[0]];
    const auto [low, high] = part_of(first, from, to);
    double idle = 0, any = 0, both = 0;
    std::vector<size_t> at(tracks.size(), 0);
    for (size_t i = low; i + 1 < high; ++i) {
        const double middle = 0.5 * (first.time[i] + first.time[i + 1]), span = first.time[i + 1] - first.time[i];
        size_t count = 0;
        for (const size_t tool : tools) {
            const Track& t = tracks[tool];
            while (at[tool] + 1 < t.time.size() && t.time[at[tool] + 1] <= middle) ++at[tool];
            count += !moves[tool].empty() && moves[tool][at[tool]];
        }
        (count > 0 ? any : idle) += span;
        if (count > 1) both += span;
    }
    if (any + idle > 0) m["idle_share"] = idle / (any + idle);
    if (tools.size() > 1) m["bimanual_overlap"] = any > 0 ? both / any : 0;
}

MetricValues joined(const std::vector<MetricValues>& tools) {
    MetricValues all;
    if (tools.size() == 1) return tools[0];
    const auto over = [&](const char* key, auto&& put) {
        double count = 0;
        for (const MetricValues& m : tools) {
            const auto at = m.find(key);
            if (at != m.end()) put(all[key], at->second), ++count;
        }
        return count;
    };
    for (const char* key : {"time_s", "peak_force_n", "p95_force_n"}) over(key, [](double& a, double b) { a = std::max(a, b); });
    for (const char* key : {"path_m", "turn_rad", "impulse_ns"}) over(key, [](double& a, double b) { a += b; });
    for (const char* key : {"economy", "sparc", "ldlj", "contact_share"})
        if (const double n = over(key, [](double& a, double b) { a += b; }); n > 0) all[key] /= n;
    return all;
}

std::vector<MetricValues> organs_of(const Exercise& e, const std::vector<Track>& tracks, const ScoreOptions& options) {
    std::vector<MetricValues> out(e.organ.size());
    std::vector<std::vector<double>> forces(e.organ.size());
    std::vector<double> loaded(e.organ.size(), 0), over(e.organ.size(), 0), limit(e.organ.size());
    for (size_t o = 0; o < e.organ.size(); ++o) {
        const auto said = options.damage.find(e.organ[o]);
        limit[o] = said != options.damage.end() ? said->second : measured_damage(e.organ[o]);
        out[o]["impulse_ns"] = 0;
    }
    for (const Track& t : tracks) {
        for (size_t i = 0; i < t.row.size(); ++i) {
            const ExerciseSample& s = e.sample[t.row[i]];
            const double span = i > 0 ? t.time[i] - t.time[i - 1] : span_of(t.time, 0);  // a mean over the pass that ends here
            for (uint32_t k = s.organs.first; k < s.organs.end(); ++k) {
                const OrganForce& f = e.organ_force[k];
                forces[f.organ].push_back(f.force), out[f.organ]["impulse_ns"] += span * f.force;
                loaded[f.organ] += span;
                if (limit[f.organ] > 0 && f.force > limit[f.organ]) over[f.organ] += span;
            }
        }
    }
    for (size_t o = 0; o < e.organ.size(); ++o) {
        if (forces[o].empty()) continue;
        out[o]["peak_n"] = *std::ranges::max_element(forces[o]), out[o]["p95_n"] = quantile_between(forces[o], 0.95);
        if (limit[o] > 0) out[o]["damage_n"] = limit[o], out[o]["over_damage_share"] = loaded[o] > 0 ? over[o] / loaded[o] : 0;
    }
    return out;
}

nlohmann::ordered_json values_json(const MetricValues& values, std::span<const MetricText> metrics) {
    nlohmann::ordered_json j = nlohmann::ordered_json::object();
    for (const MetricText& m : metrics)
        if (const auto at = values.find(m.key); at != values.end()) j[m.key] = at->second;
    return j;
}

}  // namespace

std::span<const MetricText> tool_metrics() { return kTool; }
std::span<const MetricText> organ_metrics() { return kOrgan; }

double measured_damage(const std::string& organ) {
    std::string name;
    for (const char c : organ) name += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    const auto says = [&](const char* word) { return name.find(word) != std::string::npos; };
    return says("fascia") ? 11.43 : says("fallopian") ? 1.25 : says("bowel") ? 1.5 : 0;
}

double quantile_between(std::vector<double> values, double q) {
    if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
    std::ranges::sort(values);
    const double at = q * static_cast<double>(values.size() - 1);
    const size_t low = static_cast<size_t>(at);
    const double next = values[std::min(low + 1, values.size() - 1)];
    return values[low] + (at - static_cast<double>(low)) * (next - values[low]);
}

Score score_exercise(const Exercise& e, const ScoreOptions& options) {
    Score score;
    const std::vector<Track> tracks = tracks_of(e);
    const std::vector<ExercisePhase> phases = phases_of(e);
    std::vector<std::vector<uint8_t>> moves;
    std::vector<size_t> everyone;
    for (size_t t = 0; t < tracks.size(); ++t) {
        moves.push_back(moving(tracks[t], options));
        if (tracks[t].time.size() > 1) everyone.push_back(t);
    }
    const auto of = [&](std::span<const ExercisePhase> parts, double from, double to, std::vector<MetricValues>& each) {
        for (size_t t = 0; t < tracks.size(); ++t) {
            each.push_back(motion_of(e, tracks[t], parts, from, to));
            const size_t alone[] = {t};
            if (!each.back().empty()) add_idleness(tracks, moves, alone, from, to, each.back());
        }
        MetricValues all = joined(each);
        if (!everyone.empty()) add_idleness(tracks, moves, everyone, from, to, all);
        return all;
    };
    if (e.sample.empty()) return score;
    score.all = of(phases, e.sample.front().time, e.sample.back().time, score.tool);
    for (const ExercisePhase& p : phases) {
        std::vector<MetricValues> each;
        score.phase.emplace_back(p, of(std::span(&p, 1), p.from, p.to, each));
    }
    score.organ = organs_of(e, tracks, options);
    return score;
}

std::string score_json(const Exercise& e, const Score& score) {
    using json = nlohmann::ordered_json;
    json j = {{"run", e.source}, {"scene", e.scene}, {"state_hash", e.state_hash}, {"rate_hz", e.rate}, {"samples", e.sample.size()}};
    j.update(values_json(score.all, kTool));
    for (size_t t = 0; t < e.tool.size(); ++t) j["tools"][e.tool[t]] = values_json(score.tool[t], kTool);
    for (size_t o = 0; o < e.organ.size(); ++o) j["organs"][e.organ[o]] = values_json(score.organ[o], kOrgan);
    for (const auto& [phase, values] : score.phase) {
        json row = {{"name", phase.name}, {"from_s", phase.from}, {"to_s", phase.to}};
        row.update(values_json(values, kTool));
        j["phases"].push_back(row);
    }
    return j.dump(2) + "\n";
}

std::string score_text(const Exercise& e, const Score& score) {
    std::string out =
        e.source + (e.scene.empty() ? "" : " (" + e.scene + ")") + format(": %zu samples at %.0f Hz\n", e.sample.size(), e.rate);
    const auto rows = [&](const std::string& title, const MetricValues& values, std::span<const MetricText> metrics) {
        out += "  " + title + "\n";
        for (const MetricText& m : metrics)
            if (const auto at = values.find(m.key); at != values.end()) out += format("    %-18s %12.6g %s\n", m.key, at->second, m.unit);
    };
    rows(e.tool.size() > 1 ? "all tools" : "tool " + (e.tool.empty() ? "" : e.tool[0]), score.all, kTool);
    for (size_t t = 0; e.tool.size() > 1 && t < e.tool.size(); ++t) rows("tool " + e.tool[t], score.tool[t], kTool);
    for (size_t o = 0; o < e.organ.size(); ++o) rows("organ " + e.organ[o], score.organ[o], kOrgan);
    for (const auto& [phase, values] : score.phase) {
        const auto at = [&](const char* key) { return values.contains(key) ? values.at(key) : 0.0; };
        out += format("  phase %8.3f to %8.3f s: ", phase.from, phase.to) + phase.name +
               format(", path %.4g m, idle %.0f %%, peak %.3g N\n", at("path_m"), 100 * at("idle_share"), at("peak_force_n"));
    }
    return out;
}

}  // namespace trocar
