#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <nlohmann/json.hpp>

#include "content/volume/mesh_distance.hpp"
#include "content/volume/organ_surface.hpp"
#include "content/volume/volume_file.hpp"
#include "content/write/save_mesh.hpp"
#include "content/write/save_tets.hpp"
#include "engine/base/error.hpp"
#include "engine/files/whole_file.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/console/progress.hpp"
#include "systems/app/console/standard_streams.hpp"
namespace trocar {
namespace {

// "its labels are 5 (1123.3 ml), 57 (1563.0 ml)", for messages; the segments of a volume that names them.
std::string list_values(const Volume& volume) {
    std::string list;
    size_t shown = 0;
    for (uint32_t layer = 0; layer < volume.layers && !volume.segments.empty(); ++layer) {
        const auto values = count_values(take_layer(volume, layer));
        for (const Segment& segment : volume.segments) {
            if (segment.layer != layer) continue;
            const auto found = std::find_if(values.begin(), values.end(), [&](const auto& v) { return v.first == segment.label; });
            const double voxels = found == values.end() ? 0 : double(found->second);
            list += (list.empty() ? "its segments are " : ", ") + segment.name + format(" (label %g", segment.label) +
                    (volume.layers > 1 ? format(" of layer %u", layer) : "") + format(", %.1f ml)", voxels * voxel_volume(volume) * 1e-3);
        }
    }
    if (!list.empty()) return list + ": choose with --segment";
    const auto values = count_values(volume);
    if (values.empty()) return "it contains measured values, not labels: choose with --threshold";
    for (const auto& [value, count] : values) {
        if (value == 0) continue;
        if (++shown > 60) return list + ", ...";
        list += (list.empty() ? "" : ", ") + format("%g", value) + format(" (%.1f ml)", double(count) * voxel_volume(volume) * 1e-3);
    }
    return list.empty() ? "all its voxels are 0" : "its labels are " + list;
}

// One surface to make.
struct OrganTask {
    std::string name;  // for messages
    std::filesystem::path out;
    bool by_threshold = false;
    double value = 0;
    uint32_t layer = 0;
};

const Segment& find_segment(const OrganOptions& options, const Volume& volume, const std::string& name) {
    for (const Segment& segment : volume.segments) {
        if (segment.name == name || segment.id == name) return segment;
    }
    throw InputError(options.volume + ": " +
                     (volume.segments.empty() ? "names no segments" : "has no segment \"" + name + "\"; " + list_values(volume)));
}

// The output of one of several surfaces: NAME_<part>.EXTENSION.
std::filesystem::path part_of(const std::filesystem::path& out, std::string part, size_t parts) {
    for (char& c : part) c = std::strchr("/\\:*?\"<>| ", c) || static_cast<unsigned char>(c) < ' ' ? '_' : c;
    std::filesystem::path file = out;
    return parts > 1 ? file.replace_filename(out.stem().string() + "_" + part + out.extension().string()) : file;
}

std::vector<OrganTask> list_tasks(const OrganOptions& options, const Volume& volume) {
    const std::filesystem::path out = options.out;
    std::vector<OrganTask> tasks;
    if (!options.threshold.empty() + !options.labels.empty() + !options.segments.empty() > 1)
        throw InputError("--label, --segment and --threshold exclude each other");
    if (volume.layers > 1 && options.segments.empty())
        throw InputError(options.volume + ": has " + std::to_string(volume.layers) + " layers; " + list_values(volume));
    if (!options.threshold.empty()) {
        double value = 0;
        const char* end = options.threshold.data() + options.threshold.size();
        const auto [stop, error] = std::from_chars(options.threshold.data(), end, value);
        if (error != std::errc() || stop != end || !std::isfinite(value)) {
            throw InputError("--threshold " + options.threshold + ": a finite number is needed");
        }
        return {{"threshold " + options.threshold, out, true, value}};
    }
    for (const std::string& name : options.segments) {
        const Segment& segment = find_segment(options, volume, name);
        tasks.push_back({"segment " + name, part_of(out, name, options.segments.size()), false, segment.label, segment.layer});
    }
    for (const double label : options.labels) {
        const std::string text = format("%g", label);
        tasks.push_back({"label " + text, part_of(out, text, options.labels.size()), false, label});
    }
    if (tasks.empty()) throw InputError(options.volume + ": choose voxels with --label, --segment or --threshold; " + list_values(volume));
    return tasks;
}

// The tetrahedra of an organ and the files they were written to.
struct OrganTets {
    size_t vertices = 0, tetrahedra = 0;
    TetFacts facts;
    double seconds = 0;  // processor time of this process
    std::vector<std::string> files;
    bool sound() const {
        return tetrahedra > 0 && facts.inverted == 0 && facts.bad_faces == 0 && facts.open_edges == 0 &&
               facts.min_dihedral > kStuffingMinDihedral && facts.max_dihedral < kStuffingMaxDihedral;
    }
};

OrganTets fill_organ(const OrganOptions& options, const OrganTask& task, const OrganSurface& organ) {
    if (organ.judgement.admitted_as != Admission::kSolid && organ.judgement.admitted_as != Admission::kWinding) {
        throw InputError(task.out.string() + ": no tetrahedra: the surface has no inside (" + organ.judgement.reason + ")");
    }
    const std::clock_t start = std::clock();
    const TetMesh mesh = stuff_isosurface({options.tets, 1}, {organ.judgement.bbox_min, organ.judgement.bbox_max},
                                          mesh_distance(organ.mesh, organ.judgement.admitted_as));
    OrganTets tets;
    tets.seconds = double(std::clock() - start) / CLOCKS_PER_SEC;
    tets.vertices = mesh.position.size();
    tets.tetrahedra = mesh.tetrahedron.size();
    tets.facts = judge_tets(mesh);
    if (mesh.tetrahedron.empty()) {
        throw InputError(task.out.string() + ": no tetrahedra: a spacing of " + format("%g", options.tets) +
                         " mm is too wide for the surface");
    }
    std::vector<FileContents> contents;
    const std::string vtu = encode_vtu(mesh), msh = encode_msh(mesh);
    for (const auto& [ending, bytes] : {std::pair{".vtu", &vtu}, {".msh", &msh}}) {
        std::filesystem::path file = task.out;
        contents.push_back({file.replace_extension(ending), *bytes});
        tets.files.push_back(contents.back().path.string());
    }
    write_whole_files(contents);
    return tets;
}

nlohmann::ordered_json tets_to_json(const OrganTets& t) {
    return {{"files", t.files},
            {"vertices", t.vertices},
            {"tetrahedra", t.tetrahedra},
            {"min_dihedral", t.facts.min_dihedral},
            {"max_dihedral", t.facts.max_dihedral},
            {"bounds", {kStuffingMinDihedral, kStuffingMaxDihedral}},
            {"inverted", t.facts.inverted},
            {"open_edges", t.facts.open_edges},
            {"bad_faces", t.facts.bad_faces},
            {"volume_mm3", t.facts.volume},
            {"min_volume_mm3", t.facts.min_volume},
            {"tets_per_cpu_second", t.seconds > 0 ? double(t.tetrahedra) / t.seconds : 0}};
}

std::string tets_to_text(const OrganTets& t, double surface_volume) {
    return format(
        "  tetrahedra: %zu, %zu vertices; dihedral angles %.2f to %.2f degrees (proven %.1f to %.1f); inverted %llu; "
        "boundary %s; %.2f ml (%+.3f %% of the surface); %.0f thousand per second of processor time\n  written: %s, %s\n",
        t.tetrahedra, t.vertices, t.facts.min_dihedral, t.facts.max_dihedral, kStuffingMinDihedral, kStuffingMaxDihedral,
        static_cast<unsigned long long>(t.facts.inverted), t.facts.open_edges + t.facts.bad_faces == 0 ? "watertight" : "NOT watertight",
        t.facts.volume * 1e-3, 100 * (t.facts.volume / surface_volume - 1), t.seconds > 0 ? double(t.tetrahedra) / t.seconds * 1e-3 : 0,
        t.files[0].c_str(), t.files[1].c_str());
}

nlohmann::ordered_json to_json(const OrganTask& task, const OrganSurface& organ) {
    nlohmann::ordered_json stages = nlohmann::ordered_json::array();
    for (const OrganStage& s : organ.stages) {
        stages.push_back({{"stage", s.name},
                          {"triangles", s.triangles},
                          {"open_edges", s.open_edges},
                          {"closed", s.open_edges == 0},
                          {"volume_mm3", s.volume},
                          {"change", s.change}});
    }
    return {{"out", task.out.string()},
            {"selection", task.name},
            {"voxels_selected", organ.voxels_selected},
            {"voxels", organ.voxels_kept},
            {"pieces", organ.pieces.size()},
            {"voxel_volume_mm3", organ.voxel_volume},
            {"volume_mm3", organ.stages.back().volume},
            {"volume_error", organ.stages.back().volume / organ.voxel_volume - 1},
            {"triangles", organ.mesh.triangle.size()},
            {"stages", stages},
            {"admitted_as", admission_name(organ.judgement.admitted_as)},
            {"reason", organ.judgement.reason},
            {"warnings", organ.warnings}};
}

std::string to_text(const OrganTask& task, const OrganSurface& organ) {
    std::string text = format("%s: %s, %llu of %llu voxels, %.2f ml\n", task.out.c_str(), task.name.c_str(),
                              static_cast<unsigned long long>(organ.voxels_kept), static_cast<unsigned long long>(organ.voxels_selected),
                              organ.voxel_volume * 1e-3);
    for (const OrganStage& s : organ.stages) {
        text +=
            format("  %-16s %8llu triangles, %s, %10.2f ml (%+.3f %%)\n", s.name.c_str(), static_cast<unsigned long long>(s.triangles),
                   s.open_edges == 0 ? "closed" : (std::to_string(s.open_edges) + " open edges").c_str(), s.volume * 1e-3, 100 * s.change);
    }
    return text + format("  %s: %s; volume %+.3f %% of the voxels'\n", admission_name(organ.judgement.admitted_as),
                         organ.judgement.reason.c_str(), 100 * (organ.stages.back().volume / organ.voxel_volume - 1));
}

}  // namespace

int organ_command(const OrganOptions& options) {
    if (!(options.blur >= 0 && options.blur <= 5)) throw InputError("--blur: 0 to 5 voxels");
    if (!(options.tets >= 0 && std::isfinite(options.tets))) throw InputError("--tets: a spacing in mm, above 0");
    if (options.smooth > 1000) throw InputError("--smooth: at most 1000 rounds");
    Progress progress("organ");
    progress.show(0, "reading " + options.volume);
    const Volume volume = read_volume(options.volume, {options.series, options.frame});
    for (const std::string& warning : volume.warnings) std::fprintf(stderr, "trocar: warning: %s\n", warning.c_str());
    const std::vector<OrganTask> tasks = list_tasks(options, volume);
    const OrganParams params{options.blur, options.smooth, options.triangles, options.even, options.all_pieces};
    bool sound = true;
    for (size_t k = 0; k < tasks.size(); ++k) {
        const OrganTask& task = tasks[k];
        const auto show = [&](double done, const std::string& stage) {
            progress.show((double(k) + done) / double(tasks.size()), task.name + ": " + stage);
        };
        Volume one;
        if (volume.layers > 1) one = take_layer(volume, task.layer);
        const Volume& layer = volume.layers > 1 ? one : volume;
        const VoxelMask mask =
            task.by_threshold ? select_above(layer, task.value, organ_frame(params)) : select_label(layer, task.value, organ_frame(params));
        if (mask.count == 0) throw InputError(options.volume + ": no voxel has " + task.name + "; " + list_values(volume));
        OrganSurface organ = make_organ_surface(params, layer, mask, show);
        organ.mesh.name = task.out.stem().string();
        save_mesh(organ.mesh, task.out);
        for (const std::string& warning : organ.warnings) {
            std::fprintf(stderr, "trocar: warning: %s: %s\n", task.out.c_str(), warning.c_str());
        }
        sound = sound && organ.judgement.admitted_as == Admission::kSolid;
        nlohmann::ordered_json answer = to_json(task, organ);
        std::string text = to_text(task, organ);
        if (options.tets > 0) {
            show(0.9, "filling with tetrahedra");
            const OrganTets tets = fill_organ(options, task, organ);
            sound = sound && tets.sound();
            answer["tets"] = tets_to_json(tets);
            text += tets_to_text(tets, organ.judgement.volume);
        }
        write_standard_output(options.json ? answer.dump() + "\n" : text);
    }
    return sound ? kDone : kNo;
}

}  // namespace trocar
