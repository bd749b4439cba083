#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "content/scene/build_scene.hpp"
#include "engine/base/error.hpp"
#include "engine/files/state_hash.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "systems/frame/frame.hpp"
#include "tests/app/run_program.hpp"

// Faults that must be survived, and the tests that inject them. Tests without a file are below.
//   corrupted model file         CommandLine.MeshCutInHalf..., Mutants (tests/content), ninja trocar_mutate
//   missing, unreadable, folder  CommandLine.MissingFilesAreNamed, FaultMatrix.DanglingLinksFoldersAndSceneFilesThatAreNone
//   out of disk in capture       FaultMatrix.AFullDiskEndsTheCaptureNotTheRun
//   killed in capture            Capture.AKilledRunLeavesAReadableCapture, Capture.ACaptureCutShortAnywhere...
//   device or simulation stalls  StalledSimulation.LetsTheForceGo, SoakCommand (pause)
//   bad samples of a device      HapticTick.T14BadSamplesAreRefused
//   NaN in simulation            Advance.M10_BodyThatIsNotFiniteIsRestoredAlone, FaultMatrix.ANodeThatIsNoNumber...
//   too many threads             FaultMatrix.SixtyFourThreadsOnFewCoresGiveTheSameState
//   memory limit                 FaultMatrix.RefusedMemoryIsOneLineNeverACrash, FaultMatrix.RefusedThreadsAreAWarningNeverACrash
//   clock, suspend, lateness     RealTime.*, LiveHaptics.ModelsOfALateSimulationAreFresh, SoakCommand (pause)
//   display lost                 LiveReplay.PicturesThatCannotBeWrittenEndThePicturesWithAReason; runs with --no-render need none
//   wrong configuration          CommandLine.WrongType..., FaultMatrix.EveryWrongValueOfEveryKeyIsNamed
namespace trocar {
namespace {
namespace fs = std::filesystem;

fs::path fresh_folder(const std::string& name) {
    const fs::path folder = fs::path(testing::TempDir()) / ("faults_" + name);
    fs::remove_all(folder);
    fs::create_directories(folder);
    return folder;
}

const char* kSmall = "kidney_on_liver --set liver.triangles=300 --set kidney.triangles=200 --no-render --threads 1";

TEST(FaultMatrix, DanglingLinksFoldersAndSceneFilesThatAreNone) {
    const fs::path folder = fresh_folder("missing");
    fs::create_symlink(folder / "nowhere", folder / "link.toml");
    fs::create_directories(folder / "folder.toml");
    std::ofstream(folder / "bad.toml") << std::string("seconds = 1\0\1\2", 14);
    for (const char* name : {"link.toml", "folder.toml", "bad.toml", "absent.toml"}) {
        const Outcome o = run_program("run " + (folder / name).string() + " --out " + (folder / "out").string(), source_folder(), folder);
        EXPECT_EQ(o.code, 2) << name << o.err;
        EXPECT_NE(o.err.find(name), std::string::npos) << o.err;
        EXPECT_EQ(std::count(o.err.begin(), o.err.end(), '\n'), 1) << o.err;
        EXPECT_FALSE(fs::exists(folder / "out")) << name;
    }
}

TEST(FaultMatrix, AFullDiskEndsTheCaptureNotTheRun) {
    if (!fs::exists("/dev/full")) GTEST_SKIP() << "no /dev/full";
    const fs::path folder = fresh_folder("disk");
    fs::create_directories(folder / "a/captures");
    fs::create_symlink("/dev/full", folder / "a/captures/counter_full");
    fs::create_symlink("/dev/full", folder / "a/captures/worst.cap");
    const Outcome with = run_program(std::string("run ") + kSmall + " --seconds 0.3 --capture 3-6,worst --out " + (folder / "a").string(),
                                     source_folder(), folder);
    const Outcome without =
        run_program(std::string("run ") + kSmall + " --seconds 0.3 --out " + (folder / "b").string(), source_folder(), folder);
    ASSERT_EQ(with.code, 0) << with.err;
    EXPECT_NE(with.err.find("capturing stopped, the run went on"), std::string::npos) << with.err;
    EXPECT_NE(with.err.find("No space left"), std::string::npos) << with.err;
    const auto hash = [](const fs::path& file) { return nlohmann::json::parse(std::ifstream(file))["state_hash"].get<std::string>(); };
    EXPECT_EQ(hash(folder / "a/metrics.json"), hash(folder / "b/metrics.json"));
    ASSERT_EQ(without.code, 0);
    const Outcome earlier = run_program("replay " + (folder / "a/captures/passes_3-6.cap").string(), source_folder(), folder);
    EXPECT_EQ(earlier.code, 0) << "what was written before can be replayed: " << earlier.err << earlier.out;
}

// Address space limits from far too small to sufficient: never a signal, never a partial result, always a
// one-line reason.
TEST(FaultMatrix, RefusedMemoryIsOneLineNeverACrash) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    GTEST_SKIP() << "the sanitizer reserves terabytes";
#endif
    const fs::path folder = fresh_folder("memory");
    const auto limited = [&](int mib) {
        const std::string command = "ulimit -v " + std::to_string(mib * 1024) + "; " + program_path().string() + " run " + kSmall +
                                    " --set liver.triangles=20000 --seconds 0.05 --figures-only --out " +
                                    (folder / std::to_string(mib)).string() + " >/dev/null 2>" + (folder / "err").string();
        const int status = std::system(("cd " + source_folder().string() + " && sh -c '" + command + "'").c_str());
        return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    };
    int refused = 0, served = 0;
    for (int mib = 64; mib < 1200 && served < 1; mib += mib < 240 ? 13 : 64) {
        const int code = limited(mib);
        std::ifstream err(folder / "err");
        std::string text{std::istreambuf_iterator<char>(err), {}};
        if (code == 127) continue;  // the loader could not even map the libraries
        EXPECT_TRUE(code == 0 || code == 2 || code == 3) << mib << " MiB: code " << code << " " << text;
        EXPECT_EQ(fs::exists(folder / std::to_string(mib) / "metrics.json"), code == 0) << mib;
        ++(code == 0 ? served : refused);
        EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), code == 0 ? 0 : 1) << mib << text;
    }
    EXPECT_EQ(served, 1);
    EXPECT_GT(refused, 3) << "nearly nothing was tested";
}

