#pragma once
#include <string>
#include <vector>

#include "content/build_scene.hpp"
#include "content/scene_file.hpp"
#include "reference/paths.hpp"
namespace trocar {

// A scene of content/scenes with organs of few triangles, so that tests are quick.
inline BuiltScene small_scene(const std::string& name, const std::string& triangles = "1000") {
    std::vector<Override> overrides;
    const std::string path = (source_folder() / "content/scenes" / (name + ".toml")).string();
    for (const BodySpec& body : read_scene_file(path, {}).bodies) {
        if (body.motion != Motion::kStatic) {
            overrides.push_back({body.name + ".triangles", triangles});
            if (body.solid) overrides.push_back({body.name + ".cells", "8"});
        }
    }
    return build_scene(read_scene_file(path, overrides));
}

inline const std::vector<std::string>& scene_names() {
    static const std::vector<std::string> names{"probe_on_liver", "kidney_on_liver", "wrl_pair", "tet_liver_press"};
    return names;
}

}  // namespace trocar
