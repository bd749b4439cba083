#pragma once
#include "components/bodies.hpp"
#include "components/contacts.hpp"
#include "components/haptics.hpp"
#include "components/lives.hpp"
#include "components/nodes.hpp"
#include "components/particles.hpp"
namespace trocar {

// Enables and disables the nodes whose switches say so at `time` (s, the start of a pass): a button counts when it went
// down since the pass before, an event when it was reported since. Switches act in their order. Whoever is off from now on
// keeps its state as it is; a tool among them gives no force, and one that comes back begins clear of contact. When
// anything changed all sleepers wake: what carried them may be gone.
// An exchange puts the other instrument at rest into the hand that goes on, where the device is; what buttons ask for goes to
// the exchange whose instrument was in the hand.
void switch_nodes(double time, const Nodes& nodes, const Lives& lives, Haptics& haptics, Poses& poses, NodeState& state, Sleep& sleep);

}  // namespace trocar
