#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <memory>
#include <new>
#include <numbers>
#include <sstream>
#include <string_view>

#include "content/scene/find_scene.hpp"
#include "engine/base/error.hpp"
#include "engine/files/text_file.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "systems/app/commands/speed_command.hpp"
#include "systems/app/console/command_pool.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/station/score.hpp"

namespace {
using namespace trocar;

Override parse_override(const std::string& text) {
    const size_t equals = text.find('=');
    if (equals == std::string::npos || equals == 0)
        throw InputError("--set " + text + ": write key=value, for example --set liver.tissue.youngs_modulus=2e4");
    return {text.substr(0, equals), text.substr(equals + 1)};
}

// "x y z" as three arguments or one quoted argument.
std::vector<double> parse_numbers(const std::string& option, const std::string& text, size_t count) {
    std::vector<double> v;
    std::istringstream stream(text);
    for (std::string word; stream >> word;) {
        char* end = nullptr;
        v.push_back(std::strtod(word.c_str(), &end));
        if (end != word.c_str() + word.size() || !std::isfinite(v.back()))
            throw InputError(option + " \"" + text + "\": \"" + word + "\" is not a number");
    }
    if (v.size() != count) throw InputError(option + " \"" + text + "\": " + std::to_string(count) + " numbers are needed");
    return v;
}

// "WxH" in pixels.
void parse_size(const std::string& text, uint32_t& width, uint32_t& height) {
    char end = 0;
    if (text.find('-') != std::string::npos || std::sscanf(text.c_str(), "%ux%u%c", &width, &height, &end) != 2 || width == 0 ||
        height == 0)
        throw InputError("--size " + text + ": write WIDTHxHEIGHT in pixels, for example --size 1024x768");
}

// Sixteen hexadecimal digits, in small letters.
std::string parse_hash(const std::string& text) {
    std::string hash;
    for (const char c : text) hash += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    if (hash.size() != 16 || hash.find_first_not_of("0123456789abcdef") != std::string::npos)
        throw InputError("--expect-hash " + text + ": write the 16 hexadecimal digits of state_hash in metrics.json");
    return hash;
}

// Splits arguments into labels and file names: the parser passes everything after --label here.
void take_labels(const std::vector<std::string>& words, OrganOptions& organ) {
    std::vector<std::string> files;
    for (const std::string& word : words) {
        char* end = nullptr;
        const double value = std::strtod(word.c_str(), &end);
        const bool number = end == word.c_str() + word.size() && std::isfinite(value);
        if (number && files.empty())
            organ.labels.push_back(value);
        else
            files.push_back(word);
    }
    for (const std::string& file : files) {
        std::string& to = organ.volume.empty() ? organ.volume : organ.out;
        if (!to.empty()) throw InputError("organ: \"" + file + "\" is neither a label nor a file: expected one volume and one output");
        to = file;
    }
    if (organ.volume.empty() || organ.out.empty()) throw InputError("organ: expected a volume and an output file; see trocar organ --help");
}

// Options that several commands have.
void add_threads(CLI::App* command, uint32_t& threads) {
    command->add_option("--threads", threads, "Worker threads (default: all cores); results never depend on it")
        ->check(CLI::Range(0u, 1024u));
}
void add_sets(CLI::App* command, std::vector<Override>& overrides, const char* help) {
    const auto take = [&overrides](const std::vector<std::string>& texts) {
        for (const std::string& text : texts) overrides.push_back(parse_override(text));
    };
    command->add_option_function<std::vector<std::string>>("--set", take, help);
}

// Has a command end the program with the code that `work` returns. The options of a command live as long as its callback.
template <typename Options>
void run_with(CLI::App* command, int& code, const std::shared_ptr<Options>& options, int (*work)(const Options&)) {
    command->callback([&code, options, work] { code = work(*options); });
}

void add_root(CLI::App* command, FileRoots& roots) {
    command
        ->add_option(
            "--root", roots,
            "Folder whose files a mesh file may name (Inline, EXTERNPROTO, textures, materials) besides those below its own; names "
            "are looked for there, too; repeatable")
        ->allow_extra_args(false);
}

void add_run(CLI::App& app, int& code) {
    const auto o = std::make_shared<RunOptions>();
    CLI::App* run = app.add_subcommand("run", "Simulate a scene: pictures, film, figures, trace");
    run->add_option("scene", o->scene, "Scene file, or the name of a scene that `trocar scenes` lists")->required();
    CLI::Option* seconds =
        run->add_option("--seconds", o->seconds, "Simulated time, s (default: the scene's)")->check(CLI::Range(1e-3, 1e6));
    run->add_option("--out", o->out, "Folder for frames/, film, meshes/, metrics.json, trace.json, report.html, exercise.json");
    CLI::Option* live = run->add_flag("--live", o->live,
                                      "Run against the real clock: haptics on their own 1 kHz thread, drawing at low priority; with --out "
                                      "also writes live.recording");
    run->add_option("--device", o->devices,
                    "Live: BODY=DEVICE, moves that tool by a device instead of the scene's hand; repeatable; `trocar device list`. Prints "
                    "the samples of each at the end; exit code 1 if one gave no usable sample")
        ->needs(live);
    run->add_option("--view", o->view,
                    "Show the run in a browser on this machine, at real time: pause, step, speed, start again; lasts until it is ended "
                    "there, by Ctrl-C or by --seconds. Prints the address; --view=PORT chooses its port")
        ->expected(0, 1)
        ->default_str("0")
        ->check(CLI::Range(0, 65535));
    run->add_option("--keep-passes", o->keep_passes,
                    "Results (figures, pictures, exercise, live.recording) cover the first N contact passes; 0 = all (default: all; of a "
                    "view without --seconds 72000: what is kept must not grow for ever)")
        ->check(CLI::Range(int64_t{0}, int64_t{1'000'000'000}));
    run->add_option("--replay", o->replay,
                    "Repeat a live run in lockstep from its live.recording (of a run with --view: with what viewers did), with the same "
                    "scene and --set; exit code 1 "
                    "unless the result is bit-identical")
        ->excludes(live)
        ->excludes(seconds);
    run->add_option("--capture", o->capture,
                    "Write captures/*.cap into the folder for: 5-25 (contact passes), worst, over=33 (ms), nan, counter=NAME, "
                    "usr1, view (a button of the live view); several joined by commas. worst and over ignore the first eight passes, over "
                    "keeps the worst ten, nan the first "
                    "ten; read "
                    "them with `trocar capture` and `trocar replay`")
        ->check(CLI::Validator([](const std::string& text) { return std::string(text.empty() ? "it is empty" : ""); }, "TRIGGERS"));
    run->add_flag("--figures-only", o->figures_only, "Write only metrics.json and passes.csv");
    run->add_flag_callback(
        "--no-render", [o] { o->render = false; }, "Draw no pictures");
    run->add_flag_callback(
        "--no-exercise", [o] { o->exercise = false; }, "Write no exercise.json and exercise.csv of a scene with tools");
    run->add_option_function<std::string>(
        "--size", [o](const std::string& text) { parse_size(text, o->width, o->height); },
        "Of pictures and film: WIDTHxHEIGHT (default 640x480)");
    run->add_option_function<std::string>(
        "--expect-hash", [o](const std::string& text) { o->expected_hash = parse_hash(text); },
        "State hash, 16 hexadecimal digits, as metrics.json has it: exit code 1 when that of the final state differs");
    run->add_flag_callback(
        "--no-player", [o] { o->player = false; }, "Leave the 3D player out of report.html");
    add_sets(run, o->overrides,
             "Change a key of the scene (liver.tissue.wall=3e-3, contact.tolerance=1e-4; body.KEY: of every deformable body), or a "
             "parameter that `trocar scenes` lists: KEY=VALUE, repeatable");
    add_threads(run, o->threads);
    run->add_option("--export-every", o->export_every, "Write every body as OBJ at every n-th picture");
    run->add_option("--slow-render", o->slow_render_ms, "Live: draw each picture repeatedly for this many ms (a stress test)");
    run->add_flag("--json", o->json, "Print metrics.json to standard output");
    run_with(run, code, o, run_command);
    run->footer(
        "Example: trocar run probe_on_liver --seconds 2 --set liver.tissue.youngs_modulus=2e4 --out out/probe\n"
        "Ten thousand bodies: trocar run stress_rain --set count=10000 --set seed=7 --no-render\n"
        "A live run and its repetition: trocar run probe_on_liver --live --out out/live; "
        "trocar run probe_on_liver --replay out/live/live.recording\n"
        "Keys of [contact]: tolerance (m, 1e-4: depth along edges and in faces), direction = local | thesis (separation "
        "direction per point, or one per pair), share = mass | stiffness | half, push_speed (m/s), faces = true (constraints also at "
        "the deepest points inside faces), deep = none | last_free (a saturated pair, so deep that separation directions disagree, "
        "is moved back towards its last free position; one that starts saturated, along a translation proven to separate "
        "it), search = own | embree (traversal of Embree's trees; same results), hulls = true (free convex bodies touch by up to four "
        "contacts a pair: "
        "faster, less exact), cross_check, contours, regions");
}

void add_check(CLI::App& app, int& code) {
    const auto o = std::make_shared<CheckOptions>();
    CLI::App* check = app.add_subcommand("check", "Check meshes: closed, manifold, oriented, free of self-crossings");
    check
        ->add_option("files", o->files,
                     "Scenes (.toml), mesh files (.wrl .wrz .x3d .x3dv .iv .obj .stl .ply .off .vtk .gltf .glb .dae .fbx ...)")
        ->required();
    add_root(check, o->roots);
    check->add_flag("--json", o->json, "One JSON object per line");
    run_with(check, code, o, check_command);
    check->footer(
        "Example: trocar check liver.wrl kidney.stl --json\nA scene is built without running it; an error names its line. Exit code 1 if a "
        "mesh cannot be admitted as solid.");
}

void add_search(CLI::App* command, TreeSearch& search) {
    const auto take = [&search](const std::string& word) { search = word == "embree" ? TreeSearch::kEmbree : TreeSearch::kOwn; };
    command
        ->add_option_function<std::string>("--search", take,
                                           "Traversal of Embree's trees for closest points: own (default) or embree; same results")
        ->check(CLI::IsMember({"own", "embree"}));
}

void add_query(CLI::App& app, int& code) {
    const auto o = std::make_shared<QueryOptions>();
    CLI::App* query = app.add_subcommand("query", "Signed distance, closest point, triangle and feature of points");
    query->add_option("mesh", o->mesh, "Mesh file")->required();
    query->add_option("points", o->points, "CSV of x,y,z in file units; - reads standard input")->required();
    add_root(query, o->roots);
    query->add_option("--out", o->out, "CSV to write (default: standard output)");
    const auto threads = std::make_shared<uint32_t>(0);
    add_threads(query, *threads);
    add_search(query, o->search);
    query->add_flag("--cross-check", o->cross_check,
                    "Compare every sign of a solid with the winding number; prints the number of differences on standard error");
    query->add_flag("--json", o->json, "JSON instead of CSV");
    query->callback([&code, o, threads] {
        CommandPool pool(*threads);
        pool.run([&] { code = query_command(*o); });
    });
    query->footer(
        "Example: trocar query liver.obj points.csv --out distances.csv\nColumns: distance,cx,cy,cz,triangle,feature; "
        "distance < 0 inside.");
}

void add_collide(CLI::App& app, int& code) {
    const auto o = std::make_shared<CollideOptions>();
    CLI::App* collide = app.add_subcommand("collide", "Contact report of two meshes: overlap, depth, direction, witness, regions");
    collide->add_option("a", o->a, "First mesh")->required();
    collide->add_option("b", o->b, "Second mesh")->required();
    const auto move = [o](const std::string& text) { o->move_b = Vec3d(parse_numbers("--move-b", text, 3).data()); };
    const auto turn = [o](const std::string& text) {
        const std::vector<double> v = parse_numbers("--rotate-b", text, 4);
        const Vec3d axis(v.data());
        if (axis.norm() == 0) throw InputError("--rotate-b \"" + text + "\": the axis has no length");
        o->rotate_b = from_rotation_vector(axis.normalized() * (v[3] * std::numbers::pi / 180));
    };
    collide->add_option_function<std::string>("--move-b", move, "\"x y z\": translation of B, file units");
    collide->add_option_function<std::string>("--rotate-b", turn, "\"ax ay az degrees\": rotation of B about its origin, before the move");
    collide->add_option("--tolerance", o->tolerance, "Depth tolerance along edges, file units");
    collide->add_option("--cells", o->cells,
                        "Write the grid cells that both meshes share: .json (cell, object and primitive layers), .vtp or .png");
    add_root(collide, o->roots);
    add_search(collide, o->search);
    collide->add_flag("--separate", o->separate,
                      "Search for the shortest translation that separates B from A: proven lower and upper bounds");
    collide->add_option("--contours", o->contours, "Write the intersection curves of the surfaces to this .obj file, as lines");
    collide->add_flag("--cross-check", o->cross_check, "Compare every sign of a solid with the winding number; counts \"disagreements\"");
    collide->add_flag("--json", o->json, "JSON");
    run_with(collide, code, o, collide_command);
    collide->footer(
        "Example: trocar collide liver.stl probe.obj --move-b \"0 0 -5\" --json\n"
        "JSON: depth, surface_depth, direction, witness, vertices_a_in_b, vertices_b_in_a, edge_contacts, face_contacts, cells, contained, "
        "saturated (moving by the depth may not separate them), regions [vertices_a, vertices_b, contour, area, volume, depth, "
        "direction, witness]; with --separate separation {lower, upper, translation}, with --cross-check disagreements");
}

void add_convert(CLI::App& app, int& code) {
    const auto o = std::make_shared<ConvertOptions>();
    CLI::App* convert = app.add_subcommand("convert", "Read a mesh, clean it, write it in another format");
    convert->add_option("in", o->in, "Mesh file to read")->required();
    convert->add_option("out", o->out, "File to write: .obj .stl .ply .wrl .vtp by its extension")->required();
    add_root(convert, o->roots);
    convert->add_flag("--json", o->json, "JSON");
    CLI::Option* repair =
        convert->add_flag("--repair", o->repair, "Make it one closed solid and list the changes; exit code 1 and no file if that fails");
    convert->add_option("--weld", o->weld, "Join vertices nearer than this fraction of the diagonal")->check(CLI::Range(0.0, 0.01));
    convert->add_option("--hole-size", o->hole_size, "Fill holes up to this fraction of the diagonal (0.2)")
        ->check(CLI::Range(0.0, 1.0))
        ->needs(repair);
    run_with(convert, code, o, convert_command);
    convert->footer("Example: trocar convert liver.wrz liver.obj\n         trocar convert --repair scan.ply organ.stl");
}

void add_view(CLI::App& app, int& code) {
    const auto o = std::make_shared<ViewOptions>();
    CLI::App* view = app.add_subcommand(
        "view", "Draw a mesh or a shape: textured, lit, fitted to the picture; or make the page that plays a recorded run or capture");
    view->add_option(
            "meshes", o->sources,
            "Mesh files or shapes (shape:NAME:TRIANGLES:SEED), one tile each; or one CAPTURE.cap, live.recording or folder of a run")
        ->required();
    add_root(view, o->roots);
    view->add_option("--out", o->out, "PNG to write; of a recording the page (default: beside it)");
    view->add_option("--scene", o->scene, "Scene of a recording; default: the one that metrics.json beside it names");
    const auto take_size = [o](const std::string& text) { parse_size(text, o->width, o->height); };
    view->add_option_function<std::string>("--size", take_size, "WIDTHxHEIGHT in pixels (default 1024x768)");
    view->add_option("--azimuth", o->azimuth, "Degrees about the up axis; 0 = seen from +x, -90 from -y");
    view->add_option("--elevation", o->elevation, "Degrees above the horizon; 90 = from above");
    view->add_option("--up", o->up, "Axis that points up in the picture: x, y or z (default)")->check(CLI::IsMember({"x", "y", "z"}));
    view->add_flag("--wireframe", o->wireframe, "Edges drawn over the surface");
    view->add_flag("--sheet", o->sheet, "Front, side, top and oblique view in one picture");
    run_with(view, code, o, view_command);
    view->footer(
        "Example: trocar view shape:gallbladder:10000 --sheet --out gallbladder.png\n"
        "         trocar view out/grasp_by_hand\n"
        "         trocar view out/k/captures/worst.cap --out worst.html");
}

void add_organ(CLI::App& app, int& code) {
    const auto o = std::make_shared<OrganOptions>();
    CLI::App* organ = app.add_subcommand("organ", "Make closed surfaces and tetrahedra from a segmented image");
    organ->add_option("volume", o->volume, "NRRD, MetaImage, NIfTI or DICOM file, or a folder of DICOM slices");
    organ->add_option("out", o->out, "Surface to write: .obj .stl .ply .wrl; with several labels or segments: NAME_<label>.EXTENSION");
    const auto labels = std::make_shared<std::vector<std::string>>();
    organ->add_option("--label", *labels, "Label values, one surface each; default: list the labels in the file")->delimiter(',');
    organ
        ->add_option("--segment", o->segments,
                     "Instead of labels: names of segments in a .seg.nrrd, one surface each, repeatable; default: list them")
        ->allow_extra_args(false);
    organ->add_option("--threshold", o->threshold, "Instead of labels: voxels of at least this value");
    organ->add_option("--smooth", o->smooth, "Rounds of volume-preserving smoothing (default 10)");
    organ->add_option("--blur", o->blur, "Blur of the voxels before contouring, in voxels (default 1; 0 keeps steps)");
    organ->add_option("--triangles", o->triangles, "Simplify to about this many triangles (default: as contoured)");
    organ->add_flag("--even", o->even, "Even triangles for simulation, instead of the fewest that keep the shape");
    organ->add_option("--tets", o->tets, "Also fill with tetrahedra on a lattice of this spacing, mm: writes .vtu and .msh");
    organ->add_flag("--all-pieces", o->all_pieces, "Keep every piece, not only the largest");
    organ->add_option("--series", o->series, "DICOM series UID, if the folder contains several");
    organ->add_option("--frame", o->frame, "Of NIfTI: sform or qform (default: the sform if its code is above 0, else the qform)")
        ->check(CLI::IsMember({"sform", "qform"}));
    organ->add_flag("--json", o->json, "One JSON object per organ");
    organ->callback([&code, o, labels] {
        take_labels(*labels, *o);
        code = organ_command(*o);
    });
    organ->footer(
        "Example: trocar organ abdomen_labels.nrrd --label 5 2 organ.obj --triangles 10000 --tets 6\n"
        "writes organ_5.obj, organ_2.obj and their .vtu (ParaView) and .msh (Gmsh 2.2) meshes.\n"
        "Coordinates are the file's patient coordinates: millimetres, x left, y back, z head (LPS); use scale = 0.001 in a scene.\n"
        "Steps: choose voxels; keep the largest piece (voxels joined by faces); blur and contour at the level that encloses\n"
        "the volume of the voxels; smooth; simplify; judge. Volume and open edges are printed after each.\n"
        "Exit code 1 when a surface cannot be admitted as solid.");
}

void add_scene(CLI::App& app, int& code) {
    const auto o = std::make_shared<SceneOptions>();
    CLI::App* scene = app.add_subcommand("scene", "Make a scene of a segmented image or of a file with several shapes");
    scene->add_option("source", o->source, "NRRD, MetaImage, NIfTI or DICOM, or a mesh file such as .wrl or .x3d")->required();
    scene->add_option("out", o->out, "Scene to write, NAME.toml; its meshes go into the folder NAME beside it")->required();
    scene->add_option("--labels", o->labels,
                      "CSV with the columns label (number, name of a segment, or DEF name) and name, and optionally tissue (a preset; "
                      "empty: static), motion, color (\"0.8 0.5 0.4\") and triangles; only these become bodies");
    scene->add_option("--triangles", o->triangles, "Triangles of a surface made from an image (default 4000)")
        ->check(CLI::Range(4u, 20'000'000u));
    scene
        ->add_option("--touch", o->touch,
                     "Link bodies whose surfaces are nearer than this, m (default: a voxel of an image, else none; 0 = none)")
        ->check(CLI::Range(0.0, 1.0));
    scene->add_option("--scale", o->scale, "Metres per unit of a mesh file (default: guessed from its size)")
        ->check(CLI::Range(1e-12, 1e12));
    scene->add_option("--series", o->series, "DICOM series UID, if the folder contains several");
    scene->add_option("--frame", o->frame, "Of NIfTI: sform or qform (default: the sform if its code is above 0, else the qform)")
        ->check(CLI::IsMember({"sform", "qform"}));
    add_root(scene, o->roots);
    scene->add_flag("--json", o->json, "Bodies with their centroids, and links, as JSON");
    run_with(scene, code, o, scene_command);
    scene->footer(
        "Example: trocar scene abdomen.nii.gz liver.toml --labels table.csv && trocar run liver.toml --out out/liver\n"
        "with table.csv:  label,name,tissue\n                 5,liver,liver\n                 2,kidney,kidney\n                 90,spine,\n"
        "Organs stand where the image has them: patient axes are turned so that the patient lies on the back, z up. Of a\n"
        "scene graph (VRML, X3D) each shape, or all shapes below one DEF name, become a body; y of the file is up.\n"
        "The scene is built once as a check. `trocar organ VOLUME x.obj` lists the labels of an image.");
}

void add_soak(CLI::App& app, int& code) {
    const auto o = std::make_shared<SoakOptions>();
    CLI::App* soak = app.add_subcommand("soak", "Run scenes repeatedly for minutes and test for drift");
    soak->add_option("scene", o->scenes, "Scene files, or names of scenes that `trocar scenes` lists")->required();
    soak->add_option("--minutes", o->minutes, "Duration, minutes, of all scenes together (default 10)")->check(CLI::PositiveNumber);
    soak->add_option("--seconds", o->seconds, "Simulated time of an episode, s (default: the scene's)")->check(CLI::Range(1e-3, 1e6));
    soak->add_option(
            "--faults", o->faults,
            "Faults injected into every third episode, in turn: nan, blast (absurd velocities), pause (200 ms between two passes, "
            "which must change nothing), dropout (no new place of the hands for 12 passes), jump (their clocks go forward by 0.25 s)")
        ->delimiter(',')
        ->check(CLI::IsMember({"nan", "blast", "pause", "dropout", "jump"}));
    soak->add_option(
            "--hands", o->hands,
            "Seed: every two episodes hands leave their paths by other smooth random ways, up to 5 mm; both episodes must end in the "
            "same state")
        ->check(CLI::Range(int64_t{0}, int64_t{1} << 40));
    soak->add_option(
        "--out", o->out,
        "Folder for soak.json, soak.csv, soak.html, captures/; of several scenes a folder each, night.html with all beside the night "
        "before, and nights.csv with a line per scene and night");
    add_sets(soak, o->overrides, "Change a key of the scene: KEY=VALUE, repeatable");
    add_threads(soak, o->threads);
    soak->add_flag("--json", o->json, "Print soak.json instead of a line per minute");
    run_with(soak, code, o, soak_command);
    soak->footer(
        "Example: trocar soak probe_on_liver --minutes 30 --faults nan,pause --out out/soak\n"
        "A night: trocar soak palpate jaw_grasp wrl_pair --minutes 480 --hands 7 --out out/nights\n"
        "Every episode starts from the same state and must end in the same state. Rules: the lower bound of the drift (median\n"
        "slope, 95 % interval) of resident memory stays below 256 KiB a minute and of the heap below 64 KiB a minute, or below\n"
        "0.5 MiB in the whole run (so runs of less than two minutes detect only faster leaks); no file stays open; no particle is lost\n"
        "except by a fault, and then restored after one pass; the energy balance closes to 2 % of the largest energy; passes do not\n"
        "become 50 % slower. Exit code 1 with the reason when a rule is broken.");
}

void add_speed(CLI::App& app, int& code) {
    const auto o = std::make_shared<SpeedOptions>();
    CLI::App* speed = app.add_subcommand("speed", "Passes a second and state hashes of scenes, over numbers of threads, in one table");
    speed->add_option("scene", o->scenes, "Scene files, or names of scenes that `trocar scenes` lists")->required();
    speed->add_option("--threads", o->threads, "Numbers of threads, joined by commas (default: 1, 2, 4 ... up to all cores)")
        ->delimiter(',')
        ->check(CLI::Range(1, 1024));
    speed->add_option("--seconds", o->seconds, "Simulated time of a run, s (default 1)")->check(CLI::Range(1e-3, 1e6));
    speed->add_option("--repeat", o->repeat, "Runs of each, of which the fastest counts (default 3)")->check(CLI::Range(1, 1000));
    add_sets(speed, o->overrides, "Change a key of every scene: KEY=VALUE, repeatable");
    speed->add_flag("--json", o->json, "JSON");
    run_with(speed, code, o, speed_command);
    speed->footer(
        "Example: trocar speed probe_on_liver palpate rigid_stack --threads 1,2\n"
        "Only passes are timed: no pictures, files or figures. Exit code 1 when a scene does not end in the same state with every number "
        "of\n"
        "threads and in every run.");
}

void add_sweep(CLI::App& app, int& code) {
    const auto o = std::make_shared<SweepOptions>();
    CLI::App* sweep = app.add_subcommand(
        "sweep", "Run a scene with every combination of values, locally or on a cluster, and merge the results into one table");
    sweep->add_option("file", o->file, "Sweep file")->required();
    sweep
        ->add_option("--engine", o->engine,
                     "local (default), parallel (GNU parallel), slurm (an array job), merge (only merge the existing results)")
        ->check(CLI::IsMember({"local", "parallel", "slurm", "merge"}));
    sweep->add_option("--out", o->out, "Folder (default out/sweep_NAME): runs/ with a folder per run, runs.txt, sweep.csv, sweep.json");
    sweep->add_option("--jobs", o->jobs, "Concurrent runs (default: cores / threads of a run; slurm: as many as the cluster grants)")
        ->check(CLI::Range(1, 4096));
    sweep->add_flag("--dry-run", o->dry_run, "Print the commands and run none");
    sweep->add_flag("--json", o->json, "Print sweep.json");
    run_with(sweep, code, o, sweep_command);
    sweep->footer(
        "A sweep file:\n"
        "    scene = \"kidney_on_liver\"\n    seconds = 0.5\n    threads = 1\n"
        "    repeat = 3                                             # runs of every combination, for the spread of times\n"
        "    columns = [\"contact.total_ms_mean\", \"contact.max_depth_m\"]   # paths into metrics.json\n"
        "    [set]\n    \"liver.triangles\" = 4000\n"
        "    [vary]\n    \"contact.cell_edges\" = [2.0, 2.5, 3.0]\n    \"mesh.integrator\" = [\"leapfrog\", \"implicit\"]\n"
        "Example: trocar sweep cells.toml --engine parallel --out out/cells\n"
        "Every run is a separate command (runs.txt). Finished runs are not repeated: start the same sweep again after an interruption or\n"
        "after adding values. Exit code 1 when a run failed; the table shows which and why.");
}

void add_fit(CLI::App& app, int& code) {
    const auto o = std::make_shared<FitOptions>();
    CLI::App* fit = app.add_subcommand("fit", "Find tissue parameters with which a scene gives a measured curve of force");
    fit->add_option("scene", o->scene,
                    "Scene file, or the name of a scene that `trocar scenes` lists: the experiment, with a tool on a path")
        ->required();
    fit->add_option("--curve", o->curve,
                    "CSV with force_n (N, of the tissue on the tool) and time_s, or depth_m of the tip below the undeformed surface")
        ->required();
    fit->add_option("--parameter", o->parameters, "KEY=LOW..HIGH, bounds of a key as of --set; repeatable")
        ->required()
        ->allow_extra_args(false);
    fit->add_option("--tool", o->tool, "Body that the tool holds (default: the scene's first tool)");
    fit->add_option("--seconds", o->seconds, "Simulated time of a run, s (default: to the end of the curve; by depth, the scene's)")
        ->check(CLI::Range(1e-3, 1e6));
    add_sets(fit, o->overrides, "KEY=VALUE, changes a key of the scene in every run; repeatable");
    fit->add_option("--out", o->out,
                    "Folder for fit.json, curve.csv (measured and fitted) and trials.jsonl, with which an interrupted fit goes on");
    add_threads(fit, o->threads);
    fit->add_flag("--json", o->json, "JSON on standard output");
    run_with(fit, code, o, fit_command);
    fit->footer(
        "Example: trocar fit palpate --curve measured.csv --parameter liver.tissue.youngs_modulus=1e3..1e5\n"
        "Least squares by Levenberg and Marquardt in the logarithms of the parameters, starting in the middle of their ranges. The\n"
        "95 % intervals hold for independent errors of equal size. Exit code 1 if the search does not converge or ends at a bound.");
}

void add_tune(CLI::App& app, int& code) {
    const auto o = std::make_shared<TuneOptions>();
    CLI::App* tune = app.add_subcommand("tune", "Find contact rate, iterations, steps and integrator of a scene for a budget and an error");
    tune->add_option("scene", o->scene, "Scene file, or the name of a scene that `trocar scenes` lists")->required();
    tune->add_option("--budget-ms", o->budget_ms, "Processor time of a displayed frame (1/30 s) on one core, ms (default 33)")
        ->check(CLI::PositiveNumber);
    tune->add_option("--error-mm", o->error_mm,
                     "Root mean square over vertices and frames of the worst body against a run with 240 Hz, 16 iterations and steps of "
                     "0.25 ms, mm (default 0.1)")
        ->check(CLI::PositiveNumber);
    tune->add_option("--seconds", o->seconds, "Simulated time of a run, s (default: the scene's, at most 1)")->check(CLI::Range(1e-2, 1e6));
    tune->add_option("--out", o->out, "Scene to write, with the chosen keys and their figures (without the comments of the original)");
    tune->add_flag("--exhaustive", o->exhaustive, "Try every combination instead, some thousand runs");
    tune->add_option("--trials", o->trials, "File that keeps every run: with it an interrupted search goes on");
    add_sets(tune, o->overrides, "KEY=VALUE, changes a key of the scene in every run; repeatable");
    tune->add_flag("--json", o->json, "JSON on standard output");
    run_with(tune, code, o, tune_command);
    tune->footer(
        "Example: trocar tune kidney_on_liver --budget-ms 10 --error-mm 0.2 --out fast.toml\n"
        "Changes one of contact.rate, contact.iterations, substep, body.integrator, contact.tolerance and contact.cell_edges at a\n"
        "time, as long as the run gets cheaper within the error. Prints the choices that no other beats. Exit code 1 if none keeps\n"
        "both limits.");
}

void add_replay(CLI::App& app, int& code) {
    const auto o = std::make_shared<ReplayOptions>();
    CLI::App* replay = app.add_subcommand("replay", "Replay a capture and compare, or replay one of its passes many times");
    replay->add_option("capture", o->file, "A .cap file of `trocar run --capture`")->required();
    CLI::Option* compare = replay->add_flag_callback(
        "--check", [] {}, "Compare only (the default)");
    CLI::Option* frame = replay->add_option("--frame", o->frame, "Contact pass to repeat from its own start")->excludes(compare);
    replay->add_option("--repeat", o->repeat, "Number of repetitions (default 100)")->needs(frame)->check(CLI::Range(1, 1000000));
    replay
        ->add_flag_callback(
            "--profile", [] {}, "Median time of every stage of the pass (the default with --frame)")
        ->needs(frame);
    replay->add_option("--trace", o->trace, "File to write a trace of the repetitions to")->needs(frame);
    add_threads(replay, o->threads);
    CLI::Option* json = replay->add_flag("--json", o->json, "JSON");
    const auto take = [o](const std::vector<std::string>& texts) {
        for (const std::string& text : texts) o->changes.push_back(parse_override(text));
    };
    CLI::Option* set =
        replay
            ->add_option_function<std::vector<std::string>>(
                "--set", take,
                "What if: replay with KEY=VALUE changed and show what comes of it beside what was recorded; repeatable: gravity, "
                "substep, sleep_speed, sleep_after, keys of [contact] but rate, BODY.tissue.friction, .damping, .restitution")
            ->excludes(frame)
            ->excludes(json);
    replay->add_option("--csv", o->csv, "With --set: file with one line per pass, recorded and changed")->needs(set);
    run_with(replay, code, o, replay_command);
    replay->footer(
        "Example: trocar replay out/captures/worst.cap\n"
        "         trocar replay out/captures/worst.cap --frame 61 --repeat 200\n"
        "         trocar replay out/captures/worst.cap --set contact.iterations=8 --set liver.tissue.friction=0.3\n"
        "Exit code 1 unless the result is bit-identical; names the first different pass, stage, array and row (with --frame: only\n"
        "whether the pass ends as captured). Also 1 if the capture is incomplete: its readable part is compared.");
}

void add_capture(CLI::App& app, int& code) {
    const auto o = std::make_shared<CaptureExportOptions>();
    CLI::App* capture = app.add_subcommand("capture", "Show a capture, compare two, or export for other tools");
    capture->require_subcommand(1);
    CLI::App* info = capture->add_subcommand("info", "Scene, reason, passes, slowest pass and its dearest pair");
    const auto files = std::make_shared<std::vector<std::string>>();
    const auto json = std::make_shared<bool>(false);
    info->add_option("files", *files, "Captures")->required();
    info->add_flag("--json", *json, "One JSON object per line");
    const auto picture = std::make_shared<std::filesystem::path>();
    info->add_option("--picture", *picture, "PNG to write: the picture in the capture, of its last pass");
    info->callback([&code, files, json, picture] { code = capture_info_command(*files, *json, *picture); });
    CLI::App* diff =
        capture->add_subcommand("diff", "First difference of two captures: array, row, body, both values; exit code 1 when there is one");
    diff->add_option("files", *files, "Two captures")->required()->expected(2);
    diff->callback([&code, files] { code = capture_diff_command((*files)[0], (*files)[1]); });
    CLI::App* exported = capture->add_subcommand("export", "Surfaces for ParaView, pictures, a trace, a table");
    exported->add_option("file", o->file, "Capture")->required();
    exported->add_option("--vtp", o->vtp,
                         "Folder for bodies_PASS.vtp and bodies.pvd, which ParaView opens: body (named in bodies.csv), depth, contact "
                         "(found at the start of the pass; everything else is from its end), velocity, strain, stress");
    exported->add_flag("--per-body", o->per_body, "With --vtp: separate BODY_PASS.vtp and BODY.pvd for each body");
    exported->add_option("--png", o->png, "Folder for frames/*.png");
    exported->add_option("--trace", o->trace, "Chrome trace (JSON) of the stages of every pass: Perfetto, speedscope");
    exported->add_option("--csv", o->csv, "CSV with one line per pass");
    exported->add_option("--html", o->html,
                         "Page with the 3D player of every pass: contacts, their constraints and impulses, islands, cells of the grid, "
                         "stage times and dearest pairs as recorded");
    add_threads(exported, o->threads);
    run_with(exported, code, o, capture_export_command);
    capture->footer(
        "Example: trocar run kidney_on_liver --out out/k --capture worst,5-25\n"
        "         trocar capture info out/k/captures/*.cap\n"
        "         trocar capture export out/k/captures/worst.cap --vtp out/vtp --csv out/passes.csv");
}

void add_score_settings(CLI::App* command, ScoreSettings& settings) {
    command->add_option("--idle-speed", settings.idle_speed, "m/s: a slower tool is idle (default 0.01) ...")->check(CLI::PositiveNumber);
    command->add_option("--idle-time", settings.idle_time, "s: ... if it lasts (default 0.5)")->check(CLI::NonNegativeNumber);
    command->add_option("--damage", settings.damage, "ORGAN=N: force above which that organ is damaged; repeatable")
        ->allow_extra_args(false);
}

std::string metric_list() {
    std::string text = "Metrics, smoothed to 10 Hz where they are of motion (definitions and sources: docs/station.md):\n";
    for (const MetricText& m : tool_metrics())
        text += "  " + std::string(m.key) + (*m.unit ? std::string(", ") + m.unit : "") + ": " + m.text + "\n";
    text += "Of each organ that a tool touched or held:\n";
    for (const MetricText& m : organ_metrics())
        text += "  " + std::string(m.key) + (*m.unit ? std::string(", ") + m.unit : "") + ": " + m.text + "\n";
    return text;
}

void add_score(CLI::App& app, int& code) {
    const auto o = std::make_shared<ScoreCommandOptions>();
    CLI::App* score = app.add_subcommand("score", "Metrics of motion and force of runs with tools, from any recording");
    score->add_option("runs", o->runs, "Folders of runs; or exercise.csv, tools.csv (older runs), live.recording (the device's own space)")
        ->required();
    add_score_settings(score, o->settings);
    score->add_flag("--json", o->json, "JSON; of several runs, one line each");
    run_with(score, code, o, score_command);
    score->footer(metric_list() + "Example: trocar run grasp_by_hand --out out/grasp; trocar score out/grasp --damage gallbladder=3");
}

void add_compare(CLI::App& app, int& code) {
    const auto o = std::make_shared<CompareOptions>();
    CLI::App* compare =
        app.add_subcommand("compare", "Runs beside each other: metrics, curves on one axis, cohort statistics, times of stages");
    compare->add_option("runs", o->runs, "Folders of runs or their recordings, as for `trocar score`");
    compare->add_option("--cohort", o->cohort, "CSV with the columns run (path, relative to it) and any of group, subject, trial");
    compare->add_option("--out", o->out, "HTML page to write; it needs no other file");
    add_score_settings(compare, o->settings);
    compare->add_flag("--json", o->json, "Print JSON");
    run_with(compare, code, o, compare_command);
    compare->footer(
        "Example: trocar compare out/before out/after --out out/compare.html\n"
        "         trocar compare --cohort study.csv --out out/study.html\n"
        "Two folders: also their times, stage by stage, with a test (Wilcoxon signed-rank over 20 blocks of passes, Holm). Two groups: "
        "AUC\n"
        "with a bootstrap interval. Subjects with the same trials: ICC(2,1). Trials: learning curves. Runs are aligned by the events that\n"
        "begin phases, then by dynamic time warping on tip position and force. docs/station.md");
}

void add_exercise(CLI::App& app, int& code) {
    const auto o = std::make_shared<ExerciseOptions>();
    CLI::App* exercise = app.add_subcommand("exercise", "What a run recorded of its tools: events and phases, or an export");
    exercise->add_option("run", o->run, "Folder of a run or its recording, as for `trocar score`")->required();
    exercise->add_option("--mcap", o->mcap, "MCAP file to write: a JSON channel per tool and one of events");
    exercise->add_option("--csv", o->csv, "exercise.csv to write, for example of an older run");
    run_with(exercise, code, o, exercise_command);
    exercise->footer("Example: trocar exercise out/grasp --mcap out/grasp.mcap");
}

void add_device(CLI::App& app, int& code) {
    const auto o = std::make_shared<DeviceOptions>();
    CLI::App* device = app.add_subcommand("device", "List, test and record haptic devices");
    device->require_subcommand(1);
    CLI::App* list = device->add_subcommand("list", "Kinds of device connections, and how to name a device");
    list->add_flag("--json", o->json, "JSON");
    CLI::App* test =
        device->add_subcommand("test", "Listen to a device: rate, intervals, range, dropped samples; exit code 1 if none arrived");
    CLI::App* record =
        device->add_subcommand("record", "Record the motion of a hand as CSV, for `trace = \"FILE\"` of a [[tool]] and trace:FILE");
    for (CLI::App* each : {test, record}) {
        each->add_option("device", o->device, "KIND or KIND:WHERE, see `trocar device list`")->required();
        each->add_option("--seconds", o->seconds, "Duration, s (default 5)")->check(CLI::Range(0.05, 86400.0));
    }
    test->add_option("--spring", o->spring, "Stiffness of a spring that pulls the hand to its first position, N/m (default: no force)")
        ->check(CLI::Range(0.0, 2000.0));
    test->add_option("--max-force", o->max_force, "Largest force of that spring, N (default 2)")->check(CLI::Range(0.0, 50.0));
    test->add_flag("--json", o->json, "JSON");
    record->add_option("--out", o->out, "CSV to write: time,x,y,z,qw,qx,qy,qz,vx,vy,vz,buttons, and grip if the device has one")
        ->required();
    list->callback([&code, o] { code = device_list_command(o->json); });
    run_with(test, code, o, device_test_command);
    run_with(record, code, o, device_record_command);
    device->footer(
        "Example: trocar device list\n"
        "         trocar device test udp:7731 --seconds 10          # a device that sends packets to this machine\n"
        "         trocar device test plugin:./mine.so --spring 100  # and feels a soft spring\n"
        "         trocar device record haply --seconds 30 --out hand.csv\n"
        "         trocar run probe_on_liver --live --device probe=udp:7731\n"
        "Packets, messages and the plug-in's header: docs/devices.md. Network devices are on this machine unless an\n"
        "address is given. Forces are sent only with --spring, or in a live run.");
}

void add_scenes(CLI::App& app, int& code) {
    CLI::App* scenes = app.add_subcommand("scenes", "List the built-in scenes, shapes and tissues");
    const auto json = std::make_shared<bool>(false);
    scenes->add_flag("--json", *json, "JSON");
    scenes->callback([&code, json] { code = scenes_command(*json); });
    scenes->footer("Example: trocar scenes");
}

void describe(CLI::App& app, int& code) {
    app.name("trocar");
    app.description("Trocar: virtual surgery, headless. Contact, penetration depth, deformation, 1 kHz haptics.");
    app.set_version_flag("--version", [] { return version_text(); });
    app.require_subcommand(1);
    app.set_help_all_flag("--help-all", "Help of every command");
    for (const auto add :
         {add_run,   add_check, add_query, add_collide, add_convert, add_view,  add_organ,   add_scene,    add_soak,   add_speed,
          add_sweep, add_fit,   add_tune,  add_replay,  add_capture, add_score, add_compare, add_exercise, add_device, add_scenes})
        add(app, code);
}

// Names of the commands, or of the options of one.
std::vector<std::string> command_names(const CLI::App& app) {
    std::vector<std::string> names;
    for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; })) names.push_back(command->get_name());
    return names;
}
std::vector<std::string> option_names(const CLI::App& command) {
    std::vector<std::string> names;
    for (const CLI::Option* option : command.get_options())
        for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
    return names;
}
std::string suggestion(const std::string& word, const std::vector<std::string>& known) {
    const std::string guess = similar_word(word, known);
    return guess.empty() ? "" : "; did you mean " + guess + "?";
}

// The command that was asked for, below others: `capture info`.
const CLI::App& asked_command(const CLI::App& app) {
    const std::vector<const CLI::App*> inner = app.get_subcommands([](const CLI::App* command) { return command->parsed(); });
    return inner.empty() ? app : asked_command(*inner.front());
}

// What is wrong with the command line, in our words where the parser's are long.
std::string complaint(const CLI::App& app, const CLI::ParseError& error) {
    const CLI::App& command = asked_command(app);
    if (dynamic_cast<const CLI::ExtrasError*>(&error) || dynamic_cast<const CLI::RequiredError*>(&error)) {
        const std::vector<std::string> rest = app.remaining(true), commands = command_names(command);
        for (const std::string& word : rest)
            if (word.starts_with("-")) {
                const std::string name = word.substr(0, word.find('='));
                return "no option " + name + suggestion(name, option_names(command));
            }
        if (!rest.empty() && !commands.empty()) return "no command \"" + rest.front() + "\"" + suggestion(rest.front(), commands);
        if (!rest.empty()) return "\"" + rest.front() + "\" was not expected";
        if (!commands.empty()) return "a command is needed";
    }
    const std::string text = error.what();
    constexpr std::string_view kRange = ": Value ";  // the parser's words: "--seconds: Value 0 not in range 0.001 to 1e+06"
    const size_t at = text.find(kRange);
    if (at == std::string::npos) return text;
    const std::string option = text.substr(0, at);
    std::string value, no, in, range, to;
    double least = 0, most = 0;
    std::istringstream words(text.substr(at + kRange.size()));
    if (!(words >> value >> no >> in >> range >> least >> to >> most) || range != "range") return text;
    char* end = nullptr;
    std::strtod(value.c_str(), &end);
    if (*end != 0) return format("%s: \"%s\" is not a number", option.c_str(), value.c_str());
    if (most > 1e300) return format("%s: %s must be more than %g", option.c_str(), value.c_str(), least);
    return format("%s: %s is not from %g to %g", option.c_str(), value.c_str(), least, most);
}

// `trocar help run` is `trocar run --help`, and `trocar help` is `trocar --help`.
std::vector<std::string> arguments_of(int argc, char** argv) {
    std::vector<std::string> words(argv + 1, argv + argc);
    if (words.empty()) return {"--help"};
    if (words[0] == "help") {
        words.erase(words.begin());
        words.push_back("--help");
    }
    return words;
}

void say_no_memory() { std::fprintf(stderr, "trocar: not enough memory for this: take fewer or coarser bodies, or raise the limit\n"); }

// Memory can also run out where nothing can catch it: in a worker thread that has no room left to pass the exception on.
[[noreturn]] void end_uncaught() {
    try {
        if (const std::exception_ptr e = std::current_exception()) std::rethrow_exception(e);
    } catch (const std::bad_alloc&) {
        say_no_memory();
        std::_Exit(trocar::kFault);
    } catch (...) {
    }
    std::abort();
}

}  // namespace

