#pragma once
#include <array>
#include <limits>
#include <vector>

#include "components/entity.hpp"
#include "components/fields.hpp"
#include "components/math.hpp"
#include "components/mesh.hpp"
namespace trocar {

enum class ActionKind : uint8_t {
    kStaple,  // joins the two nearest surfaces at its point
    kCut,     // parts the surfaces that its edge sweeps through
    kIrrigate,  // lets water out at its point
    kSuck,      // takes in liquid near its point
};

enum class ActionTrigger : uint8_t {
    kButton,  // while one of `buttons` is pressed
    kGrip,    // while the grip is closed beyond `grip`
    kForce,   // while contact presses the hand with more than `force`
    kTimes,   // a staple: at each of `times`; a cut: from the first to the second, from the third to the fourth, ...
    kAlways,
};

// What an instrument does when its hand tells it to. Constant after load.
struct ToolAction {
    uint32_t tool = kNone;
    ActionKind kind = ActionKind::kStaple;
    ActionTrigger when = ActionTrigger::kButton;
    uint32_t buttons = 1;         // bits
    double grip = 0;              // rad
    double force = 0;             // N
    Range times;                  // range of Actions::time
    Vec3d point = Vec3d::Zero();  // m, frame of the tool's body: where it acts; of a cut one end of the edge
    Vec3d edge = Vec3d::Zero();   // m, frame of the tool's body: the other end of the edge
    // staples
    double reach = 0.01;                                        // m, farthest surface from the point
    double press = 0;                                           // N, of contact that it takes at least
    double stiffness = 0;                                       // N/m; 0 = four times the springs of what it holds
    double pull_out = std::numeric_limits<double>::infinity();  // N, that a staple bears
    uint32_t magazine = 20;                                     // staples that there are
    // cuts
    double toughness = 0;  // J/m^2, work per area of the new surface, Gc
    // irrigation and suction; within reach of a nozzle it sucks
    double rate = 0;                     // m^3/s
    double bore = 3e-3;                  // m, diameter of the jet
    Vec3d direction{0, 0, -1};           // unit, frame of the tool's body: of the jet
    TROCAR_FIELDS(tool, "index of tools", kind, when, buttons, grip, "rad", force, "N", times, "range of action times", point, "m", edge,
                  "m", reach, "m", press, "N", stiffness, "N/m", pull_out, "N", magazine, toughness, "J/m^2", rate, "m^3/s", bore, "m", direction);
};

// A shell or sheet that instruments may cut; its prototype is not shared, and has elements reserved at load.
struct CutBody {
    uint32_t body = kNone;
    Range vertices;        // of CutSurfaces::position and goal: those reserved; as many elements of the prototype
    Range triangles;       // of CutSurfaces::triangle, uv and material, likewise
    uint32_t edges = 0;    // reserved elements of the prototype
    uint32_t columns = 0;  // reserved columns of its springs
    double thickness = 0;  // m, height of the new surface on each side of a cut
    double edge = 0;       // m, mean edge at load
    double lightest = 0;   // 1/m^2, largest number of springs at a vertex at load / its area: springs of a smaller one are softened
    Admission whole = Admission::kSheet;  // of the surface at load
    TROCAR_FIELDS(body, "index of bodies", vertices, "range of cut vertices", triangles, "range of cut triangles", edges, columns,
                  thickness, "m", edge, "m", lightest, "1/m^2", whole);
};

// Constant after load.
struct Actions {
    std::vector<ToolAction> action;
    std::vector<double> time;                   // s, ascending within an action
    std::vector<CutBody> cut_body;              // ascending by body
    std::vector<std::array<uint32_t, 2>> cuts;  // index into action, index into cut_body: what each edge cuts
    TROCAR_FIELDS(action, time, "s", cut_body, cuts);
};

// What one action has done so far.
struct ActionProgress {
    bool on = false;             // as seen in the last pass
    uint32_t next = 0;           // kTimes: times that have come
    uint64_t done = 0;           // staples set; strokes that cut, from one pull of the trigger to its end
    uint64_t misfires = 0;       // staples that found no two surfaces, not enough force or an empty magazine
    uint64_t pulled_out = 0;     // staples that were pulled out
    double largest_force = 0;    // N, on a staple, mean over a pass
    uint64_t refused = 0;        // passes whose cut found no reserved elements left
    double area = 0;             // m^2, of the new surface on one side
    double work = 0;             // J, that it took
    double owed = 0;             // J, of it that the tool's motion has not given yet
    bool stroke = false;         // something was cut since the trigger was pulled
    bool swept = false;          // the edge was moved in the last pass, from
    Vec3d from = Vec3d::Zero();  // m, world: point
    Vec3d from_edge = Vec3d::Zero();
    TROCAR_FIELDS(on, next, done, misfires, pulled_out, largest_force, "N", refused, area, "m^2", work, "J", owed, "J", stroke, swept, from,
                  "m", from_edge, "m");
};

// A staple that an action set.
struct ToolStaple {
    uint32_t action = 0;
    Entity group;           // of links
    Vec3d across{1, 0, 0};  // unit, world, of its crown when it was set
    TROCAR_FIELDS(action, "index of actions", group, across);
};

// Present surfaces of the bodies that may be cut, in the frames of their prototypes at rest. Elements beyond the counts are unused.
struct CutSurfaces {
    std::vector<std::array<uint32_t, 2>> count;  // one per cut body: vertices, triangles
    std::vector<Vec3d> position;                 // m
    std::vector<Vec3> goal;                      // m, of the anchor, as in Anchors
    std::vector<Triangle> triangle;
    std::vector<std::array<Vec2, 3>> uv;
    std::vector<uint16_t> material;
    // Edges that are cut, but still closed, because an end of theirs is a tip of the cut: index into cut_body and both vertices.
    std::vector<std::array<uint32_t, 3>> slit;
    // Vertices at which a cut may go on: index into cut_body, vertex, index into action.
    std::vector<std::array<uint32_t, 3>> front;
    TROCAR_FIELDS(count, position, "m", goal, "m", triangle, uv, material, slit, front);
};

struct ActionState {
    std::vector<ActionProgress> progress;  // one per action
    std::vector<ToolStaple> staple;        // in the order in which they were set
    CutSurfaces cut;
    TROCAR_FIELDS(progress, staple, cut);
};

}  // namespace trocar
