#pragma once

namespace trocar {

// Version from CMakeLists.txt: "0.1.0".
const char* program_version();

}  // namespace trocar
