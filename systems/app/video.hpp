#pragma once
#include <filesystem>
#include <string>

#include "components/mesh.hpp"
namespace trocar {

// True when the program `ffmpeg` is found on PATH.
bool ffmpeg_present();

// Writes pictures of one size to an .mp4 through the external program ffmpeg: H.264 (libx264, yuv420p) where it has it,
// else MPEG-4. The file appears under its name when finish() has succeeded, never before and never in part. Every call
// returns false once something failed; error() is then one line. ffmpeg is in a process group of its own: Ctrl-C, which
// ends a run early, does not end its film. ffmpeg works beside us while pictures arrive: where a
// haptic thread runs, write the pictures first and the video afterwards.
class VideoWriter {
 public:
    VideoWriter(std::filesystem::path file, uint32_t width, uint32_t height, double pictures_per_second);
    ~VideoWriter();  // without finish(): stops ffmpeg and removes what it wrote
    VideoWriter(const VideoWriter&) = delete;
    VideoWriter& operator=(const VideoWriter&) = delete;
    bool add(const Image& picture);
    bool finish();
    bool ffmpeg_found() const { return found_; }
    const std::string& error() const { return error_; }

 private:
    bool fail(const std::string& reason);
    std::filesystem::path file_, temporary_;
    uint32_t width_ = 0, height_ = 0;
    int child_ = -1;  // process
    int input_ = -1;  // its standard input
    int log_ = -1;    // what it says
    bool finished_ = false, found_ = true;
    std::string error_;
};

// The same from a numbered PNG sequence: pattern as ffmpeg takes it ("out/frames/%06d.png"), first = number of the
// first.
bool write_video(const std::filesystem::path& pattern, uint32_t first, double pictures_per_second, const std::filesystem::path& file,
                 std::string& error);

}  // namespace trocar
