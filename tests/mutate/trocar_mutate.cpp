#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <new>

#include "engine/files/text_file.hpp"
#include "engine/files/whole_file.hpp"
#include "engine/jobs/real_time.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "mutate/mutants.hpp"

// trocar_mutate [--count N] [--first K] [--seconds S] [--minutes M] [--only ENDING] [--out DIR] [FILE...]
// Tries N mutants (20000) from number K (0) on, or as many as M minutes allow, each within S seconds (20), of
// the seeds generated here (with --only wrl those whose name ends in wrl) or of the given files. A worker
// process tries them one after another. When a mutant kills the worker (sanitizer report, failed check, time
// limit), the mutant is saved in DIR (.) and another worker continues after it. Exit code 1 if there was one.
namespace {

using namespace trocar;

// In memory shared by the worker and its parent.
struct Progress {
    std::atomic<uint64_t> number, read, refused;
};

struct Options {
    uint64_t count = 20000, first = 0;
    unsigned seconds = 20;
    double minutes = 0;  // 0 = no limit
    std::string only, out = ".";
    std::vector<std::string> files;
};

[[noreturn]] void work(const std::vector<mutate::Seed>& seeds, const Options& options, int64_t end_ns, Progress& progress) {
    for (; progress.number < options.first + options.count; ++progress.number) {
        if (monotonic_ns() > end_ns) break;
        ::alarm(options.seconds);
        const bool read = mutate::try_mutant(mutate::make_mutant(seeds, progress.number)) == mutate::Fate::kRead;
        ++(read ? progress.read : progress.refused);
    }
    std::fflush(nullptr);
    ::_exit(0);
}

std::string keep(const mutate::Seed& mutant, uint64_t number, const std::string& out) {
    const std::string path = out + "/mutant-" + std::to_string(number) + "-" + mutant.name;
    write_whole_file(path, mutant.bytes);
    return path;
}

Options read_options(int argc, char** argv) {
    Options options;
    for (int k = 1; k < argc; ++k) {
        const auto is = [&](const char* name) { return std::strcmp(argv[k], name) == 0 && k + 1 < argc; };
        if (is("--count")) {
            options.count = std::strtoull(argv[++k], nullptr, 10);
        } else if (is("--first")) {
            options.first = std::strtoull(argv[++k], nullptr, 10);
        } else if (is("--seconds")) {
            options.seconds = static_cast<unsigned>(std::strtoul(argv[++k], nullptr, 10));
        } else if (is("--minutes")) {
            options.minutes = std::strtod(argv[++k], nullptr);
            options.count = ~uint64_t{0} >> 1;
        } else if (is("--only")) {
            options.only = argv[++k];
        } else if (is("--out")) {
            options.out = argv[++k];
        } else {
            options.files.emplace_back(argv[k]);
        }
    }
    return options;
}

}  // namespace

int main(int argc, char** argv) {
    set_float_mode();
    const Options options = read_options(argc, argv);
    std::vector<mutate::Seed> seeds;
    for (const std::string& file : options.files) seeds.push_back({file, read_text_file(file)});
    if (seeds.empty()) {
        seeds = mutate::make_seeds();
        for (mutate::Seed& seed : mutate::make_input_seeds()) seeds.push_back(std::move(seed));
    }
    std::erase_if(seeds, [&](const mutate::Seed& seed) { return !seed.name.ends_with(options.only); });
    if (seeds.empty()) {
        std::printf("nothing built here reads %s\n", options.only.c_str());
        return 0;
    }
    const int64_t end_ns = options.minutes > 0 ? monotonic_ns() + static_cast<int64_t>(options.minutes * 6e10) : INT64_MAX;
    void* shared = ::mmap(nullptr, sizeof(Progress), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (shared == MAP_FAILED) return 3;
    Progress& progress = *new (shared) Progress{{options.first}, {0}, {0}};
    uint64_t found = 0;
    while (progress.number < options.first + options.count && monotonic_ns() < end_ns) {
        const pid_t worker = ::fork();
        if (worker < 0) return 3;
        if (worker == 0) work(seeds, options, end_ns, progress);
        int status = 0;
        ::waitpid(worker, &status, 0);
        if (WIFEXITED(status) && WEXITSTATUS(status) == 0) break;
        const std::string path = keep(mutate::make_mutant(seeds, progress.number), progress.number, options.out);
        const char* how = WIFSIGNALED(status) ? ::strsignal(WTERMSIG(status)) : "a report";
        std::printf("mutant %llu ended with %s: %s\n", static_cast<unsigned long long>(progress.number), how, path.c_str());
        ++found;
        ++progress.number;
    }
    std::printf("%llu mutants of %zu seeds: %llu read, %llu refused, %llu found something\n",
                static_cast<unsigned long long>(progress.number - options.first), seeds.size(),
                static_cast<unsigned long long>(progress.read), static_cast<unsigned long long>(progress.refused),
                static_cast<unsigned long long>(found));
    return found == 0 ? 0 : 1;
}
