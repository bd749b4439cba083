#include "systems/advance/tissue/tears.hpp"

#include <immintrin.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/jobs/parallel.hpp"
#include "engine/tissue/solid_tears.hpp"
#include "engine/tissue/spring_step.hpp"
namespace trocar {
namespace {

// Ends of eight half-edges, x, y and z.
inline void gather_positions(const float* offsets, __m256i vertex, __m256 out[3]) {
    const __m256i index = _mm256_slli_epi32(vertex, 2);
    for (int i = 0; i < 3; ++i) out[i] = _mm256_i32gather_ps(offsets + i, index, 4);
}

// Bits of the eight half-edges from h on, of vertices from `vertex` on, longer than `most` times rest.
uint32_t find_long(const SpringStep& step, const float* offsets, size_t h, uint32_t vertex, float most) {
    __m256 p[3], q[3];
    const __m256i own = _mm256_add_epi32(_mm256_set1_epi32(static_cast<int>(vertex)), _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7));
    gather_positions(offsets, own, p);
    gather_positions(offsets, _mm256_loadu_si256(reinterpret_cast<const __m256i*>(step.neighbour + h)), q);
    __m256 squared = _mm256_setzero_ps();
    for (int i = 0; i < 3; ++i) {
        const __m256 d = _mm256_sub_ps(q[i], p[i]);
        squared = _mm256_add_ps(squared, _mm256_mul_ps(d, d));
    }
    const __m256 limit = _mm256_mul_ps(_mm256_loadu_ps(step.rest_length + h), _mm256_set1_ps(most));
    // padding and broken ones have zero length
    return static_cast<uint32_t>(_mm256_movemask_ps(_mm256_cmp_ps(squared, _mm256_mul_ps(limit, limit), _CMP_GT_OQ)));
}

bool any_long(const SpringStep& step, const float* offsets, uint32_t begin, uint32_t end, float most) {
    for (uint32_t slice = begin; slice < end; ++slice) {
        for (uint32_t c = step.slice_column[slice]; c < step.slice_column[slice + 1]; ++c) {
            for (uint32_t lane = 0; lane < kSliceWidth; lane += 8) {
                if (find_long(step, offsets, size_t{c} * kSliceWidth + lane, slice * kSliceWidth + lane, most)) return true;
            }
        }
    }
    return false;
}

void break_half_edge(const AdvanceCall& call, const AdvanceBody& b, uint32_t from, uint32_t to) {
    const OtherForces& other = call.inputs.other;
    for (uint32_t c = b.step.slice_column[from / kSliceWidth]; c < b.step.slice_column[from / kSliceWidth + 1]; ++c) {
        const size_t h = size_t{c} * kSliceWidth + from % kSliceWidth;
        if (other.torn_springs->neighbour[h] != to) continue;
        other.torn_springs->neighbour[h] = from;
        other.torn_springs->rest_length[h] = 0;
        other.torn->spring[h] = 1;
    }
}

// At the time of the velocities, m from the body's origin.
Vec3d node_position(const Particles& particles, const AdvanceBody& b, uint32_t v) {
    const Particles& p = particles;
    const uint32_t i = b.particles.first + v;
    const double back = 0.5 * b.last_dt;
    return Vec3d(b.next[v].x - back * p.velocity_x[i], b.next[v].y - back * p.velocity_y[i], b.next[v].z - back * p.velocity_z[i]);
}

// Energy of a spring at the time of the velocities, J.
double energy_of_spring(const Particles& particles, const AdvanceBody& b, size_t h, uint32_t from, uint32_t to) {
    const double stretch = (node_position(particles, b, to) - node_position(particles, b, from)).norm() - double{b.step.rest_length[h]};
    return 0.5 * double{b.step.stiffness} * (b.step.spring_factor ? double{b.step.spring_factor[h]} : 1.0) * stretch * stretch;
}

void break_chunk(const AdvanceCall& call, const Particles& particles, const AdvanceBody& b, uint32_t chunk, float most,
                 AdvanceResult& result) {
    const SpringStep& step = b.step;
    const uint32_t begin = chunk * kSlicesPerChunk, end = std::min(begin + kSlicesPerChunk, b.slices);
    for (uint32_t slice = begin; slice < end; ++slice) {
        for (uint32_t c = step.slice_column[slice]; c < step.slice_column[slice + 1]; ++c) {
            for (uint32_t lane = 0; lane < kSliceWidth; ++lane) {
                const size_t h = size_t{c} * kSliceWidth + lane;
                const uint32_t from = slice * kSliceWidth + lane, to = step.neighbour[h];
                if (to == from || !(find_long(step, &b.next->x, h / 8 * 8, from / 8 * 8, most) & (1u << lane % 8))) continue;
                result.work_links -= energy_of_spring(particles, b, h, from, to);
                break_half_edge(call, b, from, to);
                break_half_edge(call, b, to, from);
                ++result.broken_springs;
            }
        }
    }
}

// Removes tetrahedra of a solid with an overlong edge at the end of the substep: the test of find_long again.
void break_tetrahedra(const AdvanceCall& call, const Particles& particles, const AdvanceBody& b, float most, AdvanceResult& result) {
    const OtherForces& other = call.inputs.other;
    const uint32_t prototype = call.inputs.bodies.mesh[b.body];
    const SolidInfo& info = other.solids->info[prototype];
    const auto node = [&](uint32_t t, int k) { return other.solids->corner[k][info.tetrahedra.first + t]; };
    const auto is_long = [&](uint32_t from, uint32_t to) {
        for (size_t c = b.step.slice_column[from / kSliceWidth]; c < b.step.slice_column[from / kSliceWidth + 1]; ++c) {
            const size_t h = c * kSliceWidth + from % kSliceWidth;
            if (b.step.neighbour[h] != to) continue;
            const float x = b.next[to].x - b.next[from].x, y = b.next[to].y - b.next[from].y, z = b.next[to].z - b.next[from].z;
            const float limit = b.step.rest_length[h] * most;
            return (x * x + y * y) + z * z > limit * limit;
        }
        return false;
    };
    std::vector<uint32_t> broken;
    for (uint32_t t = 0; t < info.count; ++t) {
        if (other.torn->tetrahedron[info.tetrahedra.first + t]) continue;
        bool any = false;
        for (int i = 0; i < 4; ++i) {
            for (int j = i + 1; j < 4 && !any; ++j) any = is_long(node(t, i), node(t, j));
        }
        if (any) broken.push_back(t);
    }
    std::vector<Vec3d> position(info.nodes.count);
    for (uint32_t v = 0; v < info.nodes.count; ++v) position[v] = node_position(particles, b, v);
    result.work_links -= drop_tetrahedra(call.inputs.springs, *other.solids, call.inputs.bodies, b.body, broken, position, *other.torn,
                                         *other.torn_springs, result.broken_springs);
}

}  // namespace

