#include "fuzz/judge.hpp"

#include <algorithm>
#include <cmath>

#include "engine/devices/device.hpp"
#include "engine/mesh/surfaces.hpp"
#include "engine/tissue/tet_forces.hpp"
#include "systems/app/console/format.hpp"
#include "systems/haptics/tick.hpp"
#include "systems/haptics/tool.hpp"
namespace trocar::fuzz {
namespace {

double stored(const Energy& e) { return e.kinetic + e.elastic + e.pressure + e.bending + e.links; }

// The first thing that is no number; null if all are.
const char* find_nonfinite(const World& w) {
    const auto finite = [](const std::vector<Vec3d>& v) { return std::ranges::all_of(v, [](const Vec3d& p) { return p.allFinite(); }); };
    const Particles& p = w.particles;
    if (!std::ranges::all_of(p.offset, [](const Float4& o) { return std::isfinite(o.x + o.y + o.z); })) return "the place of a particle";
    for (const auto* v : {&p.velocity_x, &p.velocity_y, &p.velocity_z})
        if (!std::ranges::all_of(*v, [](float x) { return std::isfinite(x); })) return "the velocity of a particle";
    if (!finite(w.poses.origin)) return "the place of a body";
    if (!finite(w.poses.velocity) || !finite(w.poses.angular_velocity)) return "the velocity of a body";
    for (const ToolState& tool : w.haptics.state)
        if (!tool.output.force.allFinite() || !tool.output.torque.allFinite()) return "a force on a hand";
    return std::isfinite(stored(w.energy) + w.energy.gravity + w.energy.balance) ? nullptr : "an energy";
}

// m, signed: of a point in the world from the surface of a body.
double distance_to(const World& w, uint32_t body, const Vec3d& p) {
    return w.trees[w.bodies.tree[body]]->query(world_to_frame(surfaces_of(w), body, p)).distance;
}

}  // namespace

Judge::Judge(Frame& frame) : frame_(frame), watch_(frame.world()), hands_(frame.world().haptics.tool.size()) {
    const Energy& e = frame.world().energy;
    start_ = stored(e);
    start_gravity_ = least_gravity_ = e.gravity;
    frame.set_contact_hook({[](void* user, World& w) { static_cast<Judge*>(user)->tick(w); }, this});
}

void Judge::add(Kind kind, bool named, const std::string& reason) {
    if (std::ranges::none_of(found_, [&](const Trouble& t) { return t.kind == kind; })) found_.push_back({kind, named, reason});
}

void Judge::tick(const World& w) {
    const HapticParams params = haptic_params(w.clock.contact_rate);
    for (size_t t = 0; t < hands_.size(); ++t) {
        const HandTool& tool = w.haptics.tool[t];
        ToolState state = w.haptics.state[t];
        const double slew = tool.limits.force_slew > 0 ? tool.limits.force_slew : tool.max_force / 3e-3;
        for (uint32_t ms = 0; ms < w.clock.period; ++ms) {
            const Vec3d before = state.output.force;
            const uint64_t safe = state.safety.safe_ticks;
            const DeviceState sample =
                hand_sample(tool, w.devices.intended[t * w.devices.per_tool + ms], params.dt, state.output, state.hand);
            const double time = static_cast<double>(w.clock.tick + ms) * 1e-3;
            tick_tool(params, w.local_contact[t], time, tool, effects_of(w.haptics, tool), sample, hands_[t].scratch, state);
            const double step = (state.output.force - before).norm(), force = state.output.force.norm();
            const bool dropped = state.safety.safe_ticks > safe;  // to nothing, at once, because a sample was refused
            if (!(step <= slew * params.dt * (1 + 1e-9)) && !dropped)
                add(Kind::kForce, false, format("a step of %.4g N at %.3f s, %.4g N is the ramp", step, time, slew * params.dt));
            if (!(force <= tool.max_force))
                add(Kind::kForce, false, format("%.4g N at %.3f s, %.4g N is the most", force, time, tool.max_force));
        }
        hands_[t].force = state.output.force;
    }
}

void Judge::look_at_tips() {
    const World& w = frame_.world();
    for (size_t t = 0; t < hands_.size(); ++t) {
        const HandTool& tool = w.haptics.tool[t];
        const ToolState& state = w.haptics.state[t];
        if (state.output.force != hands_[t].force)
            add(Kind::kTicks, false, format("%.9g N instead of %.9g N", state.output.force.norm(), hands_[t].force.norm()));
        if (tool.pass_through > 0 || w.trees[w.bodies.tree[tool.body]]->query(tool.tip).distance > 0)
            continue;  // the middle of a needle is air
        double deepest = 0;
        for (size_t pair = 0; pair < w.pairs.a.size(); ++pair) {
            const uint32_t a = w.pairs.a[pair], b = w.pairs.b[pair];
            if ((a != tool.body && b != tool.body) || w.bodies.thickness[a] > 0 || w.bodies.thickness[b] > 0) continue;
            deepest = std::min(deepest, distance_to(w, a == tool.body ? b : a, state.device.position));
        }
        const bool felt = state.output.force.norm() > 1e-3;
        hands_[t].lost = deepest < 0 && !felt ? hands_[t].lost + w.clock.period : 0;
        if (hands_[t].lost >= 200)
            add(Kind::kLostTip, w.report.tools_inside > 0,
                format("\"%s\" is %.3g mm inside and feels nothing at %.3f s", w.bodies.name[tool.body].c_str(), -1e3 * deepest,
                       static_cast<double>(w.clock.tick) * 1e-3));
    }
}

// What hands and scripts did, links brought and bodies that started inside each other were parted with, is the most that can be in
// play beyond the start; a fall only changes its form.
void Judge::look_at_energy() {
    const Energy& e = frame_.world().energy;
    least_gravity_ = std::min(least_gravity_, e.gravity);
    hand_ = std::max(hand_, e.work_hand + std::max(0.0, e.work_links));
    const double in_play = stored(e) + e.gravity - start_gravity_, allowed = start_ + hand_ + watch_.budget().parting;
    const double noise = 1e-5 * std::max(std::abs(e.gravity), std::abs(start_gravity_)) + watch_.budget().noise;
    if (!(in_play - allowed - noise > beyond_)) return;
    beyond_ = in_play - allowed - noise;
    energy_text_ = format("%.4g mJ of energy at %.3f s, where %.4g mJ can be", 1e3 * in_play,
                          static_cast<double>(frame_.world().clock.tick) * 1e-3, 1e3 * allowed);
}

void Judge::after_pass() {
    watch_.after_pass(frame_);
    const World& w = frame_.world();
    look_at_tips();
    if (frame_.times().picture) look_at_energy();
    if (const char* what = find_nonfinite(w))
        add(Kind::kNonfinite, w.report.nonfinite_particles > 0,
            format("%s is no number after %.3f s", what, static_cast<double>(w.clock.tick) * 1e-3));
}

void Judge::look_at_end() {
    World& w = frame_.world();
    if (w.report.nonfinite_particles > 0)
        add(Kind::kNonfinite, true, format("%llu particles were restored", static_cast<unsigned long long>(w.report.nonfinite_particles)));
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) {
        if (!is_deformable(w.bodies, b) || !is_solid(w.solids, w.bodies.mesh[b])) continue;
        const uint32_t inverted = inverted_tetrahedra(bind_tets(w.solids, w.bodies, w.particles, b, &w.torn_springs));
        if (inverted > 0)
            add(Kind::kInverted, w.report.inverted_tetrahedra > 0,
                format("%u of %u tetrahedra of \"%s\" are inside out", inverted, w.solids.info[w.bodies.mesh[b]].count,
                       w.bodies.name[b].c_str()));
    }
    if (w.report.left_overlaps > 0)
        add(Kind::kOverlap, true, format("%llu pairs are left inside each other", static_cast<unsigned long long>(w.report.left_overlaps)));
    if (beyond_ > 0.01 * (start_ + hand_ + watch_.budget().parting + start_gravity_ - least_gravity_))
        add(Kind::kEnergy, w.report.unearned_energy > 0, energy_text_);
    if (w.report.unearned_energy > 0) add(Kind::kEnergy, true, "the work of contact or numerics is more than what entered");
}

std::vector<Trouble> Judge::finish() {
    watch_.finish(frame_.world());
    look_at_end();
    const std::vector<std::string> warnings = watch_.take_warnings();
    for (Trouble& t : found_)
        if (t.named && !watch_.ruin().empty() && t.kind == Kind::kEnergy) t.reason += " [" + watch_.ruin() + "]";
    std::string all;
    for (const std::string& warning : warnings) all += " [" + warning + "]";
    if (!found_.empty()) found_.back().reason += all;
    return std::move(found_);
}

}  // namespace trocar::fuzz
