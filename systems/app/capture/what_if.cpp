#include "systems/app/capture/what_if.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "engine/base/error.hpp"
#include "engine/jobs/trace.hpp"
#include "systems/app/console/format.hpp"
namespace trocar {
namespace {

[[noreturn]] void refuse(const Override& change, const std::string& why) {
    throw InputError("--set " + change.key + "=" + change.value + ": " + why);
}

double number_of(const Override& change, std::string_view text) {
    double value = 0;
    const std::from_chars_result end = std::from_chars(text.data(), text.data() + text.size(), value);
    if (end.ec != std::errc() || end.ptr != text.data() + text.size() || !std::isfinite(value)) refuse(change, "a number is needed");
    return value;
}

Vec3d vector_of(const Override& change) {
    std::string text = change.value;
    for (char& c : text)
        if (c == '[' || c == ']' || c == ',') c = ' ';
    Vec3d v;
    char end = 0;
    if (std::sscanf(text.c_str(), "%lf %lf %lf %c", &v.x(), &v.y(), &v.z(), &end) != 3 || !v.allFinite())
        refuse(change, "three numbers are needed");
    return v;
}

template <typename Choice>
void choose(const Override& change, std::initializer_list<std::pair<std::string_view, Choice>> choices, Choice& value) {
    std::string_view word = change.value;
    if (word.size() > 1 && word.front() == '"' && word.back() == '"') word = word.substr(1, word.size() - 2);
    std::string names;
    for (const auto& [name, choice] : choices) {
        if (name == word) {
            value = choice;
            return;
        }
        names += (names.empty() ? "" : ", ") + std::string(name);
    }
    refuse(change, "it is one of " + names);
}

void set_field(const Override& c, double& value) { value = number_of(c, c.value); }
void set_field(const Override& c, uint32_t& value) {
    const double number = number_of(c, c.value);
    if (number != std::floor(number) || number < 0 || number > 4294967295.0) refuse(c, "a whole number is needed");
    value = static_cast<uint32_t>(number);
}
void set_field(const Override& c, bool& value) { choose(c, {{"true", true}, {"false", false}}, value); }
void set_field(const Override& c, Vec3d& value) { value = vector_of(c); }
void set_field(const Override& c, ResponseShare& value) {
    choose(c, {{"mass", ResponseShare::kMass}, {"stiffness", ResponseShare::kStiffness}, {"half", ResponseShare::kHalf}}, value);
}
void set_field(const Override& c, ResponseDirection& value) {
    choose(c, {{"local", ResponseDirection::kLocal}, {"thesis", ResponseDirection::kThesis}}, value);
}
void set_field(const Override& c, DeepResponse& value) {
    choose(c, {{"none", DeepResponse::kNone}, {"last_free", DeepResponse::kLastFree}}, value);
}
void set_field(const Override& c, TreeSearch& value) { choose(c, {{"own", TreeSearch::kOwn}, {"embree", TreeSearch::kEmbree}}, value); }
void set_field(const Override& c, ContactParams&) { refuse(c, "name a key of it, as contact.push_speed"); }

bool is_of_tissue(std::string_view name) { return name == "friction" || name == "damping" || name == "restitution"; }

// Ranges that a scene file has for the same keys: what the engine relies on.
void check(const Override& change, const World& w) {
    const SceneSettings& s = w.settings;
    const ContactParams& c = s.contact;
    if (!(s.substep > 0) || s.sleep_speed < 0 || s.sleep_after < 0 || !(c.tolerance > 0) || !(c.cell_edges > 0) || c.push_speed < 0 ||
        c.iterations < 1 || c.iterations > 100 || c.constraint_capacity < 1)
        refuse(change, "out of range");
    for (const Tissue& t : w.bodies.tissue)
        if (t.friction < 0 || t.damping < 0 || t.restitution < 0 || t.restitution > 1) refuse(change, "out of range");
    if (const std::string fault = find_fault(w); !fault.empty()) refuse(change, fault);
}

}  // namespace

void change_world(const Override& change, World& world) {
    const std::string_view key = change.key;
    bool found = false;
    const auto look = [&](auto& fields, std::string_view prefix) {
        each_field(fields, [&](const FieldName& field, auto& value) {
            if (key != std::string(prefix) + std::string(field.name)) return;
            found = true;
            set_field(change, value);
        });
    };
    look(world.settings, ""), look(world.settings.contact, "contact.");
    constexpr std::string_view kTissue = ".tissue.";
    const size_t at = key.rfind(kTissue);
    if (!found && at != key.npos && is_of_tissue(key.substr(at + kTissue.size()))) {
        const std::string_view body = key.substr(0, at);
        for (uint32_t b = 0; b < world.bodies.tissue.size(); ++b) {
            if (body != "body" && body != world.bodies.name[b]) continue;
            each_field(world.bodies.tissue[b], [&](const FieldName& field, double& value) {
                if (field.name == key.substr(at + kTissue.size())) found = true, set_field(change, value);
            });
        }
        if (!found) refuse(change, "the capture has no body named \"" + std::string(body) + "\"");
    }
    if (!found)
        refuse(change,
               "a capture is built already; what a pass reads anew can be changed: gravity, substep, sleep_speed, sleep_after, keys of "
               "[contact] but rate, and BODY.tissue.friction, .damping, .restitution");
    check(change, world);
}

std::vector<WhatIfPass> what_if(const Capture& capture, std::span<const Override> changes) {
    World world = world_at(capture, 0);
    for (const Override& change : changes) change_world(change, world);
    Frame frame(std::move(world), replay_options(capture, nullptr));
    take_up(capture, 0, frame);
    std::vector<WhatIfPass> passes;
    for (const Capture::Stretch& stretch : capture.stretches) {
        for (const CaptureStep& step : stretch.steps) {
            take_input(step, frame);
            const uint64_t start = now_ns();
            frame.step();
            WhatIfPass p;
            p.pass = step.pass;
            p.ms[0] = step.frame_ms, p.ms[1] = static_cast<double>(now_ns() - start) * 1e-6;
            p.depth[0] = step.depth, p.depth[1] = frame.times().deepest;
            p.contacts[0] = step.contacts, p.contacts[1] = frame.world().contacts.point.size();
            p.force[0] = step.force;
            for (const ToolState& tool : frame.world().haptics.state) p.force[1] = std::max(p.force[1], tool.output.force.norm());
            p.same = state_hash(frame.world()) == step.state_hash;
            passes.push_back(p);
        }
    }
    return passes;
}

std::string what_if_text(const std::vector<WhatIfPass>& passes) {
    const auto first = std::ranges::find(passes, false, &WhatIfPass::same);
    std::string out =
        std::to_string(passes.size()) + " passes; " +
        (first == passes.end() ? "the changes change nothing\n" : "the first to differ is " + std::to_string(first->pass) + "\n");
    out += "                          recorded      changed\n";
    const auto row = [&](const char* what, const auto& value) {
        double most[2] = {0, 0}, sum[2] = {0, 0};
        for (const WhatIfPass& p : passes)
            for (int k = 0; k < 2; ++k)
                most[k] = std::max(most[k], value(p, k)), sum[k] += value(p, k) / static_cast<double>(passes.size());
        out += format("  %-18s mean %12.5g %12.5g\n  %-18s  max %12.5g %12.5g\n", what, sum[0], sum[1], "", most[0], most[1]);
    };
    row("depth, mm", [](const WhatIfPass& p, int k) { return 1e3 * p.depth[k]; });
    row("force on hand, N", [](const WhatIfPass& p, int k) { return p.force[k]; });
    row("contacts", [](const WhatIfPass& p, int k) { return static_cast<double>(p.contacts[k]); });
    row("pass, ms", [](const WhatIfPass& p, int k) { return p.ms[k]; });
    return out;
}

std::string what_if_csv(const std::vector<WhatIfPass>& passes) {
    std::string out = "pass,depth_m,depth_changed_m,force_n,force_changed_n,contacts,contacts_changed,pass_ms,pass_changed_ms,same\n";
    for (const WhatIfPass& p : passes)
        out += format("%llu,%.9g,%.9g,%.9g,%.9g,%llu,%llu,%.4f,%.4f,%d\n", static_cast<unsigned long long>(p.pass), p.depth[0], p.depth[1],
                      p.force[0], p.force[1], static_cast<unsigned long long>(p.contacts[0]),
                      static_cast<unsigned long long>(p.contacts[1]), p.ms[0], p.ms[1], int{p.same});
    return out;
}

}  // namespace trocar
