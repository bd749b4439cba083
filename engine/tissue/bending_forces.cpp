#include "engine/tissue/bending_forces.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "engine/jobs/parallel.hpp"
#include "engine/kernels/lanes_avx2.hpp"
#include "engine/tissue/spring_step.hpp"
namespace trocar {
namespace {

constexpr uint32_t kGroup = 8;              // hinges at a time
constexpr uint32_t kHingeGroupsPerChunk = 2048;  // the same chunks for any number of threads
constexpr double kLeastHeight = 0.25;       // mean edges: hinges of flatter triangles are softened

struct Vectors {
    __m256 x, y, z;
};
inline __attribute__((always_inline)) Vectors minus(const Lanes& a, const Lanes& b) {
    return {_mm256_sub_ps(a.x, b.x), _mm256_sub_ps(a.y, b.y), _mm256_sub_ps(a.z, b.z)};
}
inline __attribute__((always_inline)) __m256 dot(const Vectors& a, const Vectors& b) {
    return _mm256_fmadd_ps(a.x, b.x, _mm256_fmadd_ps(a.y, b.y, _mm256_mul_ps(a.z, b.z)));
}
inline __attribute__((always_inline)) Vectors cross(const Vectors& a, const Vectors& b) {
    return {_mm256_fmsub_ps(a.y, b.z, _mm256_mul_ps(a.z, b.y)), _mm256_fmsub_ps(a.z, b.x, _mm256_mul_ps(a.x, b.z)),
            _mm256_fmsub_ps(a.x, b.y, _mm256_mul_ps(a.y, b.x))};
}
inline __attribute__((always_inline)) Vectors times(__m256 s, const Vectors& a) {
    return {_mm256_mul_ps(s, a.x), _mm256_mul_ps(s, a.y), _mm256_mul_ps(s, a.z)};
}

// Eight hinges in their present shape: unit normals of both triangles, sine and cosine of the angle from
// rest.
struct HingeLanes {
    Vectors edge, left, right;  // from the start of the edge to its end and to the two corners
    Vectors unit0, unit1;
    __m256 length2, length, size0, size1;  // |edge|^2, |edge|, |edge x corner|, all positive
    __m256 sine, cosine;
};

inline __attribute__((always_inline)) HingeLanes read_hinges(const float* offset, const Hinges& hinges, uint32_t group) {
    const uint32_t* vertex = hinges.vertex.data() + 4ul * kGroup * group;
    const Lanes start = gather4(offset, vertex);
    HingeLanes h;
    h.edge = minus(gather4(offset, vertex + kGroup), start);
    h.left = minus(gather4(offset, vertex + 2 * kGroup), start);
    h.right = minus(gather4(offset, vertex + 3 * kGroup), start);
    const __m256 tiny = _mm256_set1_ps(1e-30f);
    const Vectors n0 = cross(h.edge, h.left), n1 = cross(h.right, h.edge);
    h.length2 = _mm256_max_ps(dot(h.edge, h.edge), tiny);
    h.length = _mm256_sqrt_ps(h.length2);
    h.size0 = _mm256_sqrt_ps(_mm256_max_ps(dot(n0, n0), tiny));
    h.size1 = _mm256_sqrt_ps(_mm256_max_ps(dot(n1, n1), tiny));
    const __m256 one = _mm256_set1_ps(1.0f);
    h.unit0 = times(_mm256_div_ps(one, h.size0), n0);
    h.unit1 = times(_mm256_div_ps(one, h.size1), n1);
    const __m256 cosine = dot(h.unit0, h.unit1);
    const __m256 sine = _mm256_div_ps(dot(cross(h.unit0, h.unit1), h.edge), h.length);
    const __m256 rest_sine = _mm256_loadu_ps(hinges.sine.data() + size_t{kGroup} * group);
    const __m256 rest_cosine = _mm256_loadu_ps(hinges.cosine.data() + size_t{kGroup} * group);
    h.sine = _mm256_fmsub_ps(sine, rest_cosine, _mm256_mul_ps(cosine, rest_sine));
    h.cosine = _mm256_fmadd_ps(cosine, rest_cosine, _mm256_mul_ps(sine, rest_sine));
    return h;
}

// Forces of groups [first, last) on start, end, left and right corner: 32 elements of `out` per group.
void hinge_forces(const float* offset, const Hinges& hinges, float rigidity, uint32_t first, uint32_t last, Float4* out) {
    const __m256 least = _mm256_set1_ps(-2.0f), most = _mm256_set1_ps(3.0f), one = _mm256_set1_ps(1.0f);
    for (uint32_t group = first; group < last; ++group) {
        const HingeLanes h = read_hinges(offset, hinges, group);
        const size_t index = size_t{kGroup} * group;
        const __m256 moment = _mm256_mul_ps(h.sine, _mm256_mul_ps(_mm256_set1_ps(rigidity), _mm256_loadu_ps(hinges.weight.data() + index)));
        // 1 / height of the corner over the edge
        const __m256 lever0 = _mm256_min_ps(_mm256_div_ps(h.length, h.size0), _mm256_loadu_ps(hinges.cap.data() + 2 * index));
        const __m256 lever1 = _mm256_min_ps(_mm256_div_ps(h.length, h.size1), _mm256_loadu_ps(hinges.cap.data() + 2 * index + kGroup));
        const Vectors f2 = times(_mm256_mul_ps(moment, lever0), h.unit0), f3 = times(_mm256_mul_ps(moment, lever1), h.unit1);
        // projections of the corners on the edge
        const auto along = [&](const Vectors& corner) __attribute__((always_inline)) {
            return _mm256_min_ps(most, _mm256_max_ps(least, _mm256_div_ps(dot(corner, h.edge), h.length2)));
        };
        const __m256 t2 = along(h.left), t3 = along(h.right);
        const __m256 s2 = _mm256_sub_ps(one, t2), s3 = _mm256_sub_ps(one, t3);
        const auto shared = [](__m256 a, __m256 x, __m256 b, __m256 y) __attribute__((always_inline)) {
            return _mm256_fnmadd_ps(a, x, _mm256_mul_ps(_mm256_sub_ps(_mm256_setzero_ps(), b), y));
        };
        const __m256 none = _mm256_setzero_ps();
        float* to = &out[4ul * kGroup * (group - first)].x;
        store4(to, {shared(s2, f2.x, s3, f3.x), shared(s2, f2.y, s3, f3.y), shared(s2, f2.z, s3, f3.z), none});
        store4(to + 4 * kGroup, {shared(t2, f2.x, t3, f3.x), shared(t2, f2.y, t3, f3.y), shared(t2, f2.z, t3, f3.z), none});
        store4(to + 8 * kGroup, {f2.x, f2.y, f2.z, none});
        store4(to + 12 * kGroup, {f3.x, f3.y, f3.z, none});
    }
}

// Eight lanes of weight * (1 - cos) of groups [first, last).
void hinge_energies(const float* offset, const Hinges& hinges, uint32_t first, uint32_t last, double* sum) {
    const __m256 one = _mm256_set1_ps(1.0f), zero = _mm256_setzero_ps();
    for (uint32_t group = first; group < last; ++group) {
        const HingeLanes h = read_hinges(offset, hinges, group);
        // 1 - cos = sin^2 / (1 + cos), accurate at small angles
        const __m256 small = _mm256_div_ps(_mm256_mul_ps(h.sine, h.sine), _mm256_add_ps(one, _mm256_max_ps(h.cosine, zero)));
        const __m256 bent = _mm256_blendv_ps(_mm256_sub_ps(one, h.cosine), small, _mm256_cmp_ps(h.cosine, zero, _CMP_GT_OQ));
        add_doubles(sum, _mm256_mul_ps(bent, _mm256_loadu_ps(hinges.weight.data() + size_t{kGroup} * group)));
    }
}

void gather_forces(const Float4* hinge_force, const Hinges& hinges, const uint32_t* column, uint32_t first, uint32_t last,
                   float* const force[3]) {
    for (uint32_t half_slice = 2 * first; half_slice < 2 * last; ++half_slice) {
        const uint32_t slice = half_slice / 2, lane = 8 * (half_slice % 2), index = 16 * slice + lane;
        __m256 fx = _mm256_loadu_ps(force[0] + index), fy = _mm256_loadu_ps(force[1] + index), fz = _mm256_loadu_ps(force[2] + index);
        for (uint32_t c = column[slice]; c < column[slice + 1]; ++c) {
            const Lanes f = gather4(&hinge_force->x, hinges.slot.data() + 16ul * c + lane);
            fx = _mm256_add_ps(fx, f.x), fy = _mm256_add_ps(fy, f.y), fz = _mm256_add_ps(fz, f.z);
        }
        _mm256_storeu_ps(force[0] + index, fx);
        _mm256_storeu_ps(force[1] + index, fy);
        _mm256_storeu_ps(force[2] + index, fz);
    }
}

// A hinge of the rest shape in double.
struct RestHinge {
    std::array<uint32_t, 4> vertex;
    double sine, cosine, weight;
    double lever[2];  // 1 / height of the left and the right corner, 1/m
};

// False if a triangle has zero area or more than two share the edge.
bool make_hinge(const MeshView& mesh, uint32_t edge, RestHinge& out) {
    const auto [t0, t1] = mesh.edge_triangle[edge];
    if (t0 == kNone || t1 == kNone) return false;
    uint32_t k = 0;
    while (k < 2 && mesh.triangle_edge[t0][k] != edge) ++k;
    if (mesh.neighbour[t0][k] != t1) return false;
    const Triangle& t = mesh.triangle[t0];
    out.vertex = {t[k], t[(k + 1) % 3], t[(k + 2) % 3], kNone};
    for (const uint32_t v : mesh.triangle[t1])
        if (v != out.vertex[0] && v != out.vertex[1]) out.vertex[3] = v;
    const Vec3d& x = mesh.position[out.vertex[0]];
    const Vec3d e = mesh.position[out.vertex[1]] - x, a = mesh.position[out.vertex[2]] - x, b = mesh.position[out.vertex[3]] - x;
    const Vec3d n0 = e.cross(a), n1 = b.cross(e);
    const double size0 = n0.norm(), size1 = n1.norm(), length = e.norm();
    if (!(size0 > 0 && size1 > 0)) return false;
    out.cosine = n0.dot(n1) / (size0 * size1);
    out.sine = n0.cross(n1).dot(e) / (size0 * size1 * length);
    out.weight = length * length / (0.5 * (size0 + size1));
    out.lever[0] = length / size0, out.lever[1] = length / size1;
    // Softer by the factor by which the step would otherwise shrink. (Capping only the lever of the forces
    // would leave them without a potential: a mesh of long, thin triangles then oscillated until it broke.)
    const double flat = kLeastHeight * mesh.info->mean_edge * std::max(out.lever[0], out.lever[1]);
    if (flat > 1) out.weight /= flat * flat;
    return true;
}

void append_hinges(Hinges& hinges, const std::vector<RestHinge>& rest) {
    const size_t padded = (rest.size() + kGroup - 1) / kGroup * kGroup;
    for (size_t group = 0; group < padded / kGroup; ++group) {
        const auto each = [&](auto&& value) {
            for (size_t i = group * kGroup; i < (group + 1) * kGroup; ++i) value(i < rest.size() ? &rest[i] : nullptr);
        };
        for (int corner = 0; corner < 4; ++corner) each([&](const RestHinge* h) { hinges.vertex.push_back(h ? h->vertex[corner] : 0); });
        each([&](const RestHinge* h) { hinges.sine.push_back(h ? static_cast<float>(h->sine) : 0.0f); });
        each([&](const RestHinge* h) { hinges.cosine.push_back(h ? static_cast<float>(h->cosine) : 1.0f); });
        each([&](const RestHinge* h) { hinges.weight.push_back(h ? static_cast<float>(h->weight) : 0.0f); });
        for (int side = 0; side < 2; ++side)
            each([&](const RestHinge* h) { hinges.cap.push_back(h ? static_cast<float>(kFlatReserve * h->lever[side]) : 0.0f); });
    }
}

// Indices of the hinge forces of every vertex; padding is the index past the last, whose force is zero.
void append_slots(Hinges& hinges, const std::vector<RestHinge>& rest, uint32_t slices) {
    const uint32_t none = static_cast<uint32_t>((rest.size() + kGroup - 1) / kGroup * kGroup * 4);
    std::vector<std::vector<uint32_t>> around(size_t{slices} * kSliceWidth);
    for (uint32_t i = 0; i < rest.size(); ++i) {
        for (uint32_t corner = 0; corner < 4; ++corner)
            around[rest[i].vertex[corner]].push_back(i / kGroup * 4 * kGroup + corner * kGroup + i % kGroup);
    }
    for (uint32_t slice = 0; slice < slices; ++slice) {
        hinges.column.push_back(static_cast<uint32_t>(hinges.slot.size() / kSliceWidth));
        size_t columns = 0;
        for (uint32_t lane = 0; lane < kSliceWidth; ++lane) columns = std::max(columns, around[slice * kSliceWidth + lane].size());
        for (size_t c = 0; c < columns; ++c) {
            for (uint32_t lane = 0; lane < kSliceWidth; ++lane) {
                const auto& own = around[slice * kSliceWidth + lane];
                hinges.slot.push_back(c < own.size() ? own[c] : none);
            }
        }
    }
    hinges.column.push_back(static_cast<uint32_t>(hinges.slot.size() / kSliceWidth));
}

}  // namespace

double bending_rigidity(const Tissue& tissue) { return tissue.bending * tissue.wall * tissue.wall * tissue.wall / (12 * (1 - 1.0 / 9)); }

void add_hinges(Springs& springs, const MeshView& mesh, uint32_t prototype) {
    Hinges& hinges = springs.hinges;
    if (hinges.groups.size() <= prototype) {
        hinges.groups.resize(prototype + 1, {});
        hinges.first.resize(prototype + 1, kNone);
    }
    if (hinges.first[prototype] != kNone) return;
    std::vector<RestHinge> rest;
    for (uint32_t e = 0; e < mesh.edge.size(); ++e) {
        RestHinge hinge;
        if (make_hinge(mesh, e, hinge)) rest.push_back(hinge);
    }
    hinges.groups[prototype] = {static_cast<uint32_t>(hinges.weight.size() / kGroup),
                                static_cast<uint32_t>((rest.size() + kGroup - 1) / kGroup)};
    hinges.first[prototype] = static_cast<uint32_t>(hinges.column.size());
    append_hinges(hinges, rest);
    append_slots(hinges, rest, springs.info[prototype].slices.count);
}

void add_bending_forces(const Springs& springs, uint32_t prototype, double rigidity, const Float4* offset, std::vector<Float4>& hinge_force,
                        float* force_x, float* force_y, float* force_z) {
    const Hinges& hinges = springs.hinges;
    const Range groups = hinges.groups[prototype];
    const size_t range = size_t{4} * kGroup * groups.count;
    if (hinge_force.size() <= range) hinge_force.resize(range + 1);
    hinge_force[range] = {};  // what padding refers to
    parallel_for(groups.count, kHingeGroupsPerChunk, [&](uint32_t begin, uint32_t end) {
        hinge_forces(&offset->x, hinges, static_cast<float>(rigidity), groups.first + begin, groups.first + end,
                     hinge_force.data() + size_t{4} * kGroup * begin);
    });
    const uint32_t* column = hinges.column.data() + hinges.first[prototype];
    float* const force[3] = {force_x, force_y, force_z};
    for_slices(springs.info[prototype].slices.count,
               [&](uint32_t begin, uint32_t end) { gather_forces(hinge_force.data(), hinges, column, begin, end, force); });
}

double find_bending_energy(const Springs& springs, uint32_t prototype, double rigidity, const Float4* offset, std::vector<double>& sums) {
    const Range groups = springs.hinges.groups[prototype];
    sums.assign(size_t{chunk_count(groups.count, kHingeGroupsPerChunk)} * kGroup, 0.0);
    parallel_for(groups.count, kHingeGroupsPerChunk, [&](uint32_t begin, uint32_t end) {
        hinge_energies(&offset->x, springs.hinges, groups.first + begin, groups.first + end,
                       sums.data() + size_t{begin / kHingeGroupsPerChunk} * kGroup);
    });
    double total = 0;
    for (const double sum : sums) total += sum;
    return rigidity * total;
}

double bending_omega_squared(const Springs& springs, const Bodies& bodies, const Particles& particles, uint32_t body) {
    const Hinges& hinges = springs.hinges;
    const uint32_t prototype = bodies.mesh[body];
    const uint32_t skin = springs.info[prototype].skin;
    const Range groups = hinges.groups[prototype], range{bodies.particles[body].first + skin, bodies.particles[body].count - skin};
    const Float4* offset = particles.offset.data() + range.first;
    const auto position = [&](uint32_t v) { return Vec3d(offset[v].x, offset[v].y, offset[v].z); };
    std::vector<double> row_sum(range.count, 0.0);
    for (uint32_t group = groups.first; group < groups.end(); ++group) {
        for (uint32_t i = 0; i < kGroup; ++i) {
            const size_t hinge = size_t{kGroup} * group + i;
            if (!(hinges.weight[hinge] > 0)) continue;
            const auto vertex = [&](uint32_t corner) { return hinges.vertex[4ul * kGroup * group + corner * kGroup + i]; };
            const Vec3d x = position(vertex(0)), e = position(vertex(1)) - x, a = position(vertex(2)) - x, b = position(vertex(3)) - x;
            const Vec3d g0 = hinges.cap[2ul * kGroup * group + i] * e.cross(a).normalized();
            const Vec3d g1 = hinges.cap[2ul * kGroup * group + kGroup + i] * b.cross(e).normalized();
            const double t0 = a.dot(e) / e.squaredNorm(), t1 = b.dot(e) / e.squaredNorm();
            const double size[4] = {((1 - t0) * g0 + (1 - t1) * g1).norm(), (t0 * g0 + t1 * g1).norm(), g0.norm(), g1.norm()};
            const double sum = size[0] + size[1] + size[2] + size[3];
            for (uint32_t corner = 0; corner < 4; ++corner) row_sum[vertex(corner)] += hinges.weight[hinge] * size[corner] * sum;
        }
    }
    double most = 0;
    for (uint32_t v = 0; v < range.count; ++v) most = std::max(most, row_sum[v] * offset[v].w);
    return bending_rigidity(bodies.tissue[body]) * kAngleReserve * most;
}

}  // namespace trocar
