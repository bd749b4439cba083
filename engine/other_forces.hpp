#pragma once
#include "components/links.hpp"
#include "components/nodes.hpp"
#include "components/solids.hpp"
#include "components/tears.hpp"
#include "engine/holding_groups.hpp"
namespace trocar {

// Tables of the forces besides springs and anchors, one per family; null where there are none.
struct OtherForces {
    const Solids* solids = nullptr;
    Links* links = nullptr;                  // stretched, broken and counted by the bodies' steps
    const HoldingGroups* holding = nullptr;  // with links, for the bodies' steps
    const Tears* tears = nullptr;            // with the next two: springs that break
    Torn* torn = nullptr;
    TornSprings* torn_springs = nullptr;
    const Nodes* nodes = nullptr;  // with the next one: bodies with one coordinate
    NodeState* node_state = nullptr;
};

}  // namespace trocar
