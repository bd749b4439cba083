#include <nlohmann/json.hpp>

#include "content/scene/find_scene.hpp"
#include "content/scene/scene_file.hpp"
#include "content/scene/tissues.hpp"
#include "content/shapes/shape_library.hpp"
#include "engine/base/cpu.hpp"
#include "engine/distance/closest_point.hpp"
#include "engine/draw/offscreen.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/console/standard_streams.hpp"
#include "systems/app/console/version.hpp"
namespace trocar {
namespace fs = std::filesystem;

int scenes_command(bool json) {
    std::vector<fs::path> files;
    for (const std::string& name : built_in_scenes()) files.push_back(scenes_folder() / (name + ".toml"));
    nlohmann::ordered_json rows = nlohmann::ordered_json::array();
    std::string text;
    for (const fs::path& file : files) {
        const SceneFile scene = read_scene_file(file, {});
        rows.push_back({{"name", file.stem().string()},
                        {"file", file.string()},
                        {"description", scene.settings.description},
                        {"seconds", scene.settings.seconds},
                        {"bodies", scene.bodies.size()},
                        {"tools", scene.tools.size()}});
        text += file.stem().string() + "\n    " + scene.settings.description + "\n";
        std::string list;
        for (const SceneParameter& p : scene.parameters) list += (list.empty() ? "    --set " : " --set ") + p.name + "=" + p.value;
        if (!list.empty()) text += list + "\n";
    }
    text += "\nShapes, for `shape = NAME` in a scene and as shape:NAME[:TRIANGLES[:SEED]] where a command takes a mesh:\n";
    for (const std::string& name : shape_names()) {
        text += format("    %-14s  %s\n", name.c_str(), std::string(describe_shape(name)).c_str());
    }
    text += "\nTissues, for `tissue = NAME` of a body, or `preset = NAME` in its [body.tissue] with keys that override it:\n";
    for (const TissuePreset& preset : tissue_presets()) {
        text += format("    %-18s  E %g Pa, %g kg/m^3, wall %g mm, bed %g mm, volume %g Pa, bending %g Pa\n        %s\n", preset.name,
                       preset.tissue.youngs_modulus, preset.tissue.density, preset.tissue.wall * 1e3, preset.tissue.depth * 1e3,
                       preset.tissue.pressure_modulus, preset.tissue.bending, preset.sources);
    }
    text += "    Values without a source above (wall, bed, volume, damping, friction) are chosen, not measured.\n";
    write_standard_output(json ? rows.dump(1) + "\n"
                               : text + "\nRun one: trocar run " + (files.empty() ? "SCENE" : files[0].stem().string()) +
                                     " --out out/run\n");
    return kDone;
}

std::string version_text() {
    std::string text = std::string("trocar ") + program_version() + " (" + instruction_set() + ")\n";
    text += std::string("Embree ") + closest_point_library() + "\n";
    text += "compiler " + std::string(__VERSION__) + "\n";
    OffscreenContext context;
    text += "drawing " + offscreen_library(context);
    return text;
}

}  // namespace trocar
