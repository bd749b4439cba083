#pragma once
#include <string>

#include "systems/app/console/commands.hpp"
namespace trocar {

// Whether this is a capture, a live.recording or the folder of a run.
bool is_recording(const std::string& source);
// Makes the page that plays it: of a capture every pass, of a run its displayed frames. The run is repeated: from live.recording where
// there is one, else as its metrics.json says; 1 if it does not end as it did. Throws InputError.
int view_recording(const ViewOptions& options);

}  // namespace trocar
