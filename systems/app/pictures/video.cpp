#include "systems/app/pictures/video.hpp"

#include <unistd.h>

#include <vector>

#include "engine/base/error.hpp"
#include "engine/files/child_process.hpp"
namespace trocar {
namespace {

ChildResult run_ffmpeg(std::vector<std::string> arguments) {
    const std::string program = find_on_path("ffmpeg");
    if (program.empty()) throw InputError("the program ffmpeg is not on PATH");
    arguments.insert(arguments.begin(), {program, "-hide_banner"});
    return run_child(arguments, {});
}

// A colour matrix that players assume at any size, the matching tags, and even sides, which 4:2:0 requires.
std::vector<std::string> output_arguments(const std::filesystem::path& file) {
    const bool h264 = run_ffmpeg({"-encoders"}).output.find("libx264") != std::string::npos;
    std::vector<std::string> words = {"-vf", "scale=out_color_matrix=bt709:out_range=tv,pad=ceil(iw/2)*2:ceil(ih/2)*2", "-an", "-pix_fmt",
                                      "yuv420p"};
    const std::vector<std::string> encoder = h264 ? std::vector<std::string>{"-c:v", "libx264", "-preset", "veryfast", "-crf", "18"}
                                                  : std::vector<std::string>{"-c:v", "mpeg4", "-q:v", "3"};
    words.insert(words.end(), encoder.begin(), encoder.end());
    for (const char* word :
         {"-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "iec61966-2-1", "-movflags", "+faststart", "-f", "mp4"})
        words.emplace_back(word);
    words.push_back("file:" + file.string());
    return words;
}

}  // namespace

bool ffmpeg_present() {
    try {
        return !run_ffmpeg({"-version"}).output.empty();
    } catch (const InputError&) {
        return false;
    }
}

bool write_video(const std::filesystem::path& pattern, uint32_t first, double pictures_per_second, const std::filesystem::path& file,
                 std::string& error) {
    const std::filesystem::path temporary =
        file.parent_path() / ("." + file.filename().string() + "." + std::to_string(getpid()) + ".part");
    std::error_code problem;
    try {
        std::vector<std::string> words{"-loglevel",
                                       "error",
                                       "-y",
                                       "-f",
                                       "image2",
                                       "-framerate",
                                       std::to_string(pictures_per_second),
                                       "-start_number",
                                       std::to_string(first),
                                       "-i",
                                       "file:" + pattern.string()};
        const std::vector<std::string> output = output_arguments(temporary);
        words.insert(words.end(), output.begin(), output.end());
        const ChildResult result = run_ffmpeg(words);
        error = describe_child_end(result, {});
        if (!error.empty()) error = "ffmpeg " + error;
        if (error.empty()) std::filesystem::rename(temporary, file, problem);
        if (problem) error = problem.message();
    } catch (const InputError& failure) {
        error = failure.what();
    }
    if (error.empty()) return true;
    error = file.string() + ": " + error;
    std::filesystem::remove(temporary, problem);
    return false;
}

}  // namespace trocar
