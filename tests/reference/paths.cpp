#include "reference/paths.hpp"

#include <cstdlib>

namespace trocar {

std::filesystem::path source_folder() { return TROCAR_SOURCE_DIR; }
std::filesystem::path program_path() { return TROCAR_PROGRAM; }

std::filesystem::path shared_data_folder() {
    std::filesystem::path folder;
    if (const char* given = std::getenv("TROCAR_SHARED_DATA")) folder = given;
    if (folder.empty()) folder = source_folder() / "../shared/data";
    if (!std::filesystem::is_directory(folder)) folder = source_folder() / "../../shared/data";
    return std::filesystem::is_directory(folder) ? folder : std::filesystem::path{};
}

}  // namespace trocar
