#include "content/shapes/tube.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/base/check.hpp"
namespace trocar {

Vec3d CentreLine::at(double s, Vec3d& along, Vec3d& x, Vec3d& y) const {
    const double parameter = std::clamp(s / length, 0.0, 1.0) * double(point.size() - 1);
    const size_t i = std::min(static_cast<size_t>(parameter), point.size() - 2);
    const double t = parameter - double(i);
    along = (tangent[i] + t * (tangent[i + 1] - tangent[i])).normalized();
    x = across[i] + t * (across[i + 1] - across[i]);
    x = (x - x.dot(along) * along).normalized();
    y = along.cross(x);
    return point[i] + t * (point[i + 1] - point[i]);
}

CentreLine measure_curve(const std::function<Vec3d(double t)>& curve) {
    constexpr uint32_t kFine = 8192, kKept = 1024;
    std::vector<Vec3d> fine(kFine + 1);
    std::vector<double> length(kFine + 1, 0.0);
    for (uint32_t i = 0; i <= kFine; ++i) {
        fine[i] = curve(double(i) / kFine);
        if (i > 0) length[i] = length[i - 1] + (fine[i] - fine[i - 1]).norm();
    }
    CentreLine line;
    line.length = length.back();
    for (uint32_t i = 0, j = 0; i <= kKept; ++i) {
        const double wanted = line.length * i / kKept;
        while (j + 2 <= kFine && length[j + 1] < wanted) ++j;
        const double t = (wanted - length[j]) / (length[j + 1] - length[j]);
        line.point.push_back(fine[j] + t * (fine[j + 1] - fine[j]));
    }
    for (uint32_t i = 0; i <= kKept; ++i) {
        const Vec3d chord = line.point[std::min(i + 1, kKept)] - line.point[i == 0 ? 0 : i - 1];
        line.tangent.push_back(chord.normalized());
    }
    const Vec3d& first = line.tangent[0];
    const Vec3d helper = std::abs(first.z()) < 0.9 ? Vec3d::UnitZ() : Vec3d::UnitX();
    line.across.push_back((helper - helper.dot(first) * first).normalized());
    for (uint32_t i = 0; i < kKept; ++i) {
        const Vec3d step = line.point[i + 1] - line.point[i];
        const auto reflect = [](const Vec3d& v, const Vec3d& mirror) {
            return Vec3d(v - 2 * mirror.dot(v) / mirror.squaredNorm() * mirror);
        };
        const Vec3d tangent = reflect(line.tangent[i], step);
        const Vec3d turn = line.tangent[i + 1] - tangent;
        const Vec3d across = reflect(line.across[i], step);
        line.across.push_back(turn.squaredNorm() > 0 ? reflect(across, turn) : across);
    }
    return line;
}

std::function<Vec3d(double t)> curve_through(std::vector<Vec3d> points) {
    TROCAR_ASSERT(points.size() >= 2);
    return [points = std::move(points)](double t) {
        const size_t last = points.size() - 1;
        const double parameter = std::clamp(t, 0.0, 1.0) * double(last);
        const size_t i = std::min(static_cast<size_t>(parameter), last - 1);
        const double x = parameter - double(i);
        const Vec3d &p = points[i], &q = points[i + 1];
        const Vec3d before = i > 0 ? points[i - 1] : Vec3d(2 * p - q);
        const Vec3d after = i + 2 <= last ? points[i + 2] : Vec3d(2 * q - p);
        const Vec3d m = (q - before) / 2, n = (after - p) / 2;
        const double x2 = x * x, x3 = x2 * x;
        return Vec3d((2 * x3 - 3 * x2 + 1) * p + (x3 - 2 * x2 + x) * m + (3 * x2 - 2 * x3) * q + (x3 - x2) * n);
    };
}

double RadiusProfile::radius(double s) const {
    size_t i = 0;
    while (i + 2 < key.size() && s > key[i + 1].s) ++i;
    const double h = key[i + 1].s - key[i].s;
    const double x = std::clamp((s - key[i].s) / h, 0.0, 1.0);
    const double a = key[i].radius * key[i].radius, b = key[i + 1].radius * key[i + 1].radius;
    const double x2 = x * x, x3 = x2 * x;
    const double square =
        (2 * x3 - 3 * x2 + 1) * a + (x3 - 2 * x2 + x) * h * slope[i] + (3 * x2 - 2 * x3) * b + (x3 - x2) * h * slope[i + 1];
    return std::sqrt(std::max(square, 0.0));
}

RadiusProfile make_profile(std::vector<RadiusKey> keys, bool pointed) {
    TROCAR_ASSERT(keys.size() >= 3 && keys.front().radius == 0 && keys.back().radius == 0);
    RadiusProfile profile;
    const size_t count = keys.size();
    std::vector<double> rise(count - 1);
    for (size_t i = 0; i + 1 < count; ++i) {
        rise[i] = (keys[i + 1].radius * keys[i + 1].radius - keys[i].radius * keys[i].radius) / (keys[i + 1].s - keys[i].s);
    }
    // Fritsch and Butland 1984: harmonic mean of the increments, zero at sign changes; steep, hence round
    // ends
    profile.slope.assign(count, 0.0);
    for (size_t i = 1; i + 1 < count; ++i) {
        if (rise[i - 1] * rise[i] > 0) profile.slope[i] = 2 * rise[i - 1] * rise[i] / (rise[i - 1] + rise[i]);
    }
    profile.slope.front() = 2 * rise.front() - (rise[0] * rise[1] > 0 ? profile.slope[1] : 0.0);
    profile.slope.back() = pointed ? 0.0 : 2 * rise.back() - profile.slope[count - 2];
    profile.key = std::move(keys);
    profile.pointed = pointed;
    return profile;
}

Loft tube_loft(const CentreLine& line, const RadiusProfile& profile, std::function<double(double u, double s)> swell) {
    Loft loft;
    loft.samples = 512;
    loft.point = [line, profile, swell](double u, double v) {
        // slow at round ends, where the radius grows with the square root of the distance
        const double s = profile.key.back().s * (profile.pointed ? 1 - std::cos(M_PI / 2 * v) : (1 - std::cos(M_PI * v)) / 2);
        Vec3d along, x, y;
        const Vec3d centre = line.at(s, along, x, y);
        const double radius = profile.radius(s) * (swell ? swell(u, s) : 1.0);
        return Vec3d(centre + radius * (std::cos(2 * M_PI * u) * x + std::sin(2 * M_PI * u) * y));
    };
    return loft;
}

}  // namespace trocar
