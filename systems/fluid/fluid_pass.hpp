#pragma once
#include <span>

#include "components/actions.hpp"
#include "components/contacts.hpp"
#include "components/fluid.hpp"
#include "components/links.hpp"
#include "components/nodes.hpp"
#include "components/solids.hpp"
#include "components/tool.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {

// Inputs of all that liquids do in a contact pass. Bodies are where they are at its end.
struct FluidPass {
    double now = 0;      // s, at the start of the pass
    double seconds = 0;  // of the pass
    Surfaces surfaces;
    const Fluids& fluids;
    std::span<const HandTool> tools;
    const Actions& actions;
    const ActionState& action_state;
    const NodeState& node_state;  // films of bodies that are off stay as they are
    // what seals wounds
    const Links& links;
    const Solids& solids;
    const ContactConstraints& constraints;  // with the impulses of the pass
};

}  // namespace trocar
