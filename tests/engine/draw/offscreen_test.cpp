#include "engine/draw/offscreen.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <thread>

namespace trocar {
namespace {

TEST(Offscreen, NamesItsLibrary) {
    OffscreenContext context;
    const std::string library = offscreen_library(context);
    EXPECT_NE(library.find("Mesa"), std::string::npos) << library;
    EXPECT_NE(library.find("Core Profile"), std::string::npos) << library;
}

// fails when a context stays current on the thread that made it
TEST(Offscreen, ContextsMoveBetweenThreads) {
    OffscreenContext first, second;
    first.make_current();
    first.release();
    std::thread([&] {
        first.make_current();
        first.release();
        second.make_current();
        second.release();
    }).join();
    EXPECT_EQ(offscreen_library(first), offscreen_library(second));
}

// the user's environment takes precedence
TEST(Offscreen, ThreadPolicyKeepsTheUsersChoice) {
    const char* before = std::getenv("LP_NUM_THREADS");
    const std::string kept = before ? before : "";
    unsetenv("LP_NUM_THREADS");
    set_offscreen_threads(0);
    EXPECT_STREQ(std::getenv("LP_NUM_THREADS"), "0");
    set_offscreen_threads(2);
    EXPECT_STREQ(std::getenv("LP_NUM_THREADS"), "0");
    if (!before) unsetenv("LP_NUM_THREADS");
    if (before) setenv("LP_NUM_THREADS", kept.c_str(), 1);
}

}  // namespace
}  // namespace trocar
