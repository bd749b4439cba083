#pragma once
#include <optional>
#include <span>

#include "components/entity.hpp"
#include "systems/app/run/run_watch.hpp"
#include "systems/app/view/view_command.hpp"
#include "systems/frame/frame.hpp"
namespace trocar {

// What viewers do to a run, between passes. Kept with the pass it came before, it repeats a run to the bit.
//
// A hand holds a body by springs that end in the world. Of a soft body it holds the nodes nearest to the point, kNodes at most, by links
// that share kStiffness; they act in every substep. A free rigid body gets the impulse of a critically damped spring of kStiffness
// once a pass, of values at its end (Catto, Soft Constraints, GDC 2011): stable for any mass. Other bodies cannot be held. The hand
// follows its goal at kFastest, and no farther from the body than where it pulls with kStrongest. What the hand does is in
// Energy::work_hand: of links the change of their energy when the hand moves, of a rigid body that of its energy of motion.
//
// An instructor lets a wet body bleed, as an edge that a cut has opened does, and lets a staple slip, as one that was pulled out; nobody
// counts it as pulled out.
class ViewerActions {
 public:
    static constexpr uint32_t kNodes = 16;
    static constexpr double kStiffness = 300;  // N/m: that of a patch of liver (E = 10 kPa, 30 mm across), so that both give way alike
    static constexpr double kStrongest = 20;   // N: what an instrument bears in surgery
    static constexpr double kFastest = 0.5;    // m/s: what a hand in surgery reaches
    static constexpr uint32_t kVessels = 64;   // that an instructor may open, besides those that cuts open
    static constexpr double kNear = 0.01;      // m, from the point: where a vessel or a staple is looked for

    // Room for the links of a hand, so that the frame has the stages that move them, and for vessels that open. Before the frame is made;
    // without a hand the run has the same bits as without room.
    static void make_room(World& world);

    // Throws InputError, with nothing changed, for what this run cannot do.
    void obey(const ViewCommand& command, Frame& frame, RunWatch* watch);
    // Before every pass, after its commands: moves the hand.
    void before_pass(Frame& frame);
    bool holds() const { return body_ != kNone; }

    // Keys that kSet knows: gravity, substep, contact.tolerance, contact.push_speed, contact.iterations, BODY.tissue.friction, .damping and
    // .restitution. All are read anew in every pass, and none decides which stages a frame has.
    static bool is_marked(std::string_view key);

 private:
    void grab(uint32_t body, const Vec3d& point, World& world);
    void open_vessel(uint32_t body, const Vec3d& point, double rate, World& world);
    void slip_staple(const Vec3d& point, World& world);
    void let_go(World& world);
    void move_links(World& world, const Vec3d& by);
    void pull_rigid(World& world, double seconds);
    Vec3d held_place(const World& world) const;
    uint32_t vessels_ = 0;  // opened
    uint32_t body_ = kNone;
    Entity links_;                // of a soft body
    Vec3d arm_ = Vec3d::Zero();   // m, body frame: held point of a rigid one
    Vec3d goal_ = Vec3d::Zero();  // m, world: where the pointer is
    Vec3d hand_ = Vec3d::Zero();  // m, world: where the hand has come
};

}  // namespace trocar
