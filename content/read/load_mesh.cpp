#include "content/read/load_mesh.hpp"

#include <algorithm>

#include "content/mend/clean_mesh.hpp"
#include "content/read/assimp_file.hpp"
#include "content/read/obj_file.hpp"
#include "content/read/off_file.hpp"
#include "content/read/ply_file.hpp"
#include "content/read/stl_file.hpp"
#include "content/read/vrml/flatten.hpp"
#include "content/read/vrml/x3d.hpp"
#include "content/read/vtk_file.hpp"
#include "content/read/vtp_file.hpp"
#include "content/text/words.hpp"
#include "engine/base/error.hpp"
#include "engine/files/text_file.hpp"
namespace trocar {
namespace {

// Whether one of the first lines starts as only OBJ lines do.
bool looks_like_obj(std::string_view text) {
    constexpr std::string_view kKeys[] = {"v", "vt", "vn", "f", "o", "g", "s", "l", "p", "vp", "mg", "usemtl", "mtllib", "curv", "deg"};
    if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);
    int lines = 0;
    while (!text.empty() && lines < 20) {
        const size_t stop = std::min(text.find_first_of("\r\n"), text.size());
        std::string_view line = text.substr(0, stop);
        text.remove_prefix(std::min(stop + 1, text.size()));
        const size_t first = line.find_first_not_of(" \t");
        if (first == std::string_view::npos || line[first] == '#') continue;
        line.remove_prefix(first);
        const std::string_view key = line.substr(0, line.find_first_of(" \t"));
        if (key.size() < line.size() && std::find(std::begin(kKeys), std::end(kKeys), key) != std::end(kKeys)) {
            return true;
        }
        ++lines;
    }
    return false;
}

bool looks_like_ascii_stl(std::string_view text) {
    const std::string head = lower_case(text.substr(0, 4096));
    const size_t first = head.find_first_not_of(" \t\r\n");
    if (first == std::string::npos || head.compare(first, 5, "solid") != 0) return false;
    return head.find("facet", first) != std::string::npos || head.find("endsolid", first) != std::string::npos;
}

// One format: detection and reader. The reader may keep the bytes.
struct Reader {
    bool (*is_it)(std::string_view bytes, const std::filesystem::path& path);
    LoadedMesh (*read)(std::string bytes, const std::filesystem::path& path, const LoadOptions& options);
};

// Adapter for a reader that does not keep the bytes, and for one that opens other files.
template <auto Read>
LoadedMesh read_with(std::string bytes, const std::filesystem::path& path, const LoadOptions& options) {
    if constexpr (std::is_invocable_v<decltype(Read), std::string_view, std::filesystem::path, FileRoots>) {
        return Read(bytes, path, options.roots);
    } else {
        return Read(bytes, path);
    }
}

template <bool (*LooksLike)(std::string_view)>
bool by_content(std::string_view bytes, const std::filesystem::path&) {
    return LooksLike(bytes);
}

bool by_stl_ending(std::string_view, const std::filesystem::path& path) { return lower_case(path.extension().string()) == ".stl"; }

LoadedMesh read_scene(std::string bytes, const std::filesystem::path& path, const LoadOptions& options) {
    return vrml::flatten_document(vrml::read_document(std::move(bytes), path, options.progress), options);
}

// Tested in this order. Binary STL is detected by its exact size, whatever word it begins with; one of wrong
// size cannot be detected by content, so a file named .stl goes to the STL reader for its better error
// message.
constexpr Reader kReaders[] = {
    {by_content<is_binary_stl>, read_with<read_binary_stl>},
    {by_content<looks_like_ascii_stl>, read_with<read_ascii_stl>},
    {by_content<looks_like_ply>, read_with<read_ply>},
    {by_content<looks_like_vtk>, read_with<read_vtk>},
    {by_content<looks_like_off>, read_with<read_off>},
    {by_content<vrml::looks_like_vrml>, read_scene},
    {by_content<looks_like_vtp>, read_with<read_vtp>},
    {by_content<looks_like_obj>, read_with<read_obj>},
    {by_stl_ending, read_with<read_binary_stl>},
};

}  // namespace

LoadedMesh load_mesh(std::string bytes, const std::filesystem::path& path, LoadOptions options) {
    options.roots.insert(options.roots.begin(), path.parent_path());
    if (bytes.empty()) throw InputError(path.string() + ": empty file");
    if (bytes.starts_with("\xef\xbb\xbf") && !is_binary_stl(bytes)) bytes.erase(0, 3);
    const Reader* const reader =
        std::find_if(std::begin(kReaders), std::end(kReaders), [&](const Reader& r) { return r.is_it(bytes, path); });
    LoadedMesh loaded =
        reader == std::end(kReaders) ? read_with_assimp(bytes, path, options.roots) : reader->read(std::move(bytes), path, options);
    if (loaded.mesh.triangle.empty()) {
        // the first ignored element is the most likely cause
        std::string reason = ": " + loaded.format + " without a face";
        if (!loaded.warnings.empty()) reason += " (" + loaded.warnings.back() + ")";
        throw InputError(path.string() + reason);
    }
    weld_vertices(loaded.mesh, 0);
    drop_unused_vertices(loaded.mesh);
    Mesh& mesh = loaded.mesh;
    mesh.name = path.stem().string();
    const auto is_first = [](uint16_t row) { return row == 0; };
    if (std::all_of(mesh.triangle_material.begin(), mesh.triangle_material.end(), is_first)) {
        mesh.triangle_material.clear();
    }
    return loaded;
}

LoadedMesh load_mesh(const std::filesystem::path& path, const LoadOptions& options) {
    return load_mesh(read_text_file(path), path, options);
}

}  // namespace trocar
