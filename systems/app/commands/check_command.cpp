#include <cstdio>
#include <nlohmann/json.hpp>

#include "content/mend/admission.hpp"
#include "content/mend/clean_mesh.hpp"
#include "content/mend/unit_guess.hpp"
#include "content/scene/build_scene.hpp"
#include "engine/base/error.hpp"
#include "systems/app/console/command_pool.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/console/load_file.hpp"
#include "systems/app/console/standard_streams.hpp"
namespace trocar {
namespace {

// What the import changes in a mesh before contact uses it, and the resulting mesh.
struct Import {
    std::vector<std::string> changes;
    Admission admitted_as = Admission::kRefused;
};
Import import_of(Mesh mesh) {
    std::vector<std::string> changes = list_cleaning(clean_mesh(mesh, {}));
    return {std::move(changes), judge_mesh(mesh, true).admitted_as};
}

nlohmann::ordered_json to_json(const std::string& file, const MeshJudgement& j, const Import& import) {
    const UnitGuess guess = guess_unit((j.bbox_max - j.bbox_min).norm());
    const auto row = [](const Vec3d& v) { return nlohmann::ordered_json{v.x(), v.y(), v.z()}; };
    return {{"file", file},
            {"vertices", j.vertices},
            {"triangles", j.triangles},
            {"closed", j.closed},
            {"manifold", j.manifold},
            {"oriented", j.oriented},
            {"components", j.components},
            {"degenerate", j.degenerate},
            {"duplicate", j.duplicate},
            {"duplicate_faces", j.duplicate},
            {"boundary_edges", j.boundary_edges},
            {"non_manifold_edges", j.non_manifold_edges},
            {"flipped_edges", j.flipped_edges},
            {"self_crossing", j.self_crossing},
            {"volume", j.volume},
            {"area", j.area},
            {"bbox_min", row(j.bbox_min)},
            {"bbox_max", row(j.bbox_max)},
            {"admitted_as", admission_name(j.admitted_as)},
            {"reason", j.reason},
            {"repairs", import.changes},
            {"imported_as", admission_name(import.admitted_as)},
            {"unit_guess", guess.unit},
            {"unit_rule", guess.rule}};
}

std::string to_text(const std::string& file, const MeshJudgement& j, const Import& import) {
    std::string all = format(
        "%s: %s%s%s\n  %u vertices, %u triangles, %u component%s; closed %s, manifold %s, oriented %s; "
        "degenerate %u, self-crossing %u\n  volume %.6g, area %.6g, box %.6g x %.6g x %.6g\n",
        file.c_str(), admission_name(j.admitted_as), j.reason.empty() ? "" : ": ", j.reason.c_str(), j.vertices, j.triangles, j.components,
        j.components == 1 ? "" : "s", j.closed ? "yes" : "no", j.manifold ? "yes" : "no", j.oriented ? "yes" : "no", j.degenerate,
        j.self_crossing, j.volume, j.area, j.bbox_max.x() - j.bbox_min.x(), j.bbox_max.y() - j.bbox_min.y(),
        j.bbox_max.z() - j.bbox_min.z());
    for (const std::string& change : import.changes) all += "  import: " + change + "\n";
    if (import.admitted_as != j.admitted_as) all += std::string("  after import: ") + admission_name(import.admitted_as) + "\n";
    return all + "  unit: perhaps " + guess_unit((j.bbox_max - j.bbox_min).norm()).unit + "\n";
}

// Builds a scene as `run` does, without running it. Errors are thrown with file and line.
void check_scene(const std::string& file, bool json) {
    CommandPool pool(1);
    pool.run([&] {
        const BuiltScene scene = build_scene(read_scene_file(file, {}), Looks::kPlain);
        for (const std::string& warning : scene.warnings) std::fprintf(stderr, "trocar: warning: %s\n", warning.c_str());
        const size_t bodies = scene.world.bodies.mesh.size(), tools = scene.world.haptics.tool.size();
        const nlohmann::ordered_json j{{"file", file}, {"scene", true}, {"bodies", bodies}, {"tools", tools}};
        write_standard_output(json ? j.dump() + "\n"
                                   : file + ": a sound scene of " + std::to_string(bodies) + " bodies and " + std::to_string(tools) +
                                         " tools\n");
    });
}

}  // namespace

int check_command(const CheckOptions& options) {
    bool sound = true, readable = true;
    for (const std::string& file : options.files) {
        try {
            if (std::filesystem::path(file).extension() == ".toml") {
                check_scene(file, options.json);
                continue;
            }
            const LoadedMesh loaded = load_file(file, options.roots);
            MeshJudgement judgement = judge_mesh(loaded.mesh, true);
            judgement.vertices += static_cast<uint32_t>(loaded.unused_points);  // count all vertices in the file
            sound = sound && judgement.admitted_as == Admission::kSolid;
            const Import import = import_of(loaded.mesh);
            write_standard_output(options.json ? to_json(file, judgement, import).dump() + "\n" : to_text(file, judgement, import));
        } catch (const InputError& e) {
            // report this file's error and continue with the others
            std::fprintf(stderr, "trocar: %s\n", e.what());
            if (options.json)
                write_standard_output(nlohmann::ordered_json{{"file", file}, {"error", e.what()}}.dump(
                                          -1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) +
                                      "\n");
            readable = false;
        }
    }
    return !readable ? kUsage : sound ? kDone : kNo;
}

}  // namespace trocar
