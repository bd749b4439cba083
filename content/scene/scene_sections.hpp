#pragma once
#include "content/scene/scene_file.hpp"
#include "content/scene/toml_section.hpp"
namespace trocar {

// One function per table of a scene file. All throw InputError "file:line:column: reason".
std::vector<Keyframe> read_path(const std::string& file, TomlSection& owner, std::string_view key, bool with_grip = false);
void read_degrees(TomlSection& section, std::string_view key, double& angle);  // 0..180 degrees, into rad
BodySpec read_body(const std::string& file, const toml::table& table);
ToolSpec read_tool(const std::string& file, const toml::table& table);
GroupSpec read_group(const std::string& file, const toml::table& table);
TissueRegionSpec read_tissue_region(const std::string& file, const toml::table& table);
LinkSpec read_link(const std::string& file, const toml::table& table);
LinkSpec read_staple(const std::string& file, const toml::table& table);
CutSpec read_cut(const std::string& file, const toml::table& table);
NodeSpec read_node(const std::string& file, const toml::table& table);

// Removes [parameters] from the scene and inserts their values wherever other keys name them.
std::vector<SceneParameter> take_parameters(const std::string& file, toml::table& root);

// Inserts the value of one --set into the tables.
void apply_override(toml::table& root, const Override& o);

}  // namespace trocar
