#pragma once
#include <chrono>
#include <cmath>
#include <functional>
#include <initializer_list>
#include <limits>
#include <string>
#include <utility>
#include <vector>
namespace trocar::bench {

inline constexpr double kNoValue = std::numeric_limits<double>::quiet_NaN();

// How a figure is compared with its goal.
enum class Goal {
    kNone,       // a figure without a limit
    kRatio,      // peer_value / ours reaches at_least
    kPeerShare,  // ours / peer_value stays at or below at_least
    kLimit,      // ours stays at or below at_least, in the row's unit
};

// One figure with its error. NaN stands for "none".
struct Row {
    std::string name;
    double ours = kNoValue;
    std::string unit = {};
    std::string peer = {};  // empty = none
    double peer_value = kNoValue;
    double error = kNoValue, peer_error = kNoValue;
    double smooth_error = kNoValue;  // error against the smooth shape, if `error` is against its mesh
    std::string error_unit = {};
    Goal goal = Goal::kNone;
    double at_least = kNoValue, aim = kNoValue;
    std::string not_judged = {};  // why this machine cannot judge the figure; empty = it can
    std::string note = {};
    std::string plot = {}, series = {};  // the report plots ours against error, one chart per plot, one colour per series
    std::string axes = {};               // "x label|y label": a line chart through few figures, which are listed too
    std::vector<std::pair<std::string, double>> beside = {};  // figures listed below such a chart
};

// Figures of one suite, printed as they come. Removes `--json FILE`, `--peers DIR` and `--quick` from the arguments.
class Report {
 public:
    Report(std::string suite, int& argc, char** argv);
    bool quick() const { return quick_; }
    const std::string& peers() const { return peers_; }  // folder with other engines; empty: none
    // Throws InputError listing the parts if a remaining argument is none of them.
    void check_parts(int argc, char** argv, std::initializer_list<const char*> parts) const;
    // Printed with the seconds since the suite started.
    void heading(const std::string& text);
    // Figures of a plot are printed at the end, summarised by series.
    void add(Row row);
    // Prints the figures with a goal once more as one table, and writes all of them to the file of --json:
    // {suite, machine, quick, rows: [{suite, name, ours, unit, peer, peer_value, ratio, error, peer_error,
    // ..., at_least, aim, met}]}. Returns 1 if a figure misses its at_least, else 0.
    int finish();

 private:
    void print_plots() const;
    void print_goals() const;

    std::string suite_, json_, peers_;
    bool quick_ = false;
    std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
    std::vector<Row> rows_;
};

// Cores and widest vectors of this machine, without its name: "2 cores, AVX-512".
std::string machine_class();

// Why wall times are unreliable now: other programs run; empty if they are reliable.
std::string crowded();

// Processor seconds of this thread, so that other load does not count.
double thread_seconds();

// Median cost in seconds of each of several jobs, run in turn: one warm-up round, then `rounds` rounds.
std::vector<double> interleaved_medians(int rounds, const std::vector<std::function<void()>>& jobs);

}  // namespace trocar::bench
