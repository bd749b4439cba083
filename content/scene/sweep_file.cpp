#include "content/scene/sweep_file.hpp"

#include <algorithm>
#include <sstream>

#include "content/scene/toml_section.hpp"
#include "engine/base/error.hpp"
namespace trocar {
namespace {

constexpr size_t kMostRuns = 1'000'000;

[[noreturn]] void refuse(const std::string& file, const toml::source_region& at, const std::string& reason) {
    throw InputError(location(file, at) + reason);
}

// Rejects text that cannot be put into one line of a command list or job script.
std::string one_line(const std::string& file, const toml::source_region& at, const std::string& text) {
    if (std::any_of(text.begin(), text.end(), [](unsigned char c) { return c < ' ' || c == 127; }))
        refuse(file, at, "line ends and other control characters do not go into commands");
    return text;
}

// A value as --set takes it: bare words, lists and numbers in TOML syntax.
std::string value_text(const std::string& file, const toml::node& node) {
    if (const auto text = node.value<std::string>(); node.is_string()) return one_line(file, node.source(), *text);
    std::ostringstream out;
    out.precision(17);
    if (const auto number = node.value<double>(); node.is_floating_point())
        out << *number;
    else
        node.visit([&](const auto& v) { out << v; });
    return one_line(file, node.source(), out.str());
}

std::vector<SweepAxis> read_axes(const std::string& file, const toml::table& vary) {
    std::vector<SweepAxis> axes;
    size_t runs = 1;
    for (const auto& [key, values] : vary) {
        SweepAxis axis{one_line(file, key.source(), std::string(key.str())), {}};
        const toml::array* list = values.as_array();
        if (!list || list->empty())
            refuse(file, values.source(), "vary \"" + axis.key + "\" needs a list of values; a key with dots stands in quotes");
        for (const toml::node& value : *list) {
            axis.values.push_back(value_text(file, value));
            if (std::count(axis.values.begin(), axis.values.end(), axis.values.back()) > 1)
                refuse(file, value.source(), axis.key + " has this value twice; runs are known by their values");
        }
        runs *= axis.values.size();
        if (runs > kMostRuns) refuse(file, values.source(), "more than a million runs");
        axes.push_back(std::move(axis));
    }
    return axes;
}

std::vector<Override> read_fixed(const std::string& file, const toml::table& set) {
    std::vector<Override> fixed;
    for (const auto& [name, value] : set) {
        if (value.is_table()) refuse(file, value.source(), "a key of [set] with dots stands in quotes: \"contact.tolerance\"");
        fixed.push_back({one_line(file, name.source(), std::string(name.str())), value_text(file, value)});
    }
    return fixed;
}

}  // namespace

SweepFile read_sweep_file(const std::filesystem::path& path) {
    const std::string file = path.string();
    const toml::table root = read_toml(path, "sweep");
    SweepFile sweep;
    sweep.path = path;
    sweep.name = path.stem().string();
    TomlSection top(file, root);
    top.read("name", sweep.name);
    top.read("scene", sweep.scene);
    top.read("columns", sweep.columns);
    for (const auto& [key, node] : root)
        if (node.is_string()) one_line(file, node.source(), *node.value<std::string>());
    top.read("seconds", sweep.seconds, 1e-9, 1e6);
    top.read_count("threads", sweep.threads, 1, 1e6);
    top.read_count("repeat", sweep.repeat, 1, 1e6);
    if (const toml::table* set = top.table("set")) sweep.fixed = read_fixed(file, *set);
    if (const toml::table* vary = top.table("vary")) sweep.axes = read_axes(file, *vary);
    top.refuse_unknown();
    bool scene_varies = false;
    for (const SweepAxis& axis : sweep.axes) scene_varies = scene_varies || axis.key == "scene";
    if (sweep.scene.empty() && !scene_varies) throw InputError(file + ": a sweep needs a scene");
    if (sweep.axes.empty()) throw InputError(file + ": nothing varies: [vary] with a list of values a key");
    size_t runs = sweep.repeat;
    for (const SweepAxis& axis : sweep.axes) {
        runs *= axis.values.size();
        if (sweep.repeat > 1 && axis.key == "repeat")
            throw InputError(file + ": with repeat = " + std::to_string(sweep.repeat) + " no key that varies can be named repeat");
    }
    if (runs > kMostRuns) throw InputError(file + ": more than a million runs");
    if (sweep.columns.empty())
        sweep.columns = {"state_hash",
                         "wall_s",
                         "displayed_frame.p99_ms",
                         "contact.total_ms_mean",
                         "contact.max_depth_m",
                         "scale.residual_max_m",
                         "energy.worst_balance_of_peak",
                         "report.nonfinite_particles"};
    return sweep;
}

std::vector<std::vector<std::string>> combinations(const SweepFile& sweep) {
    std::vector<std::vector<std::string>> all{{}};
    for (const SweepAxis& axis : sweep.axes) {
        std::vector<std::vector<std::string>> longer;
        for (const auto& start : all) {
            for (const std::string& value : axis.values) {
                longer.push_back(start);
                longer.back().push_back(value);
            }
        }
        all.swap(longer);
    }
    return all;
}

}  // namespace trocar
