#include "engine/tissue/relaxation.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "engine/tissue/embedded_surface.hpp"
#include "engine/tissue/spring_step.hpp"
#include "engine/tissue/tet_forces.hpp"
namespace trocar {
namespace {

// Inverse of the products of the edges from the first corner, of every tetrahedron of a prototype.
void fill_metric(const Meshes& meshes, uint32_t prototype, Solids& solids) {
    const SolidInfo& info = solids.info[prototype];
    const Range surface{meshes.info[prototype].vertices.first, surface_nodes(meshes, info, prototype)};
    const auto rest = [&](uint32_t node) -> const Vec3d& {
        return node < surface.count ? meshes.position[surface.first + node] : solids.position[info.inner.first + node - surface.count];
    };
    solids.metric.resize(std::max(solids.metric.size(), size_t{6} * info.tetrahedra.end()), 0.0f);
    float* const metric = solids.metric.data() + size_t{6} * info.tetrahedra.first;
    for (uint32_t t = 0; t < info.count; ++t) {
        std::array<Vec3d, 4> p;
        for (int k = 0; k < 4; ++k) p[k] = rest(solids.corner[k][info.tetrahedra.first + t]);
        Eigen::Matrix3d edges;
        for (int k = 0; k < 3; ++k) edges.col(k) = p[k + 1] - p[0];
        const Eigen::Matrix3d m = (edges.transpose() * edges).inverse();
        const double row[6] = {m(0, 0), m(1, 1), m(2, 2), m(0, 1), m(0, 2), m(1, 2)};
        for (uint32_t k = 0; k < 6; ++k)
            metric[size_t{6 * kSliceWidth} * (t / kSliceWidth) + kSliceWidth * k + t % kSliceWidth] = static_cast<float>(row[k]);
    }
}

// Integral of q^2 over a time s, as a form in q and q' at its ends, of a tension that goes from one to the other as
// q' + (q - q') (exp(-t) - exp(-s)) / (1 - exp(-s)): what a Maxwell element of stiffness and relaxation time 1 loses.
std::array<double, 3> heat_of(double s) {
    constexpr double kShort = 0.02;  // below, Simpson's rule: its error is s^5 / 2880
    if (s < kShort) {
        const double e = std::exp(-s / 2), before = e / (1 + e), after = 1 / (1 + e);  // in the middle
        return {s / 6 * (1 + 4 * before * before), s / 6 * 8 * before * after, s / 6 * (1 + 4 * after * after)};
    }
    // limit + decaying part
    const double e = std::exp(-s), u = 1 - e;
    const double square = (1 - e * e) / 2;  // integral of exp(-2 t)
    const double limit[2] = {-e / u, 1 / u}, decaying[2] = {1 / u, -1 / u};
    const auto form = [&](int i, int j) {
        return limit[i] * limit[j] * s + (limit[i] * decaying[j] + limit[j] * decaying[i]) * u + decaying[i] * decaying[j] * square;
    };
    return {form(0, 0), 2 * form(0, 1), form(1, 1)};
}

}  // namespace

void give_law(const Meshes& meshes, const Springs& springs, const Bodies& bodies, uint32_t body, Solids& solids, Relaxation& relaxation) {
    const uint32_t prototype = bodies.mesh[body];
    if (law_of(bodies, body) == TissueLaw::kNeoHookean) fill_metric(meshes, prototype, solids);
    const uint32_t branches = prony_of(bodies, body).branches();
    if (branches == 0) return;
    const SpringInfo& info = springs.info[prototype];
    const uint32_t* column = springs.slice_column.data() + info.slices.first + prototype;
    RelaxingBody relaxing;
    relaxing.body = body, relaxing.branches = branches;
    relaxing.count = kSliceWidth * (column[info.slices.count] - column[0]);
    relaxing.first = static_cast<uint32_t>(relaxation.stretch.size());
    relaxing.first_branch = static_cast<uint32_t>(relaxation.overstretch.size());
    relaxation.stretch.resize(relaxation.stretch.size() + relaxing.count, 0.0f);
    relaxation.overstretch.resize(relaxation.overstretch.size() + size_t{branches} * relaxing.count, 0.0f);
    relaxation.body.push_back(relaxing);
}

void set_relaxing_time(const Prony& prony, double seconds, SpringStep& step) {
    for (uint32_t b = 0; b < step.branches; ++b) {
        const double s = seconds / prony.time[b], lost = -std::expm1(-s), share = prony.share[b];
        step.lost[b] = static_cast<float>(lost);
        step.gain[b] = static_cast<float>(s > 0 ? share * lost / s : share);
        step.stored[b] = static_cast<float>(0.5 / share);
        const std::array<double, 3> heat = heat_of(s);
        for (int k = 0; k < 3; ++k) step.heat[b][k] = static_cast<float>(heat[k] / share);
    }
}

void bind_relaxation(Relaxation* relaxation, const Bodies& bodies, uint32_t body, double seconds, SpringStep& step) {
    const RelaxingBody* relaxing = relaxation ? find_relaxing(*relaxation, body) : nullptr;
    if (!relaxing) return;
    step.packed = nullptr;
    step.branches = relaxing->branches;
    step.stretch = relaxation->stretch.data() + relaxing->first;
    step.overstretch = relaxation->overstretch.data() + relaxing->first_branch;
    step.branch_stride = relaxing->count;
    set_relaxing_time(prony_of(bodies, body), seconds, step);
}

double relaxing_energy(const SpringStep& step, uint32_t slices, std::vector<double>& chunk_sums) {
    const SpringKernels& kernels = spring_kernels();
    const std::array<double, 1> sum = sum_slices<1>(
        slices, chunk_sums, [&](uint32_t begin, uint32_t end, double* sums) { kernels.relaxing_sums(&step, begin, end, sums); });
    return 0.5 * step.stiffness * sum[0];
}

void forget_relaxation(const SpringStep& step, uint32_t slices) {
    for (uint32_t slice = 0; slice < slices; ++slice) {
        for (size_t h = size_t{step.slice_column[slice]} * kSliceWidth; h < size_t{step.slice_column[slice + 1]} * kSliceWidth; ++h) {
            const float *p = step.offset + 4 * (size_t{slice} * kSliceWidth + h % kSliceWidth), *q = step.offset + 4ul * step.neighbour[h];
            const size_t at = h - size_t{step.first_column} * kSliceWidth;
            const float x = q[0] - p[0], y = q[1] - p[1], z = q[2] - p[2];
            step.stretch[at] = std::sqrt(x * x + y * y + z * z) - step.rest_length[h];
            for (uint32_t b = 0; b < step.branches; ++b) step.overstretch[b * static_cast<size_t>(step.branch_stride) + at] = 0;
        }
    }
}

}  // namespace trocar
