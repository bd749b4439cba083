#include "systems/app/station/smooth_path.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <complex>
#include <numbers>
#include <numeric>
namespace trocar {
namespace {

constexpr int kDegree = 5;
constexpr size_t kTerms = kDegree + 1;
constexpr size_t kKept = 8;  // windows with the same spacing of samples: 60 Hz in whole milliseconds has three

using Terms = std::array<double, kTerms>;

// Legendre polynomials at x with their first and third derivatives.
void legendre(double x, Terms& p, Terms& first, Terms& third) {
    p = {1, x, 0, 0, 0, 0}, first = {0, 1, 0, 0, 0, 0}, third = {};
    Terms second{};
    for (size_t n = 1; n + 1 < kTerms; ++n) {
        const double k = static_cast<double>(n);
        p[n + 1] = ((2 * k + 1) * x * p[n] - k * p[n - 1]) / (k + 1);
        first[n + 1] = first[n - 1] + (2 * k + 1) * p[n];
        second[n + 1] = second[n - 1] + (2 * k + 1) * first[n];
        third[n + 1] = third[n - 1] + (2 * k + 1) * second[n];
    }
}

// What each sample of a window contributes to the fit at one time.
struct Window {
    std::vector<double> offset;  // s, of the samples from that time
    std::vector<double> value, first, third;
};

// Least squares in Legendre polynomials over the window mapped to -1..1.
void fit(Window& w) {
    const size_t n = w.offset.size(), terms = std::min(kTerms, n);
    const double middle = 0.5 * (w.offset.front() + w.offset.back());
    const double half = std::max(0.5 * (w.offset.back() - w.offset.front()), 1e-12);
    Eigen::MatrixXd basis(static_cast<Eigen::Index>(n), static_cast<Eigen::Index>(terms));
    Terms p, first, third;
    for (size_t i = 0; i < n; ++i) {
        legendre((w.offset[i] - middle) / half, p, first, third);
        for (size_t k = 0; k < terms; ++k) basis(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = p[k];
    }
    legendre(-middle / half, p, first, third);
    const Eigen::LDLT<Eigen::MatrixXd> gram(basis.transpose() * basis);
    const auto weights = [&](const Terms& at, double scale, std::vector<double>& out) {
        const Eigen::VectorXd w0 = basis * gram.solve(Eigen::Map<const Eigen::VectorXd>(at.data(), static_cast<Eigen::Index>(terms)));
        out.resize(n);
        for (size_t i = 0; i < n; ++i) out[i] = scale * w0[static_cast<Eigen::Index>(i)];
    };
    weights(p, 1, w.value), weights(first, 1 / half, w.first), weights(third, 1 / (half * half * half), w.third);
}

bool alike(std::span<const double> time, double centre, size_t low, size_t high, const Window& w) {
    if (w.offset.size() != high - low) return false;
    for (size_t i = low; i < high; ++i)
        if (std::abs(time[i] - centre - w.offset[i - low]) > 1e-7) return false;
    return true;
}

double middle_interval(std::span<const double> time) {
    std::vector<double> gap(time.size() - 1);
    for (size_t i = 0; i < gap.size(); ++i) gap[i] = time[i + 1] - time[i];
    std::nth_element(gap.begin(), gap.begin() + static_cast<ptrdiff_t>(gap.size() / 2), gap.end());
    return gap[gap.size() / 2];
}

// In place, radix 2; the size is a power of two.
void fourier(std::vector<std::complex<double>>& a) {
    const size_t n = a.size();
    for (size_t i = 1, j = 0; i < n; ++i) {
        size_t bit = n >> 1;
        for (; j & bit; bit >>= 1) j ^= bit;
        if (i < (j ^= bit)) std::swap(a[i], a[j]);
    }
    std::vector<std::complex<double>> root(n / 2);
    for (size_t k = 0; k < n / 2; ++k) root[k] = std::polar(1.0, -2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(n));
    for (size_t length = 2; length <= n; length <<= 1) {
        for (size_t i = 0; i < n; i += length) {
            for (size_t k = 0; k < length / 2; ++k) {
                std::complex<double>&x = a[i + k], &y = a[i + k + length / 2], r = root[k * (n / length)];
                const std::complex<double> v(y.real() * r.real() - y.imag() * r.imag(), y.real() * r.imag() + y.imag() * r.real());
                y = x - v, x += v;
            }
        }
    }
}

}  // namespace

std::vector<SmoothColumn> smooth_columns(std::span<const double> time, std::span<const std::vector<double>> columns, double band) {
    const size_t n = time.size();
    std::vector<SmoothColumn> out(columns.size());
    for (SmoothColumn& c : out) c.value.resize(n), c.first.resize(n), c.third.resize(n);
    if (n < 2) {
        for (size_t c = 0; c < columns.size(); ++c) out[c].value.assign(columns[c].begin(), columns[c].end());
        return out;
    }
    const double interval = middle_interval(time), rate = 1 / interval;
    const double samples = std::max(4.0, std::round((kDegree + 1) * rate / (2 * band) / 3.2));  // on either side
    const double half = (samples + 1e-6) * interval, begin = time.front(), end = time.back();
    std::vector<Window> kept;
    size_t next = 0, low = 0, high = 0;
    for (size_t i = 0; i < n; ++i) {
        double from = time[i] - half, to = time[i] + half;
        if (from < begin || to > end) {
            const bool at_begin = from - begin < end - to;
            from = at_begin ? begin : end - 4 * half, to = at_begin ? begin + 4 * half : end;
        }
        low = static_cast<size_t>(std::ranges::lower_bound(time, from) - time.begin());
        high = static_cast<size_t>(std::ranges::upper_bound(time, to) - time.begin());
        const auto known = std::ranges::find_if(kept, [&](const Window& w) { return alike(time, time[i], low, high, w); });
        size_t used = static_cast<size_t>(known - kept.begin());
        if (known == kept.end()) {
            Window made;
            for (size_t k = low; k < high; ++k) made.offset.push_back(time[k] - time[i]);
            fit(made);
            if (kept.size() < kKept)
                kept.emplace_back();
            else
                next = (next + 1) % kKept, used = next;
            kept[used] = std::move(made);
        }
        const Window& w = kept[used];
        for (size_t c = 0; c < columns.size(); ++c) {
            double value = 0, first = 0, third = 0;
            const double* x = columns[c].data() + low;
            for (size_t k = 0; k < w.value.size(); ++k) value += w.value[k] * x[k], first += w.first[k] * x[k], third += w.third[k] * x[k];
            out[c].value[i] = value, out[c].first[i] = first, out[c].third[i] = third;
        }
    }
    return out;
}

SmoothPath smooth_path(std::span<const double> time, std::span<const Vec3d> place, std::span<const Quat> turn) {
    const size_t n = time.size();
    std::vector<std::vector<double>> column(turn.empty() ? 3 : 7, std::vector<double>(n));
    Vec3d origin = n > 0 ? place[0] : Vec3d(Vec3d::Zero());
    Eigen::Vector4d before(1, 0, 0, 0);
    for (size_t i = 0; i < n; ++i) {
        for (int k = 0; k < 3; ++k) column[static_cast<size_t>(k)][i] = place[i][k] - origin[k];
        if (turn.empty()) continue;
        Eigen::Vector4d q(turn[i].w, turn[i].x, turn[i].y, turn[i].z);
        if (q.dot(before) < 0) q = -q;  // both mean the same rotation
        before = q;
        for (int k = 0; k < 4; ++k) column[static_cast<size_t>(3 + k)][i] = q[k];
    }
    const std::vector<SmoothColumn> smooth = smooth_columns(time, column);
    SmoothPath path;
    path.time.assign(time.begin(), time.end());
    for (size_t i = 0; i < n; ++i) {
        const auto vector = [&](std::vector<double> SmoothColumn::*what) {
            return Vec3d((smooth[0].*what)[i], (smooth[1].*what)[i], (smooth[2].*what)[i]);
        };
        path.place.push_back(vector(&SmoothColumn::value) + origin);
        path.speed.push_back(vector(&SmoothColumn::first).norm()), path.jerk.push_back(vector(&SmoothColumn::third).norm());
        path.turn.push_back(0);
        if (turn.empty() || i == 0) continue;
        const auto at = [&](size_t k) {
            return Eigen::Vector4d(smooth[3].value[k], smooth[4].value[k], smooth[5].value[k], smooth[6].value[k]).normalized();
        };
        path.turn.back() = 4 * std::asin(std::min(1.0, 0.5 * (at(i) - at(i - 1)).norm()));
    }
    return path;
}

double integral(std::span<const double> time, std::span<const double> values) {
    double sum = 0;
    for (size_t i = 1; i < time.size(); ++i) sum += 0.5 * (values[i] + values[i - 1]) * (time[i] - time[i - 1]);
    return sum;
}

double spectral_arc_length(std::span<const double> speed, double rate) {
    constexpr double kHighest = 10, kLeast = 0.05;  // Hz; of the largest amplitude
    constexpr size_t kPadding = 16;
    if (speed.size() < 2) return 0;
    const size_t size = std::bit_ceil(speed.size()) * kPadding;
    std::vector<std::complex<double>> spectrum(size);
    std::ranges::copy(speed, spectrum.begin());
    fourier(spectrum);
    const double step = rate / static_cast<double>(size);
    const size_t count = std::min(size, static_cast<size_t>(kHighest / step) + 1);
    double largest = 0;
    for (size_t k = 0; k < size; ++k) largest = std::max(largest, std::abs(spectrum[k]));
    if (!(largest > 0)) return 0;
    size_t first = count, last = 0;
    for (size_t k = 0; k < count; ++k)
        if (std::abs(spectrum[k]) >= kLeast * largest) first = std::min(first, k), last = k;
    if (first >= last) return 0;
    const double width = 1.0 / static_cast<double>(last - first);
    double length = 0;
    for (size_t k = first; k < last; ++k) length += std::hypot(width, (std::abs(spectrum[k + 1]) - std::abs(spectrum[k])) / largest);
    return -length;
}

double spectral_arc_length(const SmoothPath& path) {
    constexpr double kMost = 100;  // Hz: ten times the band
    if (path.time.size() < 2) return 0;
    const double span = path.time.back() - path.time.front();
    const double rate = std::min(kMost, 1 / middle_interval(path.time));
    const size_t n = static_cast<size_t>(std::floor(span * rate + 1e-6)) + 1;
    std::vector<double> even(n);
    size_t k = 0;
    for (size_t i = 0; i < n; ++i) {
        const double t = path.time.front() + static_cast<double>(i) / rate;
        while (k + 2 < path.time.size() && path.time[k + 1] < t) ++k;
        const double share = std::clamp((t - path.time[k]) / (path.time[k + 1] - path.time[k]), 0.0, 1.0);
        even[i] = path.speed[k] + share * (path.speed[k + 1] - path.speed[k]);
    }
    return spectral_arc_length(even, rate);
}

double log_dimensionless_jerk(const SmoothPath& path) {
    if (path.time.size() < 2) return 0;
    const double span = path.time.back() - path.time.front(), fastest = *std::ranges::max_element(path.speed);
    std::vector<double> squared(path.jerk.size());
    std::ranges::transform(path.jerk, squared.begin(), [](double j) { return j * j; });
    const double jerk = integral(path.time, squared);
    return fastest > 0 && jerk > 0 ? -std::log(span * span * span / (fastest * fastest) * jerk) : 0;
}

}  // namespace trocar
