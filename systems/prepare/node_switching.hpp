#pragma once
#include "components/bodies.hpp"
#include "components/contacts.hpp"
#include "components/haptics.hpp"
#include "components/nodes.hpp"
#include "components/particles.hpp"
#include "components/spawning.hpp"
namespace trocar {

// Enables and disables the nodes whose switches are due at `time` (s, the start of a pass). A button counts
// if it was pressed since the preceding pass, an event if it was reported since then. Switches act in their
// order. A disabled body keeps its state; a disabled tool gives no force, and a tool enabled again starts
// clear of contact. Any change wakes all sleeping bodies, because it may remove their support. An exchange
// moves the other instrument, at rest, to the device of the hand; a button request applies to the exchange
// whose instrument was in the hand.
void switch_nodes(double time, const Nodes& nodes, const SpawnState& spawning, Haptics& haptics, Poses& poses, NodeState& state,
                  Sleep& sleep);

}  // namespace trocar
