#pragma once
#include <cstdio>

#include "engine/thread_pool.hpp"
namespace trocar {

// The threads of a command; says on standard error when the system gives fewer than were asked for.
class CommandPool : public ThreadPool {
 public:
    explicit CommandPool(uint32_t threads) : ThreadPool(threads) {
        if (refused() == 0) return;
        std::fprintf(stderr, "trocar: warning: the system refused %u of %u threads; results are the same, later\n", refused(),
                     refused() + this->threads());
    }
};

}  // namespace trocar
