// The kernels of both instruction sets. The file that includes this one defines V (kWidth floats), D (kWide doubles), Lanes
// (x, y, z, w) and what lanes_avx2.inl and lanes_avx512.inl do with them.

// Rest positions of the anchors of kWidth particles.
struct Goals {
    V x, y, z;
};
TROCAR_LANES Goals load_goals(const SpringStep* body, unsigned base) {
    return {load(body->anchor_x + base), load(body->anchor_y + base), load(body->anchor_z + base)};
}
// goal - x = turn * rest - (x - centre); the small difference is taken first.
TROCAR_LANES V to_goal(const SpringStep* body, const Goals& rest, int axis, V x) {
    const auto turned = [&](const float* turn, V sum) __attribute__((always_inline)) {
        sum = multiply_add(set(turn[2]), rest.z, sum);
        sum = multiply_add(set(turn[1]), rest.y, sum);
        return multiply_add(set(turn[0]), rest.x, sum);
    };
    const V goal = turned(body->turn + 3 * axis, turned(body->turn_rest + 3 * axis, set(0)));
    return goal - ((x - set(body->centre[axis])) - set(body->centre_rest[axis]));
}
// The same from x + remainder.
TROCAR_LANES V to_goal_exactly(const SpringStep* body, const Goals& rest, int axis, V x, V remainder) {
    const auto turn = [&](int i) { return set_wide(double(body->turn[3 * axis + i]) + double(body->turn_rest[3 * axis + i])); };
    const D centre = set_wide(double(body->centre[axis]) + double(body->centre_rest[axis]));
    const auto half = [&](int h) __attribute__((always_inline)) {
        const D from = (centre - widened(x, h)) - widened(remainder, h);
        return multiply_add(turn(0), widened(rest.x, h),
                            multiply_add(turn(1), widened(rest.y, h), multiply_add(turn(2), widened(rest.z, h), from)));
    };
    return narrowed(half(0), half(1));
}
TROCAR_LANES V squared_length(V x, V y, V z) { return multiply_add(x, x, multiply_add(y, y, z * z)); }

// Maxwell elements of the springs of half-edges from `at` on, of which `stretch` is now so long: sums of branches.
struct Relaxed {
    V pull;    // m, their tension / stiffness
    V stored;  // m^2, their energy / stiffness
    V heat;    // m^2, energy that they lost / stiffness
};
template <bool kKeep>
TROCAR_LANES Relaxed relaxed(const SpringStep* body, unsigned long at, V stretch) {
    Relaxed sum = {set(0), set(0), set(0)};
    const V change = stretch - load(body->stretch + at);
    if (kKeep) keep_store(body->stretch + at, stretch);
    for (unsigned branch = 0; branch < body->branches; ++branch) {
        float* const place = body->overstretch + branch * static_cast<unsigned long>(body->branch_stride) + at;
        const V before = load(place);
        const V now = multiply_add(set(body->gain[branch]), change, subtract_product(before, set(body->lost[branch]), before));
        if (kKeep) keep_store(place, now);
        const float* heat = body->heat[branch];
        sum.pull = sum.pull + now;
        sum.stored = multiply_add(set(body->stored[branch]) * now, now, sum.stored);
        sum.heat =
            multiply_add(multiply_add(set(heat[0]), before, set(heat[1]) * now), before, multiply_add(set(heat[2]) * now, now, sum.heat));
    }
    return sum;
}

