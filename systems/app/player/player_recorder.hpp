#pragma once
#include "systems/app/player/player_coder.hpp"
namespace trocar {

// Keeps the displayed frames of a run, or all passes of a replayed capture. Memory is bounded: beyond kMostBytes every second
// frame goes, a few at each pass, so that no pass waits for it.
class PlayerRecorder {
 public:
    static constexpr size_t kMostBytes = size_t{24} << 20;

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
    double worst_error() const { return coder_.worst_error(); }

 private:
    void record(const Frame& frame, std::span<const uint64_t> stage_ns);
    void join_some();
    bool join_at(size_t index);
    PlayerCoder coder_;
    bool every_pass_, is_joining_ = false;
    size_t most_bytes_, bytes_ = 0, joining_ = 0;
    uint64_t offered_ = 1, stride_ = 1;
    std::vector<PlayerFrame> frames_;
};

}  // namespace trocar
