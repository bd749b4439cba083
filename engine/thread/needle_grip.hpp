#pragma once
#include "components/thread.hpp"
namespace trocar {

// Where tissue holds the shaft of a needle: a hold that an action made and that no thread slides in, one for each NeedleHole and in their
// order. A spring joins the tissue's point to `point`, which is in the frame of the needle and slips in any direction where the force is
// more than `upper`, N (the friction of Dahl, as Kim & Lee, "An empirical model of friction force between a needle and soft tissue", 2016,
// measured it: the tissue goes along first, then it slips).
inline bool is_grip(const ThreadHold& hold) { return !hold.slides && hold.action != kNone; }

}  // namespace trocar
