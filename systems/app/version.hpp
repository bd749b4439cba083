#pragma once

namespace trocar {

// Of this program, as CMakeLists.txt says: "0.1.0".
const char* program_version();

}  // namespace trocar
