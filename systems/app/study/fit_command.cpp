#include <algorithm>
#include <atomic>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <exception>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "content/scene/find_scene.hpp"
#include "engine/base/error.hpp"
#include "engine/files/text_file.hpp"
#include "engine/files/whole_file.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/console/progress.hpp"
#include "systems/app/console/standard_streams.hpp"
#include "systems/app/console/stop_signal.hpp"
#include "systems/app/study/curve.hpp"
#include "systems/app/study/least_squares.hpp"
#include "systems/app/study/trial_file.hpp"
namespace trocar {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

// "KEY=LOW..HIGH"
FitParameter parse_parameter(const std::string& text) {
    FitParameter p;
    const size_t equals = std::min(text.find('='), text.size()), dots = std::min(text.find("..", equals), text.size());
    const auto number = [](std::string_view word, double& value) {
        const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
        return error == std::errc() && end == word.data() + word.size() && std::isfinite(value);
    };
    const std::string_view all = text;
    const bool read = equals > 0 && dots < text.size() && number(all.substr(equals + 1, dots - equals - 1), p.low) &&
                      number(all.substr(dots + 2), p.high);
    if (!read || !(p.low > 0) || !(p.high > p.low))
        throw InputError("--parameter " + text +
                         ": write KEY=LOW..HIGH with 0 < LOW < HIGH, for example --parameter liver.tissue.youngs_modulus=1e3..1e5");
    p.key = text.substr(0, equals);
    return p;
}

// What the kept results depend on.
ordered_json identity_of(const FitOptions& o, const std::vector<FitParameter>& parameters, const ForceCurve& measured, double seconds) {
    ordered_json j{{"scene", read_text_file(find_scene(o.scene))}, {"at", measured.at}, {"seconds", seconds}, {"tool", o.tool}};
    for (const Override& set : o.overrides) j["set"].push_back(set.key + "=" + set.value);
    for (const FitParameter& p : parameters) j["parameters"].push_back(p.key);
    return j;
}

// Simulated curves by the values of the parameters.
class Trials {
 public:
    Trials(const FitOptions& options, const std::vector<FitParameter>& parameters, const ForceCurve& measured, double seconds)
        : options_(options),
          parameters_(parameters),
          measured_(measured),
          seconds_(seconds),
          scene_(find_scene(options.scene)),
          file_(options.out.empty() ? fs::path() : options.out / "trials.jsonl", identity_of(options, parameters, measured, seconds)) {}
    const TrialFile& file() const { return file_; }

    std::vector<std::vector<double>> forces(const std::vector<std::vector<double>>& rows) {
        std::vector<size_t> open;
        for (size_t i = 0; i < rows.size(); ++i)
            if (!file_.find(text_of(rows[i]))) open.push_back(i);
        std::atomic<size_t> next{0};
        std::exception_ptr failure;
        std::mutex mutex;
        const auto work = [&] {
            try {
                for (size_t k; (k = next++) < open.size() && stop_signal() == 0;) {
                    const std::vector<double> force = run(rows[open[k]]);
                    const std::lock_guard lock(mutex);
                    file_.keep(text_of(rows[open[k]]), force);
                    progress_.show(0, format("%zu runs", file_.made()));
                }
            } catch (...) {
                const std::lock_guard lock(mutex);
                failure = std::current_exception();
                next = open.size();
            }
        };
        const uint32_t wanted = options_.threads > 0 ? options_.threads : std::max(1u, std::thread::hardware_concurrency());
        std::vector<std::jthread> threads;
        while (threads.size() + 1 < std::min<size_t>(wanted, open.size())) threads.emplace_back(work);
        work();
        threads.clear();
        if (failure) std::rethrow_exception(failure);
        if (stop_signal() != 0) throw InputError("stopped" + (options_.out.empty() ? std::string() : "; the same command goes on"));
        std::vector<std::vector<double>> out;
        for (const std::vector<double>& row : rows) out.push_back(*file_.find(text_of(row)));
        return out;
    }

