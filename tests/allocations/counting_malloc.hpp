#pragma once
#include <cstdint>
#include <string>
#include <vector>
namespace trocar {

// Allocations of all threads between two calls, by origin.
struct AllocationCount {
    uint64_t ours = 0;                 // this program and the standard library: everything not listed below
    uint64_t tbb = 0;                  // the scheduler and its allocator
    uint64_t embree = 0;               // refits of trees
    std::vector<std::string> callers;  // of ours, distinct "file+offset", at most 16: for addr2line
};

// Starts counting malloc, calloc, realloc, memalign, mmap and operator new of all threads of the process.
void start_counting_allocations();
AllocationCount stop_counting_allocations();

}  // namespace trocar
