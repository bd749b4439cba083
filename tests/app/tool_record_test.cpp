#include "systems/app/report/tool_record.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sstream>
namespace trocar {
namespace {

// A tool that slid over a tilted plane in lines 2 mm apart, with samples every 0.5 mm; the force is a hill of
// 1 N on a base of 1 N.
Vec3d tilted(const Vec3d& v) { return Eigen::AngleAxisd(0.4, Vec3d(1, 2, 0).normalized()) * v; }
double hill(double x, double y) { return 1 + std::exp(-((x - 0.01) * (x - 0.01) + (y + 0.005) * (y + 0.005)) / (2 * 0.008 * 0.008)); }
std::vector<ToolSample> rows_over(double width, double height) {
    std::vector<ToolSample> samples;
    for (double y = -0.5 * height; y <= 0.5 * height; y += 2e-3) {
        for (double x = -0.5 * width; x <= 0.5 * width; x += 5e-4) {
            ToolSample s;
            s.tool = 1;
            s.contacts = 1;
            s.proxy = tilted({x, y, 0});
            s.force = tilted({0, 0, hill(x, y)});
            samples.push_back(s);
        }
    }
    return samples;
}

TEST(ForceMap, ShowsTheForceWhereItWasFelt) {
    std::vector<ToolSample> samples = rows_over(0.06, 0.04);
    ToolSample away = samples.front();  // samples that do not belong in the map
    away.contacts = 0, away.force *= 9;
    samples.push_back(away);
    away.tool = 0, away.contacts = 3;
    samples.push_back(away);
    const std::optional<ForceMap> map = force_map(samples, 1);
    ASSERT_TRUE(map);
    EXPECT_NEAR((map->normal - tilted(Vec3d::UnitZ())).norm(), 0, 1e-12);
    EXPECT_GE(map->cell, 0.06 / 40);  // the plane's axes are slightly rotated against the lines
    EXPECT_LE(map->cell, std::hypot(0.06, 0.04) / 40);
    EXPECT_EQ(map->force.size(), size_t{map->columns} * map->rows);
    // smoothing over a cell of 1.5 mm lowers the top of an 8 mm wide hill by s^2 / (s^2 + 8^2), 7 %, and
    // other parts less
    double worst = 0, highest = 0;
    Vec3d top = Vec3d::Zero();
    for (uint32_t j = 0; j < map->rows; ++j) {
        for (uint32_t i = 0; i < map->columns; ++i) {
            const Vec3d at = (map->right_from + (i + 0.5) * map->cell) * map->right + (map->up_from + (j + 0.5) * map->cell) * map->up;
            const Vec3d back = Eigen::AngleAxisd(-0.4, Vec3d(1, 2, 0).normalized()) * at;
            const double felt = map->force[j * map->columns + i];
            worst = std::max(worst, std::abs(felt - hill(back.x(), back.y())));
            if (felt > highest) highest = felt, top = back;
        }
    }
    EXPECT_LT(worst, 0.07);
    EXPECT_LT((top - Vec3d(0.01, -0.005, 0)).norm(), 1.5e-3);
}

// A body's name may contain a comma: it must not shift the columns after it.
TEST(ToolsCsv, NamesWithCommasAreOneField) {
    ToolSample sample;
    sample.contacts = 3;
    const std::vector<std::string> names{"p,<b>"};
    std::istringstream lines(tools_csv(std::span(&sample, 1), names));
    std::string header, row;
    std::getline(lines, header), std::getline(lines, row);
    EXPECT_EQ(row.substr(0, 14), "0.000,\"p,<b>\",");
    EXPECT_EQ(std::count(row.begin(), row.end(), ','), std::count(header.begin(), header.end(), ',') + 1);
}

TEST(ForceMap, NeedsASurfaceToShow) {
    EXPECT_FALSE(force_map(rows_over(0.06, 0.004), 1));  // samples along one line
    EXPECT_FALSE(force_map(rows_over(0.06, 0.04), 0));   // another tool
    EXPECT_FALSE(force_map({}, 0));
    EXPECT_NE(svg_force_map("a < b", *force_map(rows_over(0.06, 0.04), 1)).find("a &lt; b"), std::string::npos);
}

// Fails when an axis has no label, or when a map of few columns is narrower than its title.
TEST(ForceMap, HasAxesAndItsWholeTitle) {
    ForceMap map;
    map.columns = 1, map.rows = 20, map.cell = 1e-3;
    map.force.assign(20, 0.5);
    const std::string title = "Force on the second assistant's palpation probe by place", svg = svg_force_map(title, map);
    for (const char* text : {"across, mm", "up, mm", "0.50 N"}) EXPECT_NE(svg.find(text), std::string::npos) << text;
    double width = 0;
    ASSERT_EQ(std::sscanf(svg.c_str() + svg.find("viewBox=\"") + 9, "0 0 %lf", &width), 1);
    EXPECT_GT(width, 7.5 * static_cast<double>(title.size()));
}

// Cells that the tool never came near stay empty.
TEST(ForceMap, LeavesOutWhereTheToolNeverWas) {
    std::vector<ToolSample> samples = rows_over(0.06, 0.04);
    std::erase_if(samples, [](const ToolSample& s) {
        return std::abs(Vec3d(Eigen::AngleAxisd(-0.4, Vec3d(1, 2, 0).normalized()) * s.proxy).x()) < 0.012;
    });
    const ForceMap map = *force_map(samples, 1);
    size_t empty = 0;
    for (const double f : map.force) empty += std::isnan(f) ? 1 : 0;
    // 24 mm of 60, less 2.5 cells of 1.5 mm on either side
    EXPECT_NEAR(static_cast<double>(empty) / static_cast<double>(map.force.size()), (24 - 7.5) / 60, 0.06);
}

TEST(ToolsCsv, HoldsEveryNumber) {
    ToolSample s;
    s.time = 0.016;
    s.device = {1, 2, 3}, s.proxy = {4, 5, 6}, s.force = {7, 8, 9}, s.torque = {10, 11, 12}, s.tissue = {13, 14, 15.5};
    s.contacts = 2, s.grip = 0.25, s.grip_torque = 17;
    const std::vector<ToolSample> samples{s};
    const std::vector<std::string> names{"probe"};
    std::istringstream lines(tools_csv(samples, names));
    std::string header, row;
    std::getline(lines, header);
    std::getline(lines, row);
    EXPECT_EQ(row, "0.016,probe,1,2,3,4,5,6,7,8,9,10,11,12,13,14,15.5,2,0.25,17");
    EXPECT_EQ(std::count(header.begin(), header.end(), ','), std::count(row.begin(), row.end(), ','));
}

}  // namespace
}  // namespace trocar
