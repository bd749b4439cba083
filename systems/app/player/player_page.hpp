#pragma once
#include <string>

#include "systems/app/player/player_recorder.hpp"
namespace trocar {

// Whether the program was built with the player.
bool has_player();
// Its script, compressed by zlib; empty without it.
std::string packed_player_script();

// Largest recording on a page, bytes of base64. Beyond it every second frame goes until the rest fits.
inline constexpr size_t kLargestRecording = size_t{8} << 20;

// The section of a page that plays a recording, with all that it needs. Lets frames of the recording go if they do not fit;
// says so, and says why there is no player where it was not built or one frame alone does not fit.
std::string player_section(PlayerRecorder& recorder, const std::string& scene, const Camera& camera, size_t largest = kLargestRecording);
std::string missing_player_section();

}  // namespace trocar
