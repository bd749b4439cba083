#include "systems/prepare/sleep.hpp"

#include <algorithm>
#include <cmath>

#include "engine/base/disjoint_sets.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/mesh/mass_properties.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {
namespace {

// Whether the root mean square speed of a body's moving particles is at most `speed` and none is ten times as
// fast; false if a velocity is not finite.
bool is_slow(const Particles& p, Range range, double speed) {
    double sum = 0;
    float fastest = 0;
    uint32_t moving = 0;  // neither pinned nor padding
    for (uint32_t i = range.first; i < range.end(); ++i) {
        const float x = p.velocity_x[i], y = p.velocity_y[i], z = p.velocity_z[i], v2 = x * x + y * y + z * z;
        sum += static_cast<double>(v2);
        fastest = std::max(fastest, v2);
        moving += p.offset[i].w > 0;
    }
    return sum <= speed * speed * moving && static_cast<double>(fastest) < 100 * speed * speed;
}

// Zeroes the velocities of a body. Returns their kinetic energy, J.
double stop(Particles& p, Range range) {
    double energy = 0;
    for (uint32_t i = range.first; i < range.end(); ++i) {
        const double x = p.velocity_x[i], y = p.velocity_y[i], z = p.velocity_z[i];
        if (p.offset[i].w > 0) energy += 0.5 * (x * x + y * y + z * z) / p.offset[i].w;
        p.velocity_x[i] = p.velocity_y[i] = p.velocity_z[i] = 0;
    }
    return energy;
}

double twice_kinetic_energy(const RigidMass& free, const Poses& poses) {
    const Quat& turn = poses.orientation[free.body];
    const Vec3d& spin = poses.angular_velocity[free.body];
    const Vec3d velocity = poses.velocity[free.body] + spin.cross(rotate(turn, free.centre));
    const Vec3d about_axes = rotate_back(multiply(turn, free.axes), spin);
    return free.mass * velocity.squaredNorm() + free.moments.dot(about_axes.cwiseProduct(about_axes));
}

bool may_sleep(const Bodies& bodies, uint32_t body) { return is_deformable(bodies, body) || bodies.motion[body] == Motion::kFree; }

// Zeroes the velocities of a body. Returns their kinetic energy, J.
double stop(const Bodies& bodies, uint32_t body, Particles& particles, Poses& poses) {
    particles.last_dt[body] = 0;
    if (is_deformable(bodies, body)) return stop(particles, bodies.particles[body]);
    const double energy = 0.5 * twice_kinetic_energy(*find_rigid_mass(bodies, body), poses);
    poses.velocity[body] = poses.angular_velocity[body] = Vec3d::Zero();
    return energy;
}

// Updates the time for which every awake body has been slow, ms.
void note_slow_bodies(const SleepPass& pass, const Particles& particles, const Poses& poses, Sleep& sleep) {
    const Bodies& bodies = pass.bodies;
    const double speed = pass.settings.sleep_speed;
    const auto note = [&](uint32_t body, bool slow) {
        sleep.still[body] = slow ? std::min(sleep.still[body] + pass.period, uint32_t{1} << 30) : 0;
    };
    const auto is_relaxed = [&](uint32_t body) {
        const RelaxingBody* relaxing = find_relaxing(pass.relaxation, body);
        return !relaxing || strain_to_relax(pass.relaxation, *relaxing, pass.springs, bodies.mesh[body]) <= kRelaxedStrain;
    };
    for (uint32_t b = 0; b < bodies.motion.size(); ++b)
        if (is_deformable(bodies, b) && !is_asleep(sleep, b)) note(b, is_slow(particles, bodies.particles[b], speed) && is_relaxed(b));
    for (const RigidMass& free : bodies.rigid_mass) {
        const uint32_t b = static_cast<uint32_t>(free.body);
        const double twice = twice_kinetic_energy(free, poses);
        if (!is_asleep(sleep, b))
            note(b, twice <= free.mass * speed * speed);
        else if (twice != 0)
            sleep.still[b] = 0;  // another body pushed it
    }
}

// Bodies that scripts move now or soon, and those that drives move.
void find_moving(const SleepPass& pass, std::vector<uint8_t>& moving) {
    const Paths& paths = pass.paths;
    moving.assign(pass.bodies.mesh.size(), 0);
    const double soon = 2 * (pass.period * 1e-3);
    for (size_t p = 0; p < paths.body.size(); ++p) {
        if (paths.body[p] == kNone || paths.keys[p].count == 0) continue;
        moving[paths.body[p]] = pass.now <= paths.key[paths.keys[p].end() - 1].time + soon;
    }
    for (const NodeDrive& drive : pass.drives) moving[drive.body] = 1;
}

// Finds groups of bodies whose boxes meet, and which of them contain a moving body.
void find_groups(const SleepPass& pass, const Sleep& sleep, const BroadPhasePairs& pairs, SleepScratch& s) {
    const Bodies& bodies = pass.bodies;
    const uint32_t count = static_cast<uint32_t>(bodies.motion.size());
    s.parent.resize(count);
    s.restless.resize(count);
    const double enough = pass.settings.sleep_after * 1e3;
    const auto lies_anyway = [&](uint32_t b) {
        return bodies.motion[b] == Motion::kStatic || (bodies.motion[b] == Motion::kKinematic && !s.moving[b]);
    };
    for (uint32_t b = 0; b < count; ++b) {
        s.parent[b] = b;
        s.restless[b] = may_sleep(bodies, b) ? s.moving[b] || sleep.still[b] < enough : !lies_anyway(b);
    }
    const auto join = [&](uint32_t body, uint32_t other) {
        if (!lies_anyway(body) && !lies_anyway(other)) join_sets(s.parent, body, other);
    };
    for (size_t i = 0; i < pairs.a.size(); ++i) join(pairs.a[i], pairs.b[i]);
    for (const auto& [body, other] : pass.joined) join(body, other);
    for (uint32_t b = 0; b < count; ++b) {
        if (s.restless[b]) s.restless[find_set(s.parent, b)] = 1;
    }
}

}  // namespace

