#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "systems/app/console/format.hpp"
#include "systems/app/report/report_page.hpp"
#include "systems/app/report/svg_plot.hpp"
#include "systems/app/station/comparison.hpp"
namespace trocar {
namespace {

constexpr size_t kMostCurves = 8;    // in a plot: as many colours as it has
constexpr size_t kMostColumns = 12;  // runs in the table of metrics
constexpr double kSure = 0.05;       // level of the test

std::string cell(const std::string& text) { return "<td class=\"v\" style=\"white-space:nowrap\">" + text + "</td>"; }
std::string short_number(double v) { return std::isfinite(v) ? format("%.4g", v) : "&ndash;"; }
std::string plot_card(const Plot& plot, const std::string& note) {
    return "<div class=\"card\">" + svg_plot(plot) + "<p>" + note + "</p></div>\n";
}
std::string table(const std::string& head, const std::string& rows) {
    return "<div style=\"overflow-x:auto\"><table><tr>" + head + "</tr>" + rows + "</table></div>\n";
}

std::string metric_name(const MetricText& m) {
    return "<td title=\"" + escape_html(m.text) + "\"><code>" + m.key + "</code>" + (*m.unit ? ", " + std::string(m.unit) : "") + "</td>";
}

std::string head_section(const std::vector<ComparedRun>& runs) {
    std::string rows;
    for (const ComparedRun& r : runs)
        rows += "<tr><td>" + escape_html(r.name) + "</td><td>" + escape_html(r.exercise.scene) + "</td><td>" + escape_html(r.group) +
                "</td><td>" + escape_html(r.subject) + "</td>" + cell(r.trial > 0 ? format("%g", r.trial) : "") +
                cell(format("%zu", r.exercise.sample.size())) + cell(format("%.0f", r.exercise.rate)) + "<td><code>" +
                escape_html(r.exercise.state_hash) + "</code></td></tr>";
    return "<h1>Comparison of " + std::to_string(runs.size()) +
           " runs</h1><p>Metrics describe motion and force. Whether they tell skill has to be "
           "shown with people for each exercise: none of them is a mark.</p>" +
           table("<th>run</th><th>scene</th><th>group</th><th>subject</th><th>trial</th><th>samples</th><th>Hz</th><th>state hash</th>",
                 rows);
}

std::string metric_section(const std::vector<ComparedRun>& runs) {
    const size_t shown = std::min(runs.size(), kMostColumns);
    std::string head = "<th>metric</th>", rows;
    for (size_t r = 0; r < shown; ++r) head += "<th>" + escape_html(runs[r].name) + "</th>";
    if (runs.size() == 2) head += "<th>second over first</th>";
    head += "<th>what it is</th>";
    for (const MetricText& m : tool_metrics()) {
        std::string row;
        bool any = false;
        std::vector<double> values;
        for (size_t r = 0; r < shown; ++r) {
            const auto at = runs[r].score.all.find(m.key);
            values.push_back(at == runs[r].score.all.end() ? NAN : at->second);
            any = any || std::isfinite(values.back());
            row += cell(short_number(values.back()));
        }
        if (!any) continue;
        if (runs.size() == 2) row += cell(values[0] > 0 && std::isfinite(values[1]) ? format("%.3g", values[1] / values[0]) : "&ndash;");
        rows += "<tr>" + metric_name(m) + row + "<td>" + m.text + "</td></tr>";
    }
    std::string out = "<h2>Metrics</h2><p>Of all tools together; <code>trocar score --json</code> has them per tool and phase." +
                      std::string(shown < runs.size() ? " The first " + std::to_string(shown) + " runs." : "") + "</p>" + table(head, rows);
    std::vector<std::string> organs;
    for (size_t r = 0; r < shown; ++r)
        for (const std::string& o : runs[r].exercise.organ)
            if (std::ranges::find(organs, o) == organs.end()) organs.push_back(o);
    rows.clear();
    for (const std::string& organ : organs) {
        for (const MetricText& m : organ_metrics()) {
            std::string row;
            bool any = false;
            for (size_t r = 0; r < shown; ++r) {
                const auto& names = runs[r].exercise.organ;
                const size_t o = static_cast<size_t>(std::ranges::find(names, organ) - names.begin());
                const bool has = o < names.size() && runs[r].score.organ[o].contains(m.key);
                any |= has, row += cell(has ? short_number(runs[r].score.organ[o].at(m.key)) : "&ndash;");
            }
            if (any) rows += "<tr><td>" + escape_html(organ) + "</td>" + metric_name(m) + row + "</tr>";
        }
    }
    if (rows.empty()) return out;
    head = "<th>organ</th><th>metric</th>";
    for (size_t r = 0; r < shown; ++r) head += "<th>" + escape_html(runs[r].name) + "</th>";
    return out + "<h2>Forces on organs</h2>" + table(head, rows);
}

PlotSeries series(const std::string& name, const Signal& s, double start) {
    PlotSeries out{name, {}, s.value, false};
    for (const double t : s.time) out.x.push_back(t - start);
    return out;
}

// Each tool's force and speed over time, as recorded and on the time axis of the first run.
std::string curve_section(const std::vector<ComparedRun>& runs, const std::vector<Alignment>& alignments) {
    const size_t shown = std::min(runs.size(), kMostCurves);
    std::string cards;
    const Exercise& first = runs[0].exercise;
    for (uint32_t tool = 0; tool < first.tool.size(); ++tool) {
        for (const bool force : {true, false}) {
            const std::string what = (force ? "Force on the hand at " : "Speed of ") + first.tool[tool], unit = force ? "N" : "mm/s";
            Plot raw{what, "time since the start, s", unit}, aligned{what + ", aligned", "time of " + runs[0].name + ", s", unit};
            for (size_t r = 0; r < shown; ++r) {
                const Exercise& e = runs[r].exercise;
                const auto same = std::ranges::find(e.tool, first.tool[tool]);
                if (same == e.tool.end()) continue;
                const uint32_t index = static_cast<uint32_t>(same - e.tool.begin());
                Signal s = force ? force_signal(e, index) : speed_signal(e, index);
                if (!force)
                    for (double& v : s.value) v *= 1e3;
                raw.series.push_back(series(runs[r].name, s, e.sample.front().time));
                if (r == 0) {
                    aligned.series.push_back(raw.series.back());
                } else if (!alignments[r - 1].time.empty()) {
                    PlotSeries warped{runs[r].name, {}, {}, false};
                    for (size_t i = 0; i < alignments[r - 1].time.size(); ++i)
                        warped.x.push_back(alignments[r - 1].time[i] - first.sample.front().time),
                            warped.y.push_back(s.at(alignments[r - 1].other[i]));
                    aligned.series.push_back(std::move(warped));
                }
            }
            cards += plot_card(raw, "As recorded.");
            if (aligned.series.size() > 1)
                cards += plot_card(aligned, "Each run stretched and shrunk in time so that tip and force lie on those of the first.");
        }
    }
    std::string rows;
    for (size_t k = 0; k < alignments.size() && k < kMostColumns; ++k)
        rows += "<tr><td>" + escape_html(runs[k + 1].name) + "</td>" + cell(short_number(1e3 * alignments[k].raw_distance)) +
                cell(short_number(1e3 * alignments[k].distance)) + "<td>" +
                (alignments[k].time.empty() ? "no tool in common"
                 : alignments[k].by_phases  ? "phase by phase"
                                            : "as one phase: their phases differ") +
                "</td></tr>";
    return "<h2>On one axis</h2><p>Up to " + std::to_string(kMostCurves) +
           " runs. Aligned by the events that begin phases, then by dynamic time "
           "warping on tip position and force.</p><div class=\"grid\">" +
           cards + "</div>" +
           (rows.empty() ? ""
                         : table("<th>run</th><th>RMS distance of the tips at equal times, mm</th><th>aligned, mm</th><th></th>", rows));
}

std::string cohort_section(const std::vector<ComparedRun>& runs, const Cohort& c) {
    if (runs.size() < 3) return "";
    std::string head = "<th>metric</th>", rows, curves;
    for (size_t g = 0; g < c.group.size(); ++g)
        head += "<th>" + (c.group[g].empty() ? "all" : escape_html(c.group[g])) + ", n = " + std::to_string(c.count[g]) + "</th>";
    const bool two = c.group.size() == 2, tried = c.subjects > 1 && c.trials > 1;
    if (two) head += "<th>AUC, 95 % interval</th>";
    if (tried) head += "<th>ICC(2,1), 95 % interval</th>";
    const auto span = [](const Interval& i) {
        return std::isfinite(i.value) ? format("%.2f (%.2f to %.2f)", i.value, i.low, i.high) : std::string("&ndash;");
    };
    bool learns = false;
    for (const MetricSummary& m : c.metric) learns |= m.trial.size() > 1;
    if (learns) head += "<th>learning exponent</th>";
    for (const MetricSummary& m : c.metric) {
        rows += "<tr><td><code>" + m.key + "</code>" + (m.unit.empty() ? "" : ", " + m.unit) + "</td>";
        for (const auto& q : m.quartiles) rows += cell(short_number(q[1]) + " (" + short_number(q[0]) + " to " + short_number(q[2]) + ")");
        if (two) rows += cell(span(m.area));
        if (tried) rows += cell(span(m.reliability));
        if (learns) rows += cell(short_number(m.learning.exponent));
        rows += "</tr>";
        if (m.trial.size() < 2) continue;
        Plot plot{m.key + " over trials", "trial", m.unit.empty() ? "" : m.unit, {{"median", m.trial, m.median, false}}};
        if (std::isfinite(m.learning.exponent)) {
            PlotSeries law{"power law", {}, {}, false};
            for (int i = 0; i <= 60; ++i) {
                const double t = m.trial.front() + (m.trial.back() - m.trial.front()) * i / 60;
                law.x.push_back(t), law.y.push_back(m.learning.first * std::pow(t, m.learning.exponent));
            }
            plot.series.push_back(std::move(law));
        }
        curves += plot_card(plot, "Median of all runs with that trial number.");
    }
    return "<h2>Cohort</h2><p>Median (first to third quartile) per group. AUC: probability that a run of " +
           (two ? escape_html(c.group[0]) + " has the greater value than one of " + escape_html(c.group[1])
                : std::string("the first group has the greater value")) +
           ", with the percentile interval of 2,000 bootstrap samples. ICC(2,1): agreement of single trials, over " +
           std::to_string(c.subjects) + " subjects with all of " + std::to_string(c.trials) +
           " trials. An interval from few runs is wide: read it before the value.</p>" + table(head, rows) +
           (curves.empty() ? "" : "<h2>Learning curves</h2><div class=\"grid\">" + curves + "</div>");
}

std::string time_section(const std::vector<StageComparison>& stages) {
    if (stages.empty()) return "";
    std::vector<StageComparison> sorted = stages;
    std::ranges::sort(sorted, [](const auto& x, const auto& y) { return std::max(x.a_ms, x.b_ms) > std::max(y.a_ms, y.b_ms); });
    std::string rows;
    for (const StageComparison& s : sorted)
        rows += "<tr><td>" + escape_html(s.stage) + "</td>" + cell(format("%.4f", s.a_ms)) + cell(format("%.4f", s.b_ms)) +
                cell(format("%.3f", s.ratio)) + cell(s.p < 1e-4 ? std::string("&lt; 0.0001") : format("%.4f", s.p)) + "<td>" +
                (s.p >= kSure  ? "no difference shown"
                 : s.ratio > 1 ? "slower"
                               : "faster") +
                "</td></tr>";
    return "<h2>Times, stage by stage</h2><p>Mean time per contact pass. Passes of both runs at the same simulated time, cut into " +
           std::to_string(kTimeBlocks) +
           " blocks of consecutive ones, since neighbours depend on each other; Wilcoxon's signed-rank test on the "
           "blocks' ratios, p corrected for the number of stages (Holm). One run of each cannot tell a change of the program from one of "
           "the "
           "machine's load: repeat before believing.</p>" +
           table("<th>stage</th><th>first, ms</th><th>second, ms</th><th>ratio</th><th>p</th><th></th>", rows);
}

nlohmann::ordered_json interval_json(const Interval& i) { return {{"value", i.value}, {"low", i.low}, {"high", i.high}}; }

}  // namespace

std::string comparison_html(const std::vector<ComparedRun>& runs, const Cohort& cohort, const std::vector<Alignment>& alignments,
                            const std::vector<StageComparison>& stages) {
    if (runs.empty())
        return html_page("Comparison",
                         "<h1>Comparison of two runs</h1><p>They have no tools: only their times are compared.</p>" + time_section(stages));
    return html_page("Comparison", head_section(runs) + metric_section(runs) + curve_section(runs, alignments) +
                                       cohort_section(runs, cohort) + time_section(stages));
}

std::string comparison_text(const std::vector<ComparedRun>& runs, const std::vector<Alignment>& alignments,
                            const std::vector<StageComparison>& stages) {
    std::string out = "metric              ";
    for (const ComparedRun& r : runs) out += format(" %14.14s", r.name.c_str());
    if (runs.empty())
        out.clear();
    else
        out += "\n";
    for (const MetricText& m : tool_metrics()) {
        std::string row;
        bool any = false;
        for (const ComparedRun& r : runs) {
            const auto at = r.score.all.find(m.key);
            any |= at != r.score.all.end();
            row += at == r.score.all.end() ? format(" %14s", "-") : format(" %14.6g", at->second);
        }
        if (any) out += format("%-16s %-3s", m.key, m.unit) + row + "\n";
    }
    for (size_t k = 0; k < alignments.size(); ++k)
        out += runs[k + 1].name + format(": tips %.3g mm apart at equal times, %.3g mm aligned (RMS)\n", 1e3 * alignments[k].raw_distance,
                                         1e3 * alignments[k].distance);
    for (const StageComparison& s : stages)
        out += format("%-28s %10.4f ms %10.4f ms  ratio %6.3f  p %.4f%s\n", s.stage.c_str(), s.a_ms, s.b_ms, s.ratio, s.p,
                      s.p >= kSure  ? ""
                      : s.ratio > 1 ? "  slower"
                                    : "  faster");
    return out;
}

std::string comparison_json(const std::vector<ComparedRun>& runs, const Cohort& cohort, const std::vector<Alignment>& alignments,
                            const std::vector<StageComparison>& stages) {
    using json = nlohmann::ordered_json;
    json j;
    for (const ComparedRun& r : runs) {
        json row = {{"name", r.name}, {"group", r.group}, {"subject", r.subject}, {"trial", r.trial}};
        row.update(json::parse(score_json(r.exercise, r.score)));
        j["runs"].push_back(row);
    }
    for (const Alignment& a : alignments)
        j["alignments"].push_back({{"by_phases", a.by_phases}, {"raw_distance_m", a.raw_distance}, {"aligned_distance_m", a.distance}});
    for (const MetricSummary& m : cohort.metric) {
        json row = {{"metric", m.key}, {"quartiles", json::object()}};
        for (size_t g = 0; g < cohort.group.size(); ++g)
            row["quartiles"][cohort.group[g].empty() ? "all" : cohort.group[g]] = m.quartiles[g];
        if (cohort.group.size() == 2) row["auc"] = interval_json(m.area);
        if (std::isfinite(m.reliability.value)) row["icc_2_1"] = interval_json(m.reliability);
        if (std::isfinite(m.learning.exponent)) row["learning"] = {{"first", m.learning.first}, {"exponent", m.learning.exponent}};
        j["cohort"].push_back(row);
    }
    for (const StageComparison& s : stages)
        j["stages"].push_back({{"stage", s.stage}, {"first_ms", s.a_ms}, {"second_ms", s.b_ms}, {"ratio", s.ratio}, {"p", s.p}});
    return j.dump(2) + "\n";
}

}  // namespace trocar
