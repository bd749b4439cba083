#pragma once
#include <filesystem>
#include <string>
#include <vector>
namespace trocar {

// Folder of the built-in scenes: $TROCAR_SCENES, content/scenes of the source tree while it is the working folder, or
// beside the program or the shared library that holds this function, as built or as installed.
std::filesystem::path scenes_folder();
// Names of the built-in scenes, ascending. Throws InputError if the folder cannot be read.
std::vector<std::string> built_in_scenes();
// Scene file of that name: the file if there is one, else the built-in scene. Throws InputError that suggests a similar name.
std::filesystem::path find_scene(const std::string& name);

// The known word that a mistyped one is meant to be; empty if none is close.
std::string similar_word(const std::string& word, const std::vector<std::string>& known);

}  // namespace trocar
