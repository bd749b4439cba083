#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>

#include "content/mend/clean_mesh.hpp"
#include "content/mend/unit_guess.hpp"
#include "content/scene/build_scene.hpp"
#include "content/scene/tissues.hpp"
#include "content/volume/organ_surface.hpp"
#include "content/volume/volume_file.hpp"
#include "content/write/save_mesh.hpp"
#include "engine/base/error.hpp"
#include "engine/distance/closest_point.hpp"
#include "engine/files/whole_file.hpp"
#include "engine/geometry/quaternion.hpp"
#include "systems/app/console/command_pool.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/console/load_file.hpp"
#include "systems/app/console/progress.hpp"
#include "systems/app/console/standard_streams.hpp"
#include "systems/app/station/exercise_file.hpp"
namespace trocar {
namespace {

namespace fs = std::filesystem;

// One body of the scene to be written.
struct Part {
    std::string source;  // label, name of a segment or DEF name
    std::string name;
    std::string tissue;  // a preset; empty: a static body
    std::string motion;
    std::array<double, 3> color{};
    uint32_t triangles = 0;  // 0 = of all
    Mesh mesh{};             // file units
    std::string file{};      // as the scene names it
};

struct Look {
    const char* tissue;
    std::array<double, 3> color;
};
// Chosen, so that neighbours differ; a table may name others.
constexpr Look kLooks[] = {{"liver", {0.45, 0.16, 0.12}},
                           {"kidney", {0.50, 0.20, 0.16}},
                           {"gallbladder", {0.35, 0.50, 0.20}},
                           {"bowel", {0.80, 0.50, 0.45}},
                           {"fat", {0.90, 0.78, 0.45}},
                           {"muscle", {0.60, 0.22, 0.20}},
                           {"", {0.85, 0.82, 0.74}},
                           {"polypropylene_mesh", {0.8, 0.85, 0.9}}};

std::array<double, 3> color_of(const std::string& tissue) {
    const auto* look = std::ranges::find_if(kLooks, [&](const Look& l) { return tissue == l.tissue; });
    return look == std::end(kLooks) ? kLooks[0].color : look->color;
}

[[noreturn]] void fail(const CsvTable& t, size_t row, const std::string& why) {
    throw InputError(t.file + ":" + std::to_string(row + 2) + ": " + why);
}

// The parts that a table lists: columns label and name, and optionally tissue, motion, color ("red green blue"), triangles.
std::vector<Part> read_table(const fs::path& file) {
    const CsvTable t = read_csv(file);
    constexpr const char* kColumns[] = {"label", "name", "tissue", "motion", "color", "triangles"};
    for (const std::string& column : t.column)
        if (std::ranges::find(kColumns, column) == std::end(kColumns))
            throw InputError(t.file + ":1: no column \"" + column + "\"; there are label, name, tissue, motion, color, triangles");
    if (t.find("label") == t.column.size() || t.find("name") == t.column.size())
        throw InputError(t.file + ":1: the columns label and name are needed");
    std::vector<Part> parts;
    for (size_t r = 0; r < t.row.size(); ++r) {
        const auto field = [&](const char* column) {
            const size_t c = t.find(column);
            return c == t.column.size() ? std::string() : std::string(t.row[r][c]);
        };
        Part p{field("label"), field("name"), field("tissue"), field("motion"), {}};
        if (p.source.empty() || p.name.empty() || !is_body_name(p.name)) fail(t, r, "a label and a name without /, \\, \" are needed");
        if (std::ranges::any_of(parts, [&](const Part& other) { return other.name == p.name; })) fail(t, r, "a second \"" + p.name + "\"");
        if (!p.tissue.empty() && !find_tissue(p.tissue)) fail(t, r, "no tissue \"" + p.tissue + "\"; there are " + tissue_names());
        if (p.motion.empty()) p.motion = p.tissue.empty() ? "static" : "deformable";
        if (p.motion != "static" && p.motion != "deformable" && p.motion != "free")
            fail(t, r, "motion \"" + p.motion + "\" is none of static, deformable, free");
        if (p.motion == "deformable" && p.tissue.empty()) fail(t, r, "a deformable body needs a tissue: " + tissue_names());
        p.color = color_of(p.tissue);
        const std::string color = field("color");
        if (!color.empty() && std::sscanf(color.c_str(), "%lf %lf %lf", &p.color[0], &p.color[1], &p.color[2]) != 3)
            fail(t, r, "color \"" + color + "\": three numbers, as \"0.8 0.5 0.4\"");
        for (const double c : p.color)
            if (!(c >= 0 && c <= 1)) fail(t, r, "the numbers of a color are 0 to 1");
        if (!field("triangles").empty()) p.triangles = static_cast<uint32_t>(std::clamp(t.number(r, t.find("triangles")), 4.0, 2e7));
        parts.push_back(std::move(p));
    }
    if (parts.empty()) throw InputError(t.file + ": lists nothing");
    return parts;
}

Part unlisted(const std::string& source, const std::string& name) { return {source, name, "", "static", color_of("")}; }

// What a scene is made of, before it is laid out.
struct Parts {
    std::vector<Part> part;
    double metres = 1;            // per file unit
    double touch = 0;             // m: surfaces nearer than this touch; 0 = none do
    std::string turn, turn_note;  // [axis, degrees] from the file's axes to the world's
    Quat orientation;
};

// About x.
Quat quarter_turn(int sign) { return from_rotation_vector(sign * 0.5 * std::numbers::pi * Vec3d::UnitX()); }

void refuse_what_is_missing(const std::string& file, const Part& part, const std::vector<std::string>& known) {
    std::string list;
    for (const std::string& name : known) list += (list.empty() ? "" : ", ") + name;
    if (std::ranges::find(known, part.source) == known.end())
        throw InputError(file + ": has no \"" + part.source + "\" for \"" + part.name + "\"; it has " + list);
}

constexpr size_t kMostLabels = 256;  // more distinct values are measured ones

// Surfaces of the labels or segments of an image, with even triangles.
Parts parts_of_volume(const SceneOptions& o, Progress& progress) {
    progress.show(0, "reading " + o.source);
    const Volume volume = read_volume(o.source, {o.series, o.frame});
    for (const std::string& warning : volume.warnings) std::fprintf(stderr, "trocar: warning: %s\n", warning.c_str());
    std::map<std::string, Segment> known;
    for (const Segment& s : volume.segments) known[s.name] = s;
    const auto values = volume.layers == 1 ? count_values(volume, kMostLabels) : std::vector<std::pair<double, uint64_t>>{};
    for (const auto& [value, count] : values)
        if (value != 0) known.try_emplace(format("%g", value), Segment{"", "", value, 0});
    if (known.empty() || (!values.empty() && values.front().first < 0))
        throw InputError(o.source + ": contains measured values, not labels: segment it first");
    Parts all;
    all.part = o.labels.empty() ? std::vector<Part>{} : read_table(o.labels);
    std::vector<std::string> names;
    for (const auto& [name, segment] : known) names.push_back(name);
    if (o.labels.empty())
        for (const std::string& name : names)
            if (volume.segments.empty() || !known[name].name.empty())
                all.part.push_back(unlisted(name, known[name].name.empty() ? "label_" + name : name));
    for (size_t k = 0; k < all.part.size(); ++k) {
        Part& part = all.part[k];
        refuse_what_is_missing(o.source, part, names);
        progress.show(static_cast<double>(k) / static_cast<double>(all.part.size()), "surface of " + part.name);
        const Segment& segment = known[part.source];
        const OrganParams params{1, 10, part.triangles > 0 ? part.triangles : o.triangles, true, false};
        const Volume layer = volume.layers > 1 ? take_layer(volume, segment.layer) : Volume{};
        const Volume& from = volume.layers > 1 ? layer : volume;
        const VoxelMask mask = select_label(from, segment.label, organ_frame(params));
        if (mask.count == 0) throw InputError(o.source + ": no voxel of \"" + part.source + "\"");
        OrganSurface organ = make_organ_surface(params, from, mask);
        for (const std::string& warning : organ.warnings)
            std::fprintf(stderr, "trocar: warning: %s: %s\n", part.name.c_str(), warning.c_str());
        part.mesh = std::move(organ.mesh);
    }
    all.metres = 1e-3;
    for (const Vec3d& step : volume.step) all.touch = std::max(all.touch, all.metres * step.norm());
    all.turn = "[1.0, 0.0, 0.0, -90.0]", all.orientation = quarter_turn(-1);
    all.turn_note = "patient axes (x left, y back, z head) become world axes: x left, y head, z front; the patient lies on the back";
    return all;
}

Mesh take_triangles(const Mesh& all, uint32_t first, uint32_t count) {
    Mesh part;
    part.position = all.position, part.material = all.material;
    const auto take = [&](const auto& from, auto& to) {
        if (!from.empty()) to.assign(from.begin() + first, from.begin() + first + count);
    };
    take(all.triangle, part.triangle), take(all.uv, part.uv), take(all.triangle_material, part.triangle_material);
    drop_unused_vertices(part);
    return part;
}

// The shapes of a scene graph as parts, the rest of the triangles of other meshes as one.
Parts parts_of_graph(const SceneOptions& o) {
    const LoadedMesh loaded = load_file(o.source, o.roots);
    std::vector<MeshPart> shapes = loaded.parts;
    if (shapes.empty()) shapes.push_back({fs::path(o.source).stem().string(), 0, static_cast<uint32_t>(loaded.mesh.triangle.size())});
    std::erase_if(shapes, [](const MeshPart& s) { return s.count == 0; });
    std::map<std::string, int> times;
    std::vector<std::string> names;
    for (MeshPart& shape : shapes) {
        if (shape.name.empty() || !is_body_name(shape.name)) shape.name = "shape";
        const int n = ++times[shape.name];
        names.push_back(n > 1 ? shape.name + "_" + std::to_string(n) : shape.name);
    }
    Parts all;
    all.part = o.labels.empty() ? std::vector<Part>{} : read_table(o.labels);
    if (o.labels.empty())
        for (const std::string& name : names) all.part.push_back(unlisted(name, name));
    for (Part& part : all.part) {
        refuse_what_is_missing(o.source, part, names);
        const MeshPart& shape = shapes[static_cast<size_t>(std::ranges::find(names, part.source) - names.begin())];
        part.mesh = take_triangles(loaded.mesh, shape.first, shape.count);
    }
    Box box;
    for (const Vec3d& p : loaded.mesh.position) grow(box, p);
    all.metres = o.scale > 0 ? o.scale : guess_unit((box.max - box.min).norm()).metres;
    all.turn = "[1.0, 0.0, 0.0, 90.0]", all.orientation = quarter_turn(1);
    all.turn_note = "y of the file is up: world axes are x, -z, y of the file";
    return all;
}

struct Touch {
    std::string body, to;
    double within;   // m, from vertex to vertex
    uint32_t count;  // vertices of `body`
};

// Pairs of bodies, one of them deformable, of which vertices of the first lie nearer than `touch` to the surface of the second.
std::vector<Touch> find_touches(const World& w, double touch) {
    std::vector<Touch> touches;
    const Surfaces s = surfaces_of(w);
    const auto box_of = [&](uint32_t body) {
        Box box;
        for (uint32_t v = 0; v < w.meshes.info[w.bodies.mesh[body]].vertices.count; ++v) grow(box, vertex_position(s, body, v));
        return box;
    };
    std::vector<Box> boxes;
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) boxes.push_back(box_of(b));
    for (uint32_t a = 0; a < boxes.size(); ++a)
        for (uint32_t b = 0; b < boxes.size(); ++b) {
            const bool soft = is_deformable(w.bodies, a), once = !is_deformable(w.bodies, b) || a < b;
            const bool apart =
                ((boxes[a].min.array() - touch > boxes[b].max.array()) || (boxes[b].min.array() - touch > boxes[a].max.array())).any();
            if (a == b || !soft || !once || apart) continue;
            uint32_t count = 0;
            for (uint32_t v = 0; v < w.meshes.info[w.bodies.mesh[a]].vertices.count; ++v)
                count += std::abs(w.trees[w.bodies.tree[b]]->query(world_to_frame(s, b, vertex_position(s, a, v))).distance) < touch;
            const double mesh = is_deformable(w.bodies, b) ? w.meshes.info[w.bodies.mesh[b]].mean_edge : 0;
            if (count > 0) touches.push_back({w.bodies.name[a], w.bodies.name[b], touch + mesh, count});
        }
    return touches;
}

// To a nanometre; without -0.
Vec3d rounded(const Vec3d& v) {
    return v.unaryExpr([](double x) { return std::round(1e9 * x) * 1e-9 + 0.0; });
}

std::string scene_text(const SceneOptions& o, const Parts& all, const Vec3d& centre, const std::vector<Touch>& touches) {
    const Vec3d move = rounded(-rotate(all.orientation, Vec3d(all.metres * centre)));
    std::string text = "# Made by trocar scene from " + fs::path(o.source).filename().string() + ".\n# Axes: " + all.turn_note + ".\n";
    text += "# position moves the middle of all bodies to the origin of the world.\n";
    text += "name = \"" + fs::path(o.out).stem().string() + "\"\nseconds = 2.0\n";
    text +=
        "gravity = [0.0, 0.0, 0.0] # organs as they were imaged hang in equilibrium already\n\n[camera]\nazimuth = -60.0\nelevation = "
        "35.0\n";
    for (const Part& p : all.part) {
        text += "\n[[body]]\nname = \"" + p.name + "\"\nfile = \"" + p.file + "\"\n" + format("scale = %.9g\n", all.metres);
        text += format("origin = \"file\"\nposition = [%.9g, %.9g, %.9g]\nrotation = ", move.x(), move.y(), move.z()) + all.turn + "\n";
        text += "motion = \"" + p.motion + "\"\n";
        if (!o.labels.empty() || p.mesh.material.empty())
            text += format("color = [%.3g, %.3g, %.3g]\n", p.color[0], p.color[1], p.color[2]);
        if (!p.tissue.empty()) text += "tissue = \"" + p.tissue + "\"\n";
    }
    for (const Touch& t : touches)
        text += "\n[[link]] # they touch\nbody = \"" + t.body + "\"\nto = \"" + t.to + "\"\n" + format("within = %.6g\n", t.within);
    return text;
}

// File names: what a path may not hold, or a scene would have to quote, becomes "_".
std::string file_name(const std::string& name) {
    std::string out = name;
    for (char& c : out)
        if (!(std::isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_')) c = '_';
    return out;
}

void write_meshes(const SceneOptions& o, Parts& all) {
    const fs::path folder = fs::path(o.out).parent_path() / fs::path(o.out).stem();
    fs::create_directories(folder);
    for (size_t k = 0; k < all.part.size(); ++k) {
        Part& p = all.part[k];
        p.mesh.name = p.name;
        const std::string name = file_name(p.name) + ".obj";
        const bool twice = std::any_of(all.part.begin(), all.part.begin() + static_cast<ptrdiff_t>(k),
                                       [&](const Part& other) { return file_name(other.name) + ".obj" == name; });
        p.file = (folder.filename() / (twice ? std::to_string(k) + "_" + name : name)).string();
        save_mesh(p.mesh, folder.parent_path() / p.file);
    }
}

nlohmann::ordered_json to_json(const BuiltScene& scene, const std::vector<Touch>& touches, const std::string& out) {
    nlohmann::ordered_json bodies = nlohmann::ordered_json::array(), links = nlohmann::ordered_json::array();
    const World& w = scene.world;
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) {
        const MeshInfo& info = w.meshes.info[w.bodies.mesh[b]];
        const Vec3d& at = w.poses.origin[b];
        bodies.push_back({{"name", w.bodies.name[b]},
                          {"triangles", info.triangles.count},
                          {"volume_m3", info.volume},
                          {"centroid_m", {at.x(), at.y(), at.z()}}});
    }
    for (const Touch& t : touches) links.push_back({{"body", t.body}, {"to", t.to}, {"within_m", t.within}, {"vertices", t.count}});
    return {{"out", out}, {"bodies", bodies}, {"links", links}};
}

std::string to_text(const BuiltScene& scene, const std::vector<Touch>& touches, const std::string& out) {
    std::string text;
    const World& w = scene.world;
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) {
        const MeshInfo& info = w.meshes.info[w.bodies.mesh[b]];
        const Vec3d at = 1e3 * w.poses.origin[b];
        text += format("  %-20s %7u triangles, %9.2f ml, centroid %.1f %.1f %.1f mm\n", w.bodies.name[b].c_str(), info.triangles.count,
                       1e6 * info.volume, at.x(), at.y(), at.z());
    }
    for (const Touch& t : touches) text += format("  %s touches %s at %u vertices: linked\n", t.body.c_str(), t.to.c_str(), t.count);
    return text + "wrote " + out + ": try trocar run " + out + " --out out/" + fs::path(out).stem().string() + "\n";
}

bool is_scene_graph(const std::string& file) {
    constexpr const char* kEndings[] = {".wrl", ".wrz", ".x3d", ".x3dv", ".x3dz", ".iv",  ".obj", ".stl", ".ply",
                                        ".off", ".vtk", ".vtp", ".gltf", ".glb",  ".dae", ".fbx", ".3ds"};
    std::string ending = fs::path(file).extension().string();
    for (char& c : ending) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return std::ranges::any_of(kEndings, [&](const char* e) { return ending == e; });
}

}  // namespace

