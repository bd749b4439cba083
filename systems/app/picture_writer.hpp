#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "components/picture.hpp"
#include "systems/render.hpp"
namespace trocar {

// Makes a folder and refuses early, with an InputError, when nothing can be written there.
void prepare_folder(const std::filesystem::path& folder);

// Removes frames/000000.png ... and film.mp4 of an earlier run from a folder, and nothing else.
void clear_pictures(const std::filesystem::path& folder);

// Draws pictures and keeps them as frames/000000.png ... and, where ffmpeg is there, as film.mp4 in a folder (none: it
// only draws). Used by one thread at a time.
class PictureWriter {
 public:
    PictureWriter(const PictureParams& params, const Camera& camera, const Meshes& meshes, const std::filesystem::path& out);
    // Returns the milliseconds of drawing and reading back; writing the file is not part of a frame. Draws the picture
    // again and again until `least_ms` have passed: a renderer that is slow by being busy, for stress tests.
    double take(const PictureSnapshot& snapshot, double least_ms = 0);
    // Draws without keeping: the first picture of a kind costs what shaders and textures cost.
    void warm_up(const PictureSnapshot& snapshot);
    // Makes the film from the files. Its name in the folder, empty if there is none; warns when it failed.
    std::string finish_film() const;
    const std::vector<std::string>& files() const { return files_; }

 private:
    void draw(const PictureSnapshot& snapshot);
    PictureParams params_;
    Camera camera_;
    std::filesystem::path out_;
    GlRenderer renderer_;
    RenderScratch scratch_;
    Image image_;
    bool placed_ = false, fitted_ = false;
    std::vector<std::string> files_;
};

}  // namespace trocar
