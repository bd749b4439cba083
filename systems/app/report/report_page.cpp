#include "systems/app/report/report_page.hpp"

#include <algorithm>
#include <cmath>

#include "systems/app/console/format.hpp"
#include "systems/app/report/plot_cursor.hpp"
#include "systems/app/report/run_costs.hpp"
#include "systems/app/report/svg_plot.hpp"
namespace trocar {
namespace {

constexpr const char* kStyle =
    "body{font:15px/1.5 system-ui,sans-serif;margin:0 auto;max-width:1360px;padding:24px;color:#1c2430;"
    "background:#fbfbfc}"
    "h1{font-size:26px;margin:0 0 4px}h2{font-size:19px;margin:32px 0 4px}p{margin:4px 0 10px;max-width:92ch}"
    ".grid{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(520px,100%),1fr));gap:16px}"
    ".card{background:#fff;border:1px solid #e3e6ea;border-radius:8px;padding:10px 12px}"
    ".card p{font-size:13.5px;color:#4a5565;margin:2px 0 4px}"
    ".facts{display:grid;grid-template-columns:repeat(auto-fill,minmax(190px,1fr));gap:10px;margin:14px 0}"
    ".fact{background:#fff;border:1px solid #e3e6ea;border-radius:8px;padding:8px 12px}"
    ".fact b{display:block;font-size:20px;font-weight:600}.fact span{font-size:13px;color:#4a5565}"
    ".shots{display:grid;grid-template-columns:repeat(auto-fill,minmax(210px,1fr));gap:8px}"
    ".shots img,video{width:100%;border-radius:6px;display:block}"
    "table{border-collapse:collapse;font-size:14px}td,th{padding:3px 18px 3px 0;text-align:left;vertical-align:top;"
    "border-bottom:1px solid #eceef1}td.v{text-align:right;font-variant-numeric:tabular-nums}"
    "svg{width:100%;height:auto;display:block}svg text{font:12px system-ui,sans-serif;fill:#3a4452}"
    "svg .t{font-weight:600;font-size:14px;fill:#1c2430}"
    "svg .h{paint-order:stroke;stroke:#fff;stroke-width:4px;stroke-linejoin:round}"
    "nav{display:flex;flex-wrap:wrap;gap:4px 16px;margin:8px 0;font-size:14px}nav a{color:#1f6feb;text-decoration:none}"
    ".tip{display:none;position:fixed;z-index:5;pointer-events:none;background:#fff;border:1px solid #c9ced6;border-radius:6px;"
    "padding:4px 8px;font-size:12.5px;font-variant-numeric:tabular-nums;box-shadow:0 2px 8px #0002}"
    "svg .cursor{stroke:#8a94a3}svg .shown{stroke:#1c2430;stroke-width:1.5;display:none}.played svg .shown{display:initial}"
    ".played svg.timed,.played .card[data-time]{cursor:pointer}"
    "svg .g{stroke:#e9ecf0}svg .m{stroke:#888;stroke-dasharray:5 4}code{background:#eef0f3;padding:1px 4px;"
    "border-radius:4px}";

std::string card(const std::string& svg, const std::string& note = "") {
    return "<div class=\"card\">" + svg + (note.empty() ? "" : "<p>" + note + "</p>") + "</div>\n";
}

std::string section(const std::string& title, const std::string& note, const std::string& content) {
    return "<h2>" + title + "</h2>" + (note.empty() ? "" : "<p>" + note + "</p>") + content + "\n";
}

std::string grid(const std::string& cards) { return "<div class=\"grid\">" + cards + "</div>"; }

std::string fact(const std::string& value, const std::string& what) {
    return "<div class=\"fact\"><b>" + value + "</b><span>" + what + "</span></div>";
}

std::string row(const std::string& name, const std::string& value) { return "<tr><td>" + name + "</td><td>" + value + "</td></tr>"; }

std::string fluid_rows(const FluidFigures& f) {
    if (!f.any) return "";
    const auto ml = [](double m3) { return format("%.2f ml", 1e6 * m3); };
    std::string rows =
        row("liquids", "bled " + ml(f.bled) + ", irrigated " + ml(f.irrigated) + "; sucked " + ml(f.sucked) + " (" + ml(f.sucked_blood) +
                           " of blood), film " + ml(f.film) + ", pools " + ml(f.pools) + ", drops " + ml(f.drops) + ", lost " + ml(f.lost) +
                           format("; what came less what is there and went: %.1e of it", f.error));
    if (f.wounds > 0) rows += row("wounds", format("%u of %u sealed", f.sealed, f.wounds));
    if (f.emitted > 0)
        rows += row("smoke", format("%.3g mg; sucked %.3g mg, cleared %.3g mg", 1e6 * f.emitted, 1e6 * f.smoke_sucked, 1e6 * f.cleared));
    return rows;
}

std::string head(const RunFigures& f, const ContactColumns& c) {
    std::string facts = fact(format("%.2f s", f.simulated_s), "simulated in " + format("%.2f s", f.wall_s) + " of real time");
    facts += fact(std::to_string(c.total.size()),
                  "contact events in " + std::to_string(f.pass.size()) + " passes" +
                      (f.simulated_s > 0 ? format(" (%.0f a second)", static_cast<double>(f.pass.size()) / f.simulated_s) : ""));
    if (!c.total.empty()) {
        facts += fact(format("%.3f ms", mean(c.total)),
                      "per contact event on average; 99 % are below " + format("%.3f ms", quantile(c.total, .99)));
        facts += fact(format("%.3f ms", mean(c.response)), "of which for the response");
        facts += fact(format("%.3g mm", quantile(c.depth_mm, 1)), "deepest penetration");
        facts += fact(format("%.3g mm", 1e3 * overlap_left(f)), "deepest in the last tenth of the run: what contact has not parted");
    }
    if (f.ticks > 0)
        facts += fact(format("%.2f N", f.max_force), "largest force on the hand, in " + std::to_string(f.ticks) + " ticks of 1 ms");
    std::string table = "<table>";
    for (const std::string& body : f.bodies) table += row("body", escape_html(body));
    table += row("state hash", "<code>" + state_hash_text(f) +
                                   "</code> of the final state: independent of the number of "
                                   "threads");
    for (const ToolFigures& tool : f.tool)
        if (!tool.device.empty()) table += row("device of " + escape_html(tool.body), escape_html(device_text(tool)));
    table += fluid_rows(f.fluid);
    table += row("machine", escape_html(f.machine) + ", " + std::to_string(f.threads) + (f.threads == 1 ? " thread, " : " threads, ") +
                                escape_html(f.instruction_set));
    table += row("program", "trocar " + escape_html(f.version) + (f.live ? ", live" : ", in lockstep"));
    return "<h1>" + escape_html(f.scene) + "</h1><p>" + escape_html(f.description) + "</p><div class=\"facts\">" + facts + "</div>" +
           table + "</table>\n";
}

std::string media_sections(const ReportMedia& media) {
    std::string out;
    if (!media.film.empty())
        out += section("Film", "", "<div style=\"max-width:660px\"><video src=\"" + escape_html(media.film) + "\" controls></video></div>");
    if (media.picture.empty()) return out;
    std::string shots;
    for (size_t i = 0; i < media.picture.size(); ++i)
        shots += "<img src=\"" + escape_html(media.picture[i]) + "\" alt=\"picture " + std::to_string(i + 1) + "\">";
    return out + section("Pictures", "Selected evenly over the run; all pictures are in <code>frames/</code>.",
                         "<div class=\"shots\">" + shots + "</div>");
}

std::string contact_section(const ContactColumns& c) {
    if (c.total.empty()) return section("Contact", "Nothing overlapped in this run.", "");
    std::vector<double> event(c.total.size());
    for (size_t i = 0; i < event.size(); ++i) event[i] = static_cast<double>(i + 1);
    const auto over_events = [&](const char* title, const char* series, const std::vector<double>& ms) {
        Plot plot{title, "contact event, in order of time", "ms", {{series, event, ms}}};
        plot.event_time = c.time;
        plot.mark_y = mean(ms);
        plot.mark_label = "mean " + format("%.3f ms", mean(ms));
        plot.cut_outliers = true;
        return svg_plot(plot);
    };
    const auto against = [&](const char* title, const char* label, const std::vector<double>& x, double least) {
        Plot plot{title, label, "ms", {{"total", x, c.total, true}, {"response", x, c.response, true}}};
        plot.log_x_from = least;
        plot.cut_outliers = true;
        return svg_plot(plot);
    };
    std::string cards;
    cards += card(over_events("Detection and response", "total", c.total),
                  "The thesis' figure 5.1: 2.303 ms on average in 2008, on a dual 2.8 GHz Xeon and with its own scene.");
    cards += card(over_events("Response alone", "response", c.response), "The thesis' figure 5.2: 1.884 ms on average.");
    cards += card(against("Time per event against depth", "depth, mm", c.depth_mm, 1e-3),
                  "Depth on a logarithmic scale: the response keeps most events shallow. Smaller depths are drawn "
                  "at 1 um.");
    cards += card(against("Time per event against vertices inside", "vertices of one body inside the other", c.inside, 1),
                  "Logarithmic scale; 0 (only edges or touching vertices met) is drawn at 1.");
    return section("Contact",
                   "A contact event is a contact pass with at least one overlapping pair of bodies. Its time is detection "
                   "(every stage from body boxes to islands) and response (the contact constraints in all substeps of the pass).",
                   grid(cards));
}

std::string force_note(const RunFigures& f) {
    return std::string(
               "On the hand: what the device is commanded at the end of the pass, within its limits. Of the tissue on the tool: contacts "
               "and links, mean over the pass.") +
           (f.max_force > 0
                ? " Largest on a hand in any tick " + format("%.2f N", f.max_force) +
                      (f.max_force_wanted > f.max_force * (1 + 1e-9) ? format("; %.2f N were asked for before limits.", f.max_force_wanted)
                                                                     : ".")
                : "");
}

std::string time_section(const RunFigures& f) {
    const auto passes = [&](double PassFigures::*value, double scale = 1) {
        std::vector<double> v;
        for (const PassFigures& p : f.pass) v.push_back(p.*value * scale);
        return v;
    };
    const auto mj = [&](double Energy::*term) {
        std::vector<double> v;
        for (const PassFigures& p : f.pass) v.push_back(p.energy.*term * 1e3);
        return v;
    };
    const std::vector<double> t = passes(&PassFigures::time);
    std::vector<double> elastic;
    for (const PassFigures& p : f.pass) elastic.push_back((p.energy.elastic + p.energy.pressure + p.energy.bending) * 1e3);
    const char* const time = kTimeLabel;
    std::string cards;
    cards += card(svg_plot({"Penetration depth", time, "mm", {{"deepest pair", t, passes(&PassFigures::depth, 1e3)}}}),
                  "The largest of the shortest distances from a point inside to the other surface, of the deepest pair, "
                  "as found at the start of each pass.");
    if (f.ticks > 0)
        cards += card(svg_plot({"Force",
                                time,
                                "N",
                                {{"on the hand", t, passes(&PassFigures::force)},
                                 {"of the tissue on the tool", t, passes(&PassFigures::contact_force)}}}),
                      force_note(f));
    cards += card(svg_plot({"Energy",
                            time,
                            "mJ",
                            {{"kinetic", t, mj(&Energy::kinetic)}, {"elastic", t, elastic}, {"gravity", t, mj(&Energy::gravity)}},
                            false}),
                  "Of all deformable bodies; elastic includes enclosed volumes and bending; gravity relative to the world's "
                  "origin.");
    cards += card(svg_plot({"Work, and balance",
                            time,
                            "mJ",
                            {{"hand", t, mj(&Energy::work_hand)},
                             {"impact", t, mj(&Energy::work_contact)},
                             {"damping", t, mj(&Energy::work_damping)},
                             {"position correction", t, mj(&Energy::work_push)},
                             {"balance", t, mj(&Energy::balance)}},
                            false}),
                  "Work on the tissue. Hand: through contact with hands and scripted bodies. Impact: lost in inelastic "
                  "contact and friction. "
                  "Position correction: displacements that remove remaining overlap. Balance: energy minus all work minus "
                  "its value at the start; it should stay at zero.");
    Plot whole{"Real time per pass, picture included", time, "ms", {{"pass", t, passes(&PassFigures::frame_ms)}}};
    whole.mark_y = 1000.0 / 30;
    whole.mark_label = "33 ms: one displayed frame";
    whole.cut_outliers = true;
    cards += card(svg_plot(whole), "A pass that ends a displayed frame draws a picture; the first one also compiles its shaders.");
    return section("Over time", "", grid(cards));
}

// Coordinates of one-coordinate bodies, and the force on the hand plotted over them.
std::string node_section(const RunFigures& f) {
    std::string cards;
    for (size_t row = 0; row < f.drive.size(); ++row) {
        const bool dial = f.drive[row].behaviour == NodeBehaviour::kDial;
        const char* const unit = dial ? "angle, degrees" : "displacement, mm";
        std::vector<double> t, coordinate, force;
        for (const PassFigures& p : f.pass) {
            t.push_back(p.time), coordinate.push_back(p.coordinate[row] * (dial ? 180 / M_PI : 1e3));
            force.push_back(p.force);
        }
        const auto& count = f.drive[row].events.count;
        const auto of = [&](NodeEventKind kind) { return std::to_string(count[static_cast<size_t>(kind)]); };
        cards += card(svg_plot({f.drive[row].body, kTimeLabel, unit, {{unit, t, coordinate}}, false}),
                      dial ? "Detents passed: " + of(NodeEventKind::kDetent) + ", limits reached: " + of(NodeEventKind::kLimit) + "."
                           : "Pressed " + of(NodeEventKind::kPressed) + ", released " + of(NodeEventKind::kReleased) + ", limits reached " +
                                 of(NodeEventKind::kLimit) + " times.");
        if (f.ticks > 0)
            cards +=
                card(svg_plot({f.drive[row].body + ": force on the hand", unit, "N", {{"at the end of a pass", coordinate, force, true}}}),
                     "Largest force on a hand at that coordinate, whatever they touched.");
    }
    return cards.empty() ? "" : section("Buttons, sliders, dials", "", grid(cards));
}

std::string stage_section(const RunFigures& f) {
    std::vector<std::string> names;
    std::vector<double> p50, p99;
    for (const StageFigures& s : f.stage) {
        names.push_back(s.name);
        p50.push_back(quantile(s.ms, 0.5));
        p99.push_back(quantile(s.ms, 0.99));
    }
    return section("Stages",
                   "Real time of every stage of a pass, in order of execution. Dark: median over the passes; "
                   "pale: 99th percentile.",
                   grid(card(svg_bars("Median / 99th percentile", "ms", names, p50, p99))));
}

std::string histogram_card(const char* title, const char* unit, const std::vector<double>& v, const std::string& note) {
    PlotSeries s{"ticks", {}, {}, false};
    // so that a few late ticks do not squeeze the rest into one bin
    const double high = std::min(1.2 * quantile(v, 0.999), 4 * quantile(v, 0.9)) + 1e-9;
    std::vector<double> bin(120, 0);
    for (const double x : v) bin[std::min<size_t>(119, static_cast<size_t>(std::max(0.0, x) / high * 119))] += 1;
    for (size_t i = 0; i < bin.size(); ++i) s.x.push_back(static_cast<double>(i) * high / 119), s.y.push_back(bin[i]);
    return card(svg_plot({title, unit, "ticks", {s}}), note + " The last bin includes all larger values.");
}

// Force on one tool's hand and on the tissue over time, and over the surface if the tool palpated one.
std::string tool_cards(const RunFigures& f, uint32_t tool) {
    std::vector<double> t, hand, tissue;
    for (const ToolSample& s : f.tool_sample)
        if (s.tool == tool) t.push_back(s.time), hand.push_back(s.force.norm()), tissue.push_back(s.tissue.norm());
    std::string cards = card(svg_plot({"Force of " + f.tool[tool].body, kTimeLabel, "N", {{"hand", t, hand}, {"tissue", t, tissue}}}),
                             "On the hand, and of the tissue on the simulated tool, averaged over a contact pass.");
    if (const std::optional<ForceMap> map = force_map(f.tool_sample, tool))
        cards += card(svg_force_map("Force on " + f.tool[tool].body + " by position", *map),
                      "Along its mean direction, seen from the side of the tool. Dark where the tissue below is stiff.");
    return cards;
}

std::string haptics_section(const RunFigures& f) {
    if (f.tick_us.empty()) return "";
    std::string cards = histogram_card("Compute time of a tick", "us", f.tick_us,
                                       "Median " + format("%.1f us", quantile(f.tick_us, .5)) + ", 99.9th percentile " +
                                           format("%.1f us", quantile(f.tick_us, .999)) + ".");
    if (f.live) {
        cards += histogram_card(
            "Period of the tick", "us", f.tick_period_us,
            "99.9th percentile " + format("%.0f us", quantile(f.tick_period_us, .999)) + "; " + escape_html(f.scheduling) + ".");
        cards += histogram_card("Age of the surface used for the force", "ms", f.contact_age_ms, "");
    }
    for (uint32_t t = 0; t < f.tool.size(); ++t) cards += tool_cards(f, t);
    return section("Haptics", "The force is computed a thousand times a second from the surface near the tool.", grid(cards));
}

std::string trouble_section(const Report& r) {
    std::string rows;
    each_number(r, kOnPage, [&](const ReportNumber& n, const auto& value) {
        if (value > 0) rows += "<tr><td class=\"v\">" + std::to_string(value) + "</td><td>" + n.text + "</td></tr>";
    });
    return section("Problems",
                   rows.empty() ? "All counters are zero." : "The simulation continues after these events; counters not listed are zero.",
                   rows.empty() ? "" : "<table>" + rows + "</table>");
}

}  // namespace

std::string html_page(const std::string& title, const std::string& body) {
    return "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" "
           "content=\"width=device-width\"><title>" +
           escape_html(title) + " - Trocar</title><style>" + kStyle + "</style></head><body>\n" + body + "<script>" + kPlotCursor +
           "</script></body></html>\n";
}

std::string report_html(const RunFigures& f, const ReportMedia& media) {
    const ContactColumns c = contact_columns(f);
    return html_page(f.scene, head(f, c) + media.player + media_sections(media) + media.score + contact_section(c) + time_section(f) +
                                  node_section(f) + stage_section(f) + cost_sections(f, media) + haptics_section(f) +
                                  trouble_section(f.report));
}

}  // namespace trocar
