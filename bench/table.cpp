#include "bench/table.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "engine/base/error.hpp"
#include "engine/files/whole_file.hpp"
namespace trocar::bench {
namespace {

double ratio_of(const Row& row) { return row.goal == Goal::kPeerShare ? row.ours / row.peer_value : row.peer_value / row.ours; }

std::optional<bool> reaches(const Row& row, double limit) {
    if (row.goal == Goal::kNone || !row.not_judged.empty()) return {};
    switch (row.goal) {
        case Goal::kRatio:
            return ratio_of(row) >= limit;
        case Goal::kPeerShare:
            return ratio_of(row) <= limit;
        default:
            return row.ours <= limit;
    }
}
std::optional<bool> met(const Row& row) { return reaches(row, row.at_least); }

std::string figure(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.3g", value);
    return text;
}

nlohmann::ordered_json number(double value) {
    return std::isfinite(value) ? nlohmann::ordered_json(value) : nlohmann::ordered_json(nullptr);
}
nlohmann::ordered_json text(const std::string& value) {
    return value.empty() ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(value);
}

nlohmann::ordered_json to_json(const std::string& suite, const Row& row) {
    nlohmann::ordered_json j = {{"suite", suite}, {"name", row.name}, {"ours", number(row.ours)}, {"unit", row.unit}};
    j["peer"] = text(row.peer);
    j["peer_value"] = number(row.peer_value);
    j["ratio"] = number(ratio_of(row));
    j["error"] = number(row.error);
    j["peer_error"] = number(row.peer_error);
    j["smooth_error"] = number(row.smooth_error);
    j["error_unit"] = text(row.error_unit);
    constexpr const char* kGoals[] = {"none", "ratio", "peer_share", "limit"};
    j["goal"] = kGoals[static_cast<int>(row.goal)];
    j["at_least"] = number(row.at_least);
    j["aim"] = number(row.aim);
    const std::optional<bool> judged = met(row);
    j["met"] = judged ? nlohmann::ordered_json(*judged) : nlohmann::ordered_json(nullptr);
    j["not_judged"] = text(row.not_judged);
    j["note"] = text(row.note);
    j["plot"] = text(row.plot);
    j["series"] = text(row.series);
    if (!row.axes.empty()) j["axes"] = row.axes;
    for (const auto& [name, value] : row.beside) j["beside"][name] = number(value);
    return j;
}

void print(const Row& row) {
    std::printf("  %-58s %10.4g %-6s", row.name.c_str(), row.ours, row.unit.c_str());
    if (!row.peer.empty()) std::printf("  %s %.4g, %.3g x", row.peer.c_str(), row.peer_value, ratio_of(row));
    if (std::isfinite(row.error)) std::printf("  error %.3g %s", row.error, row.error_unit.c_str());
    if (std::isfinite(row.peer_error)) std::printf(" (peer %.3g)", row.peer_error);
    if (std::isfinite(row.smooth_error)) std::printf(", smooth %.3g", row.smooth_error);
    if (row.goal != Goal::kNone) {
        const std::optional<bool> judged = met(row);
        std::printf("  [%s %.3g, aim %.3g: %s]", row.goal == Goal::kRatio ? "at least" : "at most", row.at_least, row.aim,
                    !judged   ? row.not_judged.c_str()
                    : *judged ? "met"
                              : "MISSED");
    }
    for (const auto& [name, value] : row.beside) std::printf("  %s %.3g", name.c_str(), value);
    if (!row.note.empty()) std::printf("  %s", row.note.c_str());
    std::printf("\n");
    std::fflush(stdout);
}

}  // namespace

Report::Report(std::string suite, int& argc, char** argv) : suite_(std::move(suite)) {
    int kept = 1;
    for (int i = 1; i < argc; ++i) {
        if (std::strcmp(argv[i], "--quick") == 0) {
            quick_ = true;
        } else if (std::strcmp(argv[i], "--json") == 0 && i + 1 < argc) {
            json_ = argv[++i];
        } else if (std::strcmp(argv[i], "--peers") == 0 && i + 1 < argc) {
            peers_ = argv[++i];
        } else {
            argv[kept++] = argv[i];
        }
    }
    argc = kept;
    if (json_.empty()) return;
    // at once, not after minutes of measuring: a fresh copy has no out/
    const std::filesystem::path folder = std::filesystem::path(json_).parent_path();
    if (!folder.empty()) std::filesystem::create_directories(folder);
}

void Report::check_parts(int argc, char** argv, std::initializer_list<const char*> parts) const {
    for (int i = 1; i < argc; ++i) {
        std::string list;
        bool known = false;
        for (const char* part : parts) {
            known = known || std::strcmp(argv[i], part) == 0;
            list += (list.empty() ? "" : ", ") + std::string(part);
        }
        if (!known) throw InputError(suite_ + " has no part \"" + argv[i] + "\": " + list + "; also --quick and --json FILE");
    }
}

void Report::heading(const std::string& text) {
    const std::chrono::duration<double> since = std::chrono::steady_clock::now() - begin_;
    std::printf("[%4.0f s] %s\n", since.count(), text.c_str());
    std::fflush(stdout);
}

void Report::add(Row row) {
    if (row.plot.empty() || !row.axes.empty()) print(row);
    rows_.push_back(std::move(row));
}

void Report::print_plots() const {
    std::map<std::string, std::map<std::string, std::array<std::vector<double>, 3>>> plots;
    for (const Row& row : rows_) {
        if (row.plot.empty() || !row.axes.empty()) continue;
        auto& values = plots[row.plot][row.series];
        values[0].push_back(row.ours);
        values[1].push_back(row.error);
        if (std::isfinite(row.smooth_error)) values[2].push_back(row.smooth_error);
    }
    for (auto& [plot, series] : plots) {
        std::printf("%s: median time; error of nine in ten pairs and largest error, against the mesh and against the smooth shape\n",
                    plot.c_str());
        for (auto& [name, values] : series) {
            for (std::vector<double>& v : values) std::sort(v.begin(), v.end());
            const auto part = [](const std::vector<double>& v, double p) { return v[size_t(p * double(v.size() - 1))]; };
            std::printf("  %-24s %9.4f ms   %9.3g %9.3g mm", name.c_str(), part(values[0], 0.5), part(values[1], 0.9), values[1].back());
            if (!values[2].empty()) std::printf("   %9.3g %9.3g mm", part(values[2], 0.9), values[2].back());
            std::printf("\n");
        }
    }
}

void Report::print_goals() const {
    const auto judged = std::count_if(rows_.begin(), rows_.end(), [](const Row& row) { return row.goal != Goal::kNone; });
    if (judged == 0) return;
    const auto answer = [](std::optional<bool> yes) { return !yes ? "?" : *yes ? "yes" : "NO"; };
    std::printf("Goals (%s, one thread%s)\n  %-68s %10s %-14s %10s %9s %9s %4s %9s %4s  %s\n", machine_class().c_str(),
                quick_ ? ", quick" : "", "what", "ours", "", "peer", "", "at least", "met", "aim", "met", "error (peer's)");
    for (const Row& row : rows_) {
        if (row.goal == Goal::kNone) continue;
        const bool times = std::isfinite(row.peer_value);
        std::printf("  %-68s %10.4g %-14s %10s %9s", row.name.c_str(), row.ours, row.unit.c_str(),
                    times ? figure(row.peer_value).c_str() : "", times ? (figure(ratio_of(row)) + " x").c_str() : "");
        const char* sign = row.goal == Goal::kRatio ? ">= " : "<= ";
        std::printf(" %9s %4s %9s %4s", (sign + figure(row.at_least)).c_str(), answer(met(row)), (sign + figure(row.aim)).c_str(),
                    answer(reaches(row, row.aim)));
        if (std::isfinite(row.error)) std::printf("  %.3g", row.error);
        if (std::isfinite(row.peer_error)) std::printf(" (%.3g)", row.peer_error);
        std::printf(" %s\n", row.error_unit.c_str());
    }
}

int Report::finish() {
    bool missed = false;
    print_plots();
    print_goals();
    nlohmann::ordered_json j = {
        {"suite", suite_}, {"machine", machine_class()}, {"quick", quick_}, {"rows", nlohmann::ordered_json::array()}};
    for (const Row& row : rows_) {
        missed = missed || !met(row).value_or(true);
        j["rows"].push_back(to_json(suite_, row));
    }
    if (!json_.empty()) write_whole_file(json_, j.dump(1) + "\n");
    return missed ? 1 : 0;
}

std::string machine_class() {
    const bool wide = __builtin_cpu_supports("avx512f");
    return std::to_string(std::thread::hardware_concurrency()) + " cores, " + (wide ? "AVX-512" : "AVX2");
}

std::string crowded() {
    double load = 0;
    const double cores = static_cast<double>(sysconf(_SC_NPROCESSORS_ONLN));
    if (getloadavg(&load, 1) != 1 || load < 1.25 * cores + 0.5) return {};
    char text[80];
    std::snprintf(text, sizeof text, "load %.1f on %.0f cores: wall times are not judged", load, cores);
    return text;
}

double thread_seconds() {
    timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

std::vector<double> interleaved_medians(int rounds, const std::vector<std::function<void()>>& jobs) {
    std::vector<std::vector<double>> cost(jobs.size());
    for (int round = -1; round < rounds; ++round) {
        for (size_t i = 0; i < jobs.size(); ++i) {
            const double begin = thread_seconds();
            jobs[i]();
            if (round >= 0) cost[i].push_back(thread_seconds() - begin);
        }
    }
    std::vector<double> median;
    for (std::vector<double>& c : cost) {
        std::nth_element(c.begin(), c.begin() + static_cast<ptrdiff_t>(c.size() / 2), c.end());
        median.push_back(c[c.size() / 2]);
    }
    return median;
}

}  // namespace trocar::bench
