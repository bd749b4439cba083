#include "engine/tissue/implicit_factor.hpp"

#include <immintrin.h>

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>

#include "engine/tissue/bending_forces.hpp"
namespace trocar {
namespace {

using Entries = std::vector<Eigen::Triplet<double>>;

// Entries of the lower half for moving particles, numbered by `column`.
struct Assembly {
    std::vector<int> column;  // of a particle; -1 = fixed
    Entries entries;

    void add(uint32_t i, uint32_t j, double value) {
        const int a = column[i], b = column[j];
        if (a >= b && b >= 0) entries.emplace_back(a, b, value);
    }
};

void add_springs(const Springs& springs, uint32_t prototype, double stiffness, Assembly& a) {
    const SpringInfo& info = springs.info[prototype];
    const uint32_t* column = springs.slice_column.data() + info.slices.first + prototype;
    for (uint32_t slice = 0; slice < info.slices.count; ++slice) {
        for (size_t h = size_t{column[slice]} * kSliceWidth; h < size_t{column[slice + 1]} * kSliceWidth; ++h) {
            const uint32_t p = static_cast<uint32_t>(slice * kSliceWidth + h % kSliceWidth), q = springs.neighbour[h];
            if (p == q) continue;
            const double k = stiffness * (info.varied ? springs.factor[h] : 1.0f);
            a.add(p, p, k), a.add(p, q, -k);
        }
    }
}

// Of a hinge, rigidity * weight * c c^T: c_i is the change of its angle per displacement of corner i along the normal
// of the flat hinge (Bergou et al., "A quadratic bending model for inextensible surfaces", SGP 2006), times the
// reserve for the curvature of the angle itself.
// own: (c^T x)^2 <= 4 sum c_i^2 x_i^2, of each corner.
void add_bending(const Hinges& hinges, Range groups, double rigidity, const Anchors& anchors, uint32_t first, Assembly& a,
                 std::vector<float>& own) {
    constexpr uint32_t kGroup = 8;
    const auto rest = [&](uint32_t v) { return Vec3d(anchors.rest_x[first + v], anchors.rest_y[first + v], anchors.rest_z[first + v]); };
    for (size_t hinge = size_t{kGroup} * groups.first; hinge < size_t{kGroup} * groups.end(); ++hinge) {
        if (!(hinges.weight[hinge] > 0)) continue;
        const size_t group = hinge / kGroup, lane = hinge % kGroup;
        uint32_t v[4];
        for (uint32_t corner = 0; corner < 4; ++corner) v[corner] = hinges.vertex[4 * kGroup * group + corner * kGroup + lane];
        const Vec3d start = rest(v[0]), edge = rest(v[1]) - start;
        double c[4] = {};
        for (uint32_t side = 0; side < 2; ++side) {
            const double lever = hinges.cap[2 * kGroup * group + side * kGroup + lane] / kFlatReserve;
            const double along = (rest(v[2 + side]) - start).dot(edge) / edge.squaredNorm();
            c[0] -= (1 - along) * lever, c[1] -= along * lever, c[2 + side] = lever;
        }
        const double k = kAngleReserve * rigidity * hinges.weight[hinge];
        for (uint32_t i = 0; i < 4; ++i) own[v[i]] += static_cast<float>(4 * k * c[i] * c[i]);
        for (uint32_t i = 0; i < 4; ++i)
            for (uint32_t j = 0; j < 4; ++j) a.add(v[i], v[j], k * c[i] * c[j]);
    }
}

}  // namespace

double factored_step(double dt) { return std::exp2(0.5 * std::floor(2 * std::log2(dt))); }

void make_factor(const Springs& springs, const Bodies& bodies, const Particles& particles, const Anchors& anchors, uint32_t body,
                 double step, ImplicitFactor& factor) {
    const uint32_t prototype = bodies.mesh[body], skin = springs.info[prototype].skin;
    const Range nodes{bodies.particles[body].first + skin, bodies.particles[body].count - skin};
    factor.body = body, factor.step = step, factor.stiffness = bodies.spring_stiffness[body];
    Assembly a;
    a.column.assign(nodes.count, -1);
    int count = 0;
    for (uint32_t v = 0; v < nodes.count; ++v)
        if (particles.offset[nodes.first + v].w > 0) a.column[v] = count++;
    for (uint32_t v = 0; v < nodes.count; ++v)
        a.add(v, v, 1 / (particles.offset[nodes.first + v].w * step * step) + anchors.stiffness[nodes.first + v]);
    add_springs(springs, prototype, factor.stiffness, a);
    factor.bending.clear();
    if (has_bending(bodies, body)) {
        factor.bending.assign(nodes.count, 0.0f);
        add_bending(springs.hinges, springs.hinges.groups[prototype], bending_rigidity(bodies.tissue[body]), anchors, nodes.first, a,
                    factor.bending);
    }
    Eigen::SparseMatrix<double> matrix(count, count);
    matrix.setFromTriplets(a.entries.begin(), a.entries.end());
    const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>, Eigen::Lower, Eigen::AMDOrdering<int>> solver(matrix);
    const Eigen::SparseMatrix<double>& lower = solver.matrixL().nestedExpression();
    factor.order.assign(static_cast<size_t>(count), 0);
    for (uint32_t v = 0; v < nodes.count; ++v)
        if (a.column[v] >= 0) factor.order[static_cast<size_t>(solver.permutationP().indices()[a.column[v]])] = v;
    factor.first.assign(1, 0), factor.row.clear(), factor.value.clear(), factor.inverse.clear();
    for (int c = 0; c < count; ++c) {
        for (Eigen::SparseMatrix<double>::InnerIterator entry(lower, c); entry; ++entry) {
            if (entry.row() <= c) continue;
            factor.row.push_back(static_cast<uint32_t>(entry.row())), factor.value.push_back(static_cast<float>(entry.value()));
        }
        factor.first.push_back(static_cast<uint32_t>(factor.row.size()));
        factor.inverse.push_back(static_cast<float>(1 / solver.vectorD()[c]));
    }
    factor.work.resize(factor.order.size());
}

void solve_factor(ImplicitFactor& factor, const Float4* right, Float4* solution, uint32_t particles) {
    const size_t count = factor.order.size();
    const uint32_t *first = factor.first.data(), *row = factor.row.data();
    const float* value = factor.value.data();
    Float4* x = factor.work.data();
    const auto at = [](Float4& f) { return _mm_load_ps(&f.x); };
    for (size_t c = 0; c < count; ++c) x[c] = right[factor.order[c]];
    for (size_t c = 0; c < count; ++c) {
        const __m128 known = at(x[c]);
        for (uint32_t e = first[c]; e < first[c + 1]; ++e)
            _mm_store_ps(&x[row[e]].x, _mm_fnmadd_ps(_mm_set1_ps(value[e]), known, at(x[row[e]])));
    }
    std::fill_n(solution, particles, Float4{});
    for (size_t c = count; c-- > 0;) {
        __m128 even = _mm_mul_ps(_mm_set1_ps(factor.inverse[c]), at(x[c])), odd = _mm_setzero_ps();
        uint32_t e = first[c];
        for (; e + 1 < first[c + 1]; e += 2) {
            even = _mm_fnmadd_ps(_mm_set1_ps(value[e]), at(x[row[e]]), even);
            odd = _mm_fnmadd_ps(_mm_set1_ps(value[e + 1]), at(x[row[e + 1]]), odd);
        }
        if (e < first[c + 1]) even = _mm_fnmadd_ps(_mm_set1_ps(value[e]), at(x[row[e]]), even);
        const __m128 known = _mm_add_ps(even, odd);
        _mm_store_ps(&x[c].x, known);
        _mm_store_ps(&solution[factor.order[c]].x, known);
    }
}

}  // namespace trocar
