// The kernels of both instruction sets. The file that includes this one defines V (kWidth floats), Lanes (x, y, z, w) and
// set, load, keep_store, load4, store4, gather4, root, larger, smaller, where_positive, is_other, multiply_add and add_doubles.

struct Three {
    V x, y, z;
};

TROCAR_LANES Three load3(const float* field, unsigned padded_count, unsigned index) {
    return {load(field + index), load(field + padded_count + index), load(field + 2ul * padded_count + index)};
}
TROCAR_LANES void store3(float* field, unsigned padded_count, unsigned index, Three v) {
    keep_store(field + index, v.x);
    keep_store(field + padded_count + index, v.y);
    keep_store(field + 2ul * padded_count + index, v.z);
}
TROCAR_LANES V dot3(Three a, Three b) { return multiply_add(a.x, b.x, multiply_add(a.y, b.y, a.z * b.z)); }
// s + t x p
TROCAR_LANES Three rigid(const float* s, const float* t, Three p) {
    return {set(s[0]) + (set(t[1]) * p.z - set(t[2]) * p.y), set(s[1]) + (set(t[2]) * p.x - set(t[0]) * p.z),
            set(s[2]) + (set(t[0]) * p.y - set(t[1]) * p.x)};
}
TROCAR_LANES Three times_block(const ImplicitStep* s, unsigned index, Three r) {
    const unsigned long n = s->padded_count;
    const V xx = load(s->block + index), yy = load(s->block + n + index), zz = load(s->block + 2 * n + index),
            xy = load(s->block + 3 * n + index), xz = load(s->block + 4 * n + index), yz = load(s->block + 5 * n + index);
    return {dot3({xx, xy, xz}, r), dot3({xy, yy, yz}, r), dot3({xz, yz, zz}, r)};
}
TROCAR_LANES V goal_offset(const SpringStep* s, unsigned index, int axis, V x) {
    const Three rest = {load(s->anchor_x + index), load(s->anchor_y + index), load(s->anchor_z + index)};
    const float *turn = s->turn + 3 * axis, *small = s->turn_rest + 3 * axis;
    const V low = dot3({set(small[0]), set(small[1]), set(small[2])}, rest);
    const V goal = multiply_add(set(turn[0]), rest.x, multiply_add(set(turn[1]), rest.y, multiply_add(set(turn[2]), rest.z, low)));
    return goal - ((x - set(s->centre[axis])) - set(s->centre_rest[axis]));
}
// Damping of velocity v at position p: the new velocity; adds its work to the sums.
TROCAR_LANES Three damp(const SpringStep* s, float keep, Three v, Three p, V inverse_mass, double* sums, unsigned lane) {
    const Three drag = rigid(s->drag_velocity, s->drag_turn, p);
    const V less = set(keep - 1.0f);
    const Three lost = {less * (v.x - drag.x), less * (v.y - drag.y), less * (v.z - drag.z)};
    const Three to = {where_positive(inverse_mass, v.x + lost.x), where_positive(inverse_mass, v.y + lost.y),
                      where_positive(inverse_mass, v.z + lost.z)};
    const V power = dot3(lost, {v.x + to.x, v.y + to.y, v.z + to.z});
    add_doubles(sums + lane, where_positive(inverse_mass, set(0.5f) / inverse_mass) * power);
    return to;
}

void predict(const ImplicitStep* s, unsigned first, unsigned last, double* sums) {
    const SpringStep* b = s->spring;
    const V displacement = set(s->theta * b->dt);
    for (unsigned index = 16 * first; index < 16 * last; index += kWidth) {
        const Lanes x = load4(b->offset + 4ul * index);
        const Three v = damp(b, s->keep_before, {load(b->velocity_x + index), load(b->velocity_y + index), load(b->velocity_z + index)},
                             {x.x, x.y, x.z}, x.w, sums, index % 16);
        keep_store(b->new_velocity_x + index, v.x);
        keep_store(b->new_velocity_y + index, v.y);
        keep_store(b->new_velocity_z + index, v.z);
        store4(s->position + 4ul * index,
               {multiply_add(displacement, v.x, x.x), multiply_add(displacement, v.y, x.y), multiply_add(displacement, v.z, x.z), x.w});
    }
}

