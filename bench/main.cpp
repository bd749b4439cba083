#include <cstdio>
#include <cstring>
#include <exception>

#include "bench/suites.hpp"
#include "engine/jobs/thread_pool.hpp"

namespace {

struct Suite {
    const char* name;
    int (*run)(int argc, char** argv);
    const char* what;
};

constexpr Suite kSuites[] = {
#ifdef TROCAR_WITH_BENCHMARK
    {"content", content_suite, "marching cubes, stuffing, reading against assimp and Coin; takes Google Benchmark's flags"},
#endif
    {"contact", contact_suite,
     "contact beside its peers: [--quick] [--json FILE] [query|broad|missed|thesis|error]; or stages [passes] "
     "[goal|kidney|probe|deep|pile] [cell edges]"},
    {"deform", deform_suite,
     "integrators: rates, stable steps, error against time: [rates|threads|stability|errors|models] [--quick] [--json FILE] [--cache DIR "
     "of references, out/bench]; Bullet as peer"},
    {"fluid", fluid_suite, "films of liquid beside particles: [--quick] [--json FILE]"},
    {"scale", scale_suite,
     "bodies x threads with state hashes, growth, memory, critical path, idle cost: [--quick] [--json FILE] "
     "[--peers DIR: of JoltPhysics and box3d, built] [idle|counts|path|allocations|goals|bullet|pile]"},
    {"haptics", haptics_suite,
     "forces on replayed paths, slow simulations, stability, faults, ticks, live ticks: [--quick] [--json FILE] "
     "[paths|rates|stability|faults|tick|shell|live]"},
    {"scenes", scenes_suite,
     "another build of the program beside this one, stage by stage: --against PROGRAM [--scenes A,B] [--seconds S] [--repeat N] [--quick] "
     "[--json FILE]"},
    {"report", report_suite, "DIR: draws what suites wrote with --json DIR/NAME.json as one page, DIR/report.html"},
};

}  // namespace

int main(int argc, char** argv) {
    trocar::set_float_mode();
    trocar::keep_freed_memory();
    for (const Suite& suite : kSuites) {
        if (argc < 2 || std::strcmp(argv[1], suite.name) != 0) continue;
        try {
            return suite.run(argc - 1, argv + 1);
        } catch (const std::exception& e) {
            std::fprintf(stderr, "trocar_bench: %s\n", e.what());
            return 2;
        }
    }
    std::printf("usage: trocar_bench SUITE [arguments]\n\n");
    for (const Suite& suite : kSuites) std::printf("  %-8s %s\n", suite.name, suite.what);
    std::printf("\nExample: trocar_bench content --benchmark_repetitions=5 --benchmark_report_aggregates_only=true\n");
    return argc > 1 && std::strcmp(argv[1], "--help") == 0 ? 0 : 2;
}
