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
    kStaple,     // joins the two nearest surfaces at its point
    kCut,        // parts the surfaces that its edge sweeps through
    kGrasp,      // holds what lies at its point: nodes of deformable bodies by links, free rigid bodies by friction
    kCauterise,  // heats the tissue at its point
    kIrrigate,   // lets water out at its point
    kSuck,       // takes in liquid and smoke near its point
    kSuture,     // sews with a needle: its point makes holes in surfaces, and the thread follows where `edge`, its blunt end, goes through
};

inline bool is_nozzle(ActionKind kind) { return kind == ActionKind::kIrrigate || kind == ActionKind::kSuck; }

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
    double bleeding = 0;   // m^3/s per m of the surface's new rim, of bodies that may be wet
    // grasps; reach and stiffness as of staples
    double press_force = 0;  // N, with which each of two jaws presses what lies between them
    double friction = 0;     // of the jaws: they bear 2 friction press_force, then what they hold slips; of a suture N/m, on its needle
    double pad = 0;          // m, radius of the pad of a jaw: both bear a torque of 4/3 friction press_force pad
    // cautery
    double power = 0;  // W, into the tissue
    double spot = 0;   // m, standard deviation of the Gaussian spot that it heats
    // irrigation and suction; within reach of a nozzle it sucks
    double rate = 0;            // m^3/s
    double bore = 3e-3;         // m, diameter of the jet
    Vec3d direction{0, 0, -1};  // unit, frame of the tool's body: of the jet
    TROCAR_FIELDS(tool, "index of tools", kind, when, buttons, grip, "rad", force, "N", times, "range of action times", point, "m", edge,
                  "m", reach, "m", press, "N", stiffness, "N/m", pull_out, "N", magazine, toughness, "J/m^2", bleeding, "m^2/s",
                  press_force, "N", friction, pad, "m", power, "W", spot, "m", rate, "m^3/s", bore, "m", direction);
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

// A solid that instruments may cut. Its surface is that of its lattice of tetrahedra. Its prototype is not shared, and has
// elements reserved at load: see engine/tissue/lattice_cut.hpp.
struct CutSolid {
    uint32_t body = kNone;
    uint32_t nodes = 0;      // of the lattice at load
    Range tetrahedra;        // of Actions::lattice_tetrahedron
    Range edges;             // of Actions::lattice_edge and CutLattices::cut_at
    Range faces;             // of Actions::lattice_face, lattice_uv and lattice_material: the surface at load
    Range anchors;           // of Actions::lattice_anchor, one per node at load
    Range parts;             // of CutLattices::part: those reserved
    Range copies;            // of CutLattices::node_of, likewise
    Range vertices;          // of CutLattices::vertex, likewise
    Range triangles;         // of CutLattices::triangle, uv and material, likewise
    uint32_t mesh_edges = 0; // reserved elements of the prototype
    uint32_t columns = 0;    // reserved columns of its springs
    uint32_t slots = 0;      // reserved columns of the tetrahedra around its nodes
    uint32_t wall = 0;       // material of the new surface
    TROCAR_FIELDS(body, "index of bodies", nodes, tetrahedra, "range of lattice tetrahedra", edges, "range of lattice edges", faces,
                  "range of lattice faces", anchors, "range of lattice anchors", parts, "range of cut parts", copies, "range of cut nodes",
                  vertices, "range of lattice vertices", triangles, "range of lattice triangles", mesh_edges, columns, slots, wall);
};

// A face of a lattice with a tetrahedron on one side only, outward.
struct LatticeFace {
    Triangle corner{};         // nodes
    uint32_t tetrahedron = 0;  // of the lattice
    TROCAR_FIELDS(corner, tetrahedron);
};

// A tetrahedron or what a cut left of it: a copy that owns the material at some of its corners.
struct CutPart {
    uint32_t tetrahedron = 0;        // of the lattice
    uint32_t owned = 15;             // bits, one per corner
    std::array<uint32_t, 4> node{};  // that the copy has for the corners
    double share = 1;                // of the tetrahedron's volume
    TROCAR_FIELDS(tetrahedron, owned, node, share);
};

// A vertex of the surface of a solid that may be cut.
struct CutSolidVertex {
    std::array<uint32_t, 4> point{kNone, kNone, kNone, kNone};  // nodes of the lattice that it lies between, ascending, kNone last
    uint32_t part = 0;                                          // a part that it belongs to
    std::array<uint32_t, 4> node{};                             // that it is embedded in
    std::array<double, 4> weight{1, 0, 0, 0};
    TROCAR_FIELDS(point, part, node, weight);
};

