#include "systems/app/player/player_recorder.hpp"

#include "systems/app/player/player_code.hpp"
namespace trocar {

PlayerRecorder::PlayerRecorder(const Frame& frame, bool every_pass, std::span<const uint64_t> stage_ns, size_t most_bytes)
    : coder_(frame, every_pass), every_pass_(every_pass), most_bytes_(most_bytes) {
    record(frame, stage_ns);
}

void PlayerRecorder::after_pass(const Frame& frame, std::span<const uint64_t> stage_ns) {
    if (!every_pass_ && !frame.times().picture) return;
    join_some();
    if (offered_++ % stride_ == 0) record(frame, stage_ns);
}

void PlayerRecorder::record(const Frame& frame, std::span<const uint64_t> stage_ns) {
    frames_.push_back(coder_.next(frame, stage_ns));
    bytes_ += frames_.back().bytes();
}

// Joins frame `index` and the next one into the next one; false if there is none.
bool PlayerRecorder::join_at(size_t index) {
    if (index + 1 >= frames_.size()) return false;
    PlayerFrame &first = frames_[index], &second = frames_[index + 1];
    bytes_ -= first.bytes() + second.bytes();
    second.moves = join_moves(first.moves, second.moves, coder_.coordinates());
    first.surfaces.insert(first.surfaces.end(), second.surfaces.begin(), second.surfaces.end());
    second.surfaces = std::move(first.surfaces);
    bytes_ += second.bytes();
    frames_.erase(frames_.begin() + static_cast<ptrdiff_t>(index));
    return true;
}

void PlayerRecorder::join_some() {
    if (!is_joining_ && bytes_ > most_bytes_) is_joining_ = true, joining_ = 1;
    for (int pairs = 0; is_joining_ && pairs < 4; ++pairs) {
        is_joining_ = join_at(joining_++);
        if (!is_joining_) stride_ *= 2;
    }
}

bool PlayerRecorder::halve() {
    const size_t before = frames_.size();
    for (size_t i = 1; join_at(i); ++i) {
    }
    stride_ *= 2;
    return frames_.size() < before;
}

std::vector<uint8_t> PlayerRecorder::coded(const std::string& scene, const Camera& camera) const {
    std::vector<uint8_t> out = coder_.start(scene, camera, frames_.size());
    put_frames(out, frames_);
    return out;
}

}  // namespace trocar