// Address space in which the stacks of worker threads do not fit, or leave no room for anything else: fewer
// threads with a one-line warning, or a one-line error. Without allocating the stacks beforehand, the
// scheduler ends the program with SIGABRT.
TEST(FaultMatrix, RefusedThreadsAreAWarningNeverACrash) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    GTEST_SKIP() << "the sanitizer reserves terabytes";
#endif
    const fs::path folder = fresh_folder("threads");
    int warned = 0, served = 0;
    const auto limited = [&](int threads, int mib) {
        const std::string command = "ulimit -v " + std::to_string(mib * 1024) + "; " + program_path().string() +
                                    " run kidney_on_liver --set liver.triangles=300 --set kidney.triangles=200 --seconds 0.05" +
                                    " --no-render --threads " + std::to_string(threads) + " >/dev/null 2>" + (folder / "err").string();
        const int status = std::system(("cd " + source_folder().string() + " && sh -c '" + command + "'").c_str());
        const int code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
        if (code == 127) return;  // the loader could not even map the libraries
        std::ifstream err(folder / "err");
        const std::string text{std::istreambuf_iterator<char>(err), {}};
        EXPECT_TRUE(code == 0 || code == 2 || code == 3) << mib << " MiB: code " << code << " " << text;
        if (code != 0) return;
        const bool says = text.find("threads; results are the same") != std::string::npos;
        EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), says) << mib << text;
        ++(says ? warned : served);
    };
    for (int mib = 80; mib < 480; mib += 20) limited(4, mib);
    for (int mib = 120; mib < 1080; mib += 80) limited(64, mib);
    EXPECT_GT(served, 3);
    EXPECT_GT(warned, 3) << "no thread was refused: nothing was tested";
}

TEST(FaultMatrix, SixtyFourThreadsOnFewCoresGiveTheSameState) {
    uint64_t hash[2];
    for (const uint32_t threads : {1u, 64u}) {
        ThreadPool pool(threads);
        pool.run([&] {
            Frame frame(std::move(build_scene(read_scene_file(source_folder() / "content/scenes/stress_rain.toml",
                                                              {{"count", "8"}, {"resolution", "80"}}))
                                      .world),
                        {});
            for (int i = 0; i < 30; ++i) frame.step();
            hash[threads > 1] = state_hash(frame.world());
        });
    }
    EXPECT_EQ(hash[0], hash[1]);
}

