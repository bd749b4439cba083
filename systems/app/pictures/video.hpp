#pragma once
#include <filesystem>
#include <string>
namespace trocar {

// True when the program `ffmpeg` is found on PATH and runs.
bool ffmpeg_present();

// Writes a numbered PNG sequence as an .mp4 through the external program ffmpeg: H.264 (libx264, yuv420p) if
// available, else MPEG-4. Pattern as ffmpeg takes it ("out/frames/%06d.png"), first = number of the first picture. The
// file gets its name once complete. False with one line of error. ffmpeg has its own process group, so that Ctrl-C
// ends a run early but not its film.
bool write_video(const std::filesystem::path& pattern, uint32_t first, double pictures_per_second, const std::filesystem::path& file,
                 std::string& error);

}  // namespace trocar
