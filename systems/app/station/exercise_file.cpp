#include "systems/app/station/exercise_file.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <nlohmann/json.hpp>

#include "engine/base/error.hpp"
#include "engine/files/text_file.hpp"
#include "systems/app/console/format.hpp"
namespace trocar {
namespace fs = std::filesystem;
namespace {

constexpr int kFormat = 1;

struct ColumnText {
    const char *name, *text;
};
constexpr ColumnText kColumns[] = {
    {"time_s", "end of the contact pass, simulated"},
    {"tool", "body that the hand holds"},
    {"x_m", "tip as the hand holds it, world"},
    {"y_m", ""},
    {"z_m", ""},
    {"qw", "orientation of the device, world, unit quaternion"},
    {"qx", ""},
    {"qy", ""},
    {"qz", ""},
    {"proxy_x_m", "tip kept outside of surfaces, world"},
    {"proxy_y_m", ""},
    {"proxy_z_m", ""},
    {"grip_rad", "between the jaws"},
    {"buttons", "one bit each"},
    {"hand_x_n", "force on the hand at the end of the pass, within limits, axes of the device"},
    {"hand_y_n", ""},
    {"hand_z_n", ""},
    {"hand_peak_n", "largest force on the hand in the ticks (1 ms) of the pass"},
    {"torque_x_nm", "torque on the hand"},
    {"torque_y_nm", ""},
    {"torque_z_nm", ""},
    {"tissue_x_n", "force of tissue on the simulated tool, contacts and links, mean over the pass, world"},
    {"tissue_y_n", ""},
    {"tissue_z_n", ""},
    {"contacts", "surface constraints on the tip"},
};
constexpr const char* kOrganColumn = "organ_";  // NAME and "_n" follow

std::string number_text(double value) {
    char text[32];
    const std::to_chars_result end = std::to_chars(text, text + sizeof text, value, std::chars_format::general, 9);
    return {text, end.ptr};
}

// Splits one line of RFC 4180; a quoted field with a doubled quote is not supported, names of bodies have none.
void split_line(std::string_view line, std::vector<std::string_view>& out) {
    out.clear();
    if (line.ends_with('\r')) line.remove_suffix(1);
    for (size_t at = 0; at <= line.size();) {
        if (at < line.size() && line[at] == '"') {
            const size_t end = std::min(line.find('"', at + 1), line.size());
            out.push_back(line.substr(at + 1, end - at - 1));
            at = std::min(line.find(',', end), line.size()) + 1;
        } else {
            const size_t end = std::min(line.find(',', at), line.size());
            out.push_back(line.substr(at, end - at));
            at = end + 1;
        }
    }
}

uint32_t index_of(std::vector<std::string>& names, std::string_view name) {
    const size_t index = static_cast<size_t>(std::ranges::find(names, name) - names.begin());
    if (index == names.size()) names.emplace_back(name);
    return static_cast<uint32_t>(index);
}

Vec3d vector_at(const CsvTable& t, size_t row, size_t first) {
    return {t.number(row, first), t.number(row, first + 1), t.number(row, first + 2)};
}

size_t wanted_column(const CsvTable& t, const char* name) {
    const size_t column = t.find(name);
    if (column == t.column.size()) throw InputError(t.file + ":1: column " + name + " is missing");
    return column;
}

void check_order(const CsvTable& t, const Exercise& e) {
    std::vector<double> last(e.tool.size(), -INFINITY);
    for (size_t i = 0; i < e.sample.size(); ++i) {
        double& before = last[e.sample[i].tool];
        if (!(e.sample[i].time > before)) throw InputError(t.file + ":" + std::to_string(i + 2) + ": times of a tool must ascend");
        before = e.sample[i].time;
    }
}

double rate_of(const Exercise& e) {
    if (e.sample.size() < 2 * e.tool.size() || e.tool.empty()) return 0;
    const double span = e.sample.back().time - e.sample.front().time;
    return span > 0 ? std::round((static_cast<double>(e.sample.size()) / static_cast<double>(e.tool.size()) - 1) / span) : 0;
}

void read_events(const fs::path& file, Exercise& e) {
    const std::string text = read_text_file(file);
    try {
        const auto json = nlohmann::json::parse(text);
        if (json.at("format").get<int>() > kFormat)
            throw InputError(file.string() + ": exercise of format " + std::to_string(json["format"].get<int>()) +
                             "; this program reads up to " + std::to_string(kFormat));
        e.scene = json.value("scene", ""), e.version = json.value("version", ""), e.state_hash = json.value("state_hash", "");
        e.live = json.value("live", false), e.rate = json.value("rate_hz", 0.0), e.lost_events = json.value("lost_events", uint64_t{0});
        for (const auto& event : json.at("events")) {
            ExerciseEvent out{event.at("time_s").get<double>(), event.at("event").get<std::string>(), event.value("object", "")};
            if (event.contains("tool")) out.tool = index_of(e.tool, event["tool"].get<std::string>());
            e.event.push_back(out);
        }
    } catch (const nlohmann::json::exception& error) {
        throw InputError(file.string() + ": " + one_line(error.what()));
    }
}

}  // namespace

size_t CsvTable::find(std::string_view name) const { return static_cast<size_t>(std::ranges::find(column, name) - column.begin()); }

double CsvTable::number(size_t r, size_t c) const {
    const std::string_view text = row[r][c];
    double value = 0;
    const std::from_chars_result end = std::from_chars(text.data(), text.data() + text.size(), value);
    if (end.ec != std::errc() || end.ptr != text.data() + text.size() || !std::isfinite(value))
        throw InputError(file + ":" + std::to_string(r + 2) + ": \"" + one_line(text) + "\" in column " + column[c] + " is no number");
    return value;
}

CsvTable read_csv(const fs::path& file) {
    CsvTable t;
    t.file = file.string(), t.text = read_text_file(file);
    std::vector<std::string_view> fields;
    size_t line = 0;
    for (size_t at = 0; at < t.text.size(); ++line) {
        const size_t end = std::min(t.text.find('\n', at), t.text.size());
        split_line(std::string_view(t.text).substr(at, end - at), fields);
        at = end + 1;
        if (line == 0)
            t.column.assign(fields.begin(), fields.end());
        else if (fields.size() == t.column.size())
            t.row.push_back(fields);
        else
            throw InputError(t.file + ":" + std::to_string(line + 1) + ": " + std::to_string(fields.size()) + " fields, not " +
                             std::to_string(t.column.size()));
    }
    if (line == 0) throw InputError(t.file + ": is empty");
    return t;
}

void add_touches(Exercise& e) {
    std::vector<bool> before(e.tool.size(), false);
    for (const ExerciseSample& s : e.sample) {
        const bool now = s.contacts > 0;
        if (now != before[s.tool]) e.event.push_back({s.time, now ? "touch" : "release", "", s.tool});
        before[s.tool] = now;
    }
}

void read_scene_name(const fs::path& folder, Exercise& e) {
    std::error_code error;
    if (!fs::exists(folder / "metrics.json", error)) return;
    const auto json = nlohmann::json::parse(read_text_file(folder / "metrics.json"), nullptr, false);
    if (!json.is_object()) return;
    e.scene = json.value("scene", ""), e.version = json.value("version", ""), e.state_hash = json.value("state_hash", "");
}

Exercise read_exercise_csv(const fs::path& file) {
    const CsvTable t = read_csv(file);
    Exercise e;
    e.source = file.string();
    const size_t time = wanted_column(t, "time_s"), tool = wanted_column(t, "tool"), x = wanted_column(t, "x_m");
    const size_t turn = wanted_column(t, "qw"), proxy = wanted_column(t, "proxy_x_m"), grip = wanted_column(t, "grip_rad");
    const size_t buttons = wanted_column(t, "buttons"), hand = wanted_column(t, "hand_x_n"), peak = wanted_column(t, "hand_peak_n");
    const size_t torque = wanted_column(t, "torque_x_nm"), tissue = wanted_column(t, "tissue_x_n"), contacts = wanted_column(t, "contacts");
    std::vector<size_t> organ;
    for (size_t c = 0; c < t.column.size(); ++c) {
        const std::string& name = t.column[c];
        if (!name.starts_with(kOrganColumn) || !name.ends_with("_n")) continue;
        organ.push_back(c), e.organ.push_back(name.substr(6, name.size() - 8));
    }
    for (size_t r = 0; r < t.row.size(); ++r) {
        ExerciseSample s;
        s.time = t.number(r, time), s.tool = index_of(e.tool, t.row[r][tool]);
        s.tip = vector_at(t, r, x), s.proxy = vector_at(t, r, proxy), s.hand = vector_at(t, r, hand);
        s.turn = {t.number(r, turn), t.number(r, turn + 1), t.number(r, turn + 2), t.number(r, turn + 3)};
        s.torque = vector_at(t, r, torque), s.tissue = vector_at(t, r, tissue);
        s.grip = t.number(r, grip), s.hand_peak = t.number(r, peak);
        s.buttons = static_cast<uint32_t>(std::clamp(t.number(r, buttons), 0.0, 4294967295.0));
        s.contacts = static_cast<uint32_t>(std::clamp(t.number(r, contacts), 0.0, 4294967295.0));
        s.organs.first = static_cast<uint32_t>(e.organ_force.size());
        for (uint32_t o = 0; o < organ.size(); ++o)
            if (!t.row[r][organ[o]].empty()) e.organ_force.push_back({o, t.number(r, organ[o])});
        s.organs.count = static_cast<uint32_t>(e.organ_force.size()) - s.organs.first;
        e.sample.push_back(s);
    }
    check_order(t, e);
    std::error_code error;
    const fs::path json = fs::path(file).replace_extension(".json");
    if (fs::exists(json, error))
        read_events(json, e);
    else
        add_touches(e);
    if (e.rate == 0) e.rate = rate_of(e);
    return e;
}

Exercise read_tools_csv(const fs::path& file) {
    const CsvTable t = read_csv(file);
    Exercise e;
    e.source = file.string(), e.has_turn = e.has_organs = false;
    const size_t time = wanted_column(t, "time_s"), tool = wanted_column(t, "tool"), device = wanted_column(t, "device_x_m");
    const size_t proxy = wanted_column(t, "proxy_x_m"), force = wanted_column(t, "force_x_n"), tissue = wanted_column(t, "tissue_x_n");
    const size_t contacts = wanted_column(t, "contacts"), grip = t.find("grip_rad");
    for (size_t r = 0; r < t.row.size(); ++r) {
        ExerciseSample s;
        s.time = t.number(r, time), s.tool = index_of(e.tool, t.row[r][tool]);
        s.tip = vector_at(t, r, device), s.proxy = vector_at(t, r, proxy), s.hand = vector_at(t, r, force),
        s.tissue = vector_at(t, r, tissue);
        s.hand_peak = s.hand.norm();
        s.contacts = static_cast<uint32_t>(std::clamp(t.number(r, contacts), 0.0, 4294967295.0));
        if (grip < t.column.size()) s.grip = t.number(r, grip);
        e.sample.push_back(s);
    }
    check_order(t, e);
    add_touches(e);
    e.rate = rate_of(e);
    return e;
}

std::string exercise_json(const Exercise& e) {
    using json = nlohmann::ordered_json;
    json j = {{"format", kFormat}, {"scene", e.scene},           {"version", e.version}, {"state_hash", e.state_hash}, {"live", e.live},
              {"rate_hz", e.rate}, {"samples", e.sample.size()}, {"tools", e.tool},      {"organs", e.organ}};
    json& columns = j["columns"] = json::object();
    std::string text;
    for (const ColumnText& c : kColumns) columns[c.name] = text = *c.text ? c.text : text;
    for (const std::string& organ : e.organ)
        columns[kOrganColumn + organ + "_n"] =
            "of the tool on " + organ + ", mean over the pass: the larger of the net force and of that of its strongest part";
    j["lost_events"] = e.lost_events;
    json& events = j["events"] = json::array();
    for (const ExerciseEvent& event : e.event) {
        json row = {{"time_s", event.time}, {"event", event.kind}};
        if (event.tool != kNone) row["tool"] = e.tool[event.tool];
        if (!event.object.empty()) row["object"] = event.object;
        events.push_back(row);
    }
    json& phases = j["phases"] = json::array();
    for (const ExercisePhase& p : phases_of(e)) phases.push_back({{"name", p.name}, {"from_s", p.from}, {"to_s", p.to}});
    return j.dump(1) + "\n";
}

std::string exercise_csv(const Exercise& e) {
    std::string out;
    for (const ColumnText& c : kColumns) out += std::string(out.empty() ? "" : ",") + c.name;
    for (const std::string& organ : e.organ) out += "," + csv_field(kOrganColumn + organ + "_n");
    out += "\n";
    const auto put = [&](const auto&... values) { ((out += ',', out += number_text(values)), ...); };
    std::vector<double> organ(e.organ.size());
    for (const ExerciseSample& s : e.sample) {
        out += format("%.3f,", s.time) + csv_field(e.tool[s.tool]);
        put(s.tip.x(), s.tip.y(), s.tip.z(), s.turn.w, s.turn.x, s.turn.y, s.turn.z, s.proxy.x(), s.proxy.y(), s.proxy.z(), s.grip);
        out += format(",%u", s.buttons);
        put(s.hand.x(), s.hand.y(), s.hand.z(), s.hand_peak, s.torque.x(), s.torque.y(), s.torque.z(), s.tissue.x(), s.tissue.y(),
            s.tissue.z());
        out += format(",%u", s.contacts);
        organ.assign(e.organ.size(), 0);
        for (uint32_t k = s.organs.first; k < s.organs.end(); ++k) organ[e.organ_force[k].organ] = e.organ_force[k].force;
        for (const double force : organ) out += ',', out += force > 0 ? number_text(force) : "";
        out += "\n";
    }
    return out;
}

}  // namespace trocar
