#include "systems/app/commands/read_run.hpp"

#include "engine/base/error.hpp"
#include "engine/files/text_file.hpp"
#include "systems/app/run/recorded_exercise.hpp"
#include "systems/app/station/exercise_file.hpp"
namespace trocar {
namespace fs = std::filesystem;

Exercise read_run(const fs::path& run) {
    std::error_code error;
    fs::path file = run;
    if (fs::is_directory(run, error)) {
        const auto there = [&](const char* name) { return fs::exists(run / name, error); };
        file = run / (there("exercise.csv") ? "exercise.csv" : there("tools.csv") ? "tools.csv" : "live.recording");
        if (!fs::exists(file, error))
            throw InputError(run.string() + ": has no exercise.csv, tools.csv or live.recording: a run without tools, or none");
    }
    const std::string name = file.filename().string();
    const std::string start = name.ends_with(".csv") ? read_text_file(file).substr(0, 4096) : "";
    Exercise e = start.empty()                                 ? read_recorded_exercise(file)
                 : start.find("device_x_m") < start.find('\n') ? read_tools_csv(file)
                                                               : read_exercise_csv(file);
    if (e.scene.empty()) read_scene_name(file.parent_path(), e);
    if (e.sample.empty()) throw InputError(file.string() + ": holds no sample");
    return e;
}

}  // namespace trocar
