#include <sys/utsname.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <optional>

#include "content/build_scene.hpp"
#include "content/save_mesh.hpp"
#include "engine/error.hpp"
#include "engine/image_file.hpp"
#include "engine/offscreen.hpp"
#include "engine/thread_pool.hpp"
#include "engine/trace.hpp"
#include "engine/whole_file.hpp"
#include "systems/app/commands.hpp"
#include "systems/app/figures.hpp"
#include "systems/app/progress.hpp"
#include "systems/app/standard_streams.hpp"
#include "systems/app/video.hpp"
#include "systems/frame.hpp"
#include "systems/picture_snapshot.hpp"
#include "systems/render.hpp"
namespace trocar {
namespace fs = std::filesystem;
namespace {

constexpr size_t kTraceCapacity = 1u << 19;

// Name of a scene that comes with the program, or a path.
fs::path find_scene(const std::string& name) {
    std::error_code error;
    if (fs::exists(name, error) || name.find('/') != std::string::npos || name.ends_with(".toml")) return name;
    const fs::path file = scenes_folder() / (name + ".toml");
    if (!fs::exists(file, error))
        throw InputError(name + ": neither a scene file nor a scene that comes with the program (see `trocar scenes`)");
    return file;
}

// Makes the folder and refuses early when nothing can be written there.
void prepare_folder(const fs::path& folder) {
    std::error_code error;
    fs::create_directories(folder, error);
    if (error) throw InputError(folder.string() + ": cannot be made (" + error.message() + ")");
    const fs::path probe = folder / ".trocar_probe";
    {
        std::ofstream stream(probe);
        if (!stream || !(stream << "x").flush())
            throw InputError(folder.string() + ": cannot be written (" + std::strerror(errno) + ")");
    }
    fs::remove(probe, error);
}

std::string machine_text() {
    std::ifstream cpu("/proc/cpuinfo");
    std::string model = "unknown processor";
    for (std::string line; std::getline(cpu, line);) {
        if (line.rfind("model name", 0) == 0) {
            model = line.substr(line.find(':') + 2);
            break;
        }
    }
    utsname name{};
    uname(&name);
    return model + ", " + name.sysname + " " + name.release;
}

// World positions of a body as a mesh that the mesh commands can read back.
Mesh body_surface(const World& world, uint32_t body) {
    const MeshView view = mesh_view(world.meshes, world.bodies.mesh[body]);
    Mesh mesh;
    mesh.name = world.bodies.name[body];
    mesh.triangle.assign(view.triangle.begin(), view.triangle.end());
    for (uint32_t v = 0; v < view.position.size(); ++v)
        mesh.position.push_back(vertex_position(surfaces_of(world), body, v));
    return mesh;
}

void export_bodies(const World& world, const fs::path& folder, uint64_t picture) {
    prepare_folder(folder);
    char number[32];
    std::snprintf(number, sizeof number, "%06llu_", static_cast<unsigned long long>(picture));
    for (uint32_t b = 0; b < world.bodies.mesh.size(); ++b)
        save_mesh(body_surface(world, b), folder / (number + world.bodies.name[b] + ".obj"));
}

PassFigures pass_figures(const Frame& frame, double time) {
    const World& w = frame.world();
    PassFigures p;
    p.time = time;
    for (const uint32_t row : frame.detection_stages())
        p.detection_ms += static_cast<double>(frame.times().stage_ns[row]) * 1e-6;
    p.response_ms = static_cast<double>(frame.times().response_ns) * 1e-6;
    p.contacts = static_cast<uint32_t>(w.contacts.point.size());
    p.pairs = static_cast<uint32_t>(w.penetrations.pair.size());
    for (size_t i = 0; i < w.penetrations.pair.size(); ++i) {
        p.depth = std::max(p.depth, w.penetrations.depth[i]);
        p.inside_vertices += w.penetrations.vertices_a_in_b[i] + w.penetrations.vertices_b_in_a[i];
    }
    for (const ToolState& tool : w.haptics.state) {
        p.force = std::max(p.force, tool.command.force.norm());
        p.contact_force = std::max(p.contact_force, tool.contact_impulse.norm() / (w.clock.period * 1e-3));
    }
    p.energy = w.energy;
    return p;
}

// Draws pictures and keeps them, as PNG files and as a film.
class PictureWriter {
 public:
    PictureWriter(const BuiltScene& scene, const World& world, const fs::path& out)
        : params_(scene.picture), camera_(scene.camera), out_(out), renderer_(world.meshes) {
        if (out_.empty()) return;
        prepare_folder(out_ / "frames");
        std::error_code error;
        for (const fs::directory_entry& old : fs::directory_iterator(out_ / "frames", error))
            if (old.path().extension() == ".png") fs::remove(old.path(), error);  // of an earlier, longer run
        fs::remove(out_ / "film.mp4", error);
        if (ffmpeg_present()) film_.emplace(out_ / "film.mp4", params_.width, params_.height, 30);
    }
    // Returns the milliseconds of drawing and reading back; writing the file is not part of a frame.
    double take(const PictureSnapshot& snapshot) {
        const uint64_t start = now_ns();
        if (files_.empty()) {
            if (camera_.distance <= 0) fit_camera(snapshot, params_.width, params_.height, camera_);
            else lay_floor(snapshot, camera_);
        }
        render_picture(params_, camera_, snapshot, renderer_, scratch_, image_);
        const double ms = static_cast<double>(now_ns() - start) * 1e-6;
        if (!out_.empty()) {
            char name[32];
            std::snprintf(name, sizeof name, "frames/%06zu.png", files_.size());
            save_png(image_, out_ / name);
            files_.emplace_back(name);
            if (film_ && !film_->add(image_)) film_error_ = film_->error(), film_.reset();
        }
        return ms;
    }
    std::string finish_film() {
        if (film_ && !files_.empty() && film_->finish()) return "film.mp4";
        if (film_) film_error_ = film_->error();
        if (!film_error_.empty()) std::fprintf(stderr, "trocar: warning: no film: %s\n", film_error_.c_str());
        return "";
    }
    const std::vector<std::string>& files() const { return files_; }

