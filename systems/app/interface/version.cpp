#include "systems/app/interface/trocar/trocar.h"

const char* trocar_version(void) { return TROCAR_VERSION; }
