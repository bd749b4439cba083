#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "engine/base/error.hpp"
#include "engine/draw/offscreen.hpp"
#include "engine/files/whole_file.hpp"
#include "systems/app/capture/capture_difference.hpp"
#include "systems/app/capture/capture_export.hpp"
#include "systems/app/capture/what_if.hpp"
#include "systems/app/console/command_pool.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/console/standard_streams.hpp"
#include "systems/app/report/run_costs.hpp"
namespace trocar {
namespace {

// The slowest judged pass; the first passes (cold memory and caches) only if there are no others.
const CaptureStep* worst_step(const Capture& capture) {
    const CaptureStep* worst = nullptr;
    const auto is_worse = [&](const CaptureStep& step) {
        const bool judged = step.pass >= kFirstJudged, was_judged = worst && worst->pass >= kFirstJudged;
        return !worst || (judged == was_judged ? step.frame_ms > worst->frame_ms : judged);
    };
    for (const Capture::Stretch& stretch : capture.stretches)
        for (const CaptureStep& step : stretch.steps)
            if (is_worse(step)) worst = &step;
    return worst;
}

// The stage that took longest in a pass.
std::string longest_stage(const Capture& capture, const CaptureStep& step) {
    const size_t count = std::min(step.stage_ns.size(), capture.header.stages.size());
    if (count == 0) return "";
    const auto longest = std::max_element(step.stage_ns.begin(), step.stage_ns.begin() + static_cast<ptrdiff_t>(count));
    return format("%s %.3f ms", capture.header.stages[static_cast<size_t>(longest - step.stage_ns.begin())].c_str(),
                  static_cast<double>(*longest) * 1e-6);
}

std::string info_json(const Capture& c, const std::optional<PairFigures>& pair) {
    nlohmann::ordered_json out{{"file", c.file},
                               {"scene", c.header.scene},
                               {"reason", c.header.reason},
                               {"version", c.header.version},
                               {"instruction_set", c.header.instruction_set},
                               {"machine", c.header.machine},
                               {"live", c.header.live},
                               {"whole", c.damage.empty()},
                               {"damage", c.damage},
                               {"first_pass", c.stretches.front().pass},
                               {"passes", c.passes()},
                               {"states", c.stretches.size()}};
    if (!c.picture.png.empty())
        out["picture"] = {
            {"pass", c.picture.pass}, {"width", kCapturePictureWidth}, {"height", kCapturePictureHeight}, {"bytes", c.picture.png.size()}};
    if (const CaptureStep* worst = worst_step(c)) {
        if (pair)
            out["worst_pair"] = {{"pair", pair->name}, {"ms", pair->ms}, {"candidate_vertices", pair->vertices}, {"cell_m", pair->cell}};
        out["worst_pass"] = worst->pass, out["worst_ms"] = worst->frame_ms;
        out["state_hash"] = hex(c.stretches.back().steps.empty() ? worst->state_hash : c.stretches.back().steps.back().state_hash);
    }
    return out.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";  // names of files may be anything
}

// A damaged or unfinished capture must not be reported as complete: returns kNo for it, otherwise `code`.
int judge_whole(const Capture& c, int code) {
    if (c.damage.empty()) return code;
    std::fprintf(stderr, "trocar: warning: %s is not whole: it %s; only the %zu passes before are used\n", c.file.c_str(), c.damage.c_str(),
                 c.passes());
    return kNo;
}

void print_info(const Capture& c, const std::optional<PairFigures>& pair) {
    const CaptureHeader& h = c.header;
    write_standard_output(format("%s: scene %s, %s, trocar %s, %s\n  %s%s\n  passes %llu to %llu, %zu states\n", c.file.c_str(),
                                 h.scene.c_str(), h.reason.c_str(), h.version.c_str(), h.instruction_set.c_str(), h.machine.c_str(),
                                 h.live ? ", live" : "", static_cast<unsigned long long>(c.stretches.front().pass),
                                 static_cast<unsigned long long>(c.stretches.front().pass + c.passes() - (c.passes() > 0)),
                                 c.stretches.size()));
    if (const CaptureStep* worst = worst_step(c)) {
        write_standard_output(format("  slowest: pass %llu, %.3f ms (%s); depth %.3f mm, %llu contacts\n",
                                     static_cast<unsigned long long>(worst->pass), worst->frame_ms, longest_stage(c, *worst).c_str(),
                                     worst->depth * 1e3, static_cast<unsigned long long>(worst->contacts)));
    }
    if (pair)
        write_standard_output(format("  its dearest pair: %s: %.3f ms of detection, %.0f candidate vertices, cell %.2f mm\n",
                                     pair->name.c_str(), pair->ms, pair->vertices, pair->cell * 1e3));
    if (!c.picture.png.empty())
        write_standard_output(format("  a picture of the end of pass %llu, %u x %u (capture info --picture FILE.png writes it)\n",
                                     static_cast<unsigned long long>(c.picture.pass), kCapturePictureWidth, kCapturePictureHeight));
    if (!c.damage.empty()) write_standard_output("  incomplete: it " + c.damage + "\n");
}

// "; first in stage ...": where two captures differ after a pass, if that pass can be replayed here.
std::string tell_pass(const Capture& a, const Capture& b, uint64_t pass) {
    CommandPool pool(0);
    std::string text;
    pool.run([&] {
        try {
            text = pass_difference(a, b, pass);
        } catch (const InputError&) {
            text.clear();  // one of the two cannot be simulated
        }
    });
    return text.empty() ? "" : "; " + text;
}

int diff(const Capture& a, const Capture& b) {
    if (const std::string array = first_difference(a.scene, b.scene, &a.scene); !array.empty()) {
        write_standard_output("the scenes differ first in " + array + "\n");
        return kNo;
    }
    size_t compared = 0;
    for (const Capture::Stretch& x : a.stretches) {
        for (const Capture::Stretch& y : b.stretches) {
            if (x.pass == y.pass) {
                if (const std::string array = first_difference(x.state, y.state, &a.scene); !array.empty()) {
                    write_standard_output("the states before pass " + std::to_string(x.pass) + " differ first in " + array + "\n");
                    return kNo;
                }
            }
            for (const CaptureStep& s : x.steps) {
                if (s.pass < y.pass || s.pass >= y.pass + y.steps.size()) continue;
                ++compared;
                if (y.steps[s.pass - y.pass].state_hash == s.state_hash) continue;
                write_standard_output("pass " + std::to_string(s.pass) + " differs: " + hex(s.state_hash) + " and " +
                                      hex(y.steps[s.pass - y.pass].state_hash) + tell_pass(a, b, s.pass) + "\n");
                return kNo;
            }
        }
    }
    if (compared == 0)
        write_standard_output("the captures have no pass in common\n");
    else
        write_standard_output("identical in all " + std::to_string(compared) + " common passes\n");
    return compared > 0 ? kDone : kNo;
}

void print_profile(const PassProfile& profile, uint64_t pass) {
    write_standard_output(format("pass %llu, %zu times: median %.3f ms, p90 %.3f ms, least %.3f ms (warm caches)\n%-18s %10s %10s %10s\n",
                                 static_cast<unsigned long long>(pass), profile.pass_ms.size(), quantile(profile.pass_ms, 0.5),
                                 quantile(profile.pass_ms, 0.9), quantile(profile.pass_ms, 0), "stage", "median ms", "p90 ms", "least ms"));
    std::string idle;
    for (size_t i = 0; i < profile.stage.size(); ++i) {
        const std::vector<double>& ms = profile.stage_ms[i];
        if (quantile(ms, 1) == 0) {
            idle += (idle.empty() ? "not in this pass: " : ", ") + profile.stage[i];
            continue;
        }
        write_standard_output(
            format("%-18s %10.4f %10.4f %10.4f\n", profile.stage[i].c_str(), quantile(ms, 0.5), quantile(ms, 0.9), quantile(ms, 0)));
    }
    if (!idle.empty()) write_standard_output(idle + "\n");
}

std::string profile_json(const PassProfile& profile, uint64_t pass) {
    nlohmann::ordered_json out{
        {"pass", pass}, {"repetitions", profile.pass_ms.size()}, {"median_ms", quantile(profile.pass_ms, 0.5)}, {"same", profile.same}};
    for (size_t i = 0; i < profile.stage.size(); ++i)
        out["stages"][profile.stage[i]] = {{"median_ms", quantile(profile.stage_ms[i], 0.5)},
                                           {"p90_ms", quantile(profile.stage_ms[i], 0.9)}};
    return out.dump() + "\n";
}

int profile(const ReplayOptions& options, const Capture& capture) {
    constexpr size_t kTraceCapacity = 1u << 18;
    Trace trace(options.trace.empty() ? 0 : kTraceCapacity);
    const PassProfile profile = profile_pass(capture, *options.frame, options.repeat, options.trace.empty() ? nullptr : &trace);
    if (!options.trace.empty()) write_trace(options.trace, trace, {"main"});
    if (options.json)
        write_standard_output(profile_json(profile, *options.frame));
    else
        print_profile(profile, *options.frame);
    if (!profile.same) std::fprintf(stderr, "trocar: %s: the pass does not end as it was captured\n", capture.file.c_str());
    return profile.same ? kDone : kNo;
}

int replay(const ReplayOptions& options, const Capture& capture) {
    const ReplayVerdict verdict = replay_capture(capture, {});
    const bool same = verdict.difference.empty();
    if (options.json) {
        write_standard_output(nlohmann::ordered_json{{"passes", verdict.compared},
                                                     {"same", same},
                                                     {"difference", verdict.difference},
                                                     {"whole", capture.damage.empty()},
                                                     {"damage", capture.damage},
                                                     {"threads", thread_count()}}
                                  .dump() +
                              "\n");
    } else {
        write_standard_output(std::to_string(verdict.compared) + " passes replayed on " + std::to_string(thread_count()) + " thread" +
                              (thread_count() == 1 ? "" : "s") + ": " + (same ? "the same to the bit" : verdict.difference) + "\n");
    }
    return judge_whole(capture, same ? kDone : kNo);
}

int try_changes(const ReplayOptions& options, const Capture& capture) {
    const std::vector<WhatIfPass> passes = what_if(capture, options.changes);
    if (!options.csv.empty()) write_whole_file(options.csv, what_if_csv(passes));
    write_standard_output(what_if_text(passes));
    return judge_whole(capture, kDone);
}

void refuse_same(const std::filesystem::path& a, const std::filesystem::path& b) {
    if (!a.empty() && !b.empty() && std::filesystem::weakly_canonical(a) == std::filesystem::weakly_canonical(b))
        throw InputError("capture export: " + a.string() + " is named twice");
}

}  // namespace

int capture_info_command(const std::vector<std::string>& files, bool json, const std::filesystem::path& picture) {
    if (!picture.empty() && files.size() > 1) throw InputError("capture info: --picture FILE.png is for one capture");
    for (const std::string& file : files) {
        const Capture capture = open_capture(file);
        if (!picture.empty()) {
            refuse_same(picture, file);
            if (capture.picture.png.empty()) throw InputError(file + ": has no picture");
            write_whole_file(picture, std::string(capture.picture.png.begin(), capture.picture.png.end()));
        }
        std::optional<PairFigures> pair;
        CommandPool pool(0);
        if (const CaptureStep* worst = worst_step(capture)) pool.run([&] { pair = dearest_pair(capture, *worst); });
        if (json)
            write_standard_output(info_json(capture, pair));
        else
            print_info(capture, pair);
    }
    return kDone;
}

int capture_diff_command(const std::string& a, const std::string& b) {
    const Capture one = open_capture(a), other = open_capture(b);
    return judge_whole(one, judge_whole(other, diff(one, other)));
}

int capture_export_command(const CaptureExportOptions& options) {
    const Capture capture = open_capture(options.file);
    if (options.vtp.empty() && options.png.empty() && options.trace.empty() && options.csv.empty() && options.html.empty())
        throw InputError("capture export: choose an output: --vtp FOLDER, --png FOLDER, --trace FILE, --csv FILE or --html FILE");
    if (options.per_body && options.vtp.empty()) throw InputError("capture export: --per-body needs --vtp FOLDER");
    refuse_same(options.csv, options.file), refuse_same(options.trace, options.file), refuse_same(options.csv, options.trace);
    for (const std::filesystem::path& other : {options.csv, options.trace, std::filesystem::path(options.file)})
        refuse_same(options.html, other);
    if (!options.csv.empty()) write_whole_file(options.csv, capture_csv(capture));
    if (!options.trace.empty()) write_whole_file(options.trace, capture_trace(capture));
    set_offscreen_threads(0);
    CommandPool pool(options.threads);
    pool.run([&] {
        if (!options.vtp.empty()) export_vtp(capture, options.vtp, options.per_body);
        if (!options.html.empty()) write_whole_file(options.html, capture_page(capture));
        if (!options.png.empty() && export_pictures(capture, options.png) == 0)
            std::fprintf(stderr, "trocar: note: the passes of %s contain no picture\n", options.file.c_str());
    });
    return judge_whole(capture, kDone);
}

int replay_command(const ReplayOptions& options) {
    const Capture capture = open_capture(options.file);
    CommandPool pool(options.threads);
    int code = kFault;
    pool.run([&] {
        code = options.frame             ? profile(options, capture)
               : options.changes.empty() ? replay(options, capture)
                                         : try_changes(options, capture);
    });
    return code;
}

}  // namespace trocar
