#include "content/scene_file.hpp"

#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <numbers>
#include <sstream>
#include <unordered_set>

#include "content/tissues.hpp"
#include "engine/error.hpp"
#include "engine/geometry/quaternion.hpp"
namespace trocar {
namespace {

std::string place(const std::string& file, const toml::source_region& source) {
    if (source.begin.line == 0) return file + ": ";  // came from the command line
    return file + ":" + std::to_string(source.begin.line) + ":" + std::to_string(source.begin.column) + ": ";
}

// Levenshtein distance, for suggestions.
size_t edit_distance(std::string_view a, std::string_view b) {
    std::vector<size_t> row(b.size() + 1);
    for (size_t j = 0; j <= b.size(); ++j) row[j] = j;
    for (size_t i = 1; i <= a.size(); ++i) {
        size_t diagonal = row[0];
        row[0] = i;
        for (size_t j = 1; j <= b.size(); ++j) {
            const size_t above = row[j];
            row[j] = std::min({row[j] + 1, row[j - 1] + 1, diagonal + (a[i - 1] == b[j - 1] ? 0u : 1u)});
            diagonal = above;
        }
    }
    return row[b.size()];
}

std::string nearest(std::string_view word, const std::vector<std::string>& known) {
    std::string best;
    size_t best_distance = std::max<size_t>(2, word.size() / 2) + 1;
    for (const std::string& k : known) {
        const size_t d = edit_distance(word, k);
        if (d < best_distance) best = k, best_distance = d;
    }
    return best;
}

// One table being read: remembers which keys were asked for, so that the rest can be refused.
class Section {
 public:
    Section(const std::string& file, const toml::table& table, std::string name)
        : file_(file), table_(table), name_(std::move(name)) {}

    [[noreturn]] void fail(const toml::node& node, const std::string& reason) const {
        throw InputError(place(file_, node.source()) + reason);
    }
    [[noreturn]] void fail(const std::string& reason) const { fail(table_, reason); }

    const toml::node* find(std::string_view key) {
        known_.emplace_back(key);
        return table_.get(key);
    }
    void read(std::string_view key, double& value, double lowest = -1e300, double highest = 1e300) {
        if (const toml::node* node = find(key)) value = number(*node, key, lowest, highest);
    }
    template <typename Int>
    void read_count(std::string_view key, Int& value, double lowest, double highest) {
        double d = static_cast<double>(value);
        if (const toml::node* node = find(key)) {
            d = number(*node, key, lowest, highest);
            if (d != std::floor(d)) fail(*node, std::string(key) + " must be a whole number");
            value = static_cast<Int>(d);
        }
    }
    void read(std::string_view key, std::string& value) {
        if (const toml::node* node = find(key)) {
            const auto text = node->value<std::string>();
            if (!node->is_string() || !text) fail(*node, std::string(key) + " must be a string");
            value = *text;
        }
    }
    void read(std::string_view key, bool& value) {
        if (const toml::node* node = find(key)) {
            if (!node->is_boolean()) fail(*node, std::string(key) + " must be true or false");
            value = *node->value<bool>();
        }
    }
    void read(std::string_view key, Vec3d& value) {
        if (const toml::node* node = find(key)) {
            const std::vector<double> v = numbers(*node, key, 3);
            value = Vec3d(v[0], v[1], v[2]);
        }
    }
    void read_counts(std::string_view key, std::array<uint32_t, 2>& value, double lowest, double highest) {
        if (const toml::node* node = find(key)) {
            const std::vector<double> v = numbers(*node, key, 2);
            for (size_t i = 0; i < 2; ++i) {
                if (v[i] < lowest || v[i] > highest || v[i] != std::floor(v[i])) fail(*node, std::string(key) + " must be two whole numbers");
                value[i] = static_cast<uint32_t>(v[i]);
            }
        }
    }
    // rotation = [axis x, y, z, degrees]
    void read(std::string_view key, Quat& value) {
        if (const toml::node* node = find(key)) {
            const std::vector<double> v = numbers(*node, key, 4);
            const Vec3d axis(v[0], v[1], v[2]);
            if (v[3] != 0 && axis.norm() == 0) fail(*node, std::string(key) + ": the axis has no length");
            value = v[3] == 0 ? Quat{} : from_rotation_vector(axis.normalized() * (v[3] * std::numbers::pi / 180));
        }
    }
    template <typename Enum>
    void read_enum(std::string_view key, Enum& value, const std::vector<std::pair<std::string, Enum>>& names) {
        std::string text;
        read(key, text);
        if (text.empty()) return;
        std::vector<std::string> words;
        for (const auto& [word, e] : names) {
            if (word == text) {
                value = e;
                return;
            }
            words.push_back(word);
        }
        std::string list;
        for (const std::string& w : words) list += (list.empty() ? "" : ", ") + w;
        fail(*table_.get(key), std::string(key) + " \"" + text + "\" is none of " + list);
    }
    // [numbers], as many as `count`; false when the key is not there
    bool read(std::string_view key, size_t count, std::vector<double>& values) {
        const toml::node* node = find(key);
        if (node) values = numbers(*node, key, count);
        return node != nullptr;
    }
    const toml::array* tables(std::string_view key) {
        const toml::node* node = find(key);
        if (!node) return nullptr;
        const toml::array* array = node->as_array();
        if (!array || !array->is_array_of_tables())
            fail(*node, "write [[" + std::string(key) + "]] for each " + std::string(key));
        return array;
    }
    const toml::table* table(std::string_view key) {
        const toml::node* node = find(key);
        if (!node) return nullptr;
        if (!node->is_table()) fail(*node, std::string(key) + " must be a table");
        return node->as_table();
    }
    void refuse_unknown() const {
        for (const auto& [key, node] : table_) {
            const std::string word(key.str());
            if (std::find(known_.begin(), known_.end(), word) != known_.end()) continue;
            const std::string guess = nearest(word, known_);
            throw InputError(place(file_, key.source()) + "unknown key \"" + word + "\"" +
                             (name_.empty() ? "" : " in " + name_) +
                             (guess.empty() ? "" : "; did you mean \"" + guess + "\"?"));
        }
    }
    uint32_t line() const { return table_.source().begin.line; }

