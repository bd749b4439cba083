#pragma once
#include <cstdint>
#include <span>

#include "components/contacts.hpp"
namespace trocar {

// Makes room among the rows of contacts: new row i comes before old row before[i], ascending, so that it becomes row
// before[i] + i. What new rows hold is for the caller to write, all columns; Contacts::most is of pairs and stays.
void open_rows(std::span<const uint32_t> before, Contacts& contacts);

}  // namespace trocar
