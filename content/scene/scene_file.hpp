#pragma once
#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "components/actions.hpp"
#include "components/bodies.hpp"
#include "components/device.hpp"
#include "components/fluid.hpp"
#include "components/hand_model.hpp"
#include "components/haptic_effect.hpp"
#include "components/haptic_surface.hpp"
#include "components/lens.hpp"
#include "components/paths.hpp"
#include "components/picture.hpp"
#include "components/scene.hpp"
#include "components/thread.hpp"
#include "components/tool.hpp"
#include "content/scene/attach_spec.hpp"
#include "content/scene/node_spec.hpp"
#include "content/scene/scatter.hpp"
#include "engine/tissue/heat.hpp"
namespace trocar {

// One [[body]] of a scene file.
struct BodySpec {
    std::string name;
    std::string node;   // parent frame; empty = the world
    uint32_t line = 0;  // in the scene file, for errors
    std::string shape;  // generated shape, used if `file` is empty
    uint32_t triangles = 10000;
    uint64_t seed = 1;
    std::string file;  // mesh file, relative to the scene file or to the working folder
    double scale = 1;  // m per file unit; 0 = guess (guess_unit)
    double size = 0;   // m, desired largest extent; 0 = unchanged
    Motion motion = Motion::kStatic;
    Vec3d position = Vec3d::Zero();  // m
    Quat orientation;
    bool file_origin = false;  // `position` and `path` place the origin of the file instead of the centroid
    std::string above;         // name of the body it is placed on top of, centred, `gap` above it
    double gap = 0.005;        // m
    AnchorFrame anchor_frame = AnchorFrame::kWorld;
    Tissue tissue;
    TissueLaw law = TissueLaw::kSprings;                            // solids
    Prony prony;                                                    // solids
    bool solid = false;                                             // filled with tetrahedra; false: a shell
    double cells = 12;                                              // solids: lattice cells along the largest extent
    double spacing = 0;                                             // m, solids: lattice spacing; 0 = from cells
    bool skin = false;                                              // solids: embed the given surface in the tetrahedra
    bool filled = false;                                            // solids with skin: boundary = "filled"
    bool bed = false;                                               // solids: elastic foundation, like a shell's
    std::string integrator = "leapfrog";                            // leapfrog | implicit | auto
    uint32_t iterations = 0;                                        // implicit: iterations of a step at most; 0 = usual
    double step = 0;                                                // s, largest step of this body; 0 = default
    double fixed_below = -1e300;                                    // m, vertices with lower rest z are fixed
    double thickness = 1e-3;                                        // m, sheets
    bool self_contact = false;                                      // the surface touches itself
    double mass = 0;                                                // kg; 0: hand 0.05, free by density
    Vec3d velocity = Vec3d::Zero();                                 // m/s, initial, of a free body's origin
    Vec3d spin = Vec3d::Zero();                                     // rad/s, initial, free, world axes
    std::vector<Keyframe> path;                                     // kinematic
    std::vector<std::string> apart;                                 // bodies excluded from collision
    std::array<float, 3> color{-1, -1, -1};                         // overrides the material's diffuse colour
    double break_strain = std::numeric_limits<double>::infinity();  // springs break above this strain
    HeatTissue heat;                                                // where instruments cauterise it
    uint32_t cut_capacity = 0;                                      // triangles that cuts may add; 0 = as many as there are
    std::vector<GroupSpec> groups;
    std::vector<TissueRegionSpec> regions;
    HapticSurface haptic;  // body < kNone: it has haptic surface properties of its own
    ScatterSpec scatter;   // count > 0: this body is one of that many copies
    uint32_t copy = 0;     // index of the copy
};

// One [[tool.jaw]]: a hand body that the grip rotates about an axis of the tool's body.
struct JawSpec {
    uint32_t line = 0;
    std::string body;
    ToolJaw jaw;  // its body is set when it is built
};

// One [[tool.action]]: what an instrument does when its hand tells it to.
struct ActionSpec {
    uint32_t line = 0;
    ToolAction action;                // its tool and times are set when it is built
    bool point_given = false;         // false: the tool's tip
    std::vector<double> at;           // s
    std::vector<std::string> bodies;  // that a cut parts, cautery heats or a needle sews
    std::string thread;               // of a suture
};

// One [[tool]]: a device that drives a hand body.
struct ToolSpec {
    std::string body;
    uint32_t line = 0;
    uint32_t dof = 3;        // 3: forces at a sphere at the tip; 6: force and torque on the whole body
    uint32_t points = 1000;  // dof = 6: approximate number of points in the point shell
    bool tip_given = false;  // false: a tip outside the mesh is moved into it
    // As it will be, but that with dof = 6 a damping < 0 is critical, and a surface_stiffness of 0 is 100 times coupling_stiffness; a
    // tip_radius of 0 is from the mesh.
    HandTool tool;
    std::string trace;  // recorded device trace; if empty, path
    std::vector<Keyframe> path;
    std::vector<HapticEffect> effects;
    std::vector<ToolExchangeSpec> exchanges;
    std::vector<JawSpec> jaws;
    std::vector<ActionSpec> actions;
};

// [fluid]: which bodies may be wet, and by what.
struct FluidSpec {
    uint32_t line = 0;  // 0: not in the scene
    FluidParams params;
    bool gravity_given = false;       // false: the scene's
    std::vector<std::string> bodies;  // empty: all that can be
    uint32_t drops = 2000;
};

// One [[wound]].
struct WoundSpec {
    uint32_t line = 0;
    std::string name, body;
    Vec3d place = Vec3d::Zero();  // m, world, at load
    double radius = 0;            // m
    double rate = 0;              // m^3/s; 0 = by Poiseuille's law from
    double pressure = 0;          // Pa, over
    double length = 0;            // m, of a vessel of
    double diameter = 0;          // m
    double from = 0;              // s
    double until = std::numeric_limits<double>::infinity();
};

// One [[thread]].
struct ThreadSpec {
    uint32_t line = 0;
    Thread thread;                // without its tool and its rows
    std::string tool;             // body of the tool that holds its needle, or empty
    Vec3d end = Vec3d::Zero();    // m, frame of that body: where the thread hangs
    bool end_given = false;       // false: the tool's tip
    std::vector<Vec3d> path;      // m, world: from the first end; the needle's end follows
    bool fixed = false;           // the first end stays where it is
    double grip = 2000;           // N/m, of what holds an end
    uint32_t bites = 32;          // for which there is room
};

// One entry of [parameters]: other keys use its value by writing "$name"; --set name=value changes it.
struct SceneParameter {
    std::string name;
    std::string value;  // in TOML syntax
};

struct SceneFile {
    std::filesystem::path path;
    std::vector<SceneParameter> parameters;
    SceneSettings settings;
    uint32_t contact_rate = 60;  // Hz, contact passes per simulated second
    std::vector<NodeSpec> nodes;
    std::vector<BodySpec> bodies;
    std::vector<ToolSpec> tools;
    std::vector<LinkSpec> links;
    std::vector<CutSpec> cuts;
    FluidSpec fluid;
    std::vector<WoundSpec> wounds;
    std::vector<ThreadSpec> threads;
    uint32_t staples = 0;  // room for links created by the program while the scene runs
    Camera camera;
    std::string camera_body;   // that holds it, or empty
    uint32_t camera_line = 1;  // of [camera]
    Lenses lenses;             // of the camera, without its body
    PictureParams picture;
};

// One --set key=value: `seconds=2`, `contact.cell_edges=3`, `liver.tissue.youngs_modulus=2e4`,
// `a.file=kidney.wrl`. The first word is a top-level key or table, a key of [parameters], the name of a body
// (scattered copies by the name before the number), or `body` for every deformable body. Tools are named by
// their body as `tool.BODY.key`; links, staples, cuts and nodes by their name as `link.NAME.key`.
struct Override {
    std::string key;
    std::string value;
};

// Reads and checks a scene. Throws InputError "file:line:column: reason"; suggests similar keys for unknown
// ones.
SceneFile read_scene_file(const std::filesystem::path& path, const std::vector<Override>& overrides = {});

// The same for the text of a scene. `path` is what errors call it; files that it names are looked for beside that.
SceneFile read_scene_text(const std::string& text, const std::filesystem::path& path, const std::vector<Override>& overrides);

// The text of a scene file with keys changed, without its comments. Throws InputError as read_scene_file does.
std::string scene_text_with(const std::filesystem::path& path, const std::vector<Override>& overrides);

// Throws InputError "file:line:1: reason" about a table of the scene, for errors found only by building it.
[[noreturn]] void refuse(const SceneFile& scene, uint32_t line, const std::string& reason);

}  // namespace trocar