void begin(const ImplicitStep* s, unsigned first, unsigned last, double* sums) {
    const SpringStep* b = s->spring;
    const V zero = set(0), one = set(1), k = set(b->stiffness), h = set(b->dt), part = set(s->theta * s->theta * b->dt * b->dt);
    for (unsigned index = 16 * first; index < 16 * last; index += kWidth) {
        const Lanes p = load4(s->position + 4ul * index);
        V fx = zero, fy = zero, fz = zero, xx = zero, yy = zero, zz = zero, xy = zero, xz = zero, yz = zero;
        const unsigned slice = index / 16, lane = index % 16;
        for (unsigned long c = b->slice_column[slice]; c < b->slice_column[slice + 1]; ++c) {
            const unsigned* neighbour = b->neighbour + 16 * c + lane;
            const Lanes q = gather4(s->position, neighbour);
            const V dx = q.x - p.x, dy = q.y - p.y, dz = q.z - p.z;
            const V length = root(multiply_add(dx, dx, multiply_add(dy, dy, dz * dz)));
            const V per_length = where_positive(length, one / length);
            const V ratio = load(b->rest_length + 16 * c + lane) * per_length;
            const V factor = b->spring_factor ? load(b->spring_factor + 16 * c + lane) : one;
            const V tension = factor * where_positive(length, one - ratio);
            fx = multiply_add(tension, dx, fx);
            fy = multiply_add(tension, dy, fy);
            fz = multiply_add(tension, dz, fz);
            const V real = factor * is_other(neighbour, index);
            const V a = real * larger(one - ratio, zero), along = root(real - a) * per_length;
            const V ux = along * dx, uy = along * dy, uz = along * dz;
            float* spring_direction = s->spring_direction + 64 * c + lane;
            keep_store(spring_direction, ux);
            keep_store(spring_direction + 16, uy);
            keep_store(spring_direction + 32, uz);
            keep_store(spring_direction + 48, a);
            xx = xx + multiply_add(ux, ux, a);
            yy = yy + multiply_add(uy, uy, a);
            zz = zz + multiply_add(uz, uz, a);
            xy = multiply_add(ux, uy, xy);
            xz = multiply_add(ux, uz, xz);
            yz = multiply_add(uy, uz, yz);
        }
        const V anchor = load(b->anchor_stiffness + index);
        fx = multiply_add(anchor, goal_offset(b, index, 0, p.x), k * fx);
        fy = multiply_add(anchor, goal_offset(b, index, 1, p.y), k * fy);
        fz = multiply_add(anchor, goal_offset(b, index, 2, p.z), k * fz);
        if (b->force_x) {
            fx = fx + load(b->force_x + index);
            fy = fy + load(b->force_y + index);
            fz = fz + load(b->force_z + index);
        }
        const V qk = part * k;
        V kxx = qk * xx, kyy = qk * yy, kzz = qk * zz, u = qk * xy, v = qk * xz, w = qk * yz;
        if (s->volume_force) {
            const Three force = load3(s->volume_force, s->padded_count, index), more = load3(s->volume_block, s->padded_count, index),
                        across = load3(s->volume_block + 3ul * s->padded_count, s->padded_count, index);
            fx = fx + force.x, fy = fy + force.y, fz = fz + force.z;
            kxx = multiply_add(part, more.x, kxx), kyy = multiply_add(part, more.y, kyy), kzz = multiply_add(part, more.z, kzz);
            u = multiply_add(part, across.x, u), v = multiply_add(part, across.y, v), w = multiply_add(part, across.z, w);
        }
        const V mass = where_positive(p.w, one / p.w);
        const Three r = {where_positive(p.w, h * multiply_add(mass, set(b->gravity[0]), fx)),
                         where_positive(p.w, h * multiply_add(mass, set(b->gravity[1]), fy)),
                         where_positive(p.w, h * multiply_add(mass, set(b->gravity[2]), fz))};
        store3(s->residual, s->padded_count, index, r);
        store3(s->change, s->padded_count, index, {zero, zero, zero});
        // inverse of the symmetric block by its minors; zero for fixed particles
        const V own = multiply_add(part, anchor, mass);
        const V a = kxx + own, d = kyy + own, f = kzz + own;
        const V m0 = d * f - w * w, m1 = v * w - u * f, m2 = u * w - d * v;
        const V det = multiply_add(a, m0, multiply_add(u, m1, v * m2)), scale = where_positive(p.w, one / det);
        const unsigned long n = s->padded_count;
        keep_store(s->block + index, scale * m0);
        keep_store(s->block + n + index, scale * (a * f - v * v));
        keep_store(s->block + 2 * n + index, scale * (a * d - u * u));
        keep_store(s->block + 3 * n + index, scale * m1);
        keep_store(s->block + 4 * n + index, scale * m2);
        keep_store(s->block + 5 * n + index, scale * (u * v - a * w));
        const Three z = times_block(s, index, r);
        store4(s->direction + 4ul * index, {z.x, z.y, z.z, zero});
        add_doubles(sums + lane, dot3(r, z));
    }
}

