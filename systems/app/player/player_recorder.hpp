#pragma once
#include <span>
#include <string>
#include <vector>

#include "components/picture.hpp"
#include "systems/frame/frame.hpp"
namespace trocar {

// Everything that the player shows of one moment: what a run keeps of a displayed frame, coded as page/data.js reads it.
struct PlayerFrame {
    double time = 0;                // s, simulated: end of the pass
    uint64_t cost_us = 0;           // of the pass: sum of its stages
    uint64_t pass = 0;              // passes made so far
    std::vector<uint8_t> moves;     // every body: its state, and the steps of its coordinates since the frame before
    std::vector<uint8_t> surfaces;  // triangles of bodies torn since the frame before
    std::vector<uint8_t> findings;  // of the last pass: costs of stages and pairs, contacts, tools; cells, if asked for
    size_t bytes() const { return moves.size() + surfaces.size() + findings.size(); }
};

// Largest values of a run, at which scales of colours and arrows end.
struct PlayerLimits {
    double depth = 1e-6;  // m
    double push = 1e-9;   // N, of a contact
    double hand = 1e-9;   // N, on a hand
    double pair = 1e-6;   // ms, of detection, of a pair
};

// What a body does, in the lowest digits of its state; from kInIsland on, the number of its island.
enum class PlayerState : uint32_t { kAway, kAwake, kAsleep, kInIsland };

// Keeps the displayed frames of a run, or all passes of a replayed capture. Reads the world between passes and changes nothing.
// Memory is bounded: beyond kMostBytes every second frame goes, a few at each pass, so that no pass waits for it.
class PlayerRecorder {
 public:
    static constexpr size_t kMostBytes = size_t{24} << 20;
    static constexpr size_t kMostContacts = 1000, kMostLinks = 1000, kMostCells = 4000;  // per frame: the deepest, the first
    // Every vertex is shown to this part of its body's radius: soft bodies are stored in steps of twice that, rigid ones, whose
    // place, turn and shape are rounded, in steps of half of it.
    static constexpr double kError = 1.0 / (1 << 15);
    static constexpr double kTurnStep = 1.0 / (1 << 18);  // of a quaternion's components
    static constexpr double kPointStep = 1e-5;            // m, of contact points
    static constexpr double kNormalStep = 1.0 / 127;
    static constexpr double kDepthStep = 1e-8;  // m, of contact distances
    static constexpr double kForceStep = 1e-5;  // N

    // Records the present state, which `stage_ns` led to. `every_pass`: not only displayed ones, and with the cells of the grid.
    explicit PlayerRecorder(const Frame& frame, bool every_pass = false, std::span<const uint64_t> stage_ns = {},
                            size_t most_bytes = kMostBytes);
    // Call after every pass with the durations of its stages.
    void after_pass(const Frame& frame, std::span<const uint64_t> stage_ns);
    // Lets every second frame go (the first and the newest stay); false if none is left to spare.
    bool halve();
    // The recording in the format of page/data.js.
    std::vector<uint8_t> coded(const std::string& scene, const Camera& camera) const;
    const std::vector<PlayerFrame>& frames() const { return frames_; }
    size_t bytes() const { return bytes_; }        // of all frames
    uint64_t offered() const { return offered_; }  // frames, kept or not
    double worst_error() const;                    // m, of a moving body's vertex

 private:
    struct Body {
        std::string name;
        uint32_t mesh = 0;
        Motion motion = Motion::kStatic;
        bool sheet = false;
        double step = 0;  // m, of coordinates
    };
    void record(const Frame& frame, std::span<const uint64_t> stage_ns);
    void add_moves(const World& world, PlayerFrame& out);
    void add_surfaces(const World& world, PlayerFrame& out);
    void join_some();
    bool join_at(size_t index);
    bool every_pass_, has_links_ = false, is_joining_ = false;
    size_t most_bytes_, bytes_ = 0, joining_ = 0;
    uint64_t offered_ = 1, stride_ = 1;
    std::vector<std::string> stages_;
    PlayerLimits limits_;
    Vec3d origin_;  // m, world: positions are relative to it
    std::vector<Body> bodies_;
    std::vector<uint32_t> coordinates_;  // per body: seven of a pose, or three per vertex
    std::vector<HandTool> tools_;
    std::vector<int32_t> last_;    // coordinates of all bodies in the newest frame
    std::vector<uint32_t> order_;  // of torn triangles, as in Tears
    std::vector<std::array<uint32_t, 2>> cut_;  // as CutSurfaces::count, of the last frame
    size_t mesh_count_ = 0;
    std::vector<uint8_t> meshes_;  // coded: shapes, triangles, colours
    std::vector<PlayerFrame> frames_;
};

}  // namespace trocar
