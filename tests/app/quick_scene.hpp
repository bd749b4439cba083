#pragma once
#include "content/scene/build_scene.hpp"
#include "content/scene/scene_file.hpp"
#include "tests/reference/paths.hpp"
namespace trocar {

// The probe scene with balls, which are cheap to build, and a hand four times as fast: contact after 0.15 s.
inline World quick_scene() {
    const std::vector<Override> balls = {{"liver.shape", "\"sphere\""}, {"liver.size", "0.12"},  {"liver.triangles", "600"},
                                         {"probe.shape", "\"sphere\""}, {"probe.size", "0.014"}, {"probe.triangles", "100"}};
    World world = build_scene(read_scene_file(source_folder() / "content/scenes/probe_on_liver.toml", balls), Looks::kPlain).world;
    for (Keyframe& key : world.paths.key) key.time *= 0.25;
    return world;
}

}  // namespace trocar
