#pragma once
#include <string>
#include <vector>
namespace trocar {

// Label of an x axis of simulated time: a click on such a plot shows that moment in the player.
inline constexpr const char* kTimeLabel = "simulated time, s";

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
    double log_x_from = 0;                // > 0: logarithmic x axis; smaller values are drawn at this position
    bool cut_outliers = false;            // the y axis ends above the bulk; outliers are counted at the top
    std::vector<double> event_time = {};  // s, of x = 1, 2, ...: a click shows that moment in the player
};

// The plot as a self-contained <svg> element. Lines beyond 1200 points are drawn by the extremes of bins.
std::string svg_plot(const Plot& plot);

// An attribute of <svg> for the page's script (plot_cursor.hpp): where the axes begin and end, in the picture and in values.
std::string cursor_attribute(double left, double right, double top, double bottom, double x_low, double x_high, double y_low,
                             double y_high);

// Horizontal bars, one per name: filled to `low`, outlined to `high`.
std::string svg_bars(const std::string& title, const std::string& unit, const std::vector<std::string>& names,
                     const std::vector<double>& low, const std::vector<double>& high);

// Escapes text for HTML.
std::string escape_html(const std::string& text);

}  // namespace trocar
