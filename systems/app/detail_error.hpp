#pragma once
#include <string>

#include "content/scene_file.hpp"
namespace trocar {

// Runs a scene with its levels of detail and without them side by side, pass by pass in turn, and says what they cost in
// accuracy and bring in time: per body that asks for it the share of passes in which it was coarse and how far the vertices of
// its surface are from the full model's (root mean square over vertices and passes, largest; m); per tool the difference of the force on
// the hand and of the tissue's (over all passes, N, beside the full model's); of both the time on the clock of `advance` and
// the processor time of whole passes. One text of lines; a JSON object with `json`. Throws InputError when no body of the
// scene has a [body.lod].
std::string detail_error(const SceneFile& file, double seconds, bool json);

}  // namespace trocar
