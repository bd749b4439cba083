#include "systems/app/svg_plot.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
namespace trocar {
namespace {

constexpr double kWidth = 640, kHeight = 300, kLeft = 64, kRight = 16, kTop = 34, kBottom = 46;
constexpr const char* kColors[] = {"#1f6feb", "#d1495b", "#2a9d5c", "#e29a2f",
                                   "#7b4ab8", "#4d4d4d", "#00a3a3", "#a05a2c"};

std::string format(const char* pattern, auto... values) {
    char text[512];
    std::snprintf(text, sizeof text, pattern, values...);
    return text;
}

struct Axis {
    double low, high, step;
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
    if (s.dots || s.x.size() <= 1200) return s;
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

std::string svg_plot(const Plot& plot) {
    double x0 = INFINITY, x1 = -INFINITY, y0 = plot.zero_y ? 0 : INFINITY, y1 = plot.zero_y ? 0 : -INFINITY;
    for (const PlotSeries& s : plot.series) {
        for (size_t i = 0; i < s.x.size(); ++i) {
            if (!std::isfinite(s.x[i]) || !std::isfinite(s.y[i])) continue;
            x0 = std::min(x0, s.x[i]), x1 = std::max(x1, s.x[i]);
            y0 = std::min(y0, s.y[i]), y1 = std::max(y1, s.y[i]);
        }
    }
    std::string svg = format("<svg viewBox=\"0 0 %g %g\" role=\"img\">", kWidth, kHeight);
    svg += "<text class=\"t\" x=\"" + format("%g", kLeft) + "\" y=\"18\">" + escape_html(plot.title) + "</text>";
    if (!(x1 >= x0)) return svg + format("<text x=\"%g\" y=\"%g\">no data</text></svg>", kLeft, kHeight / 2);
    if (!plot.mark_label.empty()) y1 = std::max(y1, plot.mark_y * 1.05);
    const Axis ax = nice_axis(x0, x1), ay = nice_axis(y0, y1);
    const auto px = [&](double x) { return kLeft + (x - ax.low) / (ax.high - ax.low) * (kWidth - kLeft - kRight); };
    const auto py = [&](double y) {
        return kHeight - kBottom - (y - ay.low) / (ay.high - ay.low) * (kHeight - kTop - kBottom);
    };
    for (double x = ax.low; x <= ax.high + ax.step * 0.01; x += ax.step) {
        svg += format("<line class=\"g\" x1=\"%.1f\" x2=\"%.1f\" y1=\"%g\" y2=\"%g\"/>", px(x), px(x), kTop,
                      kHeight - kBottom);
        svg += format("<text class=\"n\" text-anchor=\"middle\" x=\"%.1f\" y=\"%g\">", px(x), kHeight - kBottom + 15) +
               number(x, ax.step) + "</text>";
    }
    for (double y = ay.low; y <= ay.high + ay.step * 0.01; y += ay.step) {
        svg += format("<line class=\"g\" x1=\"%g\" x2=\"%g\" y1=\"%.1f\" y2=\"%.1f\"/>", kLeft, kWidth - kRight, py(y),
                      py(y));
        svg += format("<text class=\"n\" text-anchor=\"end\" x=\"%g\" y=\"%.1f\">", kLeft - 6, py(y) + 4) +
               number(y, ay.step) + "</text>";
    }
    svg += format("<text class=\"n\" text-anchor=\"middle\" x=\"%g\" y=\"%g\">", (kLeft + kWidth - kRight) / 2,
                  kHeight - 10) +
           escape_html(plot.x_label) + "</text>";
    svg += format("<text class=\"n\" text-anchor=\"middle\" transform=\"translate(14,%g) rotate(-90)\">",
                  (kTop + kHeight - kBottom) / 2) +
           escape_html(plot.y_label) + "</text>";
    if (!plot.mark_label.empty()) {
        svg += format("<line class=\"m\" x1=\"%g\" x2=\"%g\" y1=\"%.1f\" y2=\"%.1f\"/>", kLeft, kWidth - kRight,
                      py(plot.mark_y), py(plot.mark_y));
        svg +=
            format("<text class=\"n\" text-anchor=\"end\" x=\"%g\" y=\"%.1f\">", kWidth - kRight, py(plot.mark_y) - 4) +
            escape_html(plot.mark_label) + "</text>";
    }
    double legend = kWidth - kRight;
    for (size_t k = plot.series.size(); k-- > 0;) {
        const char* color = kColors[k % std::size(kColors)];
        const PlotSeries s = thin(plot.series[k]);
        if (s.dots) {
            for (size_t i = 0; i < s.x.size(); ++i)
                svg += format("<circle cx=\"%.1f\" cy=\"%.1f\" r=\"2\" fill=\"%s\" fill-opacity=\".55\"/>", px(s.x[i]),
                              py(s.y[i]), color);
        } else {
            svg += format("<polyline fill=\"none\" stroke=\"%s\" stroke-width=\"1.4\" points=\"", color);
            for (size_t i = 0; i < s.x.size(); ++i)
                if (std::isfinite(s.y[i])) svg += format("%.1f,%.1f ", px(s.x[i]), py(s.y[i]));
            svg += "\"/>";
        }
        if (plot.series.size() > 1) {
            svg +=
                format("<text class=\"n\" text-anchor=\"end\" x=\"%.1f\" y=\"18\" style=\"fill:%s;font-weight:600\">",
                       legend, color) +
                escape_html(s.name) + "</text>";
            legend -= 7.0 * static_cast<double>(s.name.size()) + 14;
        }
    }
    return svg + "</svg>";
}

std::string svg_bars(const std::string& title, const std::string& unit, const std::vector<std::string>& names,
                     const std::vector<double>& low, const std::vector<double>& high) {
    const double row = 20, left = 170, height = kTop + row * static_cast<double>(names.size()) + 12;
    double most = 1e-12;
    for (const double h : high) most = std::max(most, h);
    std::string svg = format("<svg viewBox=\"0 0 %g %g\" role=\"img\">", kWidth, height);
    svg += format("<text class=\"t\" x=\"%g\" y=\"18\">", 8.0) + escape_html(title) + "</text>";
    for (size_t i = 0; i < names.size(); ++i) {
        const double y = kTop + row * static_cast<double>(i), scale = (kWidth - left - 150) / most;
        svg += format("<text class=\"n\" text-anchor=\"end\" x=\"%g\" y=\"%g\">", left - 8, y + 13) +
               escape_html(names[i]) + "</text>";
        svg += format("<rect x=\"%g\" y=\"%g\" width=\"%.1f\" height=\"13\" fill=\"#1f6feb\" fill-opacity=\".22\"/>",
                      left, y + 3, high[i] * scale);
        svg += format("<rect x=\"%g\" y=\"%g\" width=\"%.1f\" height=\"13\" fill=\"#1f6feb\"/>", left, y + 3,
                      low[i] * scale);
        svg += format("<text class=\"n\" x=\"%.1f\" y=\"%g\">%.3f / %.3f %s</text>", left + high[i] * scale + 6, y + 13,
                      low[i], high[i], unit.c_str());
    }
    return svg + "</svg>";
}

}  // namespace trocar
