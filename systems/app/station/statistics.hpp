#pragma once
#include <cstdint>
#include <span>
#include <vector>
namespace trocar {

struct Interval {
    double value = 0, low = 0, high = 0;
};

// Probability that a value of `a` is above one of `b`, ties counted half: area under the receiver operating characteristic (Mann and
// Whitney 1947; Hanley and McNeil 1982). 0.5 if one is empty.
double area_under_curve(std::span<const double> a, std::span<const double> b);
// With its 95 % percentile interval of 2,000 bootstrap samples drawn in both groups (Efron 1979); the same for the same input.
Interval bootstrap_area(std::span<const double> a, std::span<const double> b);

// Agreement of the trials (columns) of each subject (row): ICC(2,1), two-way random effects, absolute agreement, single measurement
// (Shrout and Fleiss 1979, case 2), with its 95 % interval (McGraw and Wong 1996, case 2A). `value` has one row per subject, of
// `trials` numbers. NaN without two subjects and two trials.
Interval intraclass_correlation(std::span<const double> value, size_t trials);

// Two-sided p of Wilcoxon's signed-rank test that differences are symmetric about zero: exact for at most 25 that are not zero and of
// different sizes, else by the normal approximation with ties and continuity corrected. 1 without a difference.
double signed_rank_p(std::span<const double> differences);

// p values corrected for their number (Holm 1979), in the same order.
std::vector<double> holm(std::span<const double> p);

// Least-squares power law value = a * trial^b through the logarithms (Newell and Rosenbloom 1981): {a, b}; NaN where a value is not
// positive or there are fewer than two.
struct PowerLaw {
    double first = 0, exponent = 0;
};
PowerLaw fit_power_law(std::span<const double> trial, std::span<const double> value);

// Warps the samples of b onto those of a: the monotone path of least summed distance from (0, 0) to (last, last) with steps (1, 0), (0, 1),
// (1, 1) (Sakoe and Chiba 1978, without slope weights), at most `band` of the longer length beside the diagonal. A sample has `width`
// numbers. Returns for each sample of a the mean index in b.
std::vector<double> warp_onto(std::span<const double> a, std::span<const double> b, size_t width, double band = 0.5);

}  // namespace trocar