int scene_command(const SceneOptions& o) {
    const fs::path out = o.out;
    if (out.extension() != ".toml") throw InputError(o.out + ": the scene to write ends in .toml");
    int code = kDone;
    CommandPool pool(0);
    pool.run([&] {
        Progress progress("scene");
        Parts all = is_scene_graph(o.source) ? parts_of_graph(o) : parts_of_volume(o, progress);
        Box box;
        for (const Part& p : all.part)
            for (const Vec3d& v : p.mesh.position) grow(box, v);
        const Vec3d centre = 0.5 * (box.min + box.max);
        write_meshes(o, all);
        progress.show(0.95, "looking for organs that touch");
        const auto build = [&](const std::vector<Touch>& touches, std::string& text) {
            text = scene_text(o, all, centre, touches);
            return build_scene(read_scene_text(text, out, {}), Looks::kPlain);
        };
        std::string text;
        BuiltScene scene = build({}, text);
        const double touch = o.touch >= 0 ? o.touch : all.touch;
        const std::vector<Touch> touches = touch > 0 ? find_touches(scene.world, touch) : std::vector<Touch>{};
        if (!touches.empty()) scene = build(touches, text);
        for (const std::string& warning : scene.warnings) std::fprintf(stderr, "trocar: warning: %s\n", warning.c_str());
        write_whole_file(out, text);
        write_standard_output(o.json ? to_json(scene, touches, o.out).dump() + "\n" : to_text(scene, touches, o.out));
        if (o.labels.empty())
            std::fprintf(stderr, "trocar: note: without --labels all bodies are static; a table names them and gives tissues\n");
    });
    return code;
}

}  // namespace trocar
