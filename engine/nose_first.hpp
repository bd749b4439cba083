#pragma once
#include "components/contacts.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

// Whether a contact's point goes out with the inside of its own body behind it: every face around the point (beside the edge,
// of the face) looks along the way out or lies in it, and one does look along it. Moved by the depth, what is just under the
// point comes to lie just under the other surface: the bodies still overlap. So it is when two balls have passed each other's
// centres, or where the nearest surface is the far side of a fold. False for points outside.
bool leaves_nose_first(const Surfaces& surfaces, const Contacts& contacts, uint32_t contact);

}  // namespace trocar
