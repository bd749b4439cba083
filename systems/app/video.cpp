#include "systems/app/video.hpp"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <vector>

extern char** environ;

namespace trocar {
namespace {

struct Child {
    int process = -1;
    int input = -1;
    int log = -1;
};

// Starts ffmpeg; what it prints goes to a file in memory. A socket stands in for the pipe of its standard input because
// writing to it after ffmpeg's death can be told not to raise SIGPIPE. Returns an error number, 0 = started.
int start_ffmpeg(const std::vector<std::string>& arguments, bool with_input, Child& child) {
    std::vector<char*> words{const_cast<char*>("ffmpeg")};
    for (const std::string& argument : arguments) words.push_back(const_cast<char*>(argument.c_str()));
    words.push_back(nullptr);
    int ends[2] = {-1, -1};
    if (with_input && socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) return errno;
    if (!with_input) ends[0] = open("/dev/null", O_RDONLY | O_CLOEXEC);
    child.log = memfd_create("ffmpeg", MFD_CLOEXEC);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, ends[0], STDIN_FILENO);
    posix_spawn_file_actions_adddup2(&actions, child.log, STDOUT_FILENO);
    posix_spawn_file_actions_adddup2(&actions, child.log, STDERR_FILENO);
    posix_spawnattr_t attributes;
    posix_spawnattr_init(&attributes);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);  // a group of its own, out of reach of Ctrl-C
    const int problem = posix_spawnp(&child.process, "ffmpeg", &actions, &attributes, words.data(), environ);
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&actions);
    close(ends[0]);
    child.input = ends[1];
    if (problem == 0) return 0;
    if (ends[1] >= 0) close(ends[1]);
    close(child.log);
    child = {};
    return problem;
}

