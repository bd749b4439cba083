#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "engine/jobs/thread_pool.hpp"
#include "reference/paths.hpp"

namespace {
// A folder of this process alone, so that tests that write a file of the same name can run side by side. Gone at the end.
struct OwnFolder {
    std::string path = (std::filesystem::temp_directory_path() / "trocar_tests_XXXXXX").string();
    OwnFolder() {
        if (!::mkdtemp(path.data())) {
            std::perror(path.c_str());
            std::exit(1);
        }
        for (const char* name : {"TMPDIR", "TEST_TMPDIR"}) ::setenv(name, path.c_str(), 1);
    }
    ~OwnFolder() {
        std::error_code ignored;
        std::filesystem::remove_all(path, ignored);
    }
};
}  // namespace

int main(int argc, char** argv) {
    const OwnFolder folder;
    trocar::set_float_mode();
    ::setenv("TROCAR_LIBEXEC", trocar::program_path().parent_path().c_str(), 0);  // helpers are built beside it
    testing::InitGoogleTest(&argc, argv);
    return RUN_ALL_TESTS();
}
