#pragma once
#include <cstdint>
#include <span>

#include "components/contacts.hpp"
namespace trocar {

// Resizes all columns but `warm_start` to `count` contact constraints; impulses are set to zero.
void resize_constraints(ContactConstraints& constraints, size_t count);

// Removes the marked contact constraints, one mark each; the others keep their order.
void remove_constraints(std::span<const uint8_t> dropped, ContactConstraints& constraints);

}  // namespace trocar
