#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "components/contacts.hpp"
#include "components/math.hpp"
#include "components/nodes.hpp"
#include "components/report.hpp"
#include "engine/device_link.hpp"
#include "systems/app/tool_record.hpp"
namespace trocar {

// What one contact pass found and cost.
struct PassFigures {
    double time = 0;          // s, simulated, at its start
    double detection_ms = 0;  // begin stages from body boxes to islands
    double response_ms = 0;   // contact rows in all its substeps; wall time
    double frame_ms = 0;      // all stages of the pass, pictures included
    double render_ms = 0;     // of the picture drawn in this pass, 0 if none
    double depth = 0;         // m, deepest pair
    uint32_t inside_vertices = 0;
    uint32_t contacts = 0;
    uint32_t pairs = 0;         // overlapping
    double force = 0;           // N, commanded to the hand (largest tool)
    double contact_force = 0;   // N, mean contact impulse / period on the hand tool
    Energy energy;              // newest computed
    double residual = 0;        // m, deepest overlap left at its end
    uint32_t awake = 0;         // bodies that can move and were not asleep
    bool picture = false;       // a displayed frame ends with this pass
    std::vector<double> place;  // m or rad, of every body with one coordinate, at its end
    bool contact() const { return pairs > 0; }
};

// What a displayed frame cost, ms: its contact passes with all their stages, without the drawing.
std::vector<double> displayed_frames(const std::vector<PassFigures>& passes);

// Durations of one stage.
struct StageFigures {
    std::string name;
    std::vector<double> ms;
};

// What a group of links did.
struct LinkFigures {
    std::string name;
    uint64_t made = 0, broken = 0;
    double force = 0;   // N, largest, mean over a pass
    double strain = 0;  // largest
};

// What a pair of bodies took of detection in the passes in which it had candidate vertices.
struct PairFigures {
    std::string name;  // "liver/kidney"
    uint64_t passes = 0;
    double ms = 0;        // sum
    double worst_ms = 0;  // of a pass
    double vertices = 0;  // sum, near the other body, both sides
    double cell = 0;      // m, sum: size of the grid's cells
    double depth = 0;     // m, deepest
};

// A body that its node leaves one coordinate.
struct DriveFigures {
    std::string body;
    NodeBehaviour behaviour = NodeBehaviour::kNone;
    NodeEvents events;
};

// What one tool's hand was told, and by what it was held.
struct ToolFigures {
    std::string body;
    SafetyState safety;
    HapticEvents events;
    std::string device;  // live: name of the device that held it; empty = the scene's hand
    DeviceCounts counts{};
    bool device_heard = false;   // a tick accepted a sample of it
    uint64_t refused_ticks = 0;  // that found the newest sample farther than a hand can move, or no number
};

// Everything a run measured; input of metrics.json and report.html.
struct RunFigures {
    std::string scene, description, version, instruction_set, machine, started;
    uint32_t threads = 1;
    bool live = false;
    uint64_t state_hash = 0;
    uint64_t frames = 0;  // pictures (display rate), drawn or not
    double simulated_s = 0;
    uint32_t contact_rate = 0;  // Hz
    double build_s = 0;         // reading and building the scene, making its frame
    double wall_s = 0;          // of the passes and what was done between them
    std::vector<PassFigures> pass;
    std::vector<StageFigures> stage;
    std::vector<double> render_ms;
    uint64_t ticks = 0;
    double max_force = 0;                // N
    std::vector<double> tick_us;         // compute time of every haptic tick
    std::vector<double> tick_period_us;  // live only
    std::vector<double> contact_age_ms;  // live only
    uint64_t missed_ticks = 0;           // live only: deadlines that passed while the thread was away
    uint64_t doubled_periods = 0;        // live only: periods of the tick above 2 ms
    uint64_t relieved_ticks = 0;         // live only: that the second processor began because the first was held up
    std::string scheduling;              // live only: what priority was got, kernel
    bool replay = false;
    std::string replay_difference;  // replay only: what came out otherwise than in the live run; empty = nothing
    Report report;
    TreeSearch search = TreeSearch::kOwn;
    uint64_t tree_builds = 0;  // by Embree, of the bodies' trees
    std::vector<LinkFigures> link;
    std::vector<ToolFigures> tool;
    std::vector<DriveFigures> drive;
    std::vector<ToolSample> tool_sample;            // of every pass
    std::vector<std::vector<float>> pass_stage_ms;  // per pass, per stage
    std::vector<PairFigures> pair;                  // the dearest
    uint64_t pairs_met = 0;
    uint64_t movable_bodies = 0;  // deformable and free
    double body_size = 0;         // m, diameter of the smallest of them
    double world_bytes = 0;       // resident memory that grew while the world was built and stepped; live: built alone
    double bytes_per_body = 0;    // that over all bodies
    double start_gravity = 0;     // J, potential energy before the first pass
    int stopped_by = 0;           // signal, 0 = none: the run went on to its end
    bool capture_asked = false, meshes_written = false, too_many_meshes = false, recorded = false;
    double capture_s = 0;               // lockstep: what keeping states and hashes for captures took beside the passes
    std::string write_failure;          // of a picture or a mesh, the first; empty = none. The run went on without
    std::vector<std::string> captures;  // files written, in order
    std::vector<std::string> bodies;    // "liver: 5002 vertices, deformable, 1 substep"
};

// Value at quantile q in [0, 1] (nearest rank); 0 if empty.
double quantile(std::vector<double> values, double q);
double mean(const std::vector<double>& values);

// "UDP 127.0.0.1:7731: 480 samples accepted, refused in 0 ticks; received 481, malformed 1, sent 500": of a tool that a device held.
std::string device_text(const ToolFigures& tool);

// metrics.json as text; fields as README names them.
std::string metrics_json(const RunFigures& figures);

// One line per contact pass, for spreadsheets: SI units and ms as the header says.
std::string passes_csv(const RunFigures& figures);

// Only the passes that had contact: what the thesis calls a collision instance. One row each.
struct ContactColumns {
    std::vector<double> time;      // s
    std::vector<double> total;     // ms, detection and response
    std::vector<double> response;  // ms
    std::vector<double> depth_mm, inside;
};
ContactColumns contact_columns(const RunFigures& figures);

// Sixteen hexadecimal digits.
std::string state_hash_text(const RunFigures& figures);

}  // namespace trocar
