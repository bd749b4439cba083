#include "systems/app/figures.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "systems/app/svg_plot.hpp"
namespace trocar {

double quantile(std::vector<double> values, double q) {
    if (values.empty()) return 0;
    const size_t row = std::min(
        values.size() - 1, static_cast<size_t>(std::ceil(q * static_cast<double>(values.size())) - (q > 0 ? 1 : 0)));
    std::nth_element(values.begin(), values.begin() + static_cast<ptrdiff_t>(row), values.end());
    return values[row];
}

double mean(const std::vector<double>& values) {
    double sum = 0;
    for (const double v : values) sum += v;
    return values.empty() ? 0 : sum / static_cast<double>(values.size());
}

namespace {

struct ContactColumns {
    std::vector<double> time, total, response, depth_mm, inside;
};

// Only the passes that had contact: what the thesis calls a collision instance.
ContactColumns contact_columns(const RunFigures& f) {
    ContactColumns c;
    for (const PassFigures& p : f.pass) {
        if (!p.contact()) continue;
        c.time.push_back(p.time);
        c.total.push_back(p.detection_ms + p.response_ms);
        c.response.push_back(p.response_ms);
        c.depth_mm.push_back(p.depth * 1e3);
        c.inside.push_back(p.inside_vertices);
    }
    return c;
}

std::string hex(uint64_t value) {
    char text[20];
    std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(value));
    return text;
}

nlohmann::ordered_json percentiles(const std::vector<double>& v, const char* unit) {
    const std::string u = unit;
    return {{"p50_" + u, quantile(v, 0.5)},
            {"p99_" + u, quantile(v, 0.99)},
            {"p999_" + u, quantile(v, 0.999)},
            {"max_" + u, quantile(v, 1)}};
}

nlohmann::ordered_json report_json(const Report& r) {
    return {{"contact_passes", r.contact_passes},
            {"contact_events", r.contact_events},
            {"dropped_contacts", r.dropped_contacts},
            {"oversize_triangles", r.oversize_triangles},
            {"tie_overflows", r.tie_overflows},
            {"sign_disagreements", r.sign_disagreements},
            {"ended_rows", r.ended_rows},
            {"opposing_planes", r.opposing_planes},
            {"nonfinite_particles", r.nonfinite_particles},
            {"dropped_pictures", r.dropped_pictures},
            {"late_passes", r.late_passes},
            {"deepest_residual_m", r.deepest_residual}};
}

nlohmann::ordered_json energy_json(const RunFigures& f) {
    Energy last;
    double peak = 0, worst = 0;
    for (const PassFigures& p : f.pass) {
        last = p.energy;
        peak = std::max(peak, p.energy.elastic);
        worst = std::max(worst, std::abs(p.energy.balance));
    }
    return {{"kinetic_j", last.kinetic},
            {"elastic_j", last.elastic},
            {"gravity_j", last.gravity},
            {"work_hand_j", last.work_hand},
            {"work_contact_j", last.work_contact},
            {"work_damping_j", last.work_damping},
            {"work_push_j", last.work_push},
            {"balance_j", last.balance},
            {"peak_elastic_j", peak},
            {"worst_balance_j", worst},
            {"worst_balance_of_peak", peak > 0 ? worst / peak : 0}};
}

}  // namespace