// kVaried: springs differ in stiffness. kPacked: columns are read from `packed`. kStiff: forces of positions with their remainders.
// kRelaxing: Maxwell elements beside the springs.
template <bool kVaried, bool kPacked, bool kStiff, bool kRelaxing = false>
void step_springs(const SpringStep* body, unsigned first, unsigned last, double* damping_work) {
    const V one = set(1.0f), zero = set(0);
    const unsigned long first_half = 16ul * body->first_column;
    for (unsigned base = 16 * first; base < 16 * last; base += kWidth) {
        const unsigned slice = base / 16, lane = base % 16;
        const Lanes p = load4(body->offset + 4ul * base);

        // springs
        V fx = zero, fy = zero, fz = zero, heat = zero;
        const unsigned long end = 16ul * body->slice_column[kRelaxing || !body->other_law ? slice + 1 : slice];
        for (unsigned long h = 16ul * body->slice_column[slice]; h < end; h += 16) {
            const unsigned short* packed = kPacked ? body->packed + 2 * (h - first_half) + lane : nullptr;
            const Lanes q =
                kPacked ? gather4_near(body->offset, packed, long{16 * slice} - 32768) : gather4(body->offset, body->neighbour + h + lane);
            const V rest = kPacked ? widen(packed + 16) * set(body->rest_unit) : load(body->rest_length + h + lane);
            V dx = q.x - p.x, dy = q.y - p.y, dz = q.z - p.z;
            if constexpr (kStiff) {
                dx = dx + (gather(body->remainder_x, body->neighbour + h + lane) - load(body->remainder_x + base));
                dy = dy + (gather(body->remainder_y, body->neighbour + h + lane) - load(body->remainder_y + base));
                dz = dz + (gather(body->remainder_z, body->neighbour + h + lane) - load(body->remainder_z + base));
            }
            const V length = root(squared_length(dx, dy, dz));
            V tension = zero;
            if constexpr (kRelaxing) {
                const V stretch = length - rest;
                const Relaxed branches = relaxed<true>(body, h + lane - first_half, stretch);
                tension = where_positive(length, (body->other_law ? branches.pull : stretch + branches.pull) / length);
                heat = multiply_add(load(body->spring_factor + h + lane), branches.heat, heat);
            } else {
                tension = where_positive(length, one - rest / length);
            }
            if (kVaried) tension = tension * load(body->spring_factor + h + lane);
            fx = multiply_add(tension, dx, fx);
            fy = multiply_add(tension, dy, fy);
            fz = multiply_add(tension, dz, fz);
        }

        const V k = set(body->stiffness);
        fx = k * fx, fy = k * fy, fz = k * fz;
        if (any_in_slice(body->anchor_stiffness + 16 * slice)) {  // a slice that nothing holds has no goals to read
            const V anchor = load(body->anchor_stiffness + base);
            const Goals goals = load_goals(body, base);
            if constexpr (kStiff) {
                fx = multiply_add(anchor, to_goal_exactly(body, goals, 0, p.x, load(body->remainder_x + base)), fx);
                fy = multiply_add(anchor, to_goal_exactly(body, goals, 1, p.y, load(body->remainder_y + base)), fy);
                fz = multiply_add(anchor, to_goal_exactly(body, goals, 2, p.z, load(body->remainder_z + base)), fz);
            } else {
                fx = multiply_add(anchor, to_goal(body, goals, 0, p.x), fx);
                fy = multiply_add(anchor, to_goal(body, goals, 1, p.y), fy);
                fz = multiply_add(anchor, to_goal(body, goals, 2, p.z), fz);
            }
        }
        if (body->force_x) fx = fx + load(body->force_x + base), fy = fy + load(body->force_y + base), fz = fz + load(body->force_z + base);

        // damping towards the drag velocity, then kick
        const V vx = load(body->velocity_x + base), vy = load(body->velocity_y + base), vz = load(body->velocity_z + base);
        const V wx = set(body->drag_turn[0]), wy = set(body->drag_turn[1]), wz = set(body->drag_turn[2]);
        const V ux = set(body->drag_velocity[0]) + multiply_subtract(wy, p.z, wz * p.y);
        const V uy = set(body->drag_velocity[1]) + multiply_subtract(wz, p.x, wx * p.z);
        const V uz = set(body->drag_velocity[2]) + multiply_subtract(wx, p.y, wy * p.x);
        const V keep_less_one = set(body->keep) - one;
        const V lost_x = keep_less_one * (vx - ux), lost_y = keep_less_one * (vy - uy), lost_z = keep_less_one * (vz - uz);
        const auto pulled = [&](V f, float gravity) __attribute__((always_inline)) { return multiply_add(f, p.w, set(gravity)); };
        const V ax = pulled(fx, body->gravity[0]), ay = pulled(fy, body->gravity[1]), az = pulled(fz, body->gravity[2]);
        const auto kicked = [&](V v, V lost, V a) __attribute__((always_inline)) {
            return where_positive(p.w, multiply_add(a, set(body->kick_dt), v + lost));
        };
        const V nx = kicked(vx, lost_x, ax), ny = kicked(vy, lost_y, ay), nz = kicked(vz, lost_z, az);
        keep_store(body->new_velocity_x + base, nx);
        keep_store(body->new_velocity_y + base, ny);
        keep_store(body->new_velocity_z + base, nz);
        if (damping_work) {
            const V less = set(body->kick_less);
            const auto power_of = [&](V a, V lost, V v, V n, V sum) __attribute__((always_inline)) {
                return multiply_add(multiply_add(a, less, lost), v + n, sum);
            };
            const V power = power_of(ax, lost_x, vx, nx, power_of(ay, lost_y, vy, ny, power_of(az, lost_z, vz, nz, zero)));
            add_doubles(damping_work + lane, power * where_positive(p.w, set(0.5f) / p.w));
        }

        if constexpr (kRelaxing) {  // of every spring the half, at each of its ends
            if (damping_work) add_doubles(damping_work + lane, set(-0.5f) * (k * heat));
        }

        // drift
        const V dt = set(body->dt);
        Lanes next = {multiply_add(nx, dt, p.x), multiply_add(ny, dt, p.y), multiply_add(nz, dt, p.z), p.w};
        if (body->remainder_x) {
            const auto advance_with_remainder = [&](float* remainder, V v, V from) __attribute__((always_inline)) {
                const V displacement = multiply_add(v, dt, load(remainder + base));
                const V to = from + displacement;
                keep_store(remainder + (kStiff ? body->remainder_step : 0) + base, displacement - (to - from));
                return to;
            };
            next.x = advance_with_remainder(body->remainder_x, nx, p.x);
            next.y = advance_with_remainder(body->remainder_y, ny, p.y);
            next.z = advance_with_remainder(body->remainder_z, nz, p.z);
        }
        store4(body->new_offset + 4ul * base, next);
    }
}

