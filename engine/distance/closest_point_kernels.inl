// The float kernels for one register of triangles. Included by each instruction set's unit after V, Index and Mask, the
// functions below from their intrinsics:
//   all, fused_add, fused_subtract, fused_negative, lesser, greater, root, where_not_positive, at_least, both, keep, index_of,
//   look_up, look_up_wide.

namespace {
struct Lanes3 {
    V x, y, z;
};
}  // namespace

KERNEL Lanes3 corner(const Meshlet* m, int k, int half) {
    const Index i = index_of(m->corner[k], half);
    if (__builtin_expect(!m->wide, 1)) return {look_up(m->x, i), look_up(m->y, i), look_up(m->z, i)};
    return {look_up_wide(m->x, m->more_x, i), look_up_wide(m->y, m->more_y, i), look_up_wide(m->z, m->more_z, i)};
}
KERNEL Lanes3 subtract(Lanes3 a, Lanes3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
KERNEL V dot(Lanes3 a, Lanes3 b) { return fused_add(a.z, b.z, fused_add(a.y, b.y, a.x * b.x)); }
KERNEL Lanes3 cross(Lanes3 a, Lanes3 b) {
    return {fused_subtract(a.y, b.z, a.z * b.y), fused_subtract(a.z, b.x, a.x * b.z), fused_subtract(a.x, b.y, a.y * b.x)};
}
// squared distance of the origin to the segment from r along e
KERNEL V to_segment(Lanes3 r, Lanes3 e) {
    V t = dot(r, e) / greater(dot(e, e), all(1e-36f));
    t = greater(lesser(t, all(0)), all(-1));
    const Lanes3 q = {fused_negative(t, e.x, r.x), fused_negative(t, e.y, r.y), fused_negative(t, e.z, r.z)};
    return dot(q, q);
}

KERNEL V squared_distance(const Meshlet* m, int half, const float* q) {
    const Lanes3 a0 = corner(m, 0, half), b0 = corner(m, 1, half), c0 = corner(m, 2, half);
    // edges from the vertices, not from the differences to q: their relative error must not grow with the distance
    const Lanes3 ab = subtract(b0, a0), bc = subtract(c0, b0), ca = subtract(a0, c0);
    const Lanes3 p = {all(q[0]), all(q[1]), all(q[2])};
    const Lanes3 a = subtract(a0, p), b = subtract(b0, p), c = subtract(c0, p);
    const V d = lesser(to_segment(a, ab), lesser(to_segment(b, bc), to_segment(c, ca)));
    const Lanes3 n = cross(ca, ab);
    const V s = greater(dot(cross(n, ab), a), greater(dot(cross(n, bc), b), dot(cross(n, ca), c)));  // <= 0: above the face
    const V h = dot(n, a);
    const V face = h * (h / greater(dot(n, n), all(1e-36f)));
    return where_not_positive(s, lesser(face, d), d);
}

namespace {
struct PartMeasure {
    V size, slenderness;
    Mask sound;
};
}  // namespace

KERNEL PartMeasure measure_part(const Meshlet* m, int half) {
    const Lanes3 a = corner(m, 0, half), b = corner(m, 1, half), c = corner(m, 2, half);
    const Lanes3 ab = subtract(b, a), bc = subtract(c, b), ca = subtract(a, c);
    const Lanes3 n = cross(ca, ab);
    const V n2 = dot(n, n), l2 = greater(dot(ab, ab), greater(dot(bc, bc), dot(ca, ca)));
    const Mask sound = both(at_least(n2, all(1e-4f) * (l2 * l2)), at_least(l2, all(1e-14f)));
    const V slenderness = keep(sound, l2 / root(n2));
    return {keep(sound, root(l2) * fused_add(slenderness, all(24), all(16))), slenderness, sound};
}
