#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "components/contacts.hpp"
#include "components/haptic_effect.hpp"
#include "components/math.hpp"
#include "components/nodes.hpp"
#include "components/report.hpp"
#include "components/tool_state.hpp"
#include "engine/devices/link.hpp"
#include "systems/app/report/tool_record.hpp"
namespace trocar {

// Results and costs of one contact pass.
struct PassFigures {
    double time = 0;          // s, simulated, at the start of the pass
    double detection_ms = 0;  // begin stages, from body boxes to islands
    double response_ms = 0;   // contact constraints in all substeps; wall time
    double frame_ms = 0;      // all stages of the pass, pictures included
    double render_ms = 0;     // of the picture drawn in this pass, 0 if none
    double depth = 0;         // m, deepest pair
    uint32_t inside_vertices = 0;
    uint32_t contacts = 0;
    uint32_t pairs = 0;              // overlapping pairs
    double force = 0;                // N, on the hand at the end of the pass, within limits (largest tool)
    double contact_force = 0;        // N, of tissue on a simulated tool, contacts and links, mean over the pass (largest tool)
    Energy energy;                   // most recent values
    double residual = 0;             // m, deepest overlap at the end of the pass
    uint32_t awake = 0;              // movable bodies that were not asleep
    double resident = 0;             // bytes, resident memory at the end of the pass; 0 = not looked at
    bool picture = false;            // a displayed frame ends with this pass
    std::vector<double> coordinate;  // m or rad, coordinate of every one-coordinate body at the end of the pass
    bool contact() const { return pairs > 0; }
};

// ms per displayed frame: all stages of its contact passes, without drawing.
std::vector<double> displayed_frames(const std::vector<PassFigures>& passes);

// Durations of one stage.
struct StageFigures {
    std::string name;
    std::vector<double> ms;
};

// Results of one group of links.
struct LinkFigures {
    std::string name;
    uint64_t made = 0, broken = 0;
    double force = 0;   // N, maximum of the means over a pass
    double strain = 0;  // largest
};

// What all instruments of a scene did.
struct ActionFigures {
    bool any = false;                                                                      // the scene has instruments that act
    bool staples = false, cuts = false, grasps = false, cautery = false, sutures = false;  // and these kinds of actions
    uint64_t set = 0, misfires = 0, pulled_out = 0;
    double pull = 0;                                                 // N, largest force of one staple, mean over a pass
    uint64_t cut = 0, refused = 0;                                   // strokes that cut; passes whose cut found no room
    double area = 0;                                                 // m^2, of the new surface on one side
    double work = 0;                                                 // J, that it took
    uint64_t grasped = 0, nothing_grasped = 0, slipped = 0;          // grasps; that found nothing; that slipped out
    double grip = 0;                                                 // N, largest force of one grasp, mean over a pass
    uint64_t burns = 0;                                              // strokes that heated
    double owed = 0;                                                 // J, of the work of cuts, that no motion has given yet
    double heat = 0, burnt = 0;                                      // J, that they gave; m^2, of surface that coagulated
    double hottest = 0;                                              // degrees Celsius, now
    uint64_t stitches = 0, missed = 0, slipped_off = 0, throws = 0;  // bites; for which there was no room; left by the end; of knots
    double tension = 0, drawn = 0, thread_friction = 0;              // N, largest; m, through all bites; J, that it took
};

// Liquids at the end of a run, m^3.
struct FluidFigures {
    bool any = false;  // something may be wet
    double bled = 0, irrigated = 0, film = 0, pools = 0, drops = 0, sucked = 0, sucked_blood = 0, lost = 0;
    double error = 0;                                              // of the ledger, relative
    double bleeding = 0;                                           // m^3/s, out of all wounds, in the last pass
    uint32_t wounds = 0, sealed = 0;                               // whose time it is, and of them those that do not bleed
    double smoke = 0, emitted = 0, smoke_sucked = 0, cleared = 0;  // kg
};

// Detection cost of a pair of bodies, over the passes in which it had candidate vertices.
struct PairFigures {
    std::string name;  // "liver/kidney"
    uint64_t passes = 0;
    double ms = 0;        // sum over passes
    double worst_ms = 0;  // maximum per pass
    double vertices = 0;  // sum over passes, vertices of both bodies near the other one
    double cell = 0;      // m, sum over passes of the grid's cell size
    double depth = 0;     // m, deepest
};

// A body that its scene node restricts to one coordinate.
struct DriveFigures {
    std::string body;
    NodeBehaviour behaviour = NodeBehaviour::kNone;
    NodeEvents events;
};

// What one tool's hand was sent, and which device held it.
struct ToolFigures {
    std::string body;
    SafetyState safety;
    HapticEvents events;
    std::string device;  // live: name of the device; empty = the scene's scripted hand
    DeviceCounts counts{};
    bool device_heard = false;   // at least one tick accepted a sample from it
    uint64_t refused_ticks = 0;  // newest sample not a number, or farther than a hand can move
};

// Everything measured in a run; input of metrics.json and report.html.
struct RunFigures {
    std::string scene, description, version, instruction_set, machine, started;
    std::string scene_file;                              // its path, or its name among those that come with the program
    std::vector<std::array<std::string, 2>> overridden;  // keys of it and the values they were given
    uint32_t threads = 1;
    bool live = false;
    uint64_t state_hash = 0;
    uint64_t frames = 0;  // pictures at display rate, drawn or not
    double simulated_s = 0;
    double kept_s = 0;          // s, what follows per pass ends there although the run went on; 0 = it covers the whole run
    uint32_t contact_rate = 0;  // Hz
    double build_s = 0;         // reading and building the scene and its frame
    double wall_s = 0;          // s, passes and the work between them
    std::vector<PassFigures> pass;
    std::vector<StageFigures> stage;
    std::vector<double> render_ms;
    uint64_t ticks = 0;
    double max_force = 0;                // N, within the limits
    double max_force_wanted = 0;         // N, before them
    std::vector<double> tick_us;         // compute time of every haptic tick
    std::vector<double> tick_period_us;  // live only
    std::vector<double> contact_age_ms;  // live only
    uint64_t missed_ticks = 0;           // live only: deadlines missed because the thread was descheduled
    uint64_t doubled_periods = 0;        // live only: tick periods above 2 ms
    uint64_t relieved_ticks = 0;         // live only: ticks started by the second processor
    std::string scheduling;              // live only: priority obtained, kernel
    bool replay = false;
    std::string replay_difference;  // replay only: first difference from the live run; empty = none
    Report report;
    TreeSearch search = TreeSearch::kOwn;
    uint64_t tree_builds = 0;  // by Embree, of the bodies' trees
    std::vector<LinkFigures> link;
    ActionFigures actions;
    FluidFigures fluid;
    bool any_lens = false;                       // a laparoscope that fogs; at the end:
    double lens_film = 0, lens_temperature = 0;  // m, C
    uint64_t lens_wipes = 0;
    std::vector<ToolFigures> tool;
    std::vector<DriveFigures> drive;
    std::vector<ToolSample> tool_sample;            // of every pass
    std::vector<std::vector<float>> pass_stage_ms;  // per pass, per stage
    std::vector<PairFigures> pair;                  // the most expensive pairs
    uint64_t pairs_met = 0;
    uint64_t movable_bodies = 0;  // deformable and free rigid
    double body_size = 0;         // m, diameter of the smallest movable body
    double world_bytes = 0;       // growth of resident memory by building and stepping (live: building)
    double bytes_per_body = 0;    // world_bytes / all bodies
    double start_gravity = 0;     // J, potential energy before the first pass
    int stopped_by = 0;           // signal number; 0 = the run completed
    bool capture_asked = false, meshes_written = false, too_many_meshes = false, recorded = false, exercise_written = false;
    double capture_s = 0;               // lockstep: time spent on states and hashes for captures
    std::string ruin;                   // why the run has no value; empty = it has
    std::string write_failure;          // first picture or mesh that could not be written; empty = none
    std::vector<std::string> captures;  // files written, in the order of writing
    std::vector<std::string> bodies;    // "liver: 5002 vertices, deformable, 1 substep"
};

// Value at quantile q in [0, 1] (nearest rank); 0 if empty.
double quantile(std::vector<double> values, double q);
double mean(const std::vector<double>& values);

// "UDP 127.0.0.1:7731: 480 samples accepted, refused in 0 ticks; received 481, malformed 1, sent 500".
std::string device_text(const ToolFigures& tool);

// metrics.json as text; fields as README names them.
std::string metrics_json(const RunFigures& figures);

// CSV with one line per contact pass: SI units, and ms where the header says so.
std::string passes_csv(const RunFigures& figures);

// CSV with one line per contact pass: time_s and the ms of every stage. Live runs keep none.
std::string stages_csv(const RunFigures& figures);

// Columns over the passes that had contact (the thesis' "collision instances").
struct ContactColumns {
    std::vector<double> time;      // s
    std::vector<double> total;     // ms, detection and response
    std::vector<double> response;  // ms
    std::vector<double> depth_mm, inside;
};
ContactColumns contact_columns(const RunFigures& figures);

// m, deepest overlap that the last tenth of the passes found, each at its start: what contact has not parted. Unlike the residual at the
// end of a pass, which is measured against the planes of its constraints, it is that of the surfaces.
double overlap_left(const RunFigures& figures);

// Sixteen hexadecimal digits.
std::string state_hash_text(const RunFigures& figures);

}  // namespace trocar
