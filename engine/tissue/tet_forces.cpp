#include "engine/tissue/tet_forces.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "components/springs.hpp"
#include "engine/base/cpu.hpp"
#include "engine/geometry/vec4.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/tissue/embedded_surface.hpp"
namespace trocar {
namespace {

// Groups of 16 tetrahedra per partial sum of the energy: the same chunks for any number of threads.
constexpr uint32_t kGroupsPerChunk = 256;

// Groups, and slices of nodes, per kernel call: about 4 us each.
constexpr uint32_t kGroupsPressed = 64, kSlicesGathered = 32;
constexpr uint32_t kLeastChunks = 5;  // fewer do not pay for another thread

}  // namespace

const TetKernels& tet_kernels() { return kernels_of_isa(kTetKernelsAvx2, kTetKernelsAvx512); }

SolidModuli solid_moduli(const Bodies& bodies, uint32_t body) { return solid_moduli(bodies.tissue[body], law_of(bodies, body)); }

SolidModuli solid_moduli(const Tissue& tissue, TissueLaw law) {
    const double nu = tissue.poisson, mu = tissue.youngs_modulus / (2 * (1 + nu));
    const double lambda = 2 * mu * nu / (1 - 2 * nu);
    if (law == TissueLaw::kNeoHookean) return {.springs = 2.5 * mu, .bulk = lambda + 5 * mu / 6, .shear = 4 * mu / 3};
    const double bulk = std::max(0.0, lambda - mu);
    const double crush = kCrushShare * std::clamp(bulk, kLeastCrush * mu, kMostPressure * mu);
    return {2.5 * mu, bulk, crush, std::max(0.0, kLeastSqueeze * mu - bulk), std::min(1.0, kMostPressure * mu / bulk), 0};
}

bool has_tets(const Solids* solids, const Bodies& bodies, uint32_t body) { return solids && is_solid(*solids, bodies.mesh[body]); }

TetStep bind_tets(const Solids& solids, const Bodies& bodies, const Particles& particles, uint32_t body, const TornSprings* torn) {
    const uint32_t prototype = bodies.mesh[body];
    const SolidInfo& info = solids.info[prototype];
    const SolidModuli moduli = solid_moduli(bodies, body);
    const uint32_t first = info.tetrahedra.first;
    TetStep step = {};
    step.offset = &particles.offset[bodies.particles[body].first + embedded_count(info)].x;
    step.corner0 = solids.corner[0].data() + first;
    step.corner1 = solids.corner[1].data() + first;
    step.corner2 = solids.corner[2].data() + first;
    step.corner3 = solids.corner[3].data() + first;
    const bool may_tear = torn && torn->rest.size() >= info.tetrahedra.end();
    step.rest = (may_tear ? torn->rest : solids.rest).data() + first;
    step.per_rest = (may_tear ? torn->per_rest : solids.per_rest).data() + first;
    step.factor = info.varied ? solids.factor.data() + first : nullptr;
    step.bulk = static_cast<float>(moduli.bulk);
    step.crush = static_cast<float>(moduli.crush);
    step.squeeze = static_cast<float>(moduli.squeeze);
    step.yield = static_cast<float>(moduli.yield);
    step.shear = static_cast<float>(moduli.shear);
    step.metric = moduli.shear > 0 ? solids.metric.data() + 6ul * first : nullptr;
    step.tetrahedra = info.tetrahedra.count;
    step.slot_column = solids.slot_column.data() + info.slices.first + prototype;
    step.slot = solids.slot.data();
    return step;
}

uint32_t corner_rows(const TetStep& body) { return 4 * body.tetrahedra + 1; }

namespace {

// Runs all groups of a body through one kernel; returns the least J, at most 1.
template <class Kernel>
float for_groups(const TetStep& body, Kernel kernel) {
    const uint32_t groups = body.tetrahedra / kSliceWidth;
    constexpr uint32_t kAtATime = 256 * kGroupsPressed;
    std::array<float, kAtATime / kGroupsPressed * kSliceWidth> least;
    float lowest = 1;
    for (uint32_t begin = 0; begin < groups; begin += kAtATime) {
        const uint32_t count = std::min(groups - begin, kAtATime);
        const size_t lanes = size_t{chunk_count(count, kGroupsPressed)} * kSliceWidth;
        std::fill_n(least.begin(), lanes, 1.0f);
        parallel_for_even(count, kGroupsPressed, kLeastChunks, [&](uint32_t from, uint32_t to) {
            kernel(&body, begin + from, begin + to, least.data() + from / kGroupsPressed * kSliceWidth);
        });
        lowest = std::min(lowest, *std::min_element(least.begin(), least.begin() + static_cast<ptrdiff_t>(lanes)));
    }
    return lowest;
}

}  // namespace

float least_volume_ratio(const TetStep& body) { return for_groups(body, tet_kernels().measure); }

uint32_t inverted_tetrahedra(const TetStep& body) {
    const auto at = [&](uint32_t node) { return Vec3d(Eigen::Map<const Eigen::Vector3f>(body.offset + 4ul * node).cast<double>()); };
    uint32_t inverted = 0;
    for (uint32_t t = 0; t < body.tetrahedra; ++t) {
        inverted +=
            body.rest[t] > 0 && !(six_volumes(at(body.corner0[t]), at(body.corner1[t]), at(body.corner2[t]), at(body.corner3[t])) > 0);
    }
    return inverted;
}

float add_tet_forces(const TetStep& body, uint32_t slices) {
    const TetKernels& kernels = tet_kernels();
    std::fill_n(body.corner_force + 16ul * body.tetrahedra, 4, 0.0f);
    const float lowest = for_groups(body, body.metric ? kernels.press_neo_hookean : kernels.press);
    parallel_for_even(slices, kSlicesGathered, kLeastChunks, [&](uint32_t from, uint32_t to) { kernels.gather(&body, from, to); });
    return lowest;
}

double tet_energy(const SolidModuli& m, double rest, double volume) {
    const double swelling = volume / rest - 1, held = std::clamp(swelling, -1.0, double{kStretchCap});
    const double crushed = std::min(held + 1 - double{kCrushed}, 0.0);
    const double squeezed = std::min(held, 0.0), squeeze = m.squeeze * squeezed * squeezed;
    const double yielding = std::max(held, -m.yield), bulk = m.bulk * yielding;
    const double pressure = bulk + m.crush * crushed - squeeze;  // with J clamped
    return rest / 6 *
           (bulk * (held - 0.5 * yielding) + 0.5 * m.crush * crushed * crushed - squeeze * squeezed / 3 + pressure * (swelling - held));
}

namespace {

// Energy of a tetrahedron with a metric; a, b, c: its edges from the first corner.
template <typename Vector, typename Dot>
double neo_hookean_energy(const SolidModuli& m, const TetStep& step, uint32_t t, const Vector& a, const Vector& b, const Vector& c,
                          double volume, const Dot& product) {
    const float* metric = step.metric + 96ul * (t / kSliceWidth) + t % kSliceWidth;
    const double squared = metric[0] * product(a, a) + metric[16] * product(b, b) + metric[32] * product(c, c) +
                           2 * (metric[48] * product(a, b) + metric[64] * product(a, c) + metric[80] * product(b, c));
    const double rest = step.rest[t], swelling = volume / rest - 1, held = std::max(swelling, -1.0);
    return rest / 6 *
           (0.5 * m.shear * (squared - 3 - std::log((squared + 1) / 4)) + m.bulk * held * (swelling - 0.5 * held) -
            0.75 * m.shear * swelling);
}

}  // namespace

double tet_energy(const SolidModuli& moduli, const TetStep& step, uint32_t t, const std::array<Vec3d, 4>& p) {
    const double volume = six_volumes(p[0], p[1], p[2], p[3]);
    if (!step.metric) return tet_energy(moduli, step.rest[t], volume);
    const auto product = [](const Vec3d& x, const Vec3d& y) { return x.dot(y); };
    return neo_hookean_energy<Vec3d>(moduli, step, t, p[1] - p[0], p[2] - p[0], p[3] - p[0], volume, product);
}

double six_volumes(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) { return (b - a).dot((c - a).cross(d - a)); }

double tet_energy(const TetStep& step, uint32_t nodes, const SolidModuli& moduli, const NodeVelocities& velocity, double back,
                  TetEnergyScratch& scratch) {
    constexpr uint32_t kChunk = kGroupsPerChunk * kSliceWidth, kNodes = 4096;
    scratch.position.resize(nodes);
    scratch.sums.resize(chunk_count(step.tetrahedra, kChunk));
    parallel_for(nodes, kNodes, [&](uint32_t begin, uint32_t end) {
        for (uint32_t v = begin; v < end; ++v) {
            scratch.position[v] =
                float_vec4(_mm_load_ps(step.offset + 4ul * v)) - back * make_vec4(velocity.x[v], velocity.y[v], velocity.z[v]);
        }
    });
    parallel_for(step.tetrahedra, kChunk, [&](uint32_t begin, uint32_t end) {
        const Vec4d* const at = scratch.position.data();
        // a loop of its own per law: the logarithm of one would keep the other's constants out of registers
        const auto sum_of = [&](const auto& energy_of) {
            double sum = 0;
            for (uint32_t t = begin; t < end; ++t) {
                if (step.rest[t] == 0) continue;
                const Vec4d p = at[step.corner0[t]], a = at[step.corner1[t]] - p, b = at[step.corner2[t]] - p, c = at[step.corner3[t]] - p;
                sum += (step.factor ? double{step.factor[t]} : 1.0) * energy_of(t, a, b, c, dot(a, cross(b, c)));
            }
            return sum;
        };
        const auto product = [](Vec4d x, Vec4d y) { return dot(x, y); };
        double& sum = scratch.sums[begin / kChunk];
        if (step.metric)
            sum = sum_of([&](uint32_t t, Vec4d a, Vec4d b, Vec4d c, double volume) {
                return neo_hookean_energy(moduli, step, t, a, b, c, volume, product);
            });
        else
            sum = sum_of([&](uint32_t t, Vec4d, Vec4d, Vec4d, double volume) { return tet_energy(moduli, step.rest[t], volume); });
    });
    return std::accumulate(scratch.sums.begin(), scratch.sums.end(), 0.0);
}

double tet_energy(const Solids& solids, const Bodies& bodies, const Particles& particles, uint32_t body, double back,
                  TetEnergyScratch& scratch, const TornSprings* torn) {
    const uint32_t skin = embedded_count(solids.info[bodies.mesh[body]]), first = bodies.particles[body].first + skin;
    return tet_energy(bind_tets(solids, bodies, particles, body, torn), bodies.particles[body].count - skin, solid_moduli(bodies, body),
                      {particles.velocity_x.data() + first, particles.velocity_y.data() + first, particles.velocity_z.data() + first}, back,
                      scratch);
}

}  // namespace trocar
