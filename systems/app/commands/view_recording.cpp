#include "systems/app/commands/view_recording.hpp"

#include <unistd.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "engine/base/error.hpp"
#include "engine/files/text_file.hpp"
#include "engine/files/whole_file.hpp"
#include "systems/app/capture/capture_export.hpp"
#include "systems/app/console/command_pool.hpp"
#include "systems/app/console/standard_streams.hpp"
#include "systems/app/player/player_page.hpp"
namespace trocar {
namespace fs = std::filesystem;
namespace {

// What repeats a run: its scene and what it was given on the command line.
RunOptions options_of_run(const ViewOptions& options, const fs::path& folder, const fs::path& recording) {
    RunOptions run;
    run.render = run.tells = false;
    std::error_code error;
    bool is_of_run = true;  // the recording, and not of an earlier run into the same folder
    const fs::path file = folder / "metrics.json";
    if (fs::exists(file, error)) try {
            const nlohmann::json metrics = nlohmann::json::parse(read_text_file(file), nullptr, false);
            if (!metrics.is_object()) throw InputError(file.string() + ": is no JSON object");
            run.scene = metrics.value("scene_file", "");
            for (const auto& pair : metrics.value("set", nlohmann::json::array())) run.overrides.push_back({pair.at(0), pair.at(1)});
            // half a tick less: seconds are rounded
            const double ticks = std::round(1e3 * metrics.value("simulated_s", 0.0));
            run.seconds = ticks > 0 ? 1e-3 * (ticks - 0.5) : 0;
            if (!metrics.contains("kept_s")) run.expected_hash = metrics.value("state_hash", "");
            is_of_run = metrics.value("recorded", true) || metrics.contains("replay") || options.sources.front() == recording;
        } catch (const nlohmann::json::exception&) {
            throw InputError(file.string() + ": scene_file, set, simulated_s, state_hash or recorded is not of its type");
        }
    if (!options.scene.empty()) run.scene = options.scene;
    if (run.scene.empty()) throw InputError(folder.string() + ": no metrics.json there names the scene; --scene SCENE does");
    if (is_of_run && fs::exists(recording, error)) run.replay = recording, run.seconds = 0;
    return run;
}

int play_run(const ViewOptions& options, const fs::path& page, const fs::path& folder, const fs::path& recording) {
    RunOptions run = options_of_run(options, folder, recording);
    run.out = page.string() + ".run" + std::to_string(getpid());
    struct Removed {
        fs::path folder;
        ~Removed() {
            std::error_code error;
            fs::remove_all(folder, error);
        }
    } const removed{run.out};
    const int code = run_command(run);
    write_whole_file(page, read_text_file(run.out / "report.html"));
    return code;
}

}  // namespace

bool is_recording(const std::string& source) {
    std::error_code error;
    const fs::path path = source;
    return path.extension() == ".cap" || path.extension() == ".recording" || fs::is_directory(path, error);
}

int view_recording(const ViewOptions& options) {
    const fs::path source = options.sources.front();
    const bool is_capture = source.extension() == ".cap", is_folder = !is_capture && source.extension() != ".recording";
    const fs::path folder = is_folder ? source : source.parent_path();
    const fs::path page = !options.out.empty() ? options.out
                          : is_capture         ? fs::path(source).replace_extension(".html")
                                               : folder / "player.html";
    if (page.extension() != ".html") throw InputError(page.string() + ": the page's name must end in .html");
    if (!has_player())
        throw InputError("view: this program was built without the player: Node.js and npm, or the packages they load, were not there");
    if (is_capture && !options.scene.empty()) throw InputError("--scene: a capture holds its scene");
    int code = kDone;
    if (is_capture) {
        const Capture capture = open_capture(source);
        CommandPool pool(0);
        pool.run([&] { write_whole_file(page, capture_page(capture)); });
        if (!capture.damage.empty()) code = kNo;
    } else {
        code = play_run(options, page, folder, is_folder ? folder / "live.recording" : source);
    }
    write_standard_output("open file://" + fs::absolute(page).string() + "\n");
    return code;
}

}  // namespace trocar
