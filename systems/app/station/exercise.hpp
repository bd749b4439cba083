#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "components/math.hpp"
#include "components/mesh.hpp"
#include "systems/haptics/live_haptics.hpp"
namespace trocar {

class Frame;

// Net force of one tool on one organ during a contact pass.
struct OrganForce {
    uint32_t organ = 0;  // index into Exercise::organ
    double force = 0;    // N
};

// What one tool did by the end of a contact pass.
struct ExerciseSample {
    double time = 0;               // s
    uint32_t tool = 0;             // index into Exercise::tool
    Vec3d tip = Vec3d::Zero();     // m, world: tip as the hand holds it
    Quat turn;                     // of the device, world
    Vec3d proxy = Vec3d::Zero();   // m, world: tip kept outside of surfaces
    double grip = 0;               // rad, between the jaws
    uint32_t buttons = 0;          // one bit each
    Vec3d hand = Vec3d::Zero();    // N, on the hand, at the end of the pass, within limits
    double hand_peak = 0;          // N, largest of the ticks of the pass
    Vec3d torque = Vec3d::Zero();  // N m, on the hand
    Vec3d tissue = Vec3d::Zero();  // N, of tissue on the tool, contacts and links, mean over the pass
    uint32_t contacts = 0;         // surface constraints on the proxy
    Range organs;                  // of Exercise::organ_force
};

// Something that happened at an instant: touch, release, button_down, button_up, pass_through, limit, attach, detach, torn, pressed,
// unpressed, end_stop, detent.
struct ExerciseEvent {
    double time = 0;           // s
    std::string kind, object;  // object: link, button, or body passed through; empty for none
    uint32_t tool = kNone;     // index into Exercise::tool
};

// Part of an exercise between two events that begin phases.
struct ExercisePhase {
    std::string name;
    double from = 0, to = 0;  // s
};

// Poses, grips, forces and events of one run with tools.
struct Exercise {
    std::string source;  // what it was read from
    std::string scene, version, state_hash;
    bool live = false;
    double rate = 0;  // Hz, of the samples of a tool; 0 = not stated
    std::vector<std::string> tool, organ;
    std::vector<ExerciseSample> sample;  // ascending by time, then by tool
    std::vector<OrganForce> organ_force;
    std::vector<ExerciseEvent> event;  // ascending by time
    uint64_t lost_events = 0;          // more than a tool keeps between two passes
    bool has_turn = true, has_organs = true, has_tissue = true;
};

// Phases: "approach" until the first touch, then "contact"; a link that attaches begins the phase of its name, and "after NAME" when it
// detaches; a mark begins the phase that it names.
std::vector<ExercisePhase> phases_of(const Exercise& exercise);

// Records an exercise between passes; changes nothing. Costs nothing in a world without tools.
class ExerciseRecorder {
 public:
    explicit ExerciseRecorder(const Frame& frame);
    void after_pass(const Frame& frame);
    // Puts the largest force of a live run's ticks into the passes that they belong to. `slip`: s, per pass.
    void add_ticks(std::span<const LiveTick> ticks, std::span<const double> slip);
    Exercise& exercise() { return exercise_; }

 private:
    struct Seen {
        uint64_t events = 0;
    };
    struct SeenLink {
        bool holds = false;
        uint64_t broken = 0;
    };
    void add_tool_events(const Frame& frame, uint32_t tool);
    void add_link_events(const Frame& frame);
    void add_node_events(const Frame& frame);
    void add_organ_forces(const Frame& frame, uint32_t tool, ExerciseSample& sample);
    Exercise exercise_;
    std::vector<Seen> tool_, drive_;
    std::vector<SeenLink> link_;
    std::vector<uint32_t> organ_of_body_;                 // index into Exercise::organ or kNone
    std::vector<uint32_t> tool_of_body_;                  // or kNone
    std::vector<std::pair<uint32_t, uint32_t>> touched_;  // scratch: part of the tool, organ
    std::vector<Vec3d> touched_force_;                    // N, of each
};

}  // namespace trocar
