#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "bench/suites.hpp"
#include "engine/base/error.hpp"
#include "engine/files/whole_file.hpp"
#include "systems/app/report/svg_plot.hpp"
namespace trocar {
namespace {

using json = nlohmann::json;
constexpr const char* kColours[] = {"#7a7a7a", "#1f6feb", "#d1495b", "#7b4ab8", "#9fd8b4", "#4fb477", "#1f7a46", "#a05a2c"};

double value(const json& row, const char* key) { return row.contains(key) && row[key].is_number() ? row[key].get<double>() : std::nan(""); }
std::string text(const json& row, const char* key) { return row.contains(key) && row[key].is_string() ? row[key].get<std::string>() : ""; }
std::string figure(double v) {
    char out[32];
    std::snprintf(out, sizeof out, std::abs(v) >= 1000 && std::abs(v) < 1e7 ? "%.0f" : "%.3g", v);
    return std::isfinite(v) ? out : "";
}

std::vector<json> read_rows(const std::filesystem::path& folder, std::string& machine) {
    std::vector<std::filesystem::path> files;
    for (const auto& entry : std::filesystem::directory_iterator(folder)) {
        if (entry.path().extension() == ".json") files.push_back(entry.path());
    }
    std::sort(files.begin(), files.end());
    std::vector<json> rows;
    for (const auto& file : files) {
        std::ifstream stream(file);
        const json suite = json::parse(stream, nullptr, false);
        if (suite.is_discarded() || !suite.is_object() || !suite.contains("rows"))
            throw InputError(file.string() + ": not the rows of a suite");
        if (!text(suite, "machine").empty()) machine = text(suite, "machine");
        for (const json& row : suite["rows"]) rows.push_back(row);
    }
    return rows;
}

struct Dot {
    double x, y;
    std::string series, name;
};
struct Labels {
    std::string x = "time of one pass, ms", y = "error, mm", x_unit = "ms", y_unit = "mm";
};

// Both axes logarithmic, one grid line per decade. Values below `floor` are drawn on the lowest line.
class LogPlot {
 public:
    LogPlot(const std::vector<Dot>& dots, double floor, Labels labels = {}) : floor_(floor), labels_(std::move(labels)) {
        double x0 = 1e300, x1 = 0, y1 = floor;
        for (const Dot& d : dots) x0 = std::min(x0, d.x), x1 = std::max(x1, d.x), y1 = std::max(y1, d.y);
        left_ = std::floor(std::log10(x0)), right_ = std::ceil(std::log10(x1) + 1e-9);
        low_ = std::round(std::log10(floor)), high_ = std::ceil(std::log10(y1) + 1e-9);
        right_ = std::max(right_, left_ + 1), high_ = std::max(high_, low_ + 1);
    }
    double x(double v) const { return kLeft + (std::log10(v) - left_) / (right_ - left_) * (kWidth - kLeft - kRight); }
    double y(double v) const {
        return kHeight - kBottom - (std::log10(std::max(v, floor_)) - low_) / (high_ - low_) * (kHeight - kBottom - kTop);
    }
    // `lines`: connects the dots of a series in order; otherwise draws a cross at its median.
    std::string draw(const std::string& title, const std::vector<Dot>& dots, const std::vector<std::string>& series,
                     bool lines = false) const {
        std::string out = head(title);
        for (size_t s = 0; s < series.size(); ++s) {
            const char* colour = kColours[s % std::size(kColours)];
            std::vector<double> xs, ys;
            for (const Dot& d : dots) {
                if (d.series != series[s]) continue;
                xs.push_back(d.x), ys.push_back(std::max(d.y, floor_));
                append(out, "<circle cx='%.1f' cy='%.1f' r='3.2' fill='%s' fill-opacity='0.55'><title>", x(d.x), y(d.y), colour);
                out += escape_html(d.name) + ": " + figure(d.x) + " " + labels_.x_unit + ", " + figure(d.y) + " " + labels_.y_unit +
                       "</title></circle>\n";
            }
            if (xs.empty()) continue;
            if (lines) {
                for (size_t i = 0; i < xs.size(); ++i) append(out, "%s%.1f %.1f", i ? "L" : "<path d='M", x(xs[i]), y(ys[i]));
                append(out, "' fill='none' stroke='%s' stroke-width='1.4'/>\n", colour);
                add_key(out, s, series[s]);
                continue;
            }
            const auto part_of = [](std::vector<double>& v, double part) {
                std::sort(v.begin(), v.end());
                return v[size_t(part * double(v.size() - 1))];
            };
            const double mx = x(part_of(xs, 0.5)), my = y(part_of(ys, 0.9));
            append(out, "<path d='M%.1f %.1fh12M%.1f %.1fv12' stroke='%s' stroke-width='3.4'/>\n", mx - 6, my, mx, my - 6, colour);
            add_key(out, s, series[s]);
        }
        return out + "</svg>\n";
    }

 private:
    static constexpr double kWidth = 760, kHeight = 360, kLeft = 66, kRight = 172, kTop = 30, kBottom = 42;

