#include "engine/kernels/spring_kernels.hpp"

#include <gtest/gtest.h>

#include <cstring>
#include <random>

#include "tests/systems/advance/tissue/spring_graph.hpp"
namespace trocar {
namespace {

// Random arrays of one body: ragged slices, padding, fixed particles, springs of length zero and of rest length zero.
struct RandomBody {
    std::vector<Float4> offset, next;
    std::vector<float> velocity[3], stiffness, rest[3], rest_length, remainder[3], force[3];
    std::vector<unsigned> column, neighbour;
    std::vector<unsigned short> packed;
    SpringStep step{};
    unsigned slices;

    explicit RandomBody(unsigned slices_, unsigned seed) : slices(slices_) {
        std::mt19937 random(seed);
        std::uniform_real_distribution<float> unit(-1, 1);
        const unsigned n = 16 * slices;
        for (unsigned i = 0; i < n; ++i) {
            offset.push_back({unit(random), unit(random), unit(random), i % 7 == 3 ? 0.0f : 100 + 50 * unit(random)});
            for (auto& v : velocity) v.push_back(unit(random));
            // a slice without anchors, and one with anchors in its second half only
            const bool loose = i / 16 == 3 || (i / 16 == 4 && i % 16 < 8);
            stiffness.push_back(i % 5 == 0 || loose ? 0.0f : 2 + unit(random));
            for (auto& r : rest) r.push_back(unit(random));
        }
        for (unsigned i = 0; i + 9 < n; i += 40) offset[i + 9] = {offset[i].x, offset[i].y, offset[i].z, offset[i + 9].w};
        column.push_back(0);
        for (unsigned s = 0; s < slices; ++s) {
            const unsigned columns = random() % 9;
            for (unsigned c = 0; c < columns; ++c) {
                for (unsigned lane = 0; lane < 16; ++lane) {
                    const unsigned self = 16 * s + lane;
                    const unsigned far_end = c == 0 ? (self + 9) % n : random() % n;
                    neighbour.push_back(random() % 4 == 0 ? self : far_end);
                    rest_length.push_back(random() % 5 == 0 ? 0.0f : 0.5f + 0.3f * unit(random));
                }
            }
            column.push_back(column.back() + columns);
        }
        next.resize(n);
        for (auto& r : remainder)
            for (unsigned i = 0; i < n; ++i) r.push_back(i % 7 == 3 ? 0.0f : 3e-8f * unit(random));
        for (auto& f : force)
            for (unsigned i = 0; i < n; ++i) f.push_back(0.3f * unit(random));
        step.slice_column = column.data();
        step.neighbour = neighbour.data();
        step.rest_length = rest_length.data();
        step.anchor_stiffness = stiffness.data();
        step.anchor_x = rest[0].data(), step.anchor_y = rest[1].data(), step.anchor_z = rest[2].data();
        const float turn[9] = {0.36f, 0.48f, -0.8f, -0.8f, 0.6f, 0, 0.48f, 0.64f, 0.6f};
        std::memcpy(step.turn, turn, sizeof turn);
        for (int i = 0; i < 3; ++i) {
            step.centre[i] = unit(random), step.centre_rest[i] = 1e-8f * unit(random);
            step.drag_velocity[i] = unit(random), step.drag_turn[i] = unit(random), step.gravity[i] = 9 * unit(random);
        }
        step.stiffness = 20, step.dt = 1e-3f, step.kick_dt = 0.9e-3f, step.keep = 0.98f, step.back = 0.03f;
        step.kick_less = -2e-5f;
    }
    // Rest lengths in units of 2^-16 m, and the columns again in packed form.
    void pack() {
        packed.resize(2 * neighbour.size());
        for (size_t h = 0; h < neighbour.size(); ++h) {
            const unsigned slice = static_cast<unsigned>(std::upper_bound(column.begin(), column.end(), h / 16) - column.begin()) - 1;
            const unsigned units = static_cast<unsigned>(rest_length[h] * 65536);
            rest_length[h] = static_cast<float>(units) * 0x1p-16f;
            packed[h / 16 * 32 + h % 16] = static_cast<unsigned short>(neighbour[h] + 32768 - 16 * slice);
            packed[h / 16 * 32 + 16 + h % 16] = static_cast<unsigned short>(units);
        }
        step.rest_unit = 0x1p-16f;
    }
    SpringStep bound() {
        SpringStep s = step;
        s.offset = &offset[0].x, s.new_offset = &next[0].x;
        s.velocity_x = velocity[0].data(), s.velocity_y = velocity[1].data(), s.velocity_z = velocity[2].data();
        s.new_velocity_x = velocity[0].data(), s.new_velocity_y = velocity[1].data();
        s.new_velocity_z = velocity[2].data();
        return s;
    }
    SpringStep bound_with_remainders() {
        SpringStep s = bound();
        s.remainder_x = remainder[0].data(), s.remainder_y = remainder[1].data(), s.remainder_z = remainder[2].data();
        return s;
    }
    void add_forces(SpringStep& s) const { s.force_x = force[0].data(), s.force_y = force[1].data(), s.force_z = force[2].data(); }
};

bool have_avx512() { return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq"); }

// Breaks when one of the two has a different order of operations, a contraction by the compiler or an
// approximate root.
TEST(SpringKernels, Avx2AndAvx512GiveTheSameBits) {
    if (!have_avx512()) GTEST_SKIP() << "no AVX-512 here";
    for (unsigned seed = 1; seed <= 20; ++seed) {
        RandomBody a(13, seed), b(13, seed);
        std::vector<double> work_a(16, 0.0), work_b(16, 0.0), sums_a(kShapeSums * 16, 0.0), sums_b(kShapeSums * 16, 0.0),
            energy_a(kEnergySums * 16, 0.0), energy_b(kEnergySums * 16, 0.0);
        const bool carried = seed % 2 == 0;
        SpringStep sa = carried ? a.bound_with_remainders() : a.bound(), sb = carried ? b.bound_with_remainders() : b.bound();
        if (seed % 3 == 0) a.add_forces(sa), b.add_forces(sb);
        kSpringKernelsAvx2.shape_sums(&sa, 0, 13, sums_a.data());
        kSpringKernelsAvx512.shape_sums(&sb, 0, 13, sums_b.data());
        kSpringKernelsAvx2.energy_sums(&sa, 0, 13, energy_a.data());
        kSpringKernelsAvx512.energy_sums(&sb, 0, 13, energy_b.data());
        kSpringKernelsAvx2.step(&sa, 0, 13, work_a.data());
        kSpringKernelsAvx512.step(&sb, 0, 13, work_b.data());
        EXPECT_EQ(0, std::memcmp(a.next.data(), b.next.data(), a.next.size() * sizeof(Float4)));
        for (int i = 0; i < 3; ++i) EXPECT_EQ(a.velocity[i], b.velocity[i]);
        for (int i = 0; i < 3; ++i) EXPECT_EQ(a.remainder[i], b.remainder[i]);
        EXPECT_EQ(work_a, work_b);
        EXPECT_EQ(sums_a, sums_b);
        EXPECT_EQ(energy_a, energy_b);
    }
}

// Columns in 16 bits give the same result.
TEST(SpringKernels, PackedColumnsGiveTheSameBits) {
    for (const SpringKernels* kernels : {&kSpringKernelsAvx2, &kSpringKernelsAvx512}) {
        if (kernels == &kSpringKernelsAvx512 && !have_avx512()) continue;
        RandomBody a(13, 4), b(13, 4);
        a.pack(), b.pack();
        SpringStep sa = a.bound(), sb = b.bound();
        sb.packed = b.packed.data();
        sb.neighbour = nullptr, sb.rest_length = nullptr;  // not read
        kernels->step(&sa, 0, 13, nullptr);
        kernels->step(&sb, 0, 13, nullptr);
        EXPECT_EQ(0, std::memcmp(a.next.data(), b.next.data(), a.next.size() * sizeof(Float4)));
        for (int i = 0; i < 3; ++i) EXPECT_EQ(a.velocity[i], b.velocity[i]);
    }
}

// Packing rounds rest lengths to 1/65535 of the longest; both copies give the same springs.
TEST(PackSprings, StepsAndReferenceSeeTheSameLengths) {
    for (const uint32_t n : {40u, 190u}) {  // only columns of the second exceed kPackBeyond
        AdvanceScene s;
        add_graph(s, sheet_graph(n, 0.2, 0.08, 50));
        if (n == 40) {
            EXPECT_EQ(s.springs.info[0].packed, kNone);
            pack_springs(s.springs, 0, 0);
        }
        const SpringInfo& info = s.springs.info[0];
        ASSERT_EQ(info.packed, 0u);
        const double h = 0.2 / (n - 1);
        for (size_t i = 0; i < s.springs.rest_length.size(); ++i) {
            const double rest = s.springs.rest_length[i];
            const double off = std::min({rest, std::abs(rest - h), std::abs(rest - std::sqrt(2) * h)});
            EXPECT_LT(off, 0.5001 * info.rest_unit) << i;
        }
        const Particles start = s.particles;
        s.advance(2, 20);
        const std::vector<Float4> packed = s.particles.offset;
        s.particles = start;
        s.springs.info[0].packed = kNone;
        s.params.tick = 0;
        s.advance(2, 20);
        EXPECT_EQ(0, std::memcmp(packed.data(), s.particles.offset.data(), packed.size() * sizeof(Float4)));
    }
}

TEST(PackSprings, FarEndsBeyondSixteenBitsAreLeftAsTheyAre) {
    SpringGraph graph;
    for (uint32_t i = 0; i < 40000; ++i) graph.position.push_back({i * 1e-3, 0, 0}), graph.mass.push_back(1e-3);
    graph.edge = {{0, 1}, {5, 39999}};
    AdvanceScene s;
    add_graph(s, graph);
    const std::vector<float> before = s.springs.rest_length;
    pack_springs(s.springs, 0, 0);
    EXPECT_EQ(s.springs.info[0].packed, kNone);
    EXPECT_EQ(s.springs.rest_length, before);
}

// Position plus remainder is the exact sum of position, remainder and displacement, up to the rounding of the
// remainder itself.
TEST(SpringKernels, RemaindersKeepWhatRoundingLeavesOut) {
    RandomBody body(9, 6);
    const RandomBody before(9, 6);
    const SpringStep step = body.bound_with_remainders();
    spring_kernels().step(&step, 0, 9, nullptr);
    double largest = 0;
    for (unsigned i = 0; i < 16 * 9; ++i) {
        const float* from = &before.offset[i].x;
        const float* to = &body.next[i].x;
        for (int axis = 0; axis < 3; ++axis) {
            const double displacement = double(step.dt) * body.velocity[axis][i];
            const double exact = double(from[axis]) + before.remainder[axis][i] + displacement;
            EXPECT_NEAR(double(to[axis]) + body.remainder[axis][i], exact, 2e-9) << i;
            EXPECT_LE(std::abs(body.remainder[axis][i]), 6e-8f) << i;
            largest = std::max(largest, std::abs(double(to[axis]) - exact));
            if (before.offset[i].w == 0) {
                EXPECT_EQ(to[axis], from[axis]);
            }
        }
    }
    EXPECT_GT(largest, 1e-8) << "without remainders it would be lost";
}

// Any partition of the slices gives the same particles, as parallel chunks require.
TEST(SpringKernels, SlicesDoNotDependOnEachOther) {
    RandomBody a(12, 3), b(12, 3);
    const SpringStep sa = a.bound(), sb = b.bound();
    spring_kernels().step(&sa, 0, 12, nullptr);
    spring_kernels().step(&sb, 7, 12, nullptr);
    spring_kernels().step(&sb, 0, 7, nullptr);
    EXPECT_EQ(0, std::memcmp(a.next.data(), b.next.data(), a.next.size() * sizeof(Float4)));
    EXPECT_EQ(a.velocity[2], b.velocity[2]);
}

// Every term against a plain loop in double. Breaks when a term is dropped, a sign is wrong or axes are
// swapped; here forces of other families change velocities of 1 m/s by up to 0.05.
void expect_step_agrees_with_double(bool with_forces) {
    RandomBody body(9, 5);
    const RandomBody before(9, 5);
    SpringStep step = body.bound();
    if (with_forces) body.add_forces(step);
    std::vector<double> work(16, 0.0);
    spring_kernels().step(&step, 0, 9, work.data());
    double expected_work = 0;
    const auto row = [](const float* v) { return Vec3d(v[0], v[1], v[2]); };
    for (unsigned i = 0; i < 16 * 9; ++i) {
        const Float4& o = before.offset[i];
        const Vec3d x(o.x, o.y, o.z), v(before.velocity[0][i], before.velocity[1][i], before.velocity[2][i]);
        Vec3d f = Vec3d::Zero();
        for (unsigned c = before.column[i / 16]; c < before.column[i / 16 + 1]; ++c) {
            const unsigned j = before.neighbour[16 * c + i % 16];
            const Vec3d d = Vec3d(before.offset[j].x, before.offset[j].y, before.offset[j].z) - x;
            if (d.norm() > 0) f += step.stiffness * (1 - before.rest_length[16 * c + i % 16] / d.norm()) * d;
        }
        const Vec3d rest(before.rest[0][i], before.rest[1][i], before.rest[2][i]);
        const Vec3d goal = Vec3d(row(step.turn).dot(rest), row(step.turn + 3).dot(rest), row(step.turn + 6).dot(rest)) + row(step.centre) +
                           row(step.centre_rest);
        f += before.stiffness[i] * (goal - x);
        if (with_forces) f += Vec3d(before.force[0][i], before.force[1][i], before.force[2][i]);
        const Vec3d drag = row(step.drag_velocity) + row(step.drag_turn).cross(x);
        const Vec3d lost = (step.keep - 1.0) * (v - drag);
        Vec3d expected = v + lost + step.kick_dt * (f * o.w + row(step.gravity));
        if (o.w == 0) expected.setZero();
        const Vec3d got(body.velocity[0][i], body.velocity[1][i], body.velocity[2][i]);
        EXPECT_LT((got - expected).norm(), 3e-5) << i;  // accelerations to 3e4 m/s^2, kicks to 30 m/s
        const Float4& n = body.next[i];
        EXPECT_LT((Vec3d(n.x, n.y, n.z) - (x + step.dt * got)).norm(), 3e-7) << i;
        EXPECT_EQ(n.w, o.w);
        const Vec3d taken = lost + step.kick_less * (f * o.w + row(step.gravity));
        if (o.w > 0) expected_work += taken.dot(v + expected) / (2 * o.w);
    }
    double total = 0;
    for (const double w : work) total += w;
    EXPECT_NEAR(total, expected_work, 1e-5 * std::abs(expected_work));
}
TEST(SpringKernels, StepAgreesWithDouble) { expect_step_agrees_with_double(false); }
TEST(SpringKernels, StepWithOtherForcesAgreesWithDouble) { expect_step_agrees_with_double(true); }

TEST(SpringKernels, ShapeSumsAgreeWithDouble) {
    RandomBody body(6, 9);
    const SpringStep step = body.bound();
    std::vector<double> lanes(kShapeSums * 16, 0.0), expected(kShapeSums, 0.0), got(kShapeSums, 0.0);
    spring_kernels().shape_sums(&step, 0, 6, lanes.data());
    for (int s = 0; s < kShapeSums; ++s) {
        for (int lane = 0; lane < 16; ++lane) got[s] += lanes[16 * s + lane];
    }
    for (unsigned i = 0; i < 96; ++i) {
        const double k = body.stiffness[i], m = body.offset[i].w > 0 ? 1.0 / body.offset[i].w : 0;
        const Vec3d v(body.velocity[0][i], body.velocity[1][i], body.velocity[2][i]);
        const Vec3d x = Vec3d(body.offset[i].x, body.offset[i].y, body.offset[i].z) - double(step.back) * v;
        const Vec3d l = x.cross(v);
        const Vec3d r(body.rest[0][i], body.rest[1][i], body.rest[2][i]);
        expected[kSumK] += k, expected[kSumM] += m;
        for (int a = 0; a < 3; ++a) {
            expected[kSumKx + a] += k * x[a], expected[kSumKr + a] += k * r[a], expected[kSumMx + a] += m * x[a];
            expected[kSumMv + a] += m * v[a], expected[kSumL + a] += m * l[a], expected[kSumMxx + a] += m * x[a] * x[a];
            for (int b = 0; b < 3; ++b) expected[kSumKxr + 3 * a + b] += k * x[a] * r[b];
        }
        expected[kSumMxx + 3] += m * x[0] * x[1], expected[kSumMxx + 4] += m * x[0] * x[2];
        expected[kSumMxx + 5] += m * x[1] * x[2];
    }
    for (int s = 0; s < kShapeSums; ++s) EXPECT_NEAR(got[s], expected[s], 1e-12) << s;
}

// Breaks when a half-edge is counted once, a fixed particle's mass counts, or a position is taken at the
// wrong time.
TEST(SpringKernels, EnergySumsAgreeWithDouble) {
    RandomBody body(6, 11);
    const SpringStep step = body.bound();
    std::vector<double> lanes(kEnergySums * 16, 0.0), expected(kEnergySums, 0.0), got(kEnergySums, 0.0);
    spring_kernels().energy_sums(&step, 0, 6, lanes.data());
    for (int s = 0; s < kEnergySums; ++s) {
        for (int lane = 0; lane < 16; ++lane) got[s] += lanes[16 * s + lane];
    }
    const auto velocity = [&](unsigned i) { return Vec3d(body.velocity[0][i], body.velocity[1][i], body.velocity[2][i]); };
    const auto position = [&](unsigned i) -> Vec3d {
        return Vec3d(body.offset[i].x, body.offset[i].y, body.offset[i].z) - double(step.back) * velocity(i);
    };
    const auto row = [](const float* v) { return Vec3d(v[0], v[1], v[2]); };
    for (unsigned i = 0; i < 96; ++i) {
        for (unsigned c = body.column[i / 16]; c < body.column[i / 16 + 1]; ++c) {
            const double length = (position(body.neighbour[16 * c + i % 16]) - position(i)).norm();
            expected[kSumStretch] += std::pow(length - body.rest_length[16 * c + i % 16], 2);
        }
        const Vec3d rest(body.rest[0][i], body.rest[1][i], body.rest[2][i]);
        const Vec3d goal = Vec3d(row(step.turn).dot(rest), row(step.turn + 3).dot(rest), row(step.turn + 6).dot(rest)) + row(step.centre) +
                           row(step.centre_rest);
        expected[kSumAnchor] += body.stiffness[i] * (goal - position(i)).squaredNorm();
        if (!(body.offset[i].w > 0)) continue;
        const double m = 1.0 / body.offset[i].w;
        expected[kSumMvv] += m * velocity(i).squaredNorm();
        expected[kSumMass] += m;
        for (int a = 0; a < 3; ++a) expected[kSumMPosition + a] += m * position(i)[a];
    }
    for (int s = 0; s < kEnergySums; ++s) EXPECT_NEAR(got[s], expected[s], s < kSumMvv ? 1e-4 : 1e-12) << s;
}

}  // namespace
}  // namespace trocar