// One node of one body becomes NaN: it is counted and restored in the same pass, and bodies not in contact
// with it are unaffected, bit for bit.
TEST(FaultMatrix, ANodeThatIsNoNumberIsBackInOnePassAndOthersDoNotNotice) {
    std::vector<Float4> others[2];
    for (const int poke : {0, 1}) {
        ThreadPool pool(1);
        pool.run([&] {
            const auto scene = read_scene_file(source_folder() / "content/scenes/stress_sparse.toml",
                                               {{"count", "8"}, {"resolution", "80"}, {"ball.scatter.spacing", "[1, 1, 1]"}});
            Frame frame(std::move(build_scene(scene).world), {});
            World& w = frame.world();
            for (int i = 0; i < 10; ++i) frame.step();
            const Range poked = w.bodies.particles[3];
            if (poke) w.particles.offset[poked.first + 5].x = std::nanf("");
            frame.step();
            EXPECT_EQ(w.report.nonfinite_particles > 0, poke == 1);
            for (uint32_t i = poked.first; i < poked.end(); ++i) EXPECT_TRUE(std::isfinite(w.particles.offset[i].x)) << i;
            for (int i = 0; i < 10; ++i) frame.step();
            for (uint32_t body = 0; body < w.bodies.mesh.size(); ++body) {
                const Range r = w.bodies.particles[body];
                if (body != 3)
                    others[poke].insert(others[poke].end(), w.particles.offset.begin() + r.first, w.particles.offset.begin() + r.end());
            }
        });
    }
    ASSERT_EQ(others[0].size(), others[1].size());
    EXPECT_EQ(0, std::memcmp(others[0].data(), others[1].data(), others[0].size() * sizeof(Float4)));
}

// Sets every key of every built-in scene to invalid values: either the error names the key, or the value is
// unusual but allowed and loads.
TEST(FaultMatrix, EveryWrongValueOfEveryKeyIsNamed) {
    const char* wrong[] = {"\"word\"", "-1e308", "1e400", "nan", "[1, 2]", "{ a = 1 }", "true", "[[]]", "1979-05-27", "\"$none\""};
    uint64_t refused = 0, read = 0;
    const auto attempt = [&](const fs::path& scene, const std::string& key) {
        for (const char* value : wrong) {
            try {
                read_scene_file(scene, {{key, value}});
                ++read;
            } catch (const InputError& error) {
                ++refused;
                const std::string word = key.substr(key.rfind('.') + 1), what = error.what();
                EXPECT_TRUE(what.find(word) != std::string::npos || what.find("$none") != std::string::npos ||
                            what.find("none") != std::string::npos)
                    << key << " = " << value << ": " << what;
            }
        }
    };
    const fs::path scenes = source_folder() / "content/scenes";
    for (const char* key : {"seconds",
                            "gravity",
                            "substep",
                            "sleep_speed",
                            "sleep_after",
                            "contact.tolerance",
                            "contact.cell_edges",
                            "contact.iterations",
                            "contact.share",
                            "contact.deep",
                            "contact.faces",
                            "camera.kind",
                            "camera.fov",
                            "camera.target",
                            "liver.triangles",
                            "liver.size",
                            "liver.motion",
                            "liver.anchor",
                            "liver.integrator",
                            "liver.position",
                            "liver.rotation",
                            "liver.color",
                            "liver.tissue.youngs_modulus",
                            "liver.tissue.poisson",
                            "liver.fixed_below"})
        attempt(scenes / "kidney_on_liver.toml", key);
    for (const char* key : {"drop.scatter.count", "drop.scatter.columns", "drop.scatter.spacing", "drop.scatter.jitter",
                            "drop.scatter.turned", "drop.scatter.rate", "drop.scatter.life"})
        attempt(scenes / "stress_rain.toml", key);
    EXPECT_GT(refused, 200u);
    EXPECT_LT(read, refused);
}

}  // namespace
}  // namespace trocar