void step(const SpringStep* body, unsigned first, unsigned last, double* damping_work) {
    const bool varied = body->spring_factor;
    const auto kernel = body->branches > 0
                            ? (body->remainder_step != 0 ? step_springs<true, false, true, true> : step_springs<true, false, false, true>)
                        : body->remainder_step != 0 ? (varied ? step_springs<true, false, true> : step_springs<false, false, true>)
                        : body->packed              ? (varied ? step_springs<true, true, false> : step_springs<false, true, false>)
                                                    : (varied ? step_springs<true, false, false> : step_springs<false, false, false>);
    kernel(body, first, last, damping_work);
}

TROCAR_LANES D mass_of(D inverse_mass) { return where_positive(inverse_mass, set_wide(1.0) / inverse_mass); }

template <bool kStiff>
void sum_shape(const SpringStep* body, unsigned first, unsigned last, double* sums) {
    const D back = set_wide(body->back);
    for (unsigned lane = 0; lane < 16; lane += kWide) {
        D total[kShapeSums];
        for (int s = 0; s < kShapeSums; ++s) total[s] = load_wide(sums + 16 * s + lane);
        for (unsigned base = 16 * first + lane; base < 16 * last; base += 16) {
            D x[4];
            load4_wide(body->offset + 4ul * base, x);
            const D k = widened(body->anchor_stiffness + base), m = mass_of(x[3]);
            const D r[3] = {widened(body->anchor_x + base), widened(body->anchor_y + base), widened(body->anchor_z + base)};
            const D v[3] = {widened(body->velocity_x + base), widened(body->velocity_y + base), widened(body->velocity_z + base)};
            const float* const remainder[3] = {body->remainder_x, body->remainder_y, body->remainder_z};
            for (int i = 0; i < 3; ++i) {
                if (kStiff) x[i] = x[i] + widened(remainder[i] + base);
                x[i] = subtract_product(x[i], back, v[i]);
            }
            total[kSumK] = total[kSumK] + k;
            total[kSumM] = total[kSumM] + m;
#pragma GCC unroll 3
            for (int i = 0; i < 3; ++i) {
                const int j = (i + 1) % 3, l = (i + 2) % 3;
                const D kx = k * x[i], mx = m * x[i], mv = m * v[i];
                total[kSumKx + i] = total[kSumKx + i] + kx;
                total[kSumKr + i] = multiply_add(k, r[i], total[kSumKr + i]);
                total[kSumMx + i] = total[kSumMx + i] + mx;
                total[kSumMv + i] = total[kSumMv + i] + mv;
#pragma GCC unroll 3
                for (int c = 0; c < 3; ++c) total[kSumKxr + 3 * i + c] = multiply_add(kx, r[c], total[kSumKxr + 3 * i + c]);
                const D moment = multiply_subtract(x[j], v[l], x[l] * v[j]);
                total[kSumL + i] = multiply_add(m, moment, total[kSumL + i]);
                total[kSumMxx + i] = multiply_add(mx, x[i], total[kSumMxx + i]);
                // xy, xz, yz
                const int a = i == 2 ? 1 : 0, b = i == 0 ? 1 : 2;
                total[kSumMxx + 3 + i] = multiply_add(m * x[a], x[b], total[kSumMxx + 3 + i]);
            }
        }
        for (int s = 0; s < kShapeSums; ++s) keep_store(sums + 16 * s + lane, total[s]);
    }
}

