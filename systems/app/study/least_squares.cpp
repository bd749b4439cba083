#include "systems/app/study/least_squares.hpp"

#include <algorithm>
#include <cmath>
#include <unsupported/Eigen/NonLinearOptimization>
namespace trocar {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// Of the logistic variable, for differences: a twentieth of the range in logarithms first, because forces of coarse tissue ripple
// and short steps would measure that; then half a percent, from the best so far.
constexpr double kDifferences[] = {0.25, 0.02};
constexpr double kMiddle = 0;         // the middle of the range
constexpr double kFitPrecise = 1e-7;  // relative, of the sum of squares and of the variables
constexpr int kMostEvaluations = 60;

struct LogRange {
    double low, log_width;
};

double share(double v) { return 1 / (1 + std::exp(-v)); }

struct Problem {
    std::vector<LogRange> range;
    const Residuals& residuals;
    double step = kDifferences[0];
    int count = 0;

    std::vector<double> parameters_at(const VectorXd& v) const {
        std::vector<double> p;
        for (size_t k = 0; k < range.size(); ++k) p.push_back(range[k].low * std::exp(range[k].log_width * share(v[static_cast<int>(k)])));
        return p;
    }
    int values() const { return count; }
    int operator()(const VectorXd& v, VectorXd& out) const {
        const std::vector<double> r = residuals({parameters_at(v)})[0];
        out = Eigen::Map<const VectorXd>(r.data(), static_cast<int>(r.size()));
        return 0;
    }
    int df(const VectorXd& v, MatrixXd& out) const {
        std::vector<std::vector<double>> rows;
        for (int k = 0; k < v.size(); ++k)
            for (const double side : {-step, step}) {
                VectorXd moved = v;
                moved[k] += side;
                rows.push_back(parameters_at(moved));
            }
        const auto r = residuals(rows);
        for (int k = 0; k < v.size(); ++k)
            for (int i = 0; i < count; ++i) {
                const auto row = static_cast<size_t>(2 * k), at = static_cast<size_t>(i);
                out(i, k) = (r[row + 1][at] - r[row][at]) / (2 * step);
            }
        return 0;
    }
};

}  // namespace

double students_t(double degrees) {
    const double x = 1.959963984540054, n = degrees, x2 = x * x, x4 = x2 * x2, x6 = x2 * x4;
    return x + x * (x2 + 1) / (4 * n) + x * (5 * x4 + 16 * x2 + 3) / (96 * n * n) +
           x * (3 * x6 + 19 * x4 + 17 * x2 - 15) / (384 * n * n * n) +
           x * (79 * x2 * x6 + 776 * x6 + 1482 * x4 - 1920 * x2 - 945) / (92160 * n * n * n * n);
}

Fit fit_least_squares(const std::vector<FitParameter>& parameters, const Residuals& residuals) {
    const int n = static_cast<int>(parameters.size());
    Problem problem{{}, residuals};
    for (const FitParameter& p : parameters) problem.range.push_back({p.low, std::log(p.high / p.low)});
    VectorXd v = VectorXd::Constant(n, kMiddle);
    problem.count = static_cast<int>(residuals({problem.parameters_at(v)})[0].size());
    Fit fit;
    double least = INFINITY;
    VectorXd start = v;
    for (const double step : kDifferences) {
        problem.step = step;
        Eigen::LevenbergMarquardt<Problem> search(problem);
        search.parameters.ftol = search.parameters.xtol = kFitPrecise;
        search.parameters.maxfev = kMostEvaluations;
        search.parameters.factor = 1;  // a first step of at most one: from the middle to a quarter of the range
        const auto status = search.minimize(start);
        fit.converged = status != Eigen::LevenbergMarquardtSpace::TooManyFunctionEvaluation &&
                        status != Eigen::LevenbergMarquardtSpace::ImproperInputParameters;
        if (search.fnorm < least) least = search.fnorm, v = start;
        start = v;
    }
    VectorXd r(problem.count);
    MatrixXd jacobian(problem.count, n);
    problem(v, r);
    problem.df(v, jacobian);
    fit.rms = r.norm() / std::sqrt(static_cast<double>(problem.count));
    const double degrees = std::max(1, problem.count - n);
    const MatrixXd covariance = (r.squaredNorm() / degrees) * (jacobian.transpose() * jacobian).ldlt().solve(MatrixXd::Identity(n, n));
    const std::vector<double> best = problem.parameters_at(v);
    fit.correlation.assign(static_cast<size_t>(n), std::vector<double>(static_cast<size_t>(n)));
    for (int k = 0; k < n; ++k) {
        const auto at = static_cast<size_t>(k);
        const double s = share(v[k]), slope = problem.range[at].log_width * s * (1 - s);  // of the logarithm
        const double wide = students_t(degrees) * slope * std::sqrt(std::max(0.0, covariance(k, k)));
        fit.parameter.push_back({best[at], best[at] * std::exp(-wide), best[at] * std::exp(wide), s < 1e-3 || s > 1 - 1e-3});
        for (int j = 0; j < n; ++j)
            fit.correlation[at][static_cast<size_t>(j)] = covariance(k, j) / std::sqrt(covariance(k, k) * covariance(j, j));
    }
    return fit;
}

}  // namespace trocar