std::string metrics_json(const RunFigures& f) {
    using json = nlohmann::ordered_json;
    const ContactColumns c = contact_columns(f);
    json j;
    j["scene"] = f.scene;
    j["version"] = f.version;
    j["instruction_set"] = f.instruction_set;
    j["machine"] = f.machine;
    j["threads"] = f.threads;
    j["live"] = f.live;
    j["state_hash"] = hex(f.state_hash);
    j["frames"] = f.frames;
    j["simulated_s"] = f.simulated_s;
    j["wall_s"] = f.wall_s;
    j["bodies"] = f.bodies;
    json stages = json::object();
    for (const StageFigures& s : f.stage)
        stages[s.name] = {
            {"p50_ms", quantile(s.ms, 0.5)}, {"p99_ms", quantile(s.ms, 0.99)}, {"max_ms", quantile(s.ms, 1)}};
    j["stages"] = stages;
    double max_depth = 0;
    std::vector<double> frame_ms;
    for (const PassFigures& p : f.pass) {
        max_depth = std::max(max_depth, p.depth);
        frame_ms.push_back(p.frame_ms);
    }
    std::vector<double> deep_total, deep_inside;
    for (size_t i = 0; i < c.total.size(); ++i) {
        if (c.depth_mm[i] >= 5 && c.inside[i] >= 200)
            deep_total.push_back(c.total[i]), deep_inside.push_back(c.inside[i]);
    }
    j["contact"] = {{"events", c.total.size()},
                    {"max_depth_m", max_depth},
                    {"max_inside_vertices", quantile(c.inside, 1)},
                    {"total_ms_mean", mean(c.total)},
                    {"total_ms_p99", quantile(c.total, 0.99)},
                    {"response_ms_mean", mean(c.response)},
                    {"deep_events", deep_total.size()},
                    {"deep_total_ms_mean", mean(deep_total)},
                    {"deep_total_ms_p99", quantile(deep_total, 0.99)}};
    j["frame"] = percentiles(frame_ms, "ms");
    j["render"] = percentiles(f.render_ms, "ms");
    j["haptics"] = {{"ticks", f.ticks}, {"max_force_n", f.max_force}, {"tick", percentiles(f.tick_us, "us")}};
    if (f.live) {
        j["haptics"]["period"] = percentiles(f.tick_period_us, "us");
        j["haptics"]["contact_age"] = percentiles(f.contact_age_ms, "ms");
        j["haptics"]["missed_ticks"] = f.missed_ticks;
        j["haptics"]["scheduling"] = f.scheduling;
    }
    if (f.replay) j["replay"] = {{"same", f.replay_difference.empty()}, {"difference", f.replay_difference}};
    j["energy"] = energy_json(f);
    j["report"] = report_json(f.report);
    return j.dump(2) + "\n";
}

std::string passes_csv(const RunFigures& f) {
    std::string out =
        "time_s,detection_ms,response_ms,frame_ms,render_ms,depth_m,inside_vertices,contacts,pairs,force_n,"
        "contact_force_n,kinetic_j,elastic_j,gravity_j,work_hand_j,work_contact_j,work_damping_j,work_push_j,balance_j\n";
    char line[512];
    for (const PassFigures& p : f.pass) {
        std::snprintf(line, sizeof line,
                      "%.3f,%.4f,%.4f,%.4f,%.4f,%.9g,%u,%u,%u,%.6g,%.6g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g\n", p.time,
                      p.detection_ms, p.response_ms, p.frame_ms, p.render_ms, p.depth, p.inside_vertices, p.contacts,
                      p.pairs, p.force, p.contact_force, p.energy.kinetic, p.energy.elastic, p.energy.gravity,
                      p.energy.work_hand, p.energy.work_contact, p.energy.work_damping, p.energy.work_push,
                      p.energy.balance);
        out += line;
    }
    return out;
}