int main(int argc, char** argv) {
    std::set_terminate(end_uncaught);
    trocar::set_float_mode();
    trocar::keep_freed_memory();
    try {
        CLI::App app;
        int code = trocar::kFault;
        describe(app, code);
        std::vector<std::string> words = arguments_of(argc, argv);
        const std::vector<std::string> commands = command_names(app);
        if (words[0][0] != '-' && std::ranges::find(commands, words[0]) == commands.end())
            throw trocar::InputError("there is no command \"" + words[0] + "\"" + suggestion(words[0], commands) +
                                     "; trocar --help lists them");
        std::ranges::reverse(words);  // the parser takes them from the end
        try {
            app.parse(std::move(words));
        } catch (const CLI::Success& e) {
            app.exit(e);  // --help, --version
            return trocar::kDone;
        } catch (const CLI::ParseError& e) {
            std::string name = "trocar";
            if (const CLI::App& command = asked_command(app); &command != &app) name += " " + command.get_name();
            throw trocar::InputError(complaint(app, e) + "; " + name + " --help lists its options");
        }
        return code;
    } catch (const trocar::InputError& e) {
        std::fprintf(stderr, "trocar: %s\n", trocar::one_line(e.what()).c_str());
        return trocar::kUsage;
    } catch (const std::bad_alloc&) {
        say_no_memory();
        return trocar::kFault;
    } catch (const std::exception& e) {
        std::fprintf(stderr, "trocar: internal fault: %s\n", trocar::one_line(e.what()).c_str());
        return trocar::kFault;
    }
}
