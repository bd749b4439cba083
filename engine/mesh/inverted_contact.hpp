#pragma once
#include "components/contacts.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {

// Whether a contact is inverted (through): along its separation direction the point has its own body's
// interior behind it. That is, every face around the point (next to the edge; the face itself) faces along
// that direction or is parallel to it, and at least one faces along it. After a displacement by the depth,
// the interior just under the point would be just under the other surface, so the bodies would still overlap.
// This occurs when two spheres have passed each other's centres, or where the nearest surface is the far side
// of a fold. False for points outside.
bool leaves_inverted(const Surfaces& surfaces, const Contacts& contacts, uint32_t contact);

}  // namespace trocar
