#pragma once
#include <string>
#include <vector>

#include "components/picture.hpp"
#include "engine/files/capture_file.hpp"
#include "engine/world/world.hpp"
namespace trocar {

// What a capture stores about one contact pass.
struct CaptureStep {
    uint64_t pass = 0;        // number, from 0
    uint64_t state_hash = 0;  // after the pass
    double frame_ms = 0, detection_ms = 0, response_ms = 0;
    double depth = 0, force = 0;  // m, N
    uint64_t contacts = 0, inside_vertices = 0;
    std::vector<uint64_t> stage_ns;       // in the order of the header's stage names
    std::vector<uint64_t> resource_hash;  // after the pass, per Resource; empty if only the state was hashed
    std::vector<CaptureArray> input;      // live run: the tool states that the pass read, as in World
    TROCAR_FIELDS(pass, state_hash, frame_ms, detection_ms, response_ms, depth, "m", force, "N", contacts, inside_vertices, stage_ns,
                  resource_hash);
    TROCAR_OTHER_FIELDS(input);
};
CaptureRecord to_record(const CaptureStep& step);
CaptureStep read_step(const CaptureRecord& record);

// What a reader needs in addition to the world.
struct CaptureHeader {
    std::string scene, version, instruction_set, machine;
    std::string reason;  // trigger that fired
    std::vector<std::string> stages;
    Camera camera;
    bool live = false, wireframe = false, depth_colours = false;
    TROCAR_FIELDS(scene, version, instruction_set, machine, reason, stages, camera, live, wireframe, depth_colours);
};
CaptureRecord to_record(const CaptureHeader& header);
CaptureHeader read_header(const CaptureRecord& record);

// Adds all resources of one kind to a record, or restores them from it.
void save_resources(const World& world, ResourceKind kind, CaptureRecord& record);
void load_resources(const CaptureRecord& record, ResourceKind kind, World& world);

// Saves the resources that a replay starts from as a record "state", reusing the memory of an older one.
void save_state(const World& world, CaptureRecord& record);

}  // namespace trocar
