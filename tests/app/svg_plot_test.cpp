#include "systems/app/report/svg_plot.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <pugixml.hpp>
#include <set>
#include <string>

namespace trocar {
namespace {

Plot busy_plot() {
    Plot plot{"a < b & \"c\"", "time, s", "N", {}};
    plot.mark_y = 2, plot.mark_label = "limit";
    for (const bool dots : {false, true}) {
        PlotSeries series{dots ? "dots" : "line", {}, {}, dots};
        for (int i = 0; i < 2000; ++i) series.x.push_back(1e-3 * i), series.y.push_back(std::sin(0.01 * i) * (dots ? 1 : 3));
        plot.series.push_back(series);
    }
    return plot;
}

// Breaks when part of the picture is cut off, as by a buffer that is too small.
TEST(SvgPlot, IsXmlWithEverythingInIt) {
    for (const bool outliers : {false, true}) {
        Plot plot = busy_plot();
        plot.cut_outliers = outliers;
        plot.log_x_from = outliers ? 1e-3 : 0;
        const std::string svg = svg_plot(plot);
        pugi::xml_document document;
        const pugi::xml_parse_result result = document.load_string(svg.c_str());
        ASSERT_TRUE(result) << result.description() << " at " << svg.substr(size_t(std::max<ptrdiff_t>(0, result.offset - 60)), 120);
        EXPECT_GT(document.select_nodes("//circle").size(), 1000u);
        EXPECT_EQ(document.select_nodes("//polyline[@points][@stroke]").size(), 1u);
        EXPECT_EQ(document.select_nodes("//text[contains(@transform, 'rotate(-90)')][text()='N']").size(), 1u);
        EXPECT_EQ(document.select_nodes("//text[text()='time, s']").size(), 1u);
        std::set<std::string> said;
        for (const pugi::xpath_node& text : document.select_nodes("//text")) said.insert(text.node().text().get());
        for (const char* label : {"a < b & \"c\"", "limit"}) EXPECT_TRUE(said.contains(label)) << label;
        for (const pugi::xpath_node& line : document.select_nodes("//line")) {
            for (const char* name : {"x1", "x2", "y1", "y2"})
                EXPECT_TRUE(std::isfinite(line.node().attribute(name).as_double(NAN))) << name;
        }
    }
}

// Breaks when the report of a long run draws hundreds of thousands of hidden dots, or drops an isolated one.
TEST(SvgPlot, LeavesOutDotsThatNobodyWouldSee) {
    PlotSeries dots{"dots", {}, {}, true};
    for (int i = 0; i < 100'000; ++i) dots.x.push_back(i % 100), dots.y.push_back(i % 7);
    dots.x.push_back(50), dots.y.push_back(9.5);
    const std::string svg = svg_plot({"t", "x", "y", {dots}});
    pugi::xml_document document;
    ASSERT_TRUE(document.load_string(svg.c_str()));
    EXPECT_EQ(document.select_nodes("//circle").size(), 700u * 4 + 1);
    double highest = 300;
    for (const pugi::xpath_node& c : document.select_nodes("//circle"))
        highest = std::min(highest, c.node().attribute("cy").as_double(300));
    size_t alone = 0;
    for (const pugi::xpath_node& c : document.select_nodes("//circle")) alone += c.node().attribute("cy").as_double(300) < highest + 20;
    EXPECT_EQ(alone, 1u);
}

// Breaks when the curve crosses the label of its mark, or the last tick label is cut off at the edge.
TEST(SvgPlot, LabelsAreLegible) {
    Plot plot{"ms", "vertices", "ms", {{"line", {1, 20, 90'000}, {1, 3, 2}, false}}};
    plot.mark_y = 2, plot.mark_label = "mean 2 ms";
    plot.log_x_from = 1;
    pugi::xml_document document;
    ASSERT_TRUE(document.load_string(svg_plot(plot).c_str()));
    const auto label = document.select_node("//text[text()='mean 2 ms']").node(),
               tick = document.select_node("//text[text()='100000']").node();
    ASSERT_TRUE(label && tick);
    double top = 300;
    for (const pugi::xpath_node& line : document.select_nodes("//line")) top = std::min(top, line.node().attribute("y1").as_double(300));
    EXPECT_LT(label.attribute("y").as_double(300), top);
    EXPECT_LT(tick.attribute("x").as_double(1e9) + 0.5 * 6.7 * 6, 640) << "six digits of 6.7";
}

// Breaks when the page's script reads other values than were drawn, or a name becomes markup.
TEST(SvgPlot, TellsTheScriptWhereItsAxesAre) {
    Plot plot{"f", kTimeLabel, "N", {{"a<b", {0, 1, 2}, {1, 3, 2}, false}}};
    plot.event_time = {0.5, 1.25};
    pugi::xml_document document;
    ASSERT_TRUE(document.load_string(svg_plot(plot).c_str()));
    const pugi::xml_node svg = document.child("svg"), line = document.select_node("//polyline").node();
    double left, right, top, bottom, x0, x1, y0, y1, x, y;
    ASSERT_EQ(std::sscanf(svg.attribute("data-plot").value(), "%lf %lf %lf %lf %lf %lf %lf %lf", &left, &right, &top, &bottom, &x0, &x1,
                          &y0, &y1),
              8);
    ASSERT_EQ(std::sscanf(line.attribute("points").value(), "%*f,%*f %lf,%lf", &x, &y), 2);
    EXPECT_NEAR(x0 + (x - left) / (right - left) * (x1 - x0), 1, 2e-3);
    EXPECT_NEAR(y0 + (bottom - y) / (bottom - top) * (y1 - y0), 3, 1e-2);
    EXPECT_STREQ(line.attribute("data-name").value(), "a<b");
    EXPECT_STREQ(svg.attribute("data-unit").value(), "N");
    EXPECT_STREQ(svg.attribute("data-times").value(), "0.500 1.250");
    EXPECT_TRUE(svg.attribute("data-time")) << "over time";
}

TEST(SvgPlot, BarsHaveTheirNamesAndValues) {
    const std::string svg = svg_bars("stages", "ms", {"contact constraints", "advance"}, {1, 2.5}, {2, 12.125});
    pugi::xml_document document;
    ASSERT_TRUE(document.load_string(svg.c_str()));
    EXPECT_EQ(document.select_nodes("//text[text()='contact constraints']").size(), 1u);
    EXPECT_NE(svg.find("2.500 / 12.125 ms"), std::string::npos) << svg;
}

}  // namespace
}  // namespace trocar
