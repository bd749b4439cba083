#pragma once
#include "content/scene/scene_file.hpp"
#include "content/scene/toml_section.hpp"
namespace trocar {

// One function per table of a scene file. All throw InputError "file:line:column: reason".
std::vector<Keyframe> read_path(TomlSection& owner, std::string_view key, bool with_grip = false);
void read_degrees(TomlSection& section, std::string_view key, double& angle);  // 0..180 degrees, into rad
BodySpec read_body(TomlSection section);
ToolSpec read_tool(TomlSection section);
GroupSpec read_group(TomlSection section);
TissueRegionSpec read_tissue_region(TomlSection section);
LinkSpec read_link(TomlSection section);
LinkSpec read_staple(TomlSection section);
CutSpec read_cut(TomlSection section);
ActionSpec read_action(TomlSection section);
WoundSpec read_wound(TomlSection section);
ThreadSpec read_thread(TomlSection section);
FluidSpec read_fluid(TomlSection section);
NodeSpec read_node(TomlSection section);

// Removes [parameters] from the scene and inserts their values wherever other keys name them.
std::vector<SceneParameter> take_parameters(const std::string& file, toml::table& root);

// Inserts the value of one --set into the tables.
void apply_override(toml::table& root, const Override& o);

}  // namespace trocar
