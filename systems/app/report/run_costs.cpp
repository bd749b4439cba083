#include "systems/app/report/run_costs.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>

#include "engine/files/whole_file.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/report/svg_plot.hpp"
namespace trocar {
namespace {

constexpr size_t kPairsKept = 40, kPairsShown = 12, kBands = 8;
constexpr double kLeastSpan = 20e-6;  // s
constexpr const char* kColors[kBands] = {"#1f6feb", "#d1495b", "#2a9d5c", "#e29a2f", "#7b4ab8", "#00a3a3", "#a05a2c", "#9aa4b2"};

double detection_ms(const Frame& frame) {
    double ms = 0;
    for (const uint32_t row : frame.detection_stages()) ms += 1e-6 * static_cast<double>(frame.times().stage_ns[row]);
    return ms;
}

}  // namespace

std::vector<PairCost> pair_costs(const World& w) {
    std::vector<PairCost> costs;
    double all = 0;
    for (size_t i = 0; i < w.pairs.a.size() && 2 * i + 1 < w.near.side.size(); ++i) {
        const uint32_t vertices = w.near.side[2 * i].count + w.near.side[2 * i + 1].count;
        if (vertices == 0) continue;
        costs.push_back({w.pairs.a[i], w.pairs.b[i], vertices, 0});
        all += vertices;
    }
    for (PairCost& c : costs) c.share = c.vertices / all;
    return costs;
}

void CostMeter::add(const Frame& frame, RunFigures& figures) {
    std::vector<float> row;
    for (const uint64_t ns : frame.times().stage_ns) row.push_back(1e-6f * static_cast<float>(ns));
    figures.pass_stage_ms.push_back(std::move(row));
    const World& w = frame.world();
    const double detection = detection_ms(frame);
    for (const PairCost& c : pair_costs(w)) {
        PairFigures& p = pairs_[uint64_t{c.a} << 32 | c.b];
        ++p.passes;
        p.ms += c.share * detection;
        p.worst_ms = std::max(p.worst_ms, c.share * detection);
        p.vertices += c.vertices;
        p.cell += w.occupancy.cell_size;
    }
    for (size_t i = 0; i < w.penetrations.pair.size(); ++i) {
        const uint32_t pair = w.penetrations.pair[i];
        const auto found = pairs_.find(uint64_t{w.pairs.a[pair]} << 32 | w.pairs.b[pair]);
        if (found != pairs_.end()) found->second.depth = std::max(found->second.depth, w.penetrations.depth[i]);
    }
}

void CostMeter::finish(const Frame& frame, RunFigures& figures) const {
    for (const auto& [key, p] : pairs_) {
        figures.pair.push_back(p);
        figures.pair.back().name = frame.world().bodies.name[key >> 32] + "/" + frame.world().bodies.name[key & 0xffffffff];
    }
    std::stable_sort(figures.pair.begin(), figures.pair.end(), [](const PairFigures& a, const PairFigures& b) { return a.ms > b.ms; });
    figures.pairs_met = figures.pair.size();
    if (figures.pair.size() > kPairsKept) figures.pair.resize(kPairsKept);
}

void trace_pairs(const Frame& frame, std::map<uint64_t, std::string_view>& names, Trace& trace) {
    const World& w = frame.world();
    const uint32_t pass = static_cast<uint32_t>(w.clock.pass);
    uint64_t begin = UINT64_MAX;
    for (size_t e = trace.size(); e-- > 0 && trace[e].pass + 1 >= pass;) {
        if (trace[e].name == stage_name(StageId::kBodyBoxes)) begin = trace[e].begin_ns;
        if (begin != UINT64_MAX) break;
    }
    if (begin == UINT64_MAX) return;
    const double detection = 1e-3 * detection_ms(frame);
    for (const PairCost& c : pair_costs(w)) {
        if (c.share * detection < kLeastSpan) continue;
        const auto [name, fresh] = names.try_emplace(uint64_t{c.a} << 32 | c.b);
        if (fresh) name->second = trace.keep(w.bodies.name[c.a] + "/" + w.bodies.name[c.b]);
        const uint64_t ns = static_cast<uint64_t>(1e9 * c.share * detection);
        trace.add({name->second, begin, ns, kPairTrack, pass});
        begin += ns;
    }
}

std::vector<size_t> worst_passes(const RunFigures& f, size_t count, size_t skip) {
    std::vector<size_t> rows(f.pass.size());
    std::iota(rows.begin(), rows.end(), size_t{0});
    rows.erase(rows.begin(), rows.begin() + static_cast<ptrdiff_t>(std::min(skip, rows.size())));
    std::stable_sort(rows.begin(), rows.end(), [&](size_t a, size_t b) {
        return f.pass[a].frame_ms - f.pass[a].render_ms > f.pass[b].frame_ms - f.pass[b].render_ms;
    });
    if (rows.size() > count) rows.resize(count);
    return rows;
}

size_t picture_of_pass(const RunFigures& f, size_t pass) {
    size_t picture = 0;
    for (size_t i = 0; i < pass && i < f.pass.size(); ++i) picture += f.pass[i].picture;
    return picture;
}

namespace {

// The most expensive stages of the run; the last entry is the sum of all others.
std::vector<size_t> dearest_stages(const RunFigures& f) {
    std::vector<double> total(f.stage.size());
    for (const auto& row : f.pass_stage_ms)
        for (size_t s = 0; s < row.size() && s < total.size(); ++s) total[s] += static_cast<double>(row[s]);
    std::vector<size_t> order(total.size());
    std::iota(order.begin(), order.end(), size_t{0});
    std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) { return total[a] > total[b]; });
    if (order.size() > kBands - 1) order.resize(kBands - 1);
    return order;
}

