#include "systems/app/console/progress.hpp"

#include <unistd.h>

#include <algorithm>
#include <cstdio>

#include "engine/jobs/trace.hpp"
namespace trocar {

Progress::Progress(std::string title) : title_(std::move(title)), terminal_(isatty(STDERR_FILENO) == 1), start_ns_(now_ns()) {}

Progress::~Progress() {
    if (terminal_ && shown_ns_ > 0) std::fprintf(stderr, "\r\033[K");
}

void Progress::show(double done, const std::string& note) {
    const unsigned long long now = now_ns();
    if (!terminal_ || now - shown_ns_ < 100'000'000ull) return;
    shown_ns_ = now;
    constexpr int kWidth = 30;
    const int filled = static_cast<int>(std::clamp(done, 0.0, 1.0) * kWidth);
    const double elapsed = static_cast<double>(now - start_ns_) * 1e-9;
    char left[32] = "";
    if (done > 0.01) std::snprintf(left, sizeof left, ", %.0f s left", elapsed * (1 - done) / done);
    std::fprintf(stderr, "\r\033[K%s [%.*s%.*s] %3.0f %% %s%s", title_.c_str(), filled, "##############################", kWidth - filled,
                 "..............................", done * 100, note.c_str(), left);
    std::fflush(stderr);
}

}  // namespace trocar
