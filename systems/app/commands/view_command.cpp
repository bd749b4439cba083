#include <cmath>
#include <numbers>

#include "engine/base/error.hpp"
#include "engine/files/image_file.hpp"
#include "systems/app/commands/view_recording.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/console/load_file.hpp"
#include "systems/app/console/standard_streams.hpp"
#include "systems/app/pictures/mesh_picture.hpp"
namespace trocar {

int view_command(const ViewOptions& options) {
    if (options.sources.size() == 1 && is_recording(options.sources.front())) return view_recording(options);
    if (!options.scene.empty()) throw InputError("--scene is for one recording or folder of a run");
    if (options.out.empty()) throw InputError("--out PICTURE.png is needed");
    if (uint64_t(options.width) * options.height > kImagePixelLimit) {
        throw InputError("--size: more than " + std::to_string(kImagePixelLimit) + " pixels");
    }
    if (options.out.extension() != ".png") throw InputError(options.out.string() + ": the picture is a PNG; its name must end in .png");
    if (!std::isfinite(options.azimuth) || !std::isfinite(options.elevation)) {
        throw InputError("--azimuth and --elevation: finite degrees are needed");
    }
    std::vector<Mesh> meshes;
    std::vector<MeshTile> tiles;
    const double degree = std::numbers::pi / 180;
    for (const std::string& source : options.sources) {
        LoadedMesh loaded = load_file(source, options.roots);
        const uint32_t row = static_cast<uint32_t>(meshes.size());
        if (options.sheet) {
            for (MeshTile& tile : four_views(row)) tiles.push_back(std::move(tile));
        } else {
            tiles.push_back(
                {row, options.azimuth * degree, options.elevation * degree, options.sources.size() > 1 ? loaded.mesh.name : ""});
        }
        meshes.push_back(std::move(loaded.mesh));
    }
    MeshPictureParams params;
    params.width = options.width;
    params.height = options.height;
    params.up = options.up == 'x' ? Vec3d::UnitX() : options.up == 'y' ? Vec3d::UnitY() : Vec3d::UnitZ();
    params.wireframe = options.wireframe;
    params.sizes = options.sheet;
    save_png(draw_meshes(params, meshes, tiles), options.out);
    write_standard_output(options.out.string() + ": " + std::to_string(options.width) + " x " + std::to_string(options.height) + ", " +
                          std::to_string(meshes.size()) + (meshes.size() == 1 ? " mesh\n" : " meshes\n"));
    return kDone;
}

}  // namespace trocar
