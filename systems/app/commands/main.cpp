#include <CLI/CLI.hpp>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <new>
#include <numbers>

#include "engine/base/error.hpp"
#include "engine/files/text_file.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "systems/app/console/command_pool.hpp"
#include "systems/app/console/commands.hpp"

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
std::array<uint32_t, 2> parse_size(const std::string& text) {
    std::array<uint32_t, 2> size{};
    char end = 0;
    if (text.find('-') != std::string::npos || std::sscanf(text.c_str(), "%ux%u%c", &size[0], &size[1], &end) != 2 || size[0] == 0 ||
        size[1] == 0)
        throw InputError("--size " + text + ": write WIDTHxHEIGHT in pixels, for example --size 1024x768");
    return size;
}

struct Arguments {
    RunOptions run;
    CheckOptions check;
    QueryOptions query;
    CollideOptions collide;
    ConvertOptions convert;
    ViewOptions view;
    OrganOptions organ;
    ReplayOptions replay;
    SoakOptions soak;
    SweepOptions sweep;
    CaptureExportOptions capture;
    DeviceOptions device;
    std::vector<std::string> capture_files;
    std::vector<std::string> sets, labels;
    std::string move_b, rotate_b, size;
    bool no_render = false, scenes_json = false, capture_json = false, default_said = false;
    uint32_t threads = 0;
};

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

constexpr uint32_t kMostThreads = 1024;

void add_root(CLI::App* command, FileRoots& roots) {
    command
        ->add_option(
            "--root", roots,
            "Folder whose files a mesh file may name (Inline, EXTERNPROTO, textures, materials) besides those below its own; names "
            "are looked for there, too; repeatable")
        ->allow_extra_args(false);
}

void add_run(CLI::App& app, Arguments& a) {
    CLI::App* run = app.add_subcommand("run", "Simulate a scene: pictures, film, figures, trace");
    run->add_option("scene", a.run.scene, "Scene file, or the name of a scene that `trocar scenes` lists")->required();
    CLI::Option* seconds =
        run->add_option("--seconds", a.run.seconds, "Simulated time, s (default: the scene's)")->check(CLI::Range(1e-3, 1e6));
    run->add_option("--out", a.run.out, "Folder for frames/, film, meshes/, metrics.json, trace.json, report.html");
    CLI::Option* live = run->add_flag("--live", a.run.live,
                                      "Run against the real clock: haptics on their own 1 kHz thread, drawing at low priority; with --out "
                                      "also writes live.recording");
    run->add_option("--device", a.run.devices,
                    "Live: BODY=DEVICE, moves that tool by a device instead of the scene's hand; repeatable; `trocar device list`. Prints "
                    "the samples of each at the end; exit code 1 if one gave no usable sample")
        ->needs(live);
    run->add_option("--replay", a.run.replay,
                    "Repeat a live run in lockstep from its live.recording, with the same scene and --set; exit code 1 "
                    "unless the result is bit-identical")
        ->excludes(live)
        ->excludes(seconds);
    run->add_option("--capture", a.run.capture,
                    "Write captures/*.cap into the folder for: 5-25 (contact passes), worst, over=33 (ms), nan, counter=NAME, "
                    "usr1; several joined by commas. worst and over ignore the first eight passes, over and nan write at most ten; read "
                    "them with `trocar capture` and `trocar replay`")
        ->check(CLI::Validator([](const std::string& text) { return std::string(text.empty() ? "it is empty" : ""); }, "TRIGGERS"));
    run->add_flag("--figures-only", a.run.figures_only, "Write only metrics.json and passes.csv");
    run->add_flag("--no-render", a.no_render, "Draw no pictures");
    run->add_option("--set", a.sets,
                    "Change a key of the scene (liver.tissue.wall=3e-3, contact.tolerance=1e-4; body.KEY: of every deformable body), or a "
                    "parameter that `trocar scenes` lists: KEY=VALUE, repeatable");
    run->add_option("--threads", a.threads, "Worker threads (default: all cores); results never depend on it")
        ->check(CLI::Range(0u, kMostThreads));
    run->add_option("--export-every", a.run.export_every, "Write every body as OBJ at every n-th picture");
    run->add_option("--slow-render", a.run.slow_render_ms, "Live: draw each picture repeatedly for this many ms (a stress test)");
    run->add_flag("--json", a.run.json, "Print metrics.json to standard output");
    run->footer(
        "Example: trocar run probe_on_liver --seconds 2 --set liver.tissue.youngs_modulus=2e4 --out out/probe\n"
        "Ten thousand bodies: trocar run stress_rain --set count=10000 --set seed=7 --no-render\n"
        "A live run and its repetition: trocar run probe_on_liver --live --out out/live; "
        "trocar run probe_on_liver --replay out/live/live.recording\n"
        "Keys of [contact]: tolerance (m, 1e-4: depth along edges and in faces), direction = local | thesis (separation "
        "direction per point, or one per pair), share = mass | stiffness | half, push_speed (m/s), faces = true (constraints also at "
        "the deepest points inside faces), deep = none | last_free (a saturated pair, so deep that separation directions disagree, "
        "is moved back towards its last free position; one that starts saturated, along a translation proven to separate "
        "it), search = own | embree (traversal of Embree's trees; same results), cross_check, contours, regions");
}

