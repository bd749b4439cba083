#include "systems/app/station/statistics.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "systems/app/station/score.hpp"
namespace trocar {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// SplitMix64 (Steele, Lea and Flood 2014).
struct Dice {
    uint64_t state = 0x5eed;
    uint64_t next() {
        uint64_t z = (state += 0x9e3779b97f4a7c15ull);
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
        return z ^ (z >> 31);
    }
    size_t below(size_t n) { return static_cast<size_t>((static_cast<unsigned __int128>(next()) * n) >> 64); }
};

// Regularised incomplete beta function by its continued fraction (Lentz's method).
double incomplete_beta(double a, double b, double x) {
    if (x <= 0) return 0;
    if (x >= 1) return 1;
    if (x > (a + 1) / (a + b + 2)) return 1 - incomplete_beta(b, a, 1 - x);
    const double front = std::exp(std::lgamma(a + b) - std::lgamma(a) - std::lgamma(b) + a * std::log(x) + b * std::log1p(-x)) / a;
    constexpr double kTiny = 1e-300;
    double c = 1, d = 1 - (a + b) * x / (a + 1);
    d = 1 / (std::abs(d) < kTiny ? kTiny : d);
    double f = d;
    for (int m = 1; m < 500; ++m) {
        const auto step = [&](double numerator) {
            d = 1 + numerator * d, d = 1 / (std::abs(d) < kTiny ? kTiny : d);
            c = 1 + numerator / c, c = std::abs(c) < kTiny ? kTiny : c;
            f *= c * d;
        };
        step(m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)));
        const double before = f;
        step(-(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1)));
        if (std::abs(f - before) < 1e-15 * std::abs(f)) break;
    }
    return front * f;
}

// Quantile of the F distribution by bisection.
double f_quantile(double p, double d1, double d2) {
    double low = 0, high = 1;
    for (int k = 0; k < 200; ++k) {
        const double x = 0.5 * (low + high);
        (incomplete_beta(0.5 * d1, 0.5 * d2, x) < p ? low : high) = x;
    }
    return d2 * low / (d1 * std::max(1 - low, 1e-300));
}

// Midranks of absolute values, ascending; returns whether there were ties.
bool midranks(const std::vector<double>& size, std::vector<double>& rank) {
    std::vector<size_t> order(size.size());
    std::iota(order.begin(), order.end(), size_t{0});
    std::ranges::sort(order, [&](size_t x, size_t y) { return size[x] < size[y]; });
    rank.assign(size.size(), 0);
    bool ties = false;
    for (size_t i = 0; i < order.size();) {
        size_t j = i;
        while (j < order.size() && size[order[j]] == size[order[i]]) ++j;
        for (size_t k = i; k < j; ++k) rank[order[k]] = 0.5 * static_cast<double>(i + 1 + j);
        ties |= j > i + 1, i = j;
    }
    return ties;
}

}  // namespace

double area_under_curve(std::span<const double> a, std::span<const double> b) {
    if (a.empty() || b.empty()) return 0.5;
    std::vector<double> sorted(b.begin(), b.end());
    std::ranges::sort(sorted);
    double sum = 0;
    for (const double x : a) {
        const auto [low, high] = std::ranges::equal_range(sorted, x);
        sum += static_cast<double>(low - sorted.begin()) + 0.5 * static_cast<double>(high - low);
    }
    return sum / (static_cast<double>(a.size()) * static_cast<double>(b.size()));
}

Interval bootstrap_area(std::span<const double> a, std::span<const double> b) {
    constexpr int kSamples = 2000;
    Interval out{area_under_curve(a, b), kNaN, kNaN};
    if (a.empty() || b.empty()) return out;
    Dice dice;
    std::vector<double> x(a.size()), y(b.size()), area;
    for (int k = 0; k < kSamples; ++k) {
        for (double& v : x) v = a[dice.below(a.size())];
        for (double& v : y) v = b[dice.below(b.size())];
        area.push_back(area_under_curve(x, y));
    }
    out.low = quantile_between(area, 0.025), out.high = quantile_between(area, 0.975);
    return out;
}

Interval intraclass_correlation(std::span<const double> value, size_t trials) {
    const size_t subjects = trials > 0 ? value.size() / trials : 0;
    if (subjects < 2 || trials < 2) return {kNaN, kNaN, kNaN};
    const double n = static_cast<double>(subjects), k = static_cast<double>(trials);
    const auto at = [&](size_t s, size_t t) { return value[s * trials + t]; };
    const double all = std::accumulate(value.begin(), value.end(), 0.0) / (n * k);
    double rows = 0, columns = 0, total = 0;
    for (size_t s = 0; s < subjects; ++s) {
        double sum = 0;
        for (size_t t = 0; t < trials; ++t) sum += at(s, t), total += (at(s, t) - all) * (at(s, t) - all);
        rows += k * (sum / k - all) * (sum / k - all);
    }
    for (size_t t = 0; t < trials; ++t) {
        double sum = 0;
        for (size_t s = 0; s < subjects; ++s) sum += at(s, t);
        columns += n * (sum / n - all) * (sum / n - all);
    }
    const double between = rows / (n - 1), judges = columns / (k - 1);
    const double rest = std::max(0.0, total - rows - columns) / ((n - 1) * (k - 1));
    Interval out;
    out.value = (between - rest) / (between + (k - 1) * rest + k * (judges - rest) / n);
    const double ratio = judges / std::max(rest, 1e-300), r = std::clamp(out.value, -0.999999, 0.999999);
    const double top = k * r * ratio + n * (1 + (k - 1) * r) - k * r;
    const double freedom =
        (k - 1) * (n - 1) * top * top / ((n - 1) * k * k * r * r * ratio * ratio + std::pow(n * (1 + (k - 1) * r) - k * r, 2));
    const double upper = f_quantile(0.975, n - 1, freedom), lower = f_quantile(0.975, freedom, n - 1);
    const double spread = k * judges + (k * n - k - n) * rest;
    out.low = n * (between - upper * rest) / (upper * spread + n * between);
    out.high = n * (lower * between - rest) / (spread + n * lower * between);
    return out;
}

