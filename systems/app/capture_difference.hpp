#pragma once
#include <optional>
#include <string>

#include "systems/app/capture_replay.hpp"
namespace trocar {

// Where two arrays of the same name first differ: "particles.offset, row 17, column 2 (body "liver", particle 17): 0.25 and 0.5,
// 0.25 apart"; empty when the records hold the same. `scene` names the bodies; without one rows are numbers alone. What is stored as
// a stream of bytes differs at a byte.
std::string first_difference(const CaptureRecord& a, const CaptureRecord& b, const CaptureRecord* scene = nullptr);

// What differs first between two captures that both hold pass `pass`, with different hashes: the pass is run again from both states
// before it. Names the first stage whose results differ where b stores them (`--capture FIRST-LAST`), and the first difference of
// the states; empty when a pass does not come out here as it was recorded. Inside ThreadPool::run.
std::string pass_difference(const Capture& a, const Capture& b, uint64_t pass);

// The pair of bodies that took most of the detection of a pass, by its share of the candidate vertices: run again from the state
// before it; ms are those recorded. None without such pairs, or when the pass does not come out here as it was recorded. Inside
// ThreadPool::run.
std::optional<PairFigures> dearest_pair(const Capture& capture, const CaptureStep& recorded);

}  // namespace trocar
