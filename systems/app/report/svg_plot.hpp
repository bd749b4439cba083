#pragma once
#include <string>
#include <vector>
namespace trocar {

struct PlotSeries {
    std::string name;
    std::vector<double> x, y;
    bool dots = false;  // draw dots instead of a line
};

struct Plot {
    std::string title, x_label, y_label;
    std::vector<PlotSeries> series = {};
    double mark_y = 0;  // horizontal reference line, drawn when mark_label is set
    std::string mark_label = {};
    double log_x_from = 0;      // > 0: logarithmic x axis; smaller values are drawn at this position
    bool cut_outliers = false;  // the y axis ends above the bulk; outliers are counted at the top
};

// The plot as a self-contained <svg> element. Lines beyond 1200 points are drawn by the extremes of bins.
std::string svg_plot(const Plot& plot);

// Horizontal bars, one per name: filled to `low`, outlined to `high`.
std::string svg_bars(const std::string& title, const std::string& unit, const std::vector<std::string>& names,
                     const std::vector<double>& low, const std::vector<double>& high);

// Escapes text for HTML.
std::string escape_html(const std::string& text);

}  // namespace trocar