 private:
    double number(const toml::node& node, std::string_view key, double lowest, double highest) const {
        if (!node.is_number()) fail(node, std::string(key) + " must be a number");
        const double d = *node.value<double>();
        if (!std::isfinite(d) || d < lowest || d > highest) {
            std::ostringstream text;
            text << key << " = " << d << " is outside " << lowest << " to " << highest;
            fail(node, text.str());
        }
        return d;
    }
    std::vector<double> numbers(const toml::node& node, std::string_view key, size_t count) const {
        const toml::array* array = node.as_array();
        if (!array || array->size() != count)
            fail(node, std::string(key) + " must be a list of " + std::to_string(count) + " numbers");
        std::vector<double> v;
        for (const toml::node& element : *array) v.push_back(number(element, key, -1e300, 1e300));
        return v;
    }

    const std::string& file_;
    const toml::table& table_;
    std::string name_;
    std::vector<std::string> known_;
};

std::vector<KeyframeSpec> read_path(const std::string& file, Section& owner, std::string_view key) {
    std::vector<KeyframeSpec> path;
    const toml::array* array = owner.tables(key);
    if (!array) return path;
    for (const toml::node& node : *array) {
        Section section(file, *node.as_table(), std::string(key));
        KeyframeSpec frame;
        if (!path.empty()) frame.position = path.back().position, frame.orientation = path.back().orientation;
        section.read("time", frame.time, 0, 1e9);
        section.read("position", frame.position);
        section.read("rotation", frame.orientation);
        section.read("jump", frame.jump);
        section.refuse_unknown();
        if (!path.empty() && frame.time <= path.back().time)
            section.fail("time must be later than that of the key before");
        path.push_back(frame);
    }
    return path;
}

// A preset by name, which the keys of the table override.
void choose_preset(Section& section, std::string_view key, Tissue& t) {
    std::string name;
    section.read(key, name);
    if (name.empty()) return;
    const TissuePreset* preset = find_tissue(name);
    if (!preset) section.fail(*section.find(key), "no tissue \"" + name + "\"; there are " + tissue_names());
    t = preset->tissue;
}

void read_tissue(Section& section, Tissue& t) {
    choose_preset(section, "preset", t);
    section.read("youngs_modulus", t.youngs_modulus, 1, 1e12);
    section.read("density", t.density, 1e-3, 1e6);
    section.read("wall", t.wall, 1e-9, 1e3);
    section.read("depth", t.depth, 1e-9, 1e9);
    section.read("poisson", t.poisson, 0, 0.5);
    section.read("damping", t.damping, 0, 1e6);
    section.read("friction", t.friction, 0, 1e6);
    section.read("pressure_modulus", t.pressure_modulus, 0, 1e12);
    section.read("bending", t.bending, 0, 1e12);
    section.read("restitution", t.restitution, 0, 1);
    section.refuse_unknown();
}

ScatterSpec read_scatter(Section section) {
    ScatterSpec scatter;
    section.read_count("count", scatter.count, 1, 1e6);
    if (scatter.count == 0) section.fail("[body.scatter] needs a count");
    section.read_count("seed", scatter.seed, 0, 9e15);
    section.read_counts("columns", scatter.columns, 0, 1e4);
    section.read("spacing", scatter.spacing);
    section.read("jitter", scatter.jitter, 0, 10);
    section.read("turned", scatter.turned);
    section.read("rate", scatter.rate, 0, 1e6);
    section.read("life", scatter.life, 1e-3, 1e9);
    section.refuse_unknown();
    return scatter;
}

// One of sphere = [x, y, z, radius], box = [lowest x, y, z, highest x, y, z], capsule = [from x, y, z, to x, y, z, radius];
// false when there is none.
bool read_region(Section& section, Region& region) {
    std::vector<double> v;
    int given = 0;
    if (section.read("sphere", 4, v)) region = {RegionKind::kSphere, {v[0], v[1], v[2]}, {v[0], v[1], v[2]}, v[3]}, ++given;
    if (section.read("box", 6, v)) region = {RegionKind::kBox, {v[0], v[1], v[2]}, {v[3], v[4], v[5]}, 0}, ++given;
    if (section.read("capsule", 7, v)) region = {RegionKind::kCapsule, {v[0], v[1], v[2]}, {v[3], v[4], v[5]}, v[6]}, ++given;
    if (given > 1) section.fail("give one of sphere, box and capsule");
    if (region.kind == RegionKind::kBox && (region.a.array() > region.b.array()).any()) section.fail("box: its first corner must be the lowest");
    if (region.radius < 0) section.fail("a radius must not be negative");
    return given > 0;
}

GroupSpec read_group(const std::string& file, const toml::table& table) {
    Section section(file, table, "[[body.group]]");
    GroupSpec group;
    group.line = section.line();
    section.read("name", group.name);
    section.read("material", group.material);
    const bool region = read_region(section, group.region);
    section.refuse_unknown();
    if (group.name.empty()) section.fail("a [[body.group]] needs a name");
    if (!region && group.material.empty()) section.fail("group \"" + group.name + "\" needs a sphere, box, capsule or material");
    return group;
}

TissueRegionSpec read_tissue_region(const std::string& file, const toml::table& table) {
    Section section(file, table, "[[body.region]]");
    TissueRegionSpec spec;
    spec.line = section.line();
    section.read("group", spec.group);
    section.read("field", spec.field);
    section.read("property", spec.property);
    const int given = (read_region(section, spec.region) ? 1 : 0) + (spec.group.empty() ? 0 : 1) + (spec.field.empty() ? 0 : 1);
    section.read("stiffness", spec.stiffness, 1e-6, 1e6);
    section.read("density", spec.density, 1e-6, 1e6);
    section.read("fixed", spec.fixed);
    section.refuse_unknown();
    if (given != 1) section.fail("a [[body.region]] needs one of sphere, box, capsule, group and field");
    return spec;
}

LinkSpec read_link(const std::string& file, const toml::table& table) {
    Section section(file, table, "[[link]]");
    LinkSpec link;
    link.line = section.line();
    section.read("name", link.name);
    section.read("body", link.body);
    section.read("to", link.holder);
    section.read("group", link.group);
    const bool region = read_region(section, link.region);
    link.frame_given = section.find("frame") != nullptr;
    section.read_enum<RegionFrame>("frame", link.frame, {{"to", RegionFrame::kHolder}, {"rest", RegionFrame::kRest}, {"world", RegionFrame::kWorld}});
    section.read("within", link.within, 0, 1e3);
    section.read("stiffness", link.stiffness, 1e-9, 1e12);
    section.read("rest", link.rest, 0, 1e3);
    section.read("break_strain", link.break_strain, 1e-9, 1e12);
    section.read("from", link.from, 0, 1e9);
    section.read("until", link.until, 0, 1e9);
    section.read("grip", link.grip);
    section.refuse_unknown();
    if (link.body.empty() || link.holder.empty()) section.fail("a [[link]] needs a body and what it is linked to");
    if (link.name.empty()) link.name = link.body + " to " + link.holder;
    if (region && !link.group.empty()) section.fail("link \"" + link.name + "\": give a group or a region, not both");
    if (!region && link.group.empty() && !std::isfinite(link.within))
        section.fail("link \"" + link.name + "\": which nodes? Give a group, a sphere, a box, a capsule or within");
    if (!(link.until > link.from)) section.fail("link \"" + link.name + "\": until must be later than from");
    return link;
}

CutSpec read_cut(const std::string& file, const toml::table& table) {
    Section section(file, table, "[[cut]]");
    CutSpec cut;
    cut.line = section.line();
    section.read("name", cut.name);
    section.read("body", cut.body);
    section.read("group", cut.group);
    const bool region = read_region(section, cut.region);
    section.read("time", cut.time, 0, 1e9);
    section.refuse_unknown();
    if (cut.body.empty()) section.fail("a [[cut]] needs a body");
    if (region == !cut.group.empty()) section.fail("cut of \"" + cut.body + "\": give one of sphere, box, capsule and group");
    return cut;
}

LinkSpec read_staple(const std::string& file, const toml::table& table) {
    Section section(file, table, "[[staple]]");
    LinkSpec staple;
    staple.line = section.line();
    Vec3d place = Vec3d::Zero();
    double reach = 0.01;
    section.read("name", staple.name);
    section.read("body", staple.body);
    section.read("to", staple.holder);
    section.read("place", place);
    section.read("reach", reach, 1e-9, 1e3);
    section.read("stiffness", staple.stiffness, 1e-9, 1e12);
    section.read("rest", staple.rest, 0, 1e3);
    section.read("break_strain", staple.break_strain, 1e-9, 1e12);
    section.read("time", staple.from, 0, 1e9);
    section.read("until", staple.until, 0, 1e9);
    section.refuse_unknown();
    if (staple.body.empty() || staple.holder.empty()) section.fail("a [[staple]] needs a body and what it is stapled to");
    if (staple.name.empty()) staple.name = "staple of " + staple.body + " to " + staple.holder;
    if (!(staple.until > staple.from)) section.fail("staple \"" + staple.name + "\": until must be later than time");
    staple.region = {RegionKind::kSphere, place, place, reach};
    staple.frame = RegionFrame::kWorld;
    staple.frame_given = true;
    staple.most = 1;
    return staple;
}

BodySpec read_body(const std::string& file, const toml::table& table) {
    Section section(file, table, "[[body]]");
    BodySpec body;
    body.line = section.line();
    section.read("name", body.name);
    if (body.name.empty()) section.fail("a [[body]] needs a name");
    section.read("shape", body.shape);
    section.read("file", body.file);
    if (body.shape.empty() && body.file.empty()) section.fail("body \"" + body.name + "\" needs a shape or a file");
    section.read_count("triangles", body.triangles, 4, 2e7);
    section.read_count("seed", body.seed, 0, 9e15);
    if (const toml::node* node = section.find("scale")) {
        if (node->is_string()) {
            if (*node->value<std::string>() != "auto") section.fail(*node, "scale must be a number or \"auto\"");
            body.scale = 0;
        } else {
            section.read("scale", body.scale, 1e-12, 1e12);
        }
    }
    section.read("size", body.size, 1e-9, 1e9);
    section.read_enum<Motion>("motion", body.motion,
                              {{"static", Motion::kStatic},
                               {"kinematic", Motion::kKinematic},
                               {"hand", Motion::kHand},
                               {"deformable", Motion::kDeformable},
                               {"free", Motion::kFree}});
    if (body.motion == Motion::kFree) body.tissue.damping = 0;  // it falls like a stone unless told otherwise
    section.read("position", body.position);
    section.read("rotation", body.orientation);
    section.read("above", body.above);
    section.read("gap", body.gap, -1e3, 1e3);
    section.read_enum<AnchorFrame>("anchor", body.anchor_frame,
                                   {{"world", AnchorFrame::kWorld}, {"shape", AnchorFrame::kShape}});
    section.read_enum<bool>("model", body.solid, {{"shell", false}, {"solid", true}});
    section.read("cells", body.cells, 1, 500);
    section.read("spacing", body.spacing, 1e-9, 1e9);
    section.read("bed", body.bed);
    section.read("skin", body.skin);
    section.read("fixed_below", body.fixed_below);
    section.read("integrator", body.integrator);
    constexpr const char* kIntegrators[] = {"leapfrog", "midpoint", "xpbd", "auto"};
    if (std::find(std::begin(kIntegrators), std::end(kIntegrators), body.integrator) == std::end(kIntegrators))
        section.fail(*section.find("integrator"), "integrator \"" + body.integrator + "\" is none of leapfrog, midpoint, xpbd, auto");
    section.read_count("iterations", body.iterations, 1, 1e4);
    section.read("step", body.step, 1e-9, 1);
    section.read("wanted_error", body.wanted_error, 0, 1);
    section.read("thickness", body.thickness, 1e-9, 1e3);
    section.read("mass", body.mass, 1e-6, 1e6);
    section.read("velocity", body.velocity);
    section.read("spin", body.spin);
    if (const toml::node* node = section.find("color"); node) {
        Vec3d c;
        section.read("color", c);
        body.color = {static_cast<float>(c.x()), static_cast<float>(c.y()), static_cast<float>(c.z())};
    }
    if (const toml::node* node = section.find("tissue"); node && node->is_string()) {
        choose_preset(section, "tissue", body.tissue);
    } else if (const toml::table* tissue = section.table("tissue")) {
        Section inner(file, *tissue, "[body.tissue]");
        read_tissue(inner, body.tissue);
    }
    body.path = read_path(file, section, "path");
    section.read("break_strain", body.break_strain, 1e-9, 1e12);
    if (const toml::array* groups = section.tables("group"))
        for (const toml::node& node : *groups) body.groups.push_back(read_group(file, *node.as_table()));
    if (const toml::array* regions = section.tables("region"))
        for (const toml::node& node : *regions) body.regions.push_back(read_tissue_region(file, *node.as_table()));
    if (const toml::table* scatter = section.table("scatter")) body.scatter = read_scatter({file, *scatter, "[body.scatter]"});
    section.refuse_unknown();
    if (body.scatter.count > 0 && (body.motion == Motion::kHand || !body.above.empty()))
        section.fail("body \"" + body.name + "\": what is scattered can neither be held by a hand nor stand above another body");
    if (body.scatter.rate > 0 && (body.motion != Motion::kDeformable || std::isfinite(body.break_strain)))
        section.fail("body \"" + body.name + "\": only deformable bodies that do not break come and go (scatter.rate)");
    if (body.motion == Motion::kKinematic && body.path.empty())
        section.fail("kinematic body \"" + body.name + "\" needs a [[body.path]]");
    if (body.motion != Motion::kFree && (!body.velocity.isZero(0) || !body.spin.isZero(0)))
        section.fail("body \"" + body.name + "\": only a free body starts with a velocity or spin of its own");
    return body;
}

// A direction: any length but none.
void read_direction(Section& section, std::string_view key, Vec3d& direction) {
    section.read(key, direction);
    if (direction.norm() == 0) section.fail(*section.find(key), std::string(key) + " has no length");
    direction.normalize();
}

HandModel read_hand(Section section) {
    HandModel hand;
    section.read("mass", hand.mass, 1e-3, 1e3);
    section.read("damping", hand.damping, 0, 1e4);
    section.read("stiffness", hand.stiffness, 0, 1e6);
    section.read("arm_damping", hand.arm_damping, 0, 1e4);
    section.read("friction", hand.friction, 0, 1e3);
    section.read("encoder", hand.encoder, 0, 1e-2);
    section.read_count("delay", hand.delay, 0, kMostHandDelay);
    section.read("tremor", hand.tremor, 0, 0.1);
    section.read("tremor_rate", hand.tremor_rate, 0.01, 100);
    section.refuse_unknown();
    if (hand.mass == 0 && (hand.damping > 0 || hand.stiffness > 0 || hand.arm_damping > 0 || hand.friction > 0 || hand.encoder > 0 || hand.delay > 0))
        section.fail("[tool.hand] gives way to forces only with a mass");
    return hand;
}

Workspace read_workspace(Section section) {
    Workspace workspace;
    section.read("origin", workspace.origin);
    section.read("rotation", workspace.turn);
    section.read("scale", workspace.scale, 1e-3, 1e3);
    section.read_count("clutch", workspace.clutch, 0, 4294967295.0);
    section.refuse_unknown();
    return workspace;
}

Pivot read_pivot(Section section) {
    Pivot pivot;
    pivot.kind = PivotKind::kHandle;
    section.read("point", pivot.point);
    section.read_enum<PivotKind>("device", pivot.kind, {{"handle", PivotKind::kHandle}, {"tip", PivotKind::kTip}});
    section.read("length", pivot.length, 1e-3, 10);
    read_direction(section, "axis", pivot.axis);
    section.refuse_unknown();
    return pivot;
}

DeviceLimits read_limits(Section section) {
    DeviceLimits limits;
    section.read("torque", limits.torque, 0, 1e4);
    section.read("force_slew", limits.force_slew, 0, 1e9);
    section.read("torque_slew", limits.torque_slew, 0, 1e9);
    section.read("dissipation", limits.dissipation, 0, 1e3);
    section.refuse_unknown();
    return limits;
}

// Which number each kind of effect cannot do without.
void check_effect(const Section& section, const HapticEffect& e, const std::string& kind) {
    const auto need = [&](double value, const char* key) {
        if (value == 0) section.fail("a " + kind + " needs " + key);
    };
    switch (e.kind) {
        case EffectKind::kSpringPoint:
        case EffectKind::kSpringLine:
        case EffectKind::kSpringPlane: need(e.stiffness, "stiffness"); break;
        case EffectKind::kConstant: need(e.force, "force"); break;
        case EffectKind::kImpulse: need(e.impulse, "impulse"); break;
        case EffectKind::kVibration: need(e.force, "force"), need(e.frequency, "frequency"); break;
        case EffectKind::kViscosity: need(e.damping, "damping"); break;
        case EffectKind::kInertia: need(e.mass, "mass"); break;
        case EffectKind::kMagnet: need(e.force, "force"), need(e.reach, "reach"); break;
    }
    if (e.trigger == EffectTrigger::kButton) need(e.buttons, "buttons (bits) with when = \"button\"");
}

HapticEffect read_effect(Section section) {
    HapticEffect e;
    std::string kind;
    section.read("kind", kind);
    if (kind.empty()) section.fail("a [[tool.effect]] needs a kind");
    section.read_enum<EffectKind>("kind", e.kind,
                                  {{"spring_to_point", EffectKind::kSpringPoint}, {"spring_to_line", EffectKind::kSpringLine},
                                   {"spring_to_plane", EffectKind::kSpringPlane}, {"constant", EffectKind::kConstant},
                                   {"impulse", EffectKind::kImpulse}, {"vibration", EffectKind::kVibration},
                                   {"viscosity", EffectKind::kViscosity}, {"inertia", EffectKind::kInertia}, {"magnet", EffectKind::kMagnet}});
    section.read_enum<EffectTrigger>("when", e.trigger,
                                     {{"time", EffectTrigger::kTime}, {"button", EffectTrigger::kButton},
                                      {"touch", EffectTrigger::kTouch}, {"release", EffectTrigger::kRelease}});
    section.read("start", e.start, 0, 1e9);
    section.read("duration", e.duration, 0, 1e9);
    section.read_count("buttons", e.buttons, 0, 4294967295.0);
    section.read("point", e.point);
    read_direction(section, "direction", e.direction);
    section.read("stiffness", e.stiffness, 0, 1e5);
    section.read("damping", e.damping, 0, 1e3);
    section.read("force", e.force, -1e3, 1e3);
    section.read("impulse", e.impulse, -10, 10);
    section.read("frequency", e.frequency, 0, 500);  // half the rate of the tick
    section.read("mass", e.mass, 0, 10);
    section.read("reach", e.reach, 0, 1);
    section.refuse_unknown();
    check_effect(section, e, kind);
    return e;
}

// The tables of a [[tool]].
void read_tool_tables(const std::string& file, Section& section, ToolSpec& tool) {
    if (const toml::table* hand = section.table("hand")) tool.hand = read_hand({file, *hand, "[tool.hand]"});
    if (const toml::table* workspace = section.table("workspace")) tool.workspace = read_workspace({file, *workspace, "[tool.workspace]"});
    if (const toml::table* pivot = section.table("pivot")) tool.pivot = read_pivot({file, *pivot, "[tool.pivot]"});
    if (const toml::table* limits = section.table("limits")) tool.limits = read_limits({file, *limits, "[tool.limits]"});
    const toml::array* effects = section.tables("effect");
    if (!effects) return;
    for (const toml::node& node : *effects) tool.effects.push_back(read_effect({file, *node.as_table(), "[[tool.effect]]"}));
    if (tool.effects.size() > kMaxEffects)
        section.fail("tool \"" + tool.body + "\" has " + std::to_string(tool.effects.size()) + " effects; the most is " + std::to_string(kMaxEffects));
}

ToolSpec read_tool(const std::string& file, const toml::table& table) {
    Section section(file, table, "[[tool]]");
    ToolSpec tool;
    tool.line = section.line();
    section.read("body", tool.body);
    if (tool.body.empty()) section.fail("a [[tool]] needs the name of its body");
    section.read("tip", tool.tip);
    section.read("tip_radius", tool.tip_radius, 0, 10);
    section.read("stiffness", tool.stiffness, 0, 1e7);
    section.read("damping", tool.damping, 0, 1e6);
    section.read("max_force", tool.max_force, 0, 1e6);
    section.read("friction", tool.friction, 0, 1e6);
    section.read("pass_through", tool.pass_through, 0, 1e6);
    section.read("trace", tool.trace);
    tool.path = read_path(file, section, "path");
    read_tool_tables(file, section, tool);
    section.refuse_unknown();
    if (tool.path.empty() && tool.trace.empty())
        section.fail("tool \"" + tool.body + "\" needs a trace or a [[tool.path]]");
    return tool;
}

void read_contact(Section section, ContactParams& contact) {
    section.read("tolerance", contact.tolerance, 1e-12, 1e3);
    section.read("cell_edges", contact.cell_edges, 0.01, 1000);
    section.read("push_speed", contact.push_speed, 0, 1e3);
    section.read_enum<DeepResponse>("deep", contact.deep,
                                    {{"none", DeepResponse::kNone}, {"last_free", DeepResponse::kLastFree}});
    section.read("faces", contact.faces);
    section.read("contours", contact.contours);
    section.read("regions", contact.regions);
    section.read_count("iterations", contact.iterations, 1, 100);
    section.read("cross_check", contact.cross_check);
    section.read_enum<ResponseShare>(
        "share", contact.share,
        {{"mass", ResponseShare::kMass}, {"stiffness", ResponseShare::kStiffness}, {"half", ResponseShare::kHalf}});
    section.read_enum<ResponseDirection>(
        "direction", contact.direction, {{"local", ResponseDirection::kLocal}, {"thesis", ResponseDirection::kThesis}});
    section.refuse_unknown();
}

CameraSpec read_camera(Section section) {
    CameraSpec camera;
    section.read("kind", camera.kind);
    if (camera.kind != "orbit" && camera.kind != "laparoscope")
        section.fail("camera kind must be orbit or laparoscope");
    section.read("target", camera.target);
    section.read("position", camera.position);
    section.read("azimuth", camera.azimuth);
    section.read("elevation", camera.elevation, -90, 90);
    section.read("distance", camera.distance, 0, 1e9);
    section.read("fov", camera.fov, 1, 170);
    section.read("wireframe", camera.wireframe);
    section.read("depth_colors", camera.depth_colors);
    section.refuse_unknown();
    return camera;
}

// The value as TOML would read it; a bare word becomes a string.
void insert_value(toml::table& table, const std::string& key, const std::string& value) {
    try {
        toml::table parsed = toml::parse("v = " + value);
        parsed.get("v")->visit([&](auto& node) { table.insert_or_assign(key, node); });
    } catch (const toml::parse_error&) {
        table.insert_or_assign(key, value);
    }
}

toml::table* named_table(toml::table& root, const char* list, const char* name_key, const std::string& name) {
    toml::array* array = root.get_as<toml::array>(list);
    if (!array) return nullptr;
    for (toml::node& node : *array) {
        toml::table* table = node.as_table();
        if (table && table->get(name_key) && table->get(name_key)->value<std::string>() == name) return table;
    }
    return nullptr;
}

// What a node says where "$name" stands for a parameter; null if it does not.
const toml::node* parameter_of(const std::string& file, const toml::node& node, const toml::table& parameters) {
    const auto text = node.value<std::string_view>();
    if (!node.is_string() || !text->starts_with('$')) return nullptr;
    if (const toml::node* value = parameters.get(text->substr(1))) return value;
    std::vector<std::string> names;
    for (const auto& [key, value] : parameters) names.emplace_back(key.str());
    const std::string guess = nearest(text->substr(1), names);
    throw InputError(place(file, node.source()) + "no parameter \"" + std::string(text->substr(1)) + "\" in [parameters]" +
                     (guess.empty() ? "" : "; did you mean \"" + guess + "\"?"));
}

void fill_in_parameters(const std::string& file, const toml::table& parameters, toml::node& node) {
    if (toml::table* table = node.as_table()) {
        std::vector<std::string> keys;
        for (const auto& [key, value] : *table) keys.emplace_back(key.str());
        for (const std::string& key : keys) {
            toml::node& inner = *table->get(key);
            if (const toml::node* value = parameter_of(file, inner, parameters)) table->insert_or_assign(key, *value);
            else fill_in_parameters(file, parameters, inner);
        }
    } else if (toml::array* array = node.as_array()) {
        for (size_t i = 0; i < array->size(); ++i) {
            toml::node& inner = *array->get(i);
            if (const toml::node* value = parameter_of(file, inner, parameters)) array->replace(array->cbegin() + static_cast<ptrdiff_t>(i), *value);
            else fill_in_parameters(file, parameters, inner);
        }
    }
}

// Takes [parameters] out of the scene and puts their values where other keys name them.
std::vector<SceneParameter> take_parameters(const std::string& file, toml::table& root) {
    std::vector<SceneParameter> list;
    const toml::node* node = root.get("parameters");
    if (node && !node->is_table()) throw InputError(place(file, node->source()) + "parameters must be a table");
    const toml::table parameters = node ? *node->as_table() : toml::table{};
    for (const auto& [key, value] : parameters) {
        if (!value.is_value()) throw InputError(place(file, key.source()) + "parameter \"" + std::string(key.str()) + "\" must be a number, a string, true or false");
        std::ostringstream text;
        value.visit([&](const auto& v) { text << v; });
        list.push_back({std::string(key.str()), text.str()});
    }
    root.erase("parameters");
    fill_in_parameters(file, parameters, root);
    return list;
}

void apply_override(toml::table& root, const Override& o) {
    std::vector<std::string> words;
    std::istringstream stream(o.key);
    for (std::string word; std::getline(stream, word, '.');) words.push_back(word);
    if (words.empty() || std::any_of(words.begin(), words.end(), [](const std::string& w) { return w.empty(); }))
        throw InputError("--set " + o.key + "=" + o.value + ": the key is empty");
    toml::table* table = &root;
    size_t next = 0;
    if (toml::table* parameters = root["parameters"].as_table(); words.size() == 1 && parameters && parameters->contains(o.key)) table = parameters;
    const bool named = words[0] == "link" || words[0] == "staple" || words[0] == "cut";
    if (words.size() > 2 && (words[0] == "tool" || named)) {
        table = named_table(root, words[0].c_str(), named ? "name" : "body", words[1]);
        if (!table) throw InputError("--set " + o.key + ": the scene has no " + words[0] + (named ? "" : " on a body") + " named \"" + words[1] + "\"");
        next = 2;
    } else if (words.size() > 1) {
        if (toml::table* body = named_table(root, "body", "name", words[0])) table = body, next = 1;
    }
    for (; next + 1 < words.size(); ++next) {
        if (!table->contains(words[next])) {
            if (table == &root && words[next] != "contact" && words[next] != "camera" && words[next] != "parameters")
                throw InputError("--set " + o.key + ": the scene has no body or table named \"" + words[next] + "\"");
            table->insert(words[next], toml::table{});
        }
        table = table->get_as<toml::table>(words[next]);
        if (!table) throw InputError("--set " + o.key + ": \"" + words[next] + "\" is not a table");
    }
    insert_value(*table, words.back(), o.value);
}

}  // namespace

SceneFile read_scene_file(const std::filesystem::path& path, const std::vector<Override>& overrides) {
    const std::string file = path.string();
    std::error_code error;
    if (std::filesystem::is_directory(path, error)) throw InputError(file + ": is a folder, not a scene");
    std::ifstream stream(path, std::ios::binary);
    if (!stream) throw InputError(file + ": cannot be opened (" + std::string(std::strerror(errno)) + ")");
    std::ostringstream text;
    text << stream.rdbuf();
    toml::table root;
    try {
        root = toml::parse(text.str(), file);
    } catch (const toml::parse_error& e) {
        throw InputError(place(file, e.source()) + std::string(e.description()));
    }
    for (const Override& o : overrides) apply_override(root, o);

    SceneFile scene;
    scene.path = path;
    scene.parameters = take_parameters(file, root);
    Section top(file, root, "");
    scene.settings.name = path.stem().string();
    top.read("name", scene.settings.name);
    top.read("description", scene.settings.description);
    top.read("seconds", scene.settings.seconds, 0, 1e9);
    top.read("gravity", scene.settings.gravity);
    top.read("substep", scene.settings.substep, 1e-9, 1);
    top.read("sleep_speed", scene.settings.sleep_speed, 0, 1e3);
    top.read("sleep_after", scene.settings.sleep_after, 0, 1e6);
    if (const toml::table* contact = top.table("contact"))
        read_contact({file, *contact, "[contact]"}, scene.settings.contact);
    if (const toml::table* camera = top.table("camera")) scene.camera = read_camera({file, *camera, "[camera]"});
    if (const toml::array* bodies = top.tables("body"))
        for (const toml::node& node : *bodies) {
            const BodySpec body = read_body(file, *node.as_table());
            if (body.scatter.count > 0) scatter_body(body, scene.bodies);
            else scene.bodies.push_back(body);
        }
    if (const toml::array* tools = top.tables("tool"))
        for (const toml::node& node : *tools) scene.tools.push_back(read_tool(file, *node.as_table()));
    if (const toml::array* links = top.tables("link"))
        for (const toml::node& node : *links) scene.links.push_back(read_link(file, *node.as_table()));
    if (const toml::array* staples = top.tables("staple"))
        for (const toml::node& node : *staples) scene.links.push_back(read_staple(file, *node.as_table()));
    if (const toml::array* cuts = top.tables("cut"))
        for (const toml::node& node : *cuts) scene.cuts.push_back(read_cut(file, *node.as_table()));
    top.read_count("staples", scene.staples, 0, 1e6);
    top.refuse_unknown();

    std::unordered_set<std::string_view> names;
    for (const BodySpec& body : scene.bodies) {
        if (!names.insert(body.name).second)
            throw InputError(file + ":" + std::to_string(body.line) + ":1: two bodies are named \"" + body.name + "\"");
    }
    return scene;
}

}  // namespace trocar
