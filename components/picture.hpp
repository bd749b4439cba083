#pragma once
#include <array>
#include <vector>

#include "components/fields.hpp"
#include "components/math.hpp"
#include "components/mesh.hpp"
namespace trocar {

// Unit vertex normals of deformable bodies, body axes = world axes. Indexed like Particles; zero at a vertex
// without a triangle of positive area. Derived at the display rate.
struct SurfaceNormals {
    std::vector<Vec3> normal;
    TROCAR_FIELDS(normal);
};

enum class PictureMotion : uint8_t {
    kStill,   // never moves
    kGuided,  // rigid, by a script, a joint or a hand
    kFree,    // rigid, by forces
    kSoft,    // deformable
};

// One body as drawn. World point = origin + orientation * point of the body's frame.
struct PictureBody {
    uint32_t mesh = kNone;         // prototype; kNone = not drawn
    Vec3d origin = Vec3d::Zero();  // m, world
    Quat orientation;              // identity for a deformable body: its offsets have world axes
    PictureMotion motion = PictureMotion::kStill;
    Box box;         // m, body frame
    Range vertices;  // range of position and normal; empty for a rigid body, drawn in its rest shape
    Range depths;    // range of contact_depth, one per vertex; empty without contact
    Range removed;   // range of removed
    Range exposed;   // range of exposed
    Range inner;     // range of exposed: the new surface inside a solid that was cut, in the last material of its prototype
    Range burnt;     // range of burnt, one per vertex; empty where nothing coagulated
    Range liquid;    // range of liquid, one per vertex; empty where the body is dry
    TROCAR_FIELDS(mesh, origin, "m", orientation, motion, box, "m", vertices, depths, removed, exposed, inner, burnt, liquid);
};

// The deepest point of one overlapping pair.
struct PictureWitness {
    Vec3d point = Vec3d::Zero();    // m, world
    Vec3d closest = Vec3d::Zero();  // m, world, on the other surface
    double depth = 0;               // m
    TROCAR_FIELDS(point, "m", closest, "m", depth, "m");
};

// One hand tool.
struct PictureTool {
    Vec3d device = Vec3d::Zero();  // m, world: tip position commanded by the hand
    Vec3d proxy = Vec3d::Zero();   // m, world: tip kept outside the surface; equals device without contact
    double radius = 0;             // m, of the tip
    Vec3d force = Vec3d::Zero();   // N, on the hand
    uint32_t body = kNone;
    TROCAR_FIELDS(device, "m", proxy, "m", radius, "m", force, "N", body);
};

// A small sphere beside the surfaces.
struct PicturePoint {
    Vec3d position = Vec3d::Zero();  // m, world
    double radius = 0;               // m
    std::array<float, 3> colour{};   // linear
    TROCAR_FIELDS(position, "m", radius, "m", colour);
};

// Smoke: a cloud of Gaussian density.
struct PicturePuff {
    Vec3d position = Vec3d::Zero();  // m, world
    double spread = 0;               // m, standard deviation
    double extinction = 0;           // m^2, mass times extinction per mass
    TROCAR_FIELDS(position, "m", spread, "m", extinction, "m^2");
};

// A rod between two points, with round ends.
struct PictureRod {
    Vec3d from = Vec3d::Zero(), to = Vec3d::Zero();  // m, world
    double radius = 0;                               // m
    std::array<float, 3> colour{};                   // linear
    TROCAR_FIELDS(from, "m", to, "m", radius, "m", colour);
};

// Everything that a picture shows, copied once, so that the renderer never reads World. Immutable once
// published. Float positions are relative to each body's double-precision origin, so distance from the world
// origin costs no accuracy.
struct PictureSnapshot {
    uint64_t number = 0;               // of the picture
    double time = 0;                   // s
    std::vector<PictureBody> body;     // indexed like Bodies
    std::vector<Vec3> position;        // m, body frame
    std::vector<Vec3> normal;          // unit or zero, body frame
    std::vector<float> contact_depth;  // m, >= 0
    std::vector<Triangle> removed;     // triangles of the prototype removed by a cut, as vertices
    std::vector<Triangle> exposed;     // and those that the cut exposed
    std::vector<PictureWitness> witness;
    std::vector<PictureTool> tool;
    std::vector<PicturePoint> point;
    std::vector<PictureRod> rod;  // staples and threads
    std::vector<float> burnt;     // fraction of the tissue that coagulated, 0..1
    // Liquid on a vertex: thickness (m), height of its surface above the vertex (m), how level it stands (0..1), share of blood (0..1).
    std::vector<Float4> liquid;
    Vec3d up{0, 0, 1};              // unit, world, against gravity: of the liquid
    std::vector<PicturePuff> puff;  // smoke
    double depth = 0;               // m, deepest penetration; 0 when nothing overlaps
    double force = 0;               // N, largest force commanded to a hand
    double fog = 0;                 // fraction of its light that a fogged lens scatters, 0..1
    TROCAR_FIELDS(number, time, "s", body, position, "m", normal, contact_depth, "m", removed, exposed, witness, tool, point, rod, burnt,
                  liquid, up, puff, depth, "m", force, "N", fog);
};

enum class CameraKind : uint8_t {
    kOrbit,        // looks at target from distance
    kLaparoscope,  // at position, light beside the lens, round picture
};

// Viewpoint of a picture. Angles in radians.
struct Camera {
    CameraKind kind = CameraKind::kOrbit;
    Vec3d target = Vec3d::Zero();            // m, what it looks at (both kinds)
    Vec3d up = Vec3d::UnitZ();               // against gravity
    double azimuth = -1.1;                   // orbit: about up, counter-clockwise; 0 = seen from +x
    double elevation = 0.45;                 // orbit: above the horizon
    double distance = 0.5;                   // m, orbit
    Vec3d position = Vec3d(0, -0.15, 0.15);  // m, laparoscope
    double field_of_view = 0.6;              // vertical; laparoscopes have about 1.22
    double lamp = 0;                         // m, laparoscope: the light is so far above the lens, as seen in the picture
    // laparoscope that a body holds, such as a tool: `position` is in the frame of that body, `target` is not used
    uint32_t body = kNone;
    Vec3d shaft = Vec3d::UnitZ();  // unit, body frame: out of the tip
    Vec3d mark = Vec3d::UnitY();   // unit, body frame: up in the picture
    double optic = 0;              // of the direction of view against the shaft
    double optic_roll = 0;         // about the shaft: whereto that is, clockwise as seen from behind; 0 = towards the mark
    double roll = 0;               // of the camera head about the shaft, clockwise as seen from behind
    bool level = false;            // the head is held so that up in the picture is `up`, not the mark
    double light = 0.1;            // m, from the lens, where its light has its nominal brightness
    Vec3d floor = Vec3d::Zero();             // m, point of the floor in the middle of the scene
    double floor_radius = 0;                 // m, radius at which the floor has faded out; 0 = no floor
};

// What a picture shows besides the surfaces.
struct PictureParams {
    uint32_t width = 640;
    uint32_t height = 480;
    bool smooth_edges = true;  // post-process antialiasing
    bool wireframe = false;
    bool depth_colours = false;  // surfaces coloured by contact depth, with a legend
    double depth_scale = 0.010;  // m, depth at the top of the colour scale
    bool witnesses = true;       // arrow from the deepest point of each pair to the other surface
    bool tools = true;           // spheres at device and proxy
    bool text = true;            // time, depth, force
    bool ground = true;          // floor with soft shadows, only with an orbit camera
};

}  // namespace trocar