// Up to 240 bars over time, each stacked from the mean cost of the stages.
std::string timeline(const RunFigures& f) {
    constexpr double kWidth = 1300, kHeight = 300, kLeft = 52, kBottom = 34, kTop = 40;
    const std::vector<size_t> stages = dearest_stages(f);
    const size_t passes = std::min(f.pass.size(), f.pass_stage_ms.size()), bins = std::min<size_t>(240, passes);
    if (bins == 0) return "";
    std::vector<std::vector<double>> band(bins, std::vector<double>(kBands));
    std::vector<double> sums;
    for (size_t b = 0; b < bins; ++b) {
        const size_t begin = passes * b / bins, end = passes * (b + 1) / bins;
        for (size_t i = begin; i < end; ++i) {
            double rest = std::accumulate(f.pass_stage_ms[i].begin(), f.pass_stage_ms[i].end(), 0.0);
            for (size_t k = 0; k < stages.size(); ++k) {
                const double ms = static_cast<double>(f.pass_stage_ms[i][stages[k]]);
                band[b][k] += ms / static_cast<double>(end - begin), rest -= ms;
            }
            band[b][kBands - 1] += std::max(0.0, rest) / static_cast<double>(end - begin);
        }
        sums.push_back(std::accumulate(band[b].begin(), band[b].end(), 0.0));
    }
    const double top = std::max(1e-6, std::min(1.05 * quantile(sums, 1), 3 * quantile(sums, 0.97)));
    const double step = std::pow(10.0, std::floor(std::log10(top))) / (top / std::pow(10.0, std::floor(std::log10(top))) < 2.5 ? 2 : 1);
    const auto py = [&](double ms) { return kHeight - kBottom - std::min(ms, top) / top * (kHeight - kBottom - kTop); };
    std::string svg = format("<svg viewBox=\"0 0 %g %g\" role=\"img\" data-over=\"%s\" data-time=\"\"", kWidth, kHeight, kTimeLabel) +
                      cursor_attribute(kLeft, kWidth - 8, kTop, kHeight - kBottom, f.pass.front().time, f.pass[passes - 1].time, 0, top) +
                      "><text class=\"t\" x=\"8\" y=\"16\">Stages over the run, ms per pass</text>";
    for (double y = 0; y <= top; y += step)
        svg +=
            format("<line class=\"g\" x1=\"%g\" x2=\"%g\" y1=\"%.1f\" y2=\"%.1f\"/><text text-anchor=\"end\" x=\"%g\" y=\"%.1f\">%g</text>",
                   kLeft, kWidth - 8, py(y), py(y), kLeft - 6, py(y) + 4, y);
    const double wide = (kWidth - 8 - kLeft) / static_cast<double>(bins);
    for (size_t b = 0; b < bins; ++b) {
        double below = 0;
        for (size_t k = 0; k < kBands; ++k) {
            const double height = py(below) - py(below + band[b][k]);
            below += band[b][k];
            if (height < 0.05) continue;
            svg += format("<rect x=\"%.2f\" y=\"%.2f\" width=\"%.2f\" height=\"%.2f\" fill=\"%s\"/>", kLeft + static_cast<double>(b) * wide,
                          py(below), wide * 0.96, height, kColors[k]);
        }
    }
    for (int i = 0; i <= 8; ++i) {
        const size_t pass = std::min(passes - 1, passes * static_cast<size_t>(i) / 8);
        svg += format("<text text-anchor=\"%s\" x=\"%.1f\" y=\"%g\">%.2f s</text>", i == 8 ? "end" : "middle",
                      kLeft + (kWidth - 8 - kLeft) * i / 8, kHeight - 12, f.pass[pass].time);
    }
    double x = 275;
    for (size_t k = 0; k < kBands; ++k) {
        const std::string name = k < stages.size() ? f.stage[stages[k]].name : k == kBands - 1 ? "all others" : "";
        if (name.empty()) continue;
        svg +=
            format("<rect x=\"%.0f\" y=\"6\" width=\"11\" height=\"11\" fill=\"%s\"/><text x=\"%.0f\" y=\"16\">", x, kColors[k], x + 15) +
            escape_html(name) + "</text>";
        x += 34 + 6.7 * static_cast<double>(name.size());
    }
    return "<div class=\"card\">" + svg + "</svg><p>Mean of the passes in each of " + std::to_string(bins) +
           " intervals of simulated time" +
           (quantile(sums, 1) > top ? format("; the highest, cut off here, is %.3g ms", quantile(sums, 1)) : "") + ".</p></div>\n";
}

