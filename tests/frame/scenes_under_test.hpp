#pragma once
#include <string>
#include <vector>

#include "content/scene/build_scene.hpp"
#include "content/scene/scene_file.hpp"
#include "reference/paths.hpp"
#include "systems/frame/frame.hpp"
namespace trocar {

inline double seconds_of(const Frame& f) { return static_cast<double>(f.world().clock.tick) * 1e-3; }

// A scene of content/scenes with organs of few triangles, so that tests are quick. every_contact_stage is
// kidney_on_liver with all options of [contact]; skin_press is tet_liver_press with an embedded surface.
// bleed_and_suck and smoke begin with all that they do.
inline BuiltScene small_scene(const std::string& name, const std::string& triangles = "1000", Looks looks = Looks::kPlain) {
    std::vector<Override> overrides;
    const bool every = name == "every_contact_stage";
    const bool skin = name == "skin_press";
    const std::string file = every ? "kidney_on_liver" : skin ? "tet_liver_press" : name;
    const std::string path = (source_folder() / "content/scenes" / (file + ".toml")).string();
    for (const BodySpec& body : read_scene_file(path, {}).bodies) {
        if (body.motion == Motion::kStatic) continue;
        overrides.push_back({body.name + ".triangles", every ? "300" : triangles});  // its stages are slow
        if (body.solid) overrides.push_back({body.name + ".cells", "8"});
        if (body.solid && skin) overrides.push_back({body.name + ".skin", "true"});
    }
    if (name == "jaw_grasp") {  // links early and from a distance, for short runs, and springs that break
        for (const char* link : {"link.upper.", "link.lower."}) {
            overrides.push_back({std::string(link) + "from", "0.35"});
            overrides.push_back({std::string(link) + "until", "0.6"});
            overrides.push_back({std::string(link) + "within", "0.03"});
        }
        overrides.push_back({"gallbladder.break_strain", "0.05"});
    }
    if (every) {
        for (const char* key : {"contact.contours", "contact.regions", "contact.faces"}) overrides.push_back({key, "true"});
        overrides.push_back({"contact.deep", "last_free"});
    }
    BuiltScene built = build_scene(read_scene_file(path, overrides), looks);
    if (name == "bleed_and_suck" || name == "smoke") {  // all from the start, for short runs
        for (const ToolAction& action : built.world.actions.action) built.world.actions.time[action.times.first] = 0;
        for (Wound& wound : built.world.fluids.wound) wound.begin = 0;
    }
    return built;
}

inline const std::vector<std::string>& scene_names() {
    static const std::vector<std::string> names{"probe_on_liver",      "kidney_on_liver", "wrl_pair",
                                                "every_contact_stage", "tet_liver_press", "jaw_grasp",
                                                "skin_press",          "shaft_on_liver",  "dial_and_button"};
    return names;
}

}  // namespace trocar
