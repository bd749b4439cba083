#include <algorithm>
#include <cmath>
#include <numbers>

#include "content/scene/scene_sections.hpp"
#include "content/scene/tissues.hpp"
namespace trocar {
namespace {

// Reads a preset by name; keys of the table override it. A solid ignores the values that concern only shells.
void choose_preset(TomlSection& section, std::string_view key, bool solid, Tissue& t) {
    std::string name;
    section.read(key, name);
    if (name.empty()) return;
    const TissuePreset* preset = find_tissue(name);
    if (!preset) section.fail(*section.find(key), "no tissue \"" + name + "\"; there are " + tissue_names());
    t = preset->tissue;
    if (solid) t.pressure_modulus = t.bending = 0;
}

// Blood's flow per volume of tissue (1/s), as tables give it.
HeatTissue read_heat(TomlSection section, HeatTissue heat) {
    constexpr double kBlood = 1000 * 4180.0;  // J/(m^3 K), as of HeatTissue
    double flow = heat.perfusion / kBlood;
    section.read("conductivity", heat.conductivity, 1e-9, 1e6);
    section.read("specific_heat", heat.specific_heat, 1e-3, 1e9);
    section.read("perfusion", flow, 0, 1e3);
    section.read("metabolism", heat.metabolism, 0, 1e9);
    section.read("stiffening", heat.stiffening, 1, 1e3);
    section.read("water", heat.water, 1e-3, 1);
    section.read("parts", heat.parts);
    heat.perfusion = flow * kBlood;
    section.refuse_unknown();
    return heat;
}

// prony = [[share, seconds], ...]
Prony read_prony(TomlSection& section) {
    Prony prony;
    const toml::node* node = section.find("prony");
    if (!node) return prony;
    const toml::array* list = node->as_array();
    const auto fail = [&](const toml::node& at) {
        section.fail(at, "prony must be up to " + std::to_string(Prony::kMost) +
                             " pairs [share, seconds], the share above 0 and up to 1000, the time from 1e-3 to 100 s");
    };
    if (!list || list->size() > Prony::kMost) fail(*node);
    for (size_t i = 0; i < list->size(); ++i) {
        const toml::array* pair = (*list)[i].as_array();
        if (!pair || pair->size() != 2) fail((*list)[i]);
        const std::optional<double> share = (*pair)[0].value<double>(), time = (*pair)[1].value<double>();
        if (!share || !time || !(*share > 0 && *share <= 1e3 && *time >= 1e-3 && *time <= 100)) fail((*list)[i]);
        prony.share[i] = *share, prony.time[i] = *time;
    }
    return prony;
}

Tissue read_tissue(TomlSection section, bool solid, Tissue t, TissueLaw& law, Prony& prony) {
    choose_preset(section, "preset", solid, t);
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
    section.read_enum<TissueLaw>("law", law, {{"springs", TissueLaw::kSprings}, {"neo_hookean", TissueLaw::kNeoHookean}});
    prony = read_prony(section);
    section.refuse_unknown();
    return t;
}

HapticSurface read_surface(TomlSection section, Motion motion) {
    HapticSurface s;
    s.body = 0;  // set when the body is built
    s.deformable = motion == Motion::kDeformable;
    section.read("stiffness", s.stiffness, 0, 1e7);
    section.read("damping", s.damping, 0, 1e6);
    section.read("static_friction", s.static_friction, 0, 1e3);
    s.dynamic_friction = s.static_friction;
    section.read("dynamic_friction", s.dynamic_friction, 0, 1e3);
    section.read_enum<TextureKind>("texture", s.texture,
                                   {{"none", TextureKind::kNone}, {"grating", TextureKind::kGrating}, {"noise", TextureKind::kNoise}});
    section.read("height", s.height, 0, 1e-2);
    section.read("length", s.length, 1e-6, 1);
    section.read_direction("along", s.along);
    section.refuse_unknown();
    if (s.stiffness > 0 && motion != Motion::kStatic && motion != Motion::kKinematic)
        section.fail("stiffness is for bodies that are static or kinematic: what gives way by itself is as stiff as it is");
    if (s.dynamic_friction >= 0 && s.static_friction < 0) section.fail("dynamic_friction needs a static_friction");
    if (s.dynamic_friction > s.static_friction) section.fail("dynamic_friction must not be above static_friction");
    if ((s.texture != TextureKind::kNone) != (s.height > 0)) section.fail("a texture needs a height (m), and a height a texture");
    return s;
}

ScatterSpec read_scatter(TomlSection section) {
    ScatterSpec scatter;
    scatter.asked = true;
    if (!section.find("count")) section.fail("[body.scatter] needs a count");
    section.read_count("count", scatter.count, 0, 1e6);
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

// Repeats the path `times` times. Each repetition starts at the time and pose at which the previous one ends.
void repeat_path(uint32_t times, std::vector<Keyframe>& path) {
    if (path.empty()) return;
    const size_t keys = path.size(), first = path[0].time > 0 ? 0 : 1;
    const double period = path.back().time;
    for (uint32_t n = 1; n < times; ++n) {
        for (size_t k = first; k < keys; ++k) {
            Keyframe key = path[k];
            key.time += n * period;
            path.push_back(key);
        }
    }
}

}  // namespace

void read_degrees(TomlSection& section, std::string_view key, double& angle) {
    double degrees = angle * (180 / std::numbers::pi);
    section.read(key, degrees, 0, 180);
    angle = degrees * (std::numbers::pi / 180);
}

std::vector<Keyframe> read_path(TomlSection& owner, std::string_view key, bool with_grip) {
    std::vector<Keyframe> path;
    owner.read_list(key, path, [&](TomlSection section) {
        Keyframe frame;
        if (!path.empty())
            frame.position = path.back().position, frame.orientation = path.back().orientation, frame.grip = path.back().grip;
        section.read("time", frame.time, 0, 1e9);
        section.read("position", frame.position);
        section.read("rotation", frame.orientation);
        bool jump = false;
        section.read("jump", jump);
        frame.jump = jump;
        if (with_grip) read_degrees(section, "grip", frame.grip);
        section.refuse_unknown();
        if (!path.empty() && frame.time <= path.back().time) section.fail("time must be later than that of the key before");
        return frame;
    });
    if (path.empty()) return path;
    uint32_t times = 1;
    owner.read_count("repeat", times, 1, 1e6);
    if (times > 1 && path.size() < 2) owner.fail("repeat needs a path of two keys or more");
    if (times * path.size() > 4'000'000) owner.fail("a path repeated " + std::to_string(times) + " times has more than 4 million keys");
    repeat_path(times, path);
    return path;
}

namespace {

// m per file unit; 0 stands for "auto".
void read_scale(TomlSection& section, double& scale) {
    const toml::node* node = section.find("scale");
    if (!node) return;
    if (node->is_string()) {
        if (*node->value<std::string>() != "auto") section.fail(*node, "scale must be a number or \"auto\"");
        scale = 0;
    } else {
        section.read("scale", scale, 1e-12, 1e12);
    }
}

// Rejects keys that exclude each other.
void check_body(const TomlSection& section, const BodySpec& body) {
    if (body.scatter.asked && (body.motion == Motion::kHand || !body.above.empty()))
        section.fail("body \"" + body.name + "\": what is scattered can neither be held by a hand nor stand above another body");
    if (body.scatter.rate > 0 && (body.motion != Motion::kDeformable || std::isfinite(body.break_strain)))
        section.fail("body \"" + body.name + "\": only deformable bodies that do not break come and go (scatter.rate)");
    if (body.file_origin && (body.file.empty() || !body.above.empty() || !body.node.empty() || body.motion == Motion::kHand))
        section.fail("body \"" + body.name + "\": origin = \"file\" is for a body with a file, not held by a hand, without above and node");
    if (body.motion == Motion::kKinematic && body.path.empty()) section.fail("kinematic body \"" + body.name + "\" needs a [[body.path]]");
    if (body.self_contact && body.motion != Motion::kDeformable)
        section.fail("body \"" + body.name + "\": only a deformable body has self_contact");
    if ((body.law != TissueLaw::kSprings || body.prony.branches() > 0) && (body.motion != Motion::kDeformable || !body.solid))
        section.fail("body \"" + body.name + "\": law and prony are for deformable bodies with model = \"solid\"");
    if (body.motion != Motion::kFree && (!body.velocity.isZero(0) || !body.spin.isZero(0)))
        section.fail("body \"" + body.name + "\": only a free body starts with a velocity or spin of its own");
}

}  // namespace

BodySpec read_body(TomlSection section) {
    BodySpec body;
    body.line = section.line();
    section.read("name", body.name);
    if (body.name.empty()) section.fail("a [[body]] needs a name");
    constexpr size_t kLongestName = 64;  // copies append a number to it
    if (!is_body_name(body.name) || body.name.size() > kLongestName)
        section.fail("the name of a body has at most 64 bytes, and no /, \\, \" or control character");
    section.read("node", body.node);
    section.read("shape", body.shape);
    section.read("file", body.file);
    if (body.shape.empty() && body.file.empty()) section.fail("body \"" + body.name + "\" needs a shape or a file");
    section.read_count("triangles", body.triangles, 4, 2e7);
    section.read_count("seed", body.seed, 0, 9e15);
    read_scale(section, body.scale);
    section.read("size", body.size, 1e-9, 1e9);
    section.read_enum<Motion>("motion", body.motion,
                              {{"static", Motion::kStatic},
                               {"kinematic", Motion::kKinematic},
                               {"hand", Motion::kHand},
                               {"deformable", Motion::kDeformable},
                               {"free", Motion::kFree}});
    if (body.motion == Motion::kFree) body.tissue.damping = 0;  // free fall by default
    section.read_enum<bool>("origin", body.file_origin, {{"centroid", false}, {"file", true}});
    section.read("position", body.position);
    section.read("rotation", body.orientation);
    section.read("above", body.above);
    section.read("gap", body.gap, -1e3, 1e3);
    section.read_enum<AnchorFrame>("anchor", body.anchor_frame, {{"world", AnchorFrame::kWorld}, {"shape", AnchorFrame::kShape}});
    section.read_enum<bool>("model", body.solid, {{"shell", false}, {"solid", true}});
    section.read("cells", body.cells, 1, 500);
    section.read("spacing", body.spacing, 1e-9, 1e9);
    section.read("bed", body.bed);
    section.read("skin", body.skin);
    section.read_enum<bool>("boundary", body.filled, {{"stuffed", false}, {"filled", true}});
    if (body.filled && !(body.solid && body.skin))
        section.fail(*section.find("boundary"), "boundary = \"filled\" is for bodies with model = \"solid\" and skin = true");
    section.read("fixed_below", body.fixed_below);
    section.read("integrator", body.integrator);
    if (body.integrator == "xpbd" || body.integrator == "midpoint") {
        section.fail(*section.find("integrator"),
                     "integrator \"" + body.integrator + "\" is not offered: take \"leapfrog\", or \"implicit\" for shells and sheets");
    }
    constexpr const char* kIntegrators[] = {"leapfrog", "implicit", "auto"};
    if (std::find(std::begin(kIntegrators), std::end(kIntegrators), body.integrator) == std::end(kIntegrators))
        section.fail(*section.find("integrator"), "integrator \"" + body.integrator + "\" is none of leapfrog, implicit, auto");
    section.read_count("iterations", body.iterations, 1, 1e4);
    section.read("step", body.step, 1e-9, 1);
    section.read("thickness", body.thickness, 1e-9, 1e3);
    section.read("self_contact", body.self_contact);
    section.read("mass", body.mass, 1e-6, 1e6);
    section.read("velocity", body.velocity);
    section.read("spin", body.spin);
    if (const toml::node* node = section.find("color"); node) {
        Vec3d c;
        section.read("color", c);
        body.color = {static_cast<float>(c.x()), static_cast<float>(c.y()), static_cast<float>(c.z())};
    }
    if (const toml::node* node = section.find("tissue"); node && node->is_string()) {
        choose_preset(section, "tissue", body.solid, body.tissue);
    } else {
        section.read_table("tissue", body.tissue,
                           [&](TomlSection inner) { return read_tissue(inner, body.solid, body.tissue, body.law, body.prony); });
    }
    body.path = read_path(section, "path");
    section.read("apart", body.apart);
    section.read("break_strain", body.break_strain, 1e-9, 1e12);
    section.read_count("cut_capacity", body.cut_capacity, 0, 1e6);
    section.read_list("group", body.groups, read_group);
    section.read_table("heat", body.heat, [&](TomlSection inner) { return read_heat(inner, body.heat); });
    section.read_list("region", body.regions, read_tissue_region);
    section.read_table("haptic", body.haptic, [&](TomlSection inner) { return read_surface(inner, body.motion); });
    section.read_table("scatter", body.scatter, read_scatter);
    section.refuse_unknown();
    check_body(section, body);
    return body;
}

}  // namespace trocar