void apply(const ImplicitStep* s, unsigned first, unsigned last, double* sums) {
    const SpringStep* b = s->spring;
    const V zero = set(0), k = set(b->stiffness), part = set(s->theta * s->theta * b->dt * b->dt);
    for (unsigned index = 16 * first; index < 16 * last; index += kWidth) {
        const Lanes p = load4(s->direction + 4ul * index), at = load4(s->position + 4ul * index);
        Three sum = {zero, zero, zero};
        const unsigned slice = index / 16, lane = index % 16;
        for (unsigned long c = b->slice_column[slice]; c < b->slice_column[slice + 1]; ++c) {
            const Lanes q = gather4(s->direction, b->neighbour + 16 * c + lane);
            const Three d = {p.x - q.x, p.y - q.y, p.z - q.z};
            const float* spring_direction = s->spring_direction + 64 * c + lane;
            const Three u = {load(spring_direction), load(spring_direction + 16), load(spring_direction + 32)};
            const V along = dot3(u, d), a = load(spring_direction + 48);
            sum.x = multiply_add(along, u.x, multiply_add(a, d.x, sum.x));
            sum.y = multiply_add(along, u.y, multiply_add(a, d.y, sum.y));
            sum.z = multiply_add(along, u.z, multiply_add(a, d.z, sum.z));
        }
        const V anchor = load(b->anchor_stiffness + index);
        const V mass = where_positive(at.w, set(1) / at.w);
        const Three goal = rigid(s->rigid_velocity, s->rigid_turn, {at.x, at.y, at.z});
        Three tets = {zero, zero, zero};
        if (s->volume_force) tets = load3(s->volume_pull, s->padded_count, index);
        const auto whole = [&](V springs, V own, V with, V volumes) {
            const V limited = multiply_add(anchor, own - with, multiply_add(k, springs, volumes));
            return where_positive(at.w, multiply_add(part, limited, mass * own));
        };
        const Three out = {whole(sum.x, p.x, goal.x, tets.x), whole(sum.y, p.y, goal.y, tets.y), whole(sum.z, p.z, goal.z, tets.z)};
        store3(s->applied, s->padded_count, index, out);
        add_doubles(sums + lane, dot3({p.x, p.y, p.z}, out));
    }
}

