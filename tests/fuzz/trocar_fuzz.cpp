#include <sys/mman.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <filesystem>
#include <fstream>
#include <new>
#include <sstream>

#include "content/scene/build_scene.hpp"
#include "engine/base/error.hpp"
#include "engine/files/text_file.hpp"
#include "engine/files/whole_file.hpp"
#include "engine/jobs/real_time.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "fuzz/judge.hpp"
#include "fuzz/random_scene.hpp"

namespace {

constexpr const char* kHelp =
    "trocar_fuzz [--count N] [--first SEED] [--minutes M] [--seconds S] [--out DIR] [--seeds FILE] [--list FILE]\n"
    "trocar_fuzz --keep SEED | --shrink SEED | --scene FILE\n"
    "Runs N random scenes (1000) from a seed (0) on, as many as M minutes allow, or those of a file, for a second of simulated time\n"
    "each, S seconds of processor time (10) at most, and prints what is wrong with each. What the run itself warns of is \"named\";\n"
    "what is not is a finding, whose scene is kept in DIR (.). Exit code 1 if there was one; with a file of seeds, which must be\n"
    "free of trouble, for what is named, too. --list adds to a file the seeds of scenes without any trouble.\n"
    "--keep prints a scene, --shrink the smallest with the same fault; --scene judges one from a file.\n"
    "Example: trocar_fuzz --first 30000 --minutes 5 --out out/fuzz\n";

using namespace trocar;
using namespace trocar::fuzz;

struct Options {
    uint64_t count = 1000, first = 0;
    double minutes = 0, seconds = 10;
    std::string out = ".", seeds, list, scene;
    int64_t keep = -1, shrink = -1;
};

// In memory shared by a worker and its parent.
struct Shared {
    std::atomic<uint64_t> row, refused, silent[size_t(Kind::kCount)], named[size_t(Kind::kCount)], troubled;
    std::atomic<bool> named_slow;
};

// Node steps that a scene may take: some seconds. Scenes of tiny steps, of which a run warns, are cut short.
constexpr double kMostWork = 1e8;

double affordable_seconds(const World& w, double wanted) {
    double step = w.settings.substep, nodes = 300;
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) {
        if (!is_deformable(w.bodies, b)) continue;
        const Stepping stepping = stepping_of(w.bodies, b);
        const bool leapfrog = stepping.integrator == Integrator::kLeapfrog;
        step = std::min(step, leapfrog ? std::min(w.bodies.stable_dt[b], stepping.step) : stepping.step / stepping.iterations);
        nodes += w.bodies.particles[b].count;
    }
    for (const double linked : w.links.stable_dt) step = std::min(step, linked);
    return std::min(wanted, std::max(0.02, kMostWork * step / nodes));
}

struct Verdict {
    bool refused = false;
    std::vector<Trouble> trouble;
};

Verdict try_scene(const std::string& text, Shared* shared) {
    const std::string file = (std::filesystem::temp_directory_path() / ("trocar_fuzz_" + std::to_string(::getpid()) + ".toml")).string();
    Verdict verdict;
    ThreadPool pool(1);
    pool.run([&] {
        try {
            write_whole_file(file, text);
            const SceneFile scene = read_scene_file(file, {});
            World world = build_scene(scene, Looks::kPlain).world;
            const double seconds = affordable_seconds(world, scene.settings.seconds);
            FrameOptions frame_options;
            frame_options.pictures = false;
            Frame frame(std::move(world), frame_options);
            Judge judge(frame);
            do {
                if (shared) shared->named_slow = judge.warned_of_slowness();
                frame.step();
                judge.after_pass();
            } while (static_cast<double>(frame.world().clock.tick) < 1e3 * seconds);
            verdict.trouble = judge.finish();
        } catch (const InputError&) {
            verdict.refused = true;
        } catch (const std::exception& error) {
            verdict.trouble = {{Kind::kCrash, false, error.what()}};
        }
    });
    std::filesystem::remove(file);
    return verdict;
}

void limit_time(double seconds) {
    const auto whole = static_cast<long>(seconds);
    const itimerval timer{{}, {whole, static_cast<long>(1e6 * (seconds - static_cast<double>(whole)))}};
    ::setitimer(ITIMER_VIRTUAL, &timer, nullptr);
    ::alarm(static_cast<unsigned>(20 * seconds) + 1);  // for one that waits, whatever else the machine does
}

