#include "tests/allocations/counting_malloc.hpp"

#include <dlfcn.h>
#include <errno.h>
#include <execinfo.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <new>
#include <string_view>

// Replaces the allocation functions of the whole process, libraries included; memory still comes from glibc
// under its other names, so free needs no replacement.
extern "C" {
void* __libc_malloc(size_t size);
void* __libc_calloc(size_t count, size_t size);
void* __libc_realloc(void* old, size_t size);
void* __libc_memalign(size_t alignment, size_t size);
}

namespace {

constexpr uint64_t kKept = 4096;  // allocations recorded; further ones count as ours
constexpr int kFrames = 16;
struct Site {
    std::array<void*, kFrames> frame;  // return addresses, innermost first
    int frames = 0;
    void* caller = nullptr;  // the first frame outside this file
};
std::atomic<bool> counting{false};
std::atomic<uint64_t> total{0};
std::array<Site, kKept> sites;

// Does not allocate.
void note(void* caller) {
    if (!counting.load(std::memory_order_relaxed)) return;
    const uint64_t row = total.fetch_add(1, std::memory_order_relaxed);
    if (row >= kKept) return;
    sites[row].caller = caller;
    sites[row].frames = backtrace(sites[row].frame.data(), kFrames);
}

void* checked(void* memory) {
    if (!memory) throw std::bad_alloc();
    return memory;
}

}  // namespace

#define TROCAR_CALLER __builtin_extract_return_addr(__builtin_return_address(0))

extern "C" {
void* malloc(size_t size) {
    note(TROCAR_CALLER);
    return __libc_malloc(size);
}
void* calloc(size_t count, size_t size) {
    note(TROCAR_CALLER);
    return __libc_calloc(count, size);
}
void* realloc(void* old, size_t size) {
    note(TROCAR_CALLER);
    return __libc_realloc(old, size);
}
void* memalign(size_t alignment, size_t size) {
    note(TROCAR_CALLER);
    return __libc_memalign(alignment, size);
}
void* aligned_alloc(size_t alignment, size_t size) {
    note(TROCAR_CALLER);
    return __libc_memalign(alignment, size);
}
int posix_memalign(void** out, size_t alignment, size_t size) {
    note(TROCAR_CALLER);
    *out = __libc_memalign(alignment, size);
    return *out ? 0 : ENOMEM;
}
}

// the scheduler's own allocator and Embree's large blocks use mmap
extern "C" void* mmap(void* at, size_t size, int protection, int flags, int file, off_t offset) {
    note(TROCAR_CALLER);
    return reinterpret_cast<void*>(syscall(SYS_mmap, at, size, protection, flags, file, offset));
}

// not through malloc above, so that the caller is the one of `new`
void* operator new(size_t size) {
    note(TROCAR_CALLER);
    return checked(__libc_malloc(size));
}
void* operator new[](size_t size) {
    note(TROCAR_CALLER);
    return checked(__libc_malloc(size));
}
void* operator new(size_t size, std::align_val_t alignment) {
    note(TROCAR_CALLER);
    return checked(__libc_memalign(static_cast<size_t>(alignment), size));
}
void* operator new[](size_t size, std::align_val_t alignment) {
    note(TROCAR_CALLER);
    return checked(__libc_memalign(static_cast<size_t>(alignment), size));
}
void* operator new(size_t size, const std::nothrow_t&) noexcept {
    note(TROCAR_CALLER);
    return __libc_malloc(size);
}
void* operator new[](size_t size, const std::nothrow_t&) noexcept {
    note(TROCAR_CALLER);
    return __libc_malloc(size);
}
void operator delete(void* memory) noexcept { free(memory); }
void operator delete[](void* memory) noexcept { free(memory); }
void operator delete(void* memory, const std::nothrow_t&) noexcept { free(memory); }
void operator delete[](void* memory, const std::nothrow_t&) noexcept { free(memory); }
void operator delete(void* memory, size_t) noexcept { free(memory); }
void operator delete[](void* memory, size_t) noexcept { free(memory); }
void operator delete(void* memory, std::align_val_t) noexcept { free(memory); }
void operator delete[](void* memory, std::align_val_t) noexcept { free(memory); }
void operator delete(void* memory, size_t, std::align_val_t) noexcept { free(memory); }
void operator delete[](void* memory, size_t, std::align_val_t) noexcept { free(memory); }

namespace trocar {

namespace {

bool starts_with_any(std::string_view text, std::initializer_list<std::string_view> heads) {
    return std::any_of(heads.begin(), heads.end(), [text](std::string_view head) { return text.starts_with(head); });
}

// Whether a frame only forwards a request: the C and C++ libraries, the loader (which allocates a library's
// thread_local variables on a thread's first access), and template instances of g++ anywhere, as a library
// may call this program's copy of std::string's functions.
bool passes_on(const Dl_info& info) {
    const std::string_view file = info.dli_fname ? info.dli_fname : "", symbol = info.dli_sname ? info.dli_sname : "";
    return file.find("libstdc++") != std::string_view::npos || file.find("libc.so") != std::string_view::npos ||
           file.find("ld-linux") != std::string_view::npos || starts_with_any(symbol, {"_ZNSt", "_ZNKSt", "_ZSt", "_Znwm", "_Znam"});
}

// Origin of an allocation: the innermost frame that does not only forward it.
Dl_info asker(const Site& site, void*& address) {
    int first = 0;
    while (first < site.frames && site.frame[static_cast<size_t>(first)] != site.caller) ++first;
    Dl_info info{};
    for (int i = first; i < site.frames; ++i) {
        address = site.frame[static_cast<size_t>(i)];
        info = {};
        if (dladdr(address, &info) != 0 && !passes_on(info)) break;
    }
    return info;
}

std::string position(const Dl_info& info, void* address) {
    char offset[32];
    std::snprintf(offset, sizeof offset, "+0x%tx", static_cast<char*>(address) - static_cast<char*>(info.dli_fbase));
    return std::string(info.dli_fname ? info.dli_fname : "?") + offset;
}

}  // namespace

void start_counting_allocations() {
    std::array<void*, kFrames> frame;
    backtrace(frame.data(), kFrames);  // its first call loads a library
    total = 0;
    counting = true;
}

AllocationCount stop_counting_allocations() {
    counting = false;
    AllocationCount count;
    const uint64_t all = total, kept = std::min(all, kKept);
    count.ours = all - kept;
    for (uint64_t i = 0; i < kept; ++i) {
        void* address = nullptr;
        const Dl_info info = asker(sites[i], address);
        const std::string_view file = info.dli_fname ? info.dli_fname : "";
        if (file.find("libtbb") != std::string_view::npos) {
            ++count.tbb;
        } else if (file.find("libembree") != std::string_view::npos) {
            ++count.embree;
        } else {
            ++count.ours;
            const std::string name = position(info, address);
            const bool seen = std::find(count.callers.begin(), count.callers.end(), name) != count.callers.end();
            if (!seen && count.callers.size() < 16) count.callers.push_back(name);
        }
    }
    return count;
}

}  // namespace trocar
