// The kernels of both instruction sets. The file that includes this one defines V (kWidth floats), Lanes (x, y, z, w) and
// set, load, keep_store, store4, gather4, larger, smaller, multiply_add and multiply_subtract.

struct Vec {
    V x, y, z;
};
TROCAR_LANES Vec between(const Lanes& from, const Lanes& to) { return {to.x - from.x, to.y - from.y, to.z - from.z}; }
TROCAR_LANES Vec cross(const Vec& a, const Vec& b) {
    return {multiply_subtract(a.y, b.z, a.z * b.y), multiply_subtract(a.z, b.x, a.x * b.z), multiply_subtract(a.x, b.y, a.y * b.x)};
}
TROCAR_LANES Lanes scaled(V s, const Vec& a) { return {s * a.x, s * a.y, s * a.z, set(0)}; }
// -(a + b + c): the forces of a tetrahedron sum to zero.
TROCAR_LANES Lanes against(const Lanes& a, const Lanes& b, const Lanes& c) {
    const V zero = set(0);
    const auto sum = [&](V p, V q, V r) __attribute__((always_inline)) { return zero - ((p + q) + r); };
    return {sum(a.x, b.x, c.x), sum(a.y, b.y, c.y), sum(a.z, b.z, c.z), zero};
}

// Edges from the first corner of tetrahedra t to t + kWidth.
struct Edges {
    Vec a, b, c;
};
TROCAR_LANES Edges edges_of(const TetStep* body, unsigned t) {
    const Lanes p0 = gather4(body->offset, body->corner0 + t);
    return {between(p0, gather4(body->offset, body->corner1 + t)), between(p0, gather4(body->offset, body->corner2 + t)),
            between(p0, gather4(body->offset, body->corner3 + t))};
}
// J - 1 of these tetrahedra, given b x c.
TROCAR_LANES V swelling_of(const TetStep* body, unsigned t, const Vec& a, const Vec& bc) {
    const V volume = multiply_add(a.x, bc.x, multiply_add(a.y, bc.y, a.z * bc.z));
    return (volume - load(body->rest + t)) * load(body->per_rest + t);
}
TROCAR_LANES void keep_least(float* least, unsigned t, V swelling) {
    float* lane = least + t % 16;
    keep_store(lane, smaller(swelling + set(1.0f), load(lane)));
}

void press(const TetStep* body, unsigned first, unsigned last, float* least) {
    const unsigned long corner_rows = 4ul * body->tetrahedra;
    for (unsigned t = 16 * first; t < 16 * last; t += kWidth) {
        const auto [a, b, c] = edges_of(body, t);
        const Vec bc = cross(b, c), ca = cross(c, a), ab = cross(a, b);
        const V swelling = swelling_of(body, t, a, bc);
        const V held = larger(smaller(swelling, set(kStretchCap)), set(-1.0f));
        const V crushed = smaller(held + set(1.0f - kCrushed), set(0));
        const V squeezed = smaller(held, set(0));
        const V linear = multiply_add(set(body->crush), crushed, set(body->bulk) * larger(held, set(-body->yield)));
        const V pressure = multiply_add(set(-body->squeeze), squeezed * squeezed, linear);
        V share = pressure * set(-1.0f / 6);
        if (body->factor) share = share * load(body->factor + t);
        const Lanes f1 = scaled(share, bc), f2 = scaled(share, ca), f3 = scaled(share, ab);
        float* out = body->corner_force + 4ul * t;
        store4(out, against(f1, f2, f3));
        store4(out + corner_rows, f1);
        store4(out + 2 * corner_rows, f2);
        store4(out + 3 * corner_rows, f3);
        keep_least(least, t, swelling);
    }
}

