#include "systems/deformable_energy.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/best_fit_rotation.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/surfaces.hpp"
namespace trocar {
namespace {

// A body half a substep back, where its velocities are.
struct BodyState {
    const Particles& particles;
    Range rows;
    double back;  // s
    Vec3d velocity(uint32_t v) const {
        const uint32_t p = rows.first + v;
        return {particles.velocity_x[p], particles.velocity_y[p], particles.velocity_z[p]};
    }
    Vec3d offset(uint32_t v) const {
        const Float4& o = particles.offset[rows.first + v];
        return Vec3d(o.x, o.y, o.z) - back * velocity(v);
    }
    double inv_mass(uint32_t v) const { return particles.offset[rows.first + v].w; }
};

double spring_energy(const Springs& springs, uint32_t prototype, double stiffness, const BodyState& state) {
    const Range slices = springs.info[prototype].slices;
    const uint32_t* column = springs.slice_column.data() + slices.first + prototype;
    double sum = 0;
    for (uint32_t v = 0; v < state.rows.count; ++v) {
        const uint32_t slice = v / kSliceWidth, lane = v % kSliceWidth;
        const Vec3d x = state.offset(v);
        for (uint32_t c = column[slice]; c < column[slice + 1]; ++c) {
            const uint32_t far_end = springs.neighbour[c * kSliceWidth + lane];
            if (far_end <= v) continue;  // each spring once; padding names itself
            const double stretch = (state.offset(far_end) - x).norm() - springs.rest_length[c * kSliceWidth + lane];
            sum += stretch * stretch;
        }
    }
    return 0.5 * stiffness * sum;
}

Vec3d rest_of(const Anchors& anchors, uint32_t p) { return {anchors.rest_x[p], anchors.rest_y[p], anchors.rest_z[p]}; }

// Goal of a rest position r is centre + turn * r.
struct GoalFrame {
    Vec3d centre = Vec3d::Zero();
    std::array<Vec3d, 3> turn = rotation_rows({});
    Vec3d goal(const Vec3d& r) const { return centre + Vec3d(turn[0].dot(r), turn[1].dot(r), turn[2].dot(r)); }
};

GoalFrame best_fit_frame(const Anchors& anchors, const BodyState& state, const Quat& start) {
    Vec3d sum_x = Vec3d::Zero(), sum_r = Vec3d::Zero();
    std::array<Vec3d, 3> a;
    a.fill(Vec3d::Zero());
    double stiffness = 0;
    for (uint32_t v = 0; v < state.rows.count; ++v) {
        const double k = anchors.stiffness[state.rows.first + v];
        const Vec3d x = state.offset(v), r = rest_of(anchors, state.rows.first + v);
        stiffness += k;
        sum_x += k * x;
        sum_r += k * r;
        for (int i = 0; i < 3; ++i) a[i] += k * x[i] * r;
    }
    GoalFrame frame;
    if (!(stiffness > 0)) return frame;
    for (int i = 0; i < 3; ++i) a[i] -= sum_x[i] / stiffness * sum_r;
    frame.turn = rotation_rows(best_fit_rotation(a, start));
    const Vec3d rest = sum_r / stiffness;
    frame.centre = sum_x / stiffness - (frame.goal(rest) - frame.centre);
    return frame;
}

double anchor_energy(const Anchors& anchors, const BodyState& state, const GoalFrame& frame) {
    double sum = 0;
    for (uint32_t v = 0; v < state.rows.count; ++v) {
        const uint32_t p = state.rows.first + v;
        if (anchors.stiffness[p] > 0) {
            sum += anchors.stiffness[p] * (frame.goal(rest_of(anchors, p)) - state.offset(v)).squaredNorm();
        }
    }
    return 0.5 * sum;
}

BodyState state_of(const Bodies& bodies, const Particles& particles, uint32_t body) {
    return {particles, bodies.particles[body], 0.5 * particles.last_dt[body]};
}

}  // namespace

void measure_energy(const Springs& springs, const Bodies& bodies, const Poses& poses, const Particles& particles,
                    const Anchors& anchors, const Vec3d& gravity, double start, Energy& energy) {
    energy.kinetic = energy.elastic = energy.gravity = 0;
    for (uint32_t body = 0; body < bodies.motion.size(); ++body) {
        if (!is_deformable(bodies, body)) continue;
        const BodyState state = state_of(bodies, particles, body);
        for (uint32_t v = 0; v < state.rows.count; ++v) {
            if (!(state.inv_mass(v) > 0)) continue;
            energy.kinetic += 0.5 * state.velocity(v).squaredNorm() / state.inv_mass(v);
            energy.gravity -= gravity.dot(poses.origin[body] + state.offset(v)) / state.inv_mass(v);
        }
        const GoalFrame frame = bodies.anchor_frame[body] == AnchorFrame::kShape
                                    ? best_fit_frame(anchors, state, poses.orientation[body])
                                    : GoalFrame{};
        energy.elastic += spring_energy(springs, bodies.mesh[body], bodies.spring_stiffness[body], state) +
                          anchor_energy(anchors, state, frame);
    }
    energy.balance = energy.kinetic + energy.elastic + energy.gravity - energy.work_hand - energy.work_contact -
                     energy.work_damping - energy.work_push - start;
}

Momentum measure_momentum(const Bodies& bodies, const Poses& poses, const Particles& particles, uint32_t body) {
    const BodyState state = state_of(bodies, particles, body);
    Momentum sum;
    for (uint32_t v = 0; v < state.rows.count; ++v) {
        if (!(state.inv_mass(v) > 0)) continue;
        const Vec3d momentum = state.velocity(v) / state.inv_mass(v);
        sum.linear += momentum;
        sum.angular += (poses.origin[body] + state.offset(v)).cross(momentum);
    }
    return sum;
}

}  // namespace trocar
