#include "mutate/mutants.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "content/scene/scene_file.hpp"
#include "engine/base/error.hpp"
namespace trocar {
namespace {

using namespace mutate;

// Damaged files are given only to this program's readers: files that they reject are not passed to assimp.
struct Mutants : testing::Test {
    std::string old_helpers;
    void SetUp() override {
        if (const char* set = std::getenv("TROCAR_LIBEXEC")) old_helpers = set;
        ::unsetenv("TROCAR_LIBEXEC");
    }
    void TearDown() override { ::setenv("TROCAR_LIBEXEC", old_helpers.c_str(), 1); }
};

TEST_F(Mutants, every_seed_is_read_as_it_is) {
    for (const Seed& seed : make_seeds()) EXPECT_EQ(try_mutant(seed), Fate::kRead) << seed.name;
    for (const Seed& seed : make_input_seeds()) EXPECT_EQ(try_mutant(seed), Fate::kRead) << seed.name;
}

TEST_F(Mutants, the_same_number_gives_the_same_bytes_and_they_differ_from_the_seed) {
    const std::vector<Seed> seeds = make_seeds();
    size_t changed = 0;
    for (uint64_t number = 0; number < 100; ++number) {
        const Seed mutant = make_mutant(seeds, number);
        EXPECT_EQ(mutant.bytes, make_mutant(seeds, number).bytes);
        changed += mutant.bytes != seeds[number % seeds.size()].bytes;
    }
    EXPECT_GT(changed, 90u);
}

// A short run of trocar_mutate: each of 500 files is read correctly or rejected with one line; anything else
// ends the program.
TEST_F(Mutants, five_hundred_end_in_a_surface_or_one_line) {
    const std::vector<Seed> seeds = make_seeds();
    size_t read = 0;
    for (uint64_t number = 0; number < 500; ++number) read += try_mutant(make_mutant(seeds, number)) == Fate::kRead;
    EXPECT_GT(read, 50u);
    EXPECT_LT(read, 450u);
}

TEST_F(Mutants, five_hundred_scenes_recordings_and_messages_too) {
    const std::vector<Seed> seeds = make_input_seeds();
    size_t read = 0;
    for (uint64_t number = 0; number < 500; ++number) read += try_mutant(make_mutant(seeds, number)) == Fate::kRead;
    EXPECT_GT(read, 20u);
    EXPECT_LT(read, 400u);
}

// An assertion inside the TOML parser becomes an error with its line, not the end of the program.
TEST(MalformedScenes, AreNamedWhereTheParserIsLost) {
    const std::filesystem::path file = std::filesystem::temp_directory_path() / "trocar_malformed.toml";
    for (const char* line : {"[[`ody]]", "[[\x1aody]]", "a = {, b = 1}", "\xc7\xb7 = 3"}) {
        std::ofstream(file) << "name = \"x\"\n\n" << line << "\nseconds = 1\n";
        try {
            read_scene_file(file, {});
            FAIL() << line;
        } catch (const InputError& error) {
            EXPECT_NE(std::string(error.what()).find(".toml:3:"), std::string::npos) << error.what();
        }
    }
    std::filesystem::remove(file);
}

}  // namespace
}  // namespace trocar
