#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "components/picture.hpp"
#include "systems/output/render.hpp"
namespace trocar {

// Creates a folder; throws InputError early if it is not writable.
void prepare_folder(const std::filesystem::path& folder);

// Removes frames/000000.png ... and film.mp4 of an earlier run, and nothing else.
void clear_pictures(const std::filesystem::path& folder);

// Draws pictures and stores them in a folder as frames/000000.png ... and, if ffmpeg is present, as film.mp4.
// Without a folder it only draws. Use from one thread at a time.
class PictureWriter {
 public:
    PictureWriter(const PictureParams& params, const Camera& camera, const Meshes& meshes, const std::filesystem::path& out);
    // Returns the ms of drawing and reading back; writing the file is not counted. Redraws the picture until
    // `least_ms` have passed: simulates a slow renderer for stress tests.
    double take(const PictureSnapshot& snapshot, double least_ms = 0);
    // Draws without storing: the first picture of a kind pays for shaders and textures.
    void warm_up(const PictureSnapshot& snapshot);
    // Makes the film from the files. Its name in the folder, empty if there is none; warns when it failed.
    std::string finish_film() const;
    const std::vector<std::string>& files() const { return files_; }
    const Image& image() const { return image_; }  // drawn last

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
