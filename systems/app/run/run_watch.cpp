#include "systems/app/run/run_watch.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/mesh/mass_properties.hpp"
#include "engine/tissue/body_energy.hpp"
#include "engine/tissue/tet_forces.hpp"
#include "systems/advance/island/constants.hpp"
#include "systems/app/console/format.hpp"
#include "systems/frame/state.hpp"
namespace trocar {
namespace {

constexpr size_t kMostNames = 3;         // of one kind of trouble
constexpr double kStartsInside = 0.01;   // of the smaller body's size
constexpr double kLeftInside = 0.02;     // of the smaller body's size ...
constexpr uint64_t kLeftFor = 100;       // ms, and more: later contact had time to part them
constexpr double kUnearned = 0.01;       // of what entered
constexpr double kRuin = 10;             // times what entered
constexpr double kSummingFloats = 1e-5;  // of the potential energy, which sums floats
constexpr double kMilliJoule = 1e3;

const char* name_of(const World& w, uint32_t body) { return w.bodies.name[body].c_str(); }

// m, of the smaller of two bodies.
double smaller_size(const World& w, uint32_t a, uint32_t b) {
    return 2 * std::min(w.meshes.info[w.bodies.mesh[a]].radius, w.meshes.info[w.bodies.mesh[b]].radius);
}

struct Overlap {
    uint32_t a, b;
    double depth, share;  // m, of the smaller body's size
};

// Pairs of the last pass deeper than a share of the smaller body.
std::vector<Overlap> overlaps(const World& w, double deeper) {
    std::vector<Overlap> list;
    for (size_t i = 0; i < w.penetrations.pair.size(); ++i) {
        const uint32_t a = w.pairs.a[w.penetrations.pair[i]], b = w.pairs.b[w.penetrations.pair[i]];
        const double share = w.penetrations.depth[i] / smaller_size(w, a, b);
        if (share > deeper) list.push_back({a, b, w.penetrations.depth[i], share});
    }
    return list;
}

// "a, b and c", the names of at most three, and how many more.
std::string listed(std::vector<std::string> texts) {
    const size_t more = texts.size() - std::min(texts.size(), kMostNames);
    texts.resize(texts.size() - more);
    std::string all;
    for (const std::string& text : texts) all += (all.empty() ? "" : "; ") + text;
    return all + (more > 0 ? format("; and %zu more", more) : "");
}

// s, the longest step of a deformable body.
double step_of(const World& w, uint32_t body) {
    const Stepping stepping = stepping_of(w.bodies, body);
    if (stepping.integrator != Integrator::kLeapfrog) return stepping.step;
    const double linked = body < w.links.stable_dt.size() ? w.links.stable_dt[body] : w.bodies.stable_dt[body];
    return std::min({w.bodies.stable_dt[body], linked, stepping.step, w.settings.substep});
}

double stored(const Energy& e) { return e.kinetic + e.elastic + e.pressure + e.bending + e.links; }

double moved_mass(const World& w) {
    double mass = 0;
    for (const RigidMass& free : w.bodies.rigid_mass) mass += free.mass;
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) {
        if (!is_deformable(w.bodies, b)) continue;
        for (uint32_t p = w.bodies.particles[b].first; p < w.bodies.particles[b].end(); ++p)
            if (w.particles.offset[p].w > 0) mass += 1.0 / static_cast<double>(w.particles.offset[p].w);
    }
    return mass;
}

// The body with the most energy of motion and deformation.
uint32_t most_energetic(World& w) {
    BodyEnergyScratch scratch;
    uint32_t most = kNone;
    double largest = -1;
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) {
        Energy own;
        add_body_energy(energy_inputs(w), b, scratch, own);
        if (joins_islands(w.bodies.motion[b]) && stored(own) > largest) largest = stored(own), most = b;
    }
    return most;
}

}  // namespace

RunWatch::RunWatch(const World& world) : inverted_(world.bodies.mesh.size()) {
    const Energy& e = world.energy;
    budget_.known = world.energy_start.known;
    budget_.start = stored(e);
    budget_.start_gravity = budget_.least_gravity = e.gravity;
    budget_.mass = moved_mass(world);
    budget_.last = e;
    look_at_steps(world);
}

std::vector<std::string> RunWatch::take_warnings() { return std::exchange(warnings_, {}); }

void RunWatch::after_pass(Frame& frame) {
    World& w = frame.world();
    if (w.clock.pass == 1) look_at_start(w);
    if (w.report.short_steps > 0) look_at_steps(w);
    look_at_tetrahedra(w);
    follow_overlaps(w);
    if (frame.times().picture && budget_.known) look_at_energy(frame);
}

void RunWatch::look_at_start(World& w) {
    std::vector<std::string> texts, tools;
    const std::vector<Overlap> deep = overlaps(w, kStartsInside);
    for (const Overlap& o : deep)
        texts.push_back(format("\"%s\" and \"%s\" start %.3g mm inside each other, %.2g %% of the smaller one", name_of(w, o.a),
                               name_of(w, o.b), 1e3 * o.depth, 100 * o.share));
    for (const HandTool& tool : w.haptics.tool) {
        const auto inside = [&](const Overlap& o) { return (o.a == tool.body || o.b == tool.body); };
        const auto found = std::ranges::find_if(deep, inside);
        if (found == deep.end()) continue;
        tools.push_back(
            format("the tool \"%s\" starts inside \"%s\"", name_of(w, tool.body), name_of(w, found->a == tool.body ? found->b : found->a)));
    }
    w.report.start_overlaps += texts.size();
    w.report.tools_inside += tools.size();
    parting_ = !texts.empty();
    if (!texts.empty()) warnings_.push_back(listed(texts) + ": contact will part them; move them apart if that is not meant");
    if (!tools.empty()) warnings_.push_back(listed(tools));
}

