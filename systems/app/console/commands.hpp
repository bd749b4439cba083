#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "content/scene/scene_file.hpp"
#include "content/text/local_file.hpp"
namespace trocar {

// Exit codes of the program.
enum ExitCode : int { kDone = 0, kNo = 1, kUsage = 2, kFault = 3 };

// Passes that the results of a view without --seconds cover: 20 minutes at 60 Hz. A pass takes about 1.3 kB, with a live tool 4.5.
inline constexpr uint64_t kMostViewedPasses = 72'000;

struct RunOptions {
    std::string scene;  // path, or the name of a built-in scene
    std::vector<Override> overrides;
    double seconds = 0;         // 0 = the scene's
    std::filesystem::path out;  // folder; empty = write nothing
    std::string capture;        // triggers, see parse_capture_triggers; empty = no capture
    bool live = false;
    std::vector<std::string> devices;  // live: BODY=SPECIFICATION, replaces the scene's scripted hand
    std::filesystem::path replay;      // recording of a live run to repeat in lockstep; empty = none
    int view = -1;                     // port of the live view; 0 = any free one, -1 = no view
    int64_t keep_passes =
        -1;  // contact passes that results cover, from the first; 0 = all; -1 = all, of a view without end kMostViewedPasses
    bool render = true;
    bool player = true;              // embed the 3D player in report.html
    bool exercise = true;            // write exercise.json and exercise.csv of a scene with tools
    uint32_t width = 0, height = 0;  // of pictures; 0 = the scene's
    std::string expected_hash;       // sixteen hexadecimal digits: another final state means exit code 1; empty = any
    uint32_t threads = 0;            // 0 = all cores
    bool figures_only = false;       // write only metrics.json and passes.csv
    uint32_t export_every = 0;       // write every body as OBJ with every n-th picture; 0 = only at the end
    bool json = false;               // print metrics.json to standard output
    bool tells = true;               // print a summary, without json
    double slow_render_ms = 0;       // live: delays every picture, to show that no other thread waits for drawing
};
int run_command(const RunOptions& options);

struct CheckOptions {
    std::vector<std::string> files;
    FileRoots roots;
    bool json = false;
};
int check_command(const CheckOptions& options);

struct QueryOptions {
    std::string mesh;
    FileRoots roots;
    std::string points;         // CSV x,y,z in file units; "-" = standard input
    std::filesystem::path out;  // CSV; empty = standard output
    TreeSearch search = TreeSearch::kOwn;
    bool cross_check = false;  // compare signs with the winding number
    bool json = false;
};
int query_command(const QueryOptions& options);

struct CollideOptions {
    std::string a, b;
    FileRoots roots;
    Vec3d move_b = Vec3d::Zero();    // file units
    Quat rotate_b;                   // about the origin of B's file, before the move
    double tolerance = 0;            // file units; 0 = 1e-4 of the smaller diagonal
    std::filesystem::path cells;     // .json, .vtp or .png of the shared cells; empty = none
    std::filesystem::path contours;  // .obj of lines; empty = none
    TreeSearch search = TreeSearch::kOwn;
    bool separate = false;
    bool cross_check = false;  // compare signs with the winding number
    bool json = false;
};
int collide_command(const CollideOptions& options);

struct ConvertOptions {
    std::string in, out;
    FileRoots roots;
    bool json = false;
    bool repair = false;
    double weld = 0;       // of the diagonal; 0 = default of repair_mesh, else only identical positions
    double hole_size = 0;  // of the diagonal; 0 = default of repair_mesh
};
int convert_command(const ConvertOptions& options);

struct ViewOptions {
    std::vector<std::string> sources;  // files or shapes, see load_mesh_or_shape; or one capture, recording or folder of a run
    FileRoots roots;
    std::filesystem::path out;  // PNG; of what was recorded a page with the player, empty = beside it
    std::string scene;          // of a recording, instead of the one that its run's metrics.json names
    uint32_t width = 1024, height = 768;
    double azimuth = -60, elevation = 28;  // degrees, see Camera
    char up = 'z';
    bool wireframe = false;
    bool sheet = false;  // front, side, top and oblique in one picture
};
int view_command(const ViewOptions& options);
struct OrganOptions {
    std::string volume;                 // file, or folder of DICOM slices
    std::string out;                    // surface; with several labels, _<label> is inserted before the extension
    std::vector<double> labels;         // one surface for each
    std::vector<std::string> segments;  // used instead of labels: names of the file's segments
    std::string threshold;              // used instead of labels; empty = none
    std::string series;                 // DICOM series UID; empty = the only series
    std::string frame;                  // NIfTI: sform or qform; empty = by the standard
    uint32_t smooth = 10;               // rounds
    uint32_t triangles = 0;             // target count; 0 = keep all contoured triangles
    bool even = false;                  // remesh to even triangles
    double blur = 1;                    // voxels
    double tets = 0;                    // lattice spacing, mm; 0 = no tetrahedra
    bool all_pieces = false;
    bool json = false;
};
int organ_command(const OrganOptions& options);

// Makes a scene file of what an image or a scene graph contains.
struct SceneOptions {
    std::string source;  // image (see OrganOptions::volume) or mesh file
    std::string out;     // .toml; meshes are written into the folder of the same name beside it
    std::string labels;  // CSV: label, name and optionally tissue, motion, color, triangles; empty = all, static
    FileRoots roots;
    std::string series, frame;  // as in OrganOptions
    uint32_t triangles = 4000;  // of a surface made from an image
    double scale = 0;           // m per unit of a mesh file; 0 = guessed
    double touch = -1;          // m, surfaces nearer than this are linked; 0 = none, -1 = a voxel of an image
    bool json = false;
};
int scene_command(const SceneOptions& options);

struct ReplayOptions {
    std::string file;
    std::optional<uint64_t> frame;  // replay only this pass, `repeat` times, to measure it
    uint32_t repeat = 100;
    std::filesystem::path trace;    // of the repetitions; empty = none
    std::vector<Override> changes;  // what if: replay with these keys changed
    std::filesystem::path csv;      // of that, one line per pass; empty = none
    uint32_t threads = 0;
    bool json = false;
};
int replay_command(const ReplayOptions& options);

struct CaptureExportOptions {
    std::string file;
    std::filesystem::path vtp, png, trace, csv, html;  // empty = not written
    bool per_body = false;                             // applies to vtp
    uint32_t threads = 0;
};
int capture_export_command(const CaptureExportOptions& options);
// `picture`: where the picture of the one file goes; empty = nowhere.
int capture_info_command(const std::vector<std::string>& files, bool json, const std::filesystem::path& picture);
int capture_diff_command(const std::string& a, const std::string& b);

int scenes_command(bool json);

struct DeviceOptions {
    std::string device;  // specification, see open_device
    double seconds = 5;
    double spring = 0;          // N/m, test: spring towards the first reported position; 0 = no force
    double max_force = 2;       // N
    std::filesystem::path out;  // record: CSV
    bool json = false;
};
class DeviceLink;
// Closes all devices in parallel; names on standard error those which do not finish.
void close_devices(std::span<DeviceLink* const> links);
int device_list_command(bool json);
// Listens for a while and prints rate, intervals and errors; exit code 1 if no sample arrived.
int device_test_command(const DeviceOptions& options);
int device_record_command(const DeviceOptions& options);
// Library versions and the instruction set in use.
std::string version_text();

struct SoakOptions {
    std::vector<std::string> scenes;  // one after the other, each for its share of the minutes
    std::vector<Override> overrides;
    double minutes = 10;
    double seconds = 0;  // simulated, per episode; 0 = the scene's
    std::vector<std::string> faults;
    int64_t hands = -1;         // seed: hands deviate at random from their paths, every two episodes anew; -1 = as the scene has them
    std::filesystem::path out;  // folder; empty = only print to standard output
    uint32_t threads = 0;
    bool json = false;
};
int soak_command(const SoakOptions& options);

struct SweepOptions {
    std::string file;              // see content/scene/sweep_file.hpp
    std::string engine = "local";  // local | parallel | slurm | merge
    std::filesystem::path out;     // folder; empty = out/sweep_NAME
    uint32_t jobs = 0;             // concurrent runs; 0 = as many as the cores allow
    bool dry_run = false, json = false;
};
// Runs every combination of a sweep that has no result yet and merges all results into one table.
int sweep_command(const SweepOptions& options);

// Finds tissue parameters with which a scene gives a measured curve of force.
struct FitOptions {
    std::string scene;
    std::vector<Override> overrides;
    std::filesystem::path curve;          // CSV, see systems/app/study/curve.hpp
    std::vector<std::string> parameters;  // KEY=LOW..HIGH
    std::string tool;                     // body that the tool holds; empty = the first
    double seconds = 0;                   // 0 = to the end of the curve, or of the scene
    std::filesystem::path out;            // folder: trials.jsonl, curve.csv, fit.json; empty = none, and nothing is kept for another time
    uint32_t threads = 0;
    bool json = false;
};
int fit_command(const FitOptions& options);

// Finds settings of a scene that are accurate and cheap enough.
struct TuneOptions {
    std::string scene;
    std::vector<Override> overrides;
    double budget_ms = 33;         // of a displayed frame, 1/30 s, on one core
    double error_mm = 0.1;         // root mean square of the worst body against a finer run
    double seconds = 0;            // simulated; 0 = the scene's, at most 1
    std::filesystem::path out;     // .toml of the chosen settings; empty = none
    bool exhaustive = false;       // every combination instead of one key at a time
    std::filesystem::path trials;  // file with which an interrupted search goes on; empty = none
    bool json = false;
};
int tune_command(const TuneOptions& options);

// How metrics are computed (systems/app/station/score.hpp).
struct ScoreSettings {
    double idle_speed = 0.01;         // m/s
    double idle_time = 0.5;           // s
    std::vector<std::string> damage;  // ORGAN=N
};
struct ScoreCommandOptions {
    std::vector<std::string> runs;  // folders, or files, see read_run
    ScoreSettings settings;
    bool json = false;
};
int score_command(const ScoreCommandOptions& options);

struct CompareOptions {
    std::vector<std::string> runs;
    std::filesystem::path cohort, out;  // CSV; HTML: empty = print
    ScoreSettings settings;
    bool json = false;
};
int compare_command(const CompareOptions& options);

struct ExerciseOptions {
    std::string run;
    std::filesystem::path mcap, csv;  // empty = not written
};
int exercise_command(const ExerciseOptions& options);

// Processor and kernel version.
std::string machine_text();

}  // namespace trocar
