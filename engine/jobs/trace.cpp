#include "engine/jobs/trace.hpp"

#include <ctime>
#include <utility>

#include "engine/base/format.hpp"
namespace trocar {

uint64_t now_ns() {
    timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return static_cast<uint64_t>(t.tv_sec) * 1'000'000'000ull + static_cast<uint64_t>(t.tv_nsec);
}

namespace {

// A JSON string, with its quotes.
void append_string(std::string_view text, std::string& out) {
    out += '"';
    for (const char c : text) {
        if (c == '"' || c == '\\') out += '\\';
        out += static_cast<unsigned char>(c) < ' ' ? ' ' : c;
    }
    out += '"';
}

}  // namespace

std::string Trace::to_json(const std::vector<std::string>& thread_names) const {
    std::string out = "{\"displayTimeUnit\":\"ms\",\"traceEvents\":[";
    const char* separator = "\n";
    for (size_t t = 0; t < thread_names.size(); ++t) {
        if (thread_names[t].empty()) continue;
        out += std::exchange(separator, ",\n");
        out += "{\"name\":\"thread_name\",\"ph\":\"M\",\"pid\":1,\"tid\":" + std::to_string(t) + ",\"args\":{\"name\":";
        append_string(thread_names[t], out);
        out += "}}";
    }
    const size_t count = size();
    uint64_t first = count > 0 ? events_[0].begin_ns : 0;
    for (size_t i = 0; i < count; ++i) first = std::min(first, events_[i].begin_ns);
    for (size_t i = 0; i < count; ++i) {
        const TraceEvent& e = events_[i];
        out += std::exchange(separator, ",\n");
        out += "{\"name\":";
        append_string(e.name, out);
        out += format(",\"ph\":\"X\",\"pid\":1,\"tid\":%u,\"ts\":%.3f,\"dur\":%.3f}", e.thread,
                      static_cast<double>(e.begin_ns - first) * 1e-3, static_cast<double>(e.duration_ns) * 1e-3);
    }
    out += "\n]}\n";
    return out;
}

}  // namespace trocar