std::string frame_histogram(const RunFigures& f) {
    const std::vector<double> frames = displayed_frames(f.pass);
    if (frames.size() < 4) return "";
    const double high = std::max(1e-6, std::min(1.05 * quantile(frames, 1), 4 * quantile(frames, 0.9)));
    constexpr size_t kBins = 60;
    PlotSeries s{"frames", {}, {}, false};
    std::vector<double> bin(kBins);
    for (const double ms : frames) bin[std::min(kBins - 1, static_cast<size_t>(ms / high * kBins))] += 1;
    for (size_t i = 0; i < kBins; ++i) {
        // staircase
        s.x.push_back(static_cast<double>(i) * high / kBins), s.y.push_back(bin[i]);
        s.x.push_back(static_cast<double>(i + 1) * high / kBins), s.y.push_back(bin[i]);
    }
    return "<div class=\"card\">" + svg_plot({"Displayed frames by cost", "ms, all passes of a frame, without drawing", "frames", {s}}) +
           format("<p>Median %.3g ms, 99th percentile %.3g ms. The last bin includes all larger values.</p></div>\n", quantile(frames, 0.5),
                  quantile(frames, 0.99));
}

std::string worst_section(const RunFigures& f, const ReportMedia& media) {
    const std::vector<size_t> worst = worst_passes(f, 6);
    if (worst.empty()) return "";
    std::string cards;
    for (size_t i = 0; i < worst.size(); ++i) {
        const PassFigures& p = f.pass[worst[i]];
        std::vector<std::pair<float, size_t>> stages;
        if (worst[i] < f.pass_stage_ms.size())
            for (size_t s = 0; s < f.pass_stage_ms[worst[i]].size(); ++s) stages.emplace_back(-f.pass_stage_ms[worst[i]][s], s);
        std::sort(stages.begin(), stages.end());
        cards += format("<div class=\"card\" data-time=\"%.3f\">", p.time);
        if (i < media.worst.size() && !media.worst[i].empty())
            cards += "<img style=\"width:100%\" src=\"" + escape_html(media.worst[i]) + "\" alt=\"pass\">";
        cards += format("<p><b>%.2f ms</b>, pass %zu at %.3f s; ", p.frame_ms - p.render_ms, worst[i], p.time);
        for (size_t s = 0; s < std::min<size_t>(3, stages.size()); ++s)
            cards += escape_html(f.stage[stages[s].second].name) + format(" %.2f, ", static_cast<double>(-stages[s].first));
        cards += format("%u contact%s, %u pair%s overlapping, deepest %.2f mm</p></div>\n", p.contacts, p.contacts == 1 ? "" : "s", p.pairs,
                        p.pairs == 1 ? "" : "s", p.depth * 1e3);
    }
    return "<h2>The slowest passes</h2><p>Without drawing; the first four passes of a run, which allocate memory, are excluded. Each "
           "picture is the next one drawn.</p><div class=\"shots\">" +
           cards + "</div>\n";
}