// A deformable body that instruments may heat. Temperatures are those of its nodes: the vertices of a shell or sheet,
// all nodes of a solid.
struct HeatBody {
    uint32_t body = kNone;
    Range nodes;               // of HeatState's arrays and of Actions::heat_volume
    Range edges;               // of Actions::heat_edge
    double per_volume = 0;     // J/(m^3 K), density times specific heat
    double perfusion = 0;      // W/(m^3 K), blood flow times its density and specific heat
    double metabolism = 0;     // W/m^3
    double blood = 37;         // degrees Celsius, of the arteries
    double damage_rate = 0;    // 1/s, of the Arrhenius integral
    double damage_energy = 0;  // J/mol, likewise
    double stable_dt = 0;      // s, of explicit diffusion
    double conductivity = 0;   // W/(m K)
    double wall = 0;           // m, of a shell or sheet
    double stiffening = 1;     // stiffness of denatured tissue / that before
    double boil = 0;           // J/m^3, that boil away its water
    bool parts = false;        // what has boiled away is removed
    uint32_t cut = kNone;      // the same body as one that instruments may cut
    Range springs;             // of Actions::heat_spring: factors of its springs without stiffening; empty without
    Range tetrahedra;          // of Actions::heat_tetrahedron, likewise
    TROCAR_FIELDS(body, "index of bodies", nodes, "range of heated nodes", edges, "range of heat edges", per_volume, "J/(m^3 K)", perfusion,
                  "W/(m^3 K)", metabolism, "W/m^3", blood, "C", damage_rate, "1/s", damage_energy, "J/mol", stable_dt, "s", conductivity, "W/(m K)", wall, "m",
                  stiffening, boil, "J/m^3", parts, cut, "index of cut bodies or none", springs, "range of heat springs", tetrahedra,
                  "range of heat tetrahedra");
};

// Two nodes of a heated body between which heat flows.
struct HeatEdge {
    uint32_t a = 0, b = 0;   // of HeatBody::nodes
    double conductance = 0;  // W/K
    TROCAR_FIELDS(a, b, conductance, "W/K");
};

// Constant after load; what heat needs of a body that instruments cut follows its surface.
struct Actions {
    std::vector<ToolAction> action;
    std::vector<double> time;                   // s, ascending within an action
    std::vector<CutBody> cut_body;              // ascending by body
    std::vector<std::array<uint32_t, 2>> cuts;  // index into action, index into cut_body: what each edge cuts
    std::vector<CutSolid> cut_solid;            // ascending by body
    std::vector<std::array<uint32_t, 2>> solid_cuts;           // index into action, index into cut_solid
    std::vector<std::array<uint32_t, 4>> lattice_tetrahedron;  // nodes, positive volume
    std::vector<std::array<uint32_t, 4>> lattice_neighbour;    // tetrahedron across the face that lacks a corner, or kNone
    std::vector<std::array<uint32_t, 2>> lattice_edge;         // nodes, lower first, ascending
    std::vector<LatticeFace> lattice_face;
    std::vector<std::array<Vec2, 3>> lattice_uv;
    std::vector<uint16_t> lattice_material;
    std::vector<float> lattice_anchor;          // N/m, at load
    std::vector<HeatBody> heat_body;            // ascending by body
    std::vector<double> heat_volume;            // m^3, of the tissue at a node, at rest
    std::vector<double> heat_area;              // m^2, of the surface at a node, at rest; 0 inside
    std::vector<HeatEdge> heat_edge;
    std::vector<float> heat_spring;              // as Springs::factor, of the columns of a body
    std::vector<float> heat_tetrahedron;         // as Solids::factor
    std::vector<std::array<uint32_t, 2>> heats;  // index into action, index into heat_body: what each tip heats
    TROCAR_FIELDS(action, time, "s", cut_body, cuts, cut_solid, solid_cuts, lattice_tetrahedron, lattice_neighbour, lattice_edge, lattice_face,
                  lattice_uv, lattice_material, lattice_anchor, "N/m", heat_body, heat_volume, "m^3", heat_area, "m^2", heat_edge, heat_spring,
                  heat_tetrahedron, heats);
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
    uint64_t slips = 0;          // grasps that let go of what they held, because it was pulled too hard
    double heat = 0;             // J, that cautery gave to tissue
    double burnt = 0;            // m^2, of surface that it coagulated
    bool stroke = false;         // something was cut since the trigger was pulled
    bool swept = false;          // the edge was moved in the last pass, from
    Vec3d from = Vec3d::Zero();  // m, world: point
    Vec3d from_edge = Vec3d::Zero();
    TROCAR_FIELDS(on, next, done, misfires, pulled_out, largest_force, "N", refused, area, "m^2", work, "J", owed, "J", slips, heat, "J",
                  burnt, "m^2", stroke, swept, from, "m", from_edge, "m");
};

