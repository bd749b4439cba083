#pragma once
#include <array>
#include <span>
#include <string>
#include <vector>

#include "components/picture.hpp"
#include "systems/app/player/player_effects.hpp"
namespace trocar {

// Everything that the player shows of one moment, coded as page/data.js reads it.
struct PlayerFrame {
    double time = 0;                // s, simulated: end of the pass
    uint64_t cost_us = 0;           // of the pass: sum of its stages
    uint64_t pass = 0;              // passes made so far
    std::vector<uint8_t> moves;     // every body: its state, and the steps of its coordinates since the frame before
    std::vector<uint8_t> surfaces;  // triangles of bodies torn since the frame before
    std::vector<uint8_t> findings;  // of the last pass: costs of stages and pairs, contacts, tools, effects; cells, if asked for
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

// Turns states of a world into frames for the player, each as steps from the one before. Reads the world between passes and
// changes nothing.
class PlayerCoder {
 public:
    static constexpr size_t kMostContacts = 1000, kMostLinks = 1000, kMostCells = 4000;  // per frame: the deepest, the first
    static constexpr size_t kMostInspected = 1000;  // bodies' boxes, candidate pairs, islands: the first of each
    // Every vertex is shown to this part of its body's radius: soft bodies are stored in steps of twice that, rigid ones, whose
    // place, turn and shape are rounded, in steps of half of it.
    static constexpr double kError = 1.0 / (1 << 15);
    static constexpr double kTurnStep = 1.0 / (1 << 18);  // of a quaternion's components
    static constexpr double kPointStep = 1e-5;            // m, of contact points
    static constexpr double kNormalStep = 1.0 / 127;
    static constexpr double kDepthStep = 1e-8;  // m, of contact distances
    static constexpr double kForceStep = 1e-5;  // N

    explicit PlayerCoder(const Frame& frame, bool with_cells = false);
    // The present state, as steps from that of the last call, at first from zero. `stage_ns`: of the pass that led to it.
    PlayerFrame next(const Frame& frame, std::span<const uint64_t> stage_ns);
    // The state of the last call of next() as steps from zero: what someone needs who saw none of the frames.
    PlayerFrame whole(const World& world) const;
    // What stands before the frames of a recording: header, meshes.
    std::vector<uint8_t> start(const std::string& scene, const Camera& camera, size_t frames) const;
    std::span<const uint32_t> coordinates() const { return coordinates_; }  // per body: seven of a pose, or three per vertex
    const Vec3d& origin() const { return origin_; }                         // m, world: positions are relative to it
    double worst_error() const;                                             // m, of a moving body's vertex

 private:
    struct Body {
        std::string name;
        uint32_t mesh = 0;
        Motion motion = Motion::kStatic;
        bool sheet = false;
        double step = 0;  // m, of coordinates
    };
    void add_meshes(const World& world);
    void add_moves(const World& world, PlayerFrame& out);
    void add_surfaces(const World& world, PlayerFrame& out);
    bool with_cells_, has_links_ = false, has_effects_ = false;
    PlayerEffects effects_;
    std::vector<std::string> stages_;
    PlayerLimits limits_;
    Vec3d origin_;
    std::vector<Body> bodies_;
    std::vector<uint32_t> coordinates_;
    std::vector<HandTool> tools_;
    std::vector<int32_t> last_;                     // coordinates of all bodies in the newest frame
    std::vector<uint32_t> state_;                   // of all bodies in the newest frame
    std::vector<uint32_t> order_;                   // of torn triangles, as in Tears
    std::vector<std::array<uint32_t, 2>> cut_;      // as CutSurfaces::count, of the newest frame
    std::vector<std::array<uint32_t, 4>> lattice_;  // as CutLattices::count, likewise
    PlayerFrame newest_;                            // time, pass, cost and findings of the newest frame
    size_t mesh_count_ = 0;
    std::vector<uint8_t> meshes_;  // coded: shapes, triangles, colours
};

// Appends frames as they follow the start of a recording: first all moves, then all findings. Mixed, the whole compresses to one
// and a half times as much.
void put_frames(std::vector<uint8_t>& out, std::span<const PlayerFrame> frames);

}  // namespace trocar
