#include "engine/lanes_avx512.hpp"
#include "engine/spring_kernels.hpp"
namespace trocar {
namespace {

// Rest positions of the anchors of a slice.
struct Goals {
    __m512 x, y, z;
};
inline __attribute__((always_inline)) Goals load_goals(const SpringStep* body, unsigned row) {
    return {_mm512_loadu_ps(body->anchor_x + row), _mm512_loadu_ps(body->anchor_y + row), _mm512_loadu_ps(body->anchor_z + row)};
}
// goal - x = turn * rest - (x - centre); the small difference is taken first.
inline __attribute__((always_inline)) __m512 to_goal(const SpringStep* body, const Goals& rest, int axis, __m512 x) {
    const auto turned = [&](const float* turn, __m512 sum) __attribute__((always_inline)) {
        sum = _mm512_fmadd_ps(_mm512_set1_ps(turn[2]), rest.z, sum);
        sum = _mm512_fmadd_ps(_mm512_set1_ps(turn[1]), rest.y, sum);
        return _mm512_fmadd_ps(_mm512_set1_ps(turn[0]), rest.x, sum);
    };
    const __m512 goal = turned(body->turn + 3 * axis, turned(body->turn_rest + 3 * axis, _mm512_setzero_ps()));
    const __m512 place = _mm512_sub_ps(_mm512_sub_ps(x, _mm512_set1_ps(body->centre[axis])), _mm512_set1_ps(body->centre_rest[axis]));
    return _mm512_sub_ps(goal, place);
}

// kVaried: springs differ in stiffness. kPacked: columns are read from `packed`.
template <bool kVaried, bool kPacked>
void step_springs(const SpringStep* body, unsigned first, unsigned last, double* damping_work) {
    const __m512 one = _mm512_set1_ps(1.0f), zero = _mm512_setzero_ps();
    const auto set = [](float v) { return _mm512_set1_ps(v); };
    const unsigned long first_half = 16ul * body->first_column;
    for (unsigned slice = first; slice < last; ++slice) {
        const unsigned row = 16 * slice;
        const Lanes p = load4(body->offset + 4ul * row);

        // springs
        __m512 fx = zero, fy = zero, fz = zero;
        const unsigned long end = 16ul * body->slice_column[slice + 1];
        for (unsigned long h = 16ul * body->slice_column[slice]; h < end; h += 16) {
            const unsigned short* packed = kPacked ? body->packed + 2 * (h - first_half) : nullptr;
            const Lanes q = kPacked ? gather4_near(body->offset, packed, long{row} - 32768) : gather4(body->offset, body->neighbour + h);
            const __m512 rest = kPacked ? _mm512_mul_ps(widen(packed + 16), set(body->rest_unit)) : _mm512_loadu_ps(body->rest_length + h);
            const __m512 dx = _mm512_sub_ps(q.x, p.x), dy = _mm512_sub_ps(q.y, p.y), dz = _mm512_sub_ps(q.z, p.z);
            const __m512 squared = _mm512_fmadd_ps(dx, dx, _mm512_fmadd_ps(dy, dy, _mm512_mul_ps(dz, dz)));
            const __m512 length = _mm512_sqrt_ps(squared);
            const __mmask16 apart = _mm512_cmp_ps_mask(length, zero, _CMP_GT_OQ);
            const __m512 ratio = _mm512_div_ps(rest, length);
            __m512 pull = _mm512_maskz_sub_ps(apart, one, ratio);
            if (kVaried) pull = _mm512_mul_ps(pull, _mm512_loadu_ps(body->spring_factor + h));
            fx = _mm512_fmadd_ps(pull, dx, fx);
            fy = _mm512_fmadd_ps(pull, dy, fy);
            fz = _mm512_fmadd_ps(pull, dz, fz);
        }

        const __m512 anchor = _mm512_loadu_ps(body->anchor_stiffness + row), k = set(body->stiffness);
        fx = _mm512_mul_ps(k, fx), fy = _mm512_mul_ps(k, fy), fz = _mm512_mul_ps(k, fz);
        if (_mm512_cmp_ps_mask(anchor, zero, _CMP_NEQ_UQ)) {  // a slice that nothing holds has no goals to read
            const Goals goals = load_goals(body, row);
            fx = _mm512_fmadd_ps(anchor, to_goal(body, goals, 0, p.x), fx);
            fy = _mm512_fmadd_ps(anchor, to_goal(body, goals, 1, p.y), fy);
            fz = _mm512_fmadd_ps(anchor, to_goal(body, goals, 2, p.z), fz);
        }
        if (body->force_x) {
            fx = _mm512_add_ps(fx, _mm512_loadu_ps(body->force_x + row));
            fy = _mm512_add_ps(fy, _mm512_loadu_ps(body->force_y + row));
            fz = _mm512_add_ps(fz, _mm512_loadu_ps(body->force_z + row));
        }

        // damping towards the drag velocity, then kick
        const __m512 vx = _mm512_loadu_ps(body->velocity_x + row), vy = _mm512_loadu_ps(body->velocity_y + row),
                     vz = _mm512_loadu_ps(body->velocity_z + row);
        const __m512 wx = set(body->drag_turn[0]), wy = set(body->drag_turn[1]), wz = set(body->drag_turn[2]);
        const __m512 ux = _mm512_add_ps(set(body->drag_velocity[0]), _mm512_fmsub_ps(wy, p.z, _mm512_mul_ps(wz, p.y)));
        const __m512 uy = _mm512_add_ps(set(body->drag_velocity[1]), _mm512_fmsub_ps(wz, p.x, _mm512_mul_ps(wx, p.z)));
        const __m512 uz = _mm512_add_ps(set(body->drag_velocity[2]), _mm512_fmsub_ps(wx, p.y, _mm512_mul_ps(wy, p.x)));
        const __m512 keep_less_one = _mm512_sub_ps(set(body->keep), one);
        const __m512 lost_x = _mm512_mul_ps(keep_less_one, _mm512_sub_ps(vx, ux));
        const __m512 lost_y = _mm512_mul_ps(keep_less_one, _mm512_sub_ps(vy, uy));
        const __m512 lost_z = _mm512_mul_ps(keep_less_one, _mm512_sub_ps(vz, uz));
        const __mmask16 free = _mm512_cmp_ps_mask(p.w, zero, _CMP_GT_OQ);
        const auto pulled = [&](__m512 f, float gravity) { return _mm512_fmadd_ps(f, p.w, set(gravity)); };
        const __m512 ax = pulled(fx, body->gravity[0]), ay = pulled(fy, body->gravity[1]), az = pulled(fz, body->gravity[2]);
        const auto kicked = [&](__m512 v, __m512 lost, __m512 a) {
            const __m512 damped = _mm512_add_ps(v, lost);
            return _mm512_maskz_fmadd_ps(free, a, set(body->kick_dt), damped);
        };
        const __m512 nx = kicked(vx, lost_x, ax), ny = kicked(vy, lost_y, ay), nz = kicked(vz, lost_z, az);
        _mm512_storeu_ps(body->new_velocity_x + row, nx);
        _mm512_storeu_ps(body->new_velocity_y + row, ny);
        _mm512_storeu_ps(body->new_velocity_z + row, nz);
        if (damping_work) {
            const __m512 less = set(body->kick_less);
            const auto power_of = [&](__m512 a, __m512 lost, __m512 v, __m512 n, __m512 sum) {
                return _mm512_fmadd_ps(_mm512_fmadd_ps(a, less, lost), _mm512_add_ps(v, n), sum);
            };
            const __m512 power = power_of(ax, lost_x, vx, nx, power_of(ay, lost_y, vy, ny, power_of(az, lost_z, vz, nz, zero)));
            const __m512 half_mass = _mm512_maskz_div_ps(free, set(0.5f), p.w);
            add_doubles(damping_work, _mm512_mul_ps(power, half_mass));
        }

        // drift
        const __m512 dt = set(body->dt);
        Lanes next = {_mm512_fmadd_ps(nx, dt, p.x), _mm512_fmadd_ps(ny, dt, p.y), _mm512_fmadd_ps(nz, dt, p.z), p.w};
        if (body->remainder_x) {
            const auto carried = [&](float* remainder, __m512 v, __m512 from) __attribute__((always_inline)) {
                const __m512 way = _mm512_fmadd_ps(v, dt, _mm512_loadu_ps(remainder + row));
                const __m512 to = _mm512_add_ps(from, way);
                _mm512_storeu_ps(remainder + row, _mm512_sub_ps(way, _mm512_sub_ps(to, from)));
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
    const auto to_double = [](__m512 v, int half) __attribute__((always_inline)) {
        return _mm512_cvtps_pd(half ? _mm512_extractf32x8_ps(v, 1) : _mm512_castps512_ps256(v));
    };
    for (int half = 0; half < 2; ++half) {
        __m512d total[kShapeSums];
        for (int s = 0; s < kShapeSums; ++s) total[s] = _mm512_loadu_pd(sums + 16 * s + 8 * half);
        for (unsigned slice = first; slice < last; ++slice) {
            const unsigned row = 16 * slice;
            const Lanes p = load4(body->offset + 4ul * row);
            const auto wide = [&](const float* values) __attribute__((always_inline)) {
                return _mm512_cvtps_pd(_mm256_loadu_ps(values + row + 8 * half));
            };
            const __m512d k = wide(body->anchor_stiffness);
            const __m512d r[3] = {wide(body->anchor_x), wide(body->anchor_y), wide(body->anchor_z)};
            const __m512d v[3] = {wide(body->velocity_x), wide(body->velocity_y), wide(body->velocity_z)};
            const __m512d back = _mm512_set1_pd(body->back);
            const __m512d x[3] = {_mm512_fnmadd_pd(back, v[0], to_double(p.x, half)), _mm512_fnmadd_pd(back, v[1], to_double(p.y, half)),
                                  _mm512_fnmadd_pd(back, v[2], to_double(p.z, half))};
            const __m512d inv_mass = to_double(p.w, half);
            const __m512d m =
                _mm512_maskz_div_pd(_mm512_cmp_pd_mask(inv_mass, _mm512_setzero_pd(), _CMP_GT_OQ), _mm512_set1_pd(1.0), inv_mass);
            total[kSumK] = _mm512_add_pd(total[kSumK], k);
            total[kSumM] = _mm512_add_pd(total[kSumM], m);
#pragma GCC unroll 3
            for (int i = 0; i < 3; ++i) {
                const int j = (i + 1) % 3, l = (i + 2) % 3;
                const __m512d kx = _mm512_mul_pd(k, x[i]), mx = _mm512_mul_pd(m, x[i]), mv = _mm512_mul_pd(m, v[i]);
                total[kSumKx + i] = _mm512_add_pd(total[kSumKx + i], kx);
                total[kSumKr + i] = _mm512_fmadd_pd(k, r[i], total[kSumKr + i]);
                total[kSumMx + i] = _mm512_add_pd(total[kSumMx + i], mx);
                total[kSumMv + i] = _mm512_add_pd(total[kSumMv + i], mv);
#pragma GCC unroll 3
                for (int c = 0; c < 3; ++c) {
                    total[kSumKxr + 3 * i + c] = _mm512_fmadd_pd(kx, r[c], total[kSumKxr + 3 * i + c]);
                }
                const __m512d turning = _mm512_fmsub_pd(x[j], v[l], _mm512_mul_pd(x[l], v[j]));
                total[kSumL + i] = _mm512_fmadd_pd(m, turning, total[kSumL + i]);
                total[kSumMxx + i] = _mm512_fmadd_pd(mx, x[i], total[kSumMxx + i]);
                // xy, xz, yz
                const int a = i == 2 ? 1 : 0, b = i == 0 ? 1 : 2;
                total[kSumMxx + 3 + i] = _mm512_fmadd_pd(_mm512_mul_pd(m, x[a]), x[b], total[kSumMxx + 3 + i]);
            }
        }
        for (int s = 0; s < kShapeSums; ++s) _mm512_storeu_pd(sums + 16 * s + 8 * half, total[s]);
    }
}

// The four sums of moving masses, for one half of the lanes in double.
inline __attribute__((always_inline)) void add_moving(double* sums, __m512d w, const __m512d* x, const __m512d* v, __m512d back) {
    const __m512d m = _mm512_maskz_div_pd(_mm512_cmp_pd_mask(w, _mm512_setzero_pd(), _CMP_GT_OQ), _mm512_set1_pd(1.0), w);
    const auto add = [&](int sum, __m512d value) __attribute__((always_inline)) {
        _mm512_storeu_pd(sums + 16 * sum, _mm512_add_pd(_mm512_loadu_pd(sums + 16 * sum), value));
    };
    add(kSumMvv, _mm512_mul_pd(m, _mm512_fmadd_pd(v[0], v[0], _mm512_fmadd_pd(v[1], v[1], _mm512_mul_pd(v[2], v[2])))));
    add(kSumMass, m);
    for (int i = 0; i < 3; ++i) add(kSumMPlace + i, _mm512_mul_pd(m, _mm512_fnmadd_pd(back, v[i], x[i])));
}

void energy_sums(const SpringStep* body, unsigned first, unsigned last, double* sums) {
    const __m512 back = _mm512_set1_ps(body->back);
    for (unsigned slice = first; slice < last; ++slice) {
        const unsigned lane = 0, row = 16 * slice;
        const Lanes p = load4(body->offset + 4ul * row);
        const __m512 v[3] = {_mm512_loadu_ps(body->velocity_x + row), _mm512_loadu_ps(body->velocity_y + row),
                             _mm512_loadu_ps(body->velocity_z + row)};

        // springs: differences of places and of velocities first, both small
        const unsigned long end = 16ul * body->slice_column[slice + 1];
        for (unsigned long h = 16ul * body->slice_column[slice]; h < end; h += 16) {
            const Lanes q = gather4(body->offset, body->neighbour + h + lane);
            const __m512i index = _mm512_loadu_si512(body->neighbour + h);
            const __m512 dx =
                _mm512_fnmadd_ps(back, _mm512_sub_ps(_mm512_i32gather_ps(index, body->velocity_x, 4), v[0]), _mm512_sub_ps(q.x, p.x));
            const __m512 dy =
                _mm512_fnmadd_ps(back, _mm512_sub_ps(_mm512_i32gather_ps(index, body->velocity_y, 4), v[1]), _mm512_sub_ps(q.y, p.y));
            const __m512 dz =
                _mm512_fnmadd_ps(back, _mm512_sub_ps(_mm512_i32gather_ps(index, body->velocity_z, 4), v[2]), _mm512_sub_ps(q.z, p.z));
            const __m512 squared = _mm512_fmadd_ps(dx, dx, _mm512_fmadd_ps(dy, dy, _mm512_mul_ps(dz, dz)));
            const __m512 stretch = _mm512_sub_ps(_mm512_sqrt_ps(squared), _mm512_loadu_ps(body->rest_length + h + lane));
            const __m512 factor = body->spring_factor ? _mm512_loadu_ps(body->spring_factor + h) : _mm512_set1_ps(1.0f);
            add_doubles(sums + 16 * kSumStretch + lane, _mm512_mul_ps(_mm512_mul_ps(stretch, stretch), factor));
        }

        // anchors
        const Goals goals = load_goals(body, row);
        const __m512 gx = _mm512_fmadd_ps(back, v[0], to_goal(body, goals, 0, p.x));
        const __m512 gy = _mm512_fmadd_ps(back, v[1], to_goal(body, goals, 1, p.y));
        const __m512 gz = _mm512_fmadd_ps(back, v[2], to_goal(body, goals, 2, p.z));
        const __m512 apart = _mm512_fmadd_ps(gx, gx, _mm512_fmadd_ps(gy, gy, _mm512_mul_ps(gz, gz)));
        add_doubles(sums + 16 * kSumAnchor + lane, _mm512_mul_ps(_mm512_loadu_ps(body->anchor_stiffness + row), apart));

        // masses
        const __m512d wide_back = _mm512_set1_pd(body->back);
        const __m512d low_x[3] = {_mm512_cvtps_pd(_mm512_castps512_ps256(p.x)), _mm512_cvtps_pd(_mm512_castps512_ps256(p.y)),
                                  _mm512_cvtps_pd(_mm512_castps512_ps256(p.z))};
        const __m512d low_v[3] = {_mm512_cvtps_pd(_mm512_castps512_ps256(v[0])), _mm512_cvtps_pd(_mm512_castps512_ps256(v[1])),
                                  _mm512_cvtps_pd(_mm512_castps512_ps256(v[2]))};
        add_moving(sums + lane, _mm512_cvtps_pd(_mm512_castps512_ps256(p.w)), low_x, low_v, wide_back);
        const __m512d high_x[3] = {_mm512_cvtps_pd(_mm512_extractf32x8_ps(p.x, 1)), _mm512_cvtps_pd(_mm512_extractf32x8_ps(p.y, 1)),
                                   _mm512_cvtps_pd(_mm512_extractf32x8_ps(p.z, 1))};
        const __m512d high_v[3] = {_mm512_cvtps_pd(_mm512_extractf32x8_ps(v[0], 1)), _mm512_cvtps_pd(_mm512_extractf32x8_ps(v[1], 1)),
                                   _mm512_cvtps_pd(_mm512_extractf32x8_ps(v[2], 1))};
        add_moving(sums + lane + 8, _mm512_cvtps_pd(_mm512_extractf32x8_ps(p.w, 1)), high_x, high_v, wide_back);
    }
}

}  // namespace

extern const SpringKernels kSpringKernelsAvx512 = {step, shape_sums, energy_sums};

}  // namespace trocar