// A staple that an action set.
struct ToolStaple {
    uint32_t action = 0;
    Entity group;           // of links
    Vec3d across{1, 0, 0};  // unit, world, of its crown when it was set
    TROCAR_FIELDS(action, "index of actions", group, across);
};

// What an action holds: a deformable body by links or a free rigid body by the friction of two jaws.
struct ToolGrasp {
    uint32_t action = 0;
    uint32_t body = kNone;
    Entity group;  // of links, of a deformable body
    // of a rigid body
    Vec3d point = Vec3d::Zero();    // m, frame of the tool's body: where the jaws hold it
    Vec3d arm = Vec3d::Zero();      // m, frame of the body: point that they hold
    Quat turn;                      // frame of the body to that of the tool's body, in which the jaws hold it
    Vec3d impulse = Vec3d::Zero();  // N s, on the body, summed over the pass
    Vec3d moment = Vec3d::Zero();   // N m s, about the point
    double stored = 0;              // J, in the pads
    double slipped = 0;             // m, how far the body has slid between the jaws so far
    double turned = 0;              // rad, how far it has turned between them
    double largest_force = 0;       // N, mean over a pass, so far
    TROCAR_FIELDS(action, "index of actions", body, "index of bodies", group, point, "m", arm, "m", turn, impulse, "N s", moment, "N m s",
                  stored, "J", slipped, "m", turned, "rad", largest_force, "N");
};

// Of the nodes of heated bodies.
struct HeatState {
    std::vector<double> rise;    // K, above the temperature of blood
    std::vector<double> damage;  // Arrhenius integral: 1 = 63 % of the proteins denatured, coagulated
    std::vector<double> steam;   // J, that boiled water away
    TROCAR_FIELDS(rise, "K", damage, steam, "J");
};

// An edge of a surface along which a cut has opened it.
struct OpenedEdge {
    uint32_t body = kNone;  // that was cut
    uint32_t a = 0, b = 0;  // its vertices
    uint32_t action = 0;
    TROCAR_FIELDS(body, "index of bodies", a, b, action, "index of actions");
};
// A node that coagulated.
struct BurntNode {
    uint32_t body = kNone;
    uint32_t node = 0;
    uint32_t action = 0;
    TROCAR_FIELDS(body, "index of bodies", node, action, "index of actions");
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
    std::vector<Vec3d> before;  // m, world, at the last pass, of bodies that a tool with a pulled trigger may cut
    TROCAR_FIELDS(count, position, "m", goal, "m", triangle, uv, material, slit, front, before, "m");
};

// Present state of the solids that may be cut. Elements beyond the counts are unused.
struct CutLattices {
    std::vector<std::array<uint32_t, 4>> count;  // one per cut solid: nodes, parts, vertices, triangles
    std::vector<double> cut_at;                  // where an edge of the lattice is cut, fraction from its lower node; 0 = it is whole
    std::vector<CutPart> part;
    std::vector<uint32_t> node_of;  // node of the lattice that a node is a copy of
    std::vector<CutSolidVertex> vertex;
    std::vector<Triangle> triangle;
    std::vector<std::array<Vec2, 3>> uv;
    std::vector<uint16_t> material;
    std::vector<Vec3d> before;  // m, world, as node_of: places of the nodes at the last pass, of solids that are being cut
    TROCAR_FIELDS(count, cut_at, part, node_of, vertex, triangle, uv, material, before, "m");
};

struct ActionState {
    std::vector<ActionProgress> progress;  // one per action
    std::vector<ToolStaple> staple;        // in the order in which they were set
    CutSurfaces cut;
    CutLattices lattice;
    std::vector<ToolGrasp> grasp;  // in the order in which they began
    HeatState heat;
    std::vector<OpenedEdge> opened;  // in this pass
    std::vector<BurntNode> burnt;    // in this pass
    std::vector<uint32_t> released;  // bodies whose links an instrument has let go of in this pass
    TROCAR_FIELDS(progress, staple, cut, lattice, grasp, heat, opened, burnt, released);
};

}  // namespace trocar
