#include "systems/app/report/figures.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <nlohmann/json.hpp>

#include "engine/distance/closest_point.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/console/stop_signal.hpp"
namespace trocar {

double quantile(std::vector<double> values, double q) {
    if (values.empty()) return 0;
    const size_t row =
        std::min(values.size() - 1, static_cast<size_t>(std::ceil(q * static_cast<double>(values.size())) - (q > 0 ? 1 : 0)));
    std::nth_element(values.begin(), values.begin() + static_cast<ptrdiff_t>(row), values.end());
    return values[row];
}

double mean(const std::vector<double>& values) {
    double sum = 0;
    for (const double v : values) sum += v;
    return values.empty() ? 0 : sum / static_cast<double>(values.size());
}

std::vector<double> displayed_frames(const std::vector<PassFigures>& passes) {
    std::vector<double> ms;
    double sum = 0;
    for (const PassFigures& p : passes) {
        sum += p.frame_ms - p.render_ms;
        if (p.picture) ms.push_back(sum), sum = 0;
    }
    return ms;
}

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

namespace {

nlohmann::ordered_json percentiles(const std::vector<double>& v, const char* unit) {
    const std::string u = unit;
    return {
        {"p50_" + u, quantile(v, 0.5)}, {"p99_" + u, quantile(v, 0.99)}, {"p999_" + u, quantile(v, 0.999)}, {"max_" + u, quantile(v, 1)}};
}

nlohmann::ordered_json report_json(const RunFigures& f) {
    nlohmann::ordered_json json;
    each_number(f.report, kInMetrics, [&](const ReportNumber& n, const auto& value) { json[key_of(n.name, n.unit)] = value; });
    double deepest = 0;  // over all passes; the report's own value is of the last pass only
    for (const PassFigures& p : f.pass) deepest = std::max(deepest, p.residual);
    json["deepest_residual_m"] = deepest;
    return json;
}

// J, scale of the mechanical energy: kinetic plus stored, or the gravitational energy released, whichever is
// larger (in a fall one becomes the other).
double moving_energy(const Energy& e, double start_gravity) {
    return std::max(e.kinetic + e.elastic + e.pressure + e.bending + e.links, std::abs(e.gravity - start_gravity));
}

nlohmann::ordered_json energy_json(const RunFigures& f) {
    Energy last;
    double elastic = 0, peak = 0, worst = 0;
    for (const PassFigures& p : f.pass) {
        last = p.energy;
        elastic = std::max(elastic, p.energy.elastic);
        peak = std::max(peak, moving_energy(p.energy, f.start_gravity));
        worst = std::max(worst, std::abs(p.energy.balance));
    }
    nlohmann::ordered_json json;
    each_field(last, [&](const FieldName& field, double value) { json[key_of(field.name, field.unit)] = value; });
    json.update({{"peak_elastic_j", elastic},
                 {"peak_j", peak},
                 {"worst_balance_j", worst},
                 {"worst_balance_of_peak", peak > 0 ? worst / peak : 0}});
    return json;
}

nlohmann::ordered_json pairs_json(const RunFigures& f) {
    nlohmann::ordered_json list = nlohmann::ordered_json::array();
    for (const PairFigures& p : f.pair) {
        const double n = static_cast<double>(p.passes);
        list.push_back({{"pair", p.name},
                        {"passes", p.passes},
                        {"ms_mean", p.ms / n},
                        {"ms_max", p.worst_ms},
                        {"candidate_vertices_mean", p.vertices / n},
                        {"cell_m_mean", p.cell / n},
                        {"max_depth_m", p.depth}});
    }
    return list;
}

nlohmann::ordered_json scale_json(const RunFigures& f) {
    std::vector<double> awake, found, residual, contacts;
    for (const PassFigures& p : f.pass)
        awake.push_back(p.awake), found.push_back(p.depth), residual.push_back(p.residual), contacts.push_back(p.contacts);
    return {{"movable_bodies", f.movable_bodies},     {"body_size_m", f.body_size},
            {"bytes_per_body", f.bytes_per_body},     {"frames_per_second", f.wall_s > 0 ? static_cast<double>(f.frames) / f.wall_s : 0},
            {"awake_bodies_mean", mean(awake)},       {"awake_bodies_end", f.pass.empty() ? 0 : f.pass.back().awake},
            {"contacts_mean", mean(contacts)},        {"contacts_max", quantile(contacts, 1)},
            {"found_p50_m", quantile(found, 0.5)},    {"found_p99_m", quantile(found, 0.99)},
            {"found_max_m", quantile(found, 1)},      {"residual_p99_m", quantile(residual, 0.99)},
            {"residual_max_m", quantile(residual, 1)}};
}

nlohmann::ordered_json tool_json(const ToolFigures& t) {
    using Kind = HapticEventKind;
    const auto events = [&](Kind kind) { return t.events.count[static_cast<size_t>(kind)]; };
    nlohmann::ordered_json j = {{"body", t.body},
                                {"least_energy_j", t.safety.lowest_energy},
                                {"dissipated_j", t.safety.dissipated},
                                {"limited_ticks", t.safety.limited_ticks},
                                {"safe_ticks", t.safety.safe_ticks},
                                {"events",
                                 {{"touch", events(Kind::kTouch)},
                                  {"release", events(Kind::kRelease)},
                                  {"button_down", events(Kind::kButtonDown)},
                                  {"button_up", events(Kind::kButtonUp)},
                                  {"pass_through", events(Kind::kPassThrough)},
                                  {"limit", events(Kind::kLimit)}}}};
    if (t.device.empty()) return j;
    j["device"] = t.device;
    j["device_heard"] = t.device_heard;
    j["refused_ticks"] = t.refused_ticks;
    for (size_t k = 0; k < t.counts.size(); ++k) j["counts"][describe(static_cast<DeviceCount>(k))] = t.counts[k];
    return j;
}

constexpr const char* kNodeEvents[] = {"pressed", "released", "limit", "detent"};
static_assert(std::size(kNodeEvents) == static_cast<size_t>(NodeEventKind::kCount));

nlohmann::ordered_json drive_json(const RunFigures& f, size_t row) {
    constexpr const char* kBehaviours[] = {"", "button", "slider", "dial"};
    const DriveFigures& d = f.drive[row];
    const std::string unit = d.behaviour == NodeBehaviour::kDial ? "rad" : "m";
    double lowest = 0, highest = 0;
    for (const PassFigures& p : f.pass) lowest = std::min(lowest, p.coordinate[row]), highest = std::max(highest, p.coordinate[row]);
    nlohmann::ordered_json j = {{"body", d.body},
                                {"behaviour", kBehaviours[static_cast<size_t>(d.behaviour)]},
                                {"lowest_" + unit, lowest},
                                {"highest_" + unit, highest}};
    for (size_t k = 0; k < std::size(kNodeEvents); ++k) j["events"][kNodeEvents[k]] = d.events.count[k];
    for (uint64_t n = d.events.total - std::min<uint64_t>(d.events.total, kKeptNodeEvents); n < d.events.total; ++n) {
        const NodeEvent& e = d.events.last[n % kKeptNodeEvents];
        j["last_events"].push_back(
            {{"event", kNodeEvents[static_cast<size_t>(e.kind)]}, {"time_s", e.time}, {"place_" + unit, e.coordinate}});
    }
    return j;
}

}  // namespace

namespace {

nlohmann::ordered_json actions_json(const ActionFigures& a) {
    nlohmann::ordered_json j;
    if (a.staples) j = {{"staples", a.set}, {"misfires", a.misfires}, {"pulled_out", a.pulled_out}, {"max_pull_n", a.pull}};
    if (a.cuts)
        j["cuts"] = a.cut, j["cut_area_m2"] = a.area, j["cut_work_j"] = a.work, j["cut_owed_j"] = a.owed, j["cuts_refused"] = a.refused;
    if (a.grasps) j["grasps"] = a.grasped, j["empty_grasps"] = a.nothing_grasped, j["slips"] = a.slipped, j["max_grip_n"] = a.grip;
    if (a.cautery) j["burns"] = a.burns, j["heat_j"] = a.heat, j["burnt_m2"] = a.burnt, j["hottest_c"] = a.hottest;
    if (a.sutures)
        j["stitches"] = a.stitches, j["missed_stitches"] = a.missed, j["slipped_off"] = a.slipped_off, j["throws"] = a.throws,
        j["max_tension_n"] = a.tension, j["thread_drawn_m"] = a.drawn, j["thread_friction_j"] = a.thread_friction;
    return j;
}

nlohmann::ordered_json fluid_json(const FluidFigures& f) {
    return {{"bled_m3", f.bled},
            {"irrigated_m3", f.irrigated},
            {"film_m3", f.film},
            {"pools_m3", f.pools},
            {"drops_m3", f.drops},
            {"sucked_m3", f.sucked},
            {"sucked_blood_m3", f.sucked_blood},
            {"lost_m3", f.lost},
            {"ledger_error", f.error},
            {"bleeding_m3_s", f.bleeding},
            {"wounds", f.wounds},
            {"sealed", f.sealed},
            {"smoke_emitted_kg", f.emitted},
            {"smoke_kg", f.smoke},
            {"smoke_sucked_kg", f.smoke_sucked},
            {"smoke_cleared_kg", f.cleared}};
}

}  // namespace

std::string device_text(const ToolFigures& t) {
    const auto count = [&](DeviceCount what) { return static_cast<unsigned long long>(t.counts[static_cast<size_t>(what)]); };
    std::string text = t.device + format(": %llu samples accepted, refused in %llu ticks", count(DeviceCount::kAccepted),
                                         static_cast<unsigned long long>(t.refused_ticks));
    const char* before = "; ";
    for (size_t k = 0; k < t.counts.size(); ++k) {
        const auto what = static_cast<DeviceCount>(k);
        if (what == DeviceCount::kAccepted || t.counts[k] == 0) continue;
        text += before + format("%s %llu", describe(what), count(what));
        before = ", ";
    }
    return text;
}

std::string state_hash_text(const RunFigures& f) { return hex(f.state_hash); }

std::string metrics_json(const RunFigures& f) {
    using json = nlohmann::ordered_json;
    const ContactColumns c = contact_columns(f);
    json j;
    j["scene"] = f.scene;
    if (!f.scene_file.empty()) j["scene_file"] = f.scene_file;
    for (const auto& [key, value] : f.overridden) j["set"].push_back({key, value});
    j["version"] = f.version;
    j["instruction_set"] = f.instruction_set;
    j["machine"] = f.machine;
    j["threads"] = f.threads;
    j["live"] = f.live;
    j["state_hash"] = hex(f.state_hash);
    j["frames"] = f.frames;
    j["simulated_s"] = f.simulated_s;
    if (f.kept_s > 0) j["kept_s"] = f.kept_s;
    j["build_s"] = f.build_s;
    j["wall_s"] = f.wall_s;
    j["bodies"] = f.bodies;
    json stages = json::object();
    for (const StageFigures& s : f.stage)
        stages[s.name] = {{"p50_ms", quantile(s.ms, 0.5)}, {"p99_ms", quantile(s.ms, 0.99)}, {"max_ms", quantile(s.ms, 1)}};
    j["stages"] = stages;
    if (std::isfinite(f.report.min_volume_ratio)) j["solid"] = {{"min_volume_ratio", f.report.min_volume_ratio}};
    double max_depth = 0;
    std::vector<double> frame_ms;
    for (const PassFigures& p : f.pass) {
        max_depth = std::max(max_depth, p.depth);
        frame_ms.push_back(p.frame_ms);
    }
    std::vector<double> deep_total, deep_inside;
    for (size_t i = 0; i < c.total.size(); ++i) {
        if (c.depth_mm[i] >= 5 && c.inside[i] >= 200) deep_total.push_back(c.total[i]), deep_inside.push_back(c.inside[i]);
    }
    j["contact"] = {{"events", c.total.size()},
                    {"max_depth_m", max_depth},
                    {"left_m", overlap_left(f)},
                    {"max_inside_vertices", quantile(c.inside, 1)},
                    {"total_ms_mean", mean(c.total)},
                    {"total_ms_p99", quantile(c.total, 0.99)},
                    {"response_ms_mean", mean(c.response)},
                    {"deep_events", deep_total.size()},
                    {"deep_total_ms_mean", mean(deep_total)},
                    {"deep_total_ms_p99", quantile(deep_total, 0.99)}};
    j["contact"]["search"] = {{"built_by", std::string("embree ") + closest_point_library()},
                              {"builds", f.tree_builds},
                              {"walk", f.search == TreeSearch::kEmbree ? "embree" : "own"},
                              {"queries", f.report.queries}};
    j["frame"] = percentiles(frame_ms, "ms");
    j["displayed_frame"] = percentiles(displayed_frames(f.pass), "ms");
    j["scale"] = scale_json(f);
    if (!f.pair.empty()) j["pairs"] = pairs_json(f);
    j["render"] = percentiles(f.render_ms, "ms");
    j["haptics"] = {{"ticks", f.ticks},
                    {"max_force_n", f.max_force},
                    {"max_force_wanted_n", f.max_force_wanted},
                    {"tick", percentiles(f.tick_us, "us")}};
    if (f.live) {
        j["haptics"]["period"] = percentiles(f.tick_period_us, "us");
        j["haptics"]["contact_age"] = percentiles(f.contact_age_ms, "ms");
        j["haptics"]["missed_ticks"] = f.missed_ticks;
        j["haptics"]["periods_above_2_ms"] = f.doubled_periods;
        j["haptics"]["relieved_ticks"] = f.relieved_ticks;
        j["haptics"]["scheduling"] = f.scheduling;
    }
    for (const ToolFigures& tool : f.tool) j["haptics"]["tools"].push_back(tool_json(tool));
    for (size_t row = 0; row < f.drive.size(); ++row) j["nodes"].push_back(drive_json(f, row));
    if (f.stopped_by != 0) j["stopped_by"] = name_of_signal(f.stopped_by);
    if (f.capture_asked) j["captures"] = f.captures, j["capture_s"] = f.capture_s;
    j["recorded"] = f.recorded;  // to live.recording in this folder
    if (f.replay) j["replay"] = {{"same", f.replay_difference.empty()}, {"difference", f.replay_difference}};
    j["energy"] = energy_json(f);
    for (const LinkFigures& l : f.link)
        j["links"].push_back(
            {{"name", l.name}, {"made", l.made}, {"broken", l.broken}, {"max_force_n", l.force}, {"max_strain", l.strain}});
    if (f.actions.any) j["actions"] = actions_json(f.actions);
    if (f.fluid.any) j["fluid"] = fluid_json(f.fluid);
    if (f.any_lens) j["lens"] = {{"film_m", f.lens_film}, {"temperature_c", f.lens_temperature}, {"wipes", f.lens_wipes}};
    j["report"] = report_json(f);
    return j.dump(2) + "\n";
}

std::string passes_csv(const RunFigures& f) {
    std::string out = "time_s,detection_ms,response_ms,frame_ms,render_ms,depth_m,inside_vertices,contacts,pairs,force_n,contact_force_n,";
    each_field(Energy{}, [&](const FieldName& field, double) { out += key_of(field.name, field.unit) + ","; });
    out += "residual_m,awake";
    for (const DriveFigures& d : f.drive)
        out += "," + csv_field((d.behaviour == NodeBehaviour::kDial ? "angle_rad_" : "place_m_") + d.body);
    out += "\n";
    for (const PassFigures& p : f.pass) {
        out += format("%.3f,%.4f,%.4f,%.4f,%.4f,%.9g,%u,%u,%u,%.6g,%.6g,", p.time, p.detection_ms, p.response_ms, p.frame_ms, p.render_ms,
                      p.depth, p.inside_vertices, p.contacts, p.pairs, p.force, p.contact_force);
        each_field(p.energy, [&](const FieldName&, double value) { out += format("%.9g,", value); });
        out += format("%.9g,%u", p.residual, p.awake);
        for (const double coordinate : p.coordinate) out += format(",%.9g", coordinate);
        out += "\n";
    }
    return out;
}

double overlap_left(const RunFigures& f) {
    double left = 0;
    for (size_t k = f.pass.size() - std::min(f.pass.size(), std::max<size_t>(1, f.pass.size() / 10)); k < f.pass.size(); ++k)
        left = std::max(left, f.pass[k].depth);
    return left;
}

std::string stages_csv(const RunFigures& f) {
    std::string out = "time_s";
    for (const StageFigures& s : f.stage) out += "," + csv_field(s.name + "_ms");
    out += "\n";
    for (size_t i = 0; i < std::min(f.pass.size(), f.pass_stage_ms.size()); ++i) {
        out += format("%.3f", f.pass[i].time);
        for (const float ms : f.pass_stage_ms[i]) out += format(",%.5g", static_cast<double>(ms));
        out += "\n";
    }
    return out;
}

}  // namespace trocar
