#include <gtest/gtest.h>

#include "engine/thread_pool.hpp"

int main(int argc, char** argv) {
    trocar::set_float_mode();
    testing::InitGoogleTest(&argc, argv);
    return RUN_ALL_TESTS();
}
