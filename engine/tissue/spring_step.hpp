#pragma once
#include <array>
#include <vector>

#include "components/bodies.hpp"
#include "components/particles.hpp"
#include "components/springs.hpp"
#include "components/tears.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/kernels/spring_kernels.hpp"
namespace trocar {

// Inputs of the kernels for one deformable body in its present shape: springs, anchors with goals at their
// rest positions, offsets and velocities. No outputs, time, gravity or drag. With `torn`, without broken
// springs.
SpringStep bind_body(const Springs& springs, const Bodies& bodies, const Anchors& anchors, const Particles& particles, uint32_t body,
                     const TornSprings* torn = nullptr);

// Slices of a body per kernel call, about 3 us: the same chunks for any number of threads; a body of 10,000
// particles has eight equal ones.
inline constexpr uint32_t kSlicesPerChunk = 80;

// Bodies of fewer chunks, 7,700 particles, are not worth the synchronisation of threads.
inline constexpr uint32_t kLeastShared = 7;

// Runs body(begin, end) over the slices of a body, chunk by chunk.
template <typename Body>  // Body: void(uint32_t begin, uint32_t end)
void for_slices(uint32_t slices, const Body& body) {
    parallel_for_even(slices, kSlicesPerChunk, kLeastShared, body);
}

// Runs kernel(begin, end, sums) over the slices of a body and adds up its sums[kSums][16], one lane of all
// sums after another: every sum in the order of chunks and lanes. chunk_sums is scratch.
template <int kSums, typename Kernel>  // Kernel: void(uint32_t begin, uint32_t end, double* sums)
std::array<double, kSums> sum_slices(uint32_t slices, std::vector<double>& chunk_sums, const Kernel& kernel) {
    constexpr uint32_t kRow = kSums * kSliceWidth;
    constexpr int kAtOnce = kSums % 8 == 0 ? 8 : kSums;  // as many as fit in registers
    chunk_sums.assign(size_t{chunk_count(slices, kSlicesPerChunk)} * kRow, 0.0);
    for_slices(slices,
               [&](uint32_t begin, uint32_t end) { kernel(begin, end, chunk_sums.data() + size_t{begin / kSlicesPerChunk} * kRow); });
    std::array<double, kSums> total{};
    for (int first = 0; first < kSums; first += kAtOnce) {
        double sum[kAtOnce] = {};
        for (const double* row = chunk_sums.data(); row != chunk_sums.data() + chunk_sums.size(); row += kRow) {
            for (uint32_t lane = 0; lane < kSliceWidth; ++lane) {
                const double* column = row + first * kSliceWidth + lane;
#pragma GCC unroll 8
                for (int s = 0; s < kAtOnce; ++s) sum[s] += column[s * kSliceWidth];
            }
        }
#pragma GCC unroll 8
        for (int s = 0; s < kAtOnce; ++s) total[first + s] = sum[s];
    }
    return total;
}

// The sums for the energy of a body, over all its particles. chunk_sums is scratch.
std::array<double, kEnergySums> sum_energy(const SpringStep& body, uint32_t slices, std::vector<double>& chunk_sums);

}  // namespace trocar