double signed_rank_p(std::span<const double> differences) {
    std::vector<double> size, rank;
    std::vector<uint8_t> up;
    for (const double d : differences)
        if (d != 0 && std::isfinite(d)) size.push_back(std::abs(d)), up.push_back(d > 0);
    const size_t n = size.size();
    if (n == 0) return 1;
    const bool ties = midranks(size, rank);
    double sum = 0;
    for (size_t i = 0; i < n; ++i) sum += up[i] ? rank[i] : 0;
    const double whole = 0.5 * static_cast<double>(n * (n + 1)), less = std::min(sum, whole - sum);
    if (n <= 25 && !ties) {
        std::vector<double> ways(static_cast<size_t>(whole) + 1, 0);  // of signs that give each sum of ranks
        ways[0] = 1;
        for (size_t r = 1; r <= n; ++r)
            for (size_t s = ways.size() - 1; s >= r; --s) ways[s] += ways[s - r];
        const double tail = std::accumulate(ways.begin(), ways.begin() + static_cast<ptrdiff_t>(less) + 1, 0.0);
        return std::min(1.0, 2 * tail / std::exp2(static_cast<double>(n)));
    }
    double variance = 0;
    for (const double r : rank) variance += r * r;  // midranks: ties are accounted for
    const double z = std::max(0.0, 0.5 * whole - less - 0.5) / std::sqrt(0.25 * variance);
    return std::min(1.0, std::erfc(z / std::sqrt(2.0)));
}

std::vector<double> holm(std::span<const double> p) {
    std::vector<size_t> order(p.size());
    std::iota(order.begin(), order.end(), size_t{0});
    std::ranges::sort(order, [&](size_t a, size_t b) { return p[a] < p[b]; });
    std::vector<double> out(p.size());
    double worst = 0;
    for (size_t i = 0; i < order.size(); ++i)
        out[order[i]] = worst = std::max(worst, std::min(1.0, p[order[i]] * static_cast<double>(order.size() - i)));
    return out;
}

PowerLaw fit_power_law(std::span<const double> trial, std::span<const double> value) {
    double n = 0, x = 0, y = 0, xx = 0, xy = 0;
    for (size_t i = 0; i < trial.size(); ++i) {
        if (!(trial[i] > 0) || !(value[i] > 0)) return {kNaN, kNaN};
        const double u = std::log(trial[i]), v = std::log(value[i]);
        n += 1, x += u, y += v, xx += u * u, xy += u * v;
    }
    const double wide = n * xx - x * x;
    if (n < 2 || !(wide > 0)) return {kNaN, kNaN};
    const double exponent = (n * xy - x * y) / wide;
    return {std::exp((y - exponent * x) / n), exponent};
}

std::vector<double> warp_onto(std::span<const double> a, std::span<const double> b, size_t width, double band) {
    const size_t n = a.size() / width, m = b.size() / width;
    if (n == 0 || m == 0) return {};
    const double slope = n > 1 ? static_cast<double>(m - 1) / static_cast<double>(n - 1) : 0;
    const double reach = std::max(2.0 + slope, band * static_cast<double>(std::max(n, m)));
    std::vector<size_t> low(n), high(n);  // columns of each row within the band
    for (size_t i = 0; i < n; ++i) {
        const double middle = n > 1 ? slope * static_cast<double>(i) : 0;
        low[i] = static_cast<size_t>(std::max(0.0, std::ceil(middle - reach)));
        high[i] = n > 1 ? static_cast<size_t>(std::min(static_cast<double>(m), std::floor(middle + reach) + 1)) : m;
    }
    constexpr double kFar = std::numeric_limits<double>::infinity();
    std::vector<double> before(m + 1, kFar), now(m + 1, kFar);  // cost up to column j - 1
    std::vector<std::vector<uint8_t>> from(n);
    for (size_t i = 0; i < n; ++i) {
        std::ranges::fill(now, kFar);
        from[i].resize(high[i] - low[i]);
        for (size_t j = low[i]; j < high[i]; ++j) {
            double squared = 0;
            for (size_t k = 0; k < width; ++k) squared += (a[i * width + k] - b[j * width + k]) * (a[i * width + k] - b[j * width + k]);
            const double both = i == 0 && j == 0 ? 0 : before[j], up = before[j + 1], left = now[j];
            const uint8_t step = both <= up && both <= left ? 0 : up <= left ? 1 : 2;
            from[i][j - low[i]] = step;
            now[j + 1] = std::sqrt(squared) + (step == 0 ? both : step == 1 ? up : left);
        }
        std::swap(before, now);
    }
    std::vector<double> sum(n, 0), count(n, 0);
    for (size_t i = n - 1, j = m - 1;;) {
        sum[i] += static_cast<double>(j), count[i] += 1;
        if (i == 0 && j == 0) break;
        const uint8_t step = from[i][j - low[i]];
        if (step != 2 && i > 0) --i;
        if (step != 1 && j > 0) --j;
    }
    for (size_t i = 0; i < n; ++i) sum[i] /= count[i];
    return sum;
}

}  // namespace trocar
