#include "engine/lanes_avx2.hpp"
#include "engine/spring_kernels.hpp"
namespace trocar {
namespace {

// Rest positions of the anchors of a slice.
struct Goals {
    __m256 x, y, z;
};
inline __attribute__((always_inline)) Goals load_goals(const SpringStep* body, unsigned row) {
    return {_mm256_loadu_ps(body->anchor_x + row), _mm256_loadu_ps(body->anchor_y + row), _mm256_loadu_ps(body->anchor_z + row)};
}
// goal - x = turn * rest - (x - centre); the small difference is taken first.
inline __attribute__((always_inline)) __m256 to_goal(const SpringStep* body, const Goals& rest, int axis, __m256 x) {
    const auto turned = [&](const float* turn, __m256 sum) __attribute__((always_inline)) {
        sum = _mm256_fmadd_ps(_mm256_set1_ps(turn[2]), rest.z, sum);
        sum = _mm256_fmadd_ps(_mm256_set1_ps(turn[1]), rest.y, sum);
        return _mm256_fmadd_ps(_mm256_set1_ps(turn[0]), rest.x, sum);
    };
    const __m256 goal = turned(body->turn + 3 * axis, turned(body->turn_rest + 3 * axis, _mm256_setzero_ps()));
    const __m256 place = _mm256_sub_ps(_mm256_sub_ps(x, _mm256_set1_ps(body->centre[axis])), _mm256_set1_ps(body->centre_rest[axis]));
    return _mm256_sub_ps(goal, place);
}

// kVaried: springs differ in stiffness. kPacked: columns are read from `packed`.
template <bool kVaried, bool kPacked>
void step_springs(const SpringStep* body, unsigned first, unsigned last, double* damping_work) {
    const __m256 one = _mm256_set1_ps(1.0f), zero = _mm256_setzero_ps();
    const auto set = [](float v) { return _mm256_set1_ps(v); };
    const unsigned long first_half = 16ul * body->first_column;
    for (unsigned half_slice = 2 * first; half_slice < 2 * last; ++half_slice) {
        const unsigned slice = half_slice / 2, lane = 8 * (half_slice % 2), row = 16 * slice + lane;
        const Lanes p = load4(body->offset + 4ul * row);

        // springs
        __m256 fx = zero, fy = zero, fz = zero;
        const unsigned long end = 16ul * body->slice_column[slice + 1];
        for (unsigned long h = 16ul * body->slice_column[slice]; h < end; h += 16) {
            const unsigned short* packed = kPacked ? body->packed + 2 * (h - first_half) + lane : nullptr;
            const Lanes q =
                kPacked ? gather4_near(body->offset, packed, long{16 * slice} - 32768) : gather4(body->offset, body->neighbour + h + lane);
            const __m256 rest =
                kPacked ? _mm256_mul_ps(widen(packed + 16), set(body->rest_unit)) : _mm256_loadu_ps(body->rest_length + h + lane);
            const __m256 dx = _mm256_sub_ps(q.x, p.x), dy = _mm256_sub_ps(q.y, p.y), dz = _mm256_sub_ps(q.z, p.z);
            const __m256 squared = _mm256_fmadd_ps(dx, dx, _mm256_fmadd_ps(dy, dy, _mm256_mul_ps(dz, dz)));
            const __m256 length = _mm256_sqrt_ps(squared);
            const __m256 apart = _mm256_cmp_ps(length, zero, _CMP_GT_OQ);
            const __m256 ratio = _mm256_div_ps(rest, length);
            __m256 pull = _mm256_and_ps(apart, _mm256_sub_ps(one, ratio));
            if (kVaried) pull = _mm256_mul_ps(pull, _mm256_loadu_ps(body->spring_factor + h + lane));
            fx = _mm256_fmadd_ps(pull, dx, fx);
            fy = _mm256_fmadd_ps(pull, dy, fy);
            fz = _mm256_fmadd_ps(pull, dz, fz);
        }

        const __m256 anchor = _mm256_loadu_ps(body->anchor_stiffness + row), k = set(body->stiffness);
        const __m256 beside = _mm256_loadu_ps(body->anchor_stiffness + 16 * slice + (8 - lane));
        fx = _mm256_mul_ps(k, fx), fy = _mm256_mul_ps(k, fy), fz = _mm256_mul_ps(k, fz);
        // a slice that nothing holds has no goals to read; asked for all its 16, as the other kernel does
        if (_mm256_movemask_ps(_mm256_or_ps(_mm256_cmp_ps(anchor, zero, _CMP_NEQ_UQ), _mm256_cmp_ps(beside, zero, _CMP_NEQ_UQ)))) {
            const Goals goals = load_goals(body, row);
            fx = _mm256_fmadd_ps(anchor, to_goal(body, goals, 0, p.x), fx);
            fy = _mm256_fmadd_ps(anchor, to_goal(body, goals, 1, p.y), fy);
            fz = _mm256_fmadd_ps(anchor, to_goal(body, goals, 2, p.z), fz);
        }
        if (body->force_x) {
            fx = _mm256_add_ps(fx, _mm256_loadu_ps(body->force_x + row));
            fy = _mm256_add_ps(fy, _mm256_loadu_ps(body->force_y + row));
            fz = _mm256_add_ps(fz, _mm256_loadu_ps(body->force_z + row));
        }

        // damping towards the drag velocity, then kick
        const __m256 vx = _mm256_loadu_ps(body->velocity_x + row), vy = _mm256_loadu_ps(body->velocity_y + row),
                     vz = _mm256_loadu_ps(body->velocity_z + row);
        const __m256 wx = set(body->drag_turn[0]), wy = set(body->drag_turn[1]), wz = set(body->drag_turn[2]);
        const __m256 ux = _mm256_add_ps(set(body->drag_velocity[0]), _mm256_fmsub_ps(wy, p.z, _mm256_mul_ps(wz, p.y)));
        const __m256 uy = _mm256_add_ps(set(body->drag_velocity[1]), _mm256_fmsub_ps(wz, p.x, _mm256_mul_ps(wx, p.z)));
        const __m256 uz = _mm256_add_ps(set(body->drag_velocity[2]), _mm256_fmsub_ps(wx, p.y, _mm256_mul_ps(wy, p.x)));
        const __m256 keep_less_one = _mm256_sub_ps(set(body->keep), one);
        const __m256 lost_x = _mm256_mul_ps(keep_less_one, _mm256_sub_ps(vx, ux));
        const __m256 lost_y = _mm256_mul_ps(keep_less_one, _mm256_sub_ps(vy, uy));
        const __m256 lost_z = _mm256_mul_ps(keep_less_one, _mm256_sub_ps(vz, uz));
        const __m256 free = _mm256_cmp_ps(p.w, zero, _CMP_GT_OQ);
        const auto pulled = [&](__m256 f, float gravity) { return _mm256_fmadd_ps(f, p.w, set(gravity)); };
        const __m256 ax = pulled(fx, body->gravity[0]), ay = pulled(fy, body->gravity[1]), az = pulled(fz, body->gravity[2]);
        const auto kicked = [&](__m256 v, __m256 lost, __m256 a) {
            const __m256 damped = _mm256_add_ps(v, lost);
            return _mm256_and_ps(free, _mm256_fmadd_ps(a, set(body->kick_dt), damped));
        };
        const __m256 nx = kicked(vx, lost_x, ax), ny = kicked(vy, lost_y, ay), nz = kicked(vz, lost_z, az);
        _mm256_storeu_ps(body->new_velocity_x + row, nx);
        _mm256_storeu_ps(body->new_velocity_y + row, ny);
        _mm256_storeu_ps(body->new_velocity_z + row, nz);
        if (damping_work) {
            const __m256 less = set(body->kick_less);
            const auto power_of = [&](__m256 a, __m256 lost, __m256 v, __m256 n, __m256 sum) {
                return _mm256_fmadd_ps(_mm256_fmadd_ps(a, less, lost), _mm256_add_ps(v, n), sum);
            };
            const __m256 power = power_of(ax, lost_x, vx, nx, power_of(ay, lost_y, vy, ny, power_of(az, lost_z, vz, nz, zero)));
            const __m256 half_mass = _mm256_and_ps(free, _mm256_div_ps(set(0.5f), p.w));
            add_doubles(damping_work + lane, _mm256_mul_ps(power, half_mass));
        }

        // drift
        const __m256 dt = set(body->dt);
        Lanes next = {_mm256_fmadd_ps(nx, dt, p.x), _mm256_fmadd_ps(ny, dt, p.y), _mm256_fmadd_ps(nz, dt, p.z), p.w};
        if (body->remainder_x) {
            const auto carried = [&](float* remainder, __m256 v, __m256 from) __attribute__((always_inline)) {
                const __m256 way = _mm256_fmadd_ps(v, dt, _mm256_loadu_ps(remainder + row));
                const __m256 to = _mm256_add_ps(from, way);
                _mm256_storeu_ps(remainder + row, _mm256_sub_ps(way, _mm256_sub_ps(to, from)));
                return to;
            };
            next.x = carried(body->remainder_x, nx, p.x);
            next.y = carried(body->remainder_y, ny, p.y);
            next.z = carried(body->remainder_z, nz, p.z);
        }
        store4(body->new_offset + 4ul * row, next);
    }
}

void step(const SpringStep* body, unsigned first, unsigned last, double* damping_work) {
    const auto kernel = body->packed ? (body->spring_factor ? step_springs<true, true> : step_springs<false, true>)
                                     : (body->spring_factor ? step_springs<true, false> : step_springs<false, false>);
    kernel(body, first, last, damping_work);
}

void shape_sums(const SpringStep* body, unsigned first, unsigned last, double* sums) {
    const __m256d one = _mm256_set1_pd(1.0), zero = _mm256_setzero_pd();
    for (int lane = 0; lane < 16; lane += 4) {
        __m256d total[kShapeSums];
        for (int s = 0; s < kShapeSums; ++s) total[s] = _mm256_loadu_pd(sums + 16 * s + lane);
        for (unsigned slice = first; slice < last; ++slice) {
            const unsigned row = 16 * slice + lane;
            __m128 px = _mm_load_ps(body->offset + 4ul * row), py = _mm_load_ps(body->offset + 4ul * row + 4),
                   pz = _mm_load_ps(body->offset + 4ul * row + 8), pw = _mm_load_ps(body->offset + 4ul * row + 12);
            _MM_TRANSPOSE4_PS(px, py, pz, pw);
            const auto wide = [&](const float* values) __attribute__((always_inline)) {
                return _mm256_cvtps_pd(_mm_loadu_ps(values + row));
            };
            const __m256d k = wide(body->anchor_stiffness);
            const __m256d r[3] = {wide(body->anchor_x), wide(body->anchor_y), wide(body->anchor_z)};
            const __m256d v[3] = {wide(body->velocity_x), wide(body->velocity_y), wide(body->velocity_z)};
            const __m256d back = _mm256_set1_pd(body->back);
            const __m256d x[3] = {_mm256_fnmadd_pd(back, v[0], _mm256_cvtps_pd(px)), _mm256_fnmadd_pd(back, v[1], _mm256_cvtps_pd(py)),
                                  _mm256_fnmadd_pd(back, v[2], _mm256_cvtps_pd(pz))};
            const __m256d inv_mass = _mm256_cvtps_pd(pw);
            const __m256d m = _mm256_and_pd(_mm256_cmp_pd(inv_mass, zero, _CMP_GT_OQ), _mm256_div_pd(one, inv_mass));
            total[kSumK] = _mm256_add_pd(total[kSumK], k);
            total[kSumM] = _mm256_add_pd(total[kSumM], m);
#pragma GCC unroll 3
            for (int i = 0; i < 3; ++i) {
                const int j = (i + 1) % 3, l = (i + 2) % 3;
                const __m256d kx = _mm256_mul_pd(k, x[i]), mx = _mm256_mul_pd(m, x[i]), mv = _mm256_mul_pd(m, v[i]);
                total[kSumKx + i] = _mm256_add_pd(total[kSumKx + i], kx);
                total[kSumKr + i] = _mm256_fmadd_pd(k, r[i], total[kSumKr + i]);
                total[kSumMx + i] = _mm256_add_pd(total[kSumMx + i], mx);
                total[kSumMv + i] = _mm256_add_pd(total[kSumMv + i], mv);
#pragma GCC unroll 3
                for (int c = 0; c < 3; ++c) {
                    total[kSumKxr + 3 * i + c] = _mm256_fmadd_pd(kx, r[c], total[kSumKxr + 3 * i + c]);
                }
                const __m256d turning = _mm256_fmsub_pd(x[j], v[l], _mm256_mul_pd(x[l], v[j]));
                total[kSumL + i] = _mm256_fmadd_pd(m, turning, total[kSumL + i]);
                total[kSumMxx + i] = _mm256_fmadd_pd(mx, x[i], total[kSumMxx + i]);
                // xy, xz, yz
                const int a = i == 2 ? 1 : 0, b = i == 0 ? 1 : 2;
                total[kSumMxx + 3 + i] = _mm256_fmadd_pd(_mm256_mul_pd(m, x[a]), x[b], total[kSumMxx + 3 + i]);
            }
        }
        for (int s = 0; s < kShapeSums; ++s) _mm256_storeu_pd(sums + 16 * s + lane, total[s]);
    }
}

// The four sums of moving masses, for one half of the lanes in double.
inline __attribute__((always_inline)) void add_moving(double* sums, __m256d w, const __m256d* x, const __m256d* v, __m256d back) {
    const __m256d m = _mm256_and_pd(_mm256_cmp_pd(w, _mm256_setzero_pd(), _CMP_GT_OQ), _mm256_div_pd(_mm256_set1_pd(1.0), w));
    const auto add = [&](int sum, __m256d value) __attribute__((always_inline)) {
        _mm256_storeu_pd(sums + 16 * sum, _mm256_add_pd(_mm256_loadu_pd(sums + 16 * sum), value));
    };
    add(kSumMvv, _mm256_mul_pd(m, _mm256_fmadd_pd(v[0], v[0], _mm256_fmadd_pd(v[1], v[1], _mm256_mul_pd(v[2], v[2])))));
    add(kSumMass, m);
    for (int i = 0; i < 3; ++i) add(kSumMPlace + i, _mm256_mul_pd(m, _mm256_fnmadd_pd(back, v[i], x[i])));
}

void energy_sums(const SpringStep* body, unsigned first, unsigned last, double* sums) {
    const __m256 back = _mm256_set1_ps(body->back);
    for (unsigned half_slice = 2 * first; half_slice < 2 * last; ++half_slice) {
        const unsigned slice = half_slice / 2, lane = 8 * (half_slice % 2), row = 16 * slice + lane;
        const Lanes p = load4(body->offset + 4ul * row);
        const __m256 v[3] = {_mm256_loadu_ps(body->velocity_x + row), _mm256_loadu_ps(body->velocity_y + row),
                             _mm256_loadu_ps(body->velocity_z + row)};

        // springs: differences of places and of velocities first, both small
        const unsigned long end = 16ul * body->slice_column[slice + 1];
        for (unsigned long h = 16ul * body->slice_column[slice]; h < end; h += 16) {
            const Lanes q = gather4(body->offset, body->neighbour + h + lane);
            const __m256i index = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(body->neighbour + h + lane));
            const __m256 dx =
                _mm256_fnmadd_ps(back, _mm256_sub_ps(_mm256_i32gather_ps(body->velocity_x, index, 4), v[0]), _mm256_sub_ps(q.x, p.x));
            const __m256 dy =
                _mm256_fnmadd_ps(back, _mm256_sub_ps(_mm256_i32gather_ps(body->velocity_y, index, 4), v[1]), _mm256_sub_ps(q.y, p.y));
            const __m256 dz =
                _mm256_fnmadd_ps(back, _mm256_sub_ps(_mm256_i32gather_ps(body->velocity_z, index, 4), v[2]), _mm256_sub_ps(q.z, p.z));
            const __m256 squared = _mm256_fmadd_ps(dx, dx, _mm256_fmadd_ps(dy, dy, _mm256_mul_ps(dz, dz)));
            const __m256 stretch = _mm256_sub_ps(_mm256_sqrt_ps(squared), _mm256_loadu_ps(body->rest_length + h + lane));
            const __m256 factor = body->spring_factor ? _mm256_loadu_ps(body->spring_factor + h + lane) : _mm256_set1_ps(1.0f);
            add_doubles(sums + 16 * kSumStretch + lane, _mm256_mul_ps(_mm256_mul_ps(stretch, stretch), factor));
        }

        // anchors
        const Goals goals = load_goals(body, row);
        const __m256 gx = _mm256_fmadd_ps(back, v[0], to_goal(body, goals, 0, p.x));
        const __m256 gy = _mm256_fmadd_ps(back, v[1], to_goal(body, goals, 1, p.y));
        const __m256 gz = _mm256_fmadd_ps(back, v[2], to_goal(body, goals, 2, p.z));
        const __m256 apart = _mm256_fmadd_ps(gx, gx, _mm256_fmadd_ps(gy, gy, _mm256_mul_ps(gz, gz)));
        add_doubles(sums + 16 * kSumAnchor + lane, _mm256_mul_ps(_mm256_loadu_ps(body->anchor_stiffness + row), apart));

        // masses
        const __m256d wide_back = _mm256_set1_pd(body->back);
        const __m256d low_x[3] = {_mm256_cvtps_pd(_mm256_castps256_ps128(p.x)), _mm256_cvtps_pd(_mm256_castps256_ps128(p.y)),
                                  _mm256_cvtps_pd(_mm256_castps256_ps128(p.z))};
        const __m256d low_v[3] = {_mm256_cvtps_pd(_mm256_castps256_ps128(v[0])), _mm256_cvtps_pd(_mm256_castps256_ps128(v[1])),
                                  _mm256_cvtps_pd(_mm256_castps256_ps128(v[2]))};
        add_moving(sums + lane, _mm256_cvtps_pd(_mm256_castps256_ps128(p.w)), low_x, low_v, wide_back);
        const __m256d high_x[3] = {_mm256_cvtps_pd(_mm256_extractf128_ps(p.x, 1)), _mm256_cvtps_pd(_mm256_extractf128_ps(p.y, 1)),
                                   _mm256_cvtps_pd(_mm256_extractf128_ps(p.z, 1))};
        const __m256d high_v[3] = {_mm256_cvtps_pd(_mm256_extractf128_ps(v[0], 1)), _mm256_cvtps_pd(_mm256_extractf128_ps(v[1], 1)),
                                   _mm256_cvtps_pd(_mm256_extractf128_ps(v[2], 1))};
        add_moving(sums + lane + 4, _mm256_cvtps_pd(_mm256_extractf128_ps(p.w, 1)), high_x, high_v, wide_back);
    }
}

}  // namespace

extern const SpringKernels kSpringKernelsAvx2 = {step, shape_sums, energy_sums};

}  // namespace trocar
