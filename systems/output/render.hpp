#pragma once
#include "components/picture.hpp"
#include "engine/draw/fogged_picture.hpp"
#include "engine/draw/gl_renderer.hpp"
#include "engine/draw/smooth_edges.hpp"
namespace trocar {

struct RenderScratch {
    std::vector<Marker> markers;
    std::vector<GroundShadow> shadows;
    Ground ground;
    SmoothEdgesScratch smooth;
    FogScratch fog;
};

// Aims an orbit camera at the centre of a snapshot, keeps its direction, sets the distance and places the floor under it. Done once,
// not per picture, so that the view stays steady while tissue moves. Its deformable and free bodies fill the picture, with space
// for bodies that approach them; fixed and guided bodies (floors, instruments) may extend beyond it. Without such bodies the
// camera is fitted to those moved by scripts, joints and hands, and without these to everything. `margin` pixels at the left and
// right edges are kept free of them. Other cameras and empty snapshots leave the camera unchanged.
void fit_camera(const PictureSnapshot& snapshot, uint32_t width, uint32_t height, Camera& camera, uint32_t margin = 0);

// Moves a camera placed by fit_camera back, keeping its direction, until the deformable and free bodies are
// inside the picture; never nearer. Bodies that have fallen below its floor or left it are ignored.
void keep_in_picture(const PictureSnapshot& snapshot, uint32_t width, uint32_t height, Camera& camera, uint32_t margin = 0);

// Pixels at the right edge that the legend occupies; 0 without a legend.
uint32_t legend_width(const PictureParams& params);

// Places the floor under everything in a snapshot, around the bodies that fit_camera would fit, for a camera
// placed by hand. fit_camera does the same.
void lay_floor(const PictureSnapshot& snapshot, Camera& camera);

// Where a laparoscope that a body holds is in a snapshot, as one that stands there. Its view direction is turned by `optic` from
// the shaft. Another camera, or one whose body the snapshot does not have, as it is.
Camera placed_camera(const Camera& camera, const PictureSnapshot& snapshot);

// View matrices of a camera. The near and far planes enclose the world box.
View make_view(const Camera& camera, const Box& box, uint32_t width, uint32_t height);

// Draws a snapshot as seen by the camera, with the markers, legend and text selected in params. The body that holds it is not
// drawn, and what fogs its lens is before everything but text. One picture,
// sRGB, opaque, rows top to bottom; deterministic to the byte.
void render_picture(const PictureParams& params, const Camera& camera, const PictureSnapshot& snapshot, GlRenderer& renderer,
                    RenderScratch& scratch, Image& out);

}  // namespace trocar
