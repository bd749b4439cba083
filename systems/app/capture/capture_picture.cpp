#include "systems/app/capture/capture_picture.hpp"

#include "engine/files/image_file.hpp"
#include "systems/app/pictures/picture_writer.hpp"
#include "systems/frame/state.hpp"
#include "systems/output/surface_normals.hpp"
namespace trocar {

PictureSnapshot snapshot_of(const World& world) {
    PictureSnapshot snapshot;
    SurfaceNormalsScratch scratch;
    SurfaceNormals normals;
    compute_surface_normals(surfaces_of(world), scratch, normals);
    PictureLiquidScratch liquid;
    write_picture_snapshot(picture_inputs(world, normals, liquid), snapshot);
    return snapshot;
}

CaptureRecord picture_record(const PictureSnapshot& snapshot, const Meshes& meshes, const CaptureHeader& header, uint64_t pass) {
    PictureParams params;
    params.width = kCapturePictureWidth, params.height = kCapturePictureHeight;
    params.wireframe = header.wireframe, params.depth_colours = header.depth_colours;
    std::vector<std::byte> png;
    try {
        PictureWriter writer(params, header.camera, meshes, {});
        writer.take(snapshot);
        png = encode_png(writer.image());
    } catch (const std::exception&) {
        // the passes are what a capture is for
    }
    CaptureRecord record{"picture", {}};
    add_value(record, "pass", pass);
    record.arrays.push_back({"png", ArrayType::kU8, png.size(), 1, std::move(png)});
    return record;
}

CapturePicture read_picture(const CaptureRecord& record) {
    CapturePicture picture;
    read_value(record, "pass", picture.pass);
    read_value(record, "png", picture.png);
    return picture;
}

}  // namespace trocar
