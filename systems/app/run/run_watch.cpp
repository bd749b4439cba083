#include "systems/app/run/run_watch.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "engine/contact/sleeping_bodies.hpp"
#include "engine/mesh/mass_properties.hpp"
#include "engine/tissue/body_energy.hpp"
#include "engine/tissue/pressure_force.hpp"
#include "engine/tissue/tet_forces.hpp"
#include "systems/advance/island/constants.hpp"
#include "systems/app/console/format.hpp"
#include "systems/frame/state.hpp"
namespace trocar {
namespace {

constexpr size_t kMostNames = 3;         // of one kind of trouble
constexpr double kStartsDeep = 0.125;    // of the smaller body's size: probably a mistake
constexpr double kStartsInside = 0.01;   // of the smaller body's size
constexpr double kLeftInside = 0.02;     // of the smaller body's size ...
constexpr uint64_t kLeftFor = 100;       // ms, and more: later contact had time to part them
constexpr double kCreep = 2;             // contact at rest creeps: position correction does up to 1.05 of what entered kidney_on_liver
constexpr double kParted = 0.001;        // of the smaller body's size
constexpr double kUnearned = 0.01;       // of what entered in the whole run ...
constexpr double kUnearnedNow = 0.05;    // ... and of what has entered so far, which may be little yet
constexpr double kRuin = 10;             // times what entered
constexpr double kSummingFloats = 1e-5;  // of the potential energy, which sums floats
constexpr double kSteps = 10;            // energies of one such error that add up before damping ends them: measured 1 to 2
constexpr double kMilliJoule = 1e3;
constexpr double kStepOfParticle = 11e-9,
                 kStepOfTetrahedron = 25e-9;  // s: measured on shells of 250 particles, solids of 11,448 tetrahedra

constexpr double kSlowContact = 1;  // s of one processor for a second of contact

const char* name_of(const World& w, uint32_t body) { return w.bodies.name[body].c_str(); }

// m, of the smaller of two bodies.
double smaller_size(const World& w, uint32_t a, uint32_t b) {
    return 2 * std::min(w.meshes.info[w.bodies.mesh[a]].radius, w.meshes.info[w.bodies.mesh[b]].radius);
}

struct Overlap {
    uint32_t a, b;
    double depth, share;  // m, of the smaller body's size
};

// s of one processor, of a step of a deformable body alone.
double seconds_of_step(const World& w, uint32_t body) {
    const uint32_t mesh = w.bodies.mesh[body];
    const double tetrahedra = mesh < w.solids.info.size() ? w.solids.info[mesh].count : 0;
    return kStepOfParticle * w.bodies.particles[body].count + kStepOfTetrahedron * tetrahedra;
}

// kg, of a body that moves; else 0.
double moving_mass(const World& w, uint32_t body) {
    const auto own = std::ranges::find(w.bodies.rigid_mass, uint64_t{body}, &RigidMass::body);
    double mass = own == w.bodies.rigid_mass.end() ? 0 : own->mass;
    for (uint32_t p = w.bodies.particles[body].first; p < w.bodies.particles[body].end(); ++p)
        if (w.particles.offset[p].w > 0) mass += 1 / static_cast<double>(w.particles.offset[p].w);
    return mass;
}

// J, the most that parting a pair takes: to strain the softer body, a ball as large as the smaller one, by the overlap over its
// radius, and to lift both.
double parting_work(const World& w, const Overlap& o) {
    const double radius = 0.5 * o.depth / o.share, volume = 4.0 / 3 * std::numbers::pi * radius * radius * radius;
    double modulus = std::numeric_limits<double>::infinity();
    for (const uint32_t body : {o.a, o.b})
        if (is_deformable(w.bodies, body)) modulus = std::min(modulus, w.bodies.tissue[body].youngs_modulus);
    const double strain = o.depth / radius, elastic = std::isfinite(modulus) ? 0.5 * modulus * strain * strain * volume : 0;
    return elastic + (moving_mass(w, o.a) + moving_mass(w, o.b)) * w.settings.gravity.norm() * o.depth;
}

// m, how far a soft or scripted body goes in the pass that follows, if contacts do not look that far ahead; else 0.
Vec3d unswept_travel(const World& w, uint32_t body) {
    const double period = static_cast<double>(w.clock.period) * 1e-3;
    Vec3d velocity = Vec3d::Zero();
    if (w.bodies.motion[body] == Motion::kKinematic) velocity = w.poses.velocity[body];
    if (is_deformable(w.bodies, body)) {
        const Range particles = w.bodies.particles[body];
        const uint32_t count = w.meshes.info[w.bodies.mesh[body]].vertices.count;
        const Particles& p = w.particles;
        for (uint32_t i = particles.first; i < particles.first + count; ++i)
            velocity += Vec3d(p.velocity_x[i], p.velocity_y[i], p.velocity_z[i]) / count;
    }
    return velocity.norm() * period > w.boxes.margin[body] ? Vec3d(velocity * period) : Vec3d::Zero();
}

// m, of a body along a direction.
double extent_along(const World& w, uint32_t body, const Vec3d& direction) {
    const Vec3d size = w.boxes.box[body].max - w.boxes.box[body].min - Vec3d::Constant(2 * w.boxes.margin[body]);
    return std::max(0.0, direction.cwiseAbs().dot(size));
}

// A body in the way of one that travels, of which the thinner may be half passed before contacts see it; or kNone.
uint32_t body_in_the_way(const World& w, uint32_t body, const Vec3d& travel) {
    Box swept = w.boxes.box[body];
    swept.min = swept.min.cwiseMin(swept.min + travel);
    swept.max = swept.max.cwiseMax(swept.max + travel);
    for (uint32_t other = 0; other < w.boxes.box.size(); ++other) {
        const Box& box = w.boxes.box[other];
        const bool meets = (swept.min.array() <= box.max.array()).all() && (box.min.array() <= swept.max.array()).all();
        if (other == body || !meets) continue;
        const Vec3d direction = travel.normalized();
        const double thin = std::min(extent_along(w, body, direction), extent_along(w, other, direction));
        if (!(travel.norm() - w.boxes.margin[body] > 0.5 * thin)) continue;
        if ((joins_islands(w.bodies.motion[body]) || joins_islands(w.bodies.motion[other]))) return other;
    }
    return kNone;
}

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

// m, how deep the middle of a body's vertices is inside another body; less than 0 if it is not.
double middle_inside(const World& w, uint32_t body, uint32_t other) {
    const Surfaces s = surfaces_of(w);
    const uint32_t count = w.meshes.info[w.bodies.mesh[body]].vertices.count;
    if (w.meshes.info[w.bodies.mesh[other]].admission == Admission::kSheet || count == 0) return -1;
    Vec3d middle = Vec3d::Zero();
    for (uint32_t v = 0; v < count; ++v) middle += vertex_position(s, body, v) / count;
    return -w.trees[w.bodies.tree[other]]->query(world_to_frame(s, other, middle)).distance;
}

// Pairs that start deeper than a share of the smaller body. Where bodies nearly coincide no vertex is deep: their middles are.
std::vector<Overlap> start_overlaps(const World& w, double deeper) {
    std::vector<Overlap> list = overlaps(w, deeper);
    for (size_t pair = 0; pair < w.pairs.a.size(); ++pair) {
        const uint32_t a = w.pairs.a[pair], b = w.pairs.b[pair];
        const double depth = std::min(middle_inside(w, a, b), middle_inside(w, b, a)), share = depth / smaller_size(w, a, b);
        const auto known = std::ranges::find_if(list, [&](const Overlap& o) { return o.a == a && o.b == b; });
        if (known == list.end() && share > deeper) list.push_back({a, b, depth, share});
        if (known != list.end() && known->share <= kStartsDeep && share > known->share) *known = {a, b, depth, share};
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

// Whether a body that is stepped implicitly takes the steps of leapfrog while it touches another (fine_steps.hpp: needs_leapfrog),
// as far as the scene decides that.
bool leaps_in_contact(const World& w, uint32_t body) {
    if (stepping_of(w.bodies, body).integrator == Integrator::kLeapfrog || w.bodies.mesh.size() < 2) return false;
    const auto turns = [&](const HandTool& tool) { return tool.inertia > 0; };
    const Range particles = w.bodies.particles[body];
    const auto is_fixed = [&](const Float4& particle) { return particle.w == 0; };
    const auto first = w.particles.offset.begin() + particles.first;
    const bool held = w.bodies.anchor_frame[body] == AnchorFrame::kWorld ||
                      std::any_of(first, first + w.meshes.info[w.bodies.mesh[body]].vertices.count, is_fixed);
    return !held || has_pressure(w.bodies, body) || self_contact_of(w.bodies, body) > 0 || !w.haptics.jaw.empty() ||
           std::ranges::any_of(w.haptics.tool, turns) || std::ranges::find(w.bodies.motion, Motion::kFree) != w.bodies.motion.end();
}

double stored(const Energy& e) { return e.kinetic + e.elastic + e.pressure + e.bending + e.links; }

// J, that rounding and contacts may give to all that forces move. Contacts leave overlaps up to their tolerance: a weight may lie
// higher or lower by it, and what moves less than it in a pass moves by an amount that no contact resolves. The place of a particle
// is a float: its springs, whose frequency is about one over the stable step, are wrong by an ulp of the body's radius.
double noise_of(const World& w) {
    const double tolerance = w.settings.contact.tolerance, creep = tolerance * w.clock.contact_rate;
    const double each = kNoise + tolerance * w.settings.gravity.norm() + 0.5 * creep * creep;  // J/kg
    double noise = 0;
    for (const RigidMass& free : w.bodies.rigid_mass) noise += each * free.mass;
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) {
        if (!is_deformable(w.bodies, b)) continue;
        const double speed = w.meshes.info[w.bodies.mesh[b]].radius * std::numeric_limits<float>::epsilon() / w.bodies.stable_dt[b];
        for (uint32_t p = w.bodies.particles[b].first; p < w.bodies.particles[b].end(); ++p)
            if (w.particles.offset[p].w > 0) noise += (each + kSteps * speed * speed) / static_cast<double>(w.particles.offset[p].w);
    }
    return noise;
}

// Whether a body sleeps or never moves.
bool rests(const World& w, uint32_t body) { return is_asleep(w.sleep, body) || w.bodies.motion[body] == Motion::kStatic; }

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
    budget_.noise = noise_of(world);
    look_at_steps(world);
}

std::vector<std::string> RunWatch::take_warnings() { return std::exchange(warnings_, {}); }

void RunWatch::after_pass(Frame& frame) {
    World& w = frame.world();
    if (w.clock.pass == 1) look_at_start(w);
    if (w.report.short_steps > 0) look_at_steps(w);
    look_at_tools(w);
    look_at_passed_surfaces(w);
    look_at_tetrahedra(w);
    look_at_crossings(w);
    look_at_unswept(w);
    follow_overlaps(w);
    if (frame.times().picture && budget_.known) look_at_energy(frame);
}

void RunWatch::look_at_start(World& w) {
    std::vector<std::string> texts;
    const std::vector<Overlap> deep = start_overlaps(w, kStartsInside);
    for (const Overlap& o : deep) {
        if (o.share > kStartsDeep)
            texts.push_back(format("\"%s\" and \"%s\" start %.3g mm inside each other, %.2g %% of the smaller one", name_of(w, o.a),
                                   name_of(w, o.b), 1e3 * o.depth, 100 * o.share));
    }
    w.report.start_overlaps += deep.size();
    for (const Overlap& o : start_overlaps(w, kParted)) {
        parting_.push_back({o.a, o.b});
        parting_left_ += parting_work(w, o);
    }
    if (!texts.empty()) warnings_.push_back(listed(texts) + ": move them apart");
}

void RunWatch::look_at_tools(const World& w) {
    tool_inside_.resize(w.haptics.tool.size(), kNone);
    for (size_t t = 0; t < tool_inside_.size(); ++t) {
        const uint32_t body = w.haptics.state[t].exit.body;
        const bool before = std::exchange(tool_inside_[t], body) != kNone;
        if (body == kNone || before) continue;
        const bool starts = w.clock.pass == 1;
        const std::string when = starts ? "" : format(" at %.3f s", static_cast<double>(w.clock.tick) * 1e-3);
        warnings_.push_back(format("the tool \"%s\" %s inside \"%s\"%s, which lets it go until it is pushed out",
                                   name_of(w, w.haptics.tool[t].body), starts ? "starts" : "is", name_of(w, body), when.c_str()));
    }
}

// Once per tool.
void RunWatch::look_at_passed_surfaces(const World& w) {
    passed_.resize(w.passed_surfaces.times.size());
    for (size_t t = 0; t < passed_.size(); ++t) {
        const bool went = w.passed_surfaces.times[t] > 0;
        if (!went || std::exchange(passed_[t], uint8_t{1})) continue;
        warnings_.push_back(
            format("the tool \"%s\" went through the surface of \"%s\" at %.3f s: it moves too far in a pass, or presses harder "
                   "than the tissue holds",
                   name_of(w, w.haptics.tool[t].body), name_of(w, w.passed_surfaces.body[t]), static_cast<double>(w.clock.tick) * 1e-3));
    }
}

// Before the first pass, which may last for hours, and again when tissue is crushed.
void RunWatch::look_at_steps(const World& w) {
    if (short_) return;
    std::vector<std::string> texts;
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) {
        if (!is_deformable(w.bodies, b)) continue;
        const double step = step_of(w, b), leap = leaps_in_contact(w, b) ? w.bodies.stable_dt[b] : 1;
        if (step < kShortStep)
            texts.push_back(format("\"%s\" takes %.3g steps a millisecond, about %.2g s of a processor for a second", name_of(w, b),
                                   1e-3 / step, seconds_of_step(w, b) / step));
        else if (leap < kShortStep && seconds_of_step(w, b) > kSlowContact * leap)
            texts.push_back(
                format("\"%s\" takes %.3g steps a millisecond while it touches another body, about %.2g s of a processor "
                       "for a second of that",
                       name_of(w, b), 1e-3 / leap, seconds_of_step(w, b) / leap));
    }
    if (texts.empty() && w.report.short_steps > 0)
        texts.push_back(format("tissue that is crushed or folds takes more than %.0f steps a millisecond", 1e-3 / kShortStep));
    if (texts.empty()) return;
    short_ = true;
    warnings_.push_back(listed(texts) + ": stiff, light or finely meshed tissue is slow");
}

// Once, of a body that comes near another.
void RunWatch::look_at_unswept(const World& w) {
    if (std::exchange(unswept_before_, w.report.unswept_bodies) == w.report.unswept_bodies || unswept_) return;
    for (uint32_t body = 0; body < w.bodies.mesh.size() && !unswept_; ++body) {
        const Vec3d travel = unswept_travel(w, body);
        const uint32_t other = travel.isZero(0) ? kNone : body_in_the_way(w, body, travel);
        if (other == kNone) continue;
        unswept_ = true;
        warnings_.push_back(
            format("\"%s\" moves %.3g mm in a contact pass at %.3f s, contacts look %.3g mm ahead: it may go through \"%s\" "
                   "unless contact.rate is higher",
                   name_of(w, body), 1e3 * travel.norm(), static_cast<double>(w.clock.tick) * 1e-3, 1e3 * w.boxes.margin[body],
                   name_of(w, other)));
    }
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

// Once, of the bodies that the first such frame found: a heap of slack shells has new ones in every frame.
void RunWatch::look_at_crossings(const World& w) {
    if (crossed_) return;
    std::vector<std::string> texts;
    for (uint32_t b = 0; b < w.self_crossings.pairs.size(); ++b) {
        if (w.self_crossings.pairs[b] == 0) continue;
        texts.push_back(format("\"%s\" crosses itself in %llu pairs of faces after %.3f s", name_of(w, b),
                               static_cast<unsigned long long>(w.self_crossings.pairs[b]), static_cast<double>(w.clock.tick) * 1e-3));
    }
    if (texts.empty()) return;
    crossed_ = true;
    warnings_.push_back(listed(texts));
}

// Of all bodies, also of those whose turn it was not and of sleeping ones.
void RunWatch::count_crossings_at_end(World& w) {
    CrossingFacesScratch scratch;
    uint64_t crossings = 0;
    w.self_crossings.pairs.resize(w.bodies.mesh.size());
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b)
        crossings += w.self_crossings.pairs[b] = count_self_crossings(surfaces_of(w), b, scratch);
    w.report.self_crossings = std::max(w.report.self_crossings, crossings);
    const auto bodies = std::ranges::count_if(w.self_crossings.pairs, [](uint64_t pairs) { return pairs > 0; });
    if (crossed_ && bodies > 1)
        warnings_.push_back(format("at the end %lld bodies cross themselves, in %llu pairs of faces", static_cast<long long>(bodies),
                                   static_cast<unsigned long long>(crossings)));
    look_at_crossings(w);
}

void RunWatch::follow_overlaps(const World& w) {
    const double push_before = std::exchange(push_, w.energy.work_push);
    const auto before = [&](uint32_t a, uint32_t b) {
        return std::ranges::find(overlapping_, std::array<uint32_t, 2>{a, b}, &LastingOverlap::pair);
    };
    std::vector<LastingOverlap> still;
    for (const Overlap& o : overlaps(w, kLeftInside)) {
        const auto known = before(o.a, o.b);
        still.push_back({{o.a, o.b}, o.depth, o.share, known == overlapping_.end() ? w.clock.tick - w.clock.period : known->since});
    }
    // detection leaves out pairs that rest: they are as deep as when they fell asleep
    for (const LastingOverlap& o : overlapping_)
        if (rests(w, o.pair[0]) && rests(w, o.pair[1]) && std::ranges::find(still, o.pair, &LastingOverlap::pair) == still.end())
            still.push_back(o);
    overlapping_ = std::move(still);
    if (parting_.empty()) return;
    const double parting = std::clamp(w.energy.work_push - push_before, 0.0, parting_left_);
    budget_.parting += parting, parting_left_ -= parting;
    const std::vector<Overlap> inside = overlaps(w, kParted);
    std::erase_if(parting_, [&](const auto& pair) {
        return std::ranges::none_of(inside, [&](const Overlap& o) { return o.a == pair[0] && o.b == pair[1]; });
    });
}

void RunWatch::look_at_energy(Frame& frame) {
    World& w = frame.world();
    const Energy& e = w.energy;
    EnergyBudget& b = budget_;
    b.least_gravity = std::min(b.least_gravity, e.gravity);
    b.hand = std::max(b.hand, e.work_hand);
    b.links = std::max(b.links, e.work_links);
    const double numeric_before = std::exchange(numeric_, e.work_numeric);
    if (!w.pools.slots.empty()) b.parting += std::max(0.0, e.work_numeric - numeric_before);
    const double noise = kSummingFloats * std::max(std::abs(e.gravity), std::abs(b.start_gravity)) + b.noise;
    const double entered = b.entered(), height = e.gravity - b.start_gravity;
    // position correction moves what a hand holds or pushes: part of it is the hand's work, which contact may take again
    const double taken = entered + std::max(0.0, e.work_push);
    struct Term {
        double beyond;  // J, more than can be
        const char* what;
        double energy;
    };
    const Term terms[] = {{stored(e) + height - (b.start + b.hand + b.links + b.parting), "the energy", stored(e) + std::max(0.0, height)},
                          {std::abs(e.work_contact) - taken, "the work of contact", e.work_contact},
                          {std::abs(e.work_push) - kCreep * entered, "the work of position correction", e.work_push},
                          {w.pools.slots.empty() ? std::abs(e.work_numeric) - taken : 0, "the work of implicit steps", e.work_numeric}};
    const Term& worst = *std::ranges::max_element(terms, {}, &Term::beyond);
    if (!(worst.beyond - noise > worst_unearned_)) return;
    worst_unearned_ = worst.beyond - noise;
    worst_text_ =
        format("%s is %.3g mJ after %.3f s, but only %.3g mJ entered the scene; most energy is in \"%s\"", worst.what,
               kMilliJoule * worst.energy, static_cast<double>(w.clock.tick) * 1e-3, kMilliJoule * entered, name_of(w, most_energetic(w)));
    if (worst_unearned_ > kRuin * entered && ruin_.empty()) ruin_ = worst_text_ + format(": more than %.0f times as much", kRuin);
    if (worst_unearned_ > kUnearnedNow * entered) warn_of_energy(w);
}

void RunWatch::warn_of_energy(World& w) {
    ++w.report.unearned_energy;
    if (!std::exchange(unearned_, true) && ruin_.empty()) warnings_.push_back(worst_text_);
}

void RunWatch::finish(World& w) {
    if (!unearned_ && worst_unearned_ > kUnearned * budget_.entered()) warn_of_energy(w);
    std::vector<std::string> texts;
    for (const LastingOverlap& o : overlapping_) {
        if (w.clock.tick - o.since < kLeftFor) continue;
        texts.push_back(format("\"%s\" and \"%s\" are left %.3g mm inside each other, %.2g %% of the smaller one", name_of(w, o.pair[0]),
                               name_of(w, o.pair[1]), 1e3 * o.depth, 100 * o.share));
    }
    w.report.left_overlaps = texts.size();
    if (!texts.empty()) warnings_.push_back(listed(texts));
    count_crossings_at_end(w);
}

}  // namespace trocar
