#include <time.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "content/scene/build_scene.hpp"
#include "content/scene/find_scene.hpp"
#include "engine/base/error.hpp"
#include "engine/files/text_file.hpp"
#include "engine/files/whole_file.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/console/progress.hpp"
#include "systems/app/console/standard_streams.hpp"
#include "systems/app/console/stop_signal.hpp"
#include "systems/app/study/trial_file.hpp"
#include "systems/frame/frame.hpp"
namespace trocar {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

constexpr double kDisplayRate = 30;  // Hz
constexpr double kMilli = 1e3;

// One choice and the values it may take, the scene's own first: an empty text.
struct Knob {
    const char* key;
    std::vector<std::string> values;
};
// What speed and accuracy of a scene depend on. Steps beyond what is stable are shortened, so a long substep asks for the longest.
const Knob kKnobs[] = {{"contact.rate", {"", "30", "60", "120", "240"}},  {"contact.iterations", {"", "1", "2", "4", "8"}},
                       {"substep", {"", "5e-4", "1e-3", "2e-3", "4e-3"}}, {"body.integrator", {"", "\"leapfrog\"", "\"implicit\""}},
                       {"contact.tolerance", {"", "1e-3", "1e-4"}},       {"contact.cell_edges", {"", "1.5", "4"}}};
// Contact passes as often and steps as short as they go, until twice as many change less than the errors that are asked for.
const std::vector<Override> kReference = {
    {"contact.rate", "240"}, {"contact.iterations", "16"}, {"contact.tolerance", "1e-5"}, {"substep", "2.5e-4"}};

using Choice = std::array<size_t, std::size(kKnobs)>;

std::vector<Override> overrides_of(const Choice& c) {
    std::vector<Override> list;
    for (size_t k = 0; k < c.size(); ++k)
        if (c[k] > 0) list.push_back({kKnobs[k].key, kKnobs[k].values[c[k]]});
    return list;
}
std::string text_of(const std::vector<Override>& overrides) {
    std::string text;
    for (const Override& o : overrides) text += " --set " + o.key + "=" + o.value;
    return text;
}

// Surface vertices of every movable body at each displayed frame, m, and the processor time of the passes.
struct Course {
    std::vector<std::vector<Vec3d>> body;
    double milliseconds = 0;  // of a displayed frame
};

double thread_seconds() {
    timespec t{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

Course simulate(const SceneFile& scene, double seconds) {
    const FloatModeScope ours;
    FrameOptions options;
    options.pictures = options.account_energy = false;
    Frame frame(build_scene(scene, Looks::kPlain).world, options);
    const World& w = frame.world();
    Course course;
    course.body.resize(w.bodies.mesh.size());
    double used = 0;
    uint64_t shown = 0;
    while (1e-3 * static_cast<double>(w.clock.tick) < seconds - 1e-9 && stop_signal() == 0) {
        const double before = thread_seconds();
        frame.step();
        used += thread_seconds() - before;
        const auto now = static_cast<uint64_t>(1e-3 * kDisplayRate * static_cast<double>(w.clock.tick) + 1e-6);
        if (now == shown) continue;
        shown = now;
        for (uint32_t b = 0; b < course.body.size(); ++b)
            for (uint32_t v = 0; joins_islands(w.bodies.motion[b]) && v < w.meshes.info[w.bodies.mesh[b]].vertices.count; ++v)
                course.body[b].push_back(vertex_position(surfaces_of(w), b, v));
    }
    course.milliseconds = kMilli * used / (kDisplayRate * seconds);
    return course;
}

// mm: root mean square over vertices and frames of the worst body, and the largest distance of all.
std::array<double, 2> error_of(const Course& course, const Course& reference) {
    double worst = 0, largest = 0;
    for (size_t b = 0; b < reference.body.size(); ++b) {
        const size_t count = std::min(course.body[b].size(), reference.body[b].size());
        double sum = 0;
        for (size_t i = 0; i < count; ++i) {
            const double d2 = (course.body[b][i] - reference.body[b][i]).squaredNorm();
            sum += d2, largest = std::max(largest, d2);
        }
        if (count > 0) worst = std::max(worst, sum / static_cast<double>(count));
    }
    return {kMilli * std::sqrt(worst), kMilli * std::sqrt(largest)};
}

struct Tried {
    Choice choice{};
    double milliseconds = INFINITY, rms = INFINITY, largest = INFINITY;  // of a displayed frame; mm; mm
};

class Tuner {
 public:
    Tuner(const TuneOptions& o, TrialFile& file, double seconds) : o_(o), file_(file), seconds_(seconds), path_(find_scene(o.scene)) {}

    // The best choice: the cheapest that keeps both limits, else the most accurate within the budget, else the cheapest. What makes no
    // difference is left as the scene has it.
    Tried search() {
        Tried best = tried({});
        if (o_.exhaustive) return every(best);
        for (bool better = true; better;) {
            better = false;
            for (size_t k = 0; k < std::size(kKnobs); ++k)
                for (size_t v = 0; v < kKnobs[k].values.size(); ++v) better = take_if_better(k, v, best) || better;
        }
        for (size_t k = 0; k < std::size(kKnobs); ++k) {
            Choice plain = best.choice;
            if (std::exchange(plain[k], 0) == 0) continue;
            if (const Tried t = tried(plain); !is_better(best, t)) best = t;
        }
        return best;
    }
    bool keeps(const Tried& t) const { return t.rms <= o_.error_mm && t.milliseconds <= o_.budget_ms; }
    // What no other choice beats in both, cheapest first.
    std::vector<Tried> front() const {
        std::vector<Tried> list = all_;
        std::ranges::sort(list, {}, &Tried::milliseconds);
        std::vector<Tried> front;
        for (const Tried& t : list)
            if (std::isfinite(t.rms) && (front.empty() || t.rms < front.back().rms)) front.push_back(t);
        return front;
    }

 private:
    bool take_if_better(size_t knob, size_t value, Tried& best) {
        Choice c = best.choice;
        if (std::exchange(c[knob], value) == value) return false;
        const Tried t = tried(c);
        const bool better = is_better(t, best);
        if (better) best = t;
        return better;
    }
    Tried every(Tried best) {
        Choice c{};
        for (bool more = true; more;) {
            if (const Tried t = tried(c); is_better(t, best)) best = t;
            more = false;
            for (size_t k = 0; k < c.size() && !more; ++k) more = ++c[k] < kKnobs[k].values.size() || (c[k] = 0, false);
        }
        return best;
    }
    bool is_better(const Tried& a, const Tried& b) const {
        if (keeps(a) != keeps(b)) return keeps(a);
        if (keeps(a)) return a.milliseconds < (1 - kNoise) * b.milliseconds;
        const bool cheap_a = a.milliseconds <= o_.budget_ms, cheap_b = b.milliseconds <= o_.budget_ms;
        if (cheap_a != cheap_b) return cheap_a;
        return cheap_a ? a.rms < b.rms : a.milliseconds < (1 - kNoise) * b.milliseconds;
    }
    std::vector<Override> with(std::vector<Override> more) const {
        std::vector<Override> list = o_.overrides;
        list.insert(list.end(), more.begin(), more.end());
        return list;
    }
    const Course& reference() {
        if (reference_.body.empty()) reference_ = simulate(read_scene_file(path_, with(kReference)), seconds_);
        return reference_;
    }
    Tried tried(const Choice& c) {
        const std::vector<Override> asked = overrides_of(c);
        const std::string text = text_of(asked);
        const auto known = std::ranges::find_if(all_, [&](const Tried& t) { return t.choice == c; });
        if (known != all_.end()) return *known;
        progress_.show(0, format("%zu runs%s", file_.made(), text.c_str()));
        if (!file_.find(text)) file_.keep(text, measure(asked));
        const std::vector<double>& r = *file_.find(text);
        all_.push_back({c, r[0], r[1], r[2]});
        if (r.size() < 3 || !(r[0] >= 0)) all_.back() = {c};
        return all_.back();
    }
    // Milliseconds and errors; -1 if the scene refuses the values. The shorter of two times, as other programs only add.
    std::vector<double> measure(const std::vector<Override>& asked) {
        try {
            const SceneFile scene = read_scene_file(path_, with(asked));
            const Course first = simulate(scene, seconds_);
            const auto [rms, largest] = error_of(first, reference());
            const double again = simulate(scene, seconds_).milliseconds;
            if (stop_signal() != 0) throw Stopped{};
            return {std::min(first.milliseconds, again), rms, largest};
        } catch (const InputError&) {
            if (asked.empty()) throw;
            return {-1, 0, 0};
        }
    }
    static constexpr double kNoise = 0.03;  // of a processor time, measured twice
    const TuneOptions& o_;
    TrialFile& file_;
    double seconds_;
    fs::path path_;
    Course reference_;
    std::vector<Tried> all_;
    Progress progress_{"tune"};

 public:
    struct Stopped {};
};

ordered_json to_json(const Tried& t) {
    ordered_json set = ordered_json::object();
    for (const Override& o : overrides_of(t.choice)) set[o.key] = o.value;
    return {{"set", set}, {"ms_per_frame", t.milliseconds}, {"rms_mm", t.rms}, {"largest_mm", t.largest}};
}

std::string line_of_choice(const Tried& t) {
    const std::string set = text_of(overrides_of(t.choice));
    return format("%9.3f ms %10.4f mm rms %10.4f mm largest %s\n", t.milliseconds, t.rms, t.largest,
                  set.empty() ? " as the scene is" : set.c_str());
}

}  // namespace

int tune_command(const TuneOptions& o) {
    const fs::path path = find_scene(o.scene);
    const SceneFile scene = read_scene_file(path, o.overrides);
    const double seconds = o.seconds > 0 ? o.seconds : std::min(scene.settings.seconds, 1.0);
    ordered_json identity{{"scene", read_text_file(path)}, {"seconds", seconds}, {"set", text_of(o.overrides)}};
    const StopOnSignal stop;
    TrialFile file(o.trials, identity);
    if (file.taken_over() > 0) std::fprintf(stderr, "trocar: %zu runs of an earlier search are taken over\n", file.taken_over());
    Tuner tuner(o, file, seconds);
    try {
        const Tried best = tuner.search();
        const bool keeps = tuner.keeps(best);
        std::string text = "what no other choice beats, a displayed frame (1/30 s) on one core:\n";
        ordered_json front = ordered_json::array();
        for (const Tried& t : tuner.front()) text += line_of_choice(t), front.push_back(to_json(t));
        text += keeps ? "chosen:\n" : "nothing keeps both limits; nearest:\n";
        text += line_of_choice(best) + "trocar run " + o.scene + text_of(o.overrides) + text_of(overrides_of(best.choice)) + "\n";
        if (!o.out.empty()) {
            std::vector<Override> all = o.overrides;
            for (const Override& c : overrides_of(best.choice)) all.push_back(c);
            const std::string head = format("# Tuned by trocar tune for %g ms and %g mm over %g s:\n#%s", o.budget_ms, o.error_mm, seconds,
                                            line_of_choice(best).c_str());
            write_whole_file(o.out, head + scene_text_with(path, all));
        }
        const ordered_json answer{
            {"chosen", to_json(best)}, {"keeps_limits", keeps}, {"front", front}, {"seconds", seconds}, {"runs", file.made()}};
        write_standard_output(o.json ? answer.dump() + "\n" : text);
        return keeps ? kDone : kNo;
    } catch (const Tuner::Stopped&) {
        std::fprintf(stderr, "trocar: stopped%s\n", o.trials.empty() ? "" : "; the same command goes on");
        return exit_code_of_signal(stop_signal());
    }
}

}  // namespace trocar