    template <typename... Values>
    static void append(std::string& out, const char* pattern, Values... values) {
        char line[512];
        std::snprintf(line, sizeof line, pattern, values...);
        out += line;
    }
    static void add_key(std::string& out, size_t s, const std::string& name) {
        append(out, "<circle cx='%.0f' cy='%.0f' r='4' fill='%s'/>", kWidth - kRight + 16, kTop + 8 + 18.0 * double(s),
               kColours[s % std::size(kColours)]);
        append(out, "<text x='%.0f' y='%.0f'>%s</text>\n", kWidth - kRight + 25, kTop + 12 + 18.0 * double(s), escape_html(name).c_str());
    }
    std::string head(const std::string& title) const {
        std::string out;
        append(out, "<svg viewBox='0 0 %.0f %.0f' width='%.0f' font-size='11' font-family='sans-serif' fill='#222'>\n", kWidth, kHeight,
               kWidth);
        append(out, "<text x='%.0f' y='18' font-size='13' font-weight='bold'>%s</text>\n", kLeft, escape_html(title).c_str());
        for (double d = left_; d <= right_ + 0.5; ++d) {
            const double at = x(std::pow(10, d));
            append(out, "<path d='M%.1f %.0fV%.0f' stroke='#ddd'/><text x='%.1f' y='%.0f' text-anchor='middle'>%g</text>\n", at, kTop,
                   kHeight - kBottom, at, kHeight - kBottom + 15, std::pow(10, d));
        }
        for (double d = low_; d <= high_ + 0.5; ++d) {
            const double at = y(std::pow(10, d));
            append(out, "<path d='M%.0f %.1fH%.0f' stroke='#ddd'/><text x='%.0f' y='%.1f' text-anchor='end'>%s%g</text>\n", kLeft, at,
                   kWidth - kRight, kLeft - 6, at + 4, d == low_ ? "&#8804;" : "", std::pow(10, d));
        }
        append(out, "<text x='%.0f' y='%.0f' text-anchor='middle'>%s</text>\n", (kLeft + kWidth - kRight) / 2, kHeight - 8,
               escape_html(labels_.x).c_str());
        append(out, "<text transform='translate(14 %.0f) rotate(-90)' text-anchor='middle'>%s</text>\n", (kTop + kHeight - kBottom) / 2,
               escape_html(labels_.y).c_str());
        return out;
    }
    double floor_;
    Labels labels_;
    double left_ = 0, right_ = 1, low_ = -6, high_ = 0;
};

std::string plots(const std::vector<json>& rows) {
    std::map<std::string, std::vector<Dot>> mesh, smooth;
    std::vector<std::string> order, series;
    for (const json& row : rows) {
        const std::string plot = text(row, "plot"), name = text(row, "series");
        if (plot.empty() || !text(row, "axes").empty()) continue;
        if (std::find(order.begin(), order.end(), plot) == order.end()) order.push_back(plot);
        if (std::find(series.begin(), series.end(), name) == series.end()) series.push_back(name);
        const double ms = value(row, "ours"), error = value(row, "error"), shape = value(row, "smooth_error");
        if (std::isfinite(error)) mesh[plot].push_back({ms, error, name, text(row, "name")});
        if (std::isfinite(shape)) smooth[plot].push_back({ms, shape, name, text(row, "name")});
    }
    if (order.empty()) return "";
    std::string out =
        "<h2>Speed against error</h2>\n<p>A dot is a pair of bodies and a method; a cross is a method's median "
        "time and the error that nine in ten of its pairs stay below. To the left is faster, down is truer. Hover for the names.</p>\n";
    for (const std::string& plot : order) {
        out += "<div>" + LogPlot(mesh[plot], 1e-6).draw(plot + ": depth against the mesh", mesh[plot], series);
        if (!smooth[plot].empty()) {
            out += LogPlot(smooth[plot], 1e-6).draw(plot + ": against the smooth shape", smooth[plot], series);
        }
        out += "</div>\n";
    }
    return out;
}

// Line charts, each with a list of its `beside` figures.
std::string line_charts(const std::vector<json>& rows) {
    std::vector<std::string> order;
    std::map<std::string, std::vector<json>> of_plot;
    for (const json& row : rows) {
        if (text(row, "axes").empty()) continue;
        auto& list = of_plot[text(row, "plot")];
        if (list.empty()) order.push_back(text(row, "plot"));
        list.push_back(row);
    }
    std::string out = order.empty() ? "" : "<h2>Time to an error</h2>\n<p>To the left is faster, down is truer. Hover for the names.</p>\n";
    for (const std::string& plot : order) {
        const auto& list = of_plot[plot];
        std::vector<Dot> dots;
        std::vector<std::string> series, names;
        for (const json& row : list) {
            if (std::find(series.begin(), series.end(), text(row, "series")) == series.end()) series.push_back(text(row, "series"));
            const json beside = row.value("beside", json::object());
            for (auto entry = beside.begin(); entry != beside.end(); ++entry) {
                if (std::find(names.begin(), names.end(), entry.key()) == names.end()) names.push_back(entry.key());
            }
            if (!(value(row, "ours") > 0 && std::isfinite(value(row, "error")))) continue;
            dots.push_back({value(row, "ours"), value(row, "error"), text(row, "series"), text(row, "name")});
        }
        const std::string axes = text(list[0], "axes");
        const size_t bar = axes.find('|');
        const Labels labels{axes.substr(0, bar), axes.substr(bar + 1), text(list[0], "unit"), text(list[0], "error_unit")};
        if (!dots.empty()) out += "<div>" + LogPlot(dots, 1e-4, labels).draw(plot, dots, series, true) + "</div>\n";
        out += "<table><tr><th>" + escape_html(plot) + "</th><th>" + escape_html(labels.x) + "</th><th>" + escape_html(labels.y) + "</th>";
        for (const std::string& name : names) out += "<th>" + escape_html(name) + "</th>";
        out += "</tr>\n";
        for (const json& row : list) {
            out += "<tr><td>" + escape_html(text(row, "name")) + "</td><td>" + figure(value(row, "ours")) + "</td><td>" +
                   figure(value(row, "error")) + "</td>";
            const json beside = row.value("beside", json::object());
            for (const std::string& name : names) out += "<td>" + figure(value(beside, name.c_str())) + "</td>";
            out += "</tr>\n";
        }
        out += "</table>\n";
    }
    return out;
}

bool has_goal(const json& row) { return text(row, "goal") != "none" && !text(row, "goal").empty(); }

std::string judged(const json& row) {
    if (!has_goal(row)) return "<td></td>";
    if (!row["met"].is_boolean()) return "<td>not judged: " + escape_html(text(row, "not_judged")) + "</td>";
    const bool most = text(row, "goal") != "ratio";
    return std::string("<td class='") + (row["met"].get<bool>() ? "met'>met" : "missed'>missed") + (most ? ", at most " : ", at least ") +
           figure(value(row, "at_least")) + ", aim " + figure(value(row, "aim")) + "</td>";
}

// The figures with a goal, or those without one.
std::string table(const std::vector<json>& rows, bool with_goal) {
    std::string out =
        "<table><tr><th>what</th><th>ours</th><th>peer</th><th>times</th><th>error</th><th>peer's "
        "error</th><th>goal</th><th>note</th></tr>\n";
    for (const json& row : rows) {
        if ((!text(row, "plot").empty() && text(row, "axes").empty()) || has_goal(row) != with_goal) continue;
        const std::string unit = ' ' + escape_html(text(row, "unit"));
        out += "<tr><td>" + escape_html(text(row, "name")) + "</td><td>" + figure(value(row, "ours")) + unit + "</td><td>";
        if (!text(row, "peer").empty()) out += escape_html(text(row, "peer")) + ": " + figure(value(row, "peer_value")) + unit;
        out += "</td><td>" + figure(value(row, "ratio")) + "</td><td>" + figure(value(row, "error")) + " " +
               escape_html(text(row, "error_unit")) + "</td><td>" + figure(value(row, "peer_error")) + "</td>" + judged(row) + "<td>" +
               escape_html(text(row, "note")) + "</td></tr>\n";
    }
    return out + "</table>\n";
}

}  // namespace
}  // namespace trocar