// Waits for the end; true when it ended with code 0.
bool wait_for(int process) {
    int status = 0;
    while (waitpid(process, &status, 0) < 0)
        if (errno != EINTR) return false;
    return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

std::string read_log(int log) {
    std::string text;
    char part[4096];
    lseek(log, 0, SEEK_SET);
    for (ssize_t got; (got = read(log, part, sizeof part)) > 0;) text.append(part, static_cast<size_t>(got));
    return text;
}

// The last line that says something: ffmpeg names the cause there.
std::string last_line(const std::string& text) {
    const size_t end = text.find_last_not_of(" \r\n");
    if (end == std::string::npos) return "ended without a reason";
    const size_t begin = text.find_last_of("\r\n", end);
    return text.substr(begin == std::string::npos ? 0 : begin + 1, end - (begin == std::string::npos ? 0 : begin + 1) + 1);
}

std::string start_problem(int problem) {
    return problem == ENOENT ? "the program ffmpeg is not on PATH" : std::string("ffmpeg: ") + std::strerror(problem);
}

// Output of a short run of ffmpeg; empty when it is not there or fails.
std::string ask_ffmpeg(const std::vector<std::string>& arguments) {
    Child child;
    if (start_ffmpeg(arguments, false, child) != 0) return {};
    const bool good = wait_for(child.process);
    std::string answer = good ? read_log(child.log) : std::string();
    close(child.log);
    return answer;
}

// A colour matrix that players assume for any size, tags that say so, and even sides, which 4:2:0 needs.
std::vector<std::string> output_arguments(const std::filesystem::path& file) {
    const bool h264 = ask_ffmpeg({"-hide_banner", "-encoders"}).find("libx264") != std::string::npos;
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

std::filesystem::path temporary_name(const std::filesystem::path& file) {
    return file.parent_path() / ("." + file.filename().string() + "." + std::to_string(getpid()) + ".part");
}

std::string rate_text(double rate) { return std::to_string(rate); }

}  // namespace

bool ffmpeg_present() { return !ask_ffmpeg({"-hide_banner", "-version"}).empty(); }

VideoWriter::VideoWriter(std::filesystem::path file, uint32_t width, uint32_t height, double pictures_per_second)
    : file_(std::move(file)), temporary_(temporary_name(file_)), width_(width), height_(height) {
    std::vector<std::string> words = {"-hide_banner",
                                      "-loglevel",
                                      "error",
                                      "-y",
                                      "-f",
                                      "rawvideo",
                                      "-pixel_format",
                                      "rgba",
                                      "-video_size",
                                      std::to_string(width) + "x" + std::to_string(height),
                                      "-framerate",
                                      rate_text(pictures_per_second),
                                      "-i",
                                      "pipe:0"};
    const std::vector<std::string> output = output_arguments(temporary_);
    words.insert(words.end(), output.begin(), output.end());
    Child child;
    const int problem = start_ffmpeg(words, true, child);
    child_ = child.process;
    input_ = child.input;
    log_ = child.log;
    found_ = problem != ENOENT;
    if (problem != 0) error_ = file_.string() + ": " + start_problem(problem);
}

VideoWriter::~VideoWriter() {
    if (input_ >= 0) close(input_);
    if (child_ >= 0) {
        kill(child_, SIGKILL);
        wait_for(child_);
    }
    if (log_ >= 0) close(log_);
    std::error_code ignored;
    if (!finished_) std::filesystem::remove(temporary_, ignored);
}

bool VideoWriter::fail(const std::string& reason) {
    if (error_.empty()) error_ = file_.string() + ": " + reason;
    return false;
}

bool VideoWriter::add(const Image& picture) {
    if (!error_.empty()) return false;
    if (finished_) return fail("the video is finished");
    if (picture.width != width_ || picture.height != height_ || picture.rgba.size() != size_t{4} * picture.width * picture.height)
        return fail("a picture of another size than the video");
    for (size_t sent = 0; sent < picture.rgba.size();) {
        const ssize_t more = send(input_, picture.rgba.data() + sent, picture.rgba.size() - sent, MSG_NOSIGNAL);
        if (more < 0 && errno == EINTR) continue;
        if (more < 0) {
            // it went away: its own words say why
            wait_for(child_);
            child_ = -1;
            return fail("ffmpeg: " + last_line(read_log(log_)));
        }
        sent += static_cast<size_t>(more);
    }
    return true;
}

bool VideoWriter::finish() {
    if (!error_.empty()) return false;
    if (finished_) return true;
    close(input_);
    input_ = -1;
    const bool good = wait_for(child_);
    child_ = -1;
    if (!good) return fail("ffmpeg: " + last_line(read_log(log_)));
    std::error_code problem;
    std::filesystem::rename(temporary_, file_, problem);
    if (problem) return fail(problem.message());
    finished_ = true;
    return true;
}

bool write_video(const std::filesystem::path& pattern, uint32_t first, double pictures_per_second, const std::filesystem::path& file,
                 std::string& error) {
    const std::filesystem::path temporary = temporary_name(file);
    std::vector<std::string> words = {"-hide_banner",
                                      "-loglevel",
                                      "error",
                                      "-y",
                                      "-f",
                                      "image2",
                                      "-framerate",
                                      rate_text(pictures_per_second),
                                      "-start_number",
                                      std::to_string(first),
                                      "-i",
                                      "file:" + pattern.string()};
    const std::vector<std::string> output = output_arguments(temporary);
    words.insert(words.end(), output.begin(), output.end());
    Child child;
    const int problem = start_ffmpeg(words, false, child);
    if (problem != 0) {
        error = file.string() + ": " + start_problem(problem);
        return false;
    }
    std::error_code failure;
    const bool good = wait_for(child.process);
    error = good ? "" : file.string() + ": ffmpeg: " + last_line(read_log(child.log));
    close(child.log);
    if (good) {
        std::filesystem::rename(temporary, file, failure);
        if (failure) error = file.string() + ": " + failure.message();
    }
    if (!error.empty()) std::filesystem::remove(temporary, failure);
    return error.empty();
}

}  // namespace trocar
