#pragma once
#include <cstdint>
#include <string>
#include <vector>
namespace trocar {

// Allocations of all threads between two calls, by who asked for them.
struct AllocationCount {
    uint64_t ours = 0;                 // this program and the standard library: everything that is not named below
    uint64_t tbb = 0;                  // the scheduler and its allocator
    uint64_t embree = 0;               // refits of trees
    std::vector<std::string> callers;  // of ours, "file+offset" once each, at most 16: for addr2line
};

// From now on every malloc, calloc, realloc, memalign, mmap and operator new of any thread in the process is counted.
void start_counting_allocations();
AllocationCount stop_counting_allocations();

}  // namespace trocar