// Before the first pass, which may last for hours, and again when tissue is crushed.
void RunWatch::look_at_steps(const World& w) {
    if (short_) return;
    std::vector<std::string> texts;
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) {
        const double step = is_deformable(w.bodies, b) ? step_of(w, b) : 1;
        if (step < kShortStep) texts.push_back(format("\"%s\" takes %.3g steps a millisecond", name_of(w, b), 1e-3 / step));
    }
    if (texts.empty() && w.report.short_steps > 0)
        texts.push_back(format("tissue that is crushed or folds takes more than %.0f steps a millisecond", 1e-3 / kShortStep));
    if (texts.empty()) return;
    short_ = true;
    warnings_.push_back(listed(texts) + ": stiff, light or finely meshed tissue is slow");
}

void RunWatch::look_at_tetrahedra(const World& w) {
    if (w.report.inverted_tetrahedra == std::exchange(inverted_before_, w.report.inverted_tetrahedra)) return;
    std::vector<std::string> texts;
    inverted_.resize(w.bodies.mesh.size());
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) {
        if (inverted_[b] || !is_deformable(w.bodies, b) || !is_solid(w.solids, w.bodies.mesh[b])) continue;
        const TetStep tets = bind_tets(w.solids, w.bodies, w.particles, b, &w.torn_springs);
        const uint32_t inverted = inverted_tetrahedra(tets);
        if (inverted == 0) continue;
        inverted_[b] = 1;
        texts.push_back(format("%u of %u tetrahedra of \"%s\" are inside out after %.3f s, the least at %.2g of its volume", inverted,
                               w.solids.info[w.bodies.mesh[b]].count, name_of(w, b), static_cast<double>(w.clock.tick) * 1e-3,
                               static_cast<double>(least_volume_ratio(tets))));
    }
    if (!texts.empty()) warnings_.push_back(listed(texts));
}

void RunWatch::follow_overlaps(const World& w) {
    std::map<std::array<uint32_t, 2>, uint64_t> still;
    for (const Overlap& o : overlaps(w, kLeftInside)) {
        const std::array<uint32_t, 2> pair{o.a, o.b};
        const auto before = overlapping_.find(pair);
        still[pair] = before == overlapping_.end() ? w.clock.tick - w.clock.period : before->second;
    }
    overlapping_ = std::move(still);
    parting_ = parting_ && !overlaps(w, kStartsInside).empty();
}

void RunWatch::look_at_energy(Frame& frame) {
    World& w = frame.world();
    const Energy& e = w.energy;
    EnergyBudget& b = budget_;
    b.least_gravity = std::min(b.least_gravity, e.gravity);
    b.hand = std::max(b.hand, e.work_hand);
    b.links = std::max(b.links, e.work_links);
    if (parting_) b.parting += std::max(0.0, e.work_push - b.last.work_push);
    if (!w.pools.slots.empty()) b.parting += std::max(0.0, e.work_numeric - b.last.work_numeric);
    b.last = e;
    const double noise = kSummingFloats * std::max(std::abs(e.gravity), std::abs(b.start_gravity)) + kNoise * b.mass;
    const double entered = b.entered(), height = e.gravity - b.start_gravity;
    struct Term {
        double beyond;  // J, more than can be
        std::string text;
    };
    const Term terms[] = {
        {stored(e) + height - (b.start + b.hand + b.links + b.parting),
         format("there is %.3g mJ of energy", kMilliJoule * (stored(e) + std::max(0.0, height)))},
        {std::abs(e.work_contact) - entered, format("the work of contact is %.3g mJ", kMilliJoule * e.work_contact)},
        {std::abs(e.work_push) - entered, format("the work of position correction is %.3g mJ", kMilliJoule * e.work_push)},
        {w.pools.slots.empty() ? std::abs(e.work_numeric) - entered : 0,
         format("the work of implicit steps is %.3g mJ", kMilliJoule * e.work_numeric)}};
    const Term& worst = *std::ranges::max_element(terms, {}, &Term::beyond);
    if (!(worst.beyond > kUnearned * entered + noise)) return;
    ++w.report.unearned_energy;
    const bool ruined = worst.beyond > kRuin * entered + noise;
    if (unearned_ && (!ruined || !ruin_.empty())) return;
    unearned_ = true;
    const std::string text = format("%s after %.3f s, but only %.3g mJ entered the scene; most of it is in \"%s\"", worst.text.c_str(),
                                    static_cast<double>(w.clock.tick) * 1e-3, kMilliJoule * entered, name_of(w, most_energetic(w)));
    if (ruined)
        ruin_ = text + format(": more than %.0f times as much", kRuin);
    else
        warnings_.push_back(text);
}

void RunWatch::finish(World& w) {
    std::vector<std::string> texts;
    for (const Overlap& o : overlaps(w, kLeftInside)) {
        const auto since = overlapping_.find({o.a, o.b});
        if (since == overlapping_.end() || w.clock.tick - since->second < kLeftFor) continue;
        texts.push_back(format("\"%s\" and \"%s\" are left %.3g mm inside each other, %.2g %% of the smaller one", name_of(w, o.a),
                               name_of(w, o.b), 1e3 * o.depth, 100 * o.share));
    }
    w.report.left_overlaps = texts.size();
    if (!texts.empty()) warnings_.push_back(listed(texts));
}

}  // namespace trocar
