#pragma once
#include "components/picture.hpp"
#include "engine/gl_renderer.hpp"
namespace trocar {

struct RenderScratch {
    std::vector<Marker> markers;
    Ground ground;
};

// Aims an orbit camera at the middle of a world box and backs off until the box's sphere fills the picture (height /
// width decides which way it binds). Other cameras and empty boxes are left alone.
void fit_camera(const Box& box, uint32_t width, uint32_t height, Camera& camera);

// Camera to matrices. near and far planes enclose the world box.
View make_view(const Camera& camera, const Box& box, uint32_t width, uint32_t height);

// Draws a snapshot as the camera sees it, with markers, legend and text as params ask. One picture, sRGB, opaque, rows
// top to bottom; the same bytes every time.
void render_picture(const PictureParams& params, const Camera& camera, const PictureSnapshot& snapshot,
                    GlRenderer& renderer, RenderScratch& scratch, Image& out);

}  // namespace trocar
