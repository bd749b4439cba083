#pragma once
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include "content/scene/build_scene.hpp"
#include "engine/base/error.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "systems/frame/frame.hpp"

namespace trocar {

// A scene written in a test, stored in a file while this object exists.
struct WrittenScene {
    std::filesystem::path path;
    WrittenScene(const std::string& name, const std::string& text)
        : path(std::filesystem::temp_directory_path() / ("trocar_" + name + "_" + std::to_string(getpid()) + ".toml")) {
        std::ofstream(path) << text;
    }
    WrittenScene(const WrittenScene&) = delete;
    ~WrittenScene() { std::filesystem::remove(path); }
    BuiltScene build(const std::vector<Override>& overrides = {}) const {
        return build_scene(read_scene_file(path, overrides), Looks::kPlain);
    }
    // The error message of building it; empty if it is built.
    std::string error(const std::vector<Override>& overrides = {}) const {
        try {
            build(overrides);
        } catch (const InputError& e) {
            return e.what();
        }
        return "";
    }
};

// Steps a world and calls look(Frame&, int pass) after each pass.
template <typename Look>
void run(World world, int passes, const Look& look, uint32_t threads = 1) {
    ThreadPool pool(threads);
    pool.run([&] {
        Frame frame(std::move(world), {});
        for (int i = 0; i < passes; ++i) {
            frame.step();
            look(frame, i);
        }
    });
}

// The state hash after some passes on so many threads, and with scratch thrown away between any two stages; look(Frame&) at the end.
template <typename Look>
uint64_t hash_of(const WrittenScene& scene, int passes, uint32_t threads, bool clear_scratch, const Look& look) {
    uint64_t hash = 0;
    ThreadPool pool(threads);
    pool.run([&] {
        FrameOptions options;
        options.clear_scratch = clear_scratch;
        Frame frame(std::move(scene.build().world), options);
        for (int i = 0; i < passes; ++i) frame.step();
        look(frame);
        hash = state_hash(frame.world());
    });
    return hash;
}

// Any number of threads, and scratch thrown away between any two stages, give the same bits.
template <typename Look>
void expect_same_bits(const WrittenScene& scene, int passes, const Look& look) {
    const uint64_t one = hash_of(scene, passes, 1, false, look);
    EXPECT_EQ(one, hash_of(scene, passes, 3, false, look));
    EXPECT_EQ(one, hash_of(scene, passes, 1, true, look));
}

}  // namespace trocar