void shape_sums(const SpringStep* body, unsigned first, unsigned last, double* sums) {
    (body->remainder_step != 0 ? sum_shape<true> : sum_shape<false>)(body, first, last, sums);
}

// The sums of moving masses, for one half of the lanes in double.
TROCAR_LANES void add_moving(double* sums, int half, const Lanes& p, const V* velocity, D back) {
    const D m = mass_of(widened(p.w, half));
    const D x[3] = {widened(p.x, half), widened(p.y, half), widened(p.z, half)};
    const D v[3] = {widened(velocity[0], half), widened(velocity[1], half), widened(velocity[2], half)};
    const auto add = [&](int sum, D value) __attribute__((always_inline)) {
        double* at = sums + 16 * sum + kWide * static_cast<unsigned>(half);
        keep_store(at, load_wide(at) + value);
    };
    add(kSumMvv, m * multiply_add(v[0], v[0], multiply_add(v[1], v[1], v[2] * v[2])));
    add(kSumMass, m);
    for (int i = 0; i < 3; ++i) add(kSumMPosition + i, m * subtract_product(x[i], back, v[i]));
}

// length - rest length of half-edges from h on, at offset - back * velocity
TROCAR_LANES V stretch_of(const SpringStep* body, V back, unsigned long h, const Lanes& p, const V* v) {
    const unsigned* far_end = body->neighbour + h;
    const Lanes q = gather4(body->offset, far_end);
    const V dx = subtract_product(q.x - p.x, back, gather(body->velocity_x, far_end) - v[0]);
    const V dy = subtract_product(q.y - p.y, back, gather(body->velocity_y, far_end) - v[1]);
    const V dz = subtract_product(q.z - p.z, back, gather(body->velocity_z, far_end) - v[2]);
    return root(squared_length(dx, dy, dz)) - load(body->rest_length + h);
}

void relaxing_sums(const SpringStep* body, unsigned first, unsigned last, double* sums) {
    const V back = set(body->back);
    for (unsigned base = 16 * first; base < 16 * last; base += kWidth) {
        const unsigned slice = base / 16, lane = base % 16;
        const Lanes p = load4(body->offset + 4ul * base);
        const V v[3] = {load(body->velocity_x + base), load(body->velocity_y + base), load(body->velocity_z + base)};
        const unsigned long end = 16ul * body->slice_column[slice + 1];
        for (unsigned long h = 16ul * body->slice_column[slice] + lane; h < end; h += 16) {
            const Relaxed branches = relaxed<false>(body, h - 16ul * body->first_column, stretch_of(body, back, h, p, v));
            add_doubles(sums + lane, (branches.stored + branches.heat) * load(body->spring_factor + h));
        }
    }
}

void energy_sums(const SpringStep* body, unsigned first, unsigned last, double* sums) {
    const V back = set(body->back);
    for (unsigned base = 16 * first; base < 16 * last; base += kWidth) {
        const unsigned slice = base / 16, lane = base % 16;
        const Lanes p = load4(body->offset + 4ul * base);
        const V v[3] = {load(body->velocity_x + base), load(body->velocity_y + base), load(body->velocity_z + base)};

        // springs: differences of places and of velocities first, both small
        const unsigned long end = 16ul * body->slice_column[body->other_law ? slice : slice + 1];
        for (unsigned long h = 16ul * body->slice_column[slice] + lane; h < end; h += 16) {
            const V stretch = stretch_of(body, back, h, p, v);
            const V factor = body->spring_factor ? load(body->spring_factor + h) : set(1.0f);
            add_doubles(sums + 16 * kSumStretch + lane, stretch * stretch * factor);
        }

        // anchors
        const Goals goals = load_goals(body, base);
        const V apart =
            squared_length(multiply_add(back, v[0], to_goal(body, goals, 0, p.x)), multiply_add(back, v[1], to_goal(body, goals, 1, p.y)),
                           multiply_add(back, v[2], to_goal(body, goals, 2, p.z)));
        add_doubles(sums + 16 * kSumAnchor + lane, load(body->anchor_stiffness + base) * apart);

        for (int half = 0; half < 2; ++half) add_moving(sums + lane, half, p, v, set_wide(body->back));
    }
}
