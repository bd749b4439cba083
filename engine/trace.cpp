#include "engine/trace.hpp"

#include <cstdio>
#include <ctime>
namespace trocar {

uint64_t now_ns() {
    timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return static_cast<uint64_t>(t.tv_sec) * 1'000'000'000ull + static_cast<uint64_t>(t.tv_nsec);
}

std::string Trace::to_json(const std::vector<std::string>& thread_names) const {
    std::string out = "{\"displayTimeUnit\":\"ms\",\"traceEvents\":[\n";
    char line[256];
    for (size_t t = 0; t < thread_names.size(); ++t) {
        if (thread_names[t].empty()) continue;
        std::snprintf(line, sizeof line,
                      "{\"name\":\"thread_name\",\"ph\":\"M\",\"pid\":1,\"tid\":%zu,\"args\":{\"name\":\"%s\"}},\n", t,
                      thread_names[t].c_str());
        out += line;
    }
    const size_t count = size();
    const uint64_t start = count > 0 ? events_[0].begin_ns : 0;
    uint64_t first = start;
    for (size_t i = 0; i < count; ++i) first = std::min(first, events_[i].begin_ns);
    for (size_t i = 0; i < count; ++i) {
        const TraceEvent& e = events_[i];
        std::snprintf(
            line, sizeof line, "{\"name\":\"%.*s\",\"ph\":\"X\",\"pid\":1,\"tid\":%u,\"ts\":%.3f,\"dur\":%.3f}%s\n",
            static_cast<int>(e.name.size()), e.name.data(), e.thread, static_cast<double>(e.begin_ns - first) * 1e-3,
            static_cast<double>(e.duration_ns) * 1e-3, i + 1 < count ? "," : "");
        out += line;
    }
    if (count == 0 && !thread_names.empty()) out.erase(out.size() - 2, 1);  // no comma after the last entry
    out += "]}\n";
    return out;
}

}  // namespace trocar
