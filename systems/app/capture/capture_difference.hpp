#pragma once
#include <optional>
#include <string>

#include "systems/app/capture/capture_replay.hpp"
namespace trocar {

// Where two arrays of the same name first differ: "particles.offset, row 17, column 2 (body "liver", particle
// 17): 0.25 and 0.5, 0.25 apart"; empty if the records are equal. `scene` supplies body names; without it the
// text has row numbers only. Arrays stored as a byte stream report the byte.
std::string first_difference(const CaptureRecord& a, const CaptureRecord& b, const CaptureRecord* scene = nullptr);

// First difference between two captures that both contain pass `pass` with different hashes. Replays the pass
// from both preceding states. Returns the first stage whose results differ (if b stores them, `--capture
// FIRST-LAST`) and the first difference of the states; empty if a replay is not as recorded. Inside
// ThreadPool::run.
std::string pass_difference(const Capture& a, const Capture& b, uint64_t pass);

// The pair of bodies with the largest share of a pass's detection time, measured by its share of the
// candidate vertices. The pass is replayed from the state before it; the ms are the recorded ones. Nullopt if
// no pair had candidate vertices or the replay does not reproduce the recording. Call inside ThreadPool::run.
std::optional<PairFigures> dearest_pair(const Capture& capture, const CaptureStep& recorded);

}  // namespace trocar
