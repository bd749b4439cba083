#include "systems/app/console/version.hpp"
namespace trocar {

const char* program_version() { return TROCAR_VERSION; }

}  // namespace trocar
