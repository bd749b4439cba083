#include "engine/tissue/stable_step.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "components/springs.hpp"
namespace trocar {
namespace {

constexpr uint32_t kSteps = 60;

// y = M^-1/2 (k Laplacian + diagonal) M^-1/2 x on the free particles.
struct ScaledStiffness {
    const StiffnessGraph& graph;
    std::vector<double> root;   // sqrt(inverse mass)
    std::vector<double> total;  // diagonal of k Laplacian + diagonal, N/m
    mutable std::vector<double> scaled;

    explicit ScaledStiffness(const StiffnessGraph& g) : graph(g) {
        const size_t n = g.particle.size();
        for (const Float4& p : g.particle) root.push_back(p.w > 0 ? std::sqrt(double(p.w)) : 0.0);
        scaled.resize(n);
        total.assign(g.diagonal.begin(), g.diagonal.end());
        for_half_edges([&](uint32_t v, uint32_t, double k) { total[v] += k; });
    }
    template <typename Visit>
    void for_half_edges(const Visit& visit) const {
        for (uint32_t slice = 0; slice + 1 < graph.slice_column.size(); ++slice) {
            for (uint32_t c = graph.slice_column[slice]; c < graph.slice_column[slice + 1]; ++c) {
                for (uint32_t lane = 0; lane < kSliceWidth; ++lane) {
                    const uint32_t v = slice * kSliceWidth + lane, index = c * kSliceWidth + lane, far_end = graph.neighbour[index];
                    if (far_end != v)
                        visit(v, far_end, graph.factor ? graph.spring_stiffness * double{graph.factor[index]} : graph.spring_stiffness);
                }
            }
        }
    }
    void operator()(const std::vector<double>& x, std::vector<double>& y) const {
        for (size_t i = 0; i < x.size(); ++i) {
            scaled[i] = root[i] * x[i];
            y[i] = total[i] * scaled[i];
        }
        for_half_edges([&](uint32_t v, uint32_t far_end, double k) { y[v] -= k * scaled[far_end]; });
        for (size_t i = 0; i < x.size(); ++i) y[i] *= root[i];
    }
    // A fixed far end does not move against us, so its spring counts once, not twice.
    double gershgorin() const {
        std::vector<double> sum = total;
        for_half_edges([&](uint32_t v, uint32_t far_end, double k) {
            if (root[far_end] > 0) sum[v] += k;
        });
        double most = 0;
        for (size_t i = 0; i < sum.size(); ++i) most = std::max(most, sum[i] * root[i] * root[i]);
        return most;
    }
};

double dot(const std::vector<double>& a, const std::vector<double>& b) {
    double sum = 0;
    for (size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
    return sum;
}

// Approximately normal, on free particles only; splitmix64.
std::vector<double> random_start(const std::vector<double>& root) {
    std::vector<double> x(root.size());
    uint64_t state = 1;
    for (size_t i = 0; i < x.size(); ++i) {
        for (int k = 0; k < 4; ++k) {
            uint64_t z = state += 0x9e3779b97f4a7c15ull;
            z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
            z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
            x[i] += static_cast<double>((z ^ (z >> 31)) >> 11) * 0x1p-53 - 0.5;
        }
        if (root[i] == 0) x[i] = 0;
    }
    return x;
}

// Largest eigenvalue of a symmetric tridiagonal matrix: bisection on the number of eigenvalues below (Sturm).
double largest_eigenvalue(const std::vector<double>& alpha, const std::vector<double>& beta, double high) {
    const auto all_below = [&](double x) {
        double d = 1;
        for (size_t i = 0; i < alpha.size(); ++i) {
            d = alpha[i] - x - (i > 0 ? beta[i - 1] * beta[i - 1] / d : 0.0);
            if (!(d < 0)) return false;
        }
        return true;
    };
    double low = 0;
    for (int k = 0; k < 60; ++k) {
        const double middle = 0.5 * (low + high);
        (all_below(middle) ? high : low) = middle;
    }
    return high;
}

}  // namespace

double stiffest_mode(const StiffnessGraph& graph) {
    const ScaledStiffness matrix(graph);
    const double bound = matrix.gershgorin();
    std::vector<double> v = random_start(matrix.root), before(v.size(), 0.0), w(v.size());
    const double size = std::sqrt(dot(v, v));
    if (!(bound > 0) || !(size > 0)) return bound;
    for (double& x : v) x /= size;
    std::vector<double> alpha, beta;
    for (uint32_t step = 0; step < kSteps; ++step) {
        matrix(v, w);
        const double a = dot(v, w), b = beta.empty() ? 0 : beta.back();
        for (size_t i = 0; i < w.size(); ++i) w[i] -= a * v[i] + b * before[i];
        alpha.push_back(a);
        const double next = std::sqrt(dot(w, w));
        if (!(next > 1e-12 * bound)) break;  // the Krylov space is exhausted: the value is exact
        beta.push_back(next);
        before.swap(v);
        for (size_t i = 0; i < w.size(); ++i) v[i] = w[i] / next;
    }
    return std::min(bound, largest_eigenvalue(alpha, beta, bound * (1 + 1e-9)));
}

}  // namespace trocar
