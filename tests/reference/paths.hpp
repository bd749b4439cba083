#pragma once
#include <filesystem>

namespace trocar {

// The folder of the checkout that the tests were built from, and the program built with them.
std::filesystem::path source_folder();
std::filesystem::path program_path();

// The folder of real surfaces and volumes: $TROCAR_SHARED_DATA, otherwise shared/data beside the checkout.
// Empty if absent.
std::filesystem::path shared_data_folder();

}  // namespace trocar
