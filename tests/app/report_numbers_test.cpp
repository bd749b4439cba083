#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "systems/app/capture/capture.hpp"
#include "systems/app/report/figures.hpp"
#include "systems/app/report/report_page.hpp"

namespace trocar {
namespace {

// Breaks when a number of the report does not get to every place that its line names.
TEST(ReportNumbers, EveryLineReachesWhereItSays) {
    RunFigures figures;
    uint64_t next = 7000001;
    each_number(figures.report, 0xff,
                [&](const ReportNumber&, auto& value) { value = static_cast<std::decay_t<decltype(value)>>(next++); });
    const auto metrics = nlohmann::json::parse(metrics_json(figures))["report"];
    const std::string page = report_html(figures, {});
    World world;
    world.report = figures.report;
    CaptureRecord record{"state", {}};
    save_resource(world, Resource::kReport, record);
    size_t numbers = 0, in_metrics = 0, stored = 0;
    each_number(figures.report, 0xff, [&](const ReportNumber& n, auto value) {
        ++numbers;
        const std::string text = std::to_string(static_cast<uint64_t>(value));
        if (n.where & kInMetrics) ++in_metrics;
        const double shown = (n.where & kInMetrics) && n.unit[0] == 0 ? static_cast<double>(value) : -1;
        EXPECT_EQ(metrics.value(n.name, -1.0), shown) << n.name;
        EXPECT_EQ(page.find(">" + text + "</td><td>" + n.text) != page.npos, (n.where & kOnPage) != 0) << n.name;
        EXPECT_EQ(report_counter(figures.report, n.name).value_or(0), (n.where & kTrigger) ? static_cast<uint64_t>(value) : 0) << n.name;
        const bool has = std::any_of(record.arrays.begin(), record.arrays.end(),
                                     [&](const CaptureArray& a) { return a.name == std::string("report.") + n.name; });
        EXPECT_EQ(has, (n.where & kStored) != 0) << n.name;
        stored += has;
    });
    EXPECT_EQ(in_metrics, metrics.size());
    EXPECT_EQ(stored, record.arrays.size());
    EXPECT_EQ(sizeof(Report), numbers * sizeof(uint64_t)) << "a member that is no line of the list";
    EXPECT_TRUE(metrics.contains("deepest_residual_m") && metrics.contains("expired_constraints"));
}

// What contact has not parted is the deepest that the surfaces show in the last tenth of a run, whatever the planes say.
TEST(ReportNumbers, OverlapLeftIsThatOfTheSurfaces) {
    RunFigures figures;
    EXPECT_EQ(overlap_left(figures), 0);
    for (int k = 0; k < 100; ++k) {
        PassFigures pass;
        pass.depth = k < 90 ? 5e-3 : k == 93 ? 4e-4 : 1e-4, pass.residual = 1e-6, pass.pairs = 1;
        figures.pass.push_back(pass);
    }
    EXPECT_EQ(overlap_left(figures), 4e-4);
    EXPECT_EQ(nlohmann::json::parse(metrics_json(figures))["contact"]["left_m"], 4e-4);
    EXPECT_NE(report_html(figures, {}).find("0.4 mm</b>"), std::string::npos);
}

}  // namespace
}  // namespace trocar