void report(uint64_t seed, const Trouble& trouble, const std::string& out, bool strict, Shared& shared) {
    const auto kind = static_cast<size_t>(trouble.kind);
    ++(trouble.named ? shared.named : shared.silent)[kind];
    const std::string character = random_scene(seed).block[0][0].substr(1);
    std::printf("seed %llu:%s: %s%s: %s\n", static_cast<unsigned long long>(seed), character.c_str(), std::string(kKindNames[kind]).c_str(),
                trouble.named ? " (named)" : "", trouble.reason.c_str());
    std::fflush(stdout);
    if (trouble.named && !strict) return;
    std::filesystem::create_directories(out);
    const std::string scene = "# seed " + std::to_string(seed) + ", " + std::string(kKindNames[kind]) + ": " + trouble.reason + "\n";
    write_whole_file(out + "/physics-" + std::to_string(seed) + ".toml", scene + random_scene(seed).text());
}

[[noreturn]] void work(const std::vector<uint64_t>& seeds, const Options& options, int64_t end_ns, Shared& shared) {
    for (; shared.row < seeds.size() && monotonic_ns() < end_ns; ++shared.row) {
        const uint64_t seed = seeds[shared.row];
        shared.named_slow = false;
        limit_time(options.seconds);
        const Verdict verdict = try_scene(random_scene(seed).text(), &shared);
        limit_time(0);
        shared.refused += verdict.refused;
        shared.troubled += !verdict.trouble.empty();
        if (!options.list.empty() && !verdict.refused && verdict.trouble.empty())
            std::ofstream(options.list, std::ios::app) << seed << "\n";
        for (const Trouble& trouble : verdict.trouble) report(seed, trouble, options.out, !options.seeds.empty(), shared);
    }
    std::fflush(nullptr);
    ::_exit(0);
}

std::vector<uint64_t> read_seeds(const Options& options) {
    std::vector<uint64_t> seeds;
    if (options.seeds.empty()) {
        for (uint64_t k = 0; k < options.count; ++k) seeds.push_back(options.first + k);
        return seeds;
    }
    std::stringstream lines(read_text_file(options.seeds));
    for (std::string line; std::getline(lines, line);) {
        std::stringstream words(line.substr(0, line.find('#')));
        for (uint64_t seed; words >> seed;) seeds.push_back(seed);
    }
    return seeds;
}

int run_seeds(const Options& options) {
    const std::vector<uint64_t> seeds = read_seeds(options);
    const int64_t end_ns = options.minutes > 0 ? monotonic_ns() + static_cast<int64_t>(options.minutes * 6e10) : INT64_MAX;
    void* memory = ::mmap(nullptr, sizeof(Shared), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) return 3;
    Shared& shared = *new (memory) Shared{};
    while (shared.row < seeds.size() && monotonic_ns() < end_ns) {
        const pid_t worker = ::fork();
        if (worker < 0) return 3;
        if (worker == 0) work(seeds, options, end_ns, shared);
        int status = 0;
        ::waitpid(worker, &status, 0);
        if (WIFEXITED(status) && WEXITSTATUS(status) == 0) break;
        const int signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
        const bool slow = signal == SIGVTALRM || signal == SIGALRM;
        const Trouble trouble{slow ? Kind::kSlow : Kind::kCrash, slow && shared.named_slow, signal ? ::strsignal(signal) : "a report"};
        ++shared.troubled;
        report(seeds[shared.row++], trouble, options.out, !options.seeds.empty(), shared);
    }
    const uint64_t tried = std::min<uint64_t>(shared.row, seeds.size());
    std::printf("%llu scenes: %llu refused, %llu without trouble", static_cast<unsigned long long>(tried),
                static_cast<unsigned long long>(shared.refused), static_cast<unsigned long long>(tried - shared.refused - shared.troubled));
    uint64_t findings = 0, named = 0;
    for (size_t k = 0; k < kKindNames.size(); ++k) {
        findings += shared.silent[k], named += shared.named[k];
        if (shared.silent[k] + shared.named[k] == 0) continue;
        std::printf("; %s %llu, named %llu", std::string(kKindNames[k]).c_str(), static_cast<unsigned long long>(shared.silent[k]),
                    static_cast<unsigned long long>(shared.named[k]));
    }
    std::printf("\n");
    return findings + (options.seeds.empty() ? 0 : named) == 0 ? 0 : 1;
}

