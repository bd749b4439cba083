#include "systems/app/pictures/picture_writer.hpp"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <string>

#include "engine/base/error.hpp"
#include "engine/files/image_file.hpp"
#include "engine/jobs/trace.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/console/progress.hpp"
#include "systems/app/pictures/video.hpp"
namespace trocar {
namespace fs = std::filesystem;
namespace {

constexpr double kFilmRate = 30;  // pictures per second of simulated time

}  // namespace

void prepare_folder(const std::filesystem::path& folder) {
    std::error_code error;
    fs::create_directories(folder, error);
    if (error) throw InputError(folder.string() + ": cannot be made (" + error.message() + ")");
    const fs::path probe = folder / ".trocar_probe";
    {
        std::ofstream stream(probe);
        if (!stream || !(stream << "x").flush()) throw InputError(folder.string() + ": cannot be written (" + std::strerror(errno) + ")");
    }
    fs::remove(probe, error);
}

void clear_pictures(const fs::path& folder) {
    std::error_code error;
    for (const fs::directory_entry& old : fs::directory_iterator(folder / "frames", error)) {
        const std::string name = old.path().filename().string();
        if (name.find_first_not_of("0123456789") == 6 && name.substr(6) == ".png") fs::remove(old.path(), error);
    }
    fs::remove(folder / "film.mp4", error);
}

PictureWriter::PictureWriter(const PictureParams& params, const Camera& camera, const Meshes& meshes, const fs::path& out)
    : params_(params), camera_(camera), out_(out), renderer_(meshes) {
    if (out_.empty()) return;
    prepare_folder(out_ / "frames");
    clear_pictures(out_);  // left by an earlier, longer run
}

void PictureWriter::draw(const PictureSnapshot& snapshot) {
    if (!placed_) {
        fitted_ = fitted_ || camera_.distance <= 0;
        if (fitted_)
            fit_camera(snapshot, params_.width, params_.height, camera_, legend_width(params_));
        else
            lay_floor(snapshot, camera_);
        placed_ = true;
    }
    if (fitted_) keep_in_picture(snapshot, params_.width, params_.height, camera_, legend_width(params_));
    render_picture(params_, camera_, snapshot, renderer_, scratch_, image_);
}

void PictureWriter::warm_up(const PictureSnapshot& snapshot) {
    draw(snapshot);
    placed_ = false;
}

double PictureWriter::take(const PictureSnapshot& snapshot, double least_ms) {
    const uint64_t start = now_ns();
    double ms = 0;
    do {
        draw(snapshot);
        ms = static_cast<double>(now_ns() - start) * 1e-6;
    } while (ms < least_ms);
    if (out_.empty()) return ms;
    files_.push_back(format("frames/%06zu.png", files_.size()));
    save_png(image_, out_ / files_.back());
    return ms;
}

std::string PictureWriter::finish_film() const {
    if (files_.empty() || !ffmpeg_present()) return "";
    Progress progress("Film");
    progress.show(0, std::to_string(files_.size()) + " pictures");
    std::string error;
    if (write_video(out_ / "frames" / "%06d.png", 0, kFilmRate, out_ / "film.mp4", error)) return "film.mp4";
    std::fprintf(stderr, "trocar: warning: no film: %s\n", error.c_str());
    return "";
}

}  // namespace trocar