// report DIR: DIR/report.html from the figures of every DIR/*.json, one file that opens offline.
int report_suite(int argc, char** argv) {
    using namespace trocar;
    if (argc != 2) {
        std::fprintf(stderr, "usage: trocar_bench report DIR    (DIR holds what --json wrote)\n");
        return 2;
    }
    try {
        const std::filesystem::path folder = argv[1], page = folder / "report.html";
        if (!std::filesystem::is_directory(folder)) throw InputError(folder.string() + ": not a folder");
        std::string machine;
        const std::vector<json> rows = read_rows(folder, machine);
        if (rows.empty()) throw InputError(folder.string() + ": no rows; run suites with --json " + (folder / "SUITE.json").string());
        write_whole_file(page,
                         "<!doctype html><html lang='en'><meta charset='utf-8'><title>Trocar: speed and error</title>\n"
                         "<style>body{font:14px sans-serif;max-width:1580px;margin:24px auto;color:#222}table{border-collapse:collapse}"
                         "td,th{padding:3px 9px;border-bottom:1px solid #ddd;text-align:left;vertical-align:top}"
                         "td:nth-child(2),td:nth-child(4),td:nth-child(5),td:nth-child(7){white-space:nowrap}.met{color:#1f7a46}.missed{"
                         "color:#b00020;font-weight:bold}</style>\n<h1>Speed and error</h1>\n"
                         "<p>Processor time of one thread, medians of runs in turn with the peers of the same row" +
                             (machine.empty() ? "" : "; " + escape_html(machine)) + ".</p>\n<h2>Goals</h2>\n" + table(rows, true) +
                             plots(rows) + line_charts(rows) + "<h2>More figures</h2>\n" + table(rows, false) + "</html>\n");
        std::printf("%s: %zu rows\n", page.string().c_str(), rows.size());
        return 0;
    } catch (const InputError& error) {
        std::fprintf(stderr, "trocar_bench: %s\n", error.what());
        return 2;
    }
}
