#include "content/read/assimp_file.hpp"

#include "content/read/mesh_stream.hpp"
#include "content/text/texture.hpp"
#include "engine/base/error.hpp"
#include "engine/files/child_process.hpp"
#include "engine/files/image_file.hpp"
namespace trocar {
namespace {

constexpr const char* kAssimpReader = "trocar-assimp-reader";
constexpr int kUnknownFormat = 2;

ChildLimits limits_for(size_t bytes) {
    const double megabytes = static_cast<double>(bytes) / 1e6;
    return {.cpu_seconds = 3 + megabytes,
            .wall_seconds = 15 + 4 * megabytes,  // allows for a busy machine
            .address_space_bytes = helper_address_space((uint64_t{512} << 20) + 64 * uint64_t{bytes}),
            .output_bytes = (uint64_t{256} << 20) + 64 * uint64_t{bytes}};
}

// Loads textures embedded in the file or stored beside it.
void load_pictures(MeshStream& stream, const std::filesystem::path& path, const FileRoots& roots) {
    for (size_t m = 0; m < stream.mesh.material.size(); ++m) {
        Material& material = stream.mesh.material[m];
        if (material.texture.empty()) continue;
        std::string trouble;
        try {
            if (stream.picture[m].empty()) {
                trouble = load_texture(roots, path.parent_path(), material);
            } else {
                material.image = decode_image(stream.picture[m], "texture '" + material.texture + "' inside the file");
            }
        } catch (const InputError& error) {
            trouble = std::string("texture not used: ") + error.what();
        }
        if (!trouble.empty()) stream.warnings.push_back(trouble);
    }
}

}  // namespace

LoadedMesh read_with_assimp(std::string_view bytes, const std::filesystem::path& path, const FileRoots& roots) {
    const std::filesystem::path program = find_helper_program(kAssimpReader);
    if (program.empty()) {
        throw InputError(path.string() + ": not a format this program reads itself, and " + kAssimpReader +
                         ", which reads others, is not installed");
    }
    const ChildLimits limits = limits_for(bytes.size());
    const ChildResult result = run_child({program.string(), path.string()}, limits, bytes);
    if (result.end == ChildEnd::kExited && result.exit_code == kUnknownFormat) {
        throw InputError(path.string() + ": not a format this program reads (" + kFormatsRead + ")");
    }
    if (result.end == ChildEnd::kExited && result.exit_code == 1) {
        throw InputError(path.string() + ": " + last_error_line(result));
    }
    const std::string trouble = describe_child_end(result, limits);
    if (!trouble.empty()) throw InputError(path.string() + ": its reader " + trouble);
    try {
        MeshStream stream = decode_mesh_stream(result.output);
        load_pictures(stream, path, roots);
        for (std::string& warning : stream.warnings) warning = path.string() + ": " + warning;
        return {std::move(stream.mesh), std::move(stream.warnings), std::move(stream.format)};
    } catch (const InputError& error) {
        throw InputError(path.string() + ": " + error.what());
    }
}

}  // namespace trocar