namespace {

constexpr const char* kStyle =
    "body{font:15px/1.5 system-ui,sans-serif;margin:0 "
    "auto;max-width:1360px;padding:24px;color:#1c2430;background:#fbfbfc}"
    "h1{font-size:26px;margin:0 0 4px}h2{font-size:18px;margin:28px 0 8px}p{margin:4px 0;max-width:80ch}"
    ".grid{display:grid;grid-template-columns:repeat(auto-fit,minmax(560px,1fr));gap:16px}"
    ".card{background:#fff;border:1px solid #e3e6ea;border-radius:8px;padding:10px}"
    ".shots{display:grid;grid-template-columns:repeat(auto-fill,minmax(220px,1fr));gap:8px}.shots "
    "img,video{width:100%;border-radius:6px;display:block}"
    "table{border-collapse:collapse}td,th{padding:3px 14px 3px 0;text-align:left;border-bottom:1px solid "
    "#eceef1}td.v{text-align:right;font-variant-numeric:tabular-nums}"
    "svg{width:100%;height:auto}svg text{font:12px system-ui,sans-serif;fill:#3a4452}svg "
    ".t{font-weight:600;font-size:14px;fill:#1c2430}"
    "svg .g{stroke:#e9ecf0}svg .m{stroke:#888;stroke-dasharray:5 4}code{background:#eef0f3;padding:1px "
    "4px;border-radius:4px}";

std::string card(const std::string& svg, const std::string& note = "") {
    return "<div class=\"card\">" + svg + (note.empty() ? "" : "<p>" + note + "</p>") + "</div>\n";
}

std::string number(double v, const char* pattern) {
    char text[64];
    std::snprintf(text, sizeof text, pattern, v);
    return text;
}

std::string row(const std::string& name, const std::string& value) {
    return "<tr><td>" + name + "</td><td class=\"v\">" + value + "</td></tr>";
}

std::string contact_section(const RunFigures& f) {
    const ContactColumns c = contact_columns(f);
    std::vector<double> event(c.total.size());
    for (size_t i = 0; i < event.size(); ++i) event[i] = static_cast<double>(i + 1);
    const std::string average = number(mean(c.total), "%.3f"), response = number(mean(c.response), "%.3f");
    std::string out = "<h2>Contact</h2><div class=\"grid\">";
    out += card(svg_plot({"Detection to the end of the response",
                          "contact event",
                          "ms",
                          {{"total", event, c.total}},
                          true,
                          mean(c.total),
                          "mean " + average + " ms"}),
                "The thesis' figure 5.1 (2008, dual 2.8 GHz Xeon, its own scene: 2.303 ms on average). A contact event "
                "is a contact pass with at least one overlapping pair; the time covers every stage from body boxes to "
                "islands and the contact rows of all substeps of the pass.");
    out += card(svg_plot({"Response alone",
                          "contact event",
                          "ms",
                          {{"response", event, c.response}},
                          true,
                          mean(c.response),
                          "mean " + response + " ms"}),
                "The thesis' figure 5.2 (1.884 ms on average).");
    out += card(svg_plot({"Contact time against depth",
                          "depth, mm",
                          "ms",
                          {{"total", c.depth_mm, c.total, true}, {"response", c.depth_mm, c.response, true}}}));
    out += card(svg_plot({"Contact time against inside vertices",
                          "vertices inside",
                          "ms",
                          {{"total", c.inside, c.total, true}, {"response", c.inside, c.response, true}}}));
    return out + "</div>";
}

std::string time_section(const RunFigures& f) {
    std::vector<double> t, depth, force, contact_force, frame, kinetic, elastic, gravity, hand, contact, damping, push,
        balance;
    for (const PassFigures& p : f.pass) {
        t.push_back(p.time);
        depth.push_back(p.depth * 1e3);
        force.push_back(p.force);
        contact_force.push_back(p.contact_force);
        frame.push_back(p.frame_ms);
        kinetic.push_back(p.energy.kinetic * 1e3), elastic.push_back(p.energy.elastic * 1e3);
        gravity.push_back(p.energy.gravity * 1e3), hand.push_back(p.energy.work_hand * 1e3);
        contact.push_back(p.energy.work_contact * 1e3), damping.push_back(p.energy.work_damping * 1e3);
        push.push_back(p.energy.work_push * 1e3), balance.push_back(p.energy.balance * 1e3);
    }
    std::string out = "<h2>Over time</h2><div class=\"grid\">";
    out += card(svg_plot({"Penetration depth", "s", "mm", {{"deepest pair", t, depth}}}));
    if (f.ticks > 0)
        out += card(svg_plot(
            {"Force", "s", "N", {{"to the hand", t, force}, {"of the tissue on the tool", t, contact_force}}}));
    out += card(svg_plot(
        {"Energy", "s", "mJ", {{"kinetic", t, kinetic}, {"elastic", t, elastic}, {"gravity", t, gravity}}, false}));
    out += card(svg_plot({"Work and balance",
                          "s",
                          "mJ",
                          {{"hand", t, hand},
                           {"impact", t, contact},
                           {"damping", t, damping},
                           {"push-out", t, push},
                           {"balance", t, balance}},
                          false}),
                "balance = kinetic + elastic + gravity - all work - value at the start; it should stay flat at zero.");
    out += card(svg_plot({"Whole pass, pictures included", "s", "ms", {{"pass", t, frame}}, true, 33, "33 ms"}));
    return out + "</div>";
}

std::string stage_section(const RunFigures& f) {
    std::vector<std::string> names;
    std::vector<double> p50, p99;
    for (const StageFigures& s : f.stage) {
        names.push_back(s.name);
        p50.push_back(quantile(s.ms, 0.5));
        p99.push_back(quantile(s.ms, 0.99));
    }
    return "<h2>Stages</h2><div class=\"grid\">" +
           card(svg_bars("Cost of every stage: p50 filled, p99 pale", "ms", names, p50, p99)) + "</div>";
}

std::string haptics_section(const RunFigures& f) {
    if (f.tick_us.empty()) return "";
    const auto histogram = [](const std::vector<double>& v) {
        PlotSeries s{"ticks", {}, {}, false};
        const double high = quantile(v, 0.999) * 1.2 + 1e-9;
        std::vector<double> bin(120, 0);
        for (const double x : v) bin[std::min<size_t>(119, static_cast<size_t>(std::max(0.0, x) / high * 119))] += 1;
        for (size_t i = 0; i < bin.size(); ++i)
            s.x.push_back(static_cast<double>(i) * high / 119), s.y.push_back(bin[i]);
        return s;
    };
    std::string out = "<h2>Haptics</h2><div class=\"grid\">";
    out += card(svg_plot({"Compute time of a tick", "us", "ticks", {histogram(f.tick_us)}}),
                "p50 " + number(quantile(f.tick_us, .5), "%.1f") + " us, p99.9 " +
                    number(quantile(f.tick_us, .999), "%.1f") + " us");
    if (f.live) {
        out += card(svg_plot({"Period of the tick", "us", "ticks", {histogram(f.tick_period_us)}}),
                    "p99.9 " + number(quantile(f.tick_period_us, .999), "%.0f") + " us; " + escape_html(f.scheduling));
        out += card(svg_plot({"Age of the surface under the force", "ms", "ticks", {histogram(f.contact_age_ms)}}));
    }
    return out + "</div>";
}

}  // namespace

