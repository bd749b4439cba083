#pragma once
#include <filesystem>

namespace trocar {

// The folder of the checkout the tests were built from, and the program they were built beside.
std::filesystem::path source_folder();
std::filesystem::path program_path();

// The folder of real surfaces and volumes: $TROCAR_SHARED_DATA, else shared/data beside the checkout. Empty when absent.
std::filesystem::path shared_data_folder();

}  // namespace trocar
