#include <cstdio>
#include <nlohmann/json.hpp>

#include "content/clean_mesh.hpp"
#include "content/save_mesh.hpp"
#include "engine/whole_file.hpp"
#include "systems/app/commands.hpp"
#include "systems/app/load_file.hpp"
#include "systems/app/standard_streams.hpp"
namespace trocar {

int convert_command(const ConvertOptions& options) {
    LoadedMesh loaded = load_file(options.in);
    for (const std::string& warning : loaded.warnings) std::fprintf(stderr, "trocar: warning: %s\n", warning.c_str());
    const CleanReport cleaned = clean_mesh(loaded.mesh, CleanParams{});
    save_mesh(loaded.mesh, options.out);
    if (options.json) {
        const nlohmann::ordered_json j = {{"in", options.in},
                                          {"out", options.out},
                                          {"format", loaded.format},
                                          {"vertices", loaded.mesh.position.size()},
                                          {"triangles", loaded.mesh.triangle.size()},
                                          {"changes", describe_cleaning(cleaned)}};
        write_standard_output(j.dump() + "\n");
    } else {
        std::string text = options.out + ": " + std::to_string(loaded.mesh.position.size()) + " vertices, " +
                           std::to_string(loaded.mesh.triangle.size()) + " triangles";
        const std::string changes = describe_cleaning(cleaned);
        if (!changes.empty()) text += "; " + changes;
        write_standard_output(text + "\n");
    }
    return kDone;
}

}  // namespace trocar
