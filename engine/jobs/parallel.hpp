#pragma once
#include <algorithm>
#include <cstdint>
namespace trocar {

constexpr uint32_t kMostChunks = 64;  // for work that is cut into as few chunks as still occupy many threads

inline uint32_t chunk_count(uint32_t count, uint32_t grain) { return (count + grain - 1) / grain; }
// Grain that gives at most kMostChunks chunks.
inline uint32_t coarse_grain(uint32_t count) { return std::max(1u, chunk_count(count, kMostChunks)); }

// Runs body(begin, end) over [0, count) in chunks of `grain` indices. Chunk boundaries depend on count and
// grain alone, never on the number of threads, so per-chunk results can be combined in chunk order. One chunk
// runs on the caller without the scheduler; so does everything while the pool has one thread.
void parallel_for_chunks(uint32_t count, uint32_t grain, void (*call)(const void*, uint32_t, uint32_t), const void* body);

template <typename Body>  // Body: void(uint32_t begin, uint32_t end)
void parallel_for(uint32_t count, uint32_t grain, const Body& body) {
    parallel_for_chunks(
        count, grain, [](const void* b, uint32_t begin, uint32_t end) { (*static_cast<const Body*>(b))(begin, end); }, &body);
}

// As parallel_for, for repeated short loops over the same indices with uniform cost: each thread gets the
// same part every time, which stays in its cache. Fewer than least_chunks chunks run on the caller.
void parallel_for_even_chunks(uint32_t count, uint32_t grain, uint32_t least_chunks, void (*call)(const void*, uint32_t, uint32_t),
                              const void* body);

template <typename Body>  // Body: void(uint32_t begin, uint32_t end)
void parallel_for_even(uint32_t count, uint32_t grain, uint32_t least_chunks, const Body& body) {
    parallel_for_even_chunks(
        count, grain, least_chunks, [](const void* b, uint32_t begin, uint32_t end) { (*static_cast<const Body*>(b))(begin, end); }, &body);
}

// Index of the calling thread among the pool's threads, < thread_count(). For per-worker scratch only.
uint32_t thread_index();

}  // namespace trocar
