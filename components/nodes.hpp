#pragma once
#include <array>
#include <limits>
#include <string>
#include <vector>

#include "components/entity.hpp"
#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

enum class NodeBehaviour : uint8_t {
    kNone,    // a frame and a switch
    kButton,  // moves along an axis against a spring
    kSlider,  // moves along an axis
    kDial,    // turns about an axis
};

enum class NodeEventKind : uint8_t { kPressed, kReleased, kLimit, kDetent, kCount };
struct NodeEvent {
    NodeEventKind kind = NodeEventKind::kPressed;
    double time = 0;        // s
    double coordinate = 0;  // m or rad, coordinate at that time
    TROCAR_FIELDS(kind, time, "s", coordinate);
};
inline constexpr uint32_t kKeptNodeEvents = 16;
// The last events of a driven body and the number of events of each kind.
struct NodeEvents {
    std::array<NodeEvent, kKeptNodeEvents> last{};  // event n at n % kKeptNodeEvents
    uint64_t total = 0;
    std::array<uint32_t, static_cast<size_t>(NodeEventKind::kCount)> count{};
    TROCAR_FIELDS(last, total, count);
};

// A free body whose node leaves it one degree of freedom: metres along the axis (button, slider) or radians
// about it (dial), 0 at the position given by the scene. Contact moves it. Constant after load.
struct NodeDrive {
    uint32_t node = kNone, body = kNone;
    NodeBehaviour behaviour = NodeBehaviour::kNone;
    Vec3d axis{0, 0, 1};           // unit, world
    Vec3d pivot = Vec3d::Zero();   // m, world: a point of a dial's axis; of a sliding body, its centre of mass at 0
    Vec3d origin = Vec3d::Zero();  // m, world, of the body at 0
    Quat orientation;              // of the body at 0
    double inertia = 0;            // kg, or kg m^2 about the axis
    double lowest = -std::numeric_limits<double>::infinity(), highest = std::numeric_limits<double>::infinity();  // m or rad
    double stiffness = 0, rest = 0;                             // N/m or N m/rad of the return spring; m or rad of its rest position
    double damping = 0;                                         // N s/m or N m s/rad
    double friction = 0;                                        // N or N m, Coulomb
    double detents = 0;                                         // per turn of a dial; one is at 0
    double detent = 0;                                          // N m, largest torque of a detent
    double click_at = std::numeric_limits<double>::infinity();  // m, a button beyond this counts as pressed ...
    double click_width = 0;                                     // m, ... and over this distance the spring force drops
    double click = 0;                                           // N, by this amount
    TROCAR_FIELDS(node, "index of nodes", body, "index of bodies", behaviour, axis, pivot, "m", origin, "m", orientation, inertia, "kg",
                  lowest, highest, stiffness, rest, damping, friction, detents, detent, "N m", click_at, "m", click_width, "m", click, "N");
};

struct DriveState {
    double coordinate = 0;        // m or rad
    double rate = 0;              // m/s or rad/s, half a step behind the position
    double friction_impulse = 0;  // N s or N m s, in the last substep
    double stop_impulse = 0;      // likewise, of the limits
    bool pressed = false;
    int32_t notch = 0;  // nearest detent
    int8_t limit = 0;   // -1, 1: at the lower, upper limit
    NodeEvents events;
    TROCAR_FIELDS(coordinate, rate, friction_impulse, stop_impulse, pressed, notch, limit, events);
};

// Enables or disables a node at a given time, when a button of a tool is pressed, or when a driven body
// reports an event.
struct NodeSwitch {
    uint32_t node = kNone;
    uint8_t to = 0;                                         // 0 = disabled, 1 = enabled, 2 = toggled
    double time = std::numeric_limits<double>::infinity();  // s
    uint32_t tool = kNone, buttons = 0;                     // bits
    uint32_t drive = kNone;
    NodeEventKind event = NodeEventKind::kPressed;
    TROCAR_FIELDS(node, "index of nodes", to, time, "s", tool, "index of tools or none", buttons, drive, "index of drives or none", event);
};

// Exchanges the instrument in a hand, at a given time or when a button is pressed.
struct ToolExchange {
    uint32_t from = kNone, to = kNone;                      // indices into tools
    double time = std::numeric_limits<double>::infinity();  // s
    uint32_t buttons = 0;                                   // bits
    TROCAR_FIELDS(from, "index of tools", to, "index of tools", time, "s", buttons);
};

// The scene nodes that bodies are attached to. Its frames are folded into the poses at load. Constant.
struct Nodes {
    std::vector<std::string> name;
    std::vector<uint32_t> parent;   // index of an earlier node, or kNone
    std::vector<uint32_t> of_body;  // per body: its node or kNone; empty without nodes
    std::vector<NodeDrive> drive;   // ascending by body
    std::vector<NodeSwitch> toggle;
    std::vector<ToolExchange> exchange;
    std::vector<std::array<uint32_t, 2>> apart;  // bodies (a < b, ascending) that do not collide: a driven body and
                                                 // its static surroundings
    TROCAR_FIELDS(name, parent, of_body, "index of nodes or none", drive, toggle, exchange, apart, "index of bodies");
};

struct NodeState {
    std::vector<uint8_t> enabled;    // per node: its own switch
    std::vector<uint8_t> laid_down;  // per tool: not in the hand; empty without exchanges
    std::vector<uint8_t> off;        // per body: excluded from contact, motion and pictures; empty without nodes and exchanges
    std::vector<uint64_t> seen;      // per switch, then per exchange: buttons pressed, or events so far, or 1 = its time has passed
    std::vector<DriveState> drive;   // as Nodes::drive
    TROCAR_FIELDS(enabled, laid_down, off, seen, drive);
};

inline bool is_off(const NodeState& state, uint32_t body) { return body < state.off.size() && state.off[body] != 0; }

}  // namespace trocar
