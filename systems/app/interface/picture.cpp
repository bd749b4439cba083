#include <cmath>

#include "systems/app/interface/handles.hpp"
namespace trocar {
namespace {

constexpr double kUsualFieldOfView = 0.6108652381980153;  // rad, 35 degrees: as of scenes

// Aims the scene's own camera as a run does: fitted once, then only moved back.
const Camera& scene_camera(const PictureParams& params, const PictureSnapshot& snapshot, Painter& painter) {
    const uint32_t legend = legend_width(params);
    if (!painter.placed) {
        painter.fitted = painter.camera.distance <= 0;
        if (painter.fitted)
            fit_camera(snapshot, params.width, params.height, painter.camera, legend);
        else
            lay_floor(snapshot, painter.camera);
        painter.placed = true;
    }
    if (painter.fitted) keep_in_picture(snapshot, params.width, params.height, painter.camera, legend);
    return painter.camera;
}

Camera own_camera(const trocar_picture& asked, const PictureParams& params, const PictureSnapshot& snapshot) {
    for (const double v : {asked.target[0], asked.target[1], asked.target[2], asked.distance, asked.azimuth, asked.elevation})
        if (!std::isfinite(v)) throw InputError("picture: not a finite number");
    if (!(asked.distance >= 0 && asked.field_of_view >= 0 && asked.field_of_view < 3.1))
        throw InputError("picture: distance or field_of_view");
    Camera camera;
    camera.target = vector_at(asked.target);
    camera.distance = asked.distance, camera.azimuth = asked.azimuth, camera.elevation = asked.elevation;
    camera.field_of_view = asked.field_of_view > 0 ? asked.field_of_view : kUsualFieldOfView;
    if (camera.distance > 0)
        lay_floor(snapshot, camera);
    else
        fit_camera(snapshot, params.width, params.height, camera, legend_width(params));
    return camera;
}

}  // namespace
}  // namespace trocar

using namespace trocar;

trocar_code trocar_draw(trocar_world* world, const trocar_picture* picture, uint8_t* rgb, size_t capacity, size_t* length) {
    return guarded([&] {
        trocar_world& w = needed(world, "world");
        const trocar_picture asked = taken(picture, "picture");
        PictureParams params = w.picture;
        if (asked.width > 0) params.width = asked.width;
        if (asked.height > 0) params.height = asked.height;
        if (params.width > 8192 || params.height > 8192) throw InputError("picture: more than 8192 pixels wide or high");
        if (asked.wireframe) params.wireframe = true;
        if (asked.depth_colours) params.depth_colours = true;
        if (asked.plain) params.witnesses = params.tools = params.text = false;
        const size_t bytes = size_t{3} * params.width * params.height;
        needed(length, "length") = bytes;
        if (bytes > capacity) {
            set_last_error("the buffer is too small for the picture");
            return TROCAR_TOO_SMALL;
        }
        needed(rgb, "rgb");
        on_threads([&] {
            const PictureSnapshot& snapshot = w.frame.snapshot_now();
            if (!w.painter) w.painter = std::make_unique<Painter>(w.frame.world().meshes), w.painter->camera = w.camera;
            const Camera own = asked.own_camera ? own_camera(asked, params, snapshot) : Camera{};
            const Camera& camera = asked.own_camera ? own : scene_camera(params, snapshot, *w.painter);
            render_picture(params, camera, snapshot, w.painter->renderer, w.painter->scratch, w.painter->image);
        });
        const std::vector<uint8_t>& rgba = w.painter->image.rgba;
        for (size_t i = 0; i < bytes / 3; ++i) std::copy_n(rgba.data() + 4 * i, 3, rgb + 3 * i);
        return TROCAR_OK;
    });
}