double strain_to_relax(const Relaxation& relaxation, const RelaxingBody& body, const Springs& springs, uint32_t prototype) {
    const size_t first = size_t{kSliceWidth} * springs.slice_column[springs.info[prototype].slices.first + prototype];
    double sum = 0;
    uint32_t ends = 0;
    for (uint32_t at = 0; at < body.count; ++at) {
        const float rest = springs.rest_length[first + at];
        if (!(rest > 0)) continue;  // padding
        double tension = 0;
        for (uint32_t b = 0; b < body.branches; ++b)
            tension +=
                std::abs(double{relaxation.overstretch[body.first_branch + size_t{b} * body.count + at]});  // they may pull opposite ways
        sum += tension * tension / (double{rest} * rest), ++ends;
    }
    return ends > 0 ? std::sqrt(sum / ends) : 0;
}

void fall_asleep_and_wake(const SleepPass& pass, SleepScratch& s, Sleep& sleep, Particles& particles, Poses& poses, BroadPhasePairs& pairs,
                          Energy& energy, Report& report) {
    const Bodies& bodies = pass.bodies;
    const uint32_t count = static_cast<uint32_t>(bodies.motion.size());
    sleep.still.resize(count, 0);
    sleep.group.resize(count, kNone);
    note_slow_bodies(pass, particles, poses, sleep);
    find_moving(pass, s.moving);
    find_groups(pass, sleep, pairs, s);
    report.awake_bodies = report.asleep_bodies = 0;
    for (uint32_t b = 0; b < count; ++b) {
        if (!may_sleep(bodies, b)) continue;
        const uint32_t root = find_set(s.parent, b);
        const bool sleeps = !s.restless[root], slept = is_asleep(sleep, b);
        if (sleeps && !slept) energy.work_numeric -= stop(bodies, b, particles, poses);
        if (!sleeps && slept) sleep.still[b] = 0;
        sleep.group[b] = sleeps ? root : kNone;
        if (is_away(pass.spawning, b)) continue;
        ++(sleeps ? report.asleep_bodies : report.awake_bodies);
    }
    const auto is_awake = [&](uint32_t b) { return s.restless[find_set(s.parent, b)] != 0; };
    size_t kept = 0;
    for (size_t i = 0; i < pairs.a.size(); ++i) {
        if (!is_awake(pairs.a[i]) && !is_awake(pairs.b[i])) continue;
        pairs.a[kept] = pairs.a[i], pairs.b[kept] = pairs.b[i];
        ++kept;
    }
    pairs.a.resize(kept);
    pairs.b.resize(kept);
}

}  // namespace trocar
