#include "engine/parallel.hpp"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "engine/race_detector.hpp"
#include "engine/thread_pool.hpp"
namespace trocar {

void parallel_for_chunks(uint32_t count, uint32_t grain, void (*call)(const void*, uint32_t, uint32_t),
                         const void* body) {
    const uint32_t chunks = chunk_count(count, grain);
    const auto run_chunk = [&](uint32_t chunk) {
        const uint32_t begin = chunk * grain;
        call(body, begin, begin + grain < count ? begin + grain : count);
    };
    if (chunks <= 1 || thread_count() <= 1) {
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
    // isolate: while this stage waits it must not pick up another stage
    tbb::this_task_arena::isolate([&] { tbb::parallel_for(0u, chunks, run_task, tbb::simple_partitioner()); });
    take_over(&done);
}

}  // namespace trocar