std::string pair_section(const RunFigures& f) {
    if (f.pair.empty()) return "";
    std::string rows =
        "<tr><th>pair</th><th>ms per pass</th><th>worst, ms</th><th>candidate vertices</th><th>cell, mm</th><th>deepest, "
        "mm</th><th>passes</th></tr>";
    for (size_t i = 0; i < std::min(kPairsShown, f.pair.size()); ++i) {
        const PairFigures& p = f.pair[i];
        const double n = static_cast<double>(p.passes);
        rows += "<tr><td>" + escape_html(p.name) +
                format(
                    "</td><td class=\"v\">%.3f</td><td class=\"v\">%.3f</td><td class=\"v\">%.0f</td><td class=\"v\">%.2f</td><td "
                    "class=\"v\">%.3f</td><td class=\"v\">%llu</td></tr>",
                    p.ms / n, p.worst_ms, p.vertices / n, 1e3 * p.cell / n, 1e3 * p.depth, static_cast<unsigned long long>(p.passes));
    }
    return "<h2>Cost of each pair</h2><p>Detection time, attributed by candidate vertices in each pass; the " +
           std::to_string(std::min(kPairsShown, f.pair.size())) + " most expensive of " + std::to_string(f.pairs_met) +
           ". The response is solved by islands: see the trace.</p><table>" + rows + "</table>\n";
}

}  // namespace

std::string cost_sections(const RunFigures& f, const ReportMedia& media) {
    if (f.pass_stage_ms.empty()) return "";
    return "<h2>Cost by stage and pair</h2>" + timeline(f) + "<div class=\"grid\">" + frame_histogram(f) + "</div>" +
           worst_section(f, media) + pair_section(f);
}

std::string pass_events(const Trace& trace, const RunFigures& figures) {
    struct Times {
        uint64_t begin = UINT64_MAX, end = 0;  // ns
    };
    std::map<uint32_t, Times> passes;
    uint64_t first = UINT64_MAX;
    for (size_t i = 0; i < trace.size(); ++i) {
        const TraceEvent& e = trace[i];
        first = std::min(first, e.begin_ns);
        if (e.thread == kPairTrack) continue;  // shares, made after the pass
        Times& t = passes[e.pass];
        t.begin = std::min(t.begin, e.begin_ns), t.end = std::max(t.end, e.begin_ns + e.duration_ns);
    }
    if (passes.empty()) return "";
    std::string out = format(",\n{\"name\":\"thread_name\",\"ph\":\"M\",\"pid\":1,\"tid\":%u,\"args\":{\"name\":\"passes\"}}", kPassTrack);
    const auto us = [&](uint64_t ns) { return 1e-3 * static_cast<double>(ns - first); };
    uint64_t before = 0;  // ns, end of the pass before
    for (const auto& [pass, t] : passes) {
        if (pass >= figures.pass.size()) break;
        const PassFigures& p = figures.pass[pass];
        out += format(
            ",\n{\"name\":\"pass\",\"ph\":\"X\",\"pid\":1,\"tid\":%u,\"ts\":%.3f,\"dur\":%.3f,\"args\":{\"pass\":%u,\"time_s\":%.4f,"
            "\"pairs\":%u,"
            "\"inside_vertices\":%u,\"awake\":%u}}",
            kPassTrack, us(t.begin), us(t.end) - us(t.begin), pass, p.time, p.pairs, p.inside_vertices, p.awake);
        const std::pair<const char*, double> counters[] = {
            {"contacts", p.contacts}, {"depth_mm", 1e3 * p.depth}, {"force_n", p.force}, {"resident_mib", p.resident / (1024 * 1024)}};
        for (const auto& [name, value] : counters) {
            if (p.resident == 0 && value == 0 && std::string_view(name) == "resident_mib") continue;  // live runs do not look
            out += format(",\n{\"name\":\"%s\",\"ph\":\"C\",\"pid\":1,\"ts\":%.3f,\"args\":{\"%s\":%.6g}}", name, us(t.begin), name, value);
        }
        // an arrow from each pass to the next, whose state it made
        if (before > 0)
            out += format(
                ",\n{\"name\":\"state\",\"cat\":\"state\",\"ph\":\"s\",\"id\":%u,\"pid\":1,\"tid\":%u,\"ts\":%.3f},\n{\"name\":\"state\","
                "\"cat\":"
                "\"state\",\"ph\":\"f\",\"bp\":\"e\",\"id\":%u,\"pid\":1,\"tid\":%u,\"ts\":%.3f}",
                pass, kPassTrack, us(before) - 0.001, pass, kPassTrack, us(t.begin));
        before = t.end;
    }
    return out;
}

void write_trace(const std::filesystem::path& file, const Trace& trace, const std::vector<std::string>& thread_names,
                 const RunFigures* figures) {
    std::string text = trace.to_json(thread_names);
    if (figures) text.insert(text.rfind("\n]"), pass_events(trace, *figures));
    write_whole_file(file, text);
    if (trace.dropped() > 0)
        std::fprintf(stderr, "trocar: note: %s holds the first %zu of %zu spans\n", file.c_str(), trace.size(),
                     trace.size() + trace.dropped());
}

}  // namespace trocar
