#pragma once
#include <functional>
#include <string>
#include <vector>
namespace trocar {

// A positive parameter within bounds. The search starts at the geometric mean.
struct FitParameter {
    std::string key;
    double low = 0, high = 0;
};

struct Fitted {
    double value = 0, low = 0, high = 0;  // best, and its 95 % confidence interval
    bool at_bound = false;                // the best is within a thousandth of the range (in logarithms) of a bound
};

struct Fit {
    std::vector<Fitted> parameter;
    std::vector<std::vector<double>> correlation;
    double rms = 0;  // of the residuals
    bool converged = false;
};

// Residuals of each row of parameters, all of the same length; the rows may be computed in parallel.
using Residuals = std::function<std::vector<std::vector<double>>(const std::vector<std::vector<double>>& parameters)>;

// Least squares by Levenberg and Marquardt (MINPACK's lmder as ported in Eigen; More 1978) in the logarithms of the parameters, which a
// logistic function keeps within their bounds; derivatives by central differences. Intervals: Student's t times the square root of
// the diagonal of s^2 (J^T J)^-1, for independent residuals of equal variance (Seber and Wild 1989, section 2.1.2).
Fit fit_least_squares(const std::vector<FitParameter>& parameters, const Residuals& residuals);

// The 97.5 % quantile of Student's t (Abramowitz and Stegun 26.7.5: within 1e-3 from 4 degrees of freedom on).
double students_t(double degrees);

}  // namespace trocar
