#include <gtest/gtest.h>

#include <cstdlib>

#include "engine/thread_pool.hpp"
#include "reference/paths.hpp"

int main(int argc, char** argv) {
    trocar::set_float_mode();
    ::setenv("TROCAR_LIBEXEC", trocar::program_path().parent_path().c_str(), 0);  // helpers are built beside it
    testing::InitGoogleTest(&argc, argv);
    return RUN_ALL_TESTS();
}
