#include <cctype>
#include <cstdio>
#include <cstring>

#include "bench/contact/contact_parts.hpp"
#include "bench/suites.hpp"
#include "engine/jobs/thread_pool.hpp"

namespace {

using namespace trocar::bench;

struct Part {
    const char* name;
    void (*run)(Report&);
};
constexpr Part kParts[] = {{"query", compare_queries},
                           {"broad", compare_broad_phases},
                           {"missed", count_missed_pairs},
                           {"thesis", compare_with_thesis},
                           {"error", plot_speed_and_error}};

}  // namespace

// Contact figures with references: [--quick] [--json FILE] [query|broad|missed|thesis|error]; or the cost of
// every stage: stages [passes] [scene] [cell edges], where a number may follow directly.
int contact_suite(int argc, char** argv) {
    Report report("contact", argc, argv);
    const trocar::ThreadPool one_thread(1);
    const std::string only = argc > 1 ? argv[1] : "";
    if (only == "stages" || (!only.empty() && std::isdigit(static_cast<unsigned char>(only[0])))) {
        const int skip = only == "stages";
        measure_stages(argc - skip, argv + skip);
        return 0;
    }
    bool known = only.empty();
    for (const Part& part : kParts) {
        if (!only.empty() && only != part.name) continue;
        known = true;
        part.run(report);
    }
    if (!known) {
        std::fprintf(stderr, "trocar_bench contact: no part '%s': stages, query, broad, missed, thesis or error\n", only.c_str());
        return 2;
    }
    return report.finish();
}
