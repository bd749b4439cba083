#pragma once
#include <array>
#include <memory>
#include <span>
#include <vector>

#include "components/mesh.hpp"
#include "components/picture.hpp"
#include "engine/draw/ground_shade.hpp"
#include "engine/draw/marker_mesh.hpp"
namespace trocar {

// Column-major, as in OpenGL.
using Matrix4 = std::array<float, 16>;

// Camera of a draw call. Everything is relative to `eye` (double, world), so floats stay precise far from the
// origin.
struct View {
    Vec3d eye = Vec3d::Zero();
    Matrix4 view_projection{};                      // of points relative to eye
    std::array<float, 3> forward{}, right{}, up{};  // unit, world axes
    std::array<float, 3> sky{};                     // unit, against gravity
    Vec3d liquid_up{0, 0, 1};                       // unit, against gravity as liquids have it
    float tan_x = 1, tan_y = 1;                     // of half the field of view
    float near_plane = 0, far_plane = 0;            // m
    bool light_at_eye = false;                      // laparoscope: one light beside the lens, quadratic fall-off, round mask
    float light_distance = 0.1f;                    // m, where the light at the eye has its nominal brightness
    std::array<float, 3> lamp{};                    // m, world axes, from the eye: that light
    uint32_t hidden = kNone;                        // body that is not drawn: the one that holds the camera
};

// Floor: a disc that fades into the background.
struct Ground {
    bool on = false;
    Vec3d centre = Vec3d::Zero();   // m, world
    Vec3d axis_x = Vec3d::UnitX();  // unit, in the plane
    Vec3d axis_y = Vec3d::UnitY();
    double radius = 0;  // m
    GroundShade shade;
};

// Draws triangle meshes into memory with OpenGL. Static data (indices, texture coordinates, rest shapes,
// textures) are uploaded once per prototype; per picture only positions and normals of deformable bodies.
// Keeps its own context; may be used by any one thread at a time. The same calls give the same bytes for any
// number of Mesa threads.
class GlRenderer {
 public:
    // Throws InputError if no context is available. The meshes must outlive the renderer and stay unchanged
    // while it draws; a prototype is uploaded when a body of it is first drawn.
    explicit GlRenderer(const Meshes& meshes);
    ~GlRenderer();
    GlRenderer(const GlRenderer&) = delete;
    GlRenderer& operator=(const GlRenderer&) = delete;

    // Draws and reads back; out has params.width x params.height pixels, rows top to bottom, opaque. Text and legend
    // are not drawn here.
    void draw(const PictureParams& params, const View& view, const PictureSnapshot& snapshot, std::span<const Marker> markers,
              const Ground& ground, Image& out);

 private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace trocar
