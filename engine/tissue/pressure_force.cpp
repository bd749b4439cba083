#include "engine/tissue/pressure_force.hpp"

#include <algorithm>
#include <cmath>

#include "engine/jobs/parallel.hpp"
#include "engine/kernels/lanes_avx2.hpp"
#include "engine/tissue/spring_step.hpp"
namespace trocar {
namespace {

// Gradients of slices [first, last), and 16 lanes of 3 V.
void gradient_slices(const float* offset, const uint32_t* column, const uint32_t* corner, uint32_t first, uint32_t last,
                     float* const gradient[3], double* volume) {
    const __m256 sixth = _mm256_set1_ps(1.0f / 6.0f);
    const Float4 centre = {offset[0], offset[1], offset[2], 0};
    for (uint32_t half_slice = 2 * first; half_slice < 2 * last; ++half_slice) {
        const uint32_t slice = half_slice / 2, lane = 8 * (half_slice % 2), index = 16 * slice + lane;
        const Lanes p = load4(offset + 4ul * index);
        __m256 gx = _mm256_setzero_ps(), gy = gx, gz = gx;
        for (uint32_t c = column[slice]; c < column[slice + 1]; ++c) {
            const Lanes j = gather4(offset, corner + 32ul * c + lane), k = gather4(offset, corner + 32ul * c + 16 + lane);
            const __m256 ax = _mm256_sub_ps(j.x, p.x), ay = _mm256_sub_ps(j.y, p.y), az = _mm256_sub_ps(j.z, p.z);
            const __m256 bx = _mm256_sub_ps(k.x, p.x), by = _mm256_sub_ps(k.y, p.y), bz = _mm256_sub_ps(k.z, p.z);
            gx = _mm256_add_ps(gx, _mm256_fmsub_ps(ay, bz, _mm256_mul_ps(az, by)));
            gy = _mm256_add_ps(gy, _mm256_fmsub_ps(az, bx, _mm256_mul_ps(ax, bz)));
            gz = _mm256_add_ps(gz, _mm256_fmsub_ps(ax, by, _mm256_mul_ps(ay, bx)));
        }
        gx = _mm256_mul_ps(sixth, gx), gy = _mm256_mul_ps(sixth, gy), gz = _mm256_mul_ps(sixth, gz);
        _mm256_storeu_ps(gradient[0] + index, gx);
        _mm256_storeu_ps(gradient[1] + index, gy);
        _mm256_storeu_ps(gradient[2] + index, gz);
        const auto share = [&](__m256 x, float from, __m256 g) __attribute__((always_inline)) {
            const __m256 apart = _mm256_sub_ps(x, _mm256_set1_ps(from));
            const __m256d low = _mm256_mul_pd(_mm256_cvtps_pd(_mm256_castps256_ps128(apart)), _mm256_cvtps_pd(_mm256_castps256_ps128(g)));
            const __m256d high =
                _mm256_mul_pd(_mm256_cvtps_pd(_mm256_extractf128_ps(apart, 1)), _mm256_cvtps_pd(_mm256_extractf128_ps(g, 1)));
            _mm256_storeu_pd(volume + lane, _mm256_add_pd(_mm256_loadu_pd(volume + lane), low));
            _mm256_storeu_pd(volume + lane + 4, _mm256_add_pd(_mm256_loadu_pd(volume + lane + 4), high));
        };
        share(p.x, centre.x, gx), share(p.y, centre.y, gy), share(p.z, centre.z, gz);
    }
}

double rest_volume(const Springs& springs, const Bodies& bodies, uint32_t body) { return springs.fans.volume[bodies.mesh[body]]; }

// Sum over the edges around a vertex of the distance between the two corners opposite the edge.
double facing_corners(const Springs& springs, uint32_t prototype, const Float4* offset, uint32_t v) {
    const uint32_t* column = springs.fans.column.data() + springs.fans.first[prototype] + v / kSliceWidth;
    const uint32_t* corner = springs.fans.corner.data() + v % kSliceWidth;
    const auto position = [&](uint32_t i) { return Vec3d(offset[i].x, offset[i].y, offset[i].z); };
    const auto next = [&](uint32_t c) { return corner[2 * kSliceWidth * c]; };
    const auto last = [&](uint32_t c) { return corner[2 * kSliceWidth * c + kSliceWidth]; };
    double sum = 0;
    for (uint32_t c = column[0]; c < column[1]; ++c) {
        for (uint32_t other = column[0]; other < column[1]; ++other) {
            if (next(c) != v && last(other) == next(c)) sum += (position(last(c)) - position(next(other))).norm();
        }
    }
    return sum;
}

}  // namespace

void add_fans(Springs& springs, const MeshView& mesh, uint32_t prototype) {
    Fans& fans = springs.fans;
    if (fans.first.size() <= prototype) {
        fans.first.resize(prototype + 1, kNone);
        fans.volume.resize(prototype + 1, 0.0);
    }
    if (fans.first[prototype] != kNone) return;
    fans.first[prototype] = static_cast<uint32_t>(fans.column.size());
    fans.volume[prototype] = mesh.info->volume;
    const auto degree = [&](uint32_t v) { return v < mesh.position.size() ? mesh.incident_first[v + 1] - mesh.incident_first[v] : 0u; };
    for (uint32_t slice = 0; slice < springs.info[prototype].slices.count; ++slice) {
        const size_t column = fans.corner.size() / (2 * kSliceWidth);
        fans.column.push_back(static_cast<uint32_t>(column));
        uint32_t columns = 0;
        for (uint32_t lane = 0; lane < kSliceWidth; ++lane) columns = std::max(columns, degree(slice * kSliceWidth + lane));
        fans.corner.resize((column + columns) * 2 * kSliceWidth);
        for (uint32_t c = 0; c < columns; ++c) {
            for (uint32_t lane = 0; lane < kSliceWidth; ++lane) {
                const uint32_t v = slice * kSliceWidth + lane;
                uint32_t* entry = fans.corner.data() + (column + c) * 2 * kSliceWidth + lane;
                entry[0] = entry[kSliceWidth] = v;
                if (c >= degree(v)) continue;
                const Triangle& t = mesh.triangle[mesh.incident[mesh.incident_first[v] + c]];
                const uint32_t own = t[0] == v ? 0 : t[1] == v ? 1 : 2;
                entry[0] = t[(own + 1) % 3], entry[kSliceWidth] = t[(own + 2) % 3];
            }
        }
    }
    fans.column.push_back(static_cast<uint32_t>(fans.corner.size() / (2 * kSliceWidth)));
}

double find_volume_gradient(const Springs& springs, uint32_t prototype, const Float4* offset, std::vector<double>& sums, float* gradient_x,
                            float* gradient_y, float* gradient_z) {
    const uint32_t slices = springs.info[prototype].slices.count;
    const uint32_t* column = springs.fans.column.data() + springs.fans.first[prototype];
    float* const gradient[3] = {gradient_x, gradient_y, gradient_z};
    sums.assign(size_t{chunk_count(slices, kSlicesPerChunk)} * kSliceWidth, 0.0);
    for_slices(slices, [&](uint32_t begin, uint32_t end) {
        gradient_slices(&offset->x, column, springs.fans.corner.data(), begin, end, gradient,
                        sums.data() + size_t{begin / kSlicesPerChunk} * kSliceWidth);
    });
    double total = 0;
    for (const double sum : sums) total += sum;
    return total / 3;
}

double find_pressure(const Springs& springs, const Bodies& bodies, uint32_t body, double volume) {
    const double rest = rest_volume(springs, bodies, body);
    return bodies.tissue[body].pressure_modulus * (rest - volume) / std::abs(rest);
}

double find_pressure_energy(const Springs& springs, const Bodies& bodies, uint32_t body, double volume) {
    const double rest = rest_volume(springs, bodies, body);
    return 0.5 * bodies.tissue[body].pressure_modulus * (volume - rest) * (volume - rest) / std::abs(rest);
}

double pressure_omega_squared(const Springs& springs, const Bodies& bodies, const Particles& particles, uint32_t body) {
    const uint32_t prototype = bodies.mesh[body];
    const uint32_t skin = springs.info[prototype].skin;
    const Range range{bodies.particles[body].first + skin, bodies.particles[body].count - skin};
    const Float4* offset = particles.offset.data() + range.first;
    std::vector<float> gradient(size_t{3} * range.count);
    std::vector<double> sums;
    float* g = gradient.data();
    find_volume_gradient(springs, prototype, offset, sums, g, g + range.count, g + 2 * range.count);
    double rank_one = 0, row_sum = 0;
    for (uint32_t v = 0; v < range.count; ++v) {
        rank_one += offset[v].w * Vec3d(g[v], g[v + range.count], g[v + 2 * range.count]).squaredNorm();
        row_sum = std::max(row_sum, offset[v].w * facing_corners(springs, prototype, offset, v) / 6);
    }
    const double rest = std::abs(rest_volume(springs, bodies, body));
    return bodies.tissue[body].pressure_modulus *
           (std::pow(kStretchReserve, 4) * rank_one / rest + kVolumeReserve * kStretchReserve * row_sum);
}

}  // namespace trocar