std::string report_html(const RunFigures& f, const std::vector<std::string>& pictures, const std::string& film) {
    const ContactColumns c = contact_columns(f);
    std::string out = "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><title>" + escape_html(f.scene) +
                      " - Trocar</title><style>" + kStyle + "</style></head><body>\n<h1>" + escape_html(f.scene) +
                      "</h1><p>" + escape_html(f.description) + "</p><table>";
    out += row("simulated / wall", number(f.simulated_s, "%.2f s") + " / " + number(f.wall_s, "%.2f s"));
    out += row("threads, instruction set", std::to_string(f.threads) + ", " + f.instruction_set);
    out += row("state hash", "<code>" + hex(f.state_hash) + "</code>");
    out += row("contact events", std::to_string(c.total.size()));
    out += row("contact time, mean / p99",
               number(mean(c.total), "%.3f") + " / " + number(quantile(c.total, .99), "%.3f ms"));
    out += row("response, mean", number(mean(c.response), "%.3f ms"));
    out += row("deepest", number(quantile(c.depth_mm, 1), "%.2f mm"));
    if (f.ticks > 0)
        out += row("haptic ticks, largest force", std::to_string(f.ticks) + ", " + number(f.max_force, "%.2f N"));
    for (const std::string& body : f.bodies) out += row("body", escape_html(body));
    out += row("machine", escape_html(f.machine)) + "</table>\n";
    if (!film.empty())
        out += "<h2>Film</h2><div style=\"max-width:660px\"><video src=\"" + escape_html(film) +
               "\" controls></video></div>";
    if (!pictures.empty()) {
        out += "<h2>Pictures</h2><div class=\"shots\">";
        const size_t step = std::max<size_t>(1, pictures.size() / 12);
        for (size_t i = 0; i < pictures.size(); i += step)
            out += "<img loading=\"lazy\" src=\"" + escape_html(pictures[i]) + "\" alt=\"picture " + std::to_string(i) +
                   "\">";
        out += "</div>";
    }
    out += contact_section(f) + time_section(f) + stage_section(f) + haptics_section(f);
    return out + "</body></html>\n";
}

}  // namespace trocar