 private:
    PictureParams params_;
    Camera camera_;
    fs::path out_;
    GlRenderer renderer_;
    RenderScratch scratch_;
    Image image_;
    std::vector<std::string> files_;
    std::optional<VideoWriter> film_;
    std::string film_error_;
};

void add_stage_times(const Frame& frame, RunFigures& figures) {
    const FrameTimes& times = frame.times();
    for (size_t s = 0; s < times.stage_ns.size(); ++s)
        if (times.stage_ns[s] > 0) figures.stage[s].ms.push_back(static_cast<double>(times.stage_ns[s]) * 1e-6);
}

void start_figures(const BuiltScene& scene, const SceneFile& file, const Frame& frame, const RunOptions& options,
                   RunFigures& figures) {
    figures.scene = file.settings.name;
    figures.description = file.settings.description;
    figures.version = TROCAR_VERSION;
    figures.instruction_set = instruction_set();
    figures.machine = machine_text();
    figures.threads = thread_count();
    figures.live = options.live;
    figures.bodies = scene.notes;
    for (const std::string& name : frame.stage_names()) figures.stage.push_back({name, {}});
}

void finish_figures(const Frame& frame, RunFigures& figures) {
    const World& w = frame.world();
    figures.state_hash = state_hash(w);
    figures.frames = w.clock.picture;
    figures.simulated_s = static_cast<double>(w.clock.tick) * 1e-3;
    figures.report = w.report;
    if (!figures.live) {
        figures.ticks = w.haptics.ticks;
        figures.max_force = w.haptics.max_force;
    }
}

// Everything in one deterministic order, as fast as the machine goes.
void run_lockstep(const RunOptions& options, double seconds, Frame& frame, PictureWriter* pictures,
                  RunFigures& figures) {
    Progress progress(figures.scene);
    const uint64_t start = now_ns();
    while (static_cast<double>(frame.world().clock.tick) < seconds * 1000) {
        const double time = static_cast<double>(frame.world().clock.tick) * 1e-3;
        const uint64_t pass_start = now_ns();
        frame.step();
        PassFigures pass = pass_figures(frame, time);
        pass.frame_ms = static_cast<double>(now_ns() - pass_start) * 1e-6;
        if (frame.times().picture) {
            if (pictures) {
                pass.render_ms = pictures->take(frame.world().picture);
                pass.frame_ms += pass.render_ms;
                figures.render_ms.push_back(pass.render_ms);
            }
            if (options.export_every > 0 && !options.out.empty() &&
                (frame.world().clock.picture - 1) % options.export_every == 0)
                export_bodies(frame.world(), options.out / "meshes", frame.world().clock.picture - 1);
        }
        add_stage_times(frame, figures);
        figures.pass.push_back(pass);
        char note[96];
        std::snprintf(note, sizeof note, "%.2f s simulated, depth %.2f mm, %.2f N", time, pass.depth * 1e3, pass.force);
        progress.show(time / seconds, note);
    }
    figures.tick_us = frame.times().tick_us;
    figures.wall_s = static_cast<double>(now_ns() - start) * 1e-9;
}

void print_summary(const RunFigures& f, const fs::path& out) {
    std::vector<double> total;
    double depth = 0;
    for (const PassFigures& p : f.pass) {
        depth = std::max(depth, p.depth);
        if (p.contact()) total.push_back(p.detection_ms + p.response_ms);
    }
    char text[1024];
    std::snprintf(text, sizeof text,
                  "%s: %.2f s simulated in %.2f s, %u thread%s, %s\n  contact events %zu, %.3f ms mean, %.3f ms p99; "
                  "deepest %.2f mm\n"
                  "  haptic ticks %llu, largest force %.2f N; state hash %016llx\n",
                  f.scene.c_str(), f.simulated_s, f.wall_s, f.threads, f.threads == 1 ? "" : "s",
                  f.instruction_set.c_str(), total.size(), mean(total), quantile(total, 0.99), depth * 1e3,
                  static_cast<unsigned long long>(f.ticks), f.max_force, static_cast<unsigned long long>(f.state_hash));
    write_standard_output(text);
    if (!out.empty())
        write_standard_output("  wrote " + out.string() + "/: report.html, metrics.json, trace.json, meshes/" +
                              std::string(f.render_ms.empty() ? "" : ", frames/") + "\n");
}

}  // namespace

int run_command(const RunOptions& options) {
    const SceneFile file = read_scene_file(find_scene(options.scene), options.overrides);
    if (!options.out.empty()) prepare_folder(options.out);
    set_offscreen_threads(0);
    ThreadPool pool(options.threads);
    RunFigures figures;
    pool.run([&] {
        BuiltScene scene = build_scene(file);
        for (const std::string& warning : scene.warnings)
            std::fprintf(stderr, "trocar: warning: %s\n", warning.c_str());
        Trace trace(options.out.empty() ? 0 : kTraceCapacity);
        FrameOptions frame_options;
        frame_options.trace = options.out.empty() ? nullptr : &trace;
        frame_options.external_ticks = options.live;
        Frame frame(std::move(scene.world), frame_options);
        start_figures(scene, file, frame, options, figures);
        std::optional<PictureWriter> pictures;
        if (options.render && file.settings.render && !options.out.empty())
            pictures.emplace(scene, frame.world(), options.out);
        const double seconds = options.seconds > 0 ? options.seconds : file.settings.seconds;
        run_lockstep(options, seconds, frame, pictures ? &*pictures : nullptr, figures);
        finish_figures(frame, figures);
        if (options.out.empty()) return;
        export_bodies(frame.world(), options.out / "meshes", frame.world().clock.picture);
        const std::string film = pictures ? pictures->finish_film() : "";
        write_whole_file(options.out / "metrics.json", metrics_json(figures));
        write_whole_file(options.out / "trace.json", trace.to_json({"main"}));
        write_whole_file(options.out / "report.html",
                         report_html(figures, pictures ? pictures->files() : std::vector<std::string>{}, film));
    });
    if (options.json)
        write_standard_output(metrics_json(figures));
    else
        print_summary(figures, options.out);
    return kDone;
}

}  // namespace trocar
