#include "content/scene/find_scene.hpp"

#include <dlfcn.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>

#include "content/scene/toml_section.hpp"
#include "engine/base/error.hpp"
namespace trocar {
namespace fs = std::filesystem;

fs::path scenes_folder() {
    std::error_code error;
    if (const char* given = std::getenv("TROCAR_SCENES")) return given;
    if (fs::is_directory("content/scenes", error)) return fs::weakly_canonical("content/scenes", error);
    std::vector<fs::path> beside{fs::read_symlink("/proc/self/exe", error).parent_path()};
    Dl_info own;
    // of the program itself it is the word that started it
    if (dladdr(reinterpret_cast<const void*>(&scenes_folder), &own) != 0 && own.dli_fname && std::strstr(own.dli_fname, ".so"))
        beside.insert(beside.begin(), fs::weakly_canonical(own.dli_fname, error).parent_path());
    // build/PRESET of the source tree; PREFIX/bin or PREFIX/lib; PREFIX/lib/x86_64-linux-gnu; a Python package
    for (const fs::path& folder : beside)
        for (const char* way : {"../../content/scenes", "../share/trocar/scenes", "../../share/trocar/scenes", "scenes"})
            if (fs::is_directory(folder / way, error)) return fs::weakly_canonical(folder / way, error);
    return "content/scenes";
}

std::vector<std::string> built_in_scenes() {
    const fs::path folder = scenes_folder();
    std::error_code error;
    std::vector<std::string> names;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder, error))
        if (entry.path().extension() == ".toml") names.push_back(entry.path().stem().string());
    if (error) throw InputError(folder.string() + ": " + error.message());
    std::sort(names.begin(), names.end());
    return names;
}

std::string similar_word(const std::string& word, const std::vector<std::string>& known) { return nearest(word, known); }

fs::path find_scene(const std::string& name) {
    std::error_code error;
    // a folder of that name, such as one that a run wrote, hides no scene
    const bool file_there = fs::exists(name, error) && !fs::is_directory(name, error);
    if (file_there || name.find('/') != std::string::npos || name.ends_with(".toml")) return name;
    const fs::path file = scenes_folder() / (name + ".toml");
    if (fs::exists(file, error)) return file;
    const std::string guess = fs::is_directory(scenes_folder(), error) ? nearest(name, built_in_scenes()) : "";
    throw InputError(name + ": neither a scene file nor a built-in scene" +
                     (guess.empty() ? " (see `trocar scenes`)" : "; did you mean \"" + guess + "\"? (see `trocar scenes`)"));
}

}  // namespace trocar
