#pragma once
#include <cstdint>
#include <span>

#include "components/contacts.hpp"
namespace trocar {

// Inserts elements into contacts: new element i comes before old element before[i], ascending, so its index
// is before[i] + i. The caller writes all columns of the new elements; Contacts::most is per pair and stays.
void open_rows(std::span<const uint32_t> before, Contacts& contacts);

}  // namespace trocar