// The kinds of a scene's trouble, tried in a process of its own.
std::vector<bool> kinds_of(const RandomScene& scene, double seconds) {
    std::vector<bool> kinds(static_cast<size_t>(Kind::kCount));
    const pid_t worker = ::fork();
    if (worker < 0) return kinds;
    if (worker == 0) {
        limit_time(seconds);
        int bits = 0;
        for (const Trouble& trouble : try_scene(scene.text(), nullptr).trouble) bits |= 1 << static_cast<int>(trouble.kind);
        ::_exit(bits & 0x7f);  // the last two kinds show in how it ends
    }
    int status = 0;
    ::waitpid(worker, &status, 0);
    for (size_t k = 0; k < 7 && WIFEXITED(status); ++k) kinds[k] = (WEXITSTATUS(status) >> k & 1) != 0;
    if (WIFSIGNALED(status)) kinds[static_cast<size_t>(WTERMSIG(status) == SIGVTALRM ? Kind::kSlow : Kind::kCrash)] = true;
    return kinds;
}

// Leaves out blocks, then lines, as long as the first kind of trouble stays.
RandomScene shrunk(RandomScene scene, double seconds) {
    const std::vector<bool> all = kinds_of(scene, seconds);
    const auto first = static_cast<size_t>(std::ranges::find(all, true) - all.begin());
    if (first == all.size()) return scene;
    const auto still = [&](const RandomScene& smaller) -> bool { return kinds_of(smaller, seconds)[first]; };
    for (size_t b = scene.block.size(); b-- > 0;) {
        RandomScene smaller = scene;
        smaller.block.erase(smaller.block.begin() + static_cast<ptrdiff_t>(b));
        if (still(smaller)) scene = std::move(smaller);
    }
    for (size_t b = 0; b < scene.block.size(); ++b) {
        for (size_t l = scene.block[b].size(); l-- > 0;) {
            RandomScene smaller = scene;
            smaller.block[b].erase(smaller.block[b].begin() + static_cast<ptrdiff_t>(l));
            if (still(smaller)) scene = std::move(smaller);
        }
    }
    return scene;
}

int judge_file(const std::string& file) {
    const Verdict verdict = try_scene(read_text_file(file), nullptr);
    if (verdict.refused) std::printf("refused\n");
    for (const Trouble& t : verdict.trouble)
        std::printf("%s%s: %s\n", std::string(kKindNames[size_t(t.kind)]).c_str(), t.named ? " (named)" : "", t.reason.c_str());
    return verdict.trouble.empty() ? 0 : 1;
}

Options read_options(int argc, char** argv) {
    Options options;
    for (int k = 1; k < argc; ++k) {
        const auto is = [&](const char* name) { return std::strcmp(argv[k], name) == 0 && k + 1 < argc; };
        if (std::strcmp(argv[k], "--help") == 0 || std::strcmp(argv[k], "-h") == 0) {
            std::fputs(kHelp, stdout);
            std::exit(0);
        }
        if (is("--count")) {
            options.count = std::strtoull(argv[++k], nullptr, 10);
        } else if (is("--first")) {
            options.first = std::strtoull(argv[++k], nullptr, 10);
        } else if (is("--seconds")) {
            options.seconds = std::strtod(argv[++k], nullptr);
        } else if (is("--minutes")) {
            options.minutes = std::strtod(argv[++k], nullptr);
            options.count = 10'000'000;
        } else if (is("--out")) {
            options.out = argv[++k];
        } else if (is("--seeds")) {
            options.seeds = argv[++k];
        } else if (is("--list")) {
            options.list = argv[++k];
        } else if (is("--scene")) {
            options.scene = argv[++k];
        } else if (is("--keep")) {
            options.keep = std::strtoll(argv[++k], nullptr, 10);
        } else if (is("--shrink")) {
            options.shrink = std::strtoll(argv[++k], nullptr, 10);
        } else {
            std::fprintf(stderr, "trocar_fuzz: %s is no option, or has no value: --help\n", argv[k]);
            std::exit(2);
        }
    }
    return options;
}

}  // namespace

int main(int argc, char** argv) {
    set_float_mode();
    const Options options = read_options(argc, argv);
    if (options.keep >= 0) std::printf("%s", random_scene(static_cast<uint64_t>(options.keep)).text().c_str());
    if (options.shrink >= 0) std::printf("%s", shrunk(random_scene(static_cast<uint64_t>(options.shrink)), options.seconds).text().c_str());
    if (options.keep >= 0 || options.shrink >= 0) return 0;
    if (!options.scene.empty()) return judge_file(options.scene);
    return run_seeds(options);
}
