#pragma once
#include <algorithm>
#include <cstdint>
namespace trocar {

constexpr uint32_t kMostChunks = 64;  // of work that is cut into as few pieces as keep many threads busy

inline uint32_t chunk_count(uint32_t count, uint32_t grain) { return (count + grain - 1) / grain; }
// Rows a chunk so that there are kMostChunks at most.
inline uint32_t coarse_grain(uint32_t count) { return std::max(1u, chunk_count(count, kMostChunks)); }

// Runs body(begin, end) over [0, count) in chunks of `grain` rows. Chunk boundaries depend on count and grain alone,
// never on the number of threads, so per-chunk results can be combined in chunk order. One chunk runs on the caller
// without touching the scheduler; so does everything while the pool has one thread.
void parallel_for_chunks(uint32_t count, uint32_t grain, void (*call)(const void*, uint32_t, uint32_t), const void* body);

template <typename Body>  // Body: void(uint32_t begin, uint32_t end)
void parallel_for(uint32_t count, uint32_t grain, const Body& body) {
    parallel_for_chunks(
        count, grain, [](const void* b, uint32_t begin, uint32_t end) { (*static_cast<const Body*>(b))(begin, end); }, &body);
}

// As parallel_for, for short loops over the same rows again and again, all of one cost: each thread gets the same part of
// them every time, which stays in its cache. Fewer than least_chunks chunks run on the caller.
void parallel_for_even_chunks(uint32_t count, uint32_t grain, uint32_t least_chunks, void (*call)(const void*, uint32_t, uint32_t),
                              const void* body);

template <typename Body>  // Body: void(uint32_t begin, uint32_t end)
void parallel_for_even(uint32_t count, uint32_t grain, uint32_t least_chunks, const Body& body) {
    parallel_for_even_chunks(
        count, grain, least_chunks, [](const void* b, uint32_t begin, uint32_t end) { (*static_cast<const Body*>(b))(begin, end); }, &body);
}

// Row of the calling thread among the pool's threads, < thread_count(). For per-worker scratch only.
uint32_t thread_index();

}  // namespace trocar