uint32_t tear_of(const Tears* tears, uint32_t body) {
    for (uint32_t t = 0; tears && t < tears->body.size(); ++t) {
        if (tears->body[t].body == body) return std::isfinite(tears->body[t].break_strain) ? t : kNone;
    }
    return kNone;
}

void break_springs(const AdvanceCall& call, const Particles& particles, TissueScratch& scratch, AdvanceIsland& island,
                   AdvanceResult& result) {
    for (AdvanceBody& b : island.body) {
        if (b.tear == kNone) continue;
        const float most = static_cast<float>(1 + call.inputs.other.tears->body[b.tear].break_strain);
        scratch.overstretched.assign(chunk_count(b.slices, kSlicesPerChunk), 0);
        for_slices(b.slices, [&](uint32_t begin, uint32_t end) {
            scratch.overstretched[begin / kSlicesPerChunk] = any_long(b.step, &b.next->x, begin, end, most);
        });
        if (std::count(scratch.overstretched.begin(), scratch.overstretched.end(), uint8_t{1}) == 0) continue;
        b.energy = std::numeric_limits<double>::quiet_NaN();  // the energy of broken springs goes to work_links
        if (tears_as_solid(call.inputs.other.tears->body[b.tear])) {
            break_tetrahedra(call, particles, b, most, result);
            continue;
        }
        for (uint32_t chunk = 0; chunk < scratch.overstretched.size(); ++chunk) {
            if (!scratch.overstretched[chunk]) continue;
            break_chunk(call, particles, b, chunk, most, result);
        }
    }
}

}  // namespace trocar
