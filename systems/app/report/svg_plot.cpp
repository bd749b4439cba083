#include "systems/app/report/svg_plot.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "systems/app/console/format.hpp"
namespace trocar {
namespace {

constexpr double kWidth = 640, kHeight = 300, kLeft = 64, kRight = 16, kTop = 34, kBottom = 46, kDigitWidth = 7;
constexpr const char* kColors[] = {"#1f6feb", "#d1495b", "#2a9d5c", "#e29a2f", "#7b4ab8", "#4d4d4d", "#00a3a3", "#a05a2c"};

struct Axis {
    double low = 0, high = 1, step = 1;
};

// Round ticks around [low, high].
Axis nice_axis(double low, double high) {
    if (!(high > low)) high = low + (low != 0 ? std::abs(low) * 0.1 : 1);
    const double raw = (high - low) / 5;
    const double power = std::pow(10.0, std::floor(std::log10(raw)));
    const double unit = raw / power;
    const double step = power * (unit < 1.5 ? 1 : unit < 3.5 ? 2 : unit < 7.5 ? 5 : 10);
    return {std::floor(low / step + 1e-9) * step, std::ceil(high / step - 1e-9) * step, step};
}

std::string number(double v, double step) {
    if (std::abs(v) < step * 1e-6) v = 0;
    if (step < 1e-4 || step >= 1e6) return format("%.1e", v);
    const int digits = std::max(0, static_cast<int>(std::ceil(-std::log10(step) - 1e-9)));
    return format("%.*f", digits, v);
}

// Minimum and maximum of each of 600 bins, in order of x.
PlotSeries thin(const PlotSeries& s) {
    if (s.x.size() <= 1200) return s;
    PlotSeries out{s.name, {}, {}, false};
    constexpr size_t kBins = 600;
    for (size_t b = 0; b < kBins; ++b) {
        const size_t begin = s.x.size() * b / kBins, end = s.x.size() * (b + 1) / kBins;
        size_t low = begin, high = begin;
        for (size_t i = begin; i < end; ++i) {
            if (s.y[i] < s.y[low]) low = i;
            if (s.y[i] > s.y[high]) high = i;
        }
        for (const size_t i : {std::min(low, high), std::max(low, high)}) {
            out.x.push_back(s.x[i]);
            out.y.push_back(s.y[i]);
        }
    }
    return out;
}

}  // namespace

std::string escape_html(const std::string& text) {
    std::string out;
    for (const char c : text) {
        if (c == '<')
            out += "&lt;";
        else if (c == '>')
            out += "&gt;";
        else if (c == '&')
            out += "&amp;";
        else if (c == '"')
            out += "&quot;";
        else
            out += c;
    }
    return out;
}

namespace {

// Values that a plot shows, and the axes that hold them.
struct PlotFrame {
    Axis x, y;
    double px(double v) const { return kLeft + (v - x.low) / (x.high - x.low) * (kWidth - kLeft - kRight); }
    double py(double v) const { return kHeight - kBottom - (std::min(v, y.high) - y.low) / (y.high - y.low) * (kHeight - kTop - kBottom); }
};

double scaled_x(const Plot& plot, double x) { return plot.log_x_from > 0 ? std::log10(std::max(x, plot.log_x_from)) : x; }

// Upper end of the y axis: the highest value, or three times the 97 % quantile.
double shown_top(const Plot& plot, double highest) {
    if (!plot.cut_outliers) return highest;
    std::vector<double> all;
    for (const PlotSeries& s : plot.series)
        for (const double y : s.y)
            if (std::isfinite(y)) all.push_back(y);
    const size_t row = all.size() * 97 / 100;
    std::nth_element(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(row), all.end());
    return all[row] > 0 ? std::min(highest, 3 * all[row]) : highest;
}

// False when there is nothing to show.
bool find_frame(const Plot& plot, PlotFrame& frame) {
    double x0 = INFINITY, x1 = -INFINITY, y0 = 0, y1 = 0;
    for (const PlotSeries& s : plot.series) {
        for (size_t i = 0; i < s.x.size(); ++i) {
            if (!std::isfinite(s.x[i]) || !std::isfinite(s.y[i])) continue;
            const double x = scaled_x(plot, s.x[i]);
            x0 = std::min(x0, x), x1 = std::max(x1, x);
            y0 = std::min(y0, s.y[i]), y1 = std::max(y1, s.y[i]);
        }
    }
    if (!(x1 >= x0)) return false;
    y1 = shown_top(plot, y1);
    if (!plot.mark_label.empty()) y1 = std::max(y1, plot.mark_y * 1.05);
    frame.x =
        plot.log_x_from > 0 ? Axis{std::floor(x0 + 1e-9), std::max(std::ceil(x1 - 1e-9), std::floor(x0 + 1e-9) + 1), 1} : nice_axis(x0, x1);
    frame.y = nice_axis(y0, y1);
    return true;
}

std::string draw_axes(const Plot& plot, const PlotFrame& f) {
    std::string svg;
    for (double x = f.x.low; x <= f.x.high + f.x.step * 0.01; x += f.x.step) {
        svg += format("<line class=\"g\" x1=\"%.1f\" x2=\"%.1f\" y1=\"%g\" y2=\"%g\"/>", f.px(x), f.px(x), kTop, kHeight - kBottom);
        const std::string label = plot.log_x_from > 0 ? format("%g", std::pow(10.0, x)) : number(x, f.x.step);
        const double middle = std::min(f.px(x), kWidth - 1 - 0.5 * kDigitWidth * static_cast<double>(label.size()));
        svg += format("<text class=\"n\" text-anchor=\"middle\" x=\"%.1f\" y=\"%g\">", middle, kHeight - kBottom + 15) + label + "</text>";
    }
    for (double y = f.y.low; y <= f.y.high + f.y.step * 0.01; y += f.y.step) {
        svg += format("<line class=\"g\" x1=\"%g\" x2=\"%g\" y1=\"%.1f\" y2=\"%.1f\"/>", kLeft, kWidth - kRight, f.py(y), f.py(y));
        svg +=
            format("<text class=\"n\" text-anchor=\"end\" x=\"%g\" y=\"%.1f\">", kLeft - 6, f.py(y) + 4) + number(y, f.y.step) + "</text>";
    }
    svg += format("<text class=\"n\" text-anchor=\"middle\" x=\"%g\" y=\"%g\">", (kLeft + kWidth - kRight) / 2, kHeight - 10) +
           escape_html(plot.x_label) + "</text>";
    svg += format("<text class=\"n\" text-anchor=\"middle\" transform=\"translate(14,%g) rotate(-90)\">", (kTop + kHeight - kBottom) / 2) +
           escape_html(plot.y_label) + "</text>";
    return svg;
}

// Overlapping dots in the same pixel are indistinguishable: of a hundred thousand dots few need to be drawn.
std::string draw_dots(const Plot& plot, const PlotSeries& s, const char* color, const PlotFrame& f) {
    constexpr uint8_t kMost = 4;
    constexpr size_t kColumns = static_cast<size_t>(kWidth), kRows = static_cast<size_t>(kHeight);
    std::vector<uint8_t> drawn(kColumns * kRows, 0);
    std::string svg = format("<g fill=\"%s\" fill-opacity=\".5\">", color);
    for (size_t i = 0; i < s.x.size(); ++i) {
        if (!std::isfinite(s.x[i]) || !std::isfinite(s.y[i])) continue;
        const double x = f.px(scaled_x(plot, s.x[i])), y = f.py(s.y[i]);
        const size_t column = std::min(kColumns - 1, static_cast<size_t>(std::max(x, 0.0)));
        uint8_t& here = drawn[std::min(kRows - 1, static_cast<size_t>(std::max(y, 0.0))) * kColumns + column];
        if (here == kMost) continue;
        ++here;
        svg += format("<circle cx=\"%.1f\" cy=\"%.1f\" r=\"2.6\"/>", x, y);
    }
    return svg + "</g>";
}

std::string draw_series(const Plot& plot, const PlotSeries& full, const char* color, const PlotFrame& f) {
    if (full.dots) return draw_dots(plot, full, color, f);
    const PlotSeries s = thin(full);
    std::string svg =
        format("<polyline fill=\"none\" stroke=\"%s\" stroke-width=\"1.6\" data-name=\"", color) + escape_html(s.name) + "\" points=\"";
    for (size_t i = 0; i < s.x.size(); ++i)
        if (std::isfinite(s.y[i])) svg += format("%.1f,%.1f ", f.px(scaled_x(plot, s.x[i])), f.py(s.y[i]));
    return svg + "\"/>";
}

// What the page's script needs to tell values and times.
std::string cursor_data(const Plot& plot, const PlotFrame& f) {
    std::string data = cursor_attribute(kLeft, kWidth - kRight, kTop, kHeight - kBottom, f.x.low, f.x.high, f.y.low, f.y.high) +
                       " data-unit=\"" + escape_html(plot.y_label) + "\" data-over=\"" + escape_html(plot.x_label) + "\"";
    if (plot.log_x_from > 0) data += " data-log=\"\"";
    if (plot.x_label == kTimeLabel) data += " data-time=\"\"";
    if (plot.event_time.empty()) return data;
    data += " data-times=\"";
    for (size_t i = 0; i < plot.event_time.size(); ++i) data += format(i == 0 ? "%.3f" : " %.3f", plot.event_time[i]);
    return data + "\"";
}

// Names of several series in their colours, right to left, and the number of values beyond the top.
std::string draw_legend(const Plot& plot, const PlotFrame& f) {
    std::string svg;
    double right = kWidth - kRight;
    for (size_t k = plot.series.size(); plot.series.size() > 1 && k-- > 0;) {
        const PlotSeries& s = plot.series[k];
        svg += format("<text class=\"n\" text-anchor=\"end\" x=\"%.1f\" y=\"18\" style=\"fill:%s;font-weight:600\">", right,
                      kColors[k % std::size(kColors)]) +
               escape_html(s.name) + "</text>";
        right -= 7.3 * static_cast<double>(s.name.size()) + 16;
    }
    size_t beyond = 0;
    double highest = 0;
    for (const PlotSeries& s : plot.series)
        for (const double y : s.y)
            if (y > f.y.high) ++beyond, highest = std::max(highest, y);
    if (beyond > 0)
        svg += format("<text class=\"n h\" text-anchor=\"end\" x=\"%g\" y=\"%g\">%zu above the plot, up to %.3g</text>",
                      kWidth - kRight - 4, kTop + 13, beyond, highest);
    return svg;
}

}  // namespace

std::string cursor_attribute(double left, double right, double top, double bottom, double x_low, double x_high, double y_low,
                             double y_high) {
    return format(" data-plot=\"%g %g %g %g %.9g %.9g %.9g %.9g\"", left, right, top, bottom, x_low, x_high, y_low, y_high);
}

std::string svg_plot(const Plot& plot) {
    PlotFrame f;
    const bool drawn = find_frame(plot, f);
    std::string svg = format("<svg viewBox=\"0 0 %g %g\" role=\"img\"", kWidth, kHeight) + (drawn ? cursor_data(plot, f) : "") + ">";
    svg += "<text class=\"t\" x=\"8\" y=\"18\">" + escape_html(plot.title) + "</text>";
    if (!drawn) return svg + format("<text x=\"%g\" y=\"%g\">no data</text></svg>", kLeft, kHeight / 2);
    svg += draw_axes(plot, f);
    for (size_t k = plot.series.size(); k-- > 0;) svg += draw_series(plot, plot.series[k], kColors[k % std::size(kColors)], f);
    svg += draw_legend(plot, f);
    if (!plot.mark_label.empty()) {
        svg += format("<line class=\"m\" x1=\"%g\" x2=\"%g\" y1=\"%.1f\" y2=\"%.1f\"/>", kLeft, kWidth - kRight, f.py(plot.mark_y),
                      f.py(plot.mark_y));
        // above the curves, where a legend of several series would be
        const double y = plot.series.size() > 1 ? f.py(plot.mark_y) - 5 : 18;
        svg += format("<text class=\"n h\" text-anchor=\"end\" x=\"%g\" y=\"%.1f\">", kWidth - kRight, y) + escape_html(plot.mark_label) +
               "</text>";
    }
    return svg + "</svg>";
}

std::string svg_bars(const std::string& title, const std::string& unit, const std::vector<std::string>& names,
                     const std::vector<double>& low, const std::vector<double>& high) {
    const double row = 20, left = 120, height = kTop + row * static_cast<double>(names.size()) + 12;
    double most = 1e-12;
    for (const double h : high) most = std::max(most, h);
    std::string svg = format("<svg viewBox=\"0 0 %g %g\" role=\"img\">", kWidth, height);
    svg += format("<text class=\"t\" x=\"%g\" y=\"18\">", 8.0) + escape_html(title) + "</text>";
    for (size_t i = 0; i < names.size(); ++i) {
        const double y = kTop + row * static_cast<double>(i), scale = (kWidth - left - 150) / most;
        svg += format("<text class=\"n\" text-anchor=\"end\" x=\"%g\" y=\"%g\">", left - 8, y + 13) + escape_html(names[i]) + "</text>";
        svg += format("<rect x=\"%g\" y=\"%g\" width=\"%.1f\" height=\"13\" fill=\"#1f6feb\" fill-opacity=\".22\"/>", left, y + 3,
                      high[i] * scale);
        svg += format("<rect x=\"%g\" y=\"%g\" width=\"%.1f\" height=\"13\" fill=\"#1f6feb\"/>", left, y + 3, low[i] * scale);
        svg += format("<text class=\"n\" x=\"%.1f\" y=\"%g\">%.3f / %.3f %s</text>", left + high[i] * scale + 6, y + 13, low[i], high[i],
                      unit.c_str());
    }
    return svg + "</svg>";
}

}  // namespace trocar
