#pragma once
#include <string>
#include <vector>
namespace trocar {

struct PlotSeries {
    std::string name;
    std::vector<double> x, y;
    bool dots = false;  // dots instead of a line
};

struct Plot {
    std::string title, x_label, y_label;
    std::vector<PlotSeries> series = {};
    double mark_y = 0;  // horizontal reference line, drawn when mark_label is set
    std::string mark_label = {};
    double log_x_from = 0;      // > 0: x on a logarithmic scale; smaller values stand here
    bool cut_outliers = false;  // the y axis ends above the bulk of the values; those beyond are counted at the top
};

// The plot as an <svg> element, self-contained. A line of more than 1200 points is drawn by the extremes of its bins.
std::string svg_plot(const Plot& plot);

// Horizontal bars, one a name: `low` filled, up to `high` outlined.
std::string svg_bars(const std::string& title, const std::string& unit, const std::vector<std::string>& names,
                     const std::vector<double>& low, const std::vector<double>& high);

// Text safe inside HTML.
std::string escape_html(const std::string& text);

}  // namespace trocar