TROCAR_LANES Three cross(Three a, Three b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
TROCAR_LANES Three between(const Lanes& from, const Lanes& to) { return {to.x - from.x, to.y - from.y, to.z - from.z}; }
TROCAR_LANES Three slope_of(const ImplicitTets* s, int corner, unsigned t) {
    return load3(s->slope + 3ul * corner * s->tets->tetrahedra, s->tets->tetrahedra, t);
}
// 1 where a < b, else 0.
TROCAR_LANES V is_less(V a, V b) { return where_positive(b - a, set(1)); }

void tet_slopes(const ImplicitTets* s, unsigned first, unsigned last) {
    const TetStep* b = s->tets;
    const unsigned long corner_rows = 4ul * b->tetrahedra;
    const V zero = set(0);
    for (unsigned t = 16 * first; t < 16 * last; t += kWidth) {
        const Lanes p0 = gather4(b->offset, b->corner0 + t);
        const Three x = between(p0, gather4(b->offset, b->corner1 + t)), y = between(p0, gather4(b->offset, b->corner2 + t)),
                    z = between(p0, gather4(b->offset, b->corner3 + t));
        const Three area[3] = {cross(y, z), cross(z, x), cross(x, y)};
        const V swelling = (dot3(x, area[0]) - load(b->rest + t)) * load(b->per_rest + t);
        const V sloping = is_less(set(-1), swelling) * is_less(swelling, set(kStretchCap));
        const V limited = larger(smaller(swelling, set(kStretchCap)), set(-1)), squeezed = set(-b->squeeze) * smaller(limited, zero);
        const V bulk = set(b->bulk) * is_less(set(-b->yield), swelling);
        V stiffness = sloping * (multiply_add(set(b->crush), is_less(swelling, set(kCrushed - 1)), bulk) + (squeezed + squeezed));
        if (b->factor) stiffness = stiffness * load(b->factor + t);
        const V share = root(stiffness * load(b->per_rest + t) * set(1.0f / 6));
        const V crushed = smaller(limited + set(1 - kCrushed), zero);
        const V linear = multiply_add(set(b->crush), crushed, set(b->bulk) * larger(limited, set(-b->yield)));
        const V pressure = multiply_add(squeezed, limited, linear);
        V size = larger(pressure, zero - pressure) * set(1.0f / 6);
        if (b->factor) size = size * load(b->factor + t);
        const V lx = root(dot3(x, x)), ly = root(dot3(y, y)), lz = root(dot3(z, z));
        const V spring[3] = {size * (ly + lz), size * (lz + lx), size * (lx + ly)};
        Three all = {zero, zero, zero};
        V springs = zero;
        for (int k = 0; k < 3; ++k) {
            const Three g = {share * area[k].x, share * area[k].y, share * area[k].z};
            store3(s->slope + 3ul * k * b->tetrahedra, b->tetrahedra, t, g);
            keep_store(s->slope + (9ul + k) * b->tetrahedra + t, spring[k]);
            store4(b->corner_force + 4ul * t + (k + 1) * corner_rows,
                   {multiply_add(g.x, g.x, spring[k]), multiply_add(g.y, g.y, spring[k]), multiply_add(g.z, g.z, spring[k]), zero});
            springs = springs + spring[k];
            all = {all.x + g.x, all.y + g.y, all.z + g.z};
        }
        store4(b->corner_force + 4ul * t,
               {multiply_add(all.x, all.x, springs), multiply_add(all.y, all.y, springs), multiply_add(all.z, all.z, springs), zero});
    }
}

void tet_blocks(const ImplicitTets* s, unsigned first, unsigned last) {
    const TetStep* b = s->tets;
    const unsigned long corner_rows = 4ul * b->tetrahedra;
    const V zero = set(0);
    for (unsigned t = 16 * first; t < 16 * last; t += kWidth) {
        Three all = {zero, zero, zero};
        for (int k = 0; k < 3; ++k) {
            const Three g = slope_of(s, k, t);
            store4(b->corner_force + 4ul * t + (k + 1) * corner_rows, {g.x * g.y, g.x * g.z, g.y * g.z, zero});
            all = {all.x + g.x, all.y + g.y, all.z + g.z};
        }
        store4(b->corner_force + 4ul * t, {all.x * all.y, all.x * all.z, all.y * all.z, zero});
    }
}

void tet_pull(const ImplicitTets* s, unsigned first, unsigned last) {
    const TetStep* b = s->tets;
    const unsigned long corner_rows = 4ul * b->tetrahedra;
    const V zero = set(0);
    for (unsigned t = 16 * first; t < 16 * last; t += kWidth) {
        const Lanes p0 = gather4(s->direction, b->corner0 + t);
        const Three displacement[3] = {between(p0, gather4(s->direction, b->corner1 + t)),
                                       between(p0, gather4(s->direction, b->corner2 + t)),
                                       between(p0, gather4(s->direction, b->corner3 + t))};
        const Three slope[3] = {slope_of(s, 0, t), slope_of(s, 1, t), slope_of(s, 2, t)};
        const V along = dot3(slope[0], displacement[0]) + (dot3(slope[1], displacement[1]) + dot3(slope[2], displacement[2]));
        float* out = b->corner_force + 4ul * t;
        Three all = {zero, zero, zero};
        for (int k = 0; k < 3; ++k) {
            const V spring = load(s->slope + (9ul + k) * b->tetrahedra + t);
            const Three f = {multiply_add(spring, displacement[k].x, along * slope[k].x),
                             multiply_add(spring, displacement[k].y, along * slope[k].y),
                             multiply_add(spring, displacement[k].z, along * slope[k].z)};
            store4(out + (k + 1) * corner_rows, {f.x, f.y, f.z, zero});
            all = {all.x + f.x, all.y + f.y, all.z + f.z};
        }
        store4(out, {zero - all.x, zero - all.y, zero - all.z, zero});
    }
}

void move(const ImplicitStep* s, float a, unsigned first, unsigned last, double* sums) {
    for (unsigned index = 16 * first; index < 16 * last; index += kWidth) {
        const Lanes p = load4(s->direction + 4ul * index);
        const Three applied = load3(s->applied, s->padded_count, index), dv = load3(s->change, s->padded_count, index);
        Three r = load3(s->residual, s->padded_count, index);
        const V by = set(a), back = set(-a);
        store3(s->change, s->padded_count, index, {multiply_add(by, p.x, dv.x), multiply_add(by, p.y, dv.y), multiply_add(by, p.z, dv.z)});
        r = {multiply_add(back, applied.x, r.x), multiply_add(back, applied.y, r.y), multiply_add(back, applied.z, r.z)};
        store3(s->residual, s->padded_count, index, r);
        add_doubles(sums + index % 16, dot3(r, times_block(s, index, r)));
    }
}

void turn(const ImplicitStep* s, float b, unsigned first, unsigned last) {
    const V by = set(b);
    for (unsigned index = 16 * first; index < 16 * last; index += kWidth) {
        const Lanes p = load4(s->direction + 4ul * index);
        const Three z = times_block(s, index, load3(s->residual, s->padded_count, index));
        store4(s->direction + 4ul * index, {multiply_add(by, p.x, z.x), multiply_add(by, p.y, z.y), multiply_add(by, p.z, z.z), p.w});
    }
}

void finish(const ImplicitStep* s, unsigned first, unsigned last, double* sums) {
    const SpringStep* b = s->spring;
    const V h = set(b->dt), part = set(s->theta);
    for (unsigned index = 16 * first; index < 16 * last; index += kWidth) {
        const Lanes x = load4(b->offset + 4ul * index);
        const Three dv = load3(s->change, s->padded_count, index);
        const Three v = {load(b->new_velocity_x + index), load(b->new_velocity_y + index), load(b->new_velocity_z + index)};
        const auto moved = [&](V from, V speed, V more) { return multiply_add(h, multiply_add(part, more, speed), from); };
        store4(b->new_offset + 4ul * index, {moved(x.x, v.x, dv.x), moved(x.y, v.y, dv.y), moved(x.z, v.z, dv.z), x.w});
        const Three end = damp(b, s->keep_after, {v.x + dv.x, v.y + dv.y, v.z + dv.z}, {x.x, x.y, x.z}, x.w, sums, index % 16);
        keep_store(b->new_velocity_x + index, end.x);
        keep_store(b->new_velocity_y + index, end.y);
        keep_store(b->new_velocity_z + index, end.z);
    }
}
