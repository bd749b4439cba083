#include "mutate/mutants.hpp"

#include <gtest/gtest.h>

#include <cstdlib>

namespace trocar {
namespace {

using namespace mutate;

// Damaged files go to the readers of this program only: what they refuse is not handed on.
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

// A short run of trocar_mutate: each of 500 is read soundly or refused in one line; anything else ends the program.
TEST_F(Mutants, five_hundred_end_in_a_surface_or_one_line) {
    const std::vector<Seed> seeds = make_seeds();
    size_t read = 0;
    for (uint64_t number = 0; number < 500; ++number) read += try_mutant(make_mutant(seeds, number)) == Fate::kRead;
    EXPECT_GT(read, 50u);
    EXPECT_LT(read, 450u);
}

}  // namespace
}  // namespace trocar
