#pragma once
#include <cstdio>

#include "engine/jobs/thread_pool.hpp"
namespace trocar {

// The threads of a command. Prints a warning on standard error if the system provides fewer than requested.
class CommandPool : public ThreadPool {
 public:
    explicit CommandPool(uint32_t threads) : ThreadPool(threads) {
        if (refused() == 0) return;
        std::fprintf(stderr, "trocar: warning: the system refused %u of %u threads; results are the same, later\n", refused(),
                     refused() + this->threads());
    }
};

}  // namespace trocar
