#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "engine/error.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/thread_pool.hpp"
#include "systems/app/commands.hpp"

namespace {
using namespace trocar;

Override parse_override(const std::string& text) {
    const size_t equals = text.find('=');
    if (equals == std::string::npos || equals == 0)
        throw InputError("--set " + text + ": write key=value, for example --set liver.tissue.youngs_modulus=2e4");
    return {text.substr(0, equals), text.substr(equals + 1)};
}

// "x y z" as three words or one quoted word.
std::vector<double> parse_numbers(const std::string& option, const std::string& text, size_t count) {
    std::vector<double> v;
    std::istringstream stream(text);
    for (std::string word; stream >> word;) {
        char* end = nullptr;
        v.push_back(std::strtod(word.c_str(), &end));
        if (end != word.c_str() + word.size() || !std::isfinite(v.back()))
            throw InputError(option + " \"" + text + "\": \"" + word + "\" is not a number");
    }
    if (v.size() != count)
        throw InputError(option + " \"" + text + "\": " + std::to_string(count) + " numbers are needed");
    return v;
}

struct Arguments {
    RunOptions run;
    CheckOptions check;
    QueryOptions query;
    CollideOptions collide;
    ConvertOptions convert;
    std::vector<std::string> sets;
    std::string move_b, rotate_b;
    bool no_render = false, scenes_json = false;
    uint32_t threads = 0;
};

void describe(CLI::App& app, Arguments& a) {
    app.description("Trocar: virtual surgery, headless. Contact, penetration depth, deformation, 1 kHz haptics.");
    app.set_version_flag("--version", [] { return version_text(); });
    app.require_subcommand(1);
    app.set_help_all_flag("--help-all", "Help of every command");

    CLI::App* run = app.add_subcommand("run", "Simulate a scene: pictures, film, figures, trace");
    run->add_option("scene", a.run.scene, "Scene file, or the name of a scene that `trocar scenes` lists")->required();
    CLI::Option* seconds = run->add_option("--seconds", a.run.seconds, "Simulated time, s (default: the scene's)");
    run->add_option("--out", a.run.out, "Folder for frames/, film, meshes/, metrics.json, trace.json, report.html");
    CLI::Option* live = run->add_flag("--live", a.run.live,
                                      "Real clock: haptics on its own 1 kHz thread, drawing at low priority; with --out "
                                      "it leaves live.recording there");
    run->add_option("--replay", a.run.replay,
                    "Repeat a live run in lockstep from its live.recording, with the same scene and --set; exit code 1 "
                    "when it does not come out the same to the bit")
        ->excludes(live)
        ->excludes(seconds);
    run->add_flag("--no-render", a.no_render, "No pictures");
    run->add_option("--set", a.sets, "Change a key of the scene: KEY=VALUE, repeatable");
    run->add_option("--threads", a.threads, "Worker threads (default: all cores); results never depend on it");
    run->add_option("--export-every", a.run.export_every, "Write every body as OBJ at every n-th picture");
    run->add_option("--slow-render", a.run.slow_render_ms,
                    "Live: draw each picture again and again for this many ms (a stress test)");
    run->add_flag("--json", a.run.json, "Print metrics.json to standard output");
    run->footer("Example: trocar run probe_on_liver --seconds 2 --set liver.tissue.youngs_modulus=2e4 --out out/probe\n"
                "A live run and its repetition: trocar run probe_on_liver --live --out out/live; "
                "trocar run probe_on_liver --replay out/live/live.recording");

    CLI::App* check =
        app.add_subcommand("check", "Is a mesh sound: closed, manifold, oriented, free of self-crossings");
    check->add_option("files", a.check.files, "Mesh files (.wrl .wrz .x3d .x3dv .iv .obj .stl .ply .off .vtk)")->required();
    check->add_flag("--json", a.check.json, "One JSON object a line");
    check->footer(
        "Example: trocar check liver.wrl kidney.stl --json\nExit code 1 when a mesh cannot be admitted as solid.");

    CLI::App* query = app.add_subcommand("query", "Signed distance, closest point, triangle and feature of points");
    query->add_option("mesh", a.query.mesh, "Mesh file")->required();
    query->add_option("points", a.query.points, "CSV of x,y,z in file units; - reads standard input")->required();
    query->add_option("--out", a.query.out, "CSV to write (default: standard output)");
    query->add_option("--threads", a.threads, "Worker threads (default: all cores)");
    query->add_flag("--json", a.query.json, "JSON instead of CSV");
    query->footer(
        "Example: trocar query liver.obj points.csv --out distances.csv\nColumns: distance,cx,cy,cz,triangle,feature; "
        "distance < 0 inside.");

    CLI::App* collide =
        app.add_subcommand("collide", "Contact report of two meshes: overlap, depth, direction, witness");
    collide->add_option("a", a.collide.a, "First mesh")->required();
    collide->add_option("b", a.collide.b, "Second mesh")->required();
    collide->add_option("--move-b", a.move_b, "\"x y z\": translation of B, file units");
    collide->add_option("--rotate-b", a.rotate_b,
                        "\"ax ay az degrees\": rotation of B about its origin, before the move");
    collide->add_option("--tolerance", a.collide.tolerance, "Depth tolerance along edges, file units");
    collide->add_flag("--json", a.collide.json, "JSON");
    collide->footer("Example: trocar collide liver.stl probe.obj --move-b \"0 0 -5\" --json");

    CLI::App* convert = app.add_subcommand("convert", "Read a mesh, clean it, write it in another format");
    convert->add_option("in", a.convert.in, "Mesh file to read")->required();
    convert->add_option("out", a.convert.out, "File to write: .obj .stl .ply .wrl by its ending")->required();
    convert->add_flag("--json", a.convert.json, "JSON");
    convert->footer("Example: trocar convert liver.wrz liver.obj");

    CLI::App* scenes = app.add_subcommand("scenes", "List the scenes that come with the program");
    scenes->add_flag("--json", a.scenes_json, "JSON");
    scenes->footer("Example: trocar scenes");
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
        ThreadPool pool(a.threads);
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
    return scenes_command(a.scenes_json);
}

}  // namespace

int main(int argc, char** argv) {
    trocar::set_float_mode();
    CLI::App app;
    Arguments arguments;
    describe(app, arguments);
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& e) {
        return app.exit(e) == 0 ? trocar::kDone : trocar::kUsage;
    }
    try {
        return dispatch(app, arguments);
    } catch (const trocar::InputError& e) {
        std::fprintf(stderr, "trocar: %s\n", e.what());
        return trocar::kUsage;
    } catch (const std::exception& e) {
        std::fprintf(stderr, "trocar: internal fault: %s\n", e.what());
        return trocar::kFault;
    }
}
