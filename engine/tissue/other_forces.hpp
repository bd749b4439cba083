#pragma once
#include "components/actions.hpp"
#include "components/links.hpp"
#include "components/nodes.hpp"
#include "components/relaxation.hpp"
#include "components/solids.hpp"
#include "components/tears.hpp"
#include "components/thread.hpp"
#include "engine/tissue/holding_groups.hpp"
namespace trocar {

// Tables of the forces other than springs and anchors, one per family; null if absent.
struct OtherForces {
    const Solids* solids = nullptr;
    Links* links = nullptr;                  // stretched, broken and counted by the time steps of the bodies
    const HoldingGroups* holding = nullptr;  // with links, for the time steps of the bodies
    const Tears* tears = nullptr;            // with the next two: springs that may break
    Torn* torn = nullptr;
    TornSprings* torn_springs = nullptr;
    const Nodes* nodes = nullptr;  // with the next one: bodies with one degree of freedom
    NodeState* node_state = nullptr;
    const Actions* actions = nullptr;  // with the next one: what instruments do
    ActionState* action_state = nullptr;
    Relaxation* relaxation = nullptr;  // advanced by the time steps of the bodies
    const Threads* threads = nullptr;  // with the next one
    ThreadState* thread_state = nullptr;
};

}  // namespace trocar