 private:
    static std::string text_of(const std::vector<double>& values) {
        std::string text;
        for (const double v : values) text += format("%.17g ", v);
        return text;
    }
    std::vector<double> run(const std::vector<double>& values) const {
        std::vector<Override> overrides = options_.overrides;
        for (size_t k = 0; k < values.size(); ++k) overrides.push_back({parameters_[k].key, format("%.17g", values[k])});
        const SceneFile scene = read_scene_file(scene_, overrides);
        return force_at(simulate_curve(scene, options_.tool, measured_.by_depth, seconds_), measured_.at);
    }
    const FitOptions& options_;
    const std::vector<FitParameter>& parameters_;
    const ForceCurve& measured_;
    double seconds_;
    fs::path scene_;
    TrialFile file_;
    Progress progress_{"fit"};
};

ordered_json to_json(const FitOptions& o, const std::vector<FitParameter>& parameters, const Fit& fit, double largest, size_t runs) {
    ordered_json list = ordered_json::array();
    for (size_t k = 0; k < parameters.size(); ++k) {
        const Fitted& f = fit.parameter[k];
        list.push_back({{"key", parameters[k].key}, {"value", f.value}, {"low_95", f.low}, {"high_95", f.high}, {"at_bound", f.at_bound}});
    }
    return {{"scene", o.scene}, {"curve", o.curve.string()},           {"parameters", list},         {"correlation", fit.correlation},
            {"rms_n", fit.rms}, {"rms_of_largest", fit.rms / largest}, {"converged", fit.converged}, {"runs", runs}};
}

std::string to_text(const FitOptions& o, const std::vector<FitParameter>& parameters, const Fit& fit, double largest, size_t runs) {
    std::string text, sets;
    for (size_t k = 0; k < parameters.size(); ++k) {
        const Fitted& f = fit.parameter[k];
        text += format("  %s = %.5g, 95 %% interval %.5g to %.5g%s\n", parameters[k].key.c_str(), f.value, f.low, f.high,
                       f.at_bound ? "; AT ITS BOUND" : "");
        sets += format(" --set %s=%.6g", parameters[k].key.c_str(), f.value);
    }
    for (size_t k = 0; k < parameters.size(); ++k)
        for (size_t j = 0; j < k; ++j)
            if (std::abs(fit.correlation[k][j]) > 0.95)
                text += format("  %s and %s are hardly told apart by this curve: correlation %.3f\n", parameters[j].key.c_str(),
                               parameters[k].key.c_str(), fit.correlation[k][j]);
    return text +
           format("  residuals %.3g N, %.2g %% of the largest force; %zu runs%s\ntrocar run ", fit.rms, 100 * fit.rms / largest, runs,
                  fit.converged ? "" : "; NOT CONVERGED") +
           o.scene + sets + "\n";
}

}  // namespace

int fit_command(const FitOptions& o) {
    const ForceCurve measured = read_curve(o.curve);
    if (std::ranges::all_of(measured.force, [](double f) { return f == 0; })) throw InputError(o.curve.string() + ": has no force");
    std::vector<FitParameter> parameters;
    for (const std::string& text : o.parameters) parameters.push_back(parse_parameter(text));
    if (measured.at.size() <= parameters.size()) throw InputError(o.curve.string() + ": fewer points than parameters leave nothing to fit");
    const SceneFile scene = read_scene_file(find_scene(o.scene), o.overrides);
    const double period = 1.0 / scene.contact_rate;
    const double seconds = o.seconds > 0 ? o.seconds : measured.by_depth ? scene.settings.seconds : measured.at.back() + period;
    const StopOnSignal stop;
    if (!o.out.empty()) fs::create_directories(o.out);
    Trials trials(o, parameters, measured, seconds);
    if (trials.file().taken_over() > 0)
        std::fprintf(stderr, "trocar: %zu runs of an earlier fit are taken over\n", trials.file().taken_over());
    const auto residuals = [&](const std::vector<std::vector<double>>& rows) {
        std::vector<std::vector<double>> r = trials.forces(rows);
        for (std::vector<double>& row : r)
            for (size_t i = 0; i < row.size(); ++i) row[i] -= measured.force[i];
        return r;
    };
    const Fit fit = fit_least_squares(parameters, residuals);
    double largest = 0;
    for (const double f : measured.force) largest = std::max(largest, std::abs(f));
    const ordered_json answer = to_json(o, parameters, fit, largest, trials.file().made());
    if (!o.out.empty()) {
        std::vector<double> best;
        for (const Fitted& f : fit.parameter) best.push_back(f.value);
        const std::vector<double> force = trials.forces({best})[0];
        std::string csv = std::string(measured.by_depth ? "depth_m" : "time_s") + ",measured_n,fitted_n\n";
        for (size_t i = 0; i < force.size(); ++i) csv += format("%.9g,%.9g,%.9g\n", measured.at[i], measured.force[i], force[i]);
        write_whole_file(o.out / "curve.csv", csv);
        write_whole_file(o.out / "fit.json", answer.dump(2) + "\n");
    }
    write_standard_output(o.json ? answer.dump() + "\n" : to_text(o, parameters, fit, largest, trials.file().made()));
    const bool inside = std::ranges::none_of(fit.parameter, &Fitted::at_bound);
    return fit.converged && inside ? kDone : kNo;
}

}  // namespace trocar
