#pragma once
#include "components/picture.hpp"
#include "engine/gl_renderer.hpp"
#include "engine/smooth_edges.hpp"
namespace trocar {

struct RenderScratch {
    std::vector<Marker> markers;
    std::vector<GroundShadow> shadows;
    Ground ground;
    SmoothEdgesScratch smooth;
};

// Aims an orbit camera at the middle of a world box, keeps its direction, backs off until the box's corners just stay
// in the picture, and lays the floor under the box. Done once, not per picture, so that the view does not breathe with
// the tissue. Other cameras and empty boxes are left alone.
void fit_camera(const Box& box, uint32_t width, uint32_t height, Camera& camera);

// The same for a whole snapshot: its deformable and free bodies fill the picture with room for what comes near them, and what
// is held still or guided (floors, instruments) may run out of it. Without such bodies what scripts, joints and hands move is
// fitted, without those everything.
// `margin` pixels at the left and at the right edge stay free of them.
void fit_camera(const PictureSnapshot& snapshot, uint32_t width, uint32_t height, Camera& camera, uint32_t margin = 0);

// Backs a camera that fit_camera has placed off, keeping its direction, until the deformable and free bodies stay in the
// picture; never comes nearer. Bodies that have fallen below its floor or left it are let go.
void keep_in_picture(const PictureSnapshot& snapshot, uint32_t width, uint32_t height, Camera& camera, uint32_t margin = 0);

// Pixels at the right edge that the legend takes; 0 when there is none.
uint32_t legend_width(const PictureParams& params);

// Lays the floor under everything in a snapshot, around the bodies that fit_camera would fit, for a
// camera that was placed by hand. fit_camera does the same.
void lay_floor(const PictureSnapshot& snapshot, Camera& camera);

// Camera to matrices. near and far planes enclose the world box.
View make_view(const Camera& camera, const Box& box, uint32_t width, uint32_t height);

// Draws a snapshot as the camera sees it, with markers, legend and text as params ask. One picture, sRGB, opaque, rows
// top to bottom; the same bytes every time.
void render_picture(const PictureParams& params, const Camera& camera, const PictureSnapshot& snapshot, GlRenderer& renderer,
                    RenderScratch& scratch, Image& out);

}  // namespace trocar
