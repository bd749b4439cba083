#include "engine/jobs/parallel.hpp"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <ctime>

#include "engine/jobs/loop_watch.hpp"
#include "engine/jobs/race_detector.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/jobs/trace.hpp"
namespace trocar {
namespace {

thread_local std::vector<LoopTime>* watched = nullptr;

uint64_t processor_ns() {
    timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return static_cast<uint64_t>(t.tv_sec) * 1'000'000'000u + static_cast<uint64_t>(t.tv_nsec);
}

// Runs all chunks here and records the time of the loop, nested loops included, and of its longest chunk.
template <typename RunChunk>
void run_watched(uint32_t chunks, const RunChunk& run_chunk) {
    std::vector<LoopTime>* const times = std::exchange(watched, nullptr);
    LoopTime loop;
    loop.begin_ns = now_ns();
    const uint64_t begin = processor_ns();
    uint64_t start = begin;
    for (uint32_t chunk = 0; chunk < chunks; ++chunk) {
        run_chunk(chunk);
        const uint64_t end = processor_ns();
        loop.longest_ns = std::max(loop.longest_ns, end - start);
        start = end;
    }
    loop.processor_ns = start - begin;
    loop.duration_ns = now_ns() - loop.begin_ns;
    times->push_back(loop);
    watched = times;
}

template <typename Partitioner>
void share_chunks(uint32_t count, uint32_t grain, uint32_t least_chunks, void (*call)(const void*, uint32_t, uint32_t), const void* body,
                  const Partitioner& partitioner) {
    const uint32_t chunks = chunk_count(count, grain);
    const auto run_chunk = [&](uint32_t chunk) {
        const uint32_t begin = chunk * grain;
        call(body, begin, begin + grain < count ? begin + grain : count);
    };
    if (watched && chunks >= least_chunks && thread_count() <= 1) {
        run_watched(chunks, run_chunk);
        return;
    }
    if (chunks < least_chunks || thread_count() <= 1) {
        for (uint32_t chunk = 0; chunk < chunks; ++chunk) run_chunk(chunk);
        return;
    }
    const char begun = 0, done = 0;
    const auto run_task = [&](uint32_t chunk) TROCAR_NO_RACE_DETECTION {
        take_over(&begun);
        run_chunk(chunk);
        hand_over(&done);
    };
    hand_over(&begun);
    // isolate: while this stage waits, its thread must not start another stage
    tbb::this_task_arena::isolate([&] { tbb::parallel_for(0u, chunks, run_task, partitioner); });
    take_over(&done);
}

}  // namespace

void watch_loops(std::vector<LoopTime>* times) { watched = times; }

void parallel_for_chunks(uint32_t count, uint32_t grain, void (*call)(const void*, uint32_t, uint32_t), const void* body) {
    share_chunks(count, grain, 2, call, body, tbb::simple_partitioner());
}

void parallel_for_even_chunks(uint32_t count, uint32_t grain, uint32_t least_chunks, void (*call)(const void*, uint32_t, uint32_t),
                              const void* body) {
    share_chunks(count, grain, std::max(2u, least_chunks), call, body, tbb::static_partitioner());
}

}  // namespace trocar
