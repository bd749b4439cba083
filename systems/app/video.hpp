#pragma once
#include <filesystem>
#include <string>
namespace trocar {

// True when the program `ffmpeg` is found on PATH and runs.
bool ffmpeg_present();

// Writes a numbered PNG sequence as an .mp4 through the external program ffmpeg: H.264 (libx264, yuv420p) where it has it,
// else MPEG-4. Pattern as ffmpeg takes it ("out/frames/%06d.png"), first = number of the first. The file appears under its
// name when it is whole. False with one line of error. ffmpeg is in a process group of its own: Ctrl-C, which ends a run
// early, does not end its film.
bool write_video(const std::filesystem::path& pattern, uint32_t first, double pictures_per_second, const std::filesystem::path& file,
                 std::string& error);

}  // namespace trocar
