#include "systems/app/station/score_section.hpp"

#include "systems/app/console/format.hpp"
#include "systems/app/report/svg_plot.hpp"
namespace trocar {
namespace {

std::string metric_rows(const std::string& whose, const MetricValues& values, std::span<const MetricText> metrics) {
    std::string rows;
    for (const MetricText& m : metrics)
        if (const auto at = values.find(m.key); at != values.end())
            rows += "<tr><td>" + escape_html(whose) + "</td><td><code>" + m.key + "</code></td><td class=\"v\">" +
                    format("%.4g", at->second) + "</td><td>" + m.unit + "</td><td>" + m.text + "</td></tr>";
    return rows;
}

}  // namespace

std::string score_section(const Exercise& e, const Score& score) {
    std::string rows;
    for (size_t t = 0; t < e.tool.size(); ++t) rows += metric_rows(e.tool[t], score.tool[t], tool_metrics());
    if (e.tool.size() > 1) rows += metric_rows("all tools", score.all, tool_metrics());
    for (size_t o = 0; o < e.organ.size(); ++o) rows += metric_rows(e.organ[o], score.organ[o], organ_metrics());
    std::string phases;
    for (const auto& [phase, values] : score.phase) {
        const auto at = [&](const char* key) { return values.contains(key) ? format("%.4g", values.at(key)) : std::string(); };
        phases += "<tr><td>" + escape_html(phase.name) + "</td><td class=\"v\">" + format("%.2f", phase.from) + "</td><td class=\"v\">" +
                  format("%.2f", phase.to) + "</td><td class=\"v\">" + at("path_m") + "</td><td class=\"v\">" + at("idle_share") +
                  "</td><td class=\"v\">" + at("peak_force_n") + "</td></tr>";
    }
    return "<h2>Exercise</h2><p>What the hands did, from <code>exercise.csv</code>; <code>trocar compare</code> sets runs beside each "
           "other. "
           "Descriptions of motion and force, not marks: what they say about skill has to be shown with people.</p>"
           "<details><summary>Metrics</summary><table>" +
           rows +
           "</table></details>"
           "<table><tr><th>phase</th><th>from, s</th><th>to, s</th><th>path, m</th><th>idle share</th><th>peak force, N</th></tr>" +
           phases + "</table>\n";
}

}  // namespace trocar
