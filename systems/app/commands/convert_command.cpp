#include <cstdio>
#include <nlohmann/json.hpp>

#include "content/mend/clean_mesh.hpp"
#include "content/mend/repair_mesh.hpp"
#include "content/write/save_mesh.hpp"
#include "engine/base/error.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/console/load_file.hpp"
#include "systems/app/console/standard_streams.hpp"
namespace trocar {
namespace {

// What was changed in the mesh, and whether it may be written.
struct Changes {
    std::vector<std::string> lines;
    std::string refusal;
    double volume_before = 0, volume_after = 0;  // with repair
};

Changes change(Mesh& mesh, const ConvertOptions& options) {
    if (!options.repair) return {list_cleaning(clean_mesh(mesh, {options.weld})), "", 0, 0};
    RepairParams params;
    if (options.weld > 0) params.weld_tolerance = options.weld;
    if (options.hole_size > 0) params.holes.diagonal = options.hole_size;
    RepairReport report = repair_mesh(mesh, params);
    return {std::move(report.done), report.solid ? "" : report.reason, report.before.volume, report.after.volume};
}

std::string to_text(const ConvertOptions& options, const Mesh& mesh, const Changes& changes) {
    std::string text =
        options.out + ": " + std::to_string(mesh.position.size()) + " vertices, " + std::to_string(mesh.triangle.size()) + " triangles";
    if (!options.repair) {
        const char* gap = "; ";
        for (const std::string& line : changes.lines) {
            text += gap + line;
            gap = ", ";
        }
        return text + "\n";
    }
    text += format("; volume %.6g, before %.6g\n", changes.volume_after, changes.volume_before);
    for (const std::string& line : changes.lines) text += "  " + line + "\n";
    return text + (changes.lines.empty() ? "  nothing to repair\n" : "");
}

}  // namespace

int convert_command(const ConvertOptions& options) {
    LoadedMesh loaded = load_file(options.in, options.roots);
    const Changes changes = change(loaded.mesh, options);
    if (!changes.refusal.empty()) {
        for (const std::string& line : changes.lines) std::fprintf(stderr, "trocar: %s\n", line.c_str());
        std::fprintf(stderr, "trocar: %s: cannot be repaired: %s\n", options.in.c_str(), changes.refusal.c_str());
    } else if (loaded.mesh.triangle.empty()) {
        throw InputError(options.in + ": no face is left after cleaning");
    } else {
        save_mesh(loaded.mesh, options.out);
    }
    if (options.json) {
        std::string line;
        for (const std::string& change : changes.lines) line += (line.empty() ? "" : ", ") + change;
        nlohmann::ordered_json j = {{"in", options.in},
                                    {"out", options.out},
                                    {"format", loaded.format},
                                    {"vertices", loaded.mesh.position.size()},
                                    {"triangles", loaded.mesh.triangle.size()},
                                    {"changes", line}};
        if (options.repair) {
            j["repairs"] = changes.lines;
            j["solid"] = changes.refusal.empty();
            j["reason"] = changes.refusal;
            j["volume_before"] = changes.volume_before;
            j["volume_after"] = changes.volume_after;
        }
        write_standard_output(j.dump() + "\n");
    } else if (changes.refusal.empty()) {
        write_standard_output(to_text(options, loaded.mesh, changes));
    }
    return changes.refusal.empty() ? kDone : kNo;
}

}  // namespace trocar