void add_check(CLI::App& app, Arguments& a) {
    CLI::App* check = app.add_subcommand("check", "Check meshes: closed, manifold, oriented, free of self-crossings");
    check
        ->add_option("files", a.check.files,
                     "Scenes (.toml), mesh files (.wrl .wrz .x3d .x3dv .iv .obj .stl .ply .off .vtk .gltf .glb .dae .fbx ...)")
        ->required();
    add_root(check, a.check.roots);
    check->add_flag("--json", a.check.json, "One JSON object per line");
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

void add_query(CLI::App& app, Arguments& a) {
    CLI::App* query = app.add_subcommand("query", "Signed distance, closest point, triangle and feature of points");
    query->add_option("mesh", a.query.mesh, "Mesh file")->required();
    query->add_option("points", a.query.points, "CSV of x,y,z in file units; - reads standard input")->required();
    add_root(query, a.query.roots);
    query->add_option("--out", a.query.out, "CSV to write (default: standard output)");
    query->add_option("--threads", a.threads, "Worker threads (default: all cores)")->check(CLI::Range(0u, kMostThreads));
    add_search(query, a.query.search);
    query->add_flag("--cross-check", a.query.cross_check,
                    "Compare every sign of a solid with the winding number; prints the number of differences on standard error");
    query->add_flag("--json", a.query.json, "JSON instead of CSV");
    query->footer(
        "Example: trocar query liver.obj points.csv --out distances.csv\nColumns: distance,cx,cy,cz,triangle,feature; "
        "distance < 0 inside.");
}

void add_collide(CLI::App& app, Arguments& a) {
    CLI::App* collide = app.add_subcommand("collide", "Contact report of two meshes: overlap, depth, direction, witness, regions");
    collide->add_option("a", a.collide.a, "First mesh")->required();
    collide->add_option("b", a.collide.b, "Second mesh")->required();
    collide->add_option("--move-b", a.move_b, "\"x y z\": translation of B, file units");
    collide->add_option("--rotate-b", a.rotate_b, "\"ax ay az degrees\": rotation of B about its origin, before the move");
    collide->add_option("--tolerance", a.collide.tolerance, "Depth tolerance along edges, file units");
    collide->add_option("--cells", a.collide.cells,
                        "Write the grid cells that both meshes share: .json (cell, object and primitive layers), .vtp or .png");
    add_root(collide, a.collide.roots);
    add_search(collide, a.collide.search);
    collide->add_flag("--separate", a.collide.separate,
                      "Search for the shortest translation that separates B from A: proven lower and upper bounds");
    collide->add_option("--contours", a.collide.contours, "Write the intersection curves of the surfaces to this .obj file, as lines");
    collide->add_flag("--cross-check", a.collide.cross_check,
                      "Compare every sign of a solid with the winding number; counts \"disagreements\"");
    collide->add_flag("--json", a.collide.json, "JSON");
    collide->footer(
        "Example: trocar collide liver.stl probe.obj --move-b \"0 0 -5\" --json\n"
        "JSON: depth, surface_depth, direction, witness, vertices_a_in_b, vertices_b_in_a, edge_contacts, face_contacts, cells, contained, "
        "saturated (moving by the depth may not separate them), regions [vertices_a, vertices_b, contour, area, volume, depth, "
        "direction, witness]; with --separate separation {lower, upper, translation}, with --cross-check disagreements");
}

void add_convert(CLI::App& app, Arguments& a) {
    CLI::App* convert = app.add_subcommand("convert", "Read a mesh, clean it, write it in another format");
    convert->add_option("in", a.convert.in, "Mesh file to read")->required();
    convert->add_option("out", a.convert.out, "File to write: .obj .stl .ply .wrl .vtp by its extension")->required();
    add_root(convert, a.convert.roots);
    convert->add_flag("--json", a.convert.json, "JSON");
    CLI::Option* repair = convert->add_flag("--repair", a.convert.repair,
                                            "Make it one closed solid and list the changes; exit code 1 and no file if that fails");
    convert->add_option("--weld", a.convert.weld, "Join vertices nearer than this fraction of the diagonal")->check(CLI::Range(0.0, 0.01));
    convert->add_option("--hole-size", a.convert.hole_size, "Fill holes up to this fraction of the diagonal (0.2)")
        ->check(CLI::Range(0.0, 1.0))
        ->needs(repair);
    convert->footer("Example: trocar convert liver.wrz liver.obj\n         trocar convert --repair scan.ply organ.stl");
}

void add_view(CLI::App& app, Arguments& a) {
    CLI::App* view = app.add_subcommand("view", "Draw a mesh or a shape: textured, lit, fitted to the picture");
    view->add_option("meshes", a.view.sources, "Mesh files or shapes (shape:NAME:TRIANGLES:SEED), one tile each")->required();
    add_root(view, a.view.roots);
    view->add_option("--out", a.view.out, "PNG to write")->required();
    view->add_option("--size", a.size, "WIDTHxHEIGHT in pixels (default 1024x768)");
    view->add_option("--azimuth", a.view.azimuth, "Degrees about the up axis; 0 = seen from +x, -90 from -y");
    view->add_option("--elevation", a.view.elevation, "Degrees above the horizon; 90 = from above");
    view->add_option("--up", a.view.up, "Axis that points up in the picture: x, y or z (default)")->check(CLI::IsMember({"x", "y", "z"}));
    view->add_flag("--wireframe", a.view.wireframe, "Edges drawn over the surface");
    view->add_flag("--sheet", a.view.sheet, "Front, side, top and oblique view in one picture");
    view->footer("Example: trocar view shape:gallbladder:10000 --sheet --out gallbladder.png");
}

void add_organ(CLI::App& app, Arguments& a) {
    CLI::App* organ = app.add_subcommand("organ", "Make closed surfaces and tetrahedra from a segmented image");
    organ->add_option("volume", a.organ.volume, "NRRD, MetaImage, NIfTI or DICOM file, or a folder of DICOM slices");
    organ->add_option("out", a.organ.out, "Surface to write: .obj .stl .ply .wrl; with several labels or segments: NAME_<label>.EXTENSION");
    organ->add_option("--label", a.labels, "Label values, one surface each; default: list the labels in the file")->delimiter(',');
    organ
        ->add_option("--segment", a.organ.segments,
                     "Instead of labels: names of segments in a .seg.nrrd, one surface each, repeatable; default: list them")
        ->allow_extra_args(false);
    organ->add_option("--threshold", a.organ.threshold, "Instead of labels: voxels of at least this value");
    organ->add_option("--smooth", a.organ.smooth, "Rounds of volume-preserving smoothing (default 10)");
    organ->add_option("--blur", a.organ.blur, "Blur of the voxels before contouring, in voxels (default 1; 0 keeps steps)");
    organ->add_option("--triangles", a.organ.triangles, "Simplify to about this many triangles (default: as contoured)");
    organ->add_flag("--even", a.organ.even, "Even triangles for simulation, instead of the fewest that keep the shape");
    organ->add_option("--tets", a.organ.tets, "Also fill with tetrahedra on a lattice of this spacing, mm: writes .vtu and .msh");
    organ->add_flag("--all-pieces", a.organ.all_pieces, "Keep every piece, not only the largest");
    organ->add_option("--series", a.organ.series, "DICOM series UID, if the folder contains several");
    organ->add_option("--frame", a.organ.frame, "Of NIfTI: sform or qform (default: the sform if its code is above 0, else the qform)")
        ->check(CLI::IsMember({"sform", "qform"}));
    organ->add_flag("--json", a.organ.json, "One JSON object per organ");
    organ->footer(
        "Example: trocar organ abdomen_labels.nrrd --label 5 2 organ.obj --triangles 10000 --tets 6\n"
        "writes organ_5.obj, organ_2.obj and their .vtu (ParaView) and .msh (Gmsh 2.2) meshes.\n"
        "Coordinates are the file's patient coordinates: millimetres, x left, y back, z head (LPS); use scale = 0.001 in a scene.\n"
        "Steps: choose voxels; keep the largest piece (voxels joined by faces); blur and contour at the level that encloses\n"
        "the volume of the voxels; smooth; simplify; judge. Volume and open edges are printed after each.\n"
        "Exit code 1 when a surface cannot be admitted as solid.");
}

void add_soak(CLI::App& app, Arguments& a) {
    CLI::App* soak = app.add_subcommand("soak", "Run a scene repeatedly for minutes and test for drift");
    soak->add_option("scene", a.soak.scene, "Scene file, or the name of a scene that `trocar scenes` lists")->required();
    soak->add_option("--minutes", a.soak.minutes, "Duration, minutes (default 10)")->check(CLI::PositiveNumber);
    soak->add_option("--seconds", a.soak.seconds, "Simulated time of an episode, s (default: the scene's)")->check(CLI::Range(1e-3, 1e6));
    soak->add_option("--faults", a.soak.faults,
                     "Faults injected into every third episode, in turn: nan, blast (absurd velocities), pause (200 ms between two passes, "
                     "which must change nothing)")
        ->delimiter(',')
        ->check(CLI::IsMember({"nan", "blast", "pause"}));
    soak->add_option("--out", a.soak.out, "Folder for soak.json, soak.csv, soak.html, captures/");
    soak->add_option("--set", a.sets, "Change a key of the scene: KEY=VALUE, repeatable");
    soak->add_option("--threads", a.soak.threads, "Worker threads (default: all cores); results never depend on it")
        ->check(CLI::Range(0u, kMostThreads));
    soak->add_flag("--json", a.soak.json, "Print soak.json instead of a line per minute");
    soak->footer(
        "Example: trocar soak probe_on_liver --minutes 30 --faults nan,pause --out out/soak\n"
        "Every episode starts from the same state and must end in the same state. Rules: the lower bound of the drift (median\n"
        "slope, 95 % interval) of resident memory stays below 256 KiB a minute and of the heap below 64 KiB a minute, or below\n"
        "0.5 MiB in the whole run (so runs of less than two minutes detect only faster leaks); no file stays open; no particle is lost\n"
        "except by a fault, and then restored after one pass; the energy balance closes to 2 % of the largest energy; passes do not\n"
        "become 50 % slower. Exit code 1 with the reason when a rule is broken.");
}

void add_sweep(CLI::App& app, Arguments& a) {
    CLI::App* sweep = app.add_subcommand(
        "sweep", "Run a scene with every combination of values, locally or on a cluster, and merge the results into one table");
    sweep->add_option("file", a.sweep.file, "Sweep file")->required();
    sweep
        ->add_option("--engine", a.sweep.engine,
                     "local (default), parallel (GNU parallel), slurm (an array job), merge (only merge the existing results)")
        ->check(CLI::IsMember({"local", "parallel", "slurm", "merge"}));
    sweep->add_option("--out", a.sweep.out,
                      "Folder (default out/sweep_NAME): runs/ with a folder per run, runs.txt, sweep.csv, sweep.json");
    sweep->add_option("--jobs", a.sweep.jobs, "Concurrent runs (default: cores / threads of a run; slurm: as many as the cluster grants)")
        ->check(CLI::Range(1, 4096));
    sweep->add_flag("--dry-run", a.sweep.dry_run, "Print the commands and run none");
    sweep->add_flag("--json", a.sweep.json, "Print sweep.json");
    sweep->footer(
        "A sweep file:\n"
        "    scene = \"kidney_on_liver\"\n    seconds = 0.5\n    threads = 1\n"
        "    repeat = 3                                             # runs of every combination, for the spread of times\n"
        "    columns = [\"contact.total_ms_mean\", \"contact.max_depth_m\"]   # paths into metrics.json\n"
        "    [set]\n    \"liver.triangles\" = 4000\n"
        "    [vary]\n    \"contact.cell_edges\" = [2.0, 2.5, 3.0]\n    \"liver.integrator\" = [\"leapfrog\", \"midpoint\"]\n"
        "Example: trocar sweep cells.toml --engine parallel --out out/cells\n"
        "Every run is a separate command (runs.txt). Finished runs are not repeated: start the same sweep again after an interruption or\n"
        "after adding values. Exit code 1 when a run failed; the table shows which and why.");
}

void add_replay(CLI::App& app, Arguments& a) {
    CLI::App* replay = app.add_subcommand("replay", "Replay a capture and compare, or replay one of its passes many times");
    replay->add_option("capture", a.replay.file, "A .cap file of `trocar run --capture`")->required();
    CLI::Option* compare = replay->add_flag("--check", a.default_said, "Compare only (the default)");
    CLI::Option* frame = replay->add_option("--frame", a.replay.frame, "Contact pass to repeat from its own start")->excludes(compare);
    replay->add_option("--repeat", a.replay.repeat, "Number of repetitions (default 100)")->needs(frame)->check(CLI::Range(1, 1000000));
    replay->add_flag("--profile", a.default_said, "Median time of every stage of the pass (the default with --frame)")->needs(frame);
    replay->add_option("--trace", a.replay.trace, "File to write a trace of the repetitions to")->needs(frame);
    replay->add_option("--threads", a.replay.threads, "Worker threads (default: all cores); results never depend on it")
        ->check(CLI::Range(0u, kMostThreads));
    replay->add_flag("--json", a.replay.json, "JSON");
    replay->footer(
        "Example: trocar replay out/captures/worst.cap\n"
        "         trocar replay out/captures/worst.cap --frame 61 --repeat 200\n"
        "Exit code 1 unless the result is bit-identical; names the first different pass, stage, array and row (with --frame: only\n"
        "whether the pass ends as captured). Also 1 if the capture is incomplete: its readable part is compared.");
}

void add_capture(CLI::App& app, Arguments& a) {
    CLI::App* capture = app.add_subcommand("capture", "Show a capture, compare two, or export for other tools");
    capture->require_subcommand(1);
    CLI::App* info = capture->add_subcommand("info", "Scene, reason, passes, slowest pass and its dearest pair");
    info->add_option("files", a.capture_files, "Captures")->required();
    info->add_flag("--json", a.capture_json, "One JSON object per line");
    CLI::App* diff =
        capture->add_subcommand("diff", "First difference of two captures: array, row, body, both values; exit code 1 when there is one");
    diff->add_option("files", a.capture_files, "Two captures")->required()->expected(2);
    CLI::App* exported = capture->add_subcommand("export", "Surfaces for ParaView, pictures, a trace, a table");
    exported->add_option("file", a.capture.file, "Capture")->required();
    exported->add_option("--vtp", a.capture.vtp,
                         "Folder for bodies_PASS.vtp and bodies.pvd, which ParaView opens: body (named in bodies.csv), depth, contact "
                         "(found at the start of the pass; everything else is from its end), velocity, strain, stress");
    exported->add_flag("--per-body", a.capture.per_body, "With --vtp: separate BODY_PASS.vtp and BODY.pvd for each body");
    exported->add_option("--png", a.capture.png, "Folder for frames/*.png");
    exported->add_option("--trace", a.capture.trace, "Chrome trace (JSON) of the stages of every pass: Perfetto, speedscope");
    exported->add_option("--csv", a.capture.csv, "CSV with one line per pass");
    exported->add_option("--threads", a.capture.threads, "Worker threads (default: all cores)")->check(CLI::Range(0u, kMostThreads));
    capture->footer(
        "Example: trocar run kidney_on_liver --out out/k --capture worst,5-25\n"
        "         trocar capture info out/k/captures/*.cap\n"
        "         trocar capture export out/k/captures/worst.cap --vtp out/vtp --csv out/passes.csv");
}

void add_device(CLI::App& app, Arguments& a) {
    CLI::App* device = app.add_subcommand("device", "List, test and record haptic devices");
    device->require_subcommand(1);
    CLI::App* list = device->add_subcommand("list", "Kinds of device connections, and how to name a device");
    list->add_flag("--json", a.device.json, "JSON");
    CLI::App* test =
        device->add_subcommand("test", "Listen to a device: rate, intervals, range, dropped samples; exit code 1 if none arrived");
    CLI::App* record =
        device->add_subcommand("record", "Record the motion of a hand as CSV, for `trace = \"FILE\"` of a [[tool]] and trace:FILE");
    for (CLI::App* each : {test, record}) {
        each->add_option("device", a.device.device, "KIND or KIND:WHERE, see `trocar device list`")->required();
        each->add_option("--seconds", a.device.seconds, "Duration, s (default 5)")->check(CLI::Range(0.05, 86400.0));
    }
    test->add_option("--spring", a.device.spring,
                     "Stiffness of a spring that pulls the hand to its first position, N/m (default: no force)")
        ->check(CLI::Range(0.0, 2000.0));
    test->add_option("--max-force", a.device.max_force, "Largest force of that spring, N (default 2)")->check(CLI::Range(0.0, 50.0));
    test->add_flag("--json", a.device.json, "JSON");
    record->add_option("--out", a.device.out, "CSV to write: time,x,y,z,qw,qx,qy,qz,vx,vy,vz,buttons, and grip if the device has one")
        ->required();
    device->footer(
        "Example: trocar device list\n"
        "         trocar device test udp:7731 --seconds 10          # a device that sends packets to this machine\n"
        "         trocar device test plugin:./mine.so --spring 100  # and feels a soft spring\n"
        "         trocar device record haply --seconds 30 --out hand.csv\n"
        "         trocar run probe_on_liver --live --device probe=udp:7731\n"
        "Packets, messages and the plug-in's header: docs/devices.md. Network devices are on this machine unless an\n"
        "address is given. Forces are sent only with --spring, or in a live run.");
}

void add_scenes(CLI::App& app, Arguments& a) {
    CLI::App* scenes = app.add_subcommand("scenes", "List the built-in scenes, shapes and tissues");
    scenes->add_flag("--json", a.scenes_json, "JSON");
    scenes->footer("Example: trocar scenes");
}

void describe(CLI::App& app, Arguments& a) {
    app.description("Trocar: virtual surgery, headless. Contact, penetration depth, deformation, 1 kHz haptics.");
    app.set_version_flag("--version", [] { return version_text(); });
    app.require_subcommand(1);
    app.set_help_all_flag("--help-all", "Help of every command");
    add_run(app, a);
    add_check(app, a);
    add_query(app, a);
    add_collide(app, a);
    add_convert(app, a);
    add_view(app, a);
    add_organ(app, a);
    add_soak(app, a);
    add_sweep(app, a);
    add_replay(app, a);
    add_capture(app, a);
    add_device(app, a);
    add_scenes(app, a);
}

int dispatch(const CLI::App& app, Arguments& a) {
    if (app.got_subcommand("run")) {
        for (const std::string& text : a.sets) a.run.overrides.push_back(parse_override(text));
        a.run.render = !a.no_render;
        a.run.threads = a.threads;
        return run_command(a.run);
    }
    if (app.got_subcommand("check")) return check_command(a.check);
    if (app.got_subcommand("query")) {
        CommandPool pool(a.threads);
        int code = kFault;
        pool.run([&] { code = query_command(a.query); });
        return code;
    }
    if (app.got_subcommand("collide")) {
        if (!a.move_b.empty()) {
            const std::vector<double> v = parse_numbers("--move-b", a.move_b, 3);
            a.collide.move_b = Vec3d(v[0], v[1], v[2]);
        }
        if (!a.rotate_b.empty()) {
            const std::vector<double> v = parse_numbers("--rotate-b", a.rotate_b, 4);
            const Vec3d axis(v[0], v[1], v[2]);
            if (axis.norm() == 0) throw InputError("--rotate-b \"" + a.rotate_b + "\": the axis has no length");
            a.collide.rotate_b = from_rotation_vector(axis.normalized() * (v[3] * std::numbers::pi / 180));
        }
        return collide_command(a.collide);
    }
    if (app.got_subcommand("convert")) return convert_command(a.convert);
    if (app.got_subcommand("view")) {
        if (!a.size.empty()) {
            const std::array<uint32_t, 2> size = parse_size(a.size);
            a.view.width = size[0];
            a.view.height = size[1];
        }
        return view_command(a.view);
    }
    if (app.got_subcommand("organ")) {
        take_labels(a.labels, a.organ);
        return organ_command(a.organ);
    }
    if (app.got_subcommand("soak")) {
        for (const std::string& text : a.sets) a.soak.overrides.push_back(parse_override(text));
        return soak_command(a.soak);
    }
    if (app.got_subcommand("sweep")) return sweep_command(a.sweep);
    if (app.got_subcommand("replay")) return replay_command(a.replay);
    if (const CLI::App* capture = app.get_subcommand("capture"); capture->parsed()) {
        if (capture->got_subcommand("info")) return capture_info_command(a.capture_files, a.capture_json);
        if (capture->got_subcommand("diff")) return capture_diff_command(a.capture_files[0], a.capture_files[1]);
        return capture_export_command(a.capture);
    }
    if (const CLI::App* device = app.get_subcommand("device"); device->parsed()) {
        if (device->got_subcommand("list")) return device_list_command(a.device.json);
        return device->got_subcommand("test") ? device_test_command(a.device) : device_record_command(a.device);
    }
    return scenes_command(a.scenes_json);
}

}  // namespace

namespace {

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
        Arguments arguments;
        describe(app, arguments);
        if (argc > 1 && argv[1][0] != '-' &&
            app.get_subcommands([&](const CLI::App* command) { return command->get_name() == argv[1]; }).empty())
            throw trocar::InputError(std::string("there is no command \"") + argv[1] + "\"; trocar --help lists them");
        try {
            app.parse(argc, argv);
        } catch (const CLI::ParseError& e) {
            return app.exit(e) == 0 ? trocar::kDone : trocar::kUsage;
        }
        return dispatch(app, arguments);
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