TROCAR_LANES V product(const Vec& a, const Vec& b) { return multiply_add(a.x, b.x, multiply_add(a.y, b.y, a.z * b.z)); }
// a p + b q + c r
TROCAR_LANES Vec combined(V a, const Vec& p, V b, const Vec& q, V c, const Vec& r) {
    const auto sum = [&](V x, V y, V z) __attribute__((always_inline)) { return multiply_add(a, x, multiply_add(b, y, c * z)); };
    return {sum(p.x, q.x, r.x), sum(p.y, q.y, r.y), sum(p.z, q.z, r.z)};
}
TROCAR_LANES Lanes mixed(V s, const Vec& a, V t, const Vec& b) {
    return {multiply_add(s, a.x, t * b.x), multiply_add(s, a.y, t * b.y), multiply_add(s, a.z, t * b.z), set(0)};
}

// With the edges as columns of D and the metric M = (rest edges^T rest edges)^-1, F = D (rest edges)^-1 gives F^T F : I = D^T D : M,
// and the forces on the corners 1 to 3 are the columns of -V s D M - p / 6 (cofactors of D).
void press_neo_hookean(const TetStep* body, unsigned first, unsigned last, float* least) {
    const unsigned long corner_rows = 4ul * body->tetrahedra;
    const V shear = set(body->shear), one = set(1.0f);
    for (unsigned t = 16 * first; t < 16 * last; t += kWidth) {
        const auto [a, b, c] = edges_of(body, t);
        const Vec bc = cross(b, c), ca = cross(c, a), ab = cross(a, b);
        const V swelling = swelling_of(body, t, a, bc);
        const float* metric = body->metric + 96ul * (t / 16) + t % 16;
        const V maa = load(metric), mbb = load(metric + 16), mcc = load(metric + 32);
        const V mab = load(metric + 48), mac = load(metric + 64), mbc = load(metric + 80);
        const V straight = multiply_add(maa, product(a, a), multiply_add(mbb, product(b, b), mcc * product(c, c)));
        const V across = multiply_add(mab, product(a, b), multiply_add(mac, product(a, c), mbc * product(b, c)));
        const V squared = multiply_add(set(2.0f), across, straight);
        V pull = (shear - shear / (squared + one)) * (load(body->rest + t) * set(-1.0f / 6));
        V push = multiply_subtract(set(body->bulk), larger(swelling, set(-1.0f)), set(0.75f) * shear) * set(-1.0f / 6);
        if (body->factor) {
            const V factor = load(body->factor + t);
            pull = pull * factor, push = push * factor;
        }
        const Lanes f1 = mixed(pull, combined(maa, a, mab, b, mac, c), push, bc);
        const Lanes f2 = mixed(pull, combined(mab, a, mbb, b, mbc, c), push, ca);
        const Lanes f3 = mixed(pull, combined(mac, a, mbc, b, mcc, c), push, ab);
        float* out = body->corner_force + 4ul * t;
        store4(out, against(f1, f2, f3));
        store4(out + corner_rows, f1);
        store4(out + 2 * corner_rows, f2);
        store4(out + 3 * corner_rows, f3);
        keep_least(least, t, swelling);
    }
}

void measure(const TetStep* body, unsigned first, unsigned last, float* least) {
    for (unsigned t = 16 * first; t < 16 * last; t += kWidth) {
        const auto [a, b, c] = edges_of(body, t);
        keep_least(least, t, swelling_of(body, t, a, cross(b, c)));
    }
}

void gather_corners(const TetStep* body, unsigned first, unsigned last) {
    for (unsigned index = 16 * first; index < 16 * last; index += kWidth) {
        const unsigned slice = index / 16, lane = index % 16;
        V x = load(body->force_x + index), y = load(body->force_y + index), z = load(body->force_z + index);
        const unsigned long end = 16ul * body->slot_column[slice + 1];
        for (unsigned long h = 16ul * body->slot_column[slice]; h < end; h += 16) {
            const Lanes f = gather4(body->corner_force, body->slot + h + lane);
            x = x + f.x;
            y = y + f.y;
            z = z + f.z;
        }
        keep_store(body->force_x + index, x);
        keep_store(body->force_y + index, y);
        keep_store(body->force_z + index, z);
    }
}
